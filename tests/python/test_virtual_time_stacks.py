# SPDX-License-Identifier: MIT
"""python-can, can-isotp, udsoncan and canopen, unmodified, in virtual time: time-outs are exact."""

import asyncio
import threading
import time

import can
import canopen
import isotp
import pytest
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import PythonIsoTpConnection

from canwire import Bus, VirtualTime
from canwire.virtualtime import _REAL

BUS = "bus: { name: x, bitrate: 500000 }\nnodes: [ { name: ecu }, { name: tester } ]"


@pytest.fixture(name="clock")
def fixture_clock():
    with VirtualTime(Bus.from_yaml(BUS)) as clock:
        yield clock


def node(name, **more):
    return can.Bus(interface="canwire", channel=name, **more)


def message(number=0x123, data=b"\x01\x02", **more):
    return can.Message(arbitration_id=number, data=data, is_extended_id=False, **more)


def test_python_can_receives(clock):
    with node("ecu") as ecu, node("tester") as tester, node("tester") as beside:
        ecu.send(message())
        for bus in (tester, beside):
            got = bus.recv(1)
            assert (got.arbitration_id, bytes(got.data), got.is_rx) == (0x123, b"\x01\x02", True)
            assert got.timestamp == pytest.approx(time.time(), abs=1e-6)
        assert ecu.recv(5) is None
        assert clock.now == pytest.approx(5.000148, abs=1e-6)
        tester.send(message(0x200))  # programs at one node see each other's frames
        assert beside.recv(1).arbitration_id == ecu.recv(1).arbitration_id == 0x200
        assert tester.recv(0.1) is None
        assert ecu.state is can.BusState.ACTIVE
    with node("ecu", receive_own_messages=True) as ecu:
        ecu.send(message(0x300))
        own = ecu.recv(1)
        assert own.arbitration_id == 0x300 and not own.is_rx


def test_python_can_sends_until_the_queue_is_full(clock):
    clock.bus.node("tester").detach()  # nobody acknowledges
    with node("ecu") as ecu:
        with pytest.raises(can.CanOperationError, match="queue of ecu is full"):
            for _ in range(10000):
                ecu.send(message())
        before = clock.now
        with pytest.raises(can.CanOperationError):
            ecu.send(message(), timeout=2)
        assert clock.now == pytest.approx(before + 2, abs=1e-6)
    with pytest.raises(can.CanOperationError, match="closed"):
        ecu.send(message())


def test_python_can_gets_error_frames(clock):
    with node("ecu") as ecu:
        clock.bus.inject(name="off", do={"bus-off": "ecu"})
        got = ecu.recv(1)
        assert got.is_error_frame and got.arbitration_id & 0x40
        assert ecu.state is can.BusState.ERROR


def test_periodic_frames_and_a_notifier(clock):
    with node("ecu") as ecu, node("tester") as tester:
        got = []
        notifier = can.Notifier(tester, [got.append], timeout=1)
        task = ecu.send_periodic(message(), 0.1)
        time.sleep(1.05)
        task.stop()
        notifier.stop()
        times = [one.timestamp for one in got]
        # the bus takes the first frame 11 bits after its start
        assert [b - a for a, b in zip(times, times[1:])] == [pytest.approx(0.1, abs=30e-6)] * 10
    assert clock.now >= 1.05


def test_python_can_with_asyncio(clock):
    async def main():
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(tester, [reader], loop=asyncio.get_running_loop())
        ecu.send(message(0x77))
        got = await asyncio.wait_for(reader.get_message(), 3)
        before = clock.now
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(reader.get_message(), 4)
        notifier.stop()
        return got.arbitration_id, round(clock.now - before, 6)

    with node("ecu") as ecu, node("tester") as tester:
        assert asyncio.run(main()) == (0x77, 4)


def stack(name, txid, rxid):
    address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=txid, rxid=rxid)
    return isotp.CanStack(bus=node(name), address=address)


