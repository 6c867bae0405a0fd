# SPDX-License-Identifier: MIT
"""Interfaces that come and go while the bus runs: the node leaves, the others go on, it comes
back."""

import errno
import json
import re
import signal
import socket
import subprocess

import pytest

from canbits import Frame
from conftest import CanSocket, assert_balance, ip, wait_until
from test_faults import Shell

CONTROL = "control: links.sock\n"
TWO = """
bus: { name: links, bitrate: 500000 }
nodes:
  - { name: engine, port: vcan0 }
  - { name: gearbox, port: vcan1 }
""" + CONTROL
THREE = TWO.replace(CONTROL, "  - { name: dash, port: vcan2 }\n" + CONTROL)


def frames(identifier, count):
    return [Frame(identifier, 2, i.to_bytes(2, "big")) for i in range(count)]


class Bus:
    """A daemon, ECUs at its interfaces, and the watched link events."""

    def __init__(self, daemon):
        self.daemon = daemon
        self.shell = Shell(daemon)
        self.ecus = {}
        self.watcher = socket.socket(socket.AF_UNIX)
        self.watcher.connect(str(daemon.config.parent / "links.sock"))
        self.watcher.sendall(b'{"request":"watch","events":["link"]}\n')
        self.lines = self.watcher.makefile()
        assert json.loads(self.lines.readline())["ok"]
        self.watcher.setblocking(False)
        self.told = ""

    def ecu(self, interface, anew=False):
        """Returns a program at an interface, from its first use on: it does not get earlier frames.
        anew: it starts again, as its old socket is useless."""
        if anew and interface in self.ecus:
            self.ecus.pop(interface).close()
        if interface not in self.ecus:
            self.ecus[interface] = CanSocket(interface)
        return self.ecus[interface]

    def nodes(self):
        return self.shell.nodes("links")

    def link(self, node):
        return self.nodes()[node]["link"]

    def wait_link(self, node, state):
        wait_until(lambda: self.link(node) == state, f"{node} {state}")

    def links_told(self):
        """Returns the link events so far, as (node, state)."""
        try:
            while more := self.watcher.recv(65536):
                self.told += more.decode()
        except BlockingIOError:
            pass
        events = [json.loads(line) for line in self.told.splitlines()]
        return [(e["node"], e["state"]) for e in events if e.get("event") == "link"]

    def exchange(self, sender, receiver, identifier, count=5):
        """Sends frames from one interface to another; all of them arrive."""
        wanted = frames(identifier, count)
        self.ecu(receiver).drain()
        self.ecu(sender).send(*wanted)
        got = []
        wait_until(lambda: got.extend(self.ecu(receiver).drain()) or len(got) >= count, "frames")
        assert got == wanted

    def stop(self):
        for node in self.nodes().values():
            assert_balance(node)
        self.close()
        return self.daemon.stop()

    def close(self):
        self.lines.close()
        self.watcher.close()
        for ecu in self.ecus.values():
            ecu.close()
        self.ecus = {}


@pytest.fixture
def bus(canwired):
    started = []

    def start(text):
        started.append(Bus(canwired(text)))
        return started[-1]

    yield start
    for b in started:
        b.close()


# ---- One node leaves and comes back --------------------------------------------------------------

