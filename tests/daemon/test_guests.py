# SPDX-License-Identifier: MIT
"""Guests: nodes that are on the bus while a client is connected to the socket of `guests`.

This needs no CAN in the kernel.
"""

import errno
import json
import socket
import subprocess
import threading
from collections import Counter
from contextlib import closing

import pytest

from busclient import ERROR, HELLO, LOCAL, LOOPBACK, OWN, RECV_OWN, Client, PATIENCE_S
from busrig import BusRig, rig_fixture
from simtool import CANWIRE, TIMEOUT_S, canwire
from test_record import wait_until

BUS = """bus: {{ name: hotel, bitrate: {bitrate} }}
control: hotel.sock
guests: {{ count: {count}, port: "unix:bus.sock"{guests} }}
nodes:
  - {{ name: dash, port: "unix:dash.sock" }}
"""


class Rig(BusRig):
    TEXT, CONTROL = BUS, "hotel.sock"
    VALUES = {"bitrate": 500000, "count": 3, "guests": ""}

    def guest(self, name="", **more):
        return Client(self.folder / "bus.sock", name, **more)

    def dash(self, **more):
        return Client(self.folder / "dash.sock", **more)

    def links(self):
        return {name: node["link"] for name, node in self.nodes().items()}

    def wait(self, condition, what):
        wait_until(lambda: condition(self.nodes()), what)

    def reload(self, text, status=0):
        (self.folder / "bus.yaml").write_text(text)
        return self.run("reload", "./hotel.sock", status=status)


fixture_rig = rig_fixture(Rig)


def name_of(message):
    return message.body[24:].rstrip(b"\0").decode()


def test_a_client_is_a_node_by_its_name_until_it_goes(rig):
    r = rig()
    assert r.links() == {"dash": "up", "guest-1": "down", "guest-2": "down", "guest-3": "down"}
    dash = r.dash()
    scanner = r.guest("scanner", options=LOOPBACK | RECV_OWN)
    assert (scanner.welcome.type, name_of(scanner.welcome)) == (HELLO, "scanner")
    assert r.links() == {"dash": "up", "scanner": "up", "guest-2": "down", "guest-3": "down"}
    scanner.send(0x123, b"abc", 9)
    own = scanner.receive()
    assert (own.can_id, own.data, own.number, own.flags) == (0x123, b"abc", 9, LOCAL | OWN)
    assert dash.receive().can_id == 0x123
    dash.send(0x124)
    assert scanner.receive().can_id == 0x124
    assert r.nodes()["scanner"]["tx_frames"] == 1
    r.run("set", "./hotel.sock", "scanner", "queue=4")
    scanner.close()
    r.wait(lambda nodes: "scanner" not in nodes, "its end")
    assert r.links() == {"dash": "up", "guest-1": "down", "guest-2": "down", "guest-3": "down"}
    log = r.stop()
    assert "node scanner: a guest has come" in log and "node scanner: the guest has gone" in log


def test_a_bus_without_guests_acknowledges_nothing_of_theirs(rig):
    """A node that is off the bus does not acknowledge; a guest does."""
    r = rig()
    dash = r.dash(options=LOOPBACK | RECV_OWN)
    dash.send(0x123)
    r.wait(lambda nodes: nodes["dash"]["tx_errors"] > 20, "errors, as nobody acknowledges")
    guest = r.guest()
    assert name_of(guest.welcome) == "guest-1"
    assert dash.receive().can_id == 0x123
    assert guest.receive().can_id == 0x123
    r.stop()


def test_guests_see_each_other_through_the_bus_alone(rig):
    r = rig()
    a, b = r.guest("a"), r.guest("b")
    a.send(0x123)
    seen = b.receive()
    assert (seen.can_id, seen.flags) == (0x123, 0)
    b.send(0x124)
    assert a.receive().can_id == 0x124
    assert r.nodes()["a"]["interface"]["echoed"] == 0
    r.stop()


