# SPDX-License-Identifier: MIT
"""Traffic of canwired itself: recordings and replies, to ECUs on real vcan; and candump's files."""

import itertools
import json
import os
import subprocess

import pytest

from canbits import Frame
from conftest import PATIENCE_S, ROOT, listeners, wait_until
from test_faults import CANWIRE, Shell

BIT_NS = 2000
COUNT = 400

# Identifiers fall: a queue by priority would turn the frames round.
FRAMES = [f"{0x700 - i:03X}#{i:04X}" for i in range(COUNT)]
GAPS_US = [300 + 7 * i % 900 for i in range(COUNT)]
TIMES_US = list(itertools.accumulate(GAPS_US, initial=0))[:COUNT]
LOG = "".join(f"(17.{t:06}) can0 {frame}\n" for t, frame in zip(TIMES_US, FRAMES))

# A slow machine delays the bus, and the frames come in the same bus time.
HEAD = """
bus: { name: traffic, bitrate: 500000 }
catch-up: 1min
control: traffic.sock
nodes:
  - { name: ecu, port: vcan0, queue: 4096 }
  - { name: acknowledging }
"""


def player(*entries, name="player", more=""):
    traffic = ", ".join(f"{{ {e} }}" for e in entries)
    return f"  - {{ name: {name}, traffic: [ {traffic} ]{more} }}\n"


@pytest.fixture(name="log")
def fixture_log(tmp_path):
    path = tmp_path / "drive.log"
    path.write_text(LOG)
    return path


def texts(frames):
    """Returns frames in the form of can-utils."""
    found = []
    for frame in frames:
        data = f"R{frame.dlc or ''}" if frame.can_id >> 30 & 1 else frame.data.hex().upper()
        wide = frame.can_id >> 31
        found.append(f"{frame.identifier:0{8 if wide else 3}X}#{data}")
    return found


def reload(daemon, text):
    before = daemon.notifications.count("READY=1")
    daemon.config.write_text(text)
    Shell(daemon).run("reload", "traffic")
    wait_until(lambda: daemon.notifications.count("READY=1") > before, "the reload")


class Watch:
    """Runs canwire watch for transmitted frames, with their bus times."""

    def __init__(self, daemon, folder, sender):
        self.file = folder / "events"
        with self.file.open("w") as out:
            self.process = Shell(daemon).start("watch", "traffic", "tx", "--json", stdout=out,
                                               stderr=subprocess.DEVNULL)
        asked = 0
        while not self.sent("ecu"):  # until it listens
            sender.send(Frame.parse(f"7FF#{asked:04X}"))
            asked += 1
            wait_until(lambda: Shell(daemon).nodes("traffic")["ecu"]["tx_frames"] == asked, "tx")

    def sent(self, node):
        """Returns the frames of a node as (ns, frame)."""
        lines = self.file.read_text().split("\n")[:-1]
        found = []
        for line in lines:
            event = json.loads(line, parse_float=str)
            if event["node"] == node:
                whole, fraction = event["t"].split(".")
                found.append((int(whole) * 10**9 + int(fraction), event["frame"]))
        return found

    def close(self):
        self.process.terminate()
        self.process.wait()


def test_a_recording_is_replayed_at_its_times(vcan, can_socket, canwired, log, tmp_path):
    vcan(1)
    ecu = can_socket("vcan0")
    daemon = canwired(HEAD)
    watch = Watch(daemon, tmp_path, ecu)
    # it begins with the reload, so that nothing is missed
    reload(daemon, HEAD + player(f"replay: {log}, offset: 1ms"))
    assert texts(ecu.receive(COUNT)) == FRAMES
    wait_until(lambda: len(watch.sent("player")) == COUNT, "all events")
    watch.close()
    got = watch.sent("player")
    assert [frame for _, frame in got] == FRAMES
    lengths = [(len(subprocess.run([CANWIRE, "bits", "--raw", frame], capture_output=True,
                                   text=True,
                                   check=True).stdout.strip())) for frame in FRAMES[::40]]
    starts = [end - bits * BIT_NS for (end, _), bits in zip(got[::40], lengths)]
    for start, time_us in zip(starts, TIMES_US[::40]):
        assert abs(start - starts[0] - time_us * 1000) < BIT_NS
    daemon.stop()


def test_a_recording_is_replayed_as_fast_as_possible(vcan, can_socket, canwired, log, tmp_path):
    vcan(1)
    ecu = can_socket("vcan0")
    daemon = canwired(HEAD)
    watch = Watch(daemon, tmp_path, ecu)
    reload(daemon, HEAD + player(f"replay: {log}, speed: max, count: 3"))
    assert texts(ecu.receive(3 * COUNT)) == FRAMES * 3
    wait_until(lambda: len(watch.sent("player")) == 3 * COUNT, "all events")
    watch.close()
    times = [time for time, _ in watch.sent("player")]
    longest = (11 + 8 + 16 + 25 + 20) * BIT_NS  # with more stuff bits than there can be
    assert all(b - a < longest for a, b in itertools.pairwise(times))  # back to back
    daemon.stop()


def test_a_remote_frame_is_answered(vcan, can_socket, canwired):
    vcan(1)
    ecu = can_socket("vcan0")
    daemon = canwired(HEAD + player("reply: 123#CAFE", "reply: 7E8#0141, to: 7DF, delay: 1ms"))
    for question, answer in (("123#R2", "123#CAFE"), ("7DF#0100", "7E8#0141")) * 3:
        ecu.send(Frame.parse(question))
        assert texts(ecu.receive(1)) == [answer]
    ecu.send(Frame.parse("123#01"), Frame.parse("124#R"), Frame.parse("7DF#0100"))
    assert texts(ecu.receive(1)) == ["7E8#0141"]
    assert Shell(daemon).run("faults", "traffic").count("\n") <= 1  # no rules but the heading
    daemon.stop()


