# SPDX-License-Identifier: MIT
"""canwire sim --journal repeats the run that canwired --journal has recorded. The events are the
same, to the byte, whatever the timing was.

The live events are those of `canwire watch --json`, which begins before anything happens.
"""

import contextlib
import json
import random
import signal
import subprocess
import threading
import time

import pytest

from canbits import Frame
from conftest import PATIENCE_S, ip, wait_until
from simtool import journal_text
from test_faults import CANWIRE, Shell

BUS = """
bus: {{ name: faults, bitrate: 500000 }}
seed: {seed}
control: faults.sock
nodes:
{nodes}
faults:
  - name: coin
    when: {{ frame: "100:700", probability: 0.05 }}
    do: {{ flip: "crc[3]", at: gearbox }}
  - {{ name: hand, when: {{ manual: yes }}, do: {{ bus-off: gearbox }} }}
  - {{ name: hello, when: {{ manual: yes }}, do: {{ counters: gearbox, rec: 0 }} }}
"""

NODES = ["{ name: engine, port: vcan0, restart-ms: 20, queue: 64 }",
         "{ name: gearbox, port: vcan1, restart-ms: 0 }",
         "{ name: dash, port: vcan2 }",
         "{ name: load, traffic: [ { send: 7F0#0123, every: 3ms, jitter: 1ms }, "
         "{ reply: 7FF#CA } ] }"]

STUCK = "{ name: stuck, do: { stuck: recessive, on: engine.tx, for: 30ms } }"
BURST = 1380  # frames of each ECU; the bus keeps 256 KiB of events for a client
NOISE = ("[ { name: noise, do: { noise: 1e-4 } }, "
         "{ name: extend, when: { frame: 123 }, do: { change: { dlc: 8 } } } ]")


def bus(nodes, seed=1):
    return BUS.format(seed=seed, nodes="".join(f"  - {node}\n" for node in nodes))


class Night:
    """A bus with a journal and a watch, until morning()."""

    def __init__(self, launch, folder, text, journal=None, kinds=()):
        self.journal = journal or folder / "journal"
        self.daemon = launch(text, after=["--journal", self.journal])
        self.daemon.wait_ready()
        self.shell = Shell(self.daemon)
        self.live = folder / "live"
        self.watch = self.shell.watch(self.live, *kinds, "--json")
        wait_until(self.says_hello, "the client that watches")

    def says_hello(self):
        self.run("fire", "hello")
        return self.live.stat().st_size

    def run(self, *words):
        self.shell.run(words[0], "faults", *words[1:])

    def events(self):
        """Returns the watched events at their end."""
        self.watch.wait(PATIENCE_S)
        text = self.live.read_text()
        assert '"lost"' not in text, "watching was too slow for this"
        return text

    def morning(self):
        log = self.daemon.stop()
        return log, self.events()


def again(journal, *options, status=0):
    """Returns events and messages of the same run in virtual time."""
    result = subprocess.run([CANWIRE, "sim", "--journal", journal, "--events", "-", *options],
                            capture_output=True, text=True, timeout=4 * PATIENCE_S, check=False)
    assert result.returncode == status, result.stderr
    return result.stdout, result.stderr


def from_hello(replayed, live):
    """Returns the replayed events from the first watched one on, and the watched ones, as lines."""
    replayed, live = replayed.splitlines(), live.splitlines()
    return replayed[replayed.index(live[0]):], live


def assert_same(replayed, live, least):
    replayed, live = from_hello(replayed, live)
    assert len(live) >= least
    different = [pair for pair in zip(replayed, live) if pair[0] != pair[1]][:3]
    assert not different and len(replayed) == len(live)


def chatter(sockets, seed, stop):
    """Bursts from all ECUs with random pauses, some frames in one go, until it is to stop."""
    draw = random.Random(seed)
    while not stop.is_set():
        for _ in range(draw.randint(1, 8)):
            extended = draw.random() < 0.2
            number = draw.randint(0, 0x1FFFFFFF) if extended else draw.choice([0x100, 0x123, 0x7F8])
            data = draw.randbytes(draw.randint(0, 8)).hex().upper()
            text = f"{number:08X}#{data}" if extended else f"{number:03X}#{data}"
            with contextlib.suppress(OSError):  # its interface is down for a while
                draw.choice(sockets).send(Frame.parse(text))
        time.sleep(draw.random() * 0.02)  # no wait: others go on meanwhile


@pytest.fixture(name="ecus")
def fixture_ecus(vcan, can_socket):
    return [can_socket(name) for name in vcan(3)]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_night_runs_again_to_the_byte(launch, ecus, tmp_path, seed):
    night = Night(launch, tmp_path, bus(NODES, seed))
    stop = threading.Event()
    talk = threading.Thread(target=chatter, args=(ecus, seed, stop))
    talk.start()
    try:
        night.run("inject", STUCK)
        night.run("fire", "hand")
        night.run("restart", "gearbox")
        night.run("set", "dash", "one-shot=on", "queue=2", "order=fifo")
        night.run("inject", NOISE)
        ip("link set vcan2 down")
        time.sleep(0.1)  # no wait: others go on meanwhile
        ip("link set vcan2 up")
        night.run("clear", "noise")
        night.daemon.config.write_text(bus(NODES[:2] + ["{ name: dashboard, port: vcan2 }"], seed))
        night.run("reload")
        wait_until(lambda: "configuration reloaded" in night.daemon.stderr(), "the reload")
        night.run("set", "engine", "listen-only=on")
        time.sleep(0.2)  # no wait: others go on meanwhile
        night.run("set", "engine", "listen-only=off")
        night.daemon.process.send_signal(signal.SIGHUP)
        time.sleep(0.2)  # no wait: others go on meanwhile
    finally:
        stop.set()
        talk.join()
    _, live = night.morning()
    replayed, messages = again(night.journal)
    assert messages == ""
    assert_same(replayed, live, 500)
    kinds = {json.loads(line)["event"] for line in live.splitlines()}
    assert kinds >= {"rx", "tx", "error", "state", "fault", "drop", "restart", "link"}
    assert again(night.journal, "--step")[0] == replayed


