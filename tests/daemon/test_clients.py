# SPDX-License-Identifier: MIT
"""Several programs at one port: a plain ECU and clients with the protocol of canwire-ports(7).

This needs no CAN in the kernel.
"""

import contextlib
import errno
import re
import socket
import threading

import pytest

from busclient import (DROPPED, ERROR, FD, FD_BODY, FILTERS, FLUSH, FLUSHES, FRAME, FRAME_BODY,
                       HEAD, HELLO, JOIN, LOCAL, LOOPBACK, OPTIONS, OWN,
                       RECV_OWN, TELL_DROPPED, Client, PATIENCE_S)
from busrig import BusRig, rig_fixture
from simtool import ROOT
from test_record import wait_until

BUS = """bus: {{ name: share, bitrate: {bitrate}{bus} }}
control: share.sock
nodes:
  - {{ name: engine, port: "unix:engine.sock"{engine} }}
  - {{ name: dash, port: "unix:dash.sock"{dash} }}
"""
ERR, EFF, RTR, INV = 0x20000000, 0x80000000, 0x40000000, 0x20000000


class Rig(BusRig):
    TEXT, CONTROL = BUS, "share.sock"
    VALUES = {"bitrate": 500000, "bus": "", "engine": "", "dash": ""}

    def client(self, node="engine", *words, **more):
        return Client(self.folder / f"{node}.sock", *words, **more)

    def plain(self, node="engine"):
        ecu = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ecu.settimeout(PATIENCE_S)
        ecu.connect(str(self.folder / f"{node}.sock"))
        return ecu

    def node(self, name="engine"):
        return self.nodes()[name]

    def wait(self, condition, what, name="engine"):
        wait_until(lambda: condition(self.node(name)), what)


fixture_rig = rig_fixture(Rig)


def test_the_example_of_the_page(rig):
    r = rig(bitrate=250000)
    page = (ROOT / "daemon/man/canwire-ports.7.md").read_text()
    example = next(text for text in re.findall(r"```python\n(.*?)```", page, re.S)
                   if "client.bind" in text)
    names = {}
    exec(example.replace("/run/rig/", f"{r.folder}/"), names)
    assert (names["type"], names["flags"], names["size"]) == (FRAME, LOCAL | OWN, 48)
    assert (names["number"], names["lost"], names["can_id"]) == (7, 0, 0x123)
    assert (names["length"], names["data"][:4]) == (4, bytes.fromhex("DEADBEEF"))
    assert HEAD.unpack_from(names["welcome"])[0] == HELLO
    assert [c["name"] for c in r.node()["clients"]] == ["logger"]
    assert "    client logger: read 1 written 1 lost 0\n" in r.run("status", "./share.sock").stdout
    names["client"].close()
    r.stop()


def test_the_hello_is_answered(rig):
    r = rig(bus=", dbitrate: 2000000", dash=", kind: classical")
    for node, mtu in ("engine", 72), ("dash", 16):
        client = r.client(node, "a-name.1")
        w = client.welcome
        assert (w.type, w.body[:8]) == (HELLO, b"canwire\0")
        assert [int.from_bytes(w.body[k:k + 4], "little") for k in (8, 12, 16, 20)] == [
            1, LOOPBACK, 0, mtu]
        assert w.body[24:].rstrip(b"\0").decode() == node
    r.stop()


@pytest.mark.parametrize("wrong, code, text", [
    ({"version": 2}, errno.EPROTONOSUPPORT, "version 2 is not known: version 1 is"),
    ({"options": 0x80}, errno.EOPNOTSUPP, "options that are not known"),
    ({"name": "a b"}, errno.EINVAL, "a name has at most 32"),
    ({"name": "a" * 33}, errno.EINVAL, "a name has at most 32"),
])
def test_a_wrong_hello_is_answered_and_the_end(rig, wrong, code, text):
    r = rig()
    client = r.client(**wrong)
    assert (client.welcome.type, client.welcome.code, client.welcome.number) == (ERROR, code, HELLO)
    assert text in client.welcome.text
    assert client.ends()
    assert r.node()["interface"]["malformed"] == 1
    assert r.node()["clients"] == []
    r.stop()


