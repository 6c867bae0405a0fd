# SPDX-License-Identifier: MIT
"""Full, missing and occupied resources are reported clearly and counted, and never end canwired."""

import re
import signal
import socket
import subprocess

import pytest

from canbits import Frame
from conftest import CanSocket, Daemon, assert_balance, ip, wait_until
from test_faults import Shell

CRTL, RX_OVERFLOW = 0x20000004, 0x01
CAN_RAW_ERR_FILTER = 2
TWO = """
bus: { name: limits, bitrate: 1000000 }
control: limits.sock
nodes:
  - { name: engine, port: vcan0, queue: 4096 }
  - { name: gearbox, port: vcan1 }
"""
THREE = TWO + "  - { name: dash, port: vcan2 }\n"


def frames(identifier, count):
    return [Frame(identifier, 2, (i & 0xFFFF).to_bytes(2, "big")) for i in range(count)]


def nodes(daemon, bus="limits"):
    return Shell(daemon).nodes(bus)


def stop(daemon, bus="limits"):
    for node in nodes(daemon, bus).values():
        assert_balance(node)
    return daemon.stop()


# ---- Room in the kernel --------------------------------------------------------------------------


def room_without_capability():
    """Returns the kernel's grant for such a process, or more, of the 8 MiB that canwired asks
    for."""
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        return s.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


POWERLESS = ("setpriv", "--bounding-set", "-all", "--inh-caps", "-all")


@pytest.mark.parametrize("before", [(), POWERLESS], ids=["root", "no capability"])
@pytest.mark.parametrize("after", [(), ("--verbose",)], ids=["", "verbose"])
def test_too_little_room_is_told_once(vcan, canwired, before, after):
    """Root gets its 8 MiB. Another process gets what net.core.rmem_max is, 208 KiB by default."""
    vcan(2)
    text = canwired(TWO, before=before, after=after).stop()
    room = room_without_capability() if before else 8 << 20
    lines = [line for line in text.splitlines() if "net.core.rmem_max" in line]
    assert len(lines) == (room < 8 << 20 and after != ())
    for line in lines:
        assert line.endswith(f"an interface may have {room // 1024} KiB of frames waiting, not "
                             "8192, before the kernel drops more: sysctl net.core.rmem_max=8388608")


# ---- Interfaces that run full --------------------------------------------------------------------


def test_an_interface_that_takes_no_more(vcan, canwired, can_socket):
    """Frames to the gearbox have to wait there, until there is no room."""
    count = 3000
    vcan(3)
    subprocess.run("tc qdisc add dev vcan1 root tbf rate 8kbit burst 1540 limit 1000".split(),
                   check=True)
    daemon = canwired(THREE)
    engine, dash = can_socket("vcan0"), can_socket("vcan2")
    written = frames(0x123, count)
    engine.send(*written)
    assert dash.receive(count) == written  # no other ECU is delayed
    wait_until(lambda: nodes(daemon)["gearbox"]["rx_frames"] == count, "all at the gearbox")
    gearbox = nodes(daemon)["gearbox"]
    interface = gearbox["interface"]
    assert interface["write_failed"] > 0
    assert interface["written"] + interface["write_failed"] == count
    assert re.search(r"2: gearbox@vcan1:(.*\n)+?    RX:.*\n +\d+ +3000 +0 +"
                     f"{interface['write_failed']} ", Shell(daemon).run("status", "limits"))
    wait_until(lambda: "received, not taken by the port" in daemon.stderr(), "the warning")
    assert nodes(daemon)["engine"]["tec"] == 0
    stop(daemon)


