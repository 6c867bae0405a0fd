# SPDX-License-Identifier: MIT
"""A plugin of pytest for the tests of python-can: what they open as `virtual` is a bus of canwire.

The class is exchanged in its module. So the tests that replace it there by a mock get one that has
what the interface of canwire has. Some look into the module, or into the queue of a bus.
"""

import queue


def class_with_queue(canwire_bus):
    """Returns the class with the attribute `queue`: the messages that have come and nobody has
    taken."""
    class WithQueue(canwire_bus):
        def __init__(self, *arguments, **more):
            self.came = queue.SimpleQueue()
            super().__init__(*arguments, **more)

        @property
        def queue(self):
            while (message := super()._recv_internal(0)[0]) is not None:
                self.came.put(message)
            return self.came

        def _recv_internal(self, timeout):
            if self.came.empty():
                return super()._recv_internal(timeout)
            return self.came.get(), False

    return WithQueue


def pytest_collection_modifyitems():
    # The tests import it first, while pytest catches the output: can.Printer closes what was the
    # standard output then.
    # pylint: disable=import-outside-toplevel
    from can.interfaces import virtual

    from canwire import pythoncan

    virtual.VirtualBus = class_with_queue(pythoncan.CanwireBus)
    virtual.channels, virtual.channels_lock = pythoncan.Wire.all, pythoncan.Wire.lock