def test_a_bus_of_guests_alone(rig):
    """Two of them are enough for each other; with one there is nobody to acknowledge."""
    r = rig()
    for nodes in "nodes: []\n", "":
        r.reload('bus: { name: hotel, bitrate: 500000 }\ncontrol: hotel.sock\n' + nodes +
                 'guests: { count: 2, port: "unix:bus.sock" }\n')
        assert r.links() == {"guest-1": "down", "guest-2": "down"}
        with closing(r.guest("left")) as left, closing(r.guest("right")) as right:
            left.send(0x123, b"ab")
            message = right.receive()
            assert (message.can_id, message.data) == (0x123, b"ab")
            assert r.links() == {"left": "up", "right": "up"}
        r.wait(lambda now: "guest-1" in now and "guest-2" in now, "both to be gone")
    (r.folder / "alone.yaml").write_text((r.folder / "bus.yaml").read_text())
    for words in ("check",), ("analyse",), ("sim", "--until", "1ms"):
        canwire(*words, "alone.yaml", cwd=r.folder)
    r.stop()


@pytest.mark.parametrize("name, code, text", [
    ("dash", errno.EEXIST, "there is a node of that name"),
    ("first", errno.EEXIST, "there is a node of that name"),
    ("no/name", errno.EINVAL, "a name has at most 32"),
])
def test_a_wrong_name_is_refused(rig, name, code, text):
    r = rig()
    first = r.guest("first")
    refused = r.guest(name)
    assert (refused.welcome.type, refused.welcome.code) == (ERROR, code)
    assert text in refused.welcome.text and refused.ends()
    first.close()
    r.stop()


def test_the_own_name_of_a_guest_is_that_of_its_place(rig):
    r = rig()
    first, second = r.guest("first"), r.guest("guest-3")
    assert r.links() == {"dash": "up", "first": "up", "guest-2": "down", "guest-3": "up"}
    for name in ("guest-1", "guest-3"):
        assert r.guest(name).welcome.code == errno.EEXIST
    beyond = r.guest("guest-4")
    assert r.links() == {"dash": "up", "first": "up", "guest-4": "up", "guest-3": "up"}
    refused = r.reload(r.text.replace("count: 3", "count: 4"), status=1)
    assert "bus.yaml:3:1: node 'guest-4': a guest of that name is there" in refused.stderr
    for guest in (first, second, beyond):
        guest.close()
    r.stop()


def test_there_are_so_many_places(rig):
    r = rig(count=2)
    first, second = r.guest(), r.guest()
    third = r.guest("third")
    assert third.welcome.code == errno.EBUSY and "guests: count" in third.welcome.text
    assert third.ends()
    first.close()
    r.wait(lambda nodes: nodes["guest-1"]["link"] == "down", "its end")
    third = r.guest("third")
    assert name_of(third.welcome) == "third"
    assert set(r.nodes()) == {"dash", "third", "guest-2"}
    second.close()
    r.wait(lambda nodes: nodes["guest-2"]["link"] == "down", "its end")
    assert name_of(r.guest("guest-2").welcome) == "guest-2"
    r.stop()


def test_a_program_without_the_protocol_is_no_guest(rig):
    r = rig()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as plain:
        plain.connect(str(r.folder / "bus.sock"))
        plain.settimeout(PATIENCE_S)
        assert plain.recv(100) == b""  # whole: a message
    assert set(r.links().values()) == {"up", "down"} and r.links()["guest-1"] == "down"
    r.stop()


