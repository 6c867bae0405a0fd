# SPDX-License-Identifier: MIT
"""A full queue on Unix sockets: the program has to wait, and nothing is lost or out of order.

`when-full: wait` is the default there. This needs no CAN in the kernel; the same on vcan is in
tests/kernel/test_stacks_queue.py. CANWIRE is the tool, beside canwired.
"""

import json
import random
import re
import signal
import socket
import struct
import threading
import time
from collections import defaultdict

import pytest

from busrig import BusRig, rig_fixture
from simtool import journal_lines, kill_all
from test_record import wait_until

PATIENCE_S = 120
FRAME = struct.Struct("=IBxxB8s")  # struct can_frame
ERROR = 0x20000000
BUS = """bus: {{ name: push, bitrate: {bitrate} }}
control: push.sock
defaults: {{ queue: 16 }}
{more}
nodes:
  - {{ name: engine, port: "unix:engine.sock"{engine} }}
  - {{ name: dash, port: "unix:dash.sock"{dash} }}
"""


def pack(identifier, number):
    return FRAME.pack(identifier, 4, 0, struct.pack(">I", number))


class Ecu:
    """A program at a port: a thread reads all frames, so that it never delays the bus."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.connect(str(path))
        self.frames, self.errors = [], []
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def read(self):
        while packed := self.socket.recv(100):
            can_id, length, _, data = FRAME.unpack(packed)
            if can_id & ERROR:
                self.errors.append((can_id, data))
            else:
                self.frames.append((can_id, int.from_bytes(data[:length], "big")))

    def send(self, frames):
        """Waits as long as the port makes it wait."""
        for identifier, number in frames:
            self.socket.send(pack(identifier, number))

    def send_in_background(self, frames):
        thread = threading.Thread(target=self.send, args=(frames,), daemon=True)
        thread.start()
        return thread

    def fill(self):
        """Returns the number of frames that it can write without waiting."""
        count = 0
        try:
            while True:
                self.socket.send(pack(0x123, count), socket.MSG_DONTWAIT)
                count += 1
        except BlockingIOError:
            return count

    def expect(self, frames):
        wait_until(lambda: len(self.frames) >= len(frames), f"{len(frames)} frames")
        assert by_identifier(self.frames) == by_identifier(frames)

    def close(self):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.thread.join(PATIENCE_S)
        self.socket.close()


def by_identifier(frames):
    """Returns the order that the bus keeps: that of frames with one identifier."""
    numbers = defaultdict(list)
    for identifier, number in frames:
        numbers[identifier].append(number)
    return dict(numbers)


class Rig(BusRig):
    TEXT, CONTROL = BUS, "push.sock"
    VALUES = {"bitrate": 1000000, "more": "", "engine": "", "dash": ""}

    def __init__(self, folder, **more):
        super().__init__(folder, **more)
        self.engine, self.dash = (Ecu(folder / f"{name}.sock") for name in ("engine", "dash"))

    def close(self):
        for ecu in (self.engine, self.dash):
            ecu.close()


fixture_rig = rig_fixture(Rig)


class Room(BusRig):
    CONTROL = "room.sock"
    TEXT = """bus: {{ name: room, bitrate: 500000 }}
control: room.sock
{defaults}
guests: {{ count: 1, port: "unix:guests.sock" }}
nodes:
  - {{ name: unix, port: "unix:unix.sock" }}
  - {{ name: set, port: "unix:set.sock", queue: 5 }}
  - {{ name: usb, port: {{ usb: can0, socket: usb.sock }} }}
  - {{ name: none }}