# Ways in which the interface of the dash goes, its link then, and ways back.
WAYS = {
    "down": (["link set vcan2 down"], "down", ["link set vcan2 up"]),
    "deleted": (["link del vcan2"], "missing",
                ["link add vcan2 type vcan", "link set vcan2 up"]),
    "deleted and made anew in one go": (
        ["link del vcan2", "link add vcan2 type vcan"], "down", ["link set vcan2 up"]),
    "renamed": (["link set vcan2 down", "link set vcan2 name away", "link set away up"], "missing",
                ["link set away down", "link set away name vcan2", "link set vcan2 up"]),
    "another kind of the same name": (
        ["link del vcan2"], "missing",
        ["link add vcan2 type vxcan peer name peer2", "link set vcan2 up", "link set peer2 up"]),
    "MTU": (["link set vcan2 down", "link set vcan2 mtu 72"], "down", ["link set vcan2 up"]),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_node_leaves_the_others_go_on_and_it_comes_back(way, vcan, bus):
    away, state, back = WAYS[way]
    vcan(3)
    b = bus(THREE)
    b.exchange("vcan2", "vcan0", 0x100)
    before = b.nodes()["dash"]
    ip(*away)
    b.wait_link("dash", state)
    text = b.shell.run("status", "links")
    assert f"3: dash@vcan2: qlen 1024 order priority link {state.upper()}\n" \
           "    can state STOPPED " in text
    assert "2: gearbox@vcan1: qlen 1024 order priority\n    can state ERROR-ACTIVE " in text
    b.exchange("vcan0", "vcan1", 0x200)
    b.exchange("vcan1", "vcan0", 0x201)
    assert b.nodes()["dash"]["rx_frames"] == before["rx_frames"]
    ip(*back)
    b.wait_link("dash", "up")
    if way == "another kind of the same name":
        b.ecus["vcan2"] = CanSocket("peer2")
    else:
        b.ecu("vcan2", anew=True)
    b.exchange("vcan0", "vcan2", 0x300)
    b.exchange("vcan2", "vcan1", 0x301)
    told = b.links_told()
    assert told[0] == ("dash", "down") and told[-1] == ("dash", "up")
    assert told == [("dash", "down"), ("dash", "up")] * (len(told) // 2)
    dash = b.nodes()["dash"]
    assert dash["interface"]["read"] == dash["tx_frames"] == 10  # of all its interfaces
    assert dash["tec"] == dash["rec"] == 0
    log = b.stop()
    assert re.search(rf"node dash: vcan2 is {state}.*\n(.*\n)*.*node dash: vcan2 is up", log)


def test_a_peer_that_goes_down_takes_the_vxcan_with_it(vcan, bus):
    vcan(1)
    ip("link add vcan1 type vxcan peer name peer1", "link set vcan1 up", "link set peer1 up")
    try:
        b = bus(TWO)
        b.wait_link("gearbox", "up")
        b.ecus["vcan1"] = CanSocket("peer1")
        b.exchange("vcan0", "vcan1", 0x100)
        ip("link set peer1 down")
        b.wait_link("gearbox", "down")
        ip("link set peer1 up")
        b.wait_link("gearbox", "up")
        b.ecus.pop("vcan1").close()
        b.ecus["vcan1"] = CanSocket("peer1")
        b.exchange("vcan1", "vcan0", 0x101)
        b.stop()
    finally:
        ip("link del vcan1")


def test_what_it_had_to_send_is_dropped_and_its_counters_are_reset(vcan, bus):
    vcan(3)
    b = bus(THREE)
    b.shell.run("inject", "links",
                "{ name: alone, when: { time: 0s }, "
                "do: { partition: [[dash], [engine, gearbox]] } }")
    b.ecu("vcan2").send(*frames(0x100, 5))
    wait_until(lambda: (n := b.nodes()["dash"])["tec"] == 128 and n["queue"] == 5, "TEC 128")
    ip("link set vcan2 down")
    b.wait_link("dash", "down")
    dash = b.nodes()["dash"]
    assert (dash["queue"], dash["tx_frames"], dash["dropped"]["link-down"]) == (0, 0, 5)
    assert (dash["tec"], dash["state"]) == (0, "error-active")
    b.shell.run("clear", "links", "alone")
    ip("link set vcan2 up")
    b.wait_link("dash", "up")
    b.ecu("vcan2", anew=True)
    b.exchange("vcan2", "vcan0", 0x101)
    assert "5 dropped, link down" in b.stop()


def test_down_and_up_ends_a_bus_off(vcan, bus):
    vcan(2)
    b = bus(TWO)
    b.shell.run("inject", "links", "{ name: kill, when: { time: 0s }, do: { bus-off: engine } }")
    wait_until(lambda: b.nodes()["engine"]["state"] == "bus-off", "bus-off")
    ip("link set vcan0 down", "link set vcan0 up")
    wait_until(lambda: b.nodes()["engine"]["state"] == "error-active", "error-active")
    b.exchange("vcan0", "vcan1", 0x100)
    assert b.nodes()["engine"]["restarts"] == 0
    b.stop()


def test_a_sender_waits_for_its_only_receiver(vcan, bus):
    vcan(2)
    b = bus(TWO)
    ip("link set vcan1 down")
    b.wait_link("gearbox", "down")
    wanted = frames(0x100, 3)
    b.ecu("vcan0").send(*wanted)
    wait_until(lambda: b.nodes()["engine"]["tec"] == 128, "nobody to acknowledge")
    with pytest.raises(OSError, match="Network is down"):
        b.ecu("vcan1").drain()
    ip("link set vcan1 up")
    assert b.ecu("vcan1").receive(3) == wanted
    assert b.nodes()["engine"]["tx_frames"] == 3
    b.stop()


def test_names_that_are_exchanged(vcan, bus):
    """Each node goes with the name, as it would at the next start."""
    vcan(3)
    b = bus(THREE)
    b.exchange("vcan0", "vcan2", 0x100)
    down = [f"link set vcan{i} down" for i in range(2)]
    ip(*down, "link set vcan0 name x", "link set vcan1 name vcan0", "link set x name vcan1",
       *(d.replace("down", "up") for d in down))
    for node in ("engine", "gearbox"):
        b.wait_link(node, "up")
    for i in range(2):
        b.ecu(f"vcan{i}", anew=True)
    b.exchange("vcan0", "vcan2", 0x101)
    b.exchange("vcan1", "vcan2", 0x102)
    assert b.nodes()["engine"]["tx_frames"] == 10
    assert b.nodes()["gearbox"]["tx_frames"] == 5
    b.stop()


# ---- Under load ----------------------------------------------------------------------------------

MANY = 4000
TOGGLES = 10


def write_until_refused(ecu, wanted):
    """Returns the number of frames that an ECU could write until its interface was gone."""
    for i, frame in enumerate(wanted):
        try:
            ecu.send(frame)
        except OSError as error:
            assert error.errno in (errno.ENETDOWN, errno.ENXIO, errno.ENODEV)
            return i
    return len(wanted)


@pytest.mark.parametrize("way", ["down", "deleted"])
def test_nothing_is_lost_uncounted_under_load(way, vcan, bus):
    """A node leaves and comes back again and again; the two others lose nothing by it."""
    away, state, back = WAYS[way]
    vcan(3)
    b = bus(THREE.replace("port: vcan0", "port: vcan0, queue: 4096"))
    receiver = b.ecu("vcan1")  # before the first frame: it would miss what comes until it is there
    wanted = frames(0x100, MANY)
    received, sent, toggles, written = [], 0, 0, 0
    while len(received) < MANY:
        # on a slow machine all of these come back at once: fewer than between two toggles
        upto = min(MANY, len(received) + MANY // TOGGLES // 2)
        b.ecu("vcan0").send(*wanted[sent:upto])
        sent = max(sent, upto)
        came = receiver.receive(1)
        assert came, f"{len(received)} of {sent} frames came"
        # those of the dash are counted below: how many of them reach the bus is open
        received += [f for f in came if f.identifier == 0x100]
        if toggles < TOGGLES and len(received) >= (toggles + 1) * MANY // (TOGGLES + 2):
            toggles += 1
            written += write_until_refused(b.ecu("vcan2", anew=True), frames(0x700, 8))
            ip(*away)
            b.wait_link("dash", state)
            ip(*back)
            b.wait_link("dash", "up")
    assert toggles == TOGGLES
    assert received == wanted
    wait_until(lambda: b.nodes()["dash"]["queue"] + b.nodes()["dash"]["inbox"] == 0,
               "the last frames of the dash")
    engine, gearbox, dash = (b.nodes()[n] for n in ("engine", "gearbox", "dash"))
    assert engine["tx_frames"] == MANY and sum(engine["dropped"].values()) == 0
    # receivers have a frame one bit before its sender, which may leave then
    assert 0 <= gearbox["rx_frames"] - MANY - dash["tx_frames"] <= TOGGLES
    assert dash["interface"]["read"] == written == (
        dash["tx_frames"] + sum(dash["dropped"].values()))
    assert b.links_told() == [("dash", "down"), ("dash", "up")] * TOGGLES
    b.stop()


@pytest.mark.deep
def test_messages_of_the_kernel_that_are_lost(vcan, bus):
    """More of them than a socket holds, while the daemon is stopped."""
    vcan(3)
    b = bus(THREE)
    b.exchange("vcan0", "vcan2", 0x100)
    b.daemon.process.send_signal(signal.SIGSTOP)
    made = [f"link add d{i} type vcan" for i in range(300)]
    ip(*made, *(line.replace("add", "del").replace(" type vcan", "") for line in made))
    ip("link del vcan2", "link add vcan2 type vcan", "link set vcan2 up", "link set vcan1 down")
    b.daemon.process.send_signal(signal.SIGCONT)
    b.wait_link("gearbox", "down")
    b.wait_link("dash", "up")
    b.ecu("vcan2", anew=True)
    b.exchange("vcan0", "vcan2", 0x101)
    assert "messages about interfaces were lost" in b.stop()


# ---- Start and reload ----------------------------------------------------------------------------


def test_interfaces_that_are_missing_at_the_start_are_waited_for(vcan, bus):
    vcan(2)
    ip("link del vcan1")
    b = bus(THREE + "missing-port: wait\n")
    b.wait_link("gearbox", "missing")
    b.wait_link("dash", "missing")
    ip("link add vcan1 type vcan")
    b.wait_link("gearbox", "down")
    ip("link set vcan1 up")
    b.wait_link("gearbox", "up")
    b.exchange("vcan0", "vcan1", 0x100)
    assert b.link("dash") == "missing"
    assert "node dash: vcan2 is missing, waiting for it" in b.stop()


def test_a_bus_waits_for_the_ports_of_nodes_that_say_so(vcan, bus, launch):
    vcan(2)
    ip("link del vcan1")
    text = THREE.replace("port: vcan2", "port: vcan2, missing-port: wait")
    daemon = launch(text)
    assert daemon.wait() == 1
    assert "node gearbox: port vcan1: No such device" in daemon.stderr()
    ip("link add vcan1 type vcan", "link set vcan1 up")
    b = bus(text)
    b.wait_link("dash", "missing")
    b.exchange("vcan0", "vcan1", 0x100)
    daemon = launch(text.replace("missing-port: wait", "missing-port: fail") +
                    "missing-port: wait\n")
    assert daemon.wait() == 1
    assert "node dash: port vcan2: No such device" in daemon.stderr()
    b.daemon.config.write_text(THREE)
    assert "node dash: port vcan2: No such device" in b.shell.run("reload", "links", status=1)
    b.stop()


def test_an_interface_of_another_kind_is_not_waited_for(vcan, launch):
    vcan(1)
    daemon = launch(TWO.replace("vcan1", "lo") + "missing-port: wait\n")
    assert daemon.wait() == 1
    assert "node gearbox: port lo: No such device for CAN: it is another kind" in daemon.stderr()


def test_a_port_is_named_as_its_interface_and_not_by_an_altname(vcan, bus, launch):
    """It is refused at a start and at a reload, also where missing interfaces are waited for."""
    vcan(3)
    ip("link property add dev vcan1 altname gear-can",
       "link property add dev vcan2 altname dash-can")
    refusal = "port {}: only another name (altname) of {}: use that"
    for more in "", "missing-port: wait\n":
        daemon = launch(TWO.replace("vcan1", "gear-can") + more)
        assert daemon.wait() == 1
        assert "node gearbox: " + refusal.format("gear-can", "vcan1") in daemon.stderr()
    b = bus(TWO)
    for own, other in ("vcan2", "dash-can"), ("vcan1", "gear-can"):
        b.daemon.config.write_text(THREE.replace(own, other))
        assert refusal.format(other, own) in b.shell.run("reload", "links", status=1)
    b.exchange("vcan0", "vcan1", 0x100)
    reload(b, THREE)
    b.exchange("vcan0", "vcan2", 0x101)
    assert set(node["link"] for node in b.nodes().values()) == {"up"}
    b.stop()


def test_an_interface_that_is_down_at_the_start(vcan, bus):
    vcan(3)
    ip("link set vcan2 down")
    b = bus(THREE)
    b.wait_link("dash", "down")
    b.exchange("vcan0", "vcan1", 0x100)
    ip("link set vcan2 up")
    b.wait_link("dash", "up")
    b.exchange("vcan2", "vcan1", 0x101)
    b.stop()


def reload(b, text):
    before = b.daemon.notifications.count("READY=1")
    b.daemon.config.write_text(text)
    b.shell.run("reload", "links")
    wait_until(lambda: b.daemon.notifications.count("READY=1") > before, "the reload")


def test_links_and_reloads(vcan, bus):
    """A node that is away stays away, also by another name; without port it is on the bus."""
    vcan(3)
    ip("link del vcan2")
    b = bus(THREE + "missing-port: wait\n")
    b.wait_link("dash", "missing")
    ip("link set vcan1 down")
    b.wait_link("gearbox", "down")
    reload(b, (THREE + "missing-port: wait\n").replace("gearbox", "transmission"))
    b.wait_link("dash", "missing")
    b.wait_link("transmission", "down")
    ip("link add vcan2 type vcan", "link set vcan2 up")
    b.wait_link("dash", "up")
    b.exchange("vcan0", "vcan2", 0x100)
    ip("link set vcan2 down")
    b.wait_link("dash", "down")
    reload(b, THREE.replace(", port: vcan2", ""))
    assert b.link("dash") is None
    b.ecu("vcan0").send(*frames(0x101, 3))  # the dash, now without port, acknowledges
    wait_until(lambda: b.nodes()["engine"]["tx_frames"] == 8, "frames")
    assert b.link("gearbox") == "down"  # renamed once more, and still down
    ip("link set vcan1 up")
    b.wait_link("gearbox", "up")
    b.exchange("vcan0", "vcan1", 0x102)
    b.stop()


def test_a_reload_waits_for_interfaces_only_when_told_so(vcan, bus):
    vcan(2)
    b = bus(TWO)
    b.daemon.config.write_text(THREE)
    assert "node dash: port vcan2: No such device" in b.shell.run("reload", "links", status=1)
    reload(b, THREE + "missing-port: wait\n")
    b.wait_link("dash", "missing")
    subprocess.run(["ip", "link", "add", "vcan2", "type", "vcan"], check=True)
    try:
        ip("link set vcan2 up")
        b.wait_link("dash", "up")
        b.exchange("vcan0", "vcan2", 0x100)
        b.stop()
    finally:
        ip("link del vcan2")
