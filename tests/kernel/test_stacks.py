# SPDX-License-Identifier: MIT
"""ISO-TP, UDS, J1939 and CANopen as they are, over canwired.

On vcan they write whole messages at once, and none of their frames may get lost. On a real can0 the
interface has little room, and they must live with that as on hardware.
"""

import contextlib
import errno
import socket
import threading
import time

import can
import canopen
import isotp
import pytest
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import IsoTPSocketConnection, PythonIsoTpConnection

import stacks
from adapters import fixture_quiet_kernel  # pylint: disable=unused-import
from conftest import ip, wait_until
from stacks import (REQUEST, RESPONSE, Failed, IsotpSocket, Rig, UsbRig, break_off, bus_text,
                    exchange, fixture_pair,  # pylint: disable=unused-import
                    over, payload, python_bus, tries)

MESSAGE = 4095  # bytes: 1 first and 585 consecutive frames


@pytest.fixture(name="rig")
def fixture_rig(request):
    """rig() makes a bus, on vcan unless the test asks for others by `over`."""
    if getattr(request, "param", "vcan") == "usb":
        pair = request.getfixturevalue("pair")
        return lambda **more: UsbRig(pair, **more)
    vcan, canwired = map(request.getfixturevalue, ("vcan", "canwired"))
    vcan(2)
    return lambda **more: Rig(canwired(bus_text(**more)), "stacks")


@pytest.fixture(name="kernel_isotp")
def fixture_kernel_isotp():
    """kernel_isotp(block_size) opens client and server."""
    with contextlib.ExitStack() as opened:

        def start(block_size=0, interfaces=("vcan0", "vcan1")):
            ids = (RESPONSE, REQUEST), (REQUEST, RESPONSE)
            ends = [IsotpSocket(i, *pair, block_size) for i, pair in zip(interfaces, ids)]
            for end in ends:
                opened.callback(end.close)
            return ends

        yield start


# ---- ISO-TP of the kernel ------------------------------------------------------------------------


@over("vcan", "usb")
def test_kernel_isotp(rig, kernel_isotp):
    """Without blocks, as is the kernel's default. A short queue, below, has blocks."""
    r = rig()
    client, server = kernel_isotp(interfaces=r.ends)
    for size in r.sizes:
        exchange(client, server, size)
    assert r.sent("client") >= 586
    r.stop()


# A node that no program uses occupies the bus for this time, once in a message of each direction.
# Frames written meanwhile exceed a short queue on any machine.
HELD = """  - {{ name: idiot }}
faults:
  - {{ name: there, when: {{ frame: "7E0", skip: 100, count: 1 }}, do: {babble} }}
  - {{ name: back, when: {{ frame: "7E8", skip: 100, count: 1 }}, do: {babble} }}
""".format(babble='{ babble: "000#", as: idiot, for: 500ms }')


def test_kernel_isotp_with_a_short_queue(rig, kernel_isotp):
    """The queue of a small controller overflows, and the log has the remedy. Blocks that the queue
    can hold work."""
    r = rig(client=", queue: 16", more=HELD)
    client, server = kernel_isotp()
    break_off(client, server, lambda: r.nodes()["client"]["dropped"]["queue-full"] > 0)
    wait_until(lambda: "queue full (the last one 7E0)" in r.daemon.stderr(), "the warning")
    assert "ISO-TP: STmin or a block size" in r.daemon.stderr()
    wait_until(lambda: r.nodes()["client"]["queue"] == 0, "the rest of it")
    lost = r.nodes()["client"]["dropped"]["queue-full"]
    for end in client, server:
        end.drain()
        end.close()
    client, server = kernel_isotp(8)
    exchange(client, server)
    assert r.nodes()["client"]["dropped"]["queue-full"] == lost
    r.stop(lossless=False)


def test_a_vcan_that_waits(rig, kernel_isotp):
    """when-full: wait leaves what the queue cannot hold in the kernel, and nothing is lost."""
    r = rig(client=", queue: 16, when-full: wait", server=", queue: 1, when-full: wait", more=HELD)
    client, server = kernel_isotp()
    exchange(client, server)
    nodes = [r.nodes()[name] for name in ("client", "server")]
    assert all(node["interface"]["pushed_back"] > 0 for node in nodes)
    assert [node["queue_peak"] for node in nodes] == [16, 1]
    r.stop()


def test_vxcan(canwired, kernel_isotp):
    ip("link add vx0 type vxcan peer name ecu0", "link add vx1 type vxcan peer name ecu1",
       *(f"link set {name} up" for name in ("vx0", "ecu0", "vx1", "ecu1")))
    try:
        r = Rig(canwired(bus_text().replace("vcan", "vx")), "stacks")
        exchange(*kernel_isotp(interfaces=("ecu0", "ecu1")))
        r.stop()
    finally:
        ip("link del vx0", "link del vx1")


# ---- can-isotp and udsoncan ----------------------------------------------------------------------

PATIENT = {"rx_flowcontrol_timeout": 20000, "rx_consecutive_frame_timeout": 20000}  # ms


