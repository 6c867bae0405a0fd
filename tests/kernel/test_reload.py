# SPDX-License-Identifier: MIT
"""A configuration that is read again while the bus runs: what changes, and what must not."""

import itertools
import json
import re
import select
import signal
import socket
import subprocess
import time

import pytest

from canbits import Frame
from conftest import PATIENCE_S, wait_until
from test_faults import LAST, TX_WARNING, Candump, Shell, state

ENGINE, GEARBOX, DASH = ("{{ name: {}, port: vcan{} }}".format(name, i)
                         for i, name in enumerate(("engine", "gearbox", "dash")))
RELOADED = "configuration reloaded"
UNCHANGED = "nothing was changed"


def bus(*nodes, bitrate=500000, more=""):
    return (f"bus: {{ name: reload, bitrate: {bitrate} }}\ncontrol: reload.sock\n{more}nodes:\n"
            + "".join(f"  - {node}\n" for node in nodes))


def load(send, name="load"):
    """Returns a node without port that sends."""
    return f"{{ name: {name}, queue: 4096, traffic: [ {{ send: {send} }} ] }}"


class Rig:
    """A daemon whose configuration changes."""

    def __init__(self, daemon):
        self.daemon = daemon
        self.shell = Shell(daemon)

    def write(self, text):
        self.daemon.config.write_text(text)

    def times_ready(self):
        return self.daemon.notifications.count("READY=1")

    def hang_up(self):
        self.daemon.process.send_signal(signal.SIGHUP)

    def ask(self):
        self.shell.run("reload", "reload")

    def reload(self, text, how=hang_up):
        """Changes to a good configuration."""
        before = self.times_ready()
        self.write(text)
        how(self)
        wait_until(lambda: self.times_ready() > before, "READY=1 after the reload")

    def log(self):
        return self.daemon.stderr()

    def nodes(self):
        return self.shell.nodes("reload")


@pytest.fixture
def rig(canwired):
    """rig(TEXT) starts a Rig."""
    return lambda text: Rig(canwired(text))


@pytest.fixture
def candump(tmp_path):
    """candump("vcan0") starts a Candump."""
    dumps = []

    def start(interface):
        dumps.append(Candump(tmp_path / interface, interface))
        return dumps[-1]

    yield start
    for dump in dumps:
        dump.close()


@pytest.fixture
def events(tmp_path):
    """events(rig, "tx") gets these kinds of events from now on, from the control socket."""
    opened = []

    class Events:
        def __init__(self, r, kinds):
            self.socket = socket.socket(socket.AF_UNIX)
            self.socket.connect(str(r.daemon.config.parent / "reload.sock"))
            self.lines = self.socket.makefile()
            request = json.dumps({"request": "watch", "events": kinds})
            self.socket.sendall(request.encode() + b"\n")
            assert json.loads(self.lines.readline())["ok"]

        def until(self, condition):
            """Reads up to the first event that fulfils a condition."""
            self.socket.settimeout(PATIENCE_S)
            taken = [json.loads(self.lines.readline())]
            while not condition(taken[-1]):
                taken.append(json.loads(self.lines.readline()))
            return taken

    def start(r, *kinds):
        opened.append(Events(r, kinds))
        return opened[-1]

    yield start
    for e in opened:
        e.lines.close()
        e.socket.close()


def cansend(interface, *frames):
    for frame in frames:
        subprocess.run(["cansend", interface, frame], check=True)


def wait_all(dump, frames):
    wait_until(lambda: len(dump.all()) >= len(frames), f"{len(frames)} frames")
    assert dump.all() == frames


both_ways = pytest.mark.parametrize("how", [Rig.hang_up, Rig.ask], ids=["SIGHUP", "request"])


# ---- Nodes ---------------------------------------------------------------------------------------


