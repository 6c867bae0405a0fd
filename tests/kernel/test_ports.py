# SPDX-License-Identifier: MIT
"""ECUs on Unix sockets, beside one on vcan."""

import socket
import subprocess

import pytest

from canbits import ERROR, Frame
from conftest import CANWIRED, PATIENCE_S, assert_balance, wait_until
from test_faults import CANWIRE, Shell


class Ecu:
    """A program that connects to a port as canwire-ports(7) describes."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.settimeout(PATIENCE_S)
        # the file exists a moment before the daemon listens
        wait_until(lambda: self.socket.connect_ex(str(path)) == 0, f"who listens at {path}")

    def send(self, *texts):
        for text in texts:
            self.socket.send(Frame.parse(text).pack())

    def receive(self, count):
        """Returns frames, but no error frames."""
        frames = []
        while len(frames) < count:
            packed = self.socket.recv(100)
            assert packed, "the port was closed"
            frames.append(Frame.unpack(packed))
            if frames[-1].can_id & ERROR:
                frames.pop()
        return frames

    def is_closed(self):
        try:
            return self.socket.recv(100) == b""  # whole: a message
        except ConnectionResetError:
            return True

    def close(self):
        self.socket.close()


def frames(*texts):
    return [Frame.parse(text) for text in texts]


def bus(*nodes, more=""):
    return ("bus: { name: faults, bitrate: 500000 }\ncontrol: faults.sock\n" + more + "nodes:\n"
            + "".join(f"  - {node}\n" for node in nodes))


BODY = '{ name: body, port: "unix:body.sock" }'
DASH = "{ name: dash, port: vcan0 }"


@pytest.fixture
def rig(vcan, canwired, can_socket):
    """Returns the daemon, its folder and the socket of the ECU on vcan0."""
    vcan(1)
    daemon = canwired(bus(BODY, DASH))
    return daemon, daemon.config.parent, can_socket("vcan0")


def test_frames_go_both_ways_and_status_balances(rig):
    daemon, folder, dash = rig
    body = Ecu(folder / "body.sock")
    texts = ["123#DEADBEEF", "12345678#", "7FF#R4", "100#1122334455667788_F"]
    body.send(*texts)
    assert sorted(dash.receive(4)) == sorted(frames(*texts))
    dash.send(*frames(*texts))
    assert sorted(body.receive(4)) == sorted(frames(*texts))
    for node in Shell(daemon).nodes().values():
        assert_balance(node)
        assert node["link"] == "up"
        assert node["interface"]["read"] == node["interface"]["written"] == 4
    body.close()
    daemon.stop()
    assert not (folder / "body.sock").exists()


def test_an_ecu_that_was_not_there_has_not_hurt(rig):
    daemon, folder, dash = rig
    dash.send(*frames("100#01"))
    shell = Shell(daemon)
    shell.wait_node("body", lambda n: n["interface"]["unheard"] == 1, "a frame that nobody hears")
    body = Ecu(folder / "body.sock")
    body.send("200#02")
    assert dash.receive(1) == frames("200#02")
    body.close()
    dash.send(*frames("101#01"))
    node = shell.wait_node("body", lambda n: n["interface"]["unheard"] == 2, "another one")
    assert_balance(node)
    again = Ecu(folder / "body.sock")
    dash.send(*frames("102#01"))
    wait_until(lambda: shell.nodes()["body"]["interface"]["connected"] == 2, "the ECU again")
    assert again.receive(1) == frames("102#01")
    again.close()


def test_a_second_ecu_is_refused_and_said_so(rig):
    daemon, folder, _ = rig
    first, second = Ecu(folder / "body.sock"), Ecu(folder / "body.sock")
    assert second.is_closed()
    wait_until(lambda: "1 connection refused" in daemon.stderr(), "the line in the log")
    first.close()
    second.close()


def test_a_reload_keeps_the_connection_and_moves_it_to_a_new_name(rig):
    daemon, folder, dash = rig
    body = Ecu(folder / "body.sock")
    body.send("100#")
    assert dash.receive(1) == frames("100#")
    new = '{ name: door, port: "unix:door.sock" }'
    daemon.config.write_text(bus(BODY.replace("body,", "trunk,"), new, DASH))
    Shell(daemon).run("reload", "faults")
    wait_until(lambda: (folder / "door.sock").exists(), "the new port")
    door = Ecu(folder / "door.sock")
    body.send("101#")
    assert door.receive(1) == dash.receive(1) == frames("101#")
    daemon.config.write_text(bus(DASH))
    Shell(daemon).run("reload", "faults")
    wait_until(lambda: not (folder / "door.sock").exists(), "the old port to go")
    assert body.is_closed() and door.is_closed()


@pytest.mark.parametrize("pacing", ["tick", "spin"])
def test_frames_go_both_ways_with_every_pacing(vcan, canwired, can_socket, pacing):
    vcan(1)
    daemon = canwired(bus(BODY, DASH, more=f"pacing: {pacing}\n"))
    dash, body = can_socket("vcan0"), Ecu(daemon.config.parent / "body.sock")
    texts = [f"{n:03X}#{n:04X}" for n in range(1, 16)]
    body.send(*texts)
    assert dash.receive(15) == frames(*texts)
    dash.send(*frames(*texts))
    assert body.receive(15) == frames(*texts)
    body.close()


def test_an_inherited_socket_is_a_port(vcan, can_socket, tmp_path):
    vcan(1)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    config = tmp_path / "bus.yaml"
    config.write_text(bus(f'{{ name: body, port: "fd:{theirs.fileno()}" }}', DASH))
    with subprocess.Popen([CANWIRED, "-c", config], pass_fds=[theirs.fileno()],
                          stderr=subprocess.PIPE, text=True) as daemon:
        theirs.close()
        dash = can_socket("vcan0")
        wait_until(lambda: (tmp_path / "faults.sock").exists(), "the daemon")
        ours.send(Frame.parse("123#CAFE").pack())
        assert dash.receive(1) == frames("123#CAFE")
        daemon.terminate()
        assert daemon.wait(PATIENCE_S) == 0
    ours.settimeout(PATIENCE_S)
    assert ours.recv(100) == b""  # whole: a message
    ours.close()


def test_only_interfaces_are_made_and_listed(vcan, tmp_path):
    config = tmp_path / "bus.yaml"
    config.write_text(bus(BODY, '{ name: b, port: "fd:7" }', DASH))
    listed = subprocess.run([CANWIRE, "check", "--ports", config], stdout=subprocess.PIPE,
                            text=True, check=True).stdout
    assert listed == "vcan0\n"
    made = subprocess.run([CANWIRE, "vcan", "up", config], stdout=subprocess.PIPE, text=True,
                          check=True).stdout
    assert made == "made vcan0\n"
    subprocess.run([CANWIRE, "vcan", "down", config], stdout=subprocess.DEVNULL, check=True)
