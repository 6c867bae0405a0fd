# SPDX-License-Identifier: MIT
"""`canwire top` in a real terminal, that of tmux, and as plain text."""

import os
import signal
import subprocess

import pytest

from busrig import BusRig, rig_fixture
from simtool import CANWIRE, CANWIRED, canwire, listens, stop_canwired
from test_record import wait_until

BUS = """bus: {{ name: power, bitrate: 500000 }}
control: power.sock
nodes:
  - {{ name: engine, traffic: [ {{ send: 123#DEADBEEF, every: 5ms }} ] }}
  - {{ name: dash }}
faults:
  - {{ name: crc, when: {{ frame: "123", every: 20 }}, do: {{ flip: "crc[3]", at: [dash] }} }}
"""
BODY = """bus: { name: body, bitrate: 125000 }
control: body.sock
nodes: [ { name: door, traffic: [ { send: 7FF#, every: 10ms } ] }, { name: light } ]
"""
BROKEN = "{ name: broken, do: { stuck: recessive, on: engine.tx } }"


class Rig(BusRig):
    TEXT, CONTROL = BUS, "power.sock"


fixture_rig = rig_fixture(Rig)


class Terminal:
    """A terminal of that size, in which canwire top runs."""

    def __init__(self, folder, *words, size=(80, 24), term=None):
        self.tmux = "tmux", "-S", str(folder / "tmux")
        env = {**os.environ, "CANWIRE_RUN": str(folder)}
        self.call("-f", "/dev/null", "new-session", "-d", "-x", str(size[0]), "-y", str(size[1]),
                  "sh", env=env, cwd=folder)
        setting = "" if term is None else f"TERM={term} "
        command = " ".join([CANWIRE, "top", *words])
        self.type(f"clear; {setting}{command}; echo end $?")

    def call(self, *words, **more):
        return subprocess.run([*self.tmux, *words], capture_output=True, text=True, check=True,
                              timeout=60, **more).stdout

    def keys(self, *keys):
        self.call("send-keys", *keys)

    def type(self, text):
        self.call("send-keys", "-l", text)
        self.keys("Enter")

    def screen(self):
        return self.call("capture-pane", "-p")

    def wait(self, *texts, gone=()):
        def seen():
            text = self.screen()
            return text if all(t in text for t in texts) and not any(t in text for t in gone) \
                else None
        return wait_until(seen, f"{texts} without {gone}")

    def close(self):
        subprocess.run([*self.tmux, "kill-server"], capture_output=True, check=False, timeout=60)


@pytest.fixture(name="terminal")
def fixture_terminal(tmp_path):
    opened = []

    def start(*words, **more):
        opened.append(Terminal(tmp_path, *words, **more))
        return opened[-1]

    yield start
    for each in opened:
        each.close()


def test_keys_inject_restart_and_clear(rig, terminal):
    r = rig()
    t = terminal("power", "--interval", "200ms")
    screen = t.wait("BUS ", "engine", "error-active", "dash", "crc", "file", "q quit")
    assert max(map(len, screen.splitlines())) <= 80
    t.keys("i")
    t.wait("inject: _")
    t.type("{ name: x, do: { flop: 1 } }")
    t.wait("unknown key 'flop'")
    t.keys("i")
    t.type(BROKEN)
    t.wait("injected", "broken", "stuck", "bus-off", gone=["unknown"])
    t.keys("r")
    t.wait("select a node first")
    t.keys("Down", "c")
    t.wait("select a rule first")
    t.keys("Down", "Down", "Down", "c")
    t.wait("cleared broken")
    t.wait("bus-off", gone=["stuck"])
    t.keys("k", "k", "k", "r")
    t.wait("restarting engine", "error-active", gone=["bus-off"])
    t.keys("r")
    t.wait("node engine: it is not bus-off but error-active")
    t.keys("i")
    t.type(BROKEN)
    t.wait("broken")
    t.keys("C")
    t.wait("cleared what was injected", "crc", gone=["broken"])
    t.keys("?")
    t.wait("canwire top: keys", "stands still")
    t.keys("?", "q")
    t.wait("end 0", gone=["q quit"])
    r.stop()


