# SPDX-License-Identifier: MIT
"""A plugin of pytest for the tests of python-can: what they open as `virtual` is a bus of
canwire."""

import can.interfaces

can.interfaces.BACKENDS["virtual"] = ("canwire.pythoncan", "CanwireBus")
