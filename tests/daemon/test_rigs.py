# SPDX-License-Identifier: MIT
"""Rigs in real time: several buses in one canwired, with gateways between them.

ECUs are programs at unix: ports, and nodes with traffic of their own, so this needs no CAN in the
kernel.
"""

import json
import signal
import socket
import subprocess

import pytest

from simtool import (CANWIRE, CANWIRED, canwire, journal_lines, journal_text, kill_all, listens,
                     sim, stop_canwired)
from test_push_back import Ecu
from test_record import PATIENCE_S, wait_until

BODY = """bus: {{ name: body, bitrate: 125000{data} }}
control: body.sock
pacing: {pacing}
nodes:
  - {{ name: airbag, {airbag} }}
  - {{ name: gw }}
"""
SAFETY = """bus: {{ name: safety, bitrate: 500000{data} }}
control: safety.sock
pacing: {pacing}
nodes:
  - {{ name: lamp, port: "unix:lamp.port" }}
  - {{ name: engine, {engine} }}
  - {{ name: gw, queue: {queue} }}
"""
RIG = """buses: [ body.yaml, safety.yaml ]
gateways:
  - name: central
    between: [ "body:gw", "safety:gw" ]
    rules: [ {rules} ]
"""
CRASH = '{ filter: "050", id: "020", delay: 100us, direction: forward }'
QUIET = "ppm: 0"


class Rig:
    """A canwired in a folder with two buses."""

    def __init__(self, folder, *words, rules=CRASH, airbag=QUIET, engine=QUIET, pacing="precise",
                 other_pacing="", queue=16, data="",
                 environment=None):
        self.folder, self.log = folder, folder / "log"
        (folder / "body.yaml").write_text(BODY.format(airbag=airbag, pacing=pacing, data=data))
        (folder / "safety.yaml").write_text(
            SAFETY.format(engine=engine, pacing=other_pacing or pacing, queue=queue, data=data))
        (folder / "rig.yaml").write_text(RIG.format(rules=rules))
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "rig.yaml", *words], cwd=folder,
                                            stderr=log, env=environment)

    def wait_ready(self):
        for bus in "body", "safety":
            wait_until(lambda: listens(self.folder / f"{bus}.sock"), bus)

    def run(self, *words, status=0):
        return canwire(*words, status=status, cwd=self.folder)

    def status(self, bus):
        return json.loads(self.run("status", f"./{bus}.sock", "--json").stdout)

    def gateway(self, bus="body"):
        [only] = self.status(bus)["gateways"]
        return only

    def watch(self, bus, *kinds):
        file = self.folder / f"{bus}.events"
        with file.open("w") as out:
            process = subprocess.Popen([CANWIRE, "watch", f"./{bus}.sock", "--json", *kinds],
                                       cwd=self.folder, stdout=out)
        return process, file

    def stop(self):
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="rig")
def fixture_rig(tmp_path):
    started = []

    def start(*words, **more):
        started.append(Rig(tmp_path, *words, **more))
        started[-1].wait_ready()
        return started[-1]

    yield start
    kill_all(each.process for each in started)


def test_the_name_of_a_rig_is_told_from_that_of_a_bus(rig, tmp_path, monkeypatch):
    monkeypatch.setenv("CANWIRE_RUN", str(tmp_path))
    r = rig()
    for name in "rig", "rig.yaml", "./rig.yaml":
        assert r.run("status", name, status=1).stderr == (
            f"canwire: bus {name}: that is a configuration; its buses in {tmp_path}: body, "
            "safety\n")
    assert r.run("status", "body").stdout.startswith("body: ")
    r.stop()


def read_events(file):
    return [json.loads(line) for line in file.read_text().splitlines()]


def of_bus(events, bus):
    return [{key: value for key, value in e.items() if key != "bus"}
            for e in events if e["bus"] == bus]


def every(frame, time):
    return f"traffic: [ {{ send: {frame}, every: {time} }} ]"


# ---- Gateways ------------------------------------------------------------------------------------

@pytest.mark.parametrize("pacings", [("precise", "precise"), ("tick", "tick"), ("precise", "tick"),
                                     ("tick", "precise")], ids="-".join)
