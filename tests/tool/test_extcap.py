# SPDX-License-Identifier: MIT
"""`canwire extcap`: the real tshark lists buses by itself and captures them."""

import os
import signal
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path

import pytest

from busrig import BusRig, rig_fixture
from simtool import CANWIRE, ROOT, TIMEOUT_S

pytestmark = pytest.mark.kept

BUS = """bus: {{ name: powertrain, bitrate: 500000 }}
control: powertrain.sock
nodes:
  - {{ name: engine, traffic: [ {{ send: 123#DEADBEEF, every: 5ms }} ] }}
  - {{ name: brake, traffic: [ {{ send: 12345678#, every: 5ms, offset: 1ms }} ] }}
faults:
  - {{ name: crc, when: {{ frame: "123", every: 20 }}, do: {{ flip: "crc[3]", at: [brake] }} }}
"""
USER = 65534  # nobody


class Rig(BusRig):
    TEXT, CONTROL = BUS, "powertrain.sock"


fixture_rig = rig_fixture(Rig)


@pytest.fixture(name="tmp_path")
def fixture_folder():
    """A folder that any user may enter."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


@pytest.fixture(name="call")
def fixture_call(tmp_path):
    """call(PROGRAM, ...) runs a program that sees the extcap folder, and the sockets of a test.
    Root's tshark takes no other folder than the system's, so it runs as a user."""
    (tmp_path / "extcap").mkdir()
    shutil.copy(CANWIRE, tmp_path)
    text = (ROOT / "scripts/wireshark/canwire.in").read_text(encoding="utf-8")
    (tmp_path / "extcap/canwire").write_text(text.replace("@BINDIR@", str(tmp_path)))
    (tmp_path / "extcap/canwire").chmod(0o755)
    user = {"user": USER, "group": USER, "extra_groups": []} if os.geteuid() == 0 else {}
    if user:
        os.chown(tmp_path, USER, USER)

    def call(*words, status=0):
        if user and (tmp_path / "powertrain.sock").exists():
            os.chown(tmp_path / "powertrain.sock", USER, USER)
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
                              env={**os.environ, "WIRESHARK_EXTCAP_DIR": str(tmp_path / "extcap"),
                                   "CANWIRE_RUN": str(tmp_path), "HOME": str(tmp_path)},
                              cwd=tmp_path, **user)
        assert done.returncode == status, done.stdout + done.stderr
        return done

    return call


def test_tshark_lists_the_buses_that_run(rig, call, tmp_path):
    r = rig()
    ended = socket.socket(socket.AF_UNIX)  # a bus that has ended without removing its socket
    ended.bind(str(tmp_path / "ended.sock"))
    ended.close()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as port:  # a port is no bus
        port.bind(str(tmp_path / "port.sock"))
        port.listen()
        listed = [line.split(". ", 1)[1] for line in call("tshark", "-D").stdout.splitlines()]
    assert [i for i in listed if "canwire" in i] == ["canwire-powertrain (CAN bus powertrain)"]
    assert "EN_CAN_SOCKETCAN" not in (types := call(
        "tshark", "-i", "canwire-powertrain", "-L").stdout) and "CAN_SOCKETCAN" in types
    r.stop()


def test_tshark_captures_a_bus(rig, call):
    r = rig()
    shown = call("tshark", "-i", "canwire-powertrain", "-c", "60", "-T", "fields", "-e", "can.id",
                 "-e", "can.flags.err", "-e", "frame.interface_name").stdout
    rows = {tuple(line.split("\t")) for line in shown.splitlines()}
    frames = {row for row in rows if row[1] in ("0", "False")}
    assert {can_id for can_id, *_ in frames} == {"291", "305419896"}
    assert frames < rows  # errors are among them
    r.stop()


def test_a_capture_without_error_frames(rig, call):
    r = rig()
    shown = call("tshark", "-i", "canwire-powertrain", "-o",
                 "extcap.canwire_powertrain.framesonly:true", "-c", "12", "-T", "fields", "-e",
                 "can.id").stdout
    assert set(shown.split()) <= {"291", "305419896", "8", "136"}
    r.stop()


def test_what_wireshark_asks(rig, call, tmp_path):
    r = rig()

    def ask(*words, status=0):
        return call(CANWIRE, "extcap", *words, status=status)

    assert ask("--extcap-interfaces", "--extcap-version=4.0").stdout.splitlines()[1:] == [
        "interface {value=canwire-powertrain}{display=CAN bus powertrain}"]
    one = "--extcap-interface", "canwire-powertrain"
    assert ask("--extcap-dlts", *one).stdout == (
        "dlt {number=227}{name=CAN_SOCKETCAN}{display=SocketCAN}\n")
    assert "{call=--frames-only}" in ask("--extcap-config", *one).stdout
    assert "use a display filter" in ask(*one, "--extcap-capture-filter", "can").stdout
    assert ask(*one, "--extcap-capture-filter", "").stdout == ""
    fifo = "--capture", "--fifo", str(tmp_path / "no/fifo")
    assert "no/fifo: No such file" in ask(*one, *fifo, status=1).stderr
    assert "display filter" in ask(*one, *fifo, "--extcap-capture-filter=can", status=1).stderr
    assert "no such interface" in ask("--extcap-dlts", "--extcap-interface", "eth0",
                                      status=1).stderr
    assert "usage: canwire extcap" in ask(*one, "--capture", status=2).stderr
    r.stop()


@pytest.mark.parametrize("reader_goes", [True, False], ids=["reader goes", "SIGTERM"])
def test_a_capture_into_a_fifo_ends_quietly(rig, tmp_path, reader_goes):
    r = rig()
    os.mkfifo(tmp_path / "fifo")
    with subprocess.Popen([CANWIRE, "extcap", "--capture", "--extcap-interface",
                           "canwire-powertrain", "--fifo", tmp_path / "fifo", "--frames-only"],
                          env={**os.environ, "CANWIRE_RUN": str(tmp_path)},
                          stderr=subprocess.PIPE) as command:
        with (tmp_path / "fifo").open("rb") as fifo:
            assert fifo.read(4) == bytes.fromhex("0A0D0D0A")
            if not reader_goes:
                command.send_signal(signal.SIGTERM)
                assert command.wait(TIMEOUT_S) == 0
        assert command.wait(TIMEOUT_S) == 0
        assert command.stderr.read() == b""
    r.stop()