@both_ways
def test_a_node_that_is_added_takes_part(how, vcan, rig, candump):
    vcan(3)
    r = rig(bus(ENGINE, GEARBOX))
    gearbox, dash = candump("vcan1"), candump("vcan2")
    cansend("vcan0", "123#01")
    wait_all(gearbox, ["123#01"])
    r.reload(bus(DASH, ENGINE, GEARBOX), how)
    cansend("vcan2", "300#03")
    cansend("vcan0", "123#02", LAST)
    wait_until(lambda: LAST in gearbox.all() and LAST in dash.all(), "the last frame")
    assert sorted(gearbox.all()) == ["123#01", "123#02", "300#03", LAST]
    assert sorted(dash.all()) == ["123#02", "300#03", LAST]  # one of them vcan's own echo
    nodes = r.nodes()
    assert list(nodes) == ["dash", "engine", "gearbox"]
    assert [(n["tx_frames"], n["rx_frames"]) for n in nodes.values()] == [(1, 2), (3, 1), (0, 4)]
    assert f"reload: {RELOADED}, 3 nodes" in r.daemon.stop()


@both_ways
def test_frames_of_a_node_that_is_removed_are_counted_as_dropped(
    how, vcan, rig, candump, events
):
    vcan(3)
    r = rig(bus(ENGINE, GEARBOX, DASH))
    dash = candump("vcan2")
    watch = events(r, "drop", "tx", "rx")
    # alone on its wire it sends the first of its frames again and again
    r.shell.run("inject", "reload",
                "{ name: cut, when: { time: 0s }, do: { partition: [[dash], [engine, gearbox]] } }")
    waiting = [f"300#{i:02X}" for i in range(5)]
    cansend("vcan2", *waiting)
    wait_until(lambda: r.nodes()["dash"]["queue"] == 5, "a queue")
    r.reload(bus(ENGINE, GEARBOX), how)
    drops = watch.until(lambda e: e["frame"] == waiting[-1])
    assert [(e["node"], e["frame"], e["why"]) for e in drops] == [
        ("dash", frame, "removed") for frame in waiting]
    cansend("vcan0", "123#01")
    cansend("vcan2", "300#FF")  # the daemon no longer listens there
    taken = watch.until(lambda e: e["event"] == "tx")
    assert [(e["node"], e["event"]) for e in taken] == [("gearbox", "rx"), ("engine", "tx")]
    assert list(r.nodes()) == ["engine", "gearbox"]
    assert dash.data() == waiting + ["300#FF"]  # vcan's own echo
    assert "node dash: 5 dropped" in r.daemon.stop()


def test_a_node_that_is_renamed_is_a_new_one_on_the_same_port(vcan, rig, candump):
    vcan(2)
    r = rig(bus(ENGINE, GEARBOX))
    engine, gearbox = candump("vcan0"), candump("vcan1")
    r.shell.run("inject", "reload",
                "{ name: tec, when: { time: 0s }, do: { counters: gearbox, tec: 50 } }")
    cansend("vcan1", "200#01")
    wait_all(engine, ["200#01"])
    assert r.nodes()["gearbox"]["tec"] == 49
    r.reload(bus(ENGINE, GEARBOX.replace("gearbox", "transmission")))
    cansend("vcan0", "123#01")
    cansend("vcan1", "200#02")
    wait_all(engine, ["200#01", "123#01", "200#02"])
    wait_all(gearbox, ["200#01", "123#01", "200#02"])
    nodes = r.nodes()
    assert list(nodes) == ["engine", "transmission"]
    new = nodes["transmission"]
    assert (new["tec"], new["tx_frames"], new["rx_frames"]) == (0, 1, 1)
    r.daemon.stop()


RENAMINGS = 20


def test_renaming_under_load_makes_no_echo(vcan, rig, can_socket):
    """Frames that the bus delivers to a port during a change of its node are not frames of the
    ECU."""
    vcan(2)
    names = [GEARBOX, GEARBOX.replace("gearbox", "transmission")]
    texts = [bus(load("100#01, every: 150us"), ENGINE, name) for name in names]
    r = rig(texts[0])
    engine = can_socket("vcan0")
    for i in range(RENAMINGS):
        r.reload(texts[(i + 1) % 2])
        node = list(r.nodes().values())[2]
        assert (node["handed_in"], node["tx_frames"]) == (0, 0)
    received = engine.drain()
    assert set(received) == {Frame.parse("100#01")}
    assert r.daemon.stop().count(RELOADED) == RENAMINGS