def test_what_a_guest_has_not_sent_goes_with_it(rig):
    """Its queue is dropped, and the next one at its place does not send it."""
    r = rig(bitrate=50000, count=1)
    guest, dash = r.guest("gone"), r.dash()
    r.run("inject", "./hotel.sock", "{ name: away, do: { disconnect: gone } }")
    for number in range(5):
        guest.send(0x100 + number)
    r.wait(lambda nodes: nodes["gone"]["interface"]["read"] == 5, "all frames")
    guest.close()
    r.wait(lambda nodes: "guest-1" in nodes, "its end")
    assert r.nodes()["guest-1"]["dropped"]["link-down"] == 5
    r.run("clear", "./hotel.sock", "away")
    other = r.guest("other")
    other.send(0x200)
    assert dash.receive().can_id == 0x200
    r.stop()


def test_a_guest_goes_also_while_its_messages_wait(rig):
    r = rig(bitrate=50000, count=1, guests=", queue: 2")
    guest = r.guest("flood")
    r.run("inject", "./hotel.sock", "{ name: away, do: { disconnect: flood } }")
    guest.socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        while True:
            guest.send(0x123)
    r.wait(lambda nodes: nodes["flood"]["pushing_back"], "the push-back")
    guest.close()
    r.wait(lambda nodes: "guest-1" in nodes, "its end")
    node = r.nodes()["guest-1"]
    assert (node["link"], node["pushing_back"]) == ("down", False)
    assert node["dropped"]["link-down"] == 2
    assert name_of(r.guest("next").welcome) == "next"
    r.stop()


def test_the_keys_of_nodes_are_those_of_all_guests(rig):
    r = rig(guests=", queue: 7, order: fifo, berr-reporting: on")
    guest = r.guest("a")
    for name in ("a", "guest-2"):
        settings = r.nodes()[name]["settings"]
        assert (settings["queue"], settings["order"]) == (7, "fifo")
        assert settings["berr-reporting"] is True
    guest.close()
    r.stop()


def test_events_have_the_name_of_the_guest(rig):
    r = rig()
    with socket.socket(socket.AF_UNIX) as control:
        control.settimeout(PATIENCE_S)
        control.connect(str(r.folder / "hotel.sock"))
        control.sendall(b'{"request":"watch","events":["link","rx","tx"]}\n')
        lines = control.makefile()
        assert json.loads(lines.readline())["ok"]
        guest = r.guest("scanner", options=LOOPBACK | RECV_OWN)
        guest.send(0x321)
        guest.receive()
        guest.close()
        events = [json.loads(lines.readline()) for _ in range(4)]
    assert [(e["node"], e["event"], e.get("state")) for e in events] == [
        ("scanner", "link", "up"), ("dash", "rx", None), ("scanner", "tx", None),
        ("scanner", "link", "down")]
    r.stop()


def test_the_journal_repeats_coming_and_going(rig):
    r = rig(journal=True)
    dash = r.dash()
    for name in ("a", "b", "a", ""):
        guest = r.guest(name, options=LOOPBACK | RECV_OWN)
        guest.send(0x123)
        guest.receive()
        dash.receive()
        guest.close()
        r.wait(lambda nodes: nodes.get("guest-1", {}).get("link") == "down", "its end")
    r.stop()
    events = [(e["node"], e["event"]) for e in r.again() if e.get("node") != "dash"]
    assert events == [(name, event) for name in ("a", "b", "a", "guest-1")
                      for event in ("link", "tx", "link")]


def test_a_reload_keeps_guests_that_stay(rig):
    r = rig(journal=True)
    a, b, c = r.guest("a"), r.guest("b"), r.guest("c")
    text = r.text.replace("count: 3", "count: 2").replace(
        "nodes:\n", "nodes:\n  - { name: first }\n")
    r.reload(text)
    r.wait(lambda nodes: "first" in nodes, "the reload")
    assert r.links() == {"first": None, "dash": "up", "a": "up", "b": "up"}
    assert c.ends()
    a.send(0x123)
    assert b.receive().can_id == 0x123
    b.close()
    r.wait(lambda nodes: "b" not in nodes, "its end")
    again = r.guest("again")
    a.send(0x124)
    assert again.receive().can_id == 0x124
    refused = r.reload(text.replace("name: first", "name: again"), status=1)
    assert "bus.yaml:5:1: node 'again': a guest of that name is there" in refused.stderr
    a.send(0x125)
    assert again.receive().can_id == 0x125
    r.stop()
    frames = [e["frame"] for e in r.again() if e["event"] == "tx" and e["node"] == "a"]
    assert frames == ["123#", "124#", "125#"]


