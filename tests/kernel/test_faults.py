# SPDX-License-Identifier: MIT
"""Faults on real vcan, as users see them: can-utils and python-can at the ECUs, canwire in a shell.

The output of candump -L is compared unchanged. A frame of the lowest priority that arrives after
all others shows that nothing else is to come.
"""

import json
import os
import subprocess
from pathlib import Path

import can
import pytest

from conftest import CANWIRED, ROOT, ask_status, listeners, wait_until

CANWIRE = os.environ.get("CANWIRE") or Path(CANWIRED).with_name("canwire")
PROFILES = ROOT / "config/profiles"
RECEIVE_BUFFER_BYTES = 16 << 20
TIMEOUT_S = 60  # of a command that must end by itself
NAMES = ("engine", "gearbox", "dash")
LAST = "7FF#"

# error frames in candump's notation
TX_WARNING, RX_WARNING, TX_PASSIVE, RX_PASSIVE, ACTIVE = 0x08, 0x04, 0x20, 0x10, 0x40
BUSOFF, RESTARTED = "20000040#" + "00" * 8, "20000100#" + "00" * 8


def state(bits, tec, rec):
    return f"20000204#00{bits:02X}00000000{tec:02X}{rec:02X}"


def bit_error(tec, location):
    """Returns the error frame of a transmitter."""
    return f"20000288#000081{location:02X}0000{tec:02X}00"


def to_bus_off_and_back(rec=0):
    """Returns the error frames of a driver whose transmitter fails each time, and is restarted."""
    return [state(TX_WARNING, 96, rec), state(TX_PASSIVE, 128, rec), BUSOFF, RESTARTED,
            state(ACTIVE, 0, 0)]


def is_error(frame):
    return len(frame.split("#")[0]) == 8 and frame.startswith("2")


class Candump:
    """Runs candump -L for all data and error frames of one interface."""

    def __init__(self, file, interface):
        self.file = file
        before = listeners(interface, "err")
        with file.open("w") as out:
            self.process = subprocess.Popen(
                ["candump", "-L", "-r", str(RECEIVE_BUFFER_BYTES), f"{interface},0:0,#FFFFFFFF"],
                stdout=out)
        wait_until(lambda: listeners(interface, "err") > before, "candump to listen")

    def all(self):
        lines = self.file.read_text(encoding="ascii").split("\n")[:-1]
        return [line.split()[2] for line in lines]

    def data(self):
        return [frame for frame in self.all() if not is_error(frame)]

    def errors(self):
        return [frame for frame in self.all() if is_error(frame)]

    def close(self):
        self.process.terminate()
        self.process.wait()