@pytest.mark.parametrize("before", [(), POWERLESS], ids=["root", "no capability"])
def test_frames_that_the_kernel_lost_are_counted_and_told(vcan, canwired, can_socket, before):
    """More frames than the daemon's socket holds, while it is stopped."""
    count = 60000
    vcan(2)
    daemon = canwired(TWO, before=before)
    engine, errors = can_socket("vcan0"), CanSocket("vcan0")
    errors.socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, 0x4)
    errors.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
    try:
        daemon.process.send_signal(signal.SIGSTOP)
        engine.send(*frames(0x123, count))
        daemon.process.send_signal(signal.SIGCONT)

        def told():
            return [f for f in errors.drain() if f.can_id == CRTL and f.data[1] == RX_OVERFLOW]

        first = wait_until(told, "the error frame")
        assert first[0].data == bytes([0, RX_OVERFLOW]) + bytes(6)
        wait_until(lambda: nodes(daemon)["engine"]["queue"] == 0, "the end of the queue")
        node = nodes(daemon)["engine"]
        interface = node["interface"]
        assert interface["kernel_dropped"] > 0
        assert interface["read"] + interface["kernel_dropped"] == count
        assert node["handed_in"] == node["tx_frames"] + node["dropped"]["queue-full"]
        engine.send(Frame.parse("7FF#"))  # and it goes on
        wait_until(lambda: nodes(daemon)["engine"]["tx_frames"] == node["tx_frames"] + 1, "a frame")
        log = stop(daemon)
        assert f"{interface['kernel_dropped']} lost in the kernel before they could be read" in log
        assert ("sysctl net.core.rmem_max=8388608, then restart" in log) == (
            before != () and room_without_capability() < 8 << 20)
    finally:
        errors.close()


# ---- Two daemons ---------------------------------------------------------------------------------


def test_an_interface_belongs_to_one_daemon(vcan, canwired, launch, can_socket):
    vcan(2)
    first = canwired(TWO)
    second = launch(TWO.replace("name: limits", "name: other").replace("vcan1", "vcan9")
                    .replace("limits.sock", "other.sock"))
    assert second.wait() == 1
    owner = f"in use by bus limits of canwired, pid {first.process.pid}"
    assert f"node engine: port vcan0: {owner}" in second.stderr()
    assert "node gearbox: port vcan9: No such device" in second.stderr()
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    written = frames(0x123, 5)
    engine.send(*written)
    assert gearbox.receive(5) == written
    first.process.kill()  # nothing of it is in the way
    first.process.wait()
    third = canwired(TWO)
    engine.send(*written)
    assert gearbox.receive(5) == written
    stop(third)


def test_a_reload_does_not_take_the_interface_of_another_daemon(vcan, canwired):
    vcan(3)
    one = canwired(TWO)
    two = canwired("bus: { name: two, bitrate: 500000 }\ncontrol: two.sock\n"
                   "nodes: [ { name: dash, port: vcan2 } ]\n")
    one.config.write_text(THREE)
    refusal = Shell(one).run("reload", "limits", status=1)
    assert f"port vcan2: in use by bus two of canwired, pid {two.process.pid}" in refusal
    stop(two, "two")
    Shell(one).run("reload", "limits")
    wait_until(lambda: "dash" in nodes(one), "the reload")
    stop(one)


def test_an_interface_that_another_daemon_gets_first(vcan, canwired, can_socket):
    """One that is deleted and made anew meanwhile; it is got back when the other ends."""
    vcan(2)
    one = canwired(TWO)
    one.process.send_signal(signal.SIGSTOP)
    ip("link del vcan1", "link add vcan1 type vcan", "link set vcan1 up")
    two = canwired("bus: { name: two, bitrate: 500000 }\ncontrol: two.sock\n"
                   "nodes: [ { name: thief, port: vcan1 } ]\n")
    one.process.send_signal(signal.SIGCONT)
    owner = f"port vcan1: in use by bus two of canwired, pid {two.process.pid}; trying again"
    wait_until(lambda: owner in one.stderr(), "the refusal")
    assert nodes(one)["gearbox"]["link"] == "missing"
    stop(two, "two")
    wait_until(lambda: nodes(one)["gearbox"]["link"] == "up", "vcan1")
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    engine.send(*frames(0x123, 5))
    assert gearbox.receive(5) == frames(0x123, 5)
    assert stop(one).count("trying again") == 1


def test_network_namespaces_do_not_meet(vcan, canwired, tmp_path):
    """The same index of an interface in another namespace is another interface."""
    vcan(1)
    index = socket.if_nametoindex("vcan0")
    text = ("bus: {{ name: {0}, bitrate: 500000 }}\ncontrol: {0}.sock\n"
            "nodes: [ {{ name: a, port: vcan0 }} ]\n")
    here = canwired(text.format("here"))
    folder = tmp_path / "there"
    folder.mkdir()
    make = f"ip link add vcan0 index {index} type vcan && ip link set vcan0 up && exec \"$@\""
    there = Daemon(folder, text.format("there"), before=["unshare", "-n", "sh", "-c", make, "sh"])
    try:
        there.wait_ready()
        assert nodes(there, "there")["a"]["link"] == nodes(here, "here")["a"]["link"] == "up"
        stop(there, "there")
    finally:
        there.close()
    stop(here, "here")