class Stack(isotp.CanStack):
    """can-isotp with the interface of IsotpSocket."""

    def receive(self):
        data = self.recv(block=True, timeout=stacks.PATIENCE_S)  # whole: a message
        if data is None:
            raise Failed("timeout")
        return bytes(data)

    def drain(self):
        self.reset()


@contextlib.contextmanager
def stack(interface, rx, tx, block_size):
    address = isotp.Address(isotp.AddressingMode.Normal_11bits, rxid=rx, txid=tx)
    with python_bus(interface) as bus:
        layer = Stack(bus, address=address,
                      params={**PATIENT, "blocksize": block_size, "stmin": 0})
        layer.start()
        try:
            yield layer
        finally:
            layer.stop()


@pytest.mark.parametrize("rig, block_size", [("vcan", 0), ("usb", 8)], indirect=["rig"])
def test_python_isotp(rig, block_size):
    """Its default is a block of eight frames. A vcan takes all of them at once."""
    r = rig()
    with (stack(r.client, RESPONSE, REQUEST, block_size) as client,
          stack(r.server, REQUEST, RESPONSE, block_size) as server):
        exchange(client, server, r.long)
    r.stop()


DID, RECORD = 0xF1A0, payload(700, 5)
CONFIG = {**udsoncan.configs.default_client_config, "request_timeout": 20, "p2_timeout": 20,
          "p2_star_timeout": 20, "data_identifiers": {DID: udsoncan.AsciiCodec(len(RECORD))}}


def answer(request):
    """Returns the answer of an ECU to the few services that it has."""
    if request[0] == 0x3E:
        return bytes([0x7E, request[1]])
    if request[0] == 0x22:
        return bytes([0x62]) + request[1:3] + bytes(b & 0x7F for b in RECORD)
    if request[0] == 0x36:
        return bytes([0x76, request[1]]) + request[2:]
    return bytes([0x7F, request[0], 0x11])


def serve(end, stopping):
    while not stopping.is_set():
        with contextlib.suppress(Failed):
            end.send(answer(end.receive()))


@contextlib.contextmanager
def uds_server(end):
    """Ends with the client: a last request wakes it up."""
    stopping = threading.Event()
    thread = threading.Thread(target=serve, args=(end, stopping), daemon=True)
    thread.start()
    try:
        yield stopping
    finally:
        thread.join(60)
        assert not thread.is_alive()


GAVE_UP = (udsoncan.exceptions.TimeoutException, udsoncan.exceptions.UnexpectedResponseException)


def ask_each(client):
    client.tester_present()
    record = client.read_data_by_identifier(DID)
    assert record.service_data.values[DID] == "".join(chr(b & 0x7F) for b in RECORD)
    sent = client.transfer_data(1, payload(1000))
    assert sent.service_data.parameter_records == payload(1000)


def ask_all(connect, stopping):
    """Asks by a connection. A new one is made when ISO-TP has given up: one that has seen an error
    of its socket does not read any more."""
    def transfer():
        try:
            with stacks.failing(), Client(connect(), config=CONFIG) as client:
                ask_each(client)
        except GAVE_UP as error:
            raise Failed(str(error)) from error

    try:
        tries(transfer, ())
    finally:
        stopping.set()
        with contextlib.suppress(*GAVE_UP, OSError), Client(connect(), config=CONFIG) as client:
            client.tester_present()


ADDRESS = isotp.Address(isotp.AddressingMode.Normal_11bits, rxid=RESPONSE, txid=REQUEST)


@over("usb")
def test_uds_over_the_kernel(rig):
    r = rig()
    with (contextlib.closing(IsotpSocket(r.server, REQUEST, RESPONSE)) as server,
          uds_server(server) as stopping):
        ask_all(lambda: IsoTPSocketConnection(r.client, ADDRESS), stopping)
    r.stop()


@pytest.mark.parametrize("rig, block_size", [("vcan", 0), ("usb", 8)], indirect=["rig"])
def test_uds_over_python(rig, block_size):
    r = rig()
    with (stack(r.server, REQUEST, RESPONSE, block_size) as server, python_bus(r.client) as bus,
          uds_server(server) as stopping):
        def connect():
            params = {**PATIENT, "blocksize": block_size}
            return PythonIsoTpConnection(isotp.CanStack(bus, address=ADDRESS, params=params))

        ask_all(connect, stopping)
    r.stop()


# ---- J1939 of the kernel -------------------------------------------------------------------------

PGN = 0x12300  # peer to peer
BROADCAST_PGN = 0xFEF0


class J1939Socket:
    def __init__(self, interface, address):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_J1939)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self.socket.bind((interface, socket.J1939_NO_NAME, socket.J1939_NO_PGN, address))
        self.socket.settimeout(stacks.PATIENCE_S)
        self.interface = interface

    def send(self, data, address, pgn=PGN):
        with stacks.failing():
            self.socket.sendto(data, (self.interface, socket.J1939_NO_NAME, pgn, address))

    def receive(self):
        with stacks.failing():
            return self.socket.recv(5000)  # whole: a message

    drain = IsotpSocket.drain

    def close(self):
        self.socket.close()


