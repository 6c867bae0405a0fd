# SPDX-License-Identifier: MIT
"""`record` in canwired and `canwire record`: what ends up in the files, and who can read them.

Nodes have traffic of their own here, so these tests need no CAN in the kernel. Recordings of real
ECUs, a full disk and load are in tests/kernel/test_record.py. CANWIRE and CANWIRED are the
programs.
"""

import fcntl
import json
import os
import re
import signal
import socket
import subprocess
import time
from pathlib import Path

import can
import pytest

from simtool import CANWIRE, CANWIRED, answer, kill_all, stop_canwired

PATIENCE_S = 30

BUS = """bus: {{ name: rec, bitrate: 500000 }}
control: rec.sock
nodes:
  - {{ name: engine, traffic: [ {{ send: 123#DEADBEEF, every: 5ms{more} }} ] }}
  - {{ name: load, traffic: [ {{ send: 12345678#R5, every: 10ms, offset: 1ms{more} }},
                              {{ send: "7FF#11", every: 10ms, offset: 2ms{more} }} ] }}
  - {{ name: dash }}
faults:
  - {{ name: crc, when: {{ frame: "123", every: 4 }}, do: {{ flip: "crc[3]", at: [dash] }} }}
record:
"""
COUNTED_ONLY = {"19", "22"}  # places of dominant bits after a flag and in a passive one
LINE = re.compile(r"\((\d{10}\.\d{6})\) (\S+) (\S+)")


def wait_until(condition, what):
    deadline = time.monotonic() + PATIENCE_S
    while not (value := condition()):
        assert time.monotonic() < deadline, f"waited {PATIENCE_S} s for {what}"
        time.sleep(0.02)
    return value


class Bus:
    """A running canwired in a folder of its own."""

    def __init__(self, folder, records, count=None, text=BUS):
        self.folder, self.text = folder, text
        self.more = f", count: {count}" if count else ""
        self.write(records)
        self.log = folder / "stderr"
        with self.log.open("w") as errors:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=folder, stderr=errors)
        wait_until(lambda: " bit/s, " in self.log.read_text() or self.process.poll() is not None,
                   "the bus")

    def write(self, records):
        text = self.text.format(more=self.more) + "".join(f"  - {{ {r} }}\n" for r in records)
        text = text if records else text.replace("record:\n", "")
        (self.folder / "bus.yaml").write_text(text)

    def canwire(self, *words, status=0):
        return answer(self.folder, *words, status=status)

    def status(self):
        return json.loads(self.canwire("status", "./rec.sock", "--json"))

    def recordings(self):
        return {Path(r["file"]).name: r for r in self.status()["recordings"]}

    def wait_frames(self, count):
        wait_until(lambda: self.status()["bus"]["frames"] >= count, f"{count} frames")

    def reload(self, records):
        self.write(records)
        self.canwire("reload", "./rec.sock")
        wait_until(lambda: set(self.recordings()) == {
            Path(re.search(r"file: ([^ ,]+)", r).group(1)).name for r in records}, "the reload")

    def stop(self):
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="bus")
def fixture_bus(tmp_path):
    started = []

    def start(*records, **more):
        started.append(Bus(tmp_path, records, **more))
        return started[-1]

    yield start
    kill_all(each.process for each in started)


def lines(path):
    found = [LINE.fullmatch(line) for line in path.read_text().splitlines()]
    assert all(found), path.read_text()
    return [(float(m[1]), m[2], m[3]) for m in found]


def generations(folder, name):
    """Returns FILE.2, FILE.1, FILE: in the order of writing."""
    numbered = sorted(folder.glob(f"{name}.*"), key=lambda p: -int(p.suffix[1:]))
    return [*numbered, folder / name]


