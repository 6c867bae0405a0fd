# SPDX-License-Identifier: MIT
"""Rigs whose buses go on in strides: they show what small steps (--step) show."""

import json
import random
import subprocess

import pytest

from simtool import CANWIRE, sim

RATES = 125000, 250000, 500000, 1000000
DELAYS = "0us", "2us", "100us", "777777ns", "20ms"
FILTERS = "100:700", "200:700", "000:001", "~300:700", "105", "400:400", "00000000:00000001"
NODES = ("", "", "", ", queue: 1", ", queue: 3, order: fifo", ", filter: '~200:700'",
         ", one-shot: on", ", loopback: on", ", controller: { model: basic, service-time: 300us }")
FAULTS = ("when: { frame: '100:700', every: 3 }, do: { flip: ack-slot }",
          "when: { time: 9ms }, do: { send: '104#01', as: n0 }",
          "when: { frame: '000:001', every: 5 }, do: { send: '401#02', as: n1 }")


def random_frame(r, fast=False):
    if fast and r.random() < 0.6:
        data = "A5" * r.choice((0, 3, 20, 64))
        return f"{r.randrange(0x7F0):03X}##{r.choice((0, 1, 1, 3))}{data}"
    number = f"{r.randrange(1 << 29):08X}" if r.random() < 0.2 else f"{r.randrange(0x7F0):03X}"
    return number + r.choice(("#R", "#" + "A5" * r.randrange(9)))


def random_traffic(r, fast):
    entries = []
    for _ in range(r.randrange(4)):
        every = r.choice((r.randrange(3, 80) * 100, r.randrange(300, 8000)))
        entries.append(f"{{ send: '{random_frame(r, fast)}', every: {every}us, "
                       f"offset: {r.randrange(4000)}us, count: {r.randrange(1, 60)} }}")
    if r.random() < 0.05:
        entries.append("{ reply: '102#03', to: '200:700' }")
    return ", ".join(entries)


def random_bus(r, name):
    rate = r.choice(RATES)
    fast = r.random() < 0.4
    data = f", dbitrate: {rate * r.choice((2, 4, 8))}" if fast else ""
    text = f"bus: {{ name: {name}, bitrate: {rate}{data} }}\nnodes:\n"
    for n in range(r.randrange(2, 5)):
        node = r.choice(NODES)
        if fast and "loopback" in node: # it has bits of its own, so its frames may be late by a bit
            node = ""
        text += f"  - {{ name: n{n}{node}, traffic: [ {random_traffic(r, fast)} ] }}\n"
    if r.random() < 0.2:
        text += "faults:\n  - { name: f, " + r.choice(FAULTS) + " }\n"
    return text


def random_rule(r):
    parts = [f"filter: '{r.choice(FILTERS)}'", f"delay: {r.choice(DELAYS)}",
             f"queue: {r.choice((1, 2, 16, 1024))}",
             f"direction: {r.choice(('forward', 'backward', 'both'))}"]
    if r.random() < 0.3:
        parts.append(f"id: '{r.randrange(0x7F0):03X}'")
    return "{ " + ", ".join(parts) + " }"


def random_rig(r, folder):
    names = [f"b{i}" for i in range(r.choice((2, 2, 3, 5)))]
    for name in names:
        (folder / f"{name}.yaml").write_text(random_bus(r, name))
    text = f"buses: [ {', '.join(name + '.yaml' for name in names)} ]\ngateways:\n"
    for g in range(r.randrange(1, 4)):
        ends = [f"'{name}:n{r.randrange(2)}'" for name in r.sample(names, 2)]
        rules = ", ".join(random_rule(r) for _ in range(r.randrange(1, 4)))
        text += f"  - {{ name: g{g}, between: [ {', '.join(ends)} ], rules: [ {rules} ] }}\n"
    (folder / "rig.yaml").write_text(text)
    return folder / "rig.yaml"


def random_rig_without_loop(r, folder):
    for _ in range(100):
        file = random_rig(r, folder)
        command = [CANWIRE, "check", file]
        if subprocess.run(command, capture_output=True, check=False).returncode == 0:
            return file
    raise AssertionError("all of them have loops")


def outcome(file, *options):
    """Returns the events, in their order, and the statistics."""
    stats = file.with_suffix(".stats")
    lines = sim(file, *options, "--events", "-", "--stats", stats).stdout.splitlines()
    events = [json.loads(line) for line in lines]
    order = [(e["t"], e["bus"]) for e in events]
    assert order == sorted(order)
    return lines, json.loads(stats.read_text())


@pytest.mark.parametrize("seed", [*range(40), 1125, 1171])
def test_strides_show_what_small_steps_show(tmp_path, seed):
    r = random.Random(seed)
    file = random_rig_without_loop(r, tmp_path)
    until = "--until", r.choice(("40ms", "31234567ns"))
    assert outcome(file, *until) == outcome(file, *until, "--step")


