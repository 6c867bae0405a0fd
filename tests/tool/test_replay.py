# SPDX-License-Identifier: MIT
"""Traffic of `canwire sim`: jitter, recordings of real tools replayed, replies; how a run ends.

candump's files in tests/traces were made by candump; ASC is written by python-can and captures by
text2pcap and editcap while the tests run. Needs no CAN in the kernel.
"""

import fcntl
import itertools
import json
import os
import pty
import re
import select
import shutil
import signal
import struct
import subprocess
import termios
import threading
import time

import can
import pytest

from simtool import CANWIRE, ROOT, TIMEOUT_S, canwire, events, sim

pytestmark = pytest.mark.kept

TRACES = ROOT / "tests/traces"

BIT_NS = 2000  # 500 kbit/s
JOIN = 11  # bits before the first SOF
INTERMISSION = 3


def bus(*entries, more=""):
    """Returns a node with this traffic, and one that acknowledges."""
    traffic = "".join(f"      - {{ {entry} }}\n" for entry in entries)
    return (f"bus: {{ bitrate: 500000 }}\nseed: 1\nnodes:\n  - name: a\n    traffic:\n{traffic}"
            f"  - name: b\n{more}")


def wire_bits(frame):
    """Counts the bits from SOF to EOF."""
    return len(canwire("bits", "--raw", frame).stdout.strip())


def ns(seconds):
    """Converts times in events and logs."""
    whole, fraction = str(seconds).split(".")
    return int(whole) * 10**9 + int(fraction.ljust(9, "0"))


def transmissions(path, *arguments):
    """Returns (start of SOF in ns, frame) of all transmissions."""
    found = []
    for line in sim(path, *arguments, "--events", "-").stdout.splitlines():
        if '"event":"tx"' in line:
            time = re.match(r'{"t":([0-9.]+)', line)[1]
            frame = json.loads(line)["frame"]
            found.append((ns(time) - wire_bits(frame) * BIT_NS, frame))
    return found


def begins(release_ns, start_ns):
    """Checks that a frame handed in at that time, to an idle bus, begins with the next bit."""
    return 0 <= start_ns - max(release_ns, JOIN * BIT_NS) < BIT_NS


# ---- Jitter --------------------------------------------------------------------------------------

JITTER = "send: 123#11, every: 1ms, jitter: 700us, offset: 5ms, count: 200"


@pytest.mark.figures
def test_jitter_delays_within_its_bounds_and_keeps_the_grid(write):
    starts = [t for t, _ in transmissions(write(bus(JITTER)))]
    delays = [t - 5_000_000 - k * 1_000_000 for k, t in enumerate(starts)]
    assert len(starts) == 200
    assert all(0 <= d < 700_000 + BIT_NS for d in delays)
    assert min(delays) < 50_000 and max(delays) > 650_000
    assert 300_000 < sum(delays) / 200 < 400_000


@pytest.mark.figures
def test_jitter_depends_on_the_seed_and_on_nothing_else(write):
    path = write(bus(JITTER))
    first = transmissions(path)
    assert transmissions(path) == first
    assert transmissions(path, "--seed", "2") != first
    more = write(bus("send: 7FF#, offset: 900ms", JITTER, "send: 7FE#, offset: 901ms",
                     more="faults: [ { name: f, when: { probability: 0.5, time: 1s.. }, "
                          "do: { flip: sof } } ]\n"), "more.yaml")
    assert [t for t in transmissions(more) if t[1].startswith("123")] == first


@pytest.mark.figures
def test_equal_entries_have_jitter_of_their_own(write):
    starts = [t for t, _ in transmissions(write(bus(JITTER, JITTER.replace("5ms", "305ms"))))]
    assert [t - 300_000_000 for t in starts[200:]] != starts[:200]


@pytest.mark.figures
def test_jitter_as_long_as_the_period_keeps_the_order(write):
    path = write(bus("send: 123#, every: 100us, jitter: 100us, count: 50",
                     "send: 124#, every: 100us, offset: 10ms, jitter: 100us, count: 50"))
    assert len(transmissions(path)) == 100


# ---- Recordings ----------------------------------------------------------------------------------

# (time in us, frame or what it is instead)
DRIVE = [(1000, "123#DEADBEEF"), (2000, "7FF#"), (3000, "12345678#1122334455667788"),
         (4000, "123#R4"), (5000, "error"), (6000, "fd"), (8000, "100#FF")]
FRAMES = [(t, f) for t, f in DRIVE if "#" in f]


def message(time_us, frame):
    if frame == "error":
        return can.Message(is_error_frame=True, timestamp=100 + time_us / 1e6, channel=0)
    if frame == "fd":
        return can.Message(arbitration_id=0x123, is_extended_id=False, is_fd=True, channel=0,
                           data=bytes(12), timestamp=100 + time_us / 1e6)
    identifier, data = frame.split("#")
    remote = data.startswith("R")
    return can.Message(arbitration_id=int(identifier, 16), is_extended_id=len(identifier) == 8,
                       is_remote_frame=remote, dlc=int(data[1:]) if remote else None,
                       data=None if remote else bytes.fromhex(data),
                       timestamp=100 + time_us / 1e6, channel=0)