def test_all_times_are_those_of_the_simulation(rig, pacings, tmp_path):
    """Two rates, a delay, both directions: each event of both buses has the time of canwire sim."""
    rules = CRASH + ', { filter: "123", id: "12345678", direction: backward }'
    r = rig(rules=rules, airbag=every("050#01", "7ms"), engine=every("123#DEADBEEF", "3ms"),
            pacing=pacings[0], other_pacing=pacings[1])
    watches = [r.watch(bus, "tx", "rx", "drop", "skip") for bus in ("body", "safety")]
    wait_until(lambda: all(len(file.read_text().splitlines()) > 400 for _, file in watches),
               "events")
    r.stop()
    for process, _ in watches:
        process.wait(PATIENCE_S)
    end = max(read_events(file)[-1]["t"] for _, file in watches)
    out = sim(tmp_path / "rig.yaml", "--until", f"{end + 1:.9f}s", "--events", "-").stdout
    expected = [json.loads(line) for line in out.splitlines()]
    for bus, (_, file) in zip(("body", "safety"), watches):
        seen, whole = read_events(file), of_bus(expected, bus)
        begin = whole.index(seen[0])
        assert "skip" not in {e["event"] for e in seen}, "this machine was too slow for real time"
        assert whole[begin:begin + len(seen)] == seen


def test_an_airbag_reaches_the_safety_bus(rig, tmp_path):
    """A program at a port of the one bus, a program at a port of the other one."""
    r = rig("--journal", "j", airbag='port: "unix:airbag.port"')
    airbag, lamp = Ecu(tmp_path / "airbag.port"), Ecu(tmp_path / "lamp.port")
    airbag.send([(0x050, 1), (0x051, 2), (0x050, 3)])
    wait_until(lambda: len(lamp.frames) == 2, "two frames")
    assert lamp.frames == [(0x020, 1), (0x020, 3)]
    assert r.gateway()["forward"] == {"rules": [{"rule": 0, "forwarded": 2, "lost": 0}],
                                      "dropped": 0}
    assert r.gateway("safety") == r.gateway()
    assert "gateway central: body:gw to safety:gw: forwarded 2 lost 0" in r.run(
        "status", "./body.sock").stdout
    r.stop()
    received = [e for e in read_run(tmp_path) if e.get("frame", "").startswith("050#")
                and e["event"] == "rx" and e["node"] == "gw"]
    handed = [line for line in journal_lines(tmp_path / "j") if line.get("send") == "gw"]
    for event, line in zip(received, handed, strict=True):
        tick = round((event["t"] + 100e-6) * 80e6)
        assert line["at"] <= tick, "it comes to a bus that is beyond its time"
        assert line["at"] + line.get("in", 0) == tick


def read_run(folder):
    return [json.loads(line) for line in
            sim("--journal", folder / "j", "--events", "-").stdout.splitlines()]


def test_what_finds_no_room_is_counted_and_told(rig):
    """A full queue of a rule, and the full queue of the node on the slow bus."""
    lost = rig(rules='{ filter: "123", delay: 20ms, queue: 4, direction: backward }',
               engine=every("123#11", "1ms"))
    wait_until(lambda: lost.gateway()["backward"]["rules"][0]["lost"] > 20, "losses of the rule")
    log = lost.stop()
    assert "gateway central: " in log and "lost, the queue of their rule is full" in log
    far = rig(rules='{ direction: backward }', engine=every("123#1122334455667788", "300us"))
    wait_until(lambda: far.gateway()["backward"]["dropped"] > 20, "losses of the far queue")
    status = far.status("body")
    [gw] = [node for node in status["nodes"] if node["name"] == "gw"]
    [gateway] = status["gateways"]
    assert gw["dropped"]["queue-full"] == gateway["backward"]["dropped"] > 20 and gw["conserved"]
    assert "body: node gw: " in far.stop()


# ---- Commands ------------------------------------------------------------------------------------

def test_each_bus_has_its_own_commands(rig, tmp_path):
    r = rig("--journal", "j", airbag=every("050#01", "2ms"), engine=every("123#", "1ms"))
    (tmp_path / "faults.yaml").write_text(
        '{ name: x, when: { frame: "050" }, do: { drop: rx, at: [gw] } }\n')
    r.run("inject", "./body.sock", "faults.yaml")
    assert [f["name"] for f in json.loads(
        r.run("faults", "./body.sock", "--json").stdout)] == ["x"]
    assert json.loads(r.run("faults", "./safety.sock", "--json").stdout) == []
    before = r.gateway()["forward"]["rules"][0]["forwarded"]
    frames = r.status("body")["bus"]["frames"]
    wait_until(lambda: r.status("body")["bus"]["frames"] > frames + 50, "frames")
    assert r.gateway()["forward"]["rules"][0]["forwarded"] <= before + 1
    r.run("clear", "./body.sock", "x")
    wait_until(lambda: r.gateway()["forward"]["rules"][0]["forwarded"] > before + 10, "the gateway")
    r.run("set", "./safety.sock", "engine", "queue=7")
    assert r.status("safety")["nodes"][1]["settings"]["queue"] == 7
    r.run("restart", "./safety.sock", "engine", status=1)
    for bus in "body", "safety":
        assert r.status(bus)["bus"]["name"] == bus and r.status(bus)["bus"]["skips"] == 0
        assert all(node["conserved"] for node in r.status(bus)["nodes"])
    assert r.status("body")["journal"]["state"] == "writing"
    r.stop()