class Shell:
    """Runs canwire at the bus of a daemon, as typed in a shell."""

    def __init__(self, daemon):
        self.environment = dict(os.environ, CANWIRE_RUN=str(daemon.config.parent))

    def start(self, *words, **pipes):
        return subprocess.Popen([CANWIRE, *words], env=self.environment, cwd=ROOT, text=True,
                                **pipes)

    def run(self, *words, status=0):
        """Returns the command's standard output, or its standard error when it is to fail."""
        with self.start(*words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as command:
            out, err = command.communicate(timeout=TIMEOUT_S)
        assert command.returncode == status, err
        return err if status else out

    def inject(self, rule):
        name = self.run("inject", "faults", rule).strip()
        assert f"name: {name}," in rule

    def clear(self, rule):
        self.run("clear", "faults", rule)

    def watch(self, file, *words):
        with file.open("w") as out:
            return self.start("watch", "faults", *words, stdout=out, stderr=subprocess.DEVNULL)

    def nodes(self, bus="faults"):
        """Returns the status of the nodes by name."""
        return {node["name"]: node for node in self.status(bus)["nodes"]}

    def status(self, bus):
        return ask_status(f"{self.environment['CANWIRE_RUN']}/{bus}.sock")

    def wait_node(self, name, condition, what, bus="faults"):
        return wait_until(lambda: (n := self.nodes(bus)[name]) and condition(n) and n, what)


class Car:
    """A running bus, a candump at each ECU and a shell."""

    def __init__(self, daemon, dumps):
        self.daemon = daemon
        self.shell = Shell(daemon)
        self.dumps = dumps
        self.engine, self.gearbox = dumps["engine"], dumps["gearbox"]
        self.dash = dumps.get("dash")

    @staticmethod
    def interface(name):
        return f"vcan{NAMES.index(name)}"

    def send(self, name, *frames):
        for frame in frames:
            subprocess.run(["cansend", self.interface(name), frame], check=True)

    def generate(self, name, count):
        """Sends frames of the identifier 700, a millisecond apart."""
        subprocess.run(["cangen", self.interface(name), "-g", "1", "-I", "700", "-L", "1", "-D",
                        "i", "-n", str(count)], check=True)

    def settle(self, sender="dash", away=None):
        """Sends the frame of the lowest priority and waits until all have it."""
        self.send(sender, LAST)
        for name, dump in self.dumps.items():
            if name != away:
                wait_until(lambda d=dump: LAST in d.all(), f"the last frame at the {name}")

    def wait_errors(self, name, errors):
        """Waits until these are all error frames of this ECU so far."""
        dump = self.dumps[name]
        wait_until(lambda: len(dump.errors()) >= len(errors), f"error frames of the {name}")
        assert dump.errors() == errors


@pytest.fixture
def car(vcan, canwired, tmp_path):
    """car({"engine": "restart-ms: 20"}) starts a bus with settings of some of its three nodes."""
    dumps = []

    def start(settings=(), count=3, more=""):
        names, settings = NAMES[:count], dict(settings)
        interfaces = dict(zip(names, vcan(count)))
        nodes = [f"{{ name: {n}, port: {i}, {settings.get(n, '')} }}"
                 for n, i in interfaces.items()]
        daemon = canwired("bus: { name: faults, bitrate: 500000 }\ncontrol: faults.sock\n"
                          f"nodes: [ {', '.join(nodes)} ]\n{more}")
        for name, interface in interfaces.items():
            dumps.append(Candump(tmp_path / name, interface))
        return Car(daemon, dict(zip(names, dumps)))

    yield start
    for dump in dumps:
        dump.close()


# ---- Stuck lines ---------------------------------------------------------------------------------


def test_tx_stuck_recessive_leads_to_bus_off_and_ends_with_the_fault(car):
    c = car({"engine": "restart-ms: 50"})
    c.shell.inject("{ name: stuck, when: { time: 0s }, do: { stuck: recessive, on: engine.tx } }")
    c.send("engine", "123#01")
    c.wait_errors("engine", to_bus_off_and_back())
    c.send("gearbox", "200#01")  # the others go on without it
    wait_until(lambda: "200#01" in c.dash.all(), "a frame of the others")
    c.send("engine", "123#02")  # back on the bus, but still stuck
    c.wait_errors("engine", 2 * to_bus_off_and_back())
    c.shell.clear("stuck")
    c.send("engine", "123#03")
    c.settle()
    assert c.gearbox.all() == ["200#01", "123#03", LAST]
    assert c.dash.all() == ["200#01", "123#03", LAST]
    engine = c.shell.nodes()["engine"]
    assert engine["state"] == "error-active" and engine["tec"] == 0
    assert engine["bus_off"] == engine["restarts"] == engine["dropped"]["bus-off"] == 2
    c.daemon.stop()


def test_tx_stuck_dominant_until_the_transceiver_lets_go(car):
    c = car({"engine": "restart-ms: 50"})
    c.shell.inject("{ name: stuck, when: { time: 0s }, do: "
                   "{ stuck: dominant, on: engine.tx, dominant-timeout: 2ms } }")
    errors = [state(RX_WARNING, 0, 97), state(RX_PASSIVE, 0, 129)]
    for name in NAMES:
        c.wait_errors(name, errors)
    errors += [state(RX_WARNING, 0, 120), state(ACTIVE, 0, 95)]
    c.generate("gearbox", 30)
    c.wait_errors("engine", errors)
    c.wait_errors("dash", errors)
    c.generate("dash", 30)
    c.wait_errors("gearbox", errors)
    c.send("engine", "123#01")  # its transceiver does not let it onto the bus
    c.wait_errors("engine", errors + to_bus_off_and_back(rec=61))
    c.shell.clear("stuck")
    c.send("engine", "123#02")
    c.settle()
    for dump in c.gearbox, c.dash:
        assert dump.errors() == errors
        assert dump.data()[60:] == ["123#02", LAST]
    assert len(c.engine.data()) == 60 + len(["123#01", "123#02", LAST])
    c.daemon.stop()


def test_python_can_sees_bus_off_and_restart(car):
    c = car({"engine": "restart-ms: 50"})
    c.shell.inject("{ name: stuck, when: { time: 0s }, do: { stuck: recessive, on: engine.tx } }")
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        bus.send(can.Message(arbitration_id=0x123, data=[1], is_extended_id=False))
        told = [bus.recv(TIMEOUT_S) for _ in to_bus_off_and_back()]
        assert all(message.is_error_frame for message in told)
        assert [f"{m.arbitration_id | 0x20000000:08X}#{m.data.hex().upper()}" for m in told] == (
            to_bus_off_and_back())
        c.shell.clear("stuck")
        bus.send(can.Message(arbitration_id=0x123, data=[2], is_extended_id=False))
        with can.Bus(interface="socketcan", channel="vcan1") as other:
            bus.send(can.Message(arbitration_id=0x123, data=[3], is_extended_id=False))
            received = other.recv(TIMEOUT_S)  # whole: a frame
    assert received.arbitration_id == 0x123
    c.settle()
    assert c.gearbox.all() == ["123#02", "123#03", LAST]
    c.daemon.stop()


# ---- Single bits ---------------------------------------------------------------------------------


def test_a_wrong_crc_bit_at_one_receiver_makes_all_drop_the_frame_once(car):
    c = car()
    c.shell.inject('{ name: crc, when: { frame: "123", count: 1 }, '
                   'do: { flip: "crc[3]", at: [gearbox] } }')
    c.send("engine", "123#DEADBEEF")
    c.settle()
    for dump in c.dumps.values():
        assert dump.all() == ["123#DEADBEEF", LAST]
    nodes = c.shell.nodes()
    assert nodes["gearbox"]["errors"]["crc"] == nodes["gearbox"]["bus_errors"] == 1
    for other in "engine", "dash":  # they see its error flag where EOF is to be
        assert nodes[other]["errors"]["form"] == nodes[other]["bus_errors"] == 1
    assert nodes["engine"]["retransmissions"] == nodes["engine"]["tx_frames"] == 1
    c.daemon.stop()


def test_a_spoofed_identifier_gives_its_sender_bit_errors(car):
    c = car({"engine": "berr-reporting: on"})
    c.shell.inject('{ name: spoof, when: { frame: "123", from: engine, count: 1 }, '
                   "do: { send: 123#00, as: gearbox } }")
    c.send("engine", "123#FF")
    # Both win the arbitration, and the first data bit is recessive for the engine only. Until both
    # are error-passive, each destroys the frame of the other one. While they are suspended, any
    # other frame would go before theirs.
    wait_until(lambda: len(c.dash.all()) == 2, "both frames")
    c.settle()
    wanted = [bit_error(tec, location=0x0A) for tec in range(8, 137, 8)]
    wanted.insert(wanted.index(bit_error(96, 0x0A)) + 1, state(TX_WARNING, 96, 0))
    wanted.insert(wanted.index(bit_error(128, 0x0A)) + 1, state(TX_PASSIVE, 128, 0))
    assert c.engine.errors() == wanted
    assert c.gearbox.errors() == [state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0),
                                  state(TX_WARNING, 127, 0)]
    assert c.dash.all() == ["123#00", "123#FF", LAST]
    assert c.gearbox.data() == ["123#FF", LAST]
    c.daemon.stop()


