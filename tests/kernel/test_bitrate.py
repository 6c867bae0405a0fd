# SPDX-License-Identifier: MIT
"""A saturated bus carries what its bit rate allows: to the frame, and to the bit."""

import pytest

from canbits import INTEGRATION_BITS, Frame, Source, predict, slot_bits, wire_bits
from conftest import PATIENCE_S
from depth import DEEP

SECONDS = 10 if DEEP else 4  # of bus time
BETWEEN_S = 2  # of bus time at most, from one message to the next: their period, and catch-up's 1 s
TRAFFIC = {
    "load0": ["0A5#1122334455667788", "5F0#0000000000000000"],
    "load1": ["0AAAAAA5#DEADBEEF12345678", "7FF#FFFFFFFFFFFFFFFF"],
}


def saturating(bitrate):
    """Returns traffic that fills SECONDS of bus time and hands in a little more than the bus
    carries."""
    texts = [(node, text) for node, of_node in TRAFFIC.items() for text in of_node]
    budget = SECONDS * bitrate - INTEGRATION_BITS
    cycle = sum(slot_bits(Frame.parse(text)) for _, text in texts)
    sources, left = [], budget % cycle
    for node, text in texts:
        frame, count = Frame.parse(text), budget // cycle
        if slot_bits(frame) <= left:  # the last cycle is not complete
            left -= slot_bits(frame)
            count += 1
        sources.append(Source(node, frame, cycle - 1, count))
    return sources


def configuration(bus, interface, bitrate, sources):
    nodes = ""
    for node, texts in TRAFFIC.items():
        nodes += f"  - name: {node}\n    queue: 4096\n    traffic:\n"
        for text in texts:
            s = next(s for s in sources if s.frame == Frame.parse(text))
            nodes += f"      - {{ send: {text}, every: {s.every}bit, "
            nodes += f"offset: {s.offset}bit, count: {s.count} }}\n"
    return f"""
bus: {{ name: {bus}, bitrate: {bitrate} }}
nodes:
  - {{ name: receiver, port: {interface} }}
{nodes}
lcm: {{ period: 500ms }}
"""


class Bus:
    """A canwired with such traffic, an ECU that receives it, and its statistics."""

    def __init__(self, interface, bitrate, can_socket, listen, canwired):
        name = f"rate{bitrate}"
        self.bitrate, self.sources = bitrate, saturating(bitrate)
        self.receiver, self.messages = can_socket(interface), listen(name)
        self.daemon = canwired(configuration(name, interface, bitrate, self.sources))

    def check(self):
        order, end_bit = predict(self.sources)
        assert end_bit == INTEGRATION_BITS + sum(map(slot_bits, order)), "there were gaps"
        assert SECONDS * self.bitrate - min(map(slot_bits, order)) < end_bit
        assert end_bit <= SECONDS * self.bitrate
        assert self.receiver.receive(len(order), timeout_s=PATIENCE_S * 10) == order
        self.messages.wait_bus(lambda m: m.bits > end_bit, "the end of the window")
        bus, nodes = self.messages.wait_final(self.daemon.stop())
        assert bus.frames == len(order)
        assert bus.frame_bits == sum(map(wire_bits, order))
        assert bus.busy_bits == end_bit - INTEGRATION_BITS
        assert (bus.error_frames, bus.overload_frames, bus.pending) == (0, 0, 0)
        assert nodes["receiver"].rx_frames == len(order)
        assert nodes["receiver"].dropped_rx == 0
        for name in TRAFFIC:
            node, own = nodes[name], [s for s in self.sources if s.node == name]
            assert node.handed_in == node.tx_frames == sum(s.count for s in own)
            assert node.tx_bits == sum(s.count * wire_bits(s.frame) for s in own)
        check_load(self.messages.bus, end_bit)
        assert not self.receiver.drain()


@pytest.mark.parametrize("bitrates", [(1000000,), (125000, 250000, 500000)], ids=str)
def test_seconds_of_saturated_buses(bitrates, vcan, can_socket, canwired, listen):
    """The three slower ones at the same time have fewer frames than the fast one."""
    interfaces = vcan(len(bitrates))
    buses = [Bus(*pair, can_socket, listen, canwired) for pair in zip(interfaces, bitrates)]
    for bus in buses:
        bus.check()


def check_load(statistics, end_bit):
    """Checks that every bit after the integration is busy during the traffic."""
    during = [m for m in statistics if INTEGRATION_BITS < m.bits <= end_bit]
    assert len(during) >= SECONDS // BETWEEN_S
    for m in during:
        assert m.busy_bits == m.bits - INTEGRATION_BITS
    for m in during[1:]:
        assert m.load_period_permille == 1000
