# SPDX-License-Identifier: MIT
"""Programs that send without loopback: a vcan drops their frames in silence.

The interface counts them; canwired reports these frames and no others.
"""

import re
import signal
import socket
import subprocess

import pytest

from canbits import Frame
from conftest import PATIENCE_S, CanSocket, assert_balance, ip, wait_until
from test_faults import CANWIRE, Shell

CAN_RAW_LOOPBACK = 3
BUS = """
bus: { name: quiet, bitrate: 1000000 }
control: quiet.sock
lcm: { period: 50ms }
nodes:
  - { name: engine, port: vcan0 }
  - { name: dash, port: vcan1 }
"""
OTHERS = Frame.parse("100#01"), Frame.parse("100#02")


@pytest.fixture(name="silent")
def fixture_silent():
    """silent("vcan0") is a socket without loopback."""
    opened = []

    def make(interface):
        opened.append(CanSocket(interface))
        opened[-1].socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_LOOPBACK, 0)
        return opened[-1]

    yield make
    for each in opened:
        each.close()


def loopless(daemon):
    nodes = Shell(daemon).nodes("quiet")
    for node in nodes.values():
        assert_balance(node)
    return [node["interface"]["loopless"] for node in nodes.values()]


def told(log):
    """Returns how many a log tells of, in one line or several."""
    return sum(map(int, re.findall(r"node engine: (?:in \d+ s: )?(\d+) sent without", log)))


def test_they_are_counted_and_told(vcan, canwired, can_socket, silent, listen):
    """Those that were sent before canwired came do not count; the others arrive as ever."""
    listener = listen("quiet")
    vcan(2)
    engine, dash, quiet = can_socket("vcan0"), can_socket("vcan1"), silent("vcan0")
    quiet.send(*[Frame.parse("123#")] * 7)
    daemon = canwired(BUS)
    for _ in range(5):
        engine.send(OTHERS[0])
        quiet.send(Frame.parse("123#"))
        dash.send(OTHERS[1])
    assert dash.receive(5) == [OTHERS[0]] * 5
    wait_until(lambda: loopless(daemon) == [5, 0], "the count")
    wait_until(lambda: told(daemon.stderr()) == 5, "the warning")
    warning = "sent without loopback (cangen -x) and lost, as on any vcan: use vxcan"
    assert warning in daemon.stderr()
    text = Shell(daemon).run("status", "quiet")
    assert "    5 frames sent without loopback have not reached the bus: use vxcan\n" in text
    assert re.search(r"1: engine@vcan0:(.*\n)+?    TX:.*\n +\d+ +5 +\d+ +5 ", text)
    listener.wait_node("engine", lambda m: m.dropped_loopless == 5, "the count over LCM")
    quiet.send(Frame.parse("123#"))
    wait_until(lambda: loopless(daemon) == [6, 0], "one more")
    assert told(daemon.stop()) == 6


def test_cangen_without_loopback(vcan, canwired):
    vcan(2)
    daemon = canwired(BUS)
    subprocess.run(["cangen", "vcan1", "-x", "-g", "0", "-n", "5"], check=True)
    wait_until(lambda: loopless(daemon) == [0, 5], "the count")
    daemon.stop()


def test_nothing_else_is_taken_for_one(vcan, canwired, can_socket):
    """Frames that the kernel has lost, that collide, FD and error frames, what canwired writes."""
    vcan(2, mtu=72)
    daemon = canwired(BUS)
    engine, other, dash = can_socket("vcan0"), can_socket("vcan0"), can_socket("vcan1")
    engine.allow_fd()
    daemon.process.send_signal(signal.SIGSTOP)
    for _ in range(10):  # more than any receive buffer has room for
        engine.send(*[Frame.parse("123#0102030405060708")] * 2000)
        other.send(*[Frame.parse("124#")] * 2000)
    daemon.process.send_signal(signal.SIGCONT)
    shell = Shell(daemon)

    def settled():
        nodes = shell.nodes("quiet")
        return all(n["queue"] == n["inbox"] == 0 for n in nodes.values()) and nodes

    wait_until(settled, "room for what must not be lost")
    for _ in range(50):
        engine.send_raw(bytes.fromhex("230100002000000000") + bytes(63))
        other.send(Frame(0x20000004, 8, bytes(8)))
        dash.send(*OTHERS)
    wait_until(lambda: shell.nodes("quiet")["engine"]["interface"]["errors_ignored"] == 50,
               "the error frames")
    nodes = wait_until(settled, "the end of the queues")
    assert nodes["engine"]["interface"]["kernel_dropped"] > 0
    assert nodes["engine"]["dropped"]["bad-frame"] > 0
    log = daemon.stop()
    assert "sent without loopback" not in log


def test_an_interface_that_is_made_anew_counts_anew(vcan, canwired, silent):
    vcan(2)
    daemon = canwired(BUS)
    silent("vcan0").send(*[Frame.parse("123#")] * 3)
    wait_until(lambda: loopless(daemon) == [3, 0], "the count")
    ip("link del vcan0", "link add vcan0 type vcan", "link set vcan0 up")
    wait_until(lambda: Shell(daemon).nodes("quiet")["engine"]["link"] == "up", "vcan0 again")
    silent("vcan0").send(*[Frame.parse("123#")] * 2)
    wait_until(lambda: loopless(daemon) == [5, 0], "both counts")
    daemon.stop()


def test_on_vxcan_they_arrive(canwired, can_socket, silent):
    ip("link add vx0 type vxcan peer name ecu0", "link add vx1 type vxcan peer name ecu1",
       *(f"link set {name} up" for name in ("vx0", "ecu0", "vx1", "ecu1")))
    try:
        daemon = canwired(BUS.replace("vcan", "vx"))
        quiet, dash = silent("ecu0"), can_socket("ecu1")
        quiet.send(*[OTHERS[0]] * 20)
        assert dash.receive(20) == [OTHERS[0]] * 20
        assert loopless(daemon) == [0, 0]
        assert "without loopback" not in daemon.stop()
    finally:
        ip("link del vx0", "link del vx1")


@pytest.mark.parametrize("vxcan, sent", [("no", True), ("yes", False)])
def test_the_direction_that_programs_see(canwired, can_socket, tmp_path, vxcan, sent):
    """`canwire vcan up` makes what is asked for by one key. The flag is what candump -x
    shows as TX and python-can as not is_rx."""
    text = f"vxcan: {vxcan}\n" + BUS.replace("vcan", "port")
    file = tmp_path / "bus.yaml"
    file.write_text(text)
    own = {"no": ("port0", "port1"), "yes": ("engine", "dash")}[vxcan]
    subprocess.run([CANWIRE, "vcan", "up", file], check=True)
    try:
        daemon = canwired(text)
        engine, dash = map(can_socket, own)
        engine.send(OTHERS[0])
        dash.socket.settimeout(PATIENCE_S)
        packed, _, flags, _ = dash.socket.recvmsg(16)
        assert Frame.unpack(packed) == OTHERS[0]
        assert bool(flags & socket.MSG_DONTROUTE) == sent
        daemon.stop()
    finally:
        subprocess.run([CANWIRE, "vcan", "down", file], check=True)


def test_the_counters_are_readable_in_the_service(tmp_path):
    """Counts interfaces where /proc shows only processes."""
    script = ('mount -t proc -o subset=pid,hidepid=invisible proc "$1" && '
              'grep -c : "$1/self/net/dev"')
    run = subprocess.run(["unshare", "-m", "sh", "-c", script, "sh", tmp_path], check=True,
                         capture_output=True, text=True)
    assert int(run.stdout) > 0
