# SPDX-License-Identifier: MIT
"""The control socket and the tool that uses it, on a bus with real ECUs."""

import contextlib
import grp
import itertools
import json
import multiprocessing
import os
import re
import select
import socket
import stat
import struct
import subprocess
import time

import pytest

from canbits import Frame
from conftest import PATIENCE_S, ROOT, ask_status, wait_until

CANWIRE = os.environ.get("CANWIRE") or ROOT / "build/release/canwire"
BUS = """
bus: {{ name: powertrain, bitrate: 500000 }}
nodes:
  - {{ name: engine, port: vcan0, queue: 4096 }}
  - {{ name: gearbox, port: vcan1 }}
faults:
  - {{ name: configured, when: {{ frame: "7FF" }}, do: {{ flip: "crc[3]" }} }}
control: {path}
"""
FRAME = Frame.parse("123#DEADBEEF")
CAN_RAW_ERR_FILTER, CAN_ERR_ACK = 2, 0x20  # names that Python lacks
WATCHDOG_S = 10  # of systemd/canwired@.service
SO_TIMESTAMPNS = 35  # a name that Python lacks
HIT_ONCE = '{name: once, when: {frame: "123", count: 1}, do: {flip: "crc[3]", at: [gearbox]}}'


class Control:
    """A running canwired, and canwire as its client."""

    def __init__(self, folder, canwired):
        self.folder, self.path = folder, folder / "powertrain.sock"
        self.text = BUS.format(path=self.path)
        self.environment = dict(os.environ, CANWIRE_RUN=str(folder))
        self.daemon = canwired(self.text, after=["--verbose"])

    def tool(self, *words, status=0, **more):
        """Runs canwire; returns what it wrote to standard output, or to both if it fails."""
        done = subprocess.run(
            [CANWIRE, *words], env=self.environment, text=True, capture_output=True, **more
        )
        assert done.returncode == status, done.stdout + done.stderr
        assert "Sanitizer" not in done.stderr
        return done.stdout + done.stderr if status else done.stdout

    def popen(self, *words):
        return subprocess.Popen([CANWIRE, *words], env=self.environment, text=True, stdout=-1)

    def status(self):
        return ask_status(self.path)

    def node(self, name):
        return next(n for n in self.status()["nodes"] if n["name"] == name)

    def faults(self):
        return {f["name"]: f for f in json.loads(self.tool("faults", "powertrain", "--json"))}

    def connect(self):
        s = socket.socket(socket.AF_UNIX)
        s.settimeout(30)
        s.connect(str(self.path))
        return s


@pytest.fixture
def control(tmp_path, vcan, canwired):
    vcan(2)
    return Control(tmp_path, canwired)


@pytest.fixture
def ecus(control, can_socket):
    return can_socket("vcan0"), can_socket("vcan1")


def test_status_shows_nodes_as_ip_does(control, ecus):
    engine, gearbox = ecus
    engine.send(FRAME)
    assert gearbox.receive(1) == [FRAME]
    text = control.tool("status", "powertrain")
    assert re.search(r"^powertrain: bitrate 500000 up \d+\.\d{3} s load ", text)
    assert "\n1: engine@vcan0: qlen 4096 order priority\n" in text
    assert "    can state ERROR-ACTIVE (berr-counter tx 0 rx 0) restart-ms 0\n" in text
    titles = "re-started bus-errors arbit-lost error-warn error-pass bus-off"
    assert f"\t  {titles}\n\t  " + " ".join(["0         "] * 5) + " 0\n" in text
    node = r"2: gearbox@vcan1:.*RX:  bytes packets errors dropped  missed   mcast\n" \
           r" +4 +1 +0 +0 +0 +0\n"
    assert re.search(node, text, re.DOTALL)
    assert control.node("gearbox")["interface"]["written"] == 1
    listed = json.loads(control.tool("status", "--json"))
    assert [s["bus"]["name"] for s in listed] == ["powertrain"]