def by_python_can(path):
    with can.Logger(path) as log:
        for entry in DRIVE:
            log(message(*entry))


def packet(frame):
    """Returns a packet of LINKTYPE_CAN_SOCKETCAN."""
    if frame == "error":
        return "20000004 08000000 0004000000000000"
    if frame == "fd":
        return "00000123 0C040000" + "00" * 12
    identifier, data = frame.split("#")
    flags = (0x80000000 if len(identifier) == 8 else 0) | (0x40000000 if "R" in data else 0)
    length = int(data[1:]) if "R" in data else len(data) // 2
    return f"{int(identifier, 16) | flags:08X} {length:02X}000000" + ("" if "R" in data else data)


def by_text2pcap(path, *options):
    text = ""
    for time_us, frame in DRIVE:
        data = bytes.fromhex(packet(frame).replace(" ", ""))
        text += f"{time_us / 1e6:.6f}\n0000  {data.hex(' ')}\n"
    subprocess.run(["text2pcap", "-q", "-t", "%s.%f", "-l", "227", *options, "-", path],
                   input=text, text=True, check=True, timeout=TIMEOUT_S, capture_output=True)


def by_editcap(path, kind):
    capture = path.with_suffix(".first")
    by_text2pcap(capture)
    subprocess.run(["editcap", "-F", kind, capture, path], check=True, timeout=TIMEOUT_S,
                   capture_output=True)


MAKERS = {
    "drive.asc of Vector": lambda path: shutil.copy(TRACES / "drive.asc", path),
    "drive.asc of python-can": by_python_can,
    "drive.log of python-can": by_python_can,
    "drive.pcapng of text2pcap": by_text2pcap,
    "drive.pcap of editcap": lambda path: by_editcap(path, "pcap"),
    "nano.pcap of editcap": lambda path: by_editcap(path, "nsecpcap"),
    "drive.pcapng": lambda path: shutil.copy(TRACES / "drive.pcapng", path),
}


@pytest.mark.parametrize("name", MAKERS)
def test_recordings_are_replayed_at_their_times(name, write, tmp_path):
    if "cap" in name and " of " in name and not shutil.which("text2pcap"):
        pytest.skip("text2pcap and editcap are not installed (wireshark-common)")
    recording = tmp_path / name.split()[0]
    MAKERS[name](recording)
    path = write(bus(f"replay: {recording.name}, offset: 10ms"))
    result = sim(path, "--events", "-")
    # python-can's loses the length of remote frames in logs
    expected = [(t, "123#R" if "R" in f and "log of" in name else f) for t, f in FRAMES]
    got = transmissions(path)
    assert [f for _, f in got] == [f for _, f in expected]
    # ASC of Vector begins with "Start of measurement" at 0, all others with their first frame
    first = 0 if "Vector" in name else FRAMES[0][0]
    for (start, _), (time_us, _) in zip(got, expected):
        assert begins((10_000 + time_us - first) * 1000, start)
    assert f"{recording.name}: left out: 1 error frame (" in result.stderr
    assert "1 CAN FD frame (" in result.stderr


CANDUMP = {"log.log": {}, "absolute.txt": {}, "date-errors.txt": {}, "binary.txt": {},
           "swapped.txt": {}, "zero-extra-ascii.txt": {}, "log-extra.log": {}, "logfile.log": {},
           "delta.txt": {"format": "candump-delta"}}
CANDUMP_FRAMES = [(0, "123#DEADBEEF"), (600983, "12345678#1122334455667788"), (959421, "7FF#"),
                  (1126732, "00A#R"), (1177048, "00A#R5"), (1628914, "000#41424320")]


@pytest.mark.parametrize("name", CANDUMP)
def test_files_of_candump_are_replayed_at_their_times(name, write):
    more = "".join(f", {key}: {value}" for key, value in CANDUMP[name].items())
    got = transmissions(write(bus(f"replay: {TRACES}/candump/{name}{more}")))
    assert [f for _, f in got] == [f for _, f in CANDUMP_FRAMES]
    assert all(begins(t * 1000, start) for (t, _), (start, _) in zip(CANDUMP_FRAMES, got))


def test_a_path_is_relative_to_the_file_that_names_it(write, tmp_path, monkeypatch):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/drive.log").write_text("(1.0) can0 123#11\n")
    path = write(bus("replay: logs/drive.log"))
    monkeypatch.chdir("/")
    assert [f for _, f in transmissions(path)] == ["123#11"]


def test_filters_and_interfaces_choose_but_times_stay(write):
    log = f"{TRACES}/candump/log.log"
    path = write(bus(f'replay: {log}, only: ["7FF:7FF", 12345678]',
                     f"replay: {log}, only: 00A, interface: vcan7",
                     f"replay: {log}, interface: can-log1, only: 000"))
    got = transmissions(path)
    expected = [entry for entry in CANDUMP_FRAMES if entry[0] > 0]
    assert [f for _, f in got] == [f for _, f in expected]
    assert all(begins(t * 1000, start) for (t, _), (start, _) in zip(expected, got))


def test_what_is_left_out_is_told_once_for_a_file(write):
    log = f"{TRACES}/candump/log.log"
    result = sim(write(bus(f"replay: {log}, only: 123", f"replay: {log}, only: 7FF")))
    assert result.stderr.count("left out") == 1


