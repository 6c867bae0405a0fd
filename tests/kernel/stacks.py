# SPDX-License-Identifier: MIT
"""Transport protocols as programs use them, for the tests of stacks over canwired.

The protocols have timers of their own. The kernel's timer for a flow control or the next
consecutive frame is fixed at 1 s. On a machine that stands still for longer a transfer fails
although nothing is lost. So a transfer is tried again a few times. The tests check each time that
no frame was dropped or lost on the way.
"""

import contextlib
import errno
import socket
import struct
import time

import can
import pytest

import adapters
from conftest import RECEIVE_BUFFER_BYTES, SO_RCVBUFFORCE, assert_balance, wait_until
from test_faults import Shell

SOL_CAN_ISOTP, CAN_ISOTP_OPTS, CAN_ISOTP_RECV_FC = 106, 1, 2
CAN_ISOTP_WAIT_TX_DONE = 0x400
REQUEST, RESPONSE = 0x7E0, 0x7E8
TRIES = 6
PATIENCE_S = 30  # for one transfer; the protocol gives up much earlier
# Errors of the kernel's protocols for a failed transfer. The second line is J1939's: a session that
# failed is still there, its peer has not answered, or has sent what does not fit.
STOPPED = {errno.ECOMM, errno.ETIMEDOUT, errno.EILSEQ, errno.EBADMSG, errno.EPROTO, errno.ENODATA,
           errno.ECONNRESET, errno.EALREADY, errno.EHOSTUNREACH, errno.ENOTRECOVERABLE,
           errno.ENOTCONN}