def test_a_reload_opens_and_closes_the_door(rig):
    r = rig()
    a = r.guest("a")
    without = r.text.replace(r.text.splitlines()[2] + "\n", "")
    r.reload(without)
    r.wait(lambda nodes: set(nodes) == {"dash"}, "the reload")
    assert a.ends()
    assert not (r.folder / "bus.sock").exists()
    moved = r.text.replace("bus.sock", "door.sock")
    r.reload(moved)
    r.wait(lambda nodes: "guest-3" in nodes, "the reload")
    guest = Client(r.folder / "door.sock", "b")
    dash = r.dash()
    guest.send(0x123)
    assert dash.receive().can_id == 0x123
    r.reload(r.text)
    wait_until(lambda: (r.folder / "bus.sock").exists(), "the other door")
    guest.send(0x124)  # it stays in
    assert dash.receive().can_id == 0x124
    assert name_of(r.guest("c").welcome) == "c"
    r.stop()
    assert not (r.folder / "bus.sock").exists()


def test_many_come_and_go_at_once(rig):
    r = rig(count=40, bitrate=1000000)
    dash = r.dash()
    failures = []

    def stay(number):
        name = f"g{number}"
        try:
            for _ in range(10):
                guest = r.guest(name, options=LOOPBACK | RECV_OWN)
                while guest.welcome.type == ERROR:  # canwired has not seen its own end yet
                    assert guest.welcome.code == errno.EEXIST
                    guest = r.guest(name, options=LOOPBACK | RECV_OWN)
                guest.send(0x100 + number, number=5)
                while guest.receive().number != 5:
                    pass
                guest.close()
        except (AssertionError, OSError) as error:
            failures.append(error)

    threads = [threading.Thread(target=stay, args=(k,), daemon=True) for k in range(30)]
    for thread in threads:
        thread.start()
    seen = Counter(dash.receive().can_id for _ in range(300))
    assert seen == {0x100 + number: 10 for number in range(30)}
    for thread in threads:
        thread.join(PATIENCE_S)
    assert failures == []
    r.wait(lambda nodes: all(nodes[f"guest-{k}"]["link"] == "down" for k in range(1, 41)
                             if f"guest-{k}" in nodes) and "g0" not in nodes, "the end of all")
    r.stop()


def test_simulations_have_no_guests(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        "bus: { bitrate: 500000 }\nguests: { count: 8, port: 'unix:bus.sock' }\n"
        "nodes: [ { name: a, traffic: [ { send: 123# } ] } ]\n")
    out = canwire("sim", "bus.yaml", "--until", "200us", "--events", "-", cwd=tmp_path).stdout
    first = json.loads(out.splitlines()[0])
    assert (first["event"], first["type"]) == ("error", "ack")  # nobody acknowledges
    assert "guest" not in out


def test_guests_that_share_a_port_are_recorded(rig):
    r = rig()
    recorder = subprocess.Popen(  # pylint: disable=consider-using-with
        [CANWIRE, "record", "./hotel.sock", "hotel.log", "--format", "candump"], cwd=r.folder,
        stderr=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: (r.folder / "hotel.log").exists() or recorder.poll() is not None,
                   "the recording")
        assert recorder.poll() is None, recorder.stderr.read()
    finally:
        recorder.terminate()
        recorder.communicate(timeout=TIMEOUT_S)
    message = r.run("record", "./hotel.sock", "bus.sock", "--format", "candump", status=1).stderr
    assert "bus.sock" in message and "the bus' port" in message