def test_a_recording_is_repeated(write, tmp_path):
    (tmp_path / "r.log").write_text("(5.0) a 123#\n(5.001) a 123#01\n")
    got = transmissions(write(bus("replay: r.log, count: 3, gap: 4ms, offset: 1ms")))
    assert [f for _, f in got] == ["123#", "123#01"] * 3
    assert all(begins(t * 1_000_000, start)
               for t, (start, _) in zip((1, 2, 6, 7, 11, 12), got))


def test_a_loop_needs_an_end(write, tmp_path):
    (tmp_path / "r.log").write_text("(5.0) a 123#\n")
    path = write(bus("replay: r.log, loop: on"))
    assert f"{path}:6:9: traffic without `count` never ends: " in sim(path, status=1).stderr
    assert len(transmissions(path, "--until", "10.5ms")) == 11


# ---- As fast as possible -------------------------------------------------------------------------

# Identifiers fall, so that a queue by priority would turn them round.
FAST = "".join(f"(9.{i:06}) can0 {0x700 - i:03X}#{'55' * (i % 9)}\n" for i in range(300))


@pytest.mark.figures
def test_max_speed_leaves_no_gap_and_keeps_the_order(write, tmp_path):
    (tmp_path / "fast.log").write_text(FAST)
    path = write(bus("replay: fast.log, speed: max"))
    got = transmissions(path)
    assert [f for _, f in got] == [line.split()[2] for line in FAST.splitlines()]
    assert got[0][0] == JOIN * BIT_NS
    for (start, frame), (following, _) in itertools.pairwise(got):
        assert following == start + (wire_bits(frame) + INTERMISSION) * BIT_NS
    assert sim(path, "--events", "-").stdout == sim(path, "--events", "-", "--step").stdout


def test_max_speed_is_the_same_bit_by_bit(write, tmp_path):
    """Also where nodes collide, are alone, one-shot or lose arbitration; VCD steps each bit."""
    (tmp_path / "fast.log").write_text(FAST)
    same = bus("replay: fast.log, speed: max", "send: 001#, every: 3ms, count: 9",
               more="    traffic: [ { replay: fast.log, speed: max, only: 6F0:7F0 }, "
                    "{ send: 123#55, every: 777us, count: 20 } ]\n  - name: c\n")
    alone = bus("replay: fast.log, speed: max").replace("  - name: b\n", "")
    shot = bus("replay: fast.log, speed: max", more="    one-shot: on\n    traffic: [ { replay: "
               "fast.log, speed: max, count: 2 } ]\n").replace("- name: a", "- one-shot: on\n    "
                                                               "name: a")
    for text, until in ((same, "3s"), (alone, "100ms"), (shot, "3s")):
        path = write(text)
        plain = sim(path, "--until", until, "--events", "-").stdout
        assert plain.count('"event":"tx"') > 100 or text is alone
        assert sim(path, "--until", until, "--events", "-", "--step").stdout == plain
        trace = sim(path, "--until", until, "--events", "-", "--vcd", tmp_path / "vcd").stdout
        assert trace == plain


def test_max_speed_needs_no_times_and_is_repeated_at_once(write):
    path = write(bus(f"replay: {TRACES}/candump/no-time.txt, speed: max, count: 2"))
    assert [f for _, f in transmissions(path)] == [f for _, f in CANDUMP_FRAMES] * 2


@pytest.mark.figures
def test_max_speed_shares_the_bus_and_the_node(write, tmp_path):
    (tmp_path / "fast.log").write_text(FAST)
    path = write(bus("replay: fast.log, speed: max", "send: 001#, every: 1ms, count: 40",
                     more="    traffic: [ { send: 002#, every: 1ms, count: 40 } ]\n"))
    got = [f for _, f in transmissions(path)]
    assert got.count("001#") == 40 and got.count("002#") == 40
    assert [f for f in got if f not in ("001#", "002#")] == \
        [line.split()[2] for line in FAST.splitlines()]


@pytest.mark.figures
def test_max_speed_waits_while_the_node_is_bus_off(write, tmp_path):
    (tmp_path / "fast.log").write_text(FAST)
    faults = ("faults:\n  - { name: off, when: { frame: 6FF, count: 1 }, do: { bus-off: a } }\n"
              "  - { name: on, when: { after: { rule: off, delay: 5ms } }, do: { restart: a } }\n")
    path = write(bus("replay: fast.log, speed: max", more=faults))
    frames = [f for _, f in transmissions(path)]
    # the one that was on the wire is lost with the restart, as with a real controller
    assert frames == [line.split()[2] for line in FAST.splitlines() if " 6FF#" not in line]


@pytest.mark.figures
def test_max_speed_waits_no_longer_than_the_quiet_time(write, tmp_path):
    (tmp_path / "fast.log").write_text(FAST)
    faults = "faults:\n  - { name: off, when: { frame: 6FF, count: 1 }, do: { bus-off: a } }\n"
    result = sim(write(bus("replay: fast.log, speed: max", more=faults)), "--stats", "-")
    assert "ended before the last release" in result.stderr
    assert json.loads(result.stdout)["bus"]["time_ns"] // 10**9 == 10


