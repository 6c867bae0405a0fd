# SPDX-License-Identifier: MIT
"""python-can's own tests of its interface `virtual`, unmodified, with buses of canwire instead.

These are all of its tests that open a bus of that interface, or put a mock in its place.
"""

from upstream import Suite

PARTS = 4
# The tests of python-can, and how many of them pass.
TESTS = {
    "back2back_test.py::Back2BackTestCase": 14,
    "back2back_test.py::TestThreadSafeBus": 16,
    "contextmanager_test.py": 2,
    "listener_test.py": 10,
    "network_test.py": 2,
    "notifier_test.py": 5,
    "simplecyclic_test.py": 7,
    "test_bridge.py": 1,
    "test_bus.py": 2,
    "test_cli.py": 4,
    "test_detect_available_configs.py::TestDetectAvailableConfigs::test_general_values": 1,
    "test_interface.py::test_interface_calls_parent_shutdown[canwire]": 1,
    "test_interface.py::test_interface_calls_parent_shutdown[virtual]": 1,
    "test_interface_virtual.py": 1,
    "test_logger.py": 11,
    "test_message_filtering.py": 3,
    "test_player.py": 10,
    "test_viewer.py": 2,
    "zero_dlc_test.py": 3,
}
# These cannot pass: why. test_detect_available_configs.py has one more, which wants that
# configurations have the name of the interface `virtual`; the others wait for other interfaces.
WITHOUT = {
    "test_sendmsg_preserve_timestamp": "the time of a frame is that on the bus",
    "CanViewerTest::test_send": "it sends an error frame, which no controller does when told",
    "CanViewerTest::test_receive": "so does it",
}
# python-can itself skips these
SKIPPED = {f"test/back2back_test.py::{case}::test_message_is_rx{end}"
           for case in ("Back2BackTestCase", "TestThreadSafeBus")
           for end in ("", "_receive_own_messages")}
# These have limits of time, some of 0.1 s.
TIMED = ["back2back_test.py", "ProducerConsumer", "contextmanager_test.py", "notifier_test.py",
         "simplecyclic_test.py", "test_bridge.py", "test_interface_virtual.py", "zero_dlc_test.py"]


def count(found):
    """Returns how many of the names are in each entry of TESTS."""
    return {entry: sum(name.startswith(f"test/{entry}") for name in found) for entry in TESTS}


def test_python_can_runs_on_canwire_in_place_of_virtual(tmp_path):
    suite = Suite("python_can", tmp_path, plugins=["as_virtual"],
                  attributes=["Back2BackTestCase.TIMEOUT=0.5"])
    found, texts = suite.results([f"test/{entry}" for entry in TESTS], WITHOUT, TIMED, PARTS)
    assert not found["failed"], texts
    assert count(found["passed"]) == TESTS
    assert set(found["skipped"]) == SKIPPED
