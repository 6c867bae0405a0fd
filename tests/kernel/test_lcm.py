# SPDX-License-Identifier: MIT
"""The messages about a bus for a Python program that subscribes to LCM."""

import json
import signal
import socket
import time

from cannelloni import Datagrams, pack
from canbits import Frame, wire_bits
from conftest import wait_until
from ports import free_port
from test_faults import Shell

# Slow, so that no event is lost on its way to a subscriber on a busy machine.
LONELY = """
bus: { name: lonely, bitrate: 50000 }
nodes: [ { name: hermit, port: vcan0 } ]
lcm: { period: 100ms, events: [error, state] }
"""


def test_all_three_messages(vcan, can_socket, canwired, listen):
    vcan(2)
    started_us = int(time.time() * 1e6)
    messages = listen("types")
    daemon = canwired("""
bus: { name: types, bitrate: 250000 }
nodes:
  - { name: a, port: vcan0 }
  - { name: b, port: vcan1 }
lcm: { period: 100ms, events: [rx, tx] }
""")
    frame = Frame.parse("123#DEADBEEF")
    can_socket("vcan0").send(frame)
    bus = messages.wait_bus(lambda m: m.frames == 1, "the frame")
    messages.wait_node("b", lambda m: m.rx_frames == 1, "the receiver")
    daemon.stop()

    bits = wire_bits(frame)
    assert (bus.bus, bus.bitrate_bps) == ("types", 250000)
    assert (bus.frame_bits, bus.busy_bits, bus.error_frames) == (bits, bits + 3, 0)
    assert bus.utime_us > started_us
    assert bus.bus_time_ns == bus.bits * 4000

    a, b = messages.node("a"), messages.node("b")
    assert (a.bus, a.node, a.port, a.state) == ("types", "a", "vcan0", "error-active")
    assert (a.handed_in, a.tx_frames, a.tx_bytes, a.tx_bits) == (1, 1, 4, bits)
    assert (b.rx_frames, b.rx_bytes, b.handed_in) == (1, 4, 0)
    assert a.delay_count == 1
    assert bits * 4000 <= a.delay_min_ns == a.delay_mean_ns == a.delay_max_ns

    assert [(e.event, e.node, e.bus) for e in messages.events] == [
        ("rx", "b", "types"),
        ("tx", "a", "types"),
    ]
    for event in messages.events:
        line = json.loads(event.json)
        assert (line["event"], line["node"]) == (event.event, event.node)
        assert line["frame"] == "123#DEADBEEF"
        assert round(line["t"] * 1e9) == event.bus_time_ns
    rx, tx = messages.events
    assert tx.bus_time_ns - rx.bus_time_ns == 4000


# fifo keeps 100 behind 400, so 200 and then 400 win though it is pending. Then a bit of 500 is
# flipped, once.
IMPROPER = """
bus: { name: order, bitrate: 500000 }
nodes:
  - name: fifo
    order: fifo
    traffic: [ { send: 400#00 }, { send: 100#00 } ]
  - name: rival
    traffic: [ { send: 200#00 }, { send: 500#00, offset: 50ms } ]
faults:
  - { name: flip, when: { frame: "500", count: 1 }, do: { flip: "data[0.3]" } }
lcm: { period: 50ms, events: [improper-arbitration] }
"""


def test_improper_arbitrations_and_the_error_rate_of_a_bus(canwired, listen):
    messages = listen("order")
    daemon = canwired(IMPROPER)
    wait_until(lambda: next((m for m in messages.quality if m.error_rate_ppm), None), "an error")
    messages.wait_bus(lambda m: m.frames == 4, "all frames")
    daemon.stop()
    last = messages.quality[-1]
    assert last.bus == "order"
    assert last.improper_arbitrations == 2
    assert last.error_rate_ppm == 1_000_000 // (4 + 1)
    assert last.undetected_expected_ppt == 47
    assert [json.loads(e.json)["frame"] for e in messages.events] == ["200#00", "400#00"]