def test_max_speed_is_not_carried_away_by_dropped_frames(write, tmp_path):
    (tmp_path / "fast.log").write_text(FAST)
    faults = "faults:\n  - { name: no, when: { frame: 400:400 }, do: { drop: tx } }\n"
    found = events(write(bus("replay: fast.log, speed: max", more=faults)))
    dropped = [e["frame"] for e in found if e["event"] == "drop"]
    assert dropped == [line.split()[2] for line in FAST.splitlines()]
    times = [e["t"] for e in found]
    assert times == sorted(times)


# ---- More than the queue holds -------------------------------------------------------------------

FULL = """
bus: { bitrate: 500000 }
nodes:
  - { name: a, order: fifo, traffic: [ ENTRIES ] }
  - { name: b, queue: 64, traffic: [ { send: 7FF#, every: 3ms, count: 50 } ] }
"""


def crowd(count, at_once):
    """Returns a log in which so many frames have one time."""
    return "".join(f"({1 + i // at_once}.0) can0 {0x7F0 - i % 0x7F0:03X}#{i:04X}\n"
                   for i in range(count))


@pytest.mark.parametrize("count, at_once, late", [(17, 17, 1), (16, 16, 0), (3000, 1000, 2952)])
@pytest.mark.parametrize("bus_keys", ["", "dbitrate: 2000000, "])
def test_frames_of_one_time_wait_for_room_in_the_queue(bus_keys, count, at_once, late, write,
                                                       tmp_path):
    (tmp_path / "r.log").write_text(crowd(count, at_once))
    text = FULL.replace("ENTRIES", "{ replay: r.log }")
    path = write(text.replace("{ bitrate", "{ " + bus_keys + "bitrate"))
    result = sim(path, "--log", "-")
    got = [line.split()[2] for line in result.stdout.splitlines() if " a " in line]
    assert got == [line.split()[2] for line in crowd(count, at_once).splitlines()]
    told = re.findall(r"r.log: (\d+) frames? waited for room in the queue of a and came up to "
                      r"[\d.]+[mu]s late \(queue: 16\)\n", result.stderr)
    assert told == ([str(late)] if late else [])
    assert result.stderr.count("\n") == bool(late)
    step = sim(path, "--log", "-", "--step")
    assert (step.stdout, step.stderr) == (result.stdout, result.stderr)


def test_two_recordings_and_other_traffic_share_a_full_queue(write, tmp_path):
    (tmp_path / "r.log").write_text(crowd(300, 100))
    (tmp_path / "s.log").write_text(crowd(40, 20))
    entries = "{ replay: r.log }, { replay: s.log, offset: 1us, count: 2 }, " \
        "{ send: 001#, every: 2ms, count: 900 }"
    path = write(FULL.replace("ENTRIES", entries))
    result = sim(path, "--events", "-")
    found = [json.loads(line) for line in result.stdout.splitlines()]
    sent = [e["frame"] for e in found if e["event"] == "tx" and e["node"] == "a"]
    assert [f for f in sent if f != "001#"].count("7F0#0000") == 3
    assert len([f for f in sent if f != "001#"]) == 300 + 2 * 40
    assert {e["frame"] for e in found if e["event"] == "drop"} == {"001#"}
    assert result.stderr.count("waited for room") == 2
    assert sim(path, "--events", "-", "--step").stdout == result.stdout


# ---- Replies -------------------------------------------------------------------------------------

REPLY = """
bus: { bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 100#R2, every: 10ms, count: 3 }, { send: 100#11, offset: 5ms },
               { send: 200#, offset: 35ms }, { send: 210#, offset: 45ms } ]
  - name: b
    traffic: [ { reply: 100#CAFE }, { reply: 700#, to: 200:7F0, delay: 1ms, count: 1 } ]
"""


def test_replies_answer_remote_frames_and_what_they_are_told_to(write):
    path = write(REPLY)
    got = transmissions(path)
    assert [f for _, f in got] == ["100#R2", "100#CAFE", "100#11", "100#R2", "100#CAFE", "100#R2",
                                   "100#CAFE", "200#", "700#", "210#"]
    remote = got[0][0] + wire_bits("100#R2") * BIT_NS
    assert got[1][0] == remote + INTERMISSION * BIT_NS
    received = got[7][0] + (wire_bits("200#") - 1) * BIT_NS  # at the last but one bit of EOF
    assert got[8][0] == received + 1_000_000
    kinds = {e["event"] for e in events(path)}
    assert kinds == {"tx", "rx"}  # a reply is no fault


def test_replies_are_no_rules(write):
    report = json.loads(sim(write(REPLY), "--stats", "-").stdout)
    assert report["rules"] == [] and report["bus"]["faults"] == 0


# ---- What goes wrong -----------------------------------------------------------------------------