def wait_until_watched(control, watch):
    """Fires a rule that changes nothing until the watch reports it; then reads all events."""
    control.tool("inject", "powertrain", "{ name: probe, when: { manual: yes }, "
                                         "do: { set: engine, loopback: off } }")
    lines, fired = [], 0
    while not select.select([watch.stdout], [], [], 0.1)[0]:  # poll: in a loop
        control.tool("fire", "powertrain", "probe")
        fired += 1
        assert fired < 1000, "nothing is watched"
    hits = json.loads(control.tool("faults", "powertrain", "--json"))[-1]["hits"]
    while not lines or lines[-1]["hit"] < hits:
        lines.append(json.loads(watch.stdout.readline()))
    control.tool("clear", "powertrain", "probe")


def test_a_rule_is_injected_and_watched_and_cleared(control, ecus):
    engine, gearbox = ecus
    with control.popen("watch", "powertrain", "fault,error", "--json") as watch:
        wait_until_watched(control, watch)
        assert control.tool("inject", "powertrain", HIT_ONCE) == "once\n"
        engine.send(FRAME)
        assert gearbox.receive(1) == [FRAME]  # at the second attempt
        events = [json.loads(watch.stdout.readline()) for _ in range(2)]
        watch.terminate()
    assert events[0].items() >= {"event": "fault", "rule": "once", "hit": 1}.items()
    # no other node acknowledges
    assert events[1].items() >= {"node": "engine", "event": "error", "type": "ack"}.items()
    once = control.faults()["once"]
    assert (once["hits"], once["over"], once["injected"]) == (1, True, True)
    assert "a rule 'once' is running already" in control.tool(
        "inject", "powertrain", HIT_ONCE, status=1
    )
    control.tool("clear", "powertrain", "once")
    assert list(control.faults()) == ["configured"]
    assert control.tool("clear", "powertrain") == "1 rule cleared\n"
    assert control.faults() == {}


def test_rules_come_from_files_standard_input_and_profiles(control, tmp_path):
    rules = tmp_path / "rules.yaml"
    rules.write_text(f"- {HIT_ONCE}\n- {{name: bad, do: {{bus-off: engin}}}}\n")
    errors = control.tool("inject", "powertrain", rules, status=1)
    assert errors.startswith(f"{rules}:2:") and "did you mean 'engine'" in errors
    assert list(control.faults()) == ["configured"]
    assert control.tool("inject", "powertrain", "-", input=HIT_ONCE) == "once\n"
    assert "stdin:" in control.tool("inject", "powertrain", "-", input="{", status=1)
    profile = ROOT / "config/profiles/deaf-ecu.yaml"
    names = control.tool("inject", "--with", "victim=gearbox", "powertrain", profile).split()
    assert names and set(names) < set(control.faults())
    control.tool("clear", "powertrain", "--injected")
    assert list(control.faults()) == ["configured"]


def test_an_ecu_goes_bus_off_by_hand_and_comes_back(control, ecus):
    engine, gearbox = ecus
    rule = "{name: kill, when: {manual: yes}, do: {bus-off: engine}}"
    control.tool("inject", "powertrain", rule)
    refusal = control.tool("restart", "powertrain", "engine", status=1)
    assert "not bus-off but error-active" in refusal
    control.tool("fire", "powertrain", "kill")
    wait_until(lambda: control.node("engine")["state"] == "bus-off", "bus-off")
    engine.send(FRAME)
    wait_until(lambda: control.node("engine")["dropped"]["bus-off"] == 1, "the drop")
    control.tool("restart", "powertrain", "engine")
    wait_until(lambda: control.node("engine")["state"] == "error-active", "the restart")
    engine.send(FRAME)
    assert gearbox.receive(1) == [FRAME]