def test_a_client_that_says_something_else_first_is_turned_away(rig):
    r = rig()
    client = r.client(hello=False)
    client.socket.send(FRAME_BODY.pack(0x123, 0, 0, b""))
    answer = client.receive()
    assert (answer.type, answer.code) == (ERROR, errno.EPROTO)
    assert client.ends()
    r.stop()


def test_the_others_see_a_frame_at_once_and_the_bus_later(rig):
    """The engine's bus carries nothing, as its node is on a broken line."""
    r = rig()
    r.run("inject", "./share.sock", "{ name: away, do: { disconnect: engine } }")
    a, b, quiet = r.client(), r.client(), r.client(options=0)
    plain = r.plain()
    a.send(0x123, b"\x01\x02", number=5)
    seen = b.receive()
    assert (seen.type, seen.flags, seen.number) == (FRAME, LOCAL, 0)
    assert (seen.can_id, seen.data) == (0x123, b"\x01\x02")
    assert quiet.receive().can_id == 0x123
    assert FRAME_BODY.unpack(plain.recv(100))[0] == 0x123  # whole: a message
    quiet.send(0x124)  # without loopback
    plain.send(FRAME_BODY.pack(0x125, 0, 0, b""))
    assert a.receive().can_id == 0x125
    assert b.receive().can_id == 0x125
    r.wait(lambda node: node["interface"]["read"] == 3, "all three")
    assert r.node()["tx_frames"] == 0
    dash = r.client("dash")
    r.run("clear", "./share.sock", "away")
    assert [dash.receive().can_id for _ in range(3)] == [0x123, 0x124, 0x125]
    assert r.node()["interface"]["echoed"] == 6
    r.stop()


def test_the_others_see_a_frame_when_it_has_been_sent(rig):
    r = rig(engine=", clients: { echo: sent }", bitrate=125000)
    a, b, dash = r.client(), r.client(), r.client("dash")
    r.run("inject", "./share.sock", "{ name: away, do: { disconnect: engine } }")
    for number in range(8):
        a.send(0x100 + number)
    r.wait(lambda node: node["interface"]["read"] == 8, "all of them")
    assert r.node()["interface"]["echoed"] == 0
    r.run("clear", "./share.sock", "away")
    ours = [b.receive() for _ in range(8)]
    theirs = [dash.receive() for _ in range(8)]
    assert [m.can_id for m in ours] == [m.can_id for m in theirs] == list(range(0x100, 0x108))
    assert [m.flags for m in ours] == [LOCAL] * 8 and [m.flags for m in theirs] == [0] * 8
    for mine, other in zip(ours, theirs):  # receivers have it at the last bit but one (M7)
        assert mine.bus_ns - other.bus_ns == 8000
        assert abs(mine.realtime_ns - other.realtime_ns - 8000) <= 1
    assert r.node()["interface"]["echoed"] == 8
    r.stop()