class Ecu:
    """Answers 0x22 at once, and 0x3E after three seconds."""

    def __init__(self):
        self.stack, self.stop = stack("ecu", 0x7E8, 0x7E0), False
        self.stack.start()
        self.thread = threading.Thread(target=self.serve)
        self.thread.start()

    def serve(self):
        while not self.stop:
            request = self.stack.recv(block=True, timeout=0.5)
            if request and request[0] == 0x22:
                self.stack.send(bytes([0x62]) + request[1:3] + bytes(range(40)))
            elif request and request[0] == 0x3E:
                time.sleep(3)
                self.stack.send(b"\x7e\x00")

    def close(self):
        self.stop = True
        self.thread.join()
        self.stack.stop()
        self.stack.bus.shutdown()


class Bytes(udsoncan.DidCodec):
    def decode(self, string_bin):
        return string_bin

    def __len__(self):
        return 40


def test_isotp_and_uds(clock):
    ecu, tester = Ecu(), stack("tester", 0x7E0, 0x7E8)
    config = dict(udsoncan.configs.default_client_config, data_identifiers={0xF190: Bytes},
                  request_timeout=2, p2_timeout=1)
    with Client(PythonIsoTpConnection(tester), config=config) as client:
        before = clock.now
        found = client.read_data_by_identifier(0xF190)
        assert found.service_data.values[0xF190] == bytes(range(40))
        assert 0.001 < clock.now - before < 0.003  # nine frames of 8 bytes
        before = clock.now
        with pytest.raises(udsoncan.exceptions.TimeoutException, match="P2 timeout"):
            client.tester_present()
        assert clock.now - before == pytest.approx(1, abs=0.001)
    ecu.close()
    tester.bus.shutdown()


def network(name):
    made = canopen.Network()
    made.connect(interface="canwire", channel=name)
    return made


def test_canopen(clock):
    objects = canopen.ObjectDictionary()
    entry = canopen.objectdictionary.ODVariable("x", 0x2000, 0)
    entry.data_type, entry.default = canopen.objectdictionary.UNSIGNED32, 42
    objects.add_object(entry)
    ecu, tester = network("ecu"), network("tester")
    ecu.create_node(5, objects)
    remote = tester.add_node(5, objects)
    before = clock.now
    assert remote.sdo[0x2000].raw == 42
    assert clock.now - before < 0.001
    ecu.disconnect()
    before = clock.now
    with pytest.raises(canopen.SdoCommunicationError, match="No SDO response"):
        _ = remote.sdo[0x2000].raw
    assert clock.now - before == pytest.approx(remote.sdo.RESPONSE_TIMEOUT, abs=1e-6)
    tester.disconnect()


# ---- The rules of python-can ---------------------------------------------------------------------


def test_a_node_gets_no_frames_from_before_it_was_opened(clock):
    clock.bus.send("ecu", "111#")
    time.sleep(1)
    with node("tester") as first:
        clock.bus.send("ecu", "222#")
        time.sleep(1)
        with node("tester") as second:
            clock.bus.send("ecu", "333#")
            assert [first.recv(1).arbitration_id for _ in range(2)] == [0x222, 0x333]
            assert second.recv(1).arbitration_id == 0x333


def test_one_node_has_several_names(clock):
    with node("tester") as one, node("x:tester") as two, node("x", node="tester") as three:
        clock.bus.send("ecu", "111#")
        assert [bus.recv(1).arbitration_id for bus in (one, two, three)] == [0x111] * 3


FD_BUS = "bus: { name: x, bitrate: 500000, dbitrate: 2000000 }\n" \
         "nodes: [ { name: ecu, fd: no }, { name: tester }, { name: other } ]"


def test_frames_are_those_of_their_sender_whatever_becomes_of_them():
    """FD frames are padded, and the controller sets ESI; a dropped frame never comes."""
    with VirtualTime(Bus.from_yaml(FD_BUS.replace(", fd: no", ""))) as clock:
        with node("tester", receive_own_messages=True) as one, node("tester") as two:
            for sent in (message(data=bytes(9), is_fd=True, error_state_indicator=True), message(),
                         message(is_remote_frame=True, data=None, dlc=2)):
                one.send(sent)
                assert not one.recv(1).is_rx and two.recv(1).is_rx
            clock.bus["tester"].set(listen_only=True)
            one.send(message())  # dropped
            assert one.recv(1) is None
            clock.bus["tester"].set(listen_only=False)
            time.sleep(1)
            two.send(message())
            assert one.recv(1).is_rx and two.recv(1) is None


