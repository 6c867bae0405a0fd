# SPDX-License-Identifier: MIT
"""python-can's own tests of its `socketcan` interface, unmodified, at the nodes of a bus."""

import subprocess

import pytest

from simtool import CANWIRE, CANWIRED, kill_all, listens, stop_canwired
from test_record import wait_until
from upstream import Suite

PARTS = 5
SELECTION = [
    "test/test_socketcan.py", "test/test_socketcan_helpers.py", "test/test_socketcan_loopback.py",
    "test/test_cyclic_socketcan.py",
    "test/back2back_test.py::BasicTestSocketCan",
    "test/back2back_test.py::SocketCanBroadcastChannel",
    "test/test_detect_available_configs.py::TestDetectAvailableConfigs::test_content_socketcan",
]
# why a test cannot be run here
WITHOUT = {
    "::test_find_available_interfaces": "it asks `ip link`, so the kernel, for three interfaces",
}
# These compare times of two processes with limits that python-can has chosen.
TIMED = ["::test_timestamp", "::test_send_periodic_duration", "CyclicSocketCan::test_modify_data_"]
# python-can itself skips these
SKIPPED = {
    "test/test_socketcan.py::SocketCANTest::test_pypy_socketcan_support",
    "test/back2back_test.py::BasicTestSocketCan::test_message_is_rx",
    "test/back2back_test.py::BasicTestSocketCan::test_message_is_rx_receive_own_messages",
    # ... with Python 3.14
    *(f"test/test_socketcan.py::SocketCANTest::test_bcm_header_factory_{name}" for name in (
        "32_bit_sizeof_long_4_alignof_long_4", "32_bit_sizeof_long_4_alignof_long_long_8",
        "64_bit_sizeof_long_8_alignof_long_8")),
}
BUS = """bus: {{ name: part{0}, bitrate: 500000, dbitrate: 2000000 }}
control: part{0}.sock
nodes:
  - {{ name: vcan0, port: "unix:vcan0-{0}.sock" }}
  - {{ name: other }}
"""


@pytest.fixture(name="rig")
def fixture_rig(tmp_path):
    """A canwired with a bus for each part of the tests."""
    names = [f"part{part}.yaml" for part in range(PARTS)]
    for part, name in enumerate(names):
        (tmp_path / name).write_text(BUS.format(part))
    (tmp_path / "rig.yaml").write_text(f"buses: [{', '.join(names)}]\n")
    log = tmp_path / "stderr"
    with log.open("w") as file:
        process = subprocess.Popen([CANWIRED, "-c", "rig.yaml"], cwd=tmp_path, stderr=file)
    wait_until(lambda: listens(tmp_path / f"part{PARTS - 1}.sock") or process.poll() is not None,
               "the buses")
    yield tmp_path
    kill_all([process])


def test_python_can_tests_its_socketcan_interface(rig):
    suite = Suite(
        "python_can", rig, TEST_SOCKETCAN="1",
        words=lambda part: [CANWIRE, "run", "--bus", f"{rig}/part{part}.sock", "--as", "vcan0",
                            "--"],
        # time for a busy machine, and half of the pauses
        attributes=["Back2BackTestCase.TIMEOUT=1", "LocalLoopbackSocketCan.TIMEOUT=1",
                    "CyclicSocketCan.TIMEOUT=1", "CyclicSocketCan.PERIOD=0.5",
                    "CyclicSocketCan.DELTA=0.2"])
    found, texts = suite.results(SELECTION, WITHOUT, TIMED, PARTS)
    assert not found["failed"], texts
    assert set(found["skipped"]) <= SKIPPED
    assert len(found["passed"] + found["skipped"]) == 46