@pytest.mark.parametrize("echo", ["at-once", "sent"])
def test_own_frames_come_back_when_they_have_been_sent(rig, echo):
    """Not in the order of writing: the bus takes the more important ones first."""
    r = rig(engine=f", clients: {{ echo: {echo} }}", bitrate=50000)
    client = r.client(options=LOOPBACK | RECV_OWN)
    dash = r.client("dash")
    r.run("inject", "./share.sock", "{ name: away, do: { disconnect: engine } }")
    sent = {number: 0x300 - number // 2 for number in range(10)}  # pairs of equal frames
    for number, can_id in sent.items():
        client.send(can_id, b"\xAA", number)
    r.wait(lambda node: node["interface"]["read"] == 10, "all of them")
    r.run("clear", "./share.sock", "away")
    own = [client.receive() for _ in range(10)]
    theirs = [dash.receive() for _ in range(10)]
    assert [m.can_id for m in own] == [m.can_id for m in theirs] == sorted(sent.values())
    assert [m.number for m in own] == [8, 9, 6, 7, 4, 5, 2, 3, 0, 1]
    assert {m.flags for m in own} == {LOCAL | OWN}
    for mine, other in zip(own, theirs):
        assert mine.bus_ns - other.bus_ns == 20000
    assert r.node()["interface"]["unconfirmed"] == 0
    r.stop()


def test_own_frames_need_loopback(rig):
    r = rig()
    client, dash = r.client(options=RECV_OWN), r.client("dash")
    client.send(0x123)
    assert dash.receive().can_id == 0x123
    client.set_options(LOOPBACK | RECV_OWN)
    client.send(0x124)
    assert client.receive().can_id == 0x124
    r.stop()


def test_a_client_is_told_what_becomes_of_its_frames(rig):
    r = rig(engine=", queue: 2, when-full: drop", bitrate=125000)
    client = r.client(options=TELL_DROPPED)
    r.run("inject", "./share.sock", "{ name: away, do: { disconnect: engine } }")
    for number in range(4):
        client.send(0x100 + number, number=number)
    told = [client.receive() for _ in range(2)]
    assert [(m.type, m.number, m.code, m.text) for m in told] == [
        (DROPPED, number, errno.ENOBUFS, "queue-full") for number in (2, 3)]
    r.run("inject", "./share.sock", "{ name: off, do: { bus-off: engine } }")
    client.send(0x104, number=4)
    told = client.receive()
    assert (told.type, told.number, told.code, told.text) == (DROPPED, 4, errno.ENETDOWN, "bus-off")
    r.stop()


def test_the_port_filters(rig):
    """As the kernel does: inverted ones, joined ones, none, and by format where the mask asks.

    The frames may come by priority: those that wait while the machine is busy are sent so.
    """
    r = rig()
    cases = [
        ([(0x123, 0x7FF)], 0, [0x123, EFF | 0x123]),
        ([(0x123, EFF | RTR | 0x7FF)], 0, [0x123]),
        ([(EFF | 0x123, EFF | RTR | 0x1FFFFFFF)], 0, [EFF | 0x123]),
        ([(0x100, 0x700), (0x200, 0x7FF)], 0, [0x123, EFF | 0x123, 0x1FF, 0x200]),
        ([(INV | 0x123, 0x7FF)], 0, [0x1FF, 0x200, 0x7FF]),
        ([(INV | 0x123, 0x7FF), (INV | 0x200, 0x7FF)], JOIN, [0x1FF, 0x7FF]),
        ([], 0, []),
        ([(0, 0)], 0, [0x123, EFF | 0x123, 0x1FF, 0x200, 0x7FF]),
    ]
    clients = []
    for filters, options, expected in cases:
        clients.append((r.client("dash", options=options), expected))
        clients[-1][0].set_filters(*filters)
    last = r.client("dash")
    r.wait(lambda node: len(node["clients"]) == 9, "all clients", "dash")
    engine = r.plain()
    for can_id in [0x123, EFF | 0x123, 0x1FF, 0x200, 0x7FF]:
        engine.send(FRAME_BODY.pack(can_id, 1, 0, b"x"))
    assert [last.receive().can_id for _ in range(5)][-1] == 0x7FF
    for client, expected in clients:
        assert sorted(client.receive().can_id for _ in expected) == sorted(expected)
        client.socket.setblocking(False)
        with pytest.raises(BlockingIOError):
            client.receive()
    node = r.node("dash")
    assert node["interface"]["written"] == 5 and node["interface"]["unheard"] == 0
    r.stop()


def test_a_frame_that_no_client_wants_is_unheard(rig):
    r = rig()
    client = r.client("dash")
    client.set_filters((0x123, 0x7FF))
    engine = r.client()
    engine.send(0x122)
    engine.send(0x123)
    assert client.receive().can_id == 0x123
    interface = r.node("dash")["interface"]
    assert (interface["unheard"], interface["written"]) == (1, 1)
    r.stop()


def test_error_frames_come_to_those_who_ask(rig):
    r = rig()
    off, none, filtered = (r.client(error_mask=0x40), r.client(),
                           r.client())
    filtered.set_filters((0, ERR | 0x140))
    plain = r.plain()
    r.wait(lambda node: len(node["clients"]) == 4, "all of them")
    r.run("inject", "./share.sock", "{ name: off, do: { bus-off: engine } }")
    assert off.receive().can_id == ERR | 0x40
    assert filtered.receive().can_id == ERR | 0x40
    assert FRAME_BODY.unpack(plain.recv(100))[0] == ERR | 0x40  # whole: a message
    r.run("restart", "./share.sock", "engine")
    assert filtered.receive().can_id & 0x100
    r.client("dash").send(0x321)
    assert none.receive().can_id == 0x321
    r.stop()


@pytest.mark.parametrize("restart", ["", ", restart-ms: 50"])
def test_frames_behind_a_restart_wait_for_the_end_of_the_recovery(rig, restart):
    """R12: 128 x 11 bits take 70 ms here. More frames than the queue holds are pushed back."""
    r = rig(bitrate=20000, engine=restart)
    client, plain, dash = r.client(error_mask=0x140), r.plain(), r.client("dash")
    r.wait(lambda node: len(node["clients"]) == 2, "both")
    r.run("inject", "./share.sock", "{ name: off, do: { bus-off: engine } }")
    assert client.receive().can_id == ERR | 0x40
    if not restart:
        r.run("restart", "./share.sock", "engine")
    assert client.receive().can_id & 0x100
    client.send(0x100)
    for number in range(40):
        plain.send(FRAME_BODY.pack(0x200 + number, 0, 0, b""))
    assert sorted(dash.receive().can_id for _ in range(41)) == [0x100, *range(0x200, 0x228)]
    assert sum(r.node()["dropped"].values()) == 0
    r.stop()


def test_fd_frames_are_for_those_who_say_so(rig):
    r = rig(bus=", dbitrate: 2000000")
    fd, classical, dash = r.client(options=FD | LOOPBACK), r.client(), r.client("dash", options=FD)
    data = bytes(range(12))
    fd.send_fd(0x123, data, flags=1)
    seen = dash.receive()
    assert FD_BODY.unpack(seen.body)[:3] == (0x123, 12, 1 | 4) and seen.data == data
    fd.send(0x124)
    assert classical.receive().can_id == 0x124
    classical.send_fd(0x125)
    refused = classical.receive()
    assert (refused.type, refused.number, refused.code) == (ERROR, FRAME, errno.EINVAL)
    assert r.node()["interface"]["malformed"] == 1
    fd.send_fd(0x126, bytes(9))
    assert dash.receive().can_id == 0x124
    assert dash.receive().data == bytes(12)
    assert r.node()["interface"]["rounded"] == 1
    r.stop()


@pytest.mark.parametrize("kind, body, code", [
    (99, b"", errno.EOPNOTSUPP),
    (HELLO, b"", errno.EOPNOTSUPP),
    (FRAME, b"short", errno.EINVAL),
    (FRAME, FRAME_BODY.pack(1, 9, 0, b""), errno.EINVAL),
    (OPTIONS, b"1234", errno.EINVAL),
    (FILTERS, b"1234", errno.EINVAL),
    (FILTERS, bytes(513 * 8), errno.EMSGSIZE),
], ids=["type", "hello", "short", "length", "options", "filters", "many filters"])
def test_what_is_wrong_is_answered_and_counted(rig, kind, body, code):
    r = rig()
    client, dash = r.client(), r.client("dash")
    client.write(kind, body)
    answer = client.receive()
    assert (answer.type, answer.number, answer.code) == (ERROR, kind, code)
    client.socket.send(HEAD.pack(FRAME, 0, 31, 0, 0, 0, 0, 0))
    answer = client.receive()
    assert (answer.type, answer.code) == (ERROR, errno.EPROTO)
    assert r.node()["interface"]["malformed"] == 2
    client.send(0x123)
    assert dash.receive().can_id == 0x123
    r.stop()


def test_error_frames_of_clients_do_not_enter_the_bus(rig):
    r = rig()
    client, dash = r.client(), r.client("dash", error_mask=0x1FFFFFFF)
    beside, deaf = r.client(error_mask=0x40), r.client()
    silent = r.client(options=0)
    silent.send(ERR | 0x40, b"lost")
    client.send(ERR | 0x40, bytes(8))
    client.send(ERR | 0x20, b"other")
    client.send(0x123)
    got = beside.receive()
    assert (got.can_id, got.data, got.flags) == (ERR | 0x40, bytes(8), LOCAL)
    for other in (dash, beside, deaf):
        assert other.receive().can_id == 0x123
    assert r.node()["interface"]["errors_ignored"] == 3
    r.stop()


def test_too_many_are_turned_away(rig):
    r = rig(engine=", clients: 2")
    first, second, third = r.client(), r.client(), r.client()
    assert (third.welcome.type, third.welcome.code) == (ERROR, errno.EUSERS)
    assert third.ends()
    assert r.node()["interface"]["refused"] == 1
    first.close()
    r.wait(lambda node: len(node["clients"]) == 1, "its going")
    fourth = r.client()
    assert fourth.welcome.type == HELLO
    plain = r.plain()  # beside them
    fourth.send(0x123)
    assert FRAME_BODY.unpack(plain.recv(100))[0] == 0x123  # whole: a message
    assert second.receive().can_id == 0x123
    assert [c["name"] for c in r.node()["clients"]] == [None, "", ""]
    shown = r.run("status", "./share.sock").stdout
    assert "    ECU: read 0 written 1 lost 0\n    client: read 1 written 0 lost 0\n" in shown
    r.stop()


def test_one_plain_ecu_at_a_time_also_beside_clients(rig):
    r = rig()
    client, first = r.client(), r.plain()
    client.send(0x123)
    assert first.recv(100)  # whole: a message
    second = r.plain()
    assert second.recv(100) == b""  # whole: a message
    first.close()
    third = r.plain()
    client.send(0x124)
    wait_until(lambda: r.node()["interface"]["connected"] == 3, "the third")
    client.send(0x125)
    while FRAME_BODY.unpack(third.recv(100))[0] != 0x125:  # whole: a message
        pass
    r.stop()


def test_a_client_that_does_not_read_loses_its_own_frames(rig):
    """The others and the bus lose nothing. It is told how many."""
    r = rig(bitrate=1000000)
    deaf, reader, sender = r.client("dash", "deaf"), r.client("dash", "reader"), r.plain()
    done = threading.Event()
    lost = set()

    def write():
        while not done.is_set():
            sender.send(FRAME_BODY.pack(0x123, 0, 0, b""))

    def read():
        while not done.is_set():
            lost.add(reader.receive().lost)

    threads = [threading.Thread(target=work, daemon=True) for work in (write, read)]
    for thread in threads:
        thread.start()
    r.wait(lambda node: node["clients"][0]["lost"] >= 100, "its losses", "dash")
    while (told := deaf.receive().lost) == 0:
        pass
    done.set()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert told >= 100 and lost == {0}
    node = r.node("dash")
    assert node["interface"]["clients_lost"] == node["clients"][0]["lost"] >= told
    assert node["interface"]["write_failed"] == node["clients"][1]["lost"] == 0
    r.stop()


def write_until_the_end(client):
    with contextlib.suppress(ConnectionError):
        for _ in range(400):
            client.send(0x700, bytes(8))


def test_programs_take_turns_while_the_queue_is_full(rig):
    """One writes without end; the frames of the others do not wait behind all of these."""
    r = rig(bitrate=50000, engine=", queue: 4")
    flood, polite, dash = r.client(name="flood"), r.client(name="polite"), r.client("dash")
    thread = threading.Thread(target=lambda: write_until_the_end(flood), daemon=True)
    thread.start()
    r.wait(lambda node: node["pushing_back"], "the push-back")
    before = 0
    for number in range(10):
        polite.send(0x101 + number)
        while (seen := dash.receive().can_id) == 0x700:
            before += 1
        assert seen == 0x101 + number
    assert before < 150  # of the some hundred that wait in the socket
    read = {c["name"]: c["read"] for c in r.node()["clients"]}
    assert read["polite"] == 10 and 0 < read["flood"] < 400
    r.process.terminate()
    assert r.process.wait(PATIENCE_S) == 0


def test_a_reload_keeps_clients_and_changes_how_they_share(rig):
    r = rig()
    a, b = r.client(name="a"), r.client(name="b")
    r.run("inject", "./share.sock", "{ name: away, do: { disconnect: engine } }")
    a.send(0x100)
    assert b.receive().can_id == 0x100
    text = r.text.replace("engine.sock\"", "engine.sock\", clients: { max: 2, echo: sent }")
    (r.folder / "bus.yaml").write_text(text + "faults: [ { name: away2, when: { manual: yes }, "
                                              "do: { disconnect: engine } } ]\n")
    r.run("reload", "./share.sock")
    r.wait(lambda node: node["tx_frames"] == 1, "the frame, as the rule is gone")
    assert r.client().welcome.code == errno.EUSERS
    r.run("fire", "./share.sock", "away2")
    a.send(0x101)
    r.wait(lambda node: node["interface"]["read"] == 2, "the frame")
    b.socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        b.receive()
    r.stop()


def test_a_run_with_clients_is_in_the_journal(rig):
    r = rig(journal=True)
    a, b, dash = r.client(), r.client(), r.client("dash")
    for number in range(20):
        (a if number % 3 else b).send(0x100 + number)
    seen = [dash.receive().can_id for _ in range(20)]
    r.stop()
    again = [int(e["frame"].split("#")[0], 16) for e in r.again() if e["event"] == "rx"]
    assert again == seen


def test_a_flush_is_answered_when_the_bus_has_sent_what_was_before(rig):
    r = rig(bitrate=20000)
    dash = r.client("dash")
    client = r.client(options=LOOPBACK | FLUSHES)
    client.write(FLUSH, number=3)
    assert client.receive()[:3] == (FLUSH, 0, 3)  # nothing was before
    for number in range(5):
        client.send(0x100 + number, bytes(8))
    client.write(FLUSH, number=9)
    client.send(0x200)
    answer = client.receive()
    assert (answer.type, answer.number, answer.body) == (FLUSH, 9, b"")
    assert r.node("dash")["rx_frames"] >= 5
    assert [dash.receive().can_id for _ in range(6)] == [*range(0x100, 0x105), 0x200]
    r.stop()


def test_a_flush_is_answered_when_frames_were_dropped(rig):
    r = rig()
    client = r.client(options=LOOPBACK | FLUSHES)
    r.run("set", "./share.sock", "engine", "listen-only=on")
    for number in range(5):
        client.send(0x100 + number)
    client.write(FLUSH, number=4)
    assert client.receive()[:3] == (FLUSH, 0, 4)
    r.stop()


def test_a_wrong_flush_is_refused(rig):
    r = rig()
    client = r.client(options=LOOPBACK)
    client.write(FLUSH)
    assert (client.receive().code, r.node()["interface"]["malformed"]) == (errno.EOPNOTSUPP, 1)
    client.set_options(LOOPBACK | FLUSHES)
    client.write(FLUSH, b"1234")
    assert (client.receive().code, r.node()["interface"]["malformed"]) == (errno.EINVAL, 2)
    r.stop()