BUS = """bus: {{ name: {name}, bitrate: {rate} }}
nodes:
  - {{ name: n0, traffic: [ {traffic} ] }}
  - {{ name: n1, queue: 1024{mode} }}
  - {{ name: n2{mode} }}
"""


def write_buses(folder, *buses, gateways=""):
    for name, rate, traffic, mode in buses:
        (folder / f"{name}.yaml").write_text(
            BUS.format(name=name, rate=rate, traffic=traffic, mode=mode))
    names = ", ".join(f"{bus[0]}.yaml" for bus in buses)
    (folder / "rig.yaml").write_text(f"buses: [ {names} ]\ngateways:\n{gateways}")
    return folder / "rig.yaml"


def test_a_frame_whose_checksum_changes_its_length(tmp_path):
    """The zeros of the file would have many stuff bits more than what is sent."""
    traffic = ("{ send: '123#0000000000000000', offset: 5ms, every: 7ms, count: 3, "
               "counter: { at: 1.0, bits: 4, start: 5 }, "
               "checksum: { kind: p1, at: 0, data-id: 0x1234, data-id-mode: both } }")
    file = write_buses(tmp_path, ("a", 500000, traffic, ""), ("b", 500000, "", ""),
                       gateways="  - { name: g, between: [ 'a:n1', 'b:n1' ], "
                                "rules: [ { delay: 1us } ] }\n")
    fast, slow = (outcome(file, "--until", "40ms", *step) for step in ([], ["--step"]))
    assert fast == slow
    assert fast[1]["buses"][1]["bus"]["frames"] == 3


def test_more_frames_than_a_bus_can_hold_are_lost_one_by_one(tmp_path):
    """Six rules have room for 6144 frames in their delay, but the far bus only for 1024."""
    rules = ", ".join(f"{{ filter: '10{i}', delay: 200ms, queue: 1024, direction: forward }}"
                      for i in range(6))
    traffic = ", ".join(f"{{ send: '10{i}#', every: 420us, offset: {i * 70}us, count: 700 }}"
                        for i in range(6))
    file = write_buses(tmp_path, ("a", 1000000, traffic, ""), ("b", 1000000, "", ""),
                       gateways=f"  - {{ name: g, between: [ 'a:n1', 'b:n1' ], "
                                f"rules: [ {rules} ] }}\n")
    fast, slow = (outcome(file, "--until", "600ms", *step) for step in ([], ["--step"]))
    assert fast == slow
    forward = fast[1]["gateways"][0]["forward"]
    assert sum(rule["forwarded"] + rule["lost"] for rule in forward["rules"]) == 4200
    assert sum(rule["lost"] for rule in forward["rules"]) > 1000
    assert fast[1]["buses"][1]["bus"]["frames"] == sum(r["forwarded"] for r in forward["rules"])


def test_an_answer_comes_back_in_time(tmp_path):
    """No gateway carries on the remote frame that makes a mailbox of b send. Its answer goes back
    to a, which has gone on meanwhile only as far as it may."""
    file = write_buses(tmp_path, ("a", 125000, "{ send: '123#R2', every: 1300us, count: 20 }", ""),
                       ("b", 500000, "", ", controller: { model: full, mailboxes: [ "
                        "{ direction: rx }, { direction: tx, id: 123, reply: auto, data: 00FF }, "
                        "{ direction: tx } ] }"),
                       gateways="  - { name: g, between: [ 'a:n1', 'b:n0' ], "
                                "rules: [ { filter: '123', delay: 1500us } ] }\n")
    fast, slow = (outcome(file, "--until", "60ms", *step) for step in ([], ["--step"]))
    assert fast == slow
    assert fast[1]["gateways"][0]["backward"]["rules"][0]["forwarded"] > 10


@pytest.mark.parametrize("step", [[], ["--step"]])
def test_a_frame_beside_one_in_loopback_goes_on_at_once(tmp_path, step):
    """M15: a frame of 43 bits up to its reception ends amid one that its bus does not see."""
    (tmp_path / "a.yaml").write_text(
        "bus: { name: a, bitrate: 500000 }\nnodes:\n  - { name: n0 }\n  - { name: n1, loopback: on,"
        " traffic: [ { send: '123#A5A5A5A5A5A5A5A5', every: 3ms, count: 9 } ] }\n  - { name: n2, "
        "traffic: [ { send: '555#R2', every: 3ms, offset: 50us, count: 9 } ] }\n")
    (tmp_path / "b.yaml").write_text(
        "bus: { name: b, bitrate: 1000000 }\nnodes: [ { name: n0 }, { name: n1 } ]\n")
    file = tmp_path / "rig.yaml"
    file.write_text("buses: [ a.yaml, b.yaml ]\ngateways:\n  - { name: g, between: "
                    "[ 'a:n0', 'b:n0' ], rules: [ { filter: '555' } ] }\n")
    events = [json.loads(line) for line in outcome(file, "--until", "40ms", *step)[0]]
    comes, goes = ([round(1e9 * e["t"]) for e in events if e["event"] == "rx" and
                    e["node"] == node and e["bus"] == bus and e["frame"] == "555#R2"]
                   for bus, node in (("a", "n0"), ("b", "n1")))
    assert len(comes) == 9
    assert goes == [tick + 43 * 1000 for tick in comes]