def test_killed_and_started_again_under_load(vcan, canwired, can_socket):
    vcan(2)
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    for _ in range(3):
        daemon = canwired(TWO + "  - { name: load, traffic: [ { send: 700#, every: 200us } ] }\n")
        gearbox.drain()
        written = frames(0x123, 500)
        engine.send(*written[:300])
        gearbox.receive(50)
        engine.send(*written[300:])
        daemon.process.send_signal(signal.SIGKILL)
        daemon.process.wait()
    daemon = canwired(TWO)
    gearbox.drain()
    engine.send(*written)
    assert gearbox.receive(500) == written
    stop(daemon)


# ---- Resources -----------------------------------------------------------------------------------

MANY = 64


def many(count=MANY, more=""):
    lines = [f"  - {{ name: n{i}, port: vcan{i}{more} }}\n" for i in range(count)]
    return ("bus: { name: limits, bitrate: 1000000 }\ncontrol: limits.sock\nnodes:\n"
            + "".join(lines))


def test_sixty_four_ports(vcan, canwired, can_socket):
    vcan(MANY)
    daemon = canwired(many())
    ecus = [can_socket(f"vcan{i}") for i in range(MANY)]
    written = [Frame.parse(f"{0x100 + i:03X}#{i:02X}") for i in range(MANY)]
    for ecu, frame in zip(ecus, written):
        ecu.send(frame)
    for i, ecu in enumerate(ecus):
        got = ecu.receive(MANY - 1)
        assert sorted(got) == sorted(written[:i] + written[i + 1 :]), f"vcan{i}"
    ip(*(f"link set vcan{i} down" for i in range(0, MANY, 2)))
    wait_until(lambda: [n["link"] for n in nodes(daemon).values()] == ["down", "up"] * (MANY // 2),
               "every other node to leave")
    ecus[1].send(Frame.parse("7FF#"))
    assert ecus[MANY - 1].receive(1) == [Frame.parse("7FF#")]
    ip(*(f"link set vcan{i} up" for i in range(0, MANY, 2)))
    wait_until(lambda: {n["link"] for n in nodes(daemon).values()} == {"up"}, "all")
    stop(daemon)


def ends_clearly(daemon, words):
    """Waits until it runs, or ends with these words; returns True when it ran."""
    def runs():
        return " bit/s, " in daemon.errors.read_text()

    wait_until(lambda: runs() or daemon.process.poll() is not None, "READY=1")
    if daemon.process.poll() is None:
        daemon.process.terminate()
        daemon.process.wait()
    status = daemon.process.returncode
    if runs():
        assert status == 0, daemon.stderr()
        return True
    text = daemon.errors.read_text()
    by_the_linker = "error while loading shared libraries" in text or "ld.so" in text
    assert status == (127 if by_the_linker else 1), (status, text)
    assert re.search(words, text), text
    return False


def test_too_few_file_descriptors(vcan, tmp_path):
    """Whatever the limit is that it runs into, it says so."""
    ports = 8
    vcan(ports)
    ran = []
    for limit in range(4, 60, 3):
        folder = tmp_path / str(limit)
        folder.mkdir()
        daemon = Daemon(folder, many(ports), before=["prlimit", f"--nofile={limit}", "--"])
        try:
            ran.append(ends_clearly(daemon, "Too many open files"))
        finally:
            daemon.close()
    assert not ran[0] and ran[-1] and ran == sorted(ran)


@pytest.mark.deep
def test_too_little_memory(vcan, tmp_path):
    """Queues of 4096 frames each take about 30 MB."""
    vcan(MANY)
    ran = []
    for limit in range(8, 200, 12):
        folder = tmp_path / str(limit)
        folder.mkdir()
        daemon = Daemon(folder, many(more=", queue: 4096"),
                        before=["prlimit", f"--as={limit << 20}", "--"])
        try:
            ran.append(ends_clearly(daemon, "(?i)out of memory|cannot allocate memory|cannot map"
                                            "|failed to map"))
        finally:
            daemon.close()
    assert not ran[0] and ran[-1] and ran == sorted(ran)
