# SPDX-License-Identifier: MIT
"""Guests of rigs: programs that become nodes of two buses of one canwired, with a gateway between.

This needs no CAN in the kernel.
"""

import errno
import json
import subprocess
import threading

import pytest

from busclient import ERROR, LOOPBACK, OWN, RECV_OWN, Client
from simtool import CANWIRE, CANWIRED, canwire, kill_all, listens, sim, stop_canwired
from test_record import PATIENCE_S, wait_until

BUSES = {"body": 125000, "power": 500000}
BUS = """bus: {{ name: {name}, bitrate: {bitrate} }}
control: {name}.sock
guests: {{ count: 4, port: "unix:{name}.door"{more} }}
nodes:
  - {{ name: gw, queue: 64 }}
"""
RIG = """buses: [ body.yaml, power.yaml ]
gateways:
  - name: central
    between: [ "body:gw", "power:gw" ]
    rules:
      - { filter: "100:700", delay: 200us, direction: forward }
      - { filter: "200:700", id: "12345678", direction: backward }
"""


class Rig:
    def __init__(self, folder):
        self.folder, self.log = folder, folder / "log"
        for name in BUSES:
            self.write(name)
        (folder / "rig.yaml").write_text(RIG)
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "rig.yaml", "--journal", "j"],
                                            cwd=folder, stderr=log)
        for name in BUSES:
            wait_until(lambda name=name: listens(folder / f"{name}.sock"), name)

    def write(self, name, more=""):
        (self.folder / f"{name}.yaml").write_text(
            BUS.format(name=name, bitrate=BUSES[name], more=more))

    def guest(self, bus, name="", options=LOOPBACK | RECV_OWN):
        return Client(self.folder / f"{bus}.door", name, options)

    def nodes(self, bus):
        status = canwire("status", f"./{bus}.sock", "--json", cwd=self.folder).stdout
        return {node["name"]: node for node in json.loads(status)["nodes"]}

    def watch(self, bus):
        file = self.folder / f"{bus}.events"
        with file.open("w") as out:
            process = subprocess.Popen([CANWIRE, "watch", f"./{bus}.sock", "--json"],
                                       cwd=self.folder, stdout=out)

        def tells():
            self.guest(bus, "probe").close()
            return file.stat().st_size > 0

        wait_until(tells, "the begin of the events")
        return process, file

    def stop(self):
        for bus in BUSES:
            for node in self.nodes(bus).values():
                assert node["conserved"] is True, node
        stop_canwired(self.process, self.log)


@pytest.fixture(name="rig")
def fixture_rig(tmp_path):
    r = Rig(tmp_path)
    yield r
    kill_all([r.process])


def sent(guest, can_id, data=b"", number=1):
    """Sends a frame, and waits until the bus has sent it."""
    guest.send(can_id, data, number)
    while not (own := guest.receive()).flags & OWN:
        pass
    assert (own.can_id, own.number) == (can_id, number)


def received(guest, *ids):
    """Receives frames up to the last one of these, which come in this order."""
    wanted = list(ids)
    while wanted:
        if guest.receive().can_id == wanted[0]:
            wanted.pop(0)


def test_guests_of_two_buses_see_each_other_through_the_gateway(rig):
    door, seat = rig.guest("body", "door"), rig.guest("body", "seat")
    engine, same = rig.guest("power", "engine"), rig.guest("power", "door")
    assert rig.guest("body", "door").welcome.code == errno.EEXIST  # a name is of its own bus
    door.send(0x123, b"\1")
    received(seat, 0x123)
    for guest in engine, same:
        got = guest.receive()
        assert (got.can_id, got.data, got.flags) == (0x123, b"\1", 0)
    engine.send(0x234, b"\2")
    for guest in door, seat:
        received(guest, 0x12345678 | 0x80000000)
    door.send(0x7FF)  # the gateway does not pass it
    received(seat, 0x7FF)
    same.close()
    wait_until(lambda: rig.nodes("power")["guest-2"]["link"] == "down", "its end")
    assert rig.nodes("body")["door"]["link"] == "up"
    names = {bus: [n for n, node in rig.nodes(bus).items() if node["link"] == "up"]
             for bus in BUSES}
    assert names == {"body": ["door", "seat"], "power": ["engine"]}
    rig.stop()


def come_and_go(rig, bus, number, failures):
    try:
        for turn in range(5):
            guest = rig.guest(bus, f"{bus}-{number}")
            assert guest.welcome.type != ERROR, guest.welcome
            for k in range(5):  # these pass the gateway
                sent(guest, (0x100 if bus == "body" else 0x200) + number, bytes([turn, k]))
            guest.close()
            wait_until(lambda: f"{bus}-{number}" not in rig.nodes(bus), "its end")
    except Exception as error:  # pylint: disable=broad-except
        failures.append(error)


def of_bus(events, bus):
    return [{key: value for key, value in e.items() if key != "bus"}
            for e in events if e["bus"] == bus]


def test_the_journal_repeats_guests_of_both_buses_to_the_byte(rig, tmp_path):
    """Live, the buses tell their events to others; the journal has the same ones."""
    watches = {bus: rig.watch(bus) for bus in BUSES}
    listeners = {bus: rig.guest(bus, f"listener-{bus}", options=LOOPBACK) for bus in BUSES}
    failures = []
    threads = [threading.Thread(target=come_and_go, args=(rig, bus, number, failures))
               for bus in BUSES for number in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert not failures, failures
    (tmp_path / "rule.yaml").write_text(
        '{ name: x, when: { frame: "111" }, do: { flip: "data[0.2]", at: [listener-body] } }\n')
    canwire("inject", "./body.sock", "rule.yaml", cwd=tmp_path)
    last = rig.guest("body", "last")
    for k in range(5):
        sent(last, 0x111, bytes([k]))
    rig.write("power", ", queue: 9")  # a reload keeps the guests of both buses
    canwire("reload", "./power.sock", cwd=tmp_path)
    sent(last, 0x112)
    received(listeners["power"], 0x111, 0x112)
    rig.stop()
    for process, _ in watches.values():
        process.wait(PATIENCE_S)
    for bus in BUSES:
        (tmp_path / f"{bus}.yaml").unlink()
    once = sim("--journal", tmp_path / "j", "--events", "-").stdout
    assert sim("--journal", tmp_path / "j", "--step", "--events", "-").stdout == once
    whole = [json.loads(line) for line in once.splitlines()]
    for bus, (_, file) in watches.items():
        seen = [json.loads(line) for line in file.read_text().splitlines()
                if '"record"' not in line]
        again = of_bus(whole, bus)
        begin = again.index(seen[0])
        assert again[begin:begin + len(seen)] == seen
        links = [(e["node"], e["state"]) for e in seen if e["event"] == "link"]
        for number in range(2):
            assert links.count((f"{bus}-{number}", "up")) == 5
            assert links.count((f"{bus}-{number}", "down")) == 5
    assert sum(e["event"] == "tx" and e["node"] == "gw" for e in whole) >= 2 * 2 * 25