def test_ports_that_are_exchanged(vcan, rig, candump):
    vcan(2)
    r = rig(bus(ENGINE, GEARBOX))
    zero, one = candump("vcan0"), candump("vcan1")
    cansend("vcan0", "123#01")
    wait_all(one, ["123#01"])
    r.reload(bus(ENGINE.replace("vcan0", "vcan1"), GEARBOX.replace("vcan1", "vcan0")))
    cansend("vcan1", "123#02")
    wait_all(zero, ["123#01", "123#02"])
    nodes = r.nodes()
    assert (nodes["engine"]["port"], nodes["engine"]["tx_frames"]) == ("vcan1", 2)
    assert (nodes["gearbox"]["port"], nodes["gearbox"]["rx_frames"]) == ("vcan0", 2)
    r.daemon.stop()


def test_changed_settings_apply_and_state_and_counters_stay(vcan, rig, candump):
    vcan(2)
    r = rig(bus(ENGINE, GEARBOX))
    engine = candump("vcan0")
    r.shell.run("inject", "reload",
                "{ name: tec, when: { time: 0s }, do: { counters: engine, tec: 100 } }")
    wait_all(engine, [state(TX_WARNING, 100, 0)])
    r.shell.run("clear", "reload", "tec")
    before = r.nodes()
    r.reload(bus(ENGINE.replace(" }", ", queue: 7, restart-ms: 30, order: fifo, listen-only: on }"),
                 GEARBOX))
    cansend("vcan0", "123#01")
    wait_until(lambda: r.nodes()["engine"]["dropped"]["listen-only"] == 1, "the drop")
    after = r.nodes()
    settings = after["engine"]["settings"]
    assert (settings["queue"], settings["restart-ms"], settings["order"]) == (7, 30, "fifo")
    assert settings["listen-only"] is True
    assert (after["engine"]["tec"], after["engine"]["state"]) == (100, "error-warning")
    assert after["gearbox"] == before["gearbox"]
    r.reload(bus(ENGINE, GEARBOX))
    cansend("vcan0", "123#02")
    wait_until(lambda: r.nodes()["engine"]["tx_frames"] == 1, "a frame")
    assert r.nodes()["engine"]["tec"] == 99
    assert engine.errors() == [state(TX_WARNING, 100, 0)]  # reported once
    r.daemon.stop()


def test_a_queue_outlives_a_reload_and_injected_rules_do_not(vcan, rig, candump):
    vcan(3)
    r = rig(bus(ENGINE, GEARBOX))
    gearbox = candump("vcan1")
    r.shell.run("inject", "reload",
                "{ name: cut, when: { time: 0s }, do: { partition: [[engine], [gearbox]] } }")
    waiting = [f"123#{i:02X}" for i in range(10)]
    cansend("vcan0", *waiting)
    wait_until(lambda: (n := r.nodes()["engine"])["tec"] == 128 and n["queue"] == 10, "TEC 128")
    r.reload(bus(GEARBOX, ENGINE, DASH))
    wait_all(gearbox, waiting)
    engine = r.nodes()["engine"]
    assert (engine["tx_frames"], engine["queue"]) == (10, 0)
    assert engine["error_passive"] == 1 and engine["errors"]["ack"] >= 16
    # the gearbox may have missed the beginning of the attempt that the reload made whole again
    assert engine["tec"] in (128 - 10, 128 - 10 + 8)
    assert r.shell.run("faults", "reload").splitlines()[1:] == []
    r.daemon.stop()


# ---- Traffic -------------------------------------------------------------------------------------


def test_changed_traffic(vcan, rig, can_socket):
    vcan(1)
    r = rig(bus(ENGINE, load("100#01, every: 1ms")))
    engine = can_socket("vcan0")
    engine.receive(10)
    r.reload(bus(ENGINE, load("101#02, every: 1ms"), load("102#03, every: 1ms", name="more")))
    frames = []  # at first some of before the reload
    wait_until(lambda: frames.extend(f.identifier for f in engine.drain())
               or frames.count(0x102) >= 10, "the new traffic")
    new = frames[frames.index(0x101):]
    assert {0x101, 0x102} == set(new) and new.count(0x101) >= 9
    r.daemon.stop()


RELEASES = 60000


@pytest.mark.deep
def test_traffic_that_did_not_change_is_released_once(vcan, rig):
    """A release in each bit, so that one falls into the bit of a reload."""
    vcan(3)
    sender = load(f"100#, every: 1bit, count: {RELEASES}")
    texts = [bus(ENGINE, sender, bitrate=10000), bus(sender, ENGINE, DASH, bitrate=10000)]
    r = rig(texts[0])
    for following in itertools.cycle((texts[1], texts[0])):
        r.reload(following)
        if bits(r) >= RELEASES:
            break
    wait_until(lambda: bits(r) > RELEASES + 100, "all releases")
    assert r.nodes()["load"]["handed_in"] == RELEASES
    r.daemon.stop()