def test_replies_stay_when_rules_come_and_go(vcan, can_socket, canwired):
    vcan(1)
    ecu = can_socket("vcan0")
    daemon = canwired(HEAD + player("reply: 123#CAFE"))
    shell = Shell(daemon)
    for name in ("one", "two"):
        shell.run("inject", "traffic", 
                  f"{{ name: {name}, when: {{ frame: 7FE }}, do: {{ drop: tx }} }}")
    assert "two" in shell.run("faults", "traffic")
    shell.run("clear", "traffic")
    shell.run("inject", "traffic",
              "[ { name: a, when: { frame: 123 }, do: { counters: ecu, tec: 40 } }, "
              "{ name: b, when: { after: { rule: a } }, do: { counters: ecu, rec: 50 } } ]")
    ecu.send(Frame.parse("123#R"))
    assert texts(ecu.receive(1)) == ["123#CAFE"]
    assert shell.nodes("traffic")["ecu"]["rec"] > 40
    daemon.stop()


def test_a_damaged_line_is_left_out_and_told(vcan, can_socket, canwired, tmp_path):
    vcan(1)
    ecu = can_socket("vcan0")
    (tmp_path / "bad.log").write_text("(1.0) a 123#\n(1.01) a 124#\n(1.02) a what\n(1.03) a 125#\n")
    daemon = canwired(HEAD + player(f"replay: {tmp_path}/bad.log", "reply: 7FE#01"))
    assert texts(ecu.receive(3)) == ["123#", "124#", "125#"]
    wait_until(lambda: "left out: 1 damaged entry of 14 bytes (line 3: " in daemon.stderr(),
               "the note")
    ecu.send(Frame.parse("7FE#R"))
    wait_until(lambda: "7FE#01" in texts(ecu.drain()), "the answer")
    daemon.stop()


def test_what_is_left_out_is_logged(vcan, can_socket, canwired, tmp_path):
    vcan(1)
    ecu = can_socket("vcan0")
    log = ROOT / "tests/traces/candump/log.log"
    daemon = canwired(HEAD + player(f"replay: {log}"))
    assert len(ecu.receive(6)) == 6
    wait_until(lambda: "left out: 1 error frame (line 6), 1 CAN FD frame (line 7)"
               in daemon.stderr(), "the note")
    daemon.stop()


def test_a_replay_that_stays_goes_on_over_a_reload(vcan, can_socket, canwired, log, tmp_path):
    vcan(1)
    ecu = can_socket("vcan0")
    (tmp_path / "other.log").write_text("(1.0) x 001#01\n(1.1) x 001#02\n")
    same = player(f"replay: {log}, count: 10")
    daemon = canwired(HEAD + same, after=["--journal", tmp_path / "journal"])
    got = ecu.receive(COUNT // 2)
    other = player(f"replay: {tmp_path}/other.log", name="other")
    reload(daemon, HEAD + other + same)
    got += ecu.receive(COUNT)
    reload(daemon, HEAD + same)
    got += ecu.receive(10 * COUNT + 2 - len(got))
    daemon.stop()
    again = subprocess.run([CANWIRE, "sim", "--journal", tmp_path / "journal", "--log", "-"],
                           capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    on_bus = [line.split()[2] for line in again.stdout.splitlines()]
    for frames in (on_bus, texts(got)):
        assert [f for f in frames if not f.startswith("001")] == FRAMES * 10


def test_a_bad_recording_is_refused_at_a_reload(vcan, can_socket, canwired, tmp_path):
    vcan(1)
    can_socket("vcan0")
    daemon = canwired(HEAD)
    daemon.config.write_text(HEAD + player(f"replay: {tmp_path}/none.log"))
    error = Shell(daemon).run("reload", "traffic", status=1)
    assert "none.log: No such file" in error
    daemon.stop()


CANDUMPS = {"log": ["-L"], "absolute": ["-t", "a"], "zero": ["-t", "z", "-x", "-a"],
            "delta": ["-t", "d"], "date": ["-t", "A"]}


def test_what_candump_records_is_replayed(vcan, can_socket, tmp_path):
    vcan(1)
    sender = can_socket("vcan0")
    before = listeners("vcan0")
    dumps = []
    for name, options in CANDUMPS.items():
        with (tmp_path / name).open("w") as out:
            dumps.append(subprocess.Popen(["candump", *options, "vcan0"], stdout=out))
    wait_until(lambda: listeners("vcan0") == before + len(CANDUMPS), "candump to listen")
    sent = ["123#DEADBEEF", "12345678#", "7FF#1122334455667788", "001#R", "00000001#R8", "000#20"]
    for text in sent:
        sender.send(Frame.parse(text))
    for name in CANDUMPS:
        wait_until(lambda: (tmp_path / name).read_text().count("\n") == len(sent), name)
    for dump in dumps:
        dump.terminate()
        dump.wait()
    times = {}
    for name in CANDUMPS:
        more = ", format: candump-delta" if name == "delta" else ""
        (tmp_path / "sim.yaml").write_text(
            "bus: { bitrate: 1000000 }\nnodes:\n  - { name: b }\n"
            # recorded faster than a bus is: some wait for others
            + player(f"replay: {tmp_path / name}{more}", more=", order: fifo"))
        output = subprocess.run([CANWIRE, "sim", tmp_path / "sim.yaml", "--log", "-"],
                                capture_output=True, text=True, check=True, timeout=PATIENCE_S,
                                env=os.environ)
        lines = [line.split() for line in output.stdout.splitlines()]
        assert [line[2] for line in lines] == sent, name
        times[name] = [line[0] for line in lines]
    assert len({tuple(t) for t in times.values()}) == 1, times