@pytest.mark.parametrize("restart_ms", [1, 10]) # strides to the end of a run may end at each 10 ms
def test_frames_of_the_tick_of_a_restart_are_dropped_before_it(tmp_path, restart_ms):
    """R12: the second one comes at the very tick. The third one waits."""
    (tmp_path / "a.yaml").write_text(
        "bus: { name: a, bitrate: 500000 }\nnodes:\n"
        f"  - {{ name: n0, restart-ms: {restart_ms}, traffic: [ "
        f"{{ send: '64A#', every: {restart_ms}ms, count: 3 }} ] }}\n  - {{ name: n1 }}\n"
        "faults: [ { name: off, do: { bus-off: n0 } } ]\n")
    (tmp_path / "b.yaml").write_text("bus: { name: b, bitrate: 500000 }\nnodes: [ { name: n0 } ]\n")
    file = tmp_path / "rig.yaml"
    file.write_text("buses: [ a.yaml, b.yaml ]\ngateways:\n  - { name: g, between: "
                    "[ 'a:n0', 'b:n0' ], rules: [ { filter: '000:400' } ] }\n")
    until = f"{5 * restart_ms}ms"
    fast, slow = (outcome(file, "--until", until, *step) for step in ([], ["--step"]))
    assert fast == slow
    events = [json.loads(line) for line in slow[0]]
    assert [e["event"] for e in events if e["t"] == restart_ms / 1000] == ["drop", "restart"]
    assert [e["event"] for e in events].count("tx") == 1


@pytest.mark.parametrize("delay", ["8us", "1003us"])
def test_clocks_of_their_own_change_nothing_behind_a_delay_of_a_bit(tmp_path, delay):
    """Frames are received before the bit ends in which their bus tells so."""
    (tmp_path / "a.yaml").write_text(
        "bus: { name: a, bitrate: 125000 }\nnodes:\n  - { name: n0, ppm: 150, traffic: [ "
        "{ send: '123#A5', every: 997us, count: 60 } ] }\n  - { name: n1, rx-delay: 1us }\n")
    (tmp_path / "b.yaml").write_text(
        "bus: { name: b, bitrate: 1000000 }\nnodes:\n  - { name: n0, queue: 1 }\n"
        "  - { name: n1, traffic: [ { send: '100#1122334455667788', every: 133us, count: 480 } ] "
        "}\n")
    (tmp_path / "rig.yaml").write_text(
        "buses: [ a.yaml, b.yaml ]\ngateways:\n  - { name: g, between: [ 'a:n1', 'b:n0' ], "
        f"rules: [ {{ delay: {delay} }} ] }}\n")
    file = tmp_path / "rig.yaml"
    fast, slow = (outcome(file, "--until", "70ms", *step) for step in ([], ["--step"]))
    assert fast == slow


@pytest.mark.parametrize("step", [[], ["--step"]])
def test_a_bus_goes_on_beside_one_that_never_rests(tmp_path, step):
    """Nobody acknowledges the frame of a. The run ends 10 s after the last frame of c."""
    file = write_buses(tmp_path, ("a", 20000, "{ send: '123#' }", ", listen-only: on"),
                       ("b", 500000, "", ""),
                       ("c", 500000, "{ send: '124#', every: 5ms, count: 100 }", ""),
                       gateways="  - { name: g, between: [ 'a:n1', 'b:n1' ], "
                                "rules: [ { filter: '7FF' } ] }\n")
    result = sim(file, "--stats", "-", *step)
    assert "ended after 10 s" in result.stderr
    assert [bus["bus"]["frames"] for bus in json.loads(result.stdout)["buses"]] == [0, 0, 100]


@pytest.mark.parametrize("rates", ((20000, 20000), (20000, 50000), (125000, 20000)))
@pytest.mark.parametrize("restart", ("", ", restart-ms: 300"))
def test_buses_that_wait_in_vain_end_as_in_small_steps(tmp_path, rates, restart):
    """A node is bus-off with frames in its queue. Meetings that are skipped change nothing."""
    traffic = "{ send: '123#11', every: 7ms, count: 12 }"
    kill = ("faults: [ { name: k, when: { frame: '123' }, do: { flip: 'data[0.1]' } },"
            " { name: r, when: { time: 3s }, do: { counters: n1, rec: 5 } } ]\n")
    file = write_buses(tmp_path, ("a", rates[0], traffic, ""), ("b", rates[1], "", ""),
                       gateways="  - { name: g, between: [ 'a:n1', 'b:n1' ], rules: [ {} ] }\n")
    bus = file.with_name("a.yaml")
    bus.write_text(bus.read_text().replace("name: n0,", f"name: n0{restart},") + kill)
    fast, slow = (outcome(file, *step) for step in ([], ["--step"]))
    assert fast == slow
    assert fast[0]