def bits(r):
    return r.shell.status("reload")["bus"]["bits"]


# ---- Load ----------------------------------------------------------------------------------------

MANY = 10000  # or more, until all reloads are done
OUTSTANDING = 400  # written and not yet seen by the peer
RELOADS = 20


def sequence_frame(can_id, number):
    return Frame(can_id, 4, number.to_bytes(4, "big"))


def keep_full(ends, sent, received, goal):
    """Lets each end read what has come and write what is to go, up to goal frames.

    No end runs ahead of the other. The lower identifier wins each arbitration, so the other end
    would wait for as long as there is more to write.
    """
    for i, end in enumerate(ends):
        received[i] += end.drain()
        upto = min(goal, min(map(len, received)) + OUTSTANDING)
        end.send(*(sequence_frame(0x100 + i, k) for k in range(sent[i], upto)))
        sent[i] = max(upto, sent[i])
    select.select([e.socket for e in ends], [], [], 1)  # poll: in a loop


def test_reloads_under_saturated_load_lose_nothing_and_double_nothing(vcan, rig, can_socket):
    vcan(3)
    queue = [node.replace(" }", ", queue: 4096 }") for node in (ENGINE, GEARBOX)]
    texts = [bus(*queue, bitrate=1000000), bus(DASH, *reversed(queue), bitrate=1000000)]
    r = rig(texts[0])
    ends = [can_socket("vcan0"), can_socket("vcan1")]
    sent, received, reloads, goal = [0, 0], [[], []], 0, MANY
    deadline = time.monotonic() + 10 * PATIENCE_S
    while min(map(len, received)) < goal:
        assert time.monotonic() < deadline, (sent, reloads)
        keep_full(ends, sent, received, goal)
        due = min(map(len, received)) > reloads * MANY // (RELOADS + 1)
        if due and reloads < RELOADS and r.times_ready() == reloads + 1:
            reloads += 1
            r.write(texts[reloads % 2])
            r.hang_up()
        if max(sent) > goal - OUTSTANDING and reloads < RELOADS:
            goal += OUTSTANDING
    for i in range(2):
        assert received[1 - i] == [sequence_frame(0x100 + i, k) for k in range(goal)]
    wait_until(lambda: r.times_ready() == reloads + 1, "the last reload")
    for name in "engine", "gearbox":
        node = r.nodes()[name]
        assert (node["handed_in"], node["tx_frames"], node["rx_frames"]) == (goal, goal, goal)
        assert node["bus_errors"] == sum(node["dropped"].values()) == 0
    assert r.daemon.stop().count(RELOADED) == reloads == RELOADS


def test_bad_reloads_under_load_are_no_disturbance(vcan, rig, can_socket):
    vcan(2)
    good = bus(ENGINE.replace(" }", ", queue: 4096 }"), GEARBOX, load("7F0#00, every: 300us"))
    r = rig(good)
    before = {name: node["settings"] for name, node in r.nodes().items()}
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    written = [sequence_frame(0x100, k) for k in range(3000)]
    bad = list(BAD_FILES.values()) + list(CHANGES.values())
    received = []
    for i, (text, _) in enumerate(2 * bad):
        engine.send(*written[i * 150 : (i + 1) * 150])
        r.write(text)
        r.hang_up()
        replies = ask_for_reloads(r, 3)
        assert not any(reply["ok"] for reply in replies), replies
        received += gearbox.drain()
    assert len(2 * bad) * 150 >= len(written)
    wait_until(lambda: received.extend(gearbox.drain()) or len(
        [f for f in received if f.identifier == 0x100]) >= len(written), "all frames")
    assert [f for f in received if f.identifier == 0x100] == written
    assert {name: node["settings"] for name, node in r.nodes().items()} == before
    assert r.daemon.stop().count(RELOADED) == 0


# ---- One after the other -------------------------------------------------------------------------

# a frame takes 27 ms, so that reloads may meet before the bus changes
SLOW = [load("123#1122334455667788, every: 1ms"), ENGINE]
BURST = 8