SHORT_QUEUE = {"client": ", queue: 16, when-full: wait"}


@pytest.mark.parametrize("rig, more", [("vcan", {}), ("vcan", SHORT_QUEUE), ("usb", {})],
                         indirect=["rig"])
def test_kernel_j1939(rig, more):
    """The longest message of its transport protocol, 255 packets, and one to everybody."""
    r = rig(bitrate=250000, **more)
    one, other = J1939Socket(r.client, 0x20), J1939Socket(r.server, 0x30)
    try:
        for size in 8, 9, 1785:
            def transfer(size=size):
                one.send(payload(size), 0x30)
                stacks.assert_same(other.receive(), payload(size))
                other.send(payload(size, 1), 0x20)
                stacks.assert_same(one.receive(), payload(size, 1))

            tries(transfer, (one, other))

        def broadcast():
            one.send(payload(50), socket.J1939_NO_ADDR, BROADCAST_PGN)
            stacks.assert_same(other.receive(), payload(50))

        tries(broadcast, (one, other))
    finally:
        one.close()
        other.close()
    assert r.sent("client") > 255
    r.stop()


# ---- CANopen -------------------------------------------------------------------------------------

NODE, PDOS = 5, 100
SHORT, LONG, PDO_VALUE = 0x2000, 0x2001, 0x2002


def dictionary():
    types = canopen.objectdictionary
    entries = types.ObjectDictionary()
    for index, kind in ((SHORT, types.UNSIGNED32), (LONG, types.DOMAIN),
                        (PDO_VALUE, types.UNSIGNED32), (0x1017, types.UNSIGNED16)):
        variable = types.ODVariable(f"entry {index:X}", index)
        variable.data_type, variable.access_type, variable.pdo_mappable = kind, "rw", True
        variable.default = None if kind == types.DOMAIN else 0
        entries.add_object(variable)
    for base, kinds in ((0x1800, "com"), (0x1A00, "map")):
        record = types.ODRecord(f"TPDO {kinds}", base)
        for sub, kind in ((0, types.UNSIGNED8), (1, types.UNSIGNED32), (2, types.UNSIGNED8),
                          (3, types.UNSIGNED16), (5, types.UNSIGNED16)):
            member = types.ODVariable(f"{kinds} {sub}", base, sub)
            member.data_type, member.access_type, member.default = kind, "rw", 0
            record.add_member(member)
        entries.add_object(record)
    return entries


@contextlib.contextmanager
def canopen_network(interface):
    network = canopen.Network()
    network.connect(interface="socketcan", channel=interface)
    network.bus.socket.setsockopt(socket.SOL_SOCKET, stacks.SO_RCVBUFFORCE,
                                  stacks.RECEIVE_BUFFER_BYTES)
    try:
        yield network
    finally:
        network.disconnect()


@over("vcan", "usb")
def test_canopen(rig):
    r = rig()
    with canopen_network(r.client) as master, canopen_network(r.server) as slave:
        local = slave.create_node(NODE, dictionary())
        remote = master.add_node(NODE, dictionary())
        remote.sdo.RESPONSE_TIMEOUT = stacks.PATIENCE_S
        remote.sdo[SHORT].raw = 0xDEADBEEF  # expedited
        assert local.sdo[SHORT].raw == remote.sdo[SHORT].raw == 0xDEADBEEF
        remote.sdo[LONG].raw = payload(300)  # segmented, both ways
        assert remote.sdo[LONG].raw == payload(300)
        send_pdos(local, remote)
        send_heartbeats(local, remote)
    r.stop()


def transmit(pdo):
    """An interface with little room refuses frames; a program tries again."""
    while True:
        try:
            return pdo.transmit()
        except can.CanOperationError as error:
            assert error.error_code == errno.ENOBUFS, error
            time.sleep(0.001)  # poll: in a loop


def send_pdos(local, remote):
    for node in local, remote:
        node.tpdo[1].cob_id = 0x180 + NODE
        node.tpdo[1].add_variable(PDO_VALUE)
        node.tpdo[1].enabled = True
    got = []
    remote.tpdo[1].subscribe()
    remote.tpdo[1].add_callback(lambda message: got.append(message[0].raw))
    for value in range(PDOS):
        local.tpdo[1][0].raw = value
        transmit(local.tpdo[1])
    wait_until(lambda: len(got) == PDOS, "all PDOs")
    assert got == list(range(PDOS))


def send_heartbeats(local, remote):
    beats = []
    remote.nmt.add_heartbeat_callback(beats.append)
    local.nmt.state = "PRE-OPERATIONAL"
    local.nmt.start_heartbeat(20)
    wait_until(lambda: len(beats) >= 10, "heartbeats")
    local.nmt.stop_heartbeat()
    assert set(beats) <= {127, 0}
    assert remote.nmt.state == "PRE-OPERATIONAL"