TORN = {  # the text behind three lines of a log, and its message
    "a cut line": ("(1.3) a 126#0", "1 damaged entry of 13 bytes (line 4: '126#0'"),
    "a torn line": ("(1.2) a 12\n5#11\n(1.3) a 126#\n",
                    "2 damaged entries of 16 bytes (the first at line 4: expected"),
    "a line without time": ("a 12345#\na 125#11\n(1.3) a 126#\n",
                            "1 damaged entry of 9 bytes (line 4: '12345#'"),
    "bytes 0": ("\0" * 70000, "1 damaged entry of 70000 bytes (line 4: a byte 0"),
    "bytes 0 and more": ("\0" * 70000 + "(1.3) a 126#\n(1.4) a\n",
                         "2 damaged entries of 70008 bytes (the first at line 4: a byte 0"),
    "a line that may be cut": ("(1.3) a 126#00",
                               "1 frame whose line has no end and may be cut (line 4)"),
}


@pytest.mark.parametrize("name", TORN)
def test_what_is_whole_is_replayed_and_the_rest_is_told(name, write, tmp_path):
    more, told = TORN[name]
    (tmp_path / "torn.log").write_text("(1.0) a 123#\n(1.1) a 124#\n(1.2) a 125#\n" + more)
    path = write(bus("replay: torn.log"))
    result = sim(path, "--log", "-")
    frames = [line.split()[2] for line in result.stdout.splitlines()]
    assert frames == ["123#", "124#", "125#"] + re.findall(r"126#(?:00)?$", more, re.M)
    assert f"canwire sim: {tmp_path}/torn.log: " in result.stderr and told in result.stderr
    check = canwire("check", path)
    assert told in check.stdout and f"{len(frames)} frames to replay" in check.stdout


def test_a_capture_that_is_cut_is_replayed(write, tmp_path):
    capture = (TRACES / "drive.pcapng").read_bytes()
    path = write(bus("replay: cut.pcapng"))
    (tmp_path / "cut.pcapng").write_bytes(capture)
    whole = sim(path, "--log", "-").stdout.splitlines()
    (tmp_path / "cut.pcapng").write_bytes(capture[:-1])
    result = sim(path, "--log", "-")
    assert result.stdout.splitlines() == whole[:-1]
    assert re.search(r"cut.pcapng: left out: 1 damaged entry of \d+ bytes \(byte \d+: cut off: the "
                     rf"file ends at byte {len(capture) - 1}\), 1 error frame", result.stderr)


def test_a_loop_tells_what_it_leaves_out_after_its_first_pass(write, tmp_path):
    (tmp_path / "torn.log").write_text("(1.0) a 123#\n(1.1) a 124#\n(1.2) a 1")
    path = write(bus("replay: torn.log, loop: on"))
    assert sim(path, "--until", "1s").stderr.count("1 damaged entry") == 1


def block(kind, body):
    """Returns a block of a little-endian pcapng."""
    size = struct.pack("<I", len(body) + 12)
    return struct.pack("<I", kind) + size + body + size


PCAPNG_HEAD = bytes.fromhex("0a0d0d0a1c0000004d3c2b1a01000000ffffffffffffffff1c000000")

# Bad recordings, the place of the error in each, and its message.
BAD_RECORDINGS = {
    "candump": (b"(1.1) a 1234#\n(1.2) a 1234#\n", ":1:9: ", "3 hexadecimal digits"),
    "candump without times": (b"a 123#\nb 123#\n", ":1:1: ", "there is no time stamp"),
    "zeros": (bytes(70000), ":1:1: ", "neither a candump log, nor Vector ASC, nor pcapng"),
    "candump time": (b"(1.0 a 123#\n", ":1:1: ", "(1436509052.249713)"),
    "asc": (b"base hex timestamps absolute\n0.1 1 123 Rx d 9G\n", ":2:16: ", "0 to 15"),
    "asc head": (b"base oct timestamps absolute\n", ":1:6: ", "'hex' or 'dec'"),
    "pcapng": (PCAPNG_HEAD + b"\1\0\0\0\7\0\0\0", ": byte 28: ", ""),
    "pcapng without times": (PCAPNG_HEAD + block(1, struct.pack("<HHI", 227, 0, 0)) +
                             block(3, struct.pack("<I", 8) + bytes.fromhex("0000012300000000")),
                             ": byte 48: there is no time stamp: ", "simple packets of pcapng"),
    "neither": (b"hello\n", ":1:1: ", "neither a candump log, nor Vector ASC, nor pcapng"),
}


@pytest.mark.parametrize("name", BAD_RECORDINGS)
@pytest.mark.parametrize("command", ["check", "sim"])
def test_errors_of_recordings_have_one_form(name, command, write, tmp_path):
    content, place, message = BAD_RECORDINGS[name]
    if content is not None:
        (tmp_path / "bad").write_bytes(content)
    error = canwire(command, write(bus("replay: bad")), status=1).stderr
    assert error.startswith(f"{tmp_path}/bad{place}") and message in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize("command", ["check", "sim"])
def test_a_file_that_is_not_there_is_told_with_the_place_that_names_it(command, write, tmp_path):
    path = write(bus("replay: none.log"))
    line = path.read_text().splitlines().index("      - { replay: none.log }") + 1
    error = canwire(command, path, status=1).stderr
    assert error == f"{path}:{line}:19: replay: {tmp_path}/none.log: No such file or directory\n"


def test_an_interface_that_is_none_is_told_with_those_there_are(write):
    log = f"{TRACES}/candump/log.log"
    path = write(bus(f"replay: {log}, interface: can9"))
    told = f"{log}: no interface 'can9'; there is vcan7, can-log1\n"
    assert sim(path).stderr == f"canwire sim: {told}"
    assert f"a: {told}" in canwire("check", path).stdout