def ask_for_reloads(r, count):
    """Asks for so many reloads at once; returns the replies."""
    with socket.socket(socket.AF_UNIX) as s:
        s.settimeout(PATIENCE_S)
        s.connect(str(r.daemon.config.parent / "reload.sock"))
        s.sendall(b'{"request":"reload"}\n' * count)
        with s.makefile() as lines:
            return [json.loads(lines.readline()) for _ in range(count)]


def test_a_reload_takes_the_place_of_one_under_way(vcan, rig, can_socket):
    vcan(3)
    r = rig(bus(*SLOW, bitrate=5000))
    engine = can_socket("vcan0")
    engine.receive(3)
    r.write(bus(*SLOW, GEARBOX, DASH, bitrate=5000))  # each of them needs vcan1 and vcan2
    assert [reply["ok"] for reply in ask_for_reloads(r, BURST)] == [True] * BURST
    wait_until(lambda: list(r.nodes()) == ["load", "engine", "gearbox", "dash"], "the reload")
    r.write(bus(*SLOW, DASH, bitrate=5000))
    assert ask_for_reloads(r, 1)[0]["ok"]
    r.write("bus: {}\n")
    assert not any(reply["ok"] for reply in ask_for_reloads(r, BURST))
    wait_until(lambda: list(r.nodes()) == ["load", "engine", "dash"], "the good one")
    before = r.nodes()["load"]["tx_frames"]
    dash = can_socket("vcan2")
    assert len(dash.receive(3)) >= 3
    assert r.nodes()["load"]["tx_frames"] > before
    # the machine decides how many of a burst meet within a frame; see test_engine_reload.c
    assert 2 <= r.daemon.stop().count(RELOADED) <= 1 + BURST


# ---- What is refused -----------------------------------------------------------------------------

GOOD = bus(ENGINE, GEARBOX)
BAD_FILES = {
    "syntax": (GOOD + "faults: [\n", r":\d+:\d+: "),
    "unknown key": (GOOD.replace("port: vcan1", "prot: vcan1"), r":5:\d+: .*prot"),
    "duplicate name": (bus(ENGINE, GEARBOX.replace("gearbox", "engine")), r":5:\d+: .*engine"),
    "value": (GOOD.replace("port: vcan1", "port: vcan1, queue: 0"), r":5:\d+: .*queue"),
    "rule": (GOOD + "faults: [ { name: f, do: { stuck: dominant, on: engien.tx } } ]\n",
             r":6:\d+: .*engien"),
    "empty": ("", ":1:1: "),
}
CHANGES = {
    "bus.bitrate": (GOOD.replace("500000", "250000"), r":1:\d+"),
    "bus.name": (GOOD.replace("name: reload", "name: other"), r":1:\d+"),
    "control": (GOOD.replace("reload.sock", "other.sock"), r":2:10"),
    "lcm": (GOOD + "lcm: {}\n", r":6:6"),
}


def check_refused(r, text, pattern, candump):
    """Asks in both ways for a reload, which is refused; then the bus is unchanged."""
    before = {name: node["settings"] for name, node in r.nodes().items()}
    r.write(text)
    ready = r.times_ready()
    r.hang_up()
    wait_until(lambda: UNCHANGED in r.log(), "the refusal")
    wait_until(lambda: r.times_ready() > ready, "READY=1")
    error = r.shell.run("reload", "reload", status=1)
    for told in r.log(), error:
        assert re.search(re.escape(str(r.daemon.config)) + pattern, told), told
    assert {name: node["settings"] for name, node in r.nodes().items()} == before
    gearbox = candump("vcan1")
    cansend("vcan0", "123#01")
    wait_all(gearbox, ["123#01"])
    r.reload(GOOD)
    assert r.daemon.stop().count(RELOADED) == 1


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_changes_nothing_and_says_why(name, vcan, rig, candump):
    vcan(2)
    text, pattern = BAD_FILES[name]
    check_refused(rig(GOOD), text, pattern, candump)


@pytest.mark.parametrize("what", CHANGES)
def test_what_needs_a_restart_is_refused_with_a_word(what, vcan, rig, candump):
    vcan(2)
    text, place = CHANGES[what]
    pattern = f"{place}: {re.escape(what)} cannot change while the bus runs: restart canwired"
    check_refused(rig(GOOD), text, pattern, candump)