def test_pause_stops_the_screen_and_not_the_bus(rig, terminal):
    r = rig()
    t = terminal("power", "--interval", "100ms")
    t.wait("engine", "crc")
    t.keys("p")
    before = t.wait("PAUSED")
    hits = r.run("faults", "./power.sock").stdout
    wait_until(lambda: r.run("faults", "./power.sock").stdout != hits, "further hits")
    assert t.screen() == before
    t.keys("Space")
    t.wait("engine", gone=["PAUSED"])
    wait_until(lambda: t.screen() != before, "numbers to change")
    r.stop()


def test_a_bus_that_goes_and_comes_back(rig, terminal):
    r = rig()
    t = terminal("power", "--interval", "200ms")
    t.wait("engine", "q quit")
    stop_canwired(r.process, r.log)
    t.wait("power           is gone, with these last numbers", "engine",
           "canwire: bus power: no such bus")
    with r.log.open("a") as log:
        r.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=r.folder, stderr=log)
    t.wait("q quit", "error-active", gone=["is gone", "no such bus"])
    r.stop()


def test_a_bus_that_hangs_does_not_hold_up_the_keys(rig, terminal):
    r = rig()
    t = terminal("power", "--interval", "200ms")
    t.wait("engine", "q quit")
    r.process.send_signal(signal.SIGSTOP)
    t.wait("is gone", "it does not answer")
    t.keys("q")
    t.wait("end 0")
    r.process.send_signal(signal.SIGCONT)
    r.stop()


def test_what_a_bus_that_hangs_was_asked_is_done_later(rig, terminal):
    """The message of all commands that do something; the others wait for half a minute."""
    r = rig()
    r.run("inject", "./power.sock", BROKEN)
    t = terminal("power", "--interval", "60s")
    t.wait("broken", "q quit")
    r.process.send_signal(signal.SIGSTOP)
    t.keys("C")
    t.wait("canwire: bus power: it does not answer; what was asked may yet be done")
    r.process.send_signal(signal.SIGCONT)
    wait_until(lambda: "broken" not in r.run("faults", "./power.sock").stdout, "its end")
    t.keys("q")
    t.wait("end 0")
    r.stop()


def test_several_buses_and_any_size(rig, terminal, tmp_path):
    r = rig()
    (tmp_path / "body.yaml").write_text(BODY)
    with (tmp_path / "body.log").open("w") as log:
        body = subprocess.Popen([CANWIRED, "-c", "body.yaml"], cwd=tmp_path, stderr=log)
    wait_until(lambda: listens(tmp_path / "body.sock"), "the other bus")
    t = terminal(size=(120, 30))  # without a name: all
    t.wait(">body", " power", "door", gone=["engine"])
    t.keys("Tab")
    t.wait(" body", ">power", "engine", gone=["door"])
    t.keys("1")
    t.wait(">body", "door")
    t.call("resize-window", "-x", "60", "-y", "10")
    t.wait(">body", "NODE", "door")
    assert max(map(len, t.screen().splitlines())) <= 60
    t.call("resize-window", "-x", "30", "-y", "10")
    t.wait("needs 40 x 8", gone=["body"])
    t.call("resize-window", "-x", "80", "-y", "8")
    t.keys("Down", "Down")
    t.wait(">body", "light")
    t.keys("q")
    t.wait("end 0")
    shown = canwire("top", "./body.sock", "./power.sock", "--once", "--interval", "100ms",
                    cwd=tmp_path).stdout
    assert [shown.count(word) for word in ("BUS", "NODE", "RULE", "door", "engine")] == [
        1, 2, 1, 1, 1]
    assert max(map(len, shown.splitlines())) <= 80
    stop_canwired(body, tmp_path / "body.log")
    r.stop()


@pytest.mark.parametrize("term, why", [
    ("dumb", "the terminal of TERM has no cursor: use --once"),
    ("", "TERM is not set: use --once"),
    ("unheard-of", "the terminal of TERM is not known here: use --once")])
def test_a_terminal_that_cannot_is_refused(rig, terminal, term, why):
    r = rig()
    t = terminal("power", term=term)
    t.wait(f"canwire top: {why}", "end 1")
    r.stop()


def test_what_is_no_terminal_is_refused(rig, tmp_path):
    r = rig()
    assert r.run("top", "./power.sock", status=1).stderr == (
        "canwire top: this is no terminal: use --once\n")
    (tmp_path / "empty").mkdir()
    nothing = subprocess.run([CANWIRE, "top"], env={**os.environ, "CANWIRE_RUN": "empty"},
                             cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert (nothing.returncode, nothing.stderr) == (1, "canwire top: no bus runs in empty\n")
    r.stop()