# ---- Reload --------------------------------------------------------------------------------------

def edit(folder, file, old, new):
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))


def test_a_reload_keeps_gateways_by_the_names_of_their_nodes(rig, tmp_path):
    r = rig(airbag=every("050#01", "2ms"))
    edit(tmp_path, "safety.yaml", "nodes:\n", "nodes:\n  - { name: first }\n")
    r.run("reload", "./safety.sock")
    assert [n["name"] for n in r.status("safety")["nodes"]] == ["first", "lamp", "engine", "gw"]
    before = r.gateway()["forward"]["rules"][0]["forwarded"]
    lamp = Ecu(tmp_path / "lamp.port")
    wait_until(lambda: r.gateway()["forward"]["rules"][0]["forwarded"] > before + 10, "the gateway")
    wait_until(lambda: len(lamp.frames) > 5, "frames")
    assert {frame for frame, _ in lamp.frames} == {0x020}
    r.process.send_signal(signal.SIGHUP)
    wait_until(lambda: r.log.read_text().count("configuration reloaded") == 3, "both reloads")
    assert "body: body: configuration reloaded, 2 nodes" in r.log.read_text()
    assert "rig.yaml: 2 buses, 1 gateway\n" in r.log.read_text()
    r.run("reload", "--config", "rig.yaml", "--pid", r.process.pid)
    assert r.status("body")["rig"] == "rig.yaml"
    (tmp_path / "other.yaml").write_text((tmp_path / "rig.yaml").read_text())
    told = r.run("reload", "--config", "other.yaml", "--pid", r.process.pid, status=1).stderr
    assert told.count("it runs with rig.yaml, not with other.yaml\n") == 2
    r.stop()


@pytest.mark.parametrize("file, old, new, message", [
    ("safety.yaml", "name: gw", "name: gone",
     "safety.yaml:1:1: there is no node gw any more: gateway central of rig.yaml has it"),
    ("safety.yaml", "{ name: gw", '{ name: gw, port: "unix:gw.port"',
     "safety.yaml:7:23: node gw: gateway central of rig.yaml has it: it can have no port"),
    ("rig.yaml", "delay: 100us", "delay: 200us",
     "rig.yaml:1:1: a rig cannot change while it runs: restart canwired"),
    ("safety.yaml", "lamp.port", "body.sock",
     "has another use"),
])
def test_a_reload_that_cannot_be_is_refused(rig, tmp_path, file, old, new, message):
    r = rig(airbag=every("050#01", "2ms"))
    edit(tmp_path, file, old, new)
    error = r.run("reload", "./safety.sock", status=1).stderr
    if message == "has another use":
        assert "body.sock" in error and "safety.yaml" in error
    else:
        assert message in error
    before = r.gateway()["forward"]["rules"][0]["forwarded"]
    wait_until(lambda: r.gateway()["forward"]["rules"][0]["forwarded"] > before + 5, "the gateway")
    edit(tmp_path, file, new, old)
    r.run("reload", "./safety.sock")
    r.stop()


# ---- Journal -------------------------------------------------------------------------------------

def test_a_journal_repeats_both_buses(rig, tmp_path):
    rules = CRASH + ', { filter: "123", id: "12345678", delay: 1ms, direction: backward }'
    r = rig("--journal", "j", rules=rules, airbag='port: "unix:airbag.port"',
            engine=every("123#DEADBEEF", "1ms"))
    watches = [r.watch(bus) for bus in ("body", "safety")]
    wait_until(lambda: all(file.stat().st_size > 0 for _, file in watches), "events")
    airbag = Ecu(tmp_path / "airbag.port")
    airbag.send([(0x050, number) for number in range(20)])
    (tmp_path / "faults.yaml").write_text(
        '{ name: x, when: { frame: "050", every: 3 }, do: { flip: "data[0.2]" } }\n')
    r.run("inject", "./body.sock", "faults.yaml")
    airbag.send([(0x050, number) for number in range(20)])
    # another rule takes the place of one whose hits may still wait to be written
    r.run("clear", "./body.sock", "x")
    (tmp_path / "other.yaml").write_text(
        "{ name: y, when: { manual: yes }, do: { bus-off: airbag } }")
    r.run("inject", "./body.sock", "other.yaml")
    edit(tmp_path, "safety.yaml", "nodes:\n", "nodes:\n  - { name: first }\n")
    r.run("reload", "./safety.sock")
    airbag.send([(0x050, number) for number in range(20)])
    wait_until(lambda: r.gateway()["forward"]["rules"][0]["forwarded"] == 60, "all frames")
    r.stop()
    for process, _ in watches:
        process.wait(PATIENCE_S)
    (tmp_path / "body.yaml").unlink()
    whole = read_run(tmp_path)
    for bus, (_, file) in zip(("body", "safety"), watches):
        seen, again = file.read_text().splitlines(), of_bus(whole, bus)
        seen = [json.loads(line) for line in seen if '"record"' not in line]
        begin = again.index(seen[0])
        assert again[begin:begin + len(seen)] == seen and len(seen) > 100
    times = [e["t"] for e in whole]
    assert times == sorted(times)
    once = sim("--journal", tmp_path / "j", "--events", "-", "--stats", tmp_path / "stats").stdout
    assert sim("--journal", tmp_path / "j", "--step", "--events", "-").stdout == once
    for event in "fault", "safety:tx", "airbag:error":
        kind = event.split(":")[-1]
        end = next(e["t"] for e in whole if e["event"] == kind and
                   (kind != "tx" or e["bus"] == "safety") and
                   (kind != "error" or e["node"] == "airbag"))
        got = sim("--journal", tmp_path / "j", "--until-event", event, "--events", "-").stdout
        assert [json.loads(line) for line in got.splitlines()] == [
            e for e in whole if e["t"] <= end]
    assert [b["bus"]["name"] for b in json.loads((tmp_path / "stats").read_text())["buses"]] == [
        "body", "safety"]
    assert "ok (bus body, safety" in canwire("check", "--journal", tmp_path / "j").stdout