def test_frames_that_a_node_cannot_send_are_errors_of_python_can():
    with VirtualTime(Bus.from_yaml(FD_BUS)), node("ecu") as ecu, node("tester") as tester:
        assert (ecu.protocol, tester.protocol) == (can.CanProtocol.CAN_20, can.CanProtocol.CAN_FD)
        for bus, sent in ((ecu, message(is_fd=True)), (tester, can.Message(is_error_frame=True)),
                          (tester, message(0x800)), (tester, message(data=bytes(9))),
                          (tester, message(is_fd=True, is_remote_frame=True, data=None))):
            with pytest.raises(can.CanOperationError, match="canwire: "):
                bus.send(sent)
        with pytest.raises(can.CanInitializationError, match="no node 'x'; there is ecu, tester"):
            node("x")


def test_filters_let_error_frames_pass(clock):
    filters = [{"can_id": 0x200, "can_mask": 0x7FF, "extended": False}]
    with node("ecu") as ecu, node("tester", can_filters=filters) as tester:
        ecu.send(message(0x100))
        ecu.send(message(0x200))
        time.sleep(1)
        assert tester.recv(0).arbitration_id == 0x200 and tester.recv(0) is None
        clock.bus.inject(name="off", do={"bus-off": "tester"})
        assert tester.recv(1).is_error_frame
    with node("ecu", ignore_rx_error_frames=True) as ecu:
        clock.bus.inject(name="also", do={"bus-off": "ecu"})
        assert ecu.recv(1) is None and ecu.state is can.BusState.ERROR


def test_a_node_keeps_the_rules_of_a_bus(clock):
    ecu, tester = node("ecu"), node("tester")
    assert str(ecu) == "canwire node ecu"
    ecu.send_periodic(message(), 0.1)
    assert [got.arbitration_id for got, _ in zip(tester, range(3))] == [0x123] * 3
    tester.state = can.BusState.PASSIVE
    assert clock.bus["tester"].status.listen_only
    tester.state = can.BusState.ACTIVE
    assert not clock.bus["tester"].status.listen_only and tester.state is can.BusState.ACTIVE
    ended = []

    def read():
        try:
            while True:
                tester.recv()
        except can.CanOperationError as problem:
            ended.append(str(problem))

    reader = threading.Thread(target=read)
    reader.start()
    time.sleep(1)
    for bus in (ecu, tester, ecu, tester):
        bus.shutdown()
    reader.join()
    assert ended == ["the bus is closed"]


def test_a_name_of_python_can_means_a_node_only_in_virtual_time(clock):
    with node("ecu") as ecu:
        assert type(ecu).__name__ == "NodeBus"
        with node("beside", private=True) as one, node("beside", private=True) as two:
            one.send(message())  # a bus of its own, with the same clock
            assert two.recv(1).arbitration_id == 0x123 and ecu.recv(0) is None
        found = []

        def outside():
            with node("elsewhere", private=True) as bus:
                found.append(type(bus).__name__)

        assert clock.now < 0.001
        _REAL.start(thread := threading.Thread(target=outside))  # in real time
        _REAL.join(thread)
        assert found == ["CanwireBus"]


def test_the_nodes_are_channels(clock, write):
    assert [found["channel"] for found in can.detect_available_configs("canwire")] == \
        ["ecu", "tester"] and clock.now == 0
    with pytest.raises(can.CanInitializationError, match="name of a node: ecu, tester"):
        can.Bus(interface="canwire")


def test_a_rig_is_one_virtual_time(write):
    for name in ("one", "two"):
        write(BUS.replace("name: x", f"name: {name}"), f"{name}.yaml")
    rig = Bus.from_yaml(write("buses: [ one.yaml, two.yaml ]\ngateways: [ { name: g, between: "
                              "[ 'one:tester', 'two:ecu' ], rules: [ { filter: '123' } ] } ]\n",
                              "rig.yaml"))
    with VirtualTime(rig), node("one:ecu") as ecu, node("two", node="tester") as tester:
        assert [found["channel"] for found in can.detect_available_configs("canwire")] == \
            ["one:ecu", "one:tester", "two:ecu", "two:tester"]
        ecu.send(message())
        assert tester.recv(1).arbitration_id == 0x123
        with pytest.raises(can.CanInitializationError, match="no node 'ecu'"):
            node("ecu")