def test_settings_change_at_once(control, ecus):
    engine, gearbox = ecus
    control.tool("set", "powertrain", "engine", "listen-only=on", "restart-ms=50")
    settings = control.node("engine")["settings"]
    assert (settings["listen-only"], settings["restart-ms"]) == (True, 50)
    assert "can <LISTEN-ONLY> state ERROR-ACTIVE" in control.tool("status", "powertrain")
    engine.send(FRAME)
    wait_until(lambda: control.node("engine")["dropped"]["listen-only"] == 1, "the drop")
    control.tool("set", "powertrain", "engine", "listen-only=off")
    engine.send(FRAME)
    assert gearbox.receive(1) == [FRAME]
    refusal = control.tool("set", "powertrain", "engine", "one-shut=on", status=1)
    assert "did you mean 'one-shot'?" in refusal


def test_bus_errors_are_reported_when_that_is_switched_on(control, ecus):
    engine, gearbox = ecus
    engine.socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, CAN_ERR_ACK)
    for switch, reported in ("off", 0), ("on", 1):
        control.tool("set", "powertrain", "engine", f"berr-reporting={switch}")
        control.tool("inject", "powertrain", HIT_ONCE)
        engine.send(FRAME)
        assert gearbox.receive(1) == [FRAME]
        assert len(engine.receive(reported)) == reported
        control.tool("clear", "powertrain", "once")


def test_reload_takes_a_good_file_and_refuses_a_bad_one(control):
    good = control.text.replace("name: gearbox,", "name: gearbox, restart-ms: 70,")
    control.daemon.config.write_text(good)
    control.tool("reload", "powertrain")
    wait_until(lambda: control.node("gearbox")["settings"]["restart-ms"] == 70, "the reload")
    control.daemon.config.write_text(good + "x: 1\n")
    error = control.tool("reload", "powertrain", status=1)
    assert error.startswith(f"{control.daemon.config}:9:1: ")
    assert control.node("gearbox")["settings"]["restart-ms"] == 70


def test_the_tool_says_what_is_wrong(control, tmp_path):
    nosuch = control.tool("status", "nosuch", "--wait", "0", status=1)
    assert nosuch == (
        "canwire: bus nosuch: no such bus; those in " + str(tmp_path) + ": powertrain\n")
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(tmp_path / "left.sock"))
    left.close()
    assert "(is canwired@left running?)" in control.tool("restart", "left", "x", status=1)
    both = control.tool("status", status=1)  # shows all that is possible
    assert "left.sock" in both and "powertrain: bitrate" in both
    for words in (["set", "powertrain", "engine"], ["clear"], ["set", "a", "b", "c"], ["watch"]):
        assert "canwire" in control.tool(*words, status=2)
    for command in "status faults inject clear fire restart set watch reload".split():
        assert f"usage: canwire {command}" in control.tool(command, "--help")


def test_the_socket_is_for_its_group_and_goes_with_the_daemon(control):
    found = control.path.stat()
    assert stat.S_ISSOCK(found.st_mode) and stat.S_IMODE(found.st_mode) == 0o660
    try:
        assert found.st_gid == grp.getgrnam("canwire").gr_gid
    except KeyError:
        assert found.st_gid == os.getgid()
    control.connect().close()
    wait_until(
        lambda: f"control: client: uid {os.getuid()}, pid {os.getpid()}" in control.daemon.stderr(),
        "who it was",
    )
    control.daemon.stop()
    assert not control.path.exists()


def test_the_socket_of_a_live_daemon_is_refused_and_that_of_a_dead_one_replaced(control, launch):
    nodes = re.sub("port: vcan., ?", "", control.text).replace(", port: vcan1", "")
    second = launch(nodes)
    assert second.wait() == 1
    assert "in use; is another canwired running" in second.stderr()
    assert control.status()["pid"] == control.daemon.process.pid
    control.daemon.process.kill()
    control.daemon.process.wait()
    assert control.path.exists()
    third = launch(nodes)
    third.wait_ready()
    assert control.status()["pid"] == third.process.pid


# ---- Clients that mean harm while the bus is busy ------------------------------------------------


def huge_lines(control):
    with control.connect() as s:
        s.sendall(b"x" * (3 << 20))