def test_many_events_of_a_journal_are_in_order_of_time(rig, tmp_path):
    """Its lines are of one bus after the other, and more events lie between two of them than are
    kept at once."""
    r = rig("--journal", "j", airbag=every("051#01", "1ms"), engine=every("123#DEADBEEF", "500us"))
    wait_until(lambda: r.status("body")["bus"]["frames"] > 1500, "frames")
    r.stop()
    times = [e["t"] for e in read_run(tmp_path)]
    assert times == sorted(times) and len(times) > 4000


def test_a_journal_repeats_what_came_in_data_phases(rig, tmp_path):
    """Bits are shorter there. A replay that stops before the last ones shows other errors."""
    data = "A5" * 32
    r = rig("--journal", "j", data=", dbitrate: 1000000", airbag=every(f"050##1{data}", "2ms"),
            engine=every(f"123##1{data}", "700us"))
    watches = [r.watch(bus, "error", "fault") for bus in ("body", "safety")]
    for number in range(20):
        for bus in "body", "safety":
            r.run("inject", f"./{bus}.sock", f"{{ name: e{number}, do: {{ error-flag: gw }} }}")
    wait_until(lambda: all(file.read_text().count("fault") > 10 for _, file in watches), "faults")
    r.stop()
    for process, _ in watches:
        process.wait(PATIENCE_S)
    whole = read_run(tmp_path)
    for bus, (_, file) in zip(("body", "safety"), watches):
        seen = [event for event in read_events(file) if "record" not in event]
        again = [e for e in of_bus(whole, bus) if e["event"] in ("error", "fault")]
        assert again[-len(seen):] == seen
    assert "ok (bus body, safety" in canwire("check", "--journal", tmp_path / "j").stdout


def test_a_damaged_journal_of_a_rig_is_told(rig, tmp_path):
    r = rig("--journal", "j", airbag=every("050#01", "2ms"))
    wait_until(lambda: r.gateway()["forward"]["rules"][0]["forwarded"] > 20, "frames")
    r.stop()
    lines = journal_text(tmp_path / "j").splitlines(keepends=True)
    (tmp_path / "cut").write_text("".join(lines[:-2]))
    assert "cut off" in canwire("check", "--journal", tmp_path / "cut", status=1).stderr
    assert "cut off" in sim("--journal", tmp_path / "cut").stderr
    (tmp_path / "one").write_text("".join(lines[:-1]))
    assert "cut off" in canwire("check", "--journal", tmp_path / "one", status=1).stderr
    (tmp_path / "more").write_text("".join([*lines, lines[-1]]))
    assert "behind the end" in canwire("check", "--journal", tmp_path / "more", status=1).stderr


# ---- The service manager -------------------------------------------------------------------------

def test_the_service_manager_is_told_of_all_buses(rig, tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "300000")
        r = rig(airbag=every("050#01", "2ms"))
        got = [manager.recv(2000).decode()]  # whole: a datagram
        while got.count("WATCHDOG=1") < 3:
            got.append(manager.recv(2000).decode())
        assert got.count("READY=1") == 1
        assert any(line.startswith("STATUS=body: load ") and "; safety: load " in line
                   for line in got)
        got.clear()
        r.process.send_signal(signal.SIGHUP)
        while "READY=1" not in got:
            got.append(manager.recv(2000).decode())
        assert any(line.startswith("RELOADING=1") for line in got)
        wait_until(lambda: r.log.read_text().count("configuration reloaded") == 2, "both reloads")
        r.stop()