def test_spoofing_each_attempt_takes_the_victim_off_the_bus(car):
    c = car({"gearbox": "queue: 64"})
    c.shell.inject('{ name: spoof, when: { frame: "123", from: engine }, '
                   "do: { send: 123#00, as: gearbox } }")
    c.send("engine", "123#FF")
    c.wait_errors("engine", to_bus_off_and_back()[:3])
    c.settle(away="engine")
    assert set(c.dash.data()) == {"123#00", LAST}
    nodes = c.shell.nodes()
    # from its first passive flag on the delimiter has no room between the frames of the attacker
    errors = nodes["engine"]["errors"]
    assert (errors["bit"], errors["form"], nodes["engine"]["tx_frames"]) == (17, 15, 0)
    assert nodes["gearbox"]["bus_off"] == nodes["dash"]["error_warning"] == 0
    c.daemon.stop()


# ---- Acknowledgement -----------------------------------------------------------------------------

ACTIVE_ATTEMPTS = 16  # of a sender without acknowledgement, until it is error-passive


def test_a_suppressed_ack_on_a_bus_of_two(car):
    c = car(count=2)
    c.shell.inject("{ name: mute, when: { time: 0s }, do: { no-ack: [gearbox] } }")
    c.send("engine", "123#01")
    c.shell.wait_node("engine", lambda n: n["errors"]["ack"] > 2 * ACTIVE_ATTEMPTS, "attempts")
    c.wait_errors("engine", [state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0)])
    c.shell.clear("mute")
    engine = c.shell.wait_node("engine", lambda n: n["tx_frames"] == 1, "the acknowledgement")
    gearbox = c.shell.nodes()["gearbox"]
    assert engine["bus_off"] == 0 and engine["tec"] == 127
    # An active error flag destroys the frame for the receiver, too. After a passive one, which no
    # node sees, it has a frame without error, again and again.
    copies = engine["errors"]["ack"] - ACTIVE_ATTEMPTS + 1
    assert gearbox["errors"]["form"] == gearbox["bus_errors"] == ACTIVE_ATTEMPTS
    assert gearbox["rx_frames"] == copies
    c.generate("engine", 40)
    c.settle(sender="engine")
    assert c.gearbox.data()[:copies] == ["123#01"] * copies
    assert len(c.gearbox.data()) == copies + 40 + len([LAST])
    c.wait_errors("engine", [state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0),
                             state(TX_WARNING, 127, 0), state(ACTIVE, 95, 0)])
    assert c.gearbox.errors() == []
    c.daemon.stop()