def test_check_says_what_would_be_replayed(write):
    path = write(bus(f"replay: {TRACES}/candump/log.log, only: 123"))
    check = canwire("check", path)
    assert "log.log: 1 frame to replay" in check.stdout and "1 error frame (line 6)" in check.stdout


@pytest.mark.parametrize("entry", ["replay: r", "replay: r, count: 2, gap: 1ms",
                                   "replay: r, format: candump"])
def test_a_byte_order_mark_is_passed_over(entry, write, tmp_path):
    log = "(1.0) a 123#\r\n(1.001) a 124#\r\n"
    (tmp_path / "r").write_bytes(b"\xef\xbb\xbf" + log.encode())
    path = write(bus(entry))
    marked = sim(path, "--log", "-").stdout
    (tmp_path / "r").write_text(log)
    assert marked == sim(path, "--log", "-").stdout and "124#" in marked
    (tmp_path / "r").write_bytes(b"\xef\xbb\xbf(1.0) a 123#Z\n")  # a column is that of editors
    assert f"{tmp_path}/r:1:9: '123#Z'" in canwire("check", path, status=1).stderr


def test_a_byte_order_mark_before_asc_is_passed_over(write, tmp_path):
    text = (TRACES / "drive.asc").read_bytes()
    (tmp_path / "r").write_bytes(b"\xef\xbb\xbf" + text)
    assert canwire("check", write(bus("replay: r"))).stdout.count("frames to replay") == 1


def test_silence_in_a_recording_ends_a_run_without_until(write, tmp_path):
    (tmp_path / "long.log").write_text("(1.0) a 123#\n(9.0) a 124#\n(19.5) a 125#\n")
    path = write(bus("replay: long.log"))
    result = sim(path, "--log", "-")
    assert [line.split()[2] for line in result.stdout.splitlines()] == ["123#", "124#"]
    assert "after 10 s of bus time without a frame" in result.stderr
    result = sim(path, "--log", "-", "--until", "20s")
    assert len(result.stdout.splitlines()) == 3 and result.stderr == ""


def test_steps_back_in_time_are_told(write, tmp_path):
    (tmp_path / "back.log").write_text("(1.0) a 123#\n(0.5) a 124#\n(1.1) a 125#\n")
    path = write(bus("replay: back.log"))
    result = sim(path, "--log", "-")
    assert len(result.stdout.splitlines()) == 3
    assert "1 entry that steps back in time (line 2), sent at once" in result.stderr


# ---- Until an event ------------------------------------------------------------------------------

UNTIL = """
bus: { bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 123#, every: 1ms } ]
  - name: tx
    traffic: [ { send: 124#, every: 1ms, offset: 5ms } ]
  - name: c
faults:
  - { name: bits, when: { frame: 124, count: 40 }, do: { flip: crc-delimiter, at: [tx] } }
"""

AWAITED = [  # awaited event, event at the end of the run
    ("error", {"event": "error", "node": "tx", "role": "tx"}),
    ("c:error", {"event": "error", "node": "c"}),
    ("tx:error-passive", {"event": "state", "node": "tx", "state": "error-passive"}),
    ("bus-off", {"event": "state", "node": "tx", "state": "bus-off"}),
    ("state", {"event": "state", "node": "tx", "state": "error-warning"}),
    ("fault", {"event": "fault", "hit": 1}),
    ("fault:bits", {"event": "fault", "hit": 1}),
    ("tx:123", {"event": "tx", "frame": "123#"}),  # the kind, since 123 is none
    ("c:rx:124", {"event": "rx", "node": "c", "frame": "124#"}),
    ("rx:100:700", {"event": "rx", "frame": "123#"}),
    ("tx:rx", {"event": "rx", "node": "tx"}),
]


@pytest.mark.parametrize("text, expected", AWAITED, ids=[a[0] for a in AWAITED])
def test_a_run_ends_with_an_event(text, expected, write):
    path = write(UNTIL)
    until = sim(path, "--until", "100ms", "--events", "-").stdout.splitlines()
    got = sim(path, "--until-event", text, "--events", "-").stdout.splitlines()
    assert until[:len(got)] == got
    last = json.loads(got[-1])["t"]
    def is_awaited(line):
        return expected.items() <= json.loads(line).items()
    # it is among the events of the last tick, and was not there before
    assert any(is_awaited(line) for line in got if json.loads(line)["t"] == last)
    assert not any(is_awaited(line) for line in got if json.loads(line)["t"] < last)
    # and that tick is complete
    assert len(got) == len(until) or json.loads(until[len(got)])["t"] > last


@pytest.mark.parametrize("text", [a[0] for a in AWAITED])
def test_all_ends_where_it_does_with_care_in_every_bit(text, write, tmp_path):
    path, names = write(UNTIL), ("events", "log", "stats", "pcapng", "vcd")
    def outputs(*more):
        words = [word for name in names for word in (f"--{name}", tmp_path / name)]
        told = sim(path, "--until-event", text, "--to", "1ms", *words, *more)
        return told.stdout, told.stderr, *((tmp_path / name).read_bytes() for name in names)
    assert outputs() == outputs("--step")