def deep_nesting(control):
    with control.connect() as s:
        s.sendall((b"[" * 60000 + b"\n") * 10)
        s.recv(4096)  # whole: or not, it is not looked at


def long_injections(control):
    rules = "{name: x}, " * 4900 + "{flip: crc[3]}, " * 25
    text = json.dumps({"request": "inject", "text": f"[{rules}]"})
    with control.connect() as s:
        s.sendall(text.encode() + b"\n")
        s.recv(4096)  # whole: or not, it is not looked at


def half_lines(control):
    many = [control.connect() for _ in range(40)]
    for s in many:
        s.sendall(b'{"request":')
    time.sleep(0.5)  # no wait: it may find them at once or later
    for s in many:
        s.close()


def thousand_connections(control):
    many = []
    for _ in range(1000):
        s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        many.append(s)
        try:
            s.connect(str(control.path))
            s.send(b'{"request":"status"}\n')
        except (BlockingIOError, ConnectionError):
            pass
    for s in many:
        s.close()


def slow_reader_of_events(control):
    with control.connect() as s:
        s.sendall(b'{"request":"watch"}\n')
        time.sleep(1)  # no wait: it reads nothing


def slow_reader_of_replies(control):
    with control.connect() as s:
        s.sendall(b'{"request":"status"}\n' * 5000)


def noise(control):
    with control.connect() as s:
        s.sendall(os.urandom(1 << 20))


ATTACKS = [
    huge_lines,
    deep_nesting,
    long_injections,
    half_lines,
    thousand_connections,
    slow_reader_of_events,
    slow_reader_of_replies,
    noise,
]


def keep_attacking(attack, control, going_on):
    while not going_on.poll():
        try:
            attack(control)
        except OSError:
            pass  # it was disconnected


@contextlib.contextmanager
def attacking(attack, control):
    """Attacks by another process, since this one observes the bus. The first attack precedes the
    observation, and attacks go on until the end."""
    ours, its = multiprocessing.Pipe()

    def run():
        with contextlib.suppress(OSError):
            attack(control)
        its.send("once")
        keep_attacking(attack, control, its)

    process = multiprocessing.get_context("fork").Process(target=run)
    process.start()
    try:
        assert ours.recv() == "once"  # whole: a message
        yield
    finally:
        ours.send("enough")
        process.join()
    assert process.exitcode == 0


def stamps_of(end, count):
    """Returns the times at which frames were written to the interface, in s. They come from the
    kernel's clock and do not depend on the reading."""
    end.setblocking(True)
    end.settimeout(PATIENCE_S)
    stamps = []
    while len(stamps) < count:
        _, ancillary, _, _ = end.recvmsg(64, 256)
        seconds, ns = struct.unpack("qq", ancillary[0][2])
        stamps.append(seconds + ns / 1e9)
    end.setblocking(False)
    return stamps


@pytest.mark.parametrize("attack", [None, *ATTACKS], ids=lambda a: a.__name__ if a else "nobody")
def test_hostile_clients_never_stall_the_bus(attack, control, ecus):
    """tests/unit checks the work of a client between two looks at the bus. This test checks that no
    watchdog would end canwired."""
    engine, gearbox = ecus
    gearbox.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    frames = 3000
    with attacking(attack, control) if attack else contextlib.nullcontext():
        engine.send(*[FRAME] * frames)  # 165 us each
        stamps = stamps_of(gearbox.socket, frames)
    gap = max(later - earlier for earlier, later in itertools.pairwise(stamps))
    print(f"longest gap {gap:.3f} s of {stamps[-1] - stamps[0]:.3f} s")
    assert gap < WATCHDOG_S
    assert gearbox.receive(1, 0.2) == []
    node = wait_until(lambda: control.node("engine"), "an answer")
    assert (node["tx_frames"], sum(node["dropped"].values())) == (frames, 0)
    assert node["interface"]["kernel_dropped"] == 0
    control.daemon.stop()
