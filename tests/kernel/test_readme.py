# SPDX-License-Identifier: MIT
"""The blocks of README.md and other pages, pasted by a user without rights in an empty folder.
canwire is installed, and the machine has a can0."""

import os
import subprocess
import tempfile
from pathlib import Path

import pytest

from conftest import ip, wait_until
from readme import ROOT, SYSTEM, Reader, blocks, build_sudo, first_block

pytestmark = pytest.mark.kept

DUMPED = r"^ *{} +123 +\[4\] +DE AD BE EF"


@pytest.fixture(name="path", scope="module")
def fixture_path():
    """Installs canwire into /usr/local, of which only these tests see that. Returns a PATH, with
    the Python packages as an activated environment has them."""
    with tempfile.TemporaryDirectory(dir="/run") as name:
        folder = Path(name)
        folder.chmod(0o755)
        for part in ("upper", "work", "venv", "bin"):
            (folder / part).mkdir()
        layers = f"lowerdir=/usr/local,upperdir={folder}/upper,workdir={folder}/work"
        mounted = [["-t", "overlay", "-o", layers, "overlay", "/usr/local"],
                   ["--bind", ROOT / "build/venv", folder / "venv"]]
        for words in mounted:
            subprocess.run(["mount", *words], check=True)
        build_sudo(folder / "bin")
        environment = {k: v for k, v in os.environ.items() if k not in ("PREFIX", "DESTDIR")}
        subprocess.run([ROOT / "scripts/install-files", "install"], check=True, env=environment)
        yield f"{folder}/venv/bin:{folder}/bin:{SYSTEM}"
        for words in mounted:
            subprocess.run(["umount", words[-1]], check=True)


@pytest.fixture(name="reader")
def fixture_reader(path):
    ip("link add can0 type vcan", "link set can0 up")
    with Reader(path) as reader:
        yield reader
    for link in Path("/sys/class/net").iterdir():
        if link.name.startswith(("vcan", "can")):
            subprocess.run(["ip", "link", "del", link.name], check=False)
    for name in ("engine", "dash"):
        subprocess.run(["ip", "netns", "delete", name], check=False, capture_output=True)


def begin(reader, bus, page, file=None):
    """Saves a configuration; returns the blocks below it."""
    text, pasted = blocks(bus, page)
    reader.save(file or f"{bus}.yaml", text)
    return pasted


def test_an_ecu_goes_bus_off(reader):
    start, break_line, repair = begin(reader, "powertrain", "README.md", "bus.yaml")
    reader.paste(start)
    reader.wait(DUMPED.format("vcan1"))
    reader.paste(break_line)
    reader.wait(r"vcan0 .*ERRORFRAME(\n.*)*bus-off")
    assert "1: engine@vcan0: " in reader.said() and "can state" in reader.said()
    arrived = reader.said().count("vcan1 ")
    reader.paste(repair)
    reader.wait(DUMPED.format("vcan1"), times=arrived + 2)


def test_programs_run_without_can_in_the_kernel(reader):
    block, = begin(reader, "ci", "daemon/man/canwire-run.7.md")
    reader.paste(block)
    assert reader.said().count("can0  123   [4]  DE AD BE EF") == 1


def test_each_ecu_has_a_container(reader):
    block, = begin(reader, "boxes", "daemon/man/canwire-ports.7.md")
    reader.paste(block)
    assert reader.said().count("can0  123   [4]  DE AD BE EF") == 1


@pytest.mark.parametrize("adapter", ["usb"])
def test_a_stack_sees_a_real_controller(reader, adapter):  # pylint: disable=unused-argument
    block, = begin(reader, "real", "daemon/man/canwire-usb.8.md")
    reader.paste(block)
    assert "can state ERROR-ACTIVE" in reader.said() and "bitrate 500000" in reader.said()
    sent = Path("/sys/class/net/can7/statistics/tx_packets")
    reader.paste("cansend can7 123#DEADBEEF\n")
    wait_until(lambda: int(sent.read_text()) == 1, "the frame")


def test_a_bus_is_watched(reader):
    block, *_ = begin(reader, "seen", "daemon/man/canwire-record.7.md")
    reader.paste(block)
    said = reader.said()
    assert said.count("0x123") == 3 and '"frame":"123#DEADBEEF"' in said
    assert {"BUS", "NODE", "seen", "engine", "dash"} <= set(said.split())


def test_the_rest_of_a_bus(reader):
    reader.paste(first_block("daemon/man/canwire-restbus.1.md"))
    assert "18FEF1FE#0200" in reader.said() and "0C9#" not in reader.said()
