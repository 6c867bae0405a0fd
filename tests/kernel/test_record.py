# SPDX-License-Identifier: MIT
"""Recordings of real ECUs: can-utils replay them, a full disk stops them and not the bus, and load
loses nothing."""

import json
import re
import socket
import subprocess

import pytest

from canbits import Frame
from conftest import PATIENCE_S, assert_balance, wait_until
from test_faults import Shell

BUS = """
bus: {{ name: rec, bitrate: {bitrate} }}
control: rec.sock
nodes:
  - {{ name: engine, port: vcan0, queue: 4096 }}
  - {{ name: gearbox, port: vcan1, queue: 4096 }}
record:
{records}"""
LINE = re.compile(r"\((\d+\.\d{6})\) (\S+) (\S+)")


class Rig:
    def __init__(self, daemon):
        self.daemon, self.folder, self.shell = daemon, daemon.config.parent, Shell(daemon)

    def status(self):
        return self.shell.status("rec")

    def recording(self, name):
        return next(r for r in self.status()["recordings"] if r["file"].endswith(name))

    def frames(self, count):
        wait_until(lambda: self.status()["bus"]["frames"] >= count, f"{count} frames")

    def write(self, *records, bitrate=1000000):
        self.daemon.config.write_text(text(*records, bitrate=bitrate))


def text(*records, bitrate=1000000):
    return BUS.format(bitrate=bitrate, records="".join(f"  - {{ {r} }}\n" for r in records))


@pytest.fixture
def rig(vcan, canwired):
    """rig("file: a.log") starts a bus with two ECUs that is recorded."""

    def start(*records, interfaces=2, **more):
        vcan(interfaces)
        return Rig(canwired(text(*records, **more)))

    return start


def lines(path):
    return [LINE.fullmatch(line).groups() for line in path.read_text().splitlines()]


def numbered(count, first=100):
    """Returns different frames; identifiers belong to one ECU."""
    return [Frame.parse(f"{first + i % 300:03d}#{i:08X}") for i in range(count)]


def test_canplayer_sends_what_was_recorded(rig, can_socket):
    bus = rig("file: a.log", interfaces=3)
    ecu, other, replayed = can_socket("vcan0"), can_socket("vcan1"), can_socket("vcan2")
    sent = [*numbered(40), Frame.parse("12345678#R5"), Frame.parse("7FF#")]
    for frame in sent:  # one after the other, so that their order is this one
        ecu.send(frame)
        assert len(other.receive(1)) == 1
    bus.daemon.stop()
    subprocess.run(["canplayer", "-t", "-I", bus.folder / "a.log", "vcan2=vcan0"], check=True,
                   timeout=PATIENCE_S)
    assert replayed.receive(len(sent)) == sent