def test_until_is_the_latest_end(write):
    result = sim(write(UNTIL), "--until", "3ms", "--until-event", "bus-off", "--stats", "-")
    assert json.loads(result.stdout)["bus"]["time_ns"] == 3_000_000
    assert "--until-event bus-off: it did not happen" in result.stderr


@pytest.mark.parametrize("text, message", [
    ("buss-off", "no event 'buss-off': expected [NODE:]EVENT"), ("c:foo", "no event 'foo'"),
    ("foo:bar", "no event 'foo'"), ("error:123", "':123' cannot follow"),
    ("tx:9", "identifiers have 3"), ("c:fault", "events of the bus"),
    ("c:skip", "events of the bus"),
    ("", "expected [NODE:]EVENT"), ("record", "recordings are canwired's"),
    ("c:record", "recordings are canwired's"), ("tolerated", "no event 'tolerated'"),
])
def test_wrong_events_are_refused(text, message, write):
    error = sim(write(UNTIL), "--until-event", text, status=1).stderr
    assert f"--until-event {text}: " in error and message in error


@pytest.mark.parametrize("text, message", [
    ("fault:none", "there is no rule 'none': there is bits\n"),
    ("x:error", "there is no node 'x': there is a, tx, c\n"),
    ("nope:rx:124", "there is no node 'nope': there is a, tx, c\n"),
])
def test_what_the_file_does_not_have_is_refused(text, message, write):
    error = sim(write(UNTIL), "--until-event", text, status=1).stderr
    assert error == f"canwire sim: --until-event {text}: {message}"


def test_every_event_that_is_expected_can_be_awaited(write):
    told = sim(write(UNTIL), "--until-event", "", status=1).stderr
    kinds = re.search(r"'canwire watch' \(([^)]*)\)", told)[1].split(", ")
    kinds += re.search(r"a state \(([^)]*)\)", told)[1].split(", ") + ["fault", "skip"]
    assert len(kinds) == 21
    for kind in kinds:
        sim(write(UNTIL), "--until", "1ms", "--until-event", kind)
    watched = canwire("watch", "--help").stdout.partition("these kinds:")[2].partition("--json")[0]
    assert {*re.findall("[a-z-]+", watched)} - {"record", "capture"} <= {*kinds}


LATE = """
bus: { bitrate: 500000 }
nodes:
  - { name: a, traffic: [ { send: 123#, every: 1s } ] }
  - { name: b, traffic: [ { send: 124#, offset: OFFSET } ] }
"""


@pytest.mark.parametrize("offset, until, told", [
    ("9s", [], False), ("12s", [], True), ("12s", ["--until", "13s"], False)])
def test_a_run_that_may_never_end_says_so(offset, until, told, write):
    path = write(LATE.replace("OFFSET", offset))
    result = sim(path, "--until-event", "b:tx", "--log", "-", *until)
    assert result.stdout.splitlines()[-1].endswith(" b 124#")
    assert result.stderr.count("not yet after 10 s of bus time") == told
    assert ("only --until TIME ends the run" in result.stderr) == told


NEVER_OVER = bus("send: 123#, every: 1s")
OUTPUTS = ("events", "log", "pcapng", "stats", "vcd", "svg", "junit")


def old_outputs(tmp_path):
    """Makes files with content, and the options that name them."""
    for name in OUTPUTS:
        (tmp_path / name).write_text("old")
    return [word for name in OUTPUTS for word in (f"--{name}", tmp_path / name)]