def payload(size, seed=0):
    return bytes((i * 7 + i // 256 + seed) & 0xFF for i in range(size))


class Failed(Exception):
    """A failed transfer."""


class IsotpSocket:
    """Kernel ISO-TP, with the block size and STmin that it requests from the other side."""

    def __init__(self, interface, rx, tx, block_size=0, stmin=0):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_ISOTP)
        self.socket.setsockopt(SOL_CAN_ISOTP, CAN_ISOTP_OPTS,
                               struct.pack("=IIBBBB", CAN_ISOTP_WAIT_TX_DONE, 0, 0, 0, 0, 0))
        self.socket.setsockopt(SOL_CAN_ISOTP, CAN_ISOTP_RECV_FC,
                               struct.pack("=BBB", block_size, stmin, 0))
        self.socket.bind((interface, rx, tx))
        self.socket.settimeout(PATIENCE_S)

    def send(self, data):
        """Sends a message; returns when the last frame has been written."""
        with failing():
            self.socket.send(data)

    def receive(self):
        with failing():
            return self.socket.recv(5000)  # whole: a message

    def drain(self):
        """Discards the rest of a failed transfer."""
        self.socket.setblocking(False)
        while True:
            try:
                self.socket.recv(5000)
            except OSError as error:
                if error.errno == errno.EAGAIN:
                    break
                assert error.errno in STOPPED, error
        self.socket.settimeout(PATIENCE_S)

    def close(self):
        self.socket.close()


@contextlib.contextmanager
def failing():
    try:
        yield
    except TimeoutError as error:
        raise Failed(str(error)) from error
    except OSError as error:
        assert error.errno in STOPPED, error
        raise Failed(str(error)) from error


def tries(transfer, ends, count=TRIES):
    """Repeats a transfer until it succeeds; returns the number of failures."""
    for failures in range(count):
        try:
            transfer()
            return failures
        except Failed:
            time.sleep(1.2)  # no wait: the other side's timer runs out, and the queue empties
            for end in ends:
                end.drain()
    pytest.fail(f"{count} transfers failed, one after the other")


def exchange(client, server, size=4095):
    """Sends a message there and back."""
    def transfer():
        data, answer = payload(size), payload(size, 1)
        client.send(data)
        assert_same(server.receive(), data)
        server.send(answer)
        assert_same(client.receive(), answer)

    return tries(transfer, (client, server))


def break_off(client, server, has_come, size=4095):
    """Sends a message that does not arrive, because of a failure on its way. It repeats this when
    the protocol has given up before that."""
    for _ in range(TRIES):
        with contextlib.suppress(Failed):
            client.send(payload(size))
        with pytest.raises(Failed):
            server.receive()
        if has_come():
            return
        for end in client, server:
            end.drain()
    pytest.fail(f"{TRIES} transfers, and nothing has broken any of them")


def assert_same(got, wanted):
    """Compares messages. The first message of a failed try may come late; no other one may."""
    if got != wanted:
        assert len(got) == len(wanted), (len(got), len(wanted))
        raise Failed("another message")


class Rig:
    """A bus on vcan0 (client), vcan1 (server), and the other nodes of the text."""

    ends = client, server = "vcan0", "vcan1"
    sizes = 1, 7, 8, 200, 1700, 4095, 4095  # of messages
    long = 4095

    def __init__(self, daemon, bus):
        self.daemon, self.bus = daemon, bus
        self.shell = Shell(daemon)

    def sent(self, name):
        """Returns the number of frames that a node has sent in this test."""
        return self.nodes()[name]["tx_frames"]

    def nodes(self):
        return self.shell.nodes(self.bus)

    def run(self, *words, **more):
        return self.shell.run(words[0], self.bus, *words[1:], **more)

    def stop(self, lossless=True):
        """Stops the bus. No frame was lost between program and bus, except for drops by faults."""
        for node in self.nodes().values():
            assert_balance(node)
            if lossless and node["interface"]:
                assert node["dropped"]["queue-full"] == 0, node
                assert node["interface"]["kernel_dropped"] == 0, node
                assert node["interface"]["loopless"] == 0, node
                assert node["interface"]["write_failed"] == 0, node
        return self.daemon.stop()


class UsbRig(Rig):
    """The same on can0 and can1, of a pair of adapters that several tests have. The interfaces are
    as `ip link` makes them: ten frames wait in them at most. A frame costs seven times as much in
    the guest as on vcan, so there are fewer."""

    ends = client, server = "can0", "can1"
    sizes = 7, 4095
    long = 1000

    def __init__(self, pair, bitrate=500000):
        super().__init__(pair.daemon, "usb")
        options = f"bitrate {bitrate} restart-ms 100"
        adapters.batch(*(line for end in self.ends for line in adapters.lines_up(end, options)))
        self.before = self.counts("tx_packets")

    def counts(self, key):
        """Returns what the kernel has counted since it has the interfaces."""
        return {end: adapters.statistics(end)[key] for end in self.ends}

    def sent(self, name):
        end = getattr(self, name)
        return self.counts("tx_packets")[end] - self.before[end]

    def stop(self, lossless=True):
        """Leaves the bus to the next test. The kernel has lost nothing either, and what it has sent
        is what the bus has carried."""
        assert lossless
        for node in wait_until(self.settled, "the last echo").values():
            assert_balance(node)
            for key in "dropped", "rx_dropped":
                assert not any(node[key].values()), node
        for end in self.ends:
            lost = {key: count for key, count in adapters.statistics(end).items()
                    if count and key not in ("rx_bytes", "tx_bytes", "rx_packets", "tx_packets")}
            assert not lost, lost

    def settled(self):
        """Returns the nodes when the kernel knows of all their frames."""
        nodes = self.nodes()
        echoed = self.counts("tx_packets")
        same = [nodes[name]["tx_frames"] == echoed[getattr(self, name)] for name in nodes]
        return nodes if all(same) else None


@pytest.fixture(scope="module", name="pair")
def fixture_pair(quiet_kernel):
    assert quiet_kernel
    pair = adapters.Rig([adapters.node("client", "can0"), adapters.node("server", "can1")])
    pair.wait_for(*UsbRig.ends)
    yield pair
    pair.close()


def over(*kinds):
    """The test runs on buses of these kinds of interface."""
    return pytest.mark.parametrize("rig", kinds, indirect=True)


BUS = """
bus: {{ name: stacks, bitrate: {bitrate} }}
control: stacks.sock
nodes:
  - {{ name: client, port: vcan0{client} }}
  - {{ name: server, port: vcan1{server} }}
{more}
"""


def bus_text(**more):
    return BUS.format(**{"bitrate": 500000, "client": "", "server": "", "more": "", **more})


@contextlib.contextmanager
def python_bus(interface):
    """Opens python-can, with room for frames that come while Python is busy."""
    with can.Bus(interface="socketcan", channel=interface) as bus:
        bus.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
        yield bus