def at_rest(night):
    """Returns the nodes when all their frames have been sent."""
    nodes = night.shell.nodes()
    return nodes if not any(node["queue"] + node["inbox"] for node in nodes.values()) else None


def test_a_burst_that_fills_the_inbox_runs_again(launch, ecus, tmp_path):
    night = Night(launch, tmp_path, bus(NODES[:3]), kinds=["tx,fault"])  # all would be too much
    night.daemon.process.send_signal(signal.SIGSTOP)
    # 4096 frames fit into the inbox; their events, of 65 bytes each, wait for the slowest client
    for n in range(BURST):
        for ecu, number in zip(ecus, (0x100, 0x200, 0x300)):
            ecu.send(Frame.parse(f"{number:03X}#{n % 256:02X}"))
    night.daemon.process.send_signal(signal.SIGCONT)
    wait_until(lambda: all(night.shell.nodes()[name]["handed_in"] == BURST
                           for name in ("engine", "gearbox", "dash")), "all frames")
    before = wait_until(lambda: at_rest(night), "the bus to rest")
    sent = sum(node["tx_frames"] for node in before.values())
    wait_until(lambda: night.live.read_text().count('"event":"tx"') == sent, "the client")
    _, live = night.morning()
    events = again(night.journal)[0].splitlines(keepends=True)
    assert_same("".join(e for e in events if '"event":"tx"' in e or '"fault"' in e), live, 100)
    again(night.journal, "--stats", tmp_path / "stats")
    for node in json.loads((tmp_path / "stats").read_text())["nodes"]:
        assert [node[key] for key in ("handed_in", "dropped")] == [
            before[node["name"]][key] for key in ("handed_in", "dropped")]


def test_time_that_is_skipped_is_in_it(launch, ecus, tmp_path):
    text = bus(NODES).replace("seed:", "catch-up: 100ms\nseed:")
    night = Night(launch, tmp_path, text)
    night.daemon.process.send_signal(signal.SIGSTOP)
    time.sleep(1)  # no wait: at least so long
    night.daemon.process.send_signal(signal.SIGCONT)
    ecus[0].send(Frame.parse("123#"))
    wait_until(lambda: '"skip"' in night.live.read_text(), "the event")
    _, live = night.morning()
    assert_same(again(night.journal)[0], live, 2)


def test_a_kill_leaves_what_is_complete(launch, ecus, tmp_path):
    night = Night(launch, tmp_path, bus(NODES[:3]))
    for n in range(200):
        ecus[n % 3].send(Frame.parse(f"{n:03X}#"))
    wait_until(lambda: journal_text(night.journal).count('"send":"engine"') == 67,
               "the frames in it")
    night.daemon.process.kill()
    night.daemon.process.wait()
    replayed, messages = again(night.journal)
    assert "the journal is cut off at" in messages
    live = night.events()
    replayed, live = from_hello(replayed, live)
    common = min(len(live), len(replayed))
    assert live[:common] == replayed[:common]
    assert any('"node":"dash","event":"tx"' in line for line in replayed)


@pytest.mark.deep
def test_a_full_disk_stops_the_journal_and_not_the_bus(launch, ecus, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=12k", "none", disk], check=True)
    try:
        night = Night(launch, tmp_path, bus(NODES[:3]), disk / "journal")
        for n in range(2000):
            ecus[n % 3].send(Frame.parse(f"{n % 0x800:03X}#1122334455667788"))
            if n % 10 == 9:
                time.sleep(0.005)
        wait_until(lambda: "broken from" in night.daemon.stderr(), "the message")
        assert "No space left on device; the bus goes on without it" in night.daemon.stderr()
        ecus[0].send(Frame.parse("7FE#5AFE"))
        wait_until(lambda: "7FE#5AFE" in night.live.read_text(), "a frame afterwards")
        log, live = night.morning()
        assert " lines are missing" in log  # its end may still have had room
        replayed, messages = again(night.journal)
        assert "what followed " in messages
        replayed, live = from_hello(replayed, live)
        assert 100 < len(replayed) < len(live) and replayed == live[:len(replayed)]
    finally:
        subprocess.run(["umount", disk], check=True)


@pytest.mark.deep
def test_the_journal_of_last_night_is_kept(launch, ecus, tmp_path):
    assert ecus
    for _ in range(2):
        night = Night(launch, tmp_path, bus(NODES))
        night.morning()
    assert again(tmp_path / "journal.1")[1] == again(tmp_path / "journal")[1] == ""


def test_a_journal_that_cannot_begin_is_an_error(launch, ecus, tmp_path):
    assert ecus
    daemon = launch(bus(NODES), after=["--journal", tmp_path / "nowhere/journal"])
    assert daemon.wait() == 1
    assert f"journal {tmp_path}/nowhere/journal: No such file or directory" in daemon.stderr()