def test_a_file_that_is_gone_changes_nothing(vcan, rig):
    vcan(2)
    r = rig(GOOD)
    r.daemon.config.unlink()
    assert str(r.daemon.config) in r.shell.run("reload", "reload", status=1)
    assert list(r.nodes()) == ["engine", "gearbox"]
    r.reload(GOOD)
    r.daemon.stop()


def test_a_missing_interface_refuses_the_whole_reload(vcan, rig, candump):
    vcan(2)
    r = rig(GOOD)
    text = bus(ENGINE.replace(" }", ", queue: 3 }"), DASH, GEARBOX)
    r.write(text)
    error = r.shell.run("reload", "reload", status=1)
    assert "node dash: port vcan2: " in error and "canwire vcan up" in error
    r.hang_up()
    wait_until(lambda: UNCHANGED in r.log(), "the refusal")
    assert f"{r.daemon.config}:5:25: node dash: port vcan2: " in r.log()
    nodes = r.nodes()
    assert list(nodes) == ["engine", "gearbox"] and nodes["engine"]["settings"]["queue"] == 1024
    subprocess.run("ip link add vcan2 type vcan && ip link set vcan2 up", shell=True, check=True)
    try:
        r.reload(text)
        dash = candump("vcan2")
        cansend("vcan0", "123#01")
        wait_all(dash, ["123#01"])
        assert r.nodes()["engine"]["settings"]["queue"] == 3
        r.daemon.stop()
    finally:
        subprocess.run(["ip", "link", "del", "vcan2"], check=True)


# ---- By file and process, as a service manager does ----------------------------------------------


def ask_by_file(r, *words, status=0):
    return r.shell.run("reload", "--config", str(r.daemon.config), *words, status=status)


def test_a_bus_is_found_by_its_file(vcan, rig):
    """A refused reload ends with 1, and another process at the socket is not asked."""
    vcan(3)
    r = rig(GOOD)
    pid = str(r.daemon.process.pid)
    for words in (), ("--pid", pid):
        r.reload(GOOD, lambda r, w=words: ask_by_file(r, *w))
    assert r.log().count(RELOADED) == 2
    assert f"that is process {pid}, not 1\n" in ask_by_file(r, "--pid", "1", status=1)
    r.write(bus(ENGINE, GEARBOX, bitrate=250000))
    told = ask_by_file(r, "--pid", pid, status=1)
    assert told.endswith("bus.bitrate cannot change while the bus runs: restart canwired\n")
    r.write("bus: {}\n")
    assert "bus.yaml:1:6: " in ask_by_file(r, "--pid", pid, status=1)
    assert r.daemon.stop().count(RELOADED) == 2


def test_a_bus_without_control_socket_gets_a_signal(vcan, rig, tmp_path):
    vcan(3)
    r = rig(GOOD.replace("control: reload.sock\n", ""))
    assert "has no control socket: --pid is needed" in ask_by_file(r, status=1)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "manager"))
        manager.settimeout(PATIENCE_S)
        r.shell.environment["NOTIFY_SOCKET"] = manager.getsockname()
        r.reload(r.daemon.config.read_text(),
                 lambda r: ask_by_file(r, "--pid", str(r.daemon.process.pid)))
        assert manager.recv(100) == b"RELOADING=1"  # whole: a datagram
    assert r.daemon.stop().count(RELOADED) == 1


# ---- systemd -------------------------------------------------------------------------------------


def test_tells_systemd_that_it_reloads(vcan, rig):
    vcan(2)
    r = rig(GOOD)
    for text in bus(ENGINE), "bus: {}\n":  # a bad one, too, ends the reload
        start = len(r.daemon.notifications)
        earliest = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        r.write(text)
        r.hang_up()
        wait_until(lambda s=start: "READY=1" in r.daemon.notifications[s:], "READY=1")
        latest = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        told = [n for n in r.daemon.notifications[start:] if not n.startswith("STATUS=")]
        assert [n.split("=")[0] for n in told] == ["RELOADING", "MONOTONIC_USEC", "READY"]
        assert told[0] == "RELOADING=1"
        assert earliest <= int(told[1].split("=")[1]) <= latest
    r.daemon.stop()