def test_a_partition_makes_both_halves_time_out_and_heals(car):
    c = car(count=2)
    c.shell.inject("{ name: cut, when: { time: 0s }, do: { partition: [[engine], [gearbox]] } }")
    c.send("engine", "123#01")
    c.send("gearbox", "200#02")
    lonely = [state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0)]
    for name in "engine", "gearbox":
        c.wait_errors(name, lonely)
        node = c.shell.nodes()[name]
        assert node["errors"]["ack"] == node["bus_errors"] >= ACTIVE_ATTEMPTS
        assert (node["state"], node["tec"], node["rx_frames"]) == ("error-passive", 128, 0)
    assert c.engine.data() == ["123#01"] and c.gearbox.data() == ["200#02"]  # vcan's own echo
    c.shell.clear("cut")
    for name in "engine", "gearbox":
        c.shell.wait_node(name, lambda n: n["tx_frames"] == 1, "its frame")
    for name in "engine", "gearbox":  # down from 128 and what they cost each other on the way
        c.generate(name, 80)
    c.settle(sender="engine")
    for dump, own, other in (c.engine, "123#01", "200#02"), (c.gearbox, "200#02", "123#01"):
        # When the halves meet within frames, a bit of a frame may be the acknowledgement of
        # another, which its node does not receive. It is seldom.
        met = int(other in dump.data())
        assert dump.data()[:1 + met] == [own, other][:1 + met]
        assert len(dump.data()) == 1 + met + 2 * 80 + len([LAST])
        assert dump.errors()[:2] == lonely and BUSOFF not in dump.errors()
    for node in c.shell.nodes().values():
        assert node["state"] == "error-active" and node["tx_frames"] >= 81
    c.daemon.stop()