def test_outputs_are_as_they_were_while_the_event_is_looked_for(write, tmp_path):
    words = old_outputs(tmp_path)
    with subprocess.Popen([CANWIRE, "sim", write(NEVER_OVER), "--until-event", "bus-off", *words],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        told = process.stderr.readline()  # it is amid the search, which finds nothing
        process.terminate()
        assert process.wait(TIMEOUT_S) == -signal.SIGTERM
    assert b"not yet after 10 s of bus time" in told
    assert {(tmp_path / name).read_text() for name in OUTPUTS} == {"old"}


def test_outputs_are_written_when_the_event_has_been_found(write, tmp_path):
    words = old_outputs(tmp_path)
    sim(write(NEVER_OVER), "--until-event", "tx", *words)
    for name in OUTPUTS:
        assert (tmp_path / name).read_bytes()[:3] not in (b"", b"old"), name


def test_an_output_that_cannot_be_written_is_told_before_the_event_is_looked_for(write, tmp_path):
    (tmp_path / "log").write_text("old")
    told = sim(write(NEVER_OVER), "--until-event", "bus-off", "--log", tmp_path / "log",
               "--vcd", tmp_path / "nowhere/f", status=1).stderr
    assert told.count("\n") == 1 and "nowhere/f" in told
    assert (tmp_path / "log").read_text() == "old"


@pytest.mark.parametrize("recording, entry, message, status", [
    ("(1.0) a 123#\n", "replay: r.log, only: 456", "no frame that is asked for", 0),
    ("(1.0) a 20000040#0000000000000000\n(2.0) a 123#\n", "replay: r.log", "left out", 0),
    ("(1.0) a 123#\n(2.0) a 12\n", "replay: r.log", "1 damaged entry of 11 bytes (line 2:", 0),
    ("12\n", "replay: r.log, format: candump", "r.log:1:", 1),
    ("", "send: 123#, offset: 20s", "ended before the last release", 0),
])
def test_what_there_is_to_say_is_said_once(recording, entry, message, status, write, tmp_path):
    (tmp_path / "r.log").write_text(recording)
    path = write(bus(entry))
    told = sim(path, "--until-event", "bus-off", status=status).stderr
    assert told.count(message) == 1, told
    assert told == sim(path, "--until-event", "bus-off", "--step", status=status).stderr


# ---- Progress ------------------------------------------------------------------------------------


def read_terminal(master, process, until=None):
    """Reads until the process has ended, or up to some word."""
    got = b""
    while not until or until not in got:
        ready, _, _ = select.select([master], [], [], TIMEOUT_S)
        assert ready, got
        try:
            piece = os.read(master, 4096)
        except OSError:  # no process has it open any more
            break
        if not piece:
            break
        got += piece
    if not until:
        process.wait(TIMEOUT_S)
    return got.decode()


class SlowReader(threading.Thread):
    """Lets a run with many events wait until wall time has gone by, then takes all."""

    def __init__(self, fifo, first):
        super().__init__()
        self.fifo, self.first = fifo, first
        self.proceed, self.go_on = threading.Event(), threading.Event()

    def run(self):
        with open(self.fifo, "rb") as events_out:
            self.proceed.wait(TIMEOUT_S)
            if self.first:  # bytes, after which it waits again
                events_out.read(self.first)
                self.go_on.wait(TIMEOUT_S)
            while events_out.read(1 << 20):
                pass


def slow_run(path, tmp_path, stderr, first=0):
    os.mkfifo(tmp_path / "events")
    reader = SlowReader(tmp_path / "events", first)
    reader.start()
    process = subprocess.Popen(
        [CANWIRE, "sim", path, "--until", "3s", "--events", tmp_path / "events"],
        stdout=subprocess.PIPE, stderr=stderr,
        # SIGINT is ignored for tests in the background, and a child would inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    threading.Timer(1.5, reader.proceed.set).start()  # no line comes in the first second
    return process, reader


BUSY = bus("send: 123#, every: 200us")
LEAST_PROGRESS_S = 0.25


def test_long_runs_show_progress_on_a_terminal(write, tmp_path):
    master, slave = pty.openpty()
    begin = time.monotonic()
    process, reader = slow_run(write(BUSY), tmp_path, slave)
    os.close(slave)
    output = read_terminal(master, process)
    reader.join(TIMEOUT_S)
    assert process.returncode == 0
    lines = output.split("\r")
    shown = [line for line in lines if "bus time" in line]
    assert shown, output
    assert re.fullmatch(r"\d+\.\d s of 3\.0 s bus time, \d+ frames, \d+(\.\d+)? x real time, "
                        r"\d+:\d\d left *", shown[0]), shown[0]
    assert len(shown) <= 1 + (time.monotonic() - begin) / LEAST_PROGRESS_S  # not by frame
    # at last it is wiped: blanks over the whole of the last line, and back to its beginning
    assert lines[-1] == "" and lines[-2].strip() == "" and len(lines[-2]) >= len(lines[-3].rstrip())


@pytest.mark.parametrize("columns, told", [
    (200, r"of 3\.0 s bus time, \d+ frames, \d.* x real time, \d+:\d\d left"),
    (60, r"of 3\.0 s bus time, \d.* x real time, \d+:\d\d left"),
    (40, r"of 3\.0 s bus time, \d+:\d\d left"), (30, r"of 3\.0 s, \d+:\d\d left"),
    (20, r"^\d\.\d s of 3\.0 s$"), (10, r"^\d\.\d s$"), (5, None)])
def test_progress_stays_on_one_line(columns, told, write, tmp_path):
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("4H", 24, columns, 0, 0))
    process, reader = slow_run(write(BUSY), tmp_path, slave)
    os.close(slave)
    output = read_terminal(master, process)
    reader.join(TIMEOUT_S)
    shown = [line for line in output.split("\r") if line.strip()]
    assert output == "" if told is None else shown and re.search(told, shown[0].rstrip()), shown
    assert all(len(line) < columns for line in shown)


def test_an_interrupt_ends_the_line(write, tmp_path):
    master, slave = pty.openpty()
    process, reader = slow_run(write(BUSY), tmp_path, slave, 500_000)  # of 1.7 million
    os.close(slave)
    before = read_terminal(master, process, b"bus time")
    process.send_signal(signal.SIGINT)
    output = before + read_terminal(master, process)
    reader.go_on.set()
    reader.join(TIMEOUT_S)
    assert process.returncode == -signal.SIGINT
    assert output.endswith("left\r\n") and output.count("\n") == 1, output


def test_long_runs_show_nothing_in_a_pipe(write, tmp_path):
    process, reader = slow_run(write(BUSY), tmp_path, subprocess.PIPE)
    _, errors = process.communicate(timeout=TIMEOUT_S)
    reader.join(TIMEOUT_S)
    assert process.returncode == 0 and errors == b""