# The slave's clock starts 500 later than the master's, and is right.
SLOTS = """
bus: { name: slots, bitrate: 500000 }
nodes:
  - name: master
    time-triggered: on
    local-time: { bits: 32 }
    schedule: { reference: "010", triggers: [ { at: 5000, slot: 100us, send: 010# } ] }
  - name: slave
    time-triggered: on
    local-time: { bits: 32, start: 500 }
    schedule: { reference: "010", triggers: [ { at: 1000, slot: 50us, send: 200# } ] }
  - { name: plain }
lcm: { period: 50ms, events: [] }
"""


def test_local_times_and_slots(canwired, listen):
    messages = listen("slots")
    daemon = canwired(SLOTS)
    wait_until(lambda: any(m.sent > 3 and m.global_time >= 0 for m in messages.times
                           if m.node == "slave"), "slots of the slave")
    daemon.stop()
    assert {m.node for m in messages.times} == {"master", "slave"}
    last = [m for m in messages.times if m.node == "slave"][-1]
    assert (last.bus, last.master, last.missed, last.failed) == ("slots", "master", 0, 0)
    assert last.local_time == 500 + last.bus_time_ns // 1000
    assert abs(last.global_time - last.bus_time_ns // 1000) <= 1
    assert last.captures >= 2 * last.sent and last.references >= last.sent
    assert last.slots - last.sent in (0, 1)  # one may be under way
    assert last.late_max_ns < 2000  # a bit


TUNNEL = """
bus: {{ name: far, bitrate: 500000 }}
control: far.sock
nodes:
  - {{ name: far, port: "cannelloni:udp,listen={port},peer=127.0.0.1:{peer},timeout=2ms" }}
  - {{ name: lamp, traffic: [ {{ send: 123#11, every: 20ms }} ] }}
lcm: {{ period: 50ms }}
"""
NAMES = ("packets_read", "missing", "late", "duplicate", "restarts", "malformed", "strangers")


def test_what_is_known_of_a_tunnel(canwired, listen):
    end, port = Datagrams(), free_port(socket.SOCK_DGRAM)
    messages = listen("far", tunnels=True)
    daemon = canwired(TUNNEL.format(port=port, peer=end.port))
    end.to(port)
    for number in 0, 3, 2, 3:  # 1 does not come, 2 is late, and 3 comes twice
        end.send(number, pack(number))
    end.socket.send(b"wrong")
    end.receive()  # of lamp
    want = (3 + 1, 2, 1, 1, 0, 1, 0)
    last = wait_until(lambda: next((m for m in messages.tunnels if m.packets_written > 0 and
                                    tuple(getattr(m, name) for name in NAMES) == want), None),
                      "tunnel_t")
    assert (last.bus, last.node, last.state) == ("far", "far", "up")
    assert last.held_max_ns >= last.held_last_ns >= 2000000  # the timeout
    assert last.waited_max_ns >= last.waited_last_ns >= 0
    assert {m.node for m in messages.tunnels} == {"far"}
    status = json.loads(Shell(daemon).run("status", "far", "--json"))
    tunnel = next(node["tunnel"] for node in status["nodes"] if node["name"] == "far")
    assert tuple(tunnel[name] for name in NAMES) == want
    daemon.stop()


def check_sum(node):
    dropped = sum(getattr(node, name) for name in DROPS)
    assert node.handed_in == node.tx_frames + node.queue + dropped, node.node


DROPS = ["dropped_queue_full", "dropped_one_shot", "dropped_bus_off"]
DROPS += ["dropped_listen_only", "dropped_bad_frame", "dropped_fault"]


def test_what_was_handed_in_is_sent_queued_or_dropped(vcan, can_socket, canwired, listen):
    vcan(2)
    messages = listen("sums")
    writer, reader = can_socket("vcan0"), can_socket("vcan1")
    daemon = canwired("""
bus: { name: sums, bitrate: 500000 }
nodes:
  - { name: writer, port: vcan0, queue: 8 }
  - { name: reader, port: vcan1 }
  - name: urgent
    traffic: [ { send: 001#00, every: 300us } ]
  - name: flood
    queue: 4
    traffic: [ { send: 7FF#1122334455667788, every: 50us } ]
  - name: deaf
    listen-only: on
    traffic: [ { send: 002#, every: 10ms } ]
lcm: { period: 50ms, events: [] }
""")
    written = []
    writer.send(Frame(0x800, 0))

    def overflow():
        more = [Frame.parse(f"100#{len(written) + i:04X}") for i in range(100)]
        writer.send(*more)
        written.extend(more)
        return (node := messages.node("writer")) and node.dropped_queue_full > 0

    wait_until(overflow, "a queue that is full")
    messages.wait_node("flood", lambda m: m.tx_frames > 1000, "traffic")
    wait_until(lambda: len(messages.nodes) > 5 * 3, "statistics")
    bus, nodes = messages.wait_final(daemon.stop())
    for node in messages.nodes:
        check_sum(node)
    assert nodes["writer"].handed_in == len(written) + 1
    assert nodes["writer"].dropped_bad_frame == 1
    assert nodes["flood"].dropped_queue_full > 0
    assert nodes["deaf"].dropped_listen_only == nodes["deaf"].handed_in > 0
    assert nodes["urgent"].dropped_queue_full == 0
    assert bus.frames == sum(n.tx_frames for n in nodes.values())
    assert bus.pending == sum(n.queue for n in nodes.values())
    assert bus.frame_bits == sum(n.tx_bits for n in nodes.values())
    assert nodes["reader"].rx_frames == bus.frames
    received = reader.receive(bus.frames)
    assert len(received) == bus.frames
    from_writer = [f for f in received if f.can_id == 0x100]
    assert len(from_writer) == nodes["writer"].tx_frames
    assert from_writer == [f for f in written if f in from_writer]


def test_a_node_alone_becomes_error_passive_and_stays_so(vcan, can_socket, canwired, listen):
    vcan(1)
    messages = listen("lonely")
    daemon = canwired(LONELY)
    ecu = can_socket("vcan0")
    ecu.send(Frame.parse("123#DEADBEEF"))
    messages.wait_node("hermit", lambda m: m.ack_errors > 200, "200 failed attempts")
    bus, nodes = messages.wait_final(daemon.stop())
    hermit = nodes["hermit"]
    assert (hermit.tec, hermit.rec, hermit.state) == (128, 0, "error-passive")
    assert (hermit.error_warning, hermit.error_passive, hermit.bus_off) == (1, 1, 0)
    assert (hermit.tx_frames, hermit.queue, hermit.handed_in) == (0, 1, 1)
    assert (bus.frames, bus.pending) == (0, 1)
    assert hermit.retransmissions >= hermit.ack_errors - 1
    assert all(m.tec <= 128 for m in messages.nodes)
    check_sum(hermit)

    events = [json.loads(e.json) for e in messages.events]
    climb = [e["tec"] for e in events if e["event"] == "error"]
    assert climb[:16] == list(range(8, 129, 8))
    assert set(climb[16:]) == {128}
    assert [e["state"] for e in events if e["event"] == "state"] == [
        "error-warning",
        "error-passive",
    ]


def test_nodes_keep_their_counts_when_a_reload_moves_them(vcan, can_socket, canwired, listen):
    vcan(2)
    messages = listen("moved")
    text = """
bus: { name: moved, bitrate: 250000 }
nodes:
"""
    a, b = "  - { name: a, port: vcan0 }\n", "  - { name: b, port: vcan1 }\n"
    more = "lcm: { period: PERIOD, events: [tx] }\n"
    daemon = canwired(text + a + b + more.replace("PERIOD", "100ms"))
    frame = Frame.parse("123#DEADBEEF")
    can_socket("vcan0").send(*[frame] * 10)
    messages.wait_node("a", lambda m: m.tx_frames == 10, "the frames")
    daemon.config.write_text(text + "  - { name: new }\n" + b + a + more.replace("PERIOD", "50ms"))
    daemon.notifications.clear()
    daemon.process.send_signal(signal.SIGHUP)
    messages.wait_node("new", lambda m: m.tx_frames == 0, "the new configuration")
    can_socket("vcan1").send(frame)
    messages.wait_node("b", lambda m: m.tx_frames == 1, "a frame of the other node")
    last = messages.wait_final(daemon.stop())[1]
    assert {n: (m.tx_frames, m.rx_frames) for n, m in last.items()} == {
        "a": (10, 1), "b": (1, 10), "new": (0, 1)}
    assert all(0 <= m.load_period_permille <= 1000 for m in messages.nodes)
    assert [e.node for e in messages.events] == ["a"] * 10 + ["b"]