# ---- From the shell ------------------------------------------------------------------------------


def test_restart_brings_a_node_back_by_hand(car):
    c = car({"gearbox": "restart-ms: 100000"})
    for name in "engine", "gearbox":
        c.shell.inject(f"{{ name: off-{name}, when: {{ time: 0s }}, do: {{ bus-off: {name} }} }}")
        c.wait_errors(name, [BUSOFF])
    c.send("engine", "123#01")  # into nowhere
    c.shell.wait_node("engine", lambda n: n["dropped"]["bus-off"] == 1, "the drop")
    c.shell.run("restart", "faults", "engine")
    c.wait_errors("engine", [BUSOFF, RESTARTED, state(ACTIVE, 0, 0)])
    c.send("engine", "123#02")
    wait_until(lambda: c.dash.all() == ["123#02"], "a frame of the engine")
    refusals = {"engine": "it is not bus-off but error-active", "gearbox": "it restarts by itself",
                "dahs": "there is no node 'dahs' (did you mean 'dash'?)"}
    for name, refusal in refusals.items():
        assert refusal in c.shell.run("restart", "faults", name, status=1)
    c.daemon.stop()


def test_set_listen_only_and_back(car):
    c = car()
    c.shell.run("set", "faults", "gearbox", "listen-only=on")
    c.send("gearbox", "200#01")
    c.shell.wait_node("gearbox", lambda n: n["dropped"]["listen-only"] == 1, "the drop")
    c.send("engine", "123#01")
    wait_until(lambda: "123#01" in c.gearbox.all(), "what it listens to")
    c.shell.run("set", "faults", "gearbox", "listen-only=off")
    c.send("gearbox", "200#02")
    c.settle()
    assert c.dash.all() == ["123#01", "200#02", LAST]
    c.daemon.stop()


def test_set_one_shot_gives_up_after_one_attempt(car):
    c = car()
    c.shell.inject('{ name: broken, when: { frame: "123", count: 2 }, '
                   'do: { flip: "crc[3]", at: [gearbox] } }')
    c.shell.run("set", "faults", "engine", "one-shot=on", "warning-limit=50")
    c.send("engine", "123#01")
    engine = c.shell.wait_node("engine", lambda n: n["dropped"]["one-shot"] == 1, "the drop")
    assert engine["settings"]["one-shot"] is True and engine["settings"]["warning-limit"] == 50
    c.shell.run("set", "faults", "engine", "one-shot=off")
    c.send("engine", "123#02")
    c.settle()
    assert c.dash.all() == ["123#02", LAST]
    assert c.shell.nodes()["engine"]["retransmissions"] == 1
    c.shell.run("set", "faults", "engine", "one-shot", status=2)
    assert "one-shoot" in c.shell.run("set", "faults", "engine", "one-shoot=on", status=1)
    c.daemon.stop()


def test_watch_shows_what_happens(car, tmp_path):
    c = car()
    for mark in "text", "json", "plain", "kinds":  # a rule to fire until each of them watches
        c.shell.inject(f"{{ name: {mark}, when: {{ manual: yes }}, "
                       "do: { counters: dash, tec: 0 } }")
    words = {"text": ["--text"], "json": ["--json"], "plain": [],
             "kinds": ["fault,rx", "drop"]}
    files = {mark: tmp_path / f"watch.{mark}" for mark in words}
    watches = [c.shell.watch(file, *words[mark]) for mark, file in files.items()]

    def seen(mark):
        c.shell.run("fire", "faults", mark)
        return files[mark].read_text()

    for mark in words:
        wait_until(lambda m=mark: seen(m), "watch to begin")
    c.send("engine", "123#AB")
    c.settle()
    for file in files.values():
        wait_until(lambda f=file: f.read_text().count(LAST) >= 2, "the last frame")
    frames = {mark: [line for line in file.read_text().splitlines() if "123#AB" in line]
              for mark, file in files.items()}
    assert frames["plain"] == frames["json"]  # no terminal
    lines = [json.loads(line) for line in files["json"].read_text().splitlines()]
    frame = [(e["node"], e["event"]) for e in lines if e.get("frame") == "123#AB"]
    assert frame == [("gearbox", "rx"), ("dash", "rx"), ("engine", "tx")]
    assert [e["t"] for e in lines] == sorted(e["t"] for e in lines)
    text = [line.split() for line in files["text"].read_text().splitlines()]
    assert ["gearbox", "rx", "123#AB"] in [line[1:] for line in text]
    assert ["engine", "tx", "123#AB"] in [line[1:] for line in text]
    kinds = [json.loads(line)["event"] for line in files["kinds"].read_text().splitlines()]
    assert set(kinds) == {"fault", "rx"}
    c.daemon.stop()
    assert [watch.wait(TIMEOUT_S) for watch in watches] == [1] * len(watches)  # the bus has ended