def tshark(path, *fields, only=""):
    options = [word for field in fields for word in ("-e", field)]
    result = subprocess.run(["tshark", "-r", path, "-Y", only, "-T", "fields", *options],
                            capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    return [line.split("\t") for line in result.stdout.splitlines()]


def test_log_and_capture_have_every_frame_in_wall_clock_time(bus, tmp_path):
    began = time.time()
    running = bus("file: a.log", "file: a.pcapng")
    running.wait_frames(200)
    assert {r["state"] for r in running.recordings().values()} == {"recording"}
    stderr = running.stop()
    frames = int(re.search(r"stopped: (\d+) frames", stderr).group(1))
    log = lines(tmp_path / "a.log")
    assert len(log) == frames
    assert {(node, frame) for _, node, frame in log} == {
        ("engine", "123#DEADBEEF"), ("load", "12345678#R5"), ("load", "7FF#11")}
    assert began - 1 < log[0][0] <= log[-1][0] < time.time() + 1
    packets = tshark(tmp_path / "a.pcapng", "frame.time_epoch", "frame.interface_name",
                     only="can.flags.err == 0")
    assert [(t[:-3], node) for t, node in packets] == [
        (f"{t:.6f}", node) for t, node, _ in log]
    errors = tshark(tmp_path / "a.pcapng", "frame.interface_name",
                    only="can.flags.err == 1 && can.err.prot.location == 8")
    assert {node for node, in errors} == {"dash"}


def test_python_can_reads_the_log(bus, tmp_path):
    running = bus("file: a.log")
    running.wait_frames(50)
    running.stop()
    with can.LogReader(str(tmp_path / "a.log")) as reader:
        messages = list(reader)
    assert [(round(m.timestamp * 1e6), m.channel, m.arbitration_id, m.is_extended_id,
             m.is_remote_frame, m.dlc) for m in messages] == [
        (round(t * 1e6), node, int(frame.split("#")[0], 16), len(frame.split("#")[0]) == 8,
         "#R" in frame, 5 if "#R" in frame else len(frame.split("#")[1]) // 2)
        for t, node, frame in lines(tmp_path / "a.log")]


def values(dump):
    """Returns the changes of a VCD as a list of (time, text), without its header."""
    body, found, now = dump.split("$enddefinitions $end\n")[1], [], 0
    for line in body.splitlines():
        if line.startswith("#"):
            now = int(line[1:])
        elif not line.startswith("$"):
            found.append((now, line))
    return found


def test_a_live_dump_is_that_of_the_simulation(bus, tmp_path):
    running = bus("file: a.vcd", count=6)
    running.wait_frames(18)
    wait_until(lambda: running.status()["bus"]["time_ns"] > 100_000_000, "100 ms")
    running.stop()
    running.canwire("sim", "bus.yaml", "--until", "90ms", "--vcd", "sim.vcd")
    live, simulated = ((tmp_path / name).read_text() for name in ("a.vcd", "sim.vcd"))
    assert live.split("$enddefinitions")[0] == simulated.split("$enddefinitions")[0]
    assert values(live) == values(simulated)
    assert len(values(live)) > 1000
    assert any(change == "r8 c0" for _, change in values(live))  # a counter that is no single bit


def test_rotated_files_are_complete_and_hold_everything(bus, tmp_path):
    running = bus("file: a.log, size: 64kB, files: 1000", "file: a.vcd, size: 64kB, files: 3",
                  text=BUS.replace("every: 5ms", "every: 500us"))
    wait_until(lambda: (tmp_path / "a.log.2").exists() and (tmp_path / "a.vcd.2").exists(),
               "rotation")
    frames = int(re.search(r"stopped: (\d+) frames", running.stop()).group(1))
    log = [line for path in generations(tmp_path, "a.log") for line in lines(path)]
    assert len(log) == frames
    assert log == sorted(log, key=lambda line: line[0])
    dumps = generations(tmp_path, "a.vcd")
    assert len(dumps) == 3
    for path in dumps:
        assert path.read_text().startswith("$version")
        assert "$dumpvars" in path.read_text() or path == dumps[-1]
    for path in generations(tmp_path, "a.log")[:-1]:
        assert 64000 <= path.stat().st_size < 64100


def test_a_file_of_before_is_kept(bus, tmp_path):
    (tmp_path / "a.log").write_text("old\n")
    running = bus("file: a.log")
    running.wait_frames(5)
    running.stop()
    assert (tmp_path / "a.log.1").read_text() == "old\n"
    assert len(lines(tmp_path / "a.log")) >= 5


def test_reload_begins_ends_and_leaves_alone(bus, tmp_path):
    running = bus("file: a.log", "file: b.log")
    running.wait_frames(10)
    running.reload(["file: a.log, size: 1GB", "file: c.pcapng"])
    wait_until(lambda: running.recordings()["c.pcapng"]["entries"] > 10, "a capture")
    running.reload(["file: a.log", "file: b.log"])
    wait_until(lambda: running.recordings()["b.log"]["entries"] > 5, "the second again")
    stderr = running.stop()
    frames = int(re.search(r"stopped: (\d+) frames", stderr).group(1))
    assert len(lines(tmp_path / "a.log")) == frames  # without a gap
    assert not (tmp_path / "a.log.1").exists()
    assert len(lines(tmp_path / "b.log.1")) >= 10  # a recording of its own
    assert 0 < len(lines(tmp_path / "b.log")) < frames
    assert tshark(tmp_path / "c.pcapng", "can.id")


def test_another_format_for_a_file_waits_for_the_first_to_be_written(bus, tmp_path):
    running = bus("file: a.log")
    running.wait_frames(10)
    running.reload(["file: a.log, format: pcapng"])
    wait_until(lambda: running.recordings()["a.log"]["state"] == "recording"
               and running.recordings()["a.log"]["entries"] > 5, "a capture")
    running.stop()
    assert len(lines(tmp_path / "a.log.1")) >= 10
    assert tshark(tmp_path / "a.log", "can.id")


@pytest.mark.parametrize("file, why", [
    ("nowhere/a.log", "No such file or directory"), ("/dev/null", "no regular file")])
def test_what_cannot_be_written_is_an_error_at_the_start(bus, file, why):
    running = bus(f"file: {file}, format: candump")
    assert running.process.wait(PATIENCE_S) == 1
    assert re.search(rf"error: bus.yaml:\d+:13: record {file}: .*{why}", running.log.read_text())


def test_what_cannot_be_written_is_refused_by_a_reload(bus):
    running = bus("file: a.log")
    running.write(["file: a.log", "file: no/b.log"])
    assert "bus.yaml:12:13: record no/b.log: No such file or directory" in running.canwire(
        "reload", "./rec.sock", status=1)
    assert [r["state"] for r in running.status()["recordings"]] == ["recording"]
    running.stop()


# ---- canwire record ------------------------------------------------------------------------------


def record(running, *words):
    command = subprocess.Popen([CANWIRE, "record", "./rec.sock", *words], cwd=running.folder,
                               stderr=subprocess.PIPE, text=True)
    assert "writing" in command.stderr.readline()
    return command


def finish(command, number=signal.SIGINT):
    command.send_signal(number)
    text = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 0, text
    return text


def test_recording_from_outside_is_that_of_the_daemon(bus, tmp_path):
    running = bus("file: a.log", "file: a.pcapng")
    log, capture = record(running, "out.log"), record(running, "out.pcapng")
    before = running.status()["bus"]["frames"]
    running.wait_frames(before + 100)
    assert re.search(r"out\.log: \d+ entries, \d+ bytes$", finish(log).strip())
    finish(capture, signal.SIGTERM)
    running.stop()
    out = lines(tmp_path / "out.log")
    assert len(out) >= 100
    whole = lines(tmp_path / "a.log")
    first = whole.index(out[0])
    assert out == whole[first:first + len(out)]
    fields = ["frame.time_epoch", "frame.interface_name", "frame.p2p_dir", "can.id",
              "can.flags.err", "can.err.prot.location", "can.len", "data.data"]
    whole, out = (tshark(tmp_path / name, *fields) for name in ("a.pcapng", "out.pcapng"))
    whole = [p for p in whole if p[5] not in COUNTED_ONLY]
    first = whole.index(out[0])
    assert out == whole[first:first + len(out)]
    assert any(packet[5] == "8" for packet in out)  # errors are among them


def test_recording_from_outside_ends_with_the_bus(bus, tmp_path):
    running = bus()
    command = record(running, "out.log")
    running.wait_frames(20)
    running.stop()
    text = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 0 and "it has ended" in text
    assert len(lines(tmp_path / "out.log")) > 0


def test_recording_from_outside_follows_a_reload(bus, tmp_path):
    running = bus()
    command = record(running, "out.pcapng")
    running.wait_frames(20)
    running.text = BUS.replace("name: load", "name: other")
    running.write([])
    running.canwire("reload", "./rec.sock")
    before = running.status()["bus"]["frames"]
    running.wait_frames(before + 20)
    assert "lost" not in finish(command)
    running.stop()
    assert {node for node, in tshark(tmp_path / "out.pcapng.1", "frame.interface_name")} <= {
        "engine", "load", "dash"}
    assert "other" in {node for node, in tshark(tmp_path / "out.pcapng", "frame.interface_name")}


@pytest.mark.parametrize("words, status, message", [
    (["x.vcd"], 1, "use 'record' in the configuration, or canwire sim --vcd"),
    (["x.log", "--format", "vcd"], 1, "use 'record' in the configuration"),
    (["x.txt"], 2, "--format is needed"),
    (["-"], 2, "-: standard output says no format: --format is needed"),
    (["-", "--format", "candump", "--size", "1MB"], 2, "-: standard output is not rotated"),
    (["-", "--format", "pcapng", "--files", "2"], 2, "-: standard output is not rotated"),
    (["-", "--format", "vcd"], 1, "use 'record' in the configuration"),
    (["x.log", "--format", "asc"], 1, "expected candump or pcapng"),
    (["x.log", "--size", "1kB"], 1, "expected a size from 64kB to 1000GB"),
    (["x.log", "--files", "0"], 1, "expected a number from 1 to 1000"),
    (["no/x.log"], 1, "no/x.log: No such file or directory"),
    (["/dev/full", "--format", "candump"], 1, "no regular file"),
])
def test_recording_from_outside_refuses(bus, words, status, message):
    running = bus()
    assert message in running.canwire("record", "./rec.sock", *words, status=status)
    running.stop()


# ---- canwire record to standard output -----------------------------------------------------------


def stream(running, kind, **more):
    """Records into a pipe."""
    command = subprocess.Popen([CANWIRE, "record", "./rec.sock", "-", "--format", kind],
                               cwd=running.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               **more)
    assert b"writing standard output" in command.stderr.readline()
    return command


def end_of(command):
    assert command.wait(PATIENCE_S) == 0
    command.stdout.close()
    with command.stderr:
        return command.stderr.read().decode()


def test_each_frame_is_on_standard_output_at_once(bus):
    running = bus(text=BUS.replace("every: 5ms", "every: 500ms").replace("10ms", "500ms"))
    command = stream(running, "candump")
    for _ in range(3):  # not in blocks, which would take 100 of these
        assert LINE.fullmatch(command.stdout.readline().decode().strip())
    command.send_signal(signal.SIGINT)
    rest = len(command.stdout.readlines())
    assert re.search(rf": {rest + 3} entries, \d+ bytes$", end_of(command).strip())
    running.stop()


def test_a_viewer_shows_the_capture_live(bus):
    running = bus()
    command = stream(running, "pcapng")
    viewer = subprocess.run(["tshark", "-l", "-i", "-", "-c", "6", "-Y", "can.flags.err == 0",
                             "-T", "fields", "-e", "can.id", "-e", "frame.interface_name"],
                            stdin=command.stdout, capture_output=True, text=True,
                            timeout=PATIENCE_S, check=True)
    shown = {tuple(line.split("\t")) for line in viewer.stdout.splitlines()}
    assert ("291", "engine") in shown
    assert shown <= {("291", "engine"), ("305419896", "load"), ("2047", "load")}
    command.stdout.close()  # no reader any more: that is the end, and no error
    assert re.search(r"standard output: \d+ entries, \d+ bytes$", end_of(command).strip())
    running.stop()


def test_a_recording_ends_with_its_reader_though_the_bus_is_quiet(bus):
    running = bus(text="bus: {{ name: rec, bitrate: 500000 }}\ncontrol: rec.sock\n"
                       "nodes: [ {{ name: engine }}, {{ name: dash }} ]\n")
    command = stream(running, "candump")
    command.stdout.close()
    assert "standard output: 0 entries, 0 bytes" in end_of(command)
    running.stop()


def test_a_capture_goes_on_with_other_nodes(bus, tmp_path):
    running = bus()
    with (tmp_path / "all.pcapng").open("wb") as out:
        command = subprocess.Popen([CANWIRE, "record", "./rec.sock", "-", "--format", "pcapng"],
                                   cwd=tmp_path, stdout=out, stderr=subprocess.PIPE, text=True)
    assert "writing" in command.stderr.readline()
    running.wait_frames(20)
    running.text = BUS.replace("name: load", "name: other")
    running.write([])
    running.canwire("reload", "./rec.sock")
    running.wait_frames(running.status()["bus"]["frames"] + 20)
    assert "lost" not in finish(command)
    running.stop()
    names = [name for name, in tshark(tmp_path / "all.pcapng", "frame.interface_name",
                                      only="can.flags.err == 0")]
    assert {"engine", "load", "other"} == set(names)
    assert "load" not in names[names.index("other"):]


def test_who_does_not_read_does_not_hold_up_the_end(bus):
    running = bus()
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    with subprocess.Popen([CANWIRE, "record", "./rec.sock", "-", "--format", "pcapng"],
                          cwd=running.folder, stdout=writer, stderr=subprocess.PIPE) as command:
        assert b"writing standard output" in command.stderr.readline()
        running.wait_frames(running.status()["bus"]["frames"] + 200)  # more than the pipe holds
        command.send_signal(signal.SIGINT)
        assert command.wait(PATIENCE_S) == 1
        assert "the last of them are not written, nobody reads them" in (
            command.stderr.read().decode())
    os.close(reader)
    os.close(writer)
    running.stop()


def test_a_capture_is_not_for_a_terminal(bus):
    running = bus()
    main, terminal = os.openpty()
    refused = subprocess.run([CANWIRE, "record", "./rec.sock", "-", "--format", "pcapng"],
                             cwd=running.folder, stdout=terminal, stderr=subprocess.PIPE,
                             text=True, timeout=PATIENCE_S, check=False)
    assert (refused.returncode, refused.stderr) == (
        2, "canwire record: -: a terminal cannot show pcapng: give it to a program\n")
    os.close(main)
    os.close(terminal)
    running.stop()