def test_everything_is_recorded_under_load_and_the_bus_loses_nothing(rig, can_socket):
    count = 3000
    bus = rig("file: a.log", "file: a.pcapng, size: 200kB, files: 1000")
    ecus = [can_socket("vcan0"), can_socket("vcan1")]
    for ecu in ecus:
        ecu.send(*numbered(count, first=100 if ecu is ecus[0] else 400))
    for ecu in ecus:
        assert len(ecu.receive(count)) == count
    bus.frames(2 * count)
    status = bus.status()
    for node in status["nodes"]:
        assert_balance(node)
        assert node["tx_frames"] == count
    assert [r["lost"] for r in status["recordings"]] == [0, 0]
    bus.daemon.stop()
    log = lines(bus.folder / "a.log")
    for interface in ("vcan0", "vcan1"):
        assert sum(port == interface for _, port, _ in log) == count
    packets = 0
    for path in bus.folder.glob("a.pcapng*"):
        shown = subprocess.run(["tshark", "-r", path, "-Y", "can.flags.err == 0", "-T", "fields",
                                "-e", "frame.interface_name"], text=True, capture_output=True,
                               timeout=PATIENCE_S * 4, check=True).stdout.split()
        assert set(shown) <= {"vcan0", "vcan1"}
        packets += len(shown)
    assert packets == 2 * count


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "disk"
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "none", folder], check=True)
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_stops_the_recording_and_not_the_bus(rig, can_socket, small_disk):
    full = ("file: a.log", f"file: {small_disk}/b.pcapng", f"file: {small_disk}/c.log")
    bus = rig(*full)
    ecu, other = can_socket("vcan0"), can_socket("vcan1")
    with socket.socket(socket.AF_UNIX) as control:
        control.settimeout(PATIENCE_S)
        control.connect(str(bus.folder / "rec.sock"))
        told = control.makefile("rw")
        told.write('{"request":"watch","events":["record"]}\n')
        told.flush()
        told.readline()
        sent = 4000
        ecu.send(*numbered(sent))
        assert len(other.receive(sent)) == sent
        stopped = [json.loads(told.readline()) for _ in range(2)]
    assert {event["file"] for event in stopped} == {f"{small_disk}/b.pcapng", f"{small_disk}/c.log"}
    for event in stopped:
        assert (event["event"], event["state"], event["why"]) == (
            "record", "stopped", "No space left on device")
    recording = bus.recording("b.pcapng")
    assert (recording["state"], recording["why"]) == ("stopped", "No space left on device")
    assert "c.log: stopped: No space left on device" in bus.shell.run("status", "rec")
    sinks = {sink["name"]: sink for sink in bus.status()["sinks"]}
    assert [sink["good"] for sink in sinks.values()] == [True, False, False]
    assert sinks[f"{small_disk}/c.log"]["why"] == "No space left on device"
    assert bus.recording("a.log")["state"] == "recording"
    assert all(lines(small_disk / "c.log"))  # whole lines
    subprocess.run(["tshark", "-r", small_disk / "b.pcapng"], check=True, capture_output=True,
                   timeout=PATIENCE_S * 4)
    ecu.send(*numbered(100))
    assert len(other.receive(100)) == 100

    known = bus.recording("c.log")
    assert known["lost"] > 0 and known["entries"] + known["lost"] == sent + 100
    for path in small_disk.iterdir():
        path.unlink()
    bus.shell.run("reload", "rec")
    wait_until(lambda: bus.recording("c.log")["state"] == "recording", "the recording again")
    ecu.send(*numbered(50))
    assert len(other.receive(50)) == 50
    wait_until(lambda: bus.recording("c.log")["entries"] >= known["entries"] + 50, "more")
    log = bus.daemon.stop()
    assert "record " in log and "stopped: No space left on device" in log
    assert len(lines(bus.folder / "a.log")) == sent + 150
    assert len(lines(small_disk / "c.log")) == 50


def test_a_disk_that_is_full_at_the_start_is_no_reason_not_to_run(vcan, canwired, can_socket,
                                                                  small_disk):
    vcan(2)
    with pytest.raises(OSError), (small_disk / "fill").open("wb", buffering=0) as fill:
        while True:
            fill.write(bytes(4096))
    bus = Rig(canwired(text(f"file: {small_disk}/a.log") +
                       f"expect-report: {small_disk}/v.xml\nexpect: [ {{ errors: 0 }} ]\n"))
    assert bus.recording("a.log")["state"] == "stopped"  # before there is a frame
    assert bus.recording("a.log")["why"] == "No space left on device"
    ecu, other = can_socket("vcan0"), can_socket("vcan1")
    ecu.send(*numbered(10))
    assert len(other.receive(10)) == 10
    def report():
        return next(sink for sink in bus.status()["sinks"] if sink["kind"] == "expect-report")
    wait_until(lambda: not report()["good"], "a look at the disk")
    assert report()["why"] == "No space left on device"
    (small_disk / "fill").unlink()
    wait_until(lambda: report()["good"], "another look")
    bus.daemon.stop()
    assert (small_disk / "v.xml").read_text().startswith("<?xml")


def test_bits_are_recorded_of_ecus_that_are_silent_for_a_while(rig, can_socket):
    bus = rig("file: a.vcd", bitrate=500000)
    ecu, other = can_socket("vcan0"), can_socket("vcan1")
    for frame in numbered(5):
        before = bus.status()["bus"]["time_ns"]
        wait_until(lambda: bus.status()["bus"]["time_ns"] > before + 300_000_000, "idle time")
        ecu.send(frame)
        assert other.receive(1) == [frame]
    assert bus.recording("a.vcd")["entries"] < 5000  # idle bits are left out
    bus.daemon.stop()
    dump = (bus.folder / "a.vcd").read_text()
    fields = re.findall(r"^s(\S+) f0$", dump, re.MULTILINE)
    assert fields.count("sof") == fields.count("ack-slot") == 5
    assert fields[-1] == "idle"