# ---- Profiles ------------------------------------------------------------------------------------


def test_profile_bus_off_attack_at_start(car):
    c = car(more=f"profiles: [ {{ file: {PROFILES / 'bus-off-attack.yaml'}, "
                 'with: { frame: "123" } } ]\n')
    c.send("engine", "123#01")
    c.wait_errors("engine", to_bus_off_and_back()[:3])
    c.send("gearbox", "124#01")  # of another identifier, it is not attacked
    c.settle(away="engine")
    assert c.dash.all() == ["124#01", LAST]
    nodes = c.shell.nodes()
    assert nodes["gearbox"]["state"] == nodes["dash"]["state"] == "error-active"
    assert nodes["engine"]["errors"]["form"] == 32
    c.daemon.stop()


def test_profile_message_doubling_by_inject(car):
    c = car()
    rules = c.shell.run("inject", "--with", "frame=123", "--with", "count=2", "faults",
                        "config/profiles/message-doubling.yaml")
    assert rules == "last-eof-bit\n"
    c.send("engine", "124#00", "123#01")
    c.settle()
    for dump in c.gearbox, c.dash:  # the first two attempts are disturbed, the third is not
        assert dump.all() == ["124#00"] + ["123#01"] * 3 + [LAST]
    nodes = c.shell.nodes()
    assert nodes["engine"]["retransmissions"] == 2
    assert nodes["gearbox"]["bus_errors"] == nodes["dash"]["bus_errors"] == 0
    assert nodes["gearbox"]["overloads"] == nodes["dash"]["overloads"] == 2
    c.daemon.stop()


def test_profile_crc_blind_spot_by_inject(car):
    c = car()
    frame = "32A#35403783970DB6A1"
    c.shell.run("inject", "--with", "victim=gearbox", "faults",
                "config/profiles/crc-blind-spot.yaml")
    c.send("engine", frame)
    c.settle()
    assert c.dash.all() == [frame, LAST]
    wrong, last = c.gearbox.all()
    assert last == LAST and wrong.startswith("32A#") and wrong != frame
    nodes = c.shell.nodes()
    assert nodes["gearbox"]["undetected_errors"] == 1
    assert all(node["bus_errors"] == 0 for node in nodes.values())
    faults = c.shell.run("faults", "faults")
    assert [line.split()[4] for line in faults.splitlines()[1:]] == ["1", "1"]  # hits
    c.daemon.stop()


def test_profiles_are_checked_when_injected(car):
    c = car()
    profile = "config/profiles/deaf-ecu.yaml"
    error = c.shell.run("inject", "--with", "victim=engin", "faults", profile, status=1)
    assert error.startswith(f"{profile}:") and "engin" in error
    assert "victim" in c.shell.run("inject", "faults", profile, status=1)
    assert c.shell.run("faults", "faults").splitlines()[1:] == []
    c.shell.run("inject", "--with", "victim=engine", "faults", profile)
    again = c.shell.run("inject", "--with", "victim=engine", "faults", profile, status=1)
    assert "clear it first" in again
    c.daemon.stop()