"""


@pytest.mark.parametrize("defaults, port, other", [
    ("", 1024, 16), ("defaults: { queue: 20 }", 20, 20)])
def test_ports_have_room_for_bursts(tmp_path, defaults, port, other):
    """Scanners and transport protocols write many frames at once. The driver of usb has a queue."""
    r = Room(tmp_path, defaults=defaults)
    try:
        nodes = r.nodes()
        queues = {name: node["settings"]["queue"] for name, node in nodes.items()}
        assert queues == {"guest-1": port, "unix": port, "set": 5, "usb": other, "none": other}
        assert (nodes["unix"]["when-full"], nodes["guest-1"]["when-full"]) == ("wait", "wait")
    finally:
        kill_all([r.process])


def numbered(identifiers, count, seed=1):
    """Returns frames with random identifiers, numbered in the order of writing."""
    choose = random.Random(seed)
    return [(choose.choice(identifiers), number) for number in range(count)]


@pytest.mark.parametrize("pacing", ["precise", "tick", "spin"])
def test_a_program_that_writes_too_fast_has_to_wait(rig, pacing):
    """Both ECUs write at once, many times what their queues and sockets hold."""
    count = 2500
    r = rig(more=f"pacing: {pacing}")
    mine, theirs = numbered([0x100, 0x300, 0x7FF], count), numbered([0x101, 0x200, 0x6FF], count, 2)
    r.engine.send_in_background(mine)
    r.dash.send_in_background(theirs)
    r.dash.expect(mine)
    r.engine.expect(theirs)
    nodes = r.nodes()
    for node in nodes.values():
        assert sum(node["dropped"].values()) == 0
        assert node["interface"]["read"] == node["tx_frames"] == count
        assert node["interface"]["pushed_back"] > 0
        assert (node["when-full"], node["pushing_back"]) == ("wait", False)
        assert node["when_full"] == "wait"  # the deprecated key
        assert node["queue_peak"] == node["settings"]["queue"] == 16
    shown = r.run("status", "./push.sock").stdout
    assert re.search(r"1: engine@\S+: qlen 16 order priority when-full wait\n", shown)
    for node in nodes.values():
        times = node["interface"]["pushed_back"]
        plural = "" if times == 1 else "s"
        assert f"queue full, the ECU has had to wait {times} time{plural}\n" in shown
    assert "queue full" not in r.stop()


def test_a_program_that_does_not_want_to_wait_is_told(rig):
    """EAGAIN, as from a real interface whose queue is full ENOBUFS."""
    r = rig(bitrate=5000)
    written = r.engine.fill()
    wait_until(lambda: r.nodes()["engine"]["pushing_back"], "the push-back")
    assert "and does now\n" in r.run("status", "./push.sock").stdout
    written += r.engine.fill()  # frames that were read meanwhile
    node = r.nodes()["engine"]
    # a frame may just have been sent, and the next one not been read yet
    assert node["queue"] in (15, 16) and node["interface"]["read"] < written
    assert node["dropped"]["queue-full"] == 0
    r.stop()


def test_the_bus_has_no_gap_while_a_program_waits(rig):
    """Though canwired and the program may be late: the journal run again has one frame after the
    other, or after its arrival."""
    count = 600
    r = rig(journal=True, bitrate=125000)
    sender = r.engine.send_in_background([(0x123, number) for number in range(count)])
    wait_until(lambda: len(r.dash.frames) > 20, "the first frames")
    r.process.send_signal(signal.SIGSTOP)  # the socket holds what the bus does in 200 ms
    time.sleep(0.1)  # no wait: the bus may have caught up with the socket, or not
    r.process.send_signal(signal.SIGCONT)
    sender.join(PATIENCE_S)
    r.dash.expect([(0x123, number) for number in range(count)])
    r.stop()
    lines = r.again()
    ends = [round(e["t"] * 1e9) for e in lines if e["event"] == "tx"]
    arrivals = [(line["at"] + line.get("in", 0)) * 25 // 2
                for line in journal_lines(r.folder / "bus.journal") if "send" in line]
    assert len(ends) == len(arrivals) == count
    bits = {(end - max(before, arrival)) // 8000
            for before, end, arrival in zip(ends, ends[1:], arrivals[1:])}
    assert max(bits) <= 47 + 4 * 8 + 19 + 3, sorted(bits)  # a frame, all its stuff bits, three bits


def test_dropping_can_be_asked_for_and_names_what_helps(rig):
    count = 3000
    r = rig(engine=", when-full: drop, queue: 4")
    r.engine.send([(0x7E0, number) for number in range(count)])
    wait_until(lambda: r.nodes()["engine"]["interface"]["read"] == count, "all frames")
    node = r.nodes()["engine"]
    assert node["dropped"]["queue-full"] > 0 and node["interface"]["pushed_back"] == 0
    wait_until(lambda: "queue full" in r.log.read_text(), "the warning")
    line = next(l for l in r.stop().splitlines() if "queue full" in l)
    assert re.search(r"node engine: \d+ dropped, queue full \(the last one 7E0\): give it more "
                     r"room than queue: 4, or its program writes in smaller bursts "
                     r"\(ISO-TP: STmin or a block size\), or waits \(when-full: wait\)(;|$)",
                     line), line


def test_frames_that_are_written_in_bus_off_are_told(rig):
    r = rig(more="faults: [ { name: off, when: { time: 0s }, do: { bus-off: engine } } ]")
    wait_until(lambda: r.nodes()["engine"]["state"] == "bus-off", "bus-off")
    r.engine.send([(0x555, number) for number in range(5)])
    wait_until(lambda: r.nodes()["engine"]["dropped"]["bus-off"] == 5, "the frames")
    told = r.stop()
    assert sum(map(int, re.findall(r"node engine: .*?(\d+) dropped, bus-off", told))) == 5
    assert "stopped: 0 frames, 0 error frames, 0 frames not sent, 5 dropped\n" in told


def test_nobody_waits_for_a_node_that_takes_nothing(rig):
    """A bus-off or listen-only node drops all its frames, so a full queue does not pause
    reading."""
    r = rig(bitrate=10000)
    sender = r.engine.send_in_background([(0x123, number) for number in range(2000)])
    wait_until(lambda: r.nodes()["engine"]["pushing_back"], "the push-back")
    r.run("inject", "./push.sock", "{ name: off, do: { bus-off: engine } }")
    sender.join(PATIENCE_S)
    assert not sender.is_alive()
    wait_until(lambda: r.nodes()["engine"]["dropped"]["bus-off"] > 1000, "the drops")
    r.stop()


def test_a_larger_queue_lets_it_in_at_once(rig):
    r = rig(bitrate=5000, engine=", queue: 40")
    r.run("set", "./push.sock", "engine", "queue=4")
    r.engine.fill()
    wait_until(lambda: r.nodes()["engine"]["pushing_back"], "the push-back")
    assert r.nodes()["engine"]["queue"] <= 4
    r.run("set", "./push.sock", "engine", "queue=40")
    wait_until(lambda: r.nodes()["engine"]["queue"] > 30, "more in the queue")
    r.stop()


def test_it_comes_back_when_the_node_does(rig):
    """A bus that rests with a full queue wakes up by nothing but the command."""
    frames = [(0x123, number) for number in range(1000)]
    r = rig()
    r.run("inject", "./push.sock", "{ name: away, do: { disconnect: engine } }")
    r.engine.send_in_background(frames)
    wait_until(lambda: r.nodes()["engine"]["pushing_back"], "the push-back")
    assert r.dash.frames == []
    r.run("clear", "./push.sock", "away")
    r.dash.expect(frames)
    r.stop()


def test_only_a_reload_drops_what_a_shorter_queue_cannot_hold(rig):
    """On a slow bus, which carries little while it is looked at."""
    r = rig(bitrate=5000, engine=", queue: 256")
    r.engine.fill()
    wait_until(lambda: r.nodes()["engine"]["pushing_back"], "the push-back")
    r.run("set", "./push.sock", "engine", "queue=4")
    node = r.nodes()["engine"]
    assert node["settings"]["queue"] == 4 and node["queue"] > 4  # they stay
    taken, dropped = node["interface"]["read"], node["dropped"]["queue-full"]
    text = r.text.replace("queue: 256", "queue: 8")
    (r.folder / "bus.yaml").write_text(text)
    r.run("reload", "./push.sock")
    wait_until(lambda: r.nodes()["engine"]["settings"]["queue"] == 8, "the reload")
    node = r.nodes()["engine"]
    assert node["queue"] <= 8 and node["dropped"]["queue-full"] > dropped
    assert node["interface"]["read"] - taken <= node["tx_frames"] + 8  # it still has to wait
    r.stop()


def test_a_reload_changes_it_while_a_program_waits(rig):
    frames = [(0x123, number) for number in range(1500)]
    r = rig(bitrate=50000)
    sender = r.engine.send_in_background(frames)
    wait_until(lambda: r.nodes()["engine"]["pushing_back"], "the push-back")
    text = r.text.replace("engine.sock\"", "engine.sock\", when-full: drop")
    assert text != r.text
    (r.folder / "bus.yaml").write_text(text)
    r.run("reload", "./push.sock")
    sender.join(PATIENCE_S)
    wait_until(lambda: r.nodes()["engine"]["interface"]["read"] == len(frames), "all frames")
    node = r.nodes()["engine"]
    assert (node["when-full"], node["pushing_back"]) == ("drop", False)
    assert node["dropped"]["queue-full"] > 0
    r.stop()


def test_the_last_words_of_a_program_are_carried(rig):
    """It has written what its socket takes and is gone; the next one comes in behind that."""
    r = rig(bitrate=250000)
    written = r.engine.fill()
    r.engine.close()
    r.dash.expect([(0x123, number) for number in range(written)])
    r.engine = Ecu(r.folder / "engine.sock")
    r.engine.send([(0x456, 1)])
    wait_until(lambda: (0x456, 1) in r.dash.frames, "the frame of the next one")
    r.stop()


# ---- Time that is skipped ------------------------------------------------------------------------

SKIPS = 150


def transfer(sender, receiver, size):
    """Runs a long ISO-TP transfer: blocks of eight, each after an answer of the other side."""
    numbers = iter(range(size))
    for block in range(size // 8):
        sender.send([(0x7E0, next(numbers)) for _ in range(8)])
        wait_until(lambda: len(receiver.frames) >= 8 * (block + 1), f"block {block}")
        receiver.send([(0x7E8, block)])
        wait_until(lambda: len(sender.frames) > block, f"the word after block {block}")


@pytest.mark.parametrize("pacing", ["precise", "tick"])
def test_nothing_is_lost_or_turned_round_by_hundreds_of_skips(rig, pacing):
    """Three identifiers from each side at full load, while canwired is stopped again and again for
    longer than it may catch up with. Then transfers in blocks, stopped, too."""
    r = rig(more=f"catch-up: 2ms\npacing: {pacing}", bitrate=500000)
    done = threading.Event()
    sent = {"engine": [], "dash": []}

    def write(ecu, frames, identifiers):
        choose, number = random.Random(7), 0
        while not done.is_set():
            frames.append((choose.choice(identifiers), number))
            ecu.send(frames[-1:])
            number += 1

    threads = [threading.Thread(target=write, args=words, daemon=True) for words in (
        (r.engine, sent["engine"], [0x100, 0x102, 0x700]),
        (r.dash, sent["dash"], [0x101, 0x103, 0x6FF]))]
    for thread in threads:
        thread.start()
    pause = random.Random(3)
    for _ in range(SKIPS):
        r.process.send_signal(signal.SIGSTOP)
        threading.Event().wait(pause.uniform(0.005, 0.03))
        r.process.send_signal(signal.SIGCONT)
        threading.Event().wait(pause.uniform(0, 0.02))
    done.set()
    for thread in threads:
        thread.join(PATIENCE_S)
    r.dash.expect(sent["engine"])
    r.engine.expect(sent["dash"])
    skips = json.loads(r.run("status", "./push.sock", "--json").stdout)["bus"]["skips"]
    assert skips >= SKIPS // 2
    for node in r.nodes().values():
        assert node["tx_frames"] == node["interface"]["read"] and not sum(node["dropped"].values())
        assert node["inbox"] == node["queue"] == 0

    r.dash.frames.clear()
    r.engine.frames.clear()
    stopper = threading.Thread(target=stop_now_and_then, args=(r.process, 20), daemon=True)
    stopper.start()
    transfer(r.engine, r.dash, 584)  # the frames of 4095 bytes
    stopper.join(PATIENCE_S)
    assert [number for _, number in r.dash.frames] == list(range(584))
    assert [number for _, number in r.engine.frames] == list(range(73))
    r.stop()


def stop_now_and_then(process, times):
    for _ in range(times):
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.05)  # no wait: or longer
        process.send_signal(signal.SIGCONT)
        time.sleep(0.02)  # no wait: or longer
