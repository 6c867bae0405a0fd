# SPDX-License-Identifier: MIT
"""canwire.Bus: buses in virtual time inside of this process.

The exact traces of tests/scenarios, and the outputs of `canwire sim`, are the references.
"""

import copy
import ctypes
import json
import math
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import canwire
from canwire import Bus, ConfigError, Error, ExpectationError, Frame, Stop, _library
from simtool import ROOT, canwire as tool, events as tool_events, stats as tool_stats
from test_scenarios import SCENARIOS, arguments_of

HEADER = ROOT / "daemon/embed/canwire-sim.h"
EMPTY = """
bus: { name: small, bitrate: 500000 }
nodes: [ { name: a }, { name: b }, { name: c } ]
"""
# 11 bits until all nodes are on the bus, 78 bits with stuff bits: ends of the last EOF bits
RX_NS, TX_NS = (11 + 77) * 2000, (11 + 78) * 2000
FLIP = {"name": "flip", "when": {"frame": "123", "count": 1}, "do": {"flip": "crc[3]"}}


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def run_like_sim(bus, arguments):
    """Runs as `canwire sim` does with these arguments; returns False when it has others."""
    known = {"--until", "--seed", "--sync", "--captures"}
    given = dict(zip(arguments[::2], arguments[1::2]))
    if not set(given) <= known - {"--sync", "--captures"}:
        return False
    if "--seed" in given:
        bus.reset(int(given["--seed"]))
    bus.run(given.get("--until"))
    return True


# ---- The same as canwire sim ---------------------------------------------------------------------


def test_each_scenario_gives_its_exact_events():
    done = 0
    for path in SCENARIOS:
        with Bus(path) as bus:
            if not run_like_sim(bus, arguments_of(path)):
                continue
            assert bus.events() == lines_of(path.with_suffix(".events")), path
            done += 1
    assert done > 100


def test_a_run_in_pieces_gives_the_same_events():
    for path in SCENARIOS[::10]:
        if arguments_of(path):
            continue
        with Bus(path, listen=False) as bus:
            bus.run()
            end = bus.now_ns
            bus.reset()
            for part in range(1, 8):
                bus.run(end * part / 7e9)
            bus.run()
            assert bus.events() == lines_of(path.with_suffix(".events")), path


def test_a_rig_gives_the_events_and_statistics_of_canwire_sim():
    path = ROOT / "config/rig/rig.yaml"
    with Bus(path) as rig:
        assert rig.run("300ms") is Stop.TIME
        assert rig.events() == tool_events(path, "--until", "300ms")
        found = tool_stats(path, "--until", "300ms")
        assert [bus["bus"] for bus in rig.stats()["buses"]] == [bus["bus"]
                                                                for bus in found["buses"]]
        assert rig.stats()["gateways"] == found["gateways"]
        first = rig.buses[0]
        assert rig.node(f"{first.name}:{first.nodes[0]}").bus_name == first.name
        with pytest.raises(Error, match="say which one"):
            rig.inject(FLIP)
        before = rig.events()
        rig.reset()
        rig.run("300ms")
        assert rig.events() == before


def test_statistics_are_those_of_canwire_sim(write):
    path = write(EMPTY.replace("{ name: a }", "{ name: a, traffic: [ { send: 123#11 } ] }"))
    with Bus(path) as bus:
        assert bus.run() is Stop.END
        assert bus.stats() == tool_stats(path)


# ---- Configurations ------------------------------------------------------------------------------


def test_errors_of_a_text_have_their_place():
    with pytest.raises(ConfigError) as error:
        Bus.from_yaml("bus: { bitrate: 1 }\nnodes: []\n", name="x.yaml")
    assert str(error.value).splitlines() == [
        "x.yaml:1:17: bitrate: expected a decimal integer 5000..1000000, not '1'",
        "x.yaml:2:8: nodes: expected 1 to 64 items, not 0"]
    with pytest.raises(ConfigError, match="missing.yaml: .*No such file"):
        Bus.from_yaml("missing.yaml")


def test_a_text_may_name_files(write):
    write("profile: { name: p }\nfaults: [ { name: x, do: { flip: \"crc[3]\" } } ]\n", "p.yaml")
    path = write("")
    text = EMPTY + "profiles: [ { file: p.yaml } ]\n"
    with Bus.from_yaml(text, name=str(path)) as bus:
        assert bus.rules() == ["x"]
    with pytest.raises(ConfigError, match="p.yaml"):
        Bus.from_yaml(text, name="/nowhere/bus.yaml")


def test_a_rig_may_be_a_text(write):
    for name in ("one", "two"):
        write(EMPTY.replace("small", name), f"{name}.yaml")
    rig = Bus.from_yaml("buses: [ one.yaml, two.yaml ]\ngateways:\n"
                        "  - { name: g, between: [ 'one:b', 'two:a' ], rules: [ { filter: '123' } "
                        "] }\n", name=str(write("", "rig.yaml")))
    rig.send("one:a", "123#11")
    assert str(rig.recv("two:c", timeout="10ms")) == "123#11"
    assert [e["bus"] for e in rig.events("rx")] == ["one", "one", "two", "two"]


FAST = """
bus: { name: fast, bitrate: 1000000 }
nodes: [ { name: a }, { name: b }, { name: c, ppm: PPM, traffic: [ { send: 400#, every: 1ms } ] } ]
"""
SLOW = """
bus: { name: slow, bitrate: 10000 }
nodes: [ { name: a, traffic: [ { send: 300#00, every: 17ms } ] }, { name: b } ]
"""


def talk(bus, prefix):
    """Lets two programs answer each other at once, and frames come at odd times. Returns what was
    received, and the times at which it was known."""
    found = []
    for i in range(6):
        bus.send(f"{prefix}a", f"12{i}#")
        for here, there in ("ab", "ba", "ab"):
            frame = bus.recv(f"{prefix}{there}", timeout="1s")
            found.append((str(frame), frame.t_ns, bus.now_ns))
            bus.send(f"{prefix}{there}", f"{0x200 + len(found):03X}#")
        bus.run(f"{bus.now_ns + 33_300 * (i + 1)}ns")
        bus.send(f"{prefix}b", f"30{i}#")
        assert bus.run("9s", event=f"{prefix}tx:30{i}") is Stop.EVENT
        found.append(bus.now_ns)
    return found


@pytest.mark.parametrize("ppm", ["0", "100"])
def test_a_slow_bus_beside_it_changes_no_time_of_a_fast_one(write, ppm):
    fast = FAST.replace("PPM", ppm)
    with Bus.from_yaml(fast) as bus:
        alone, events = talk(bus, ""), bus.events()
    write(fast, "fast.yaml")
    write(SLOW, "slow.yaml")
    text = ("buses: [ fast.yaml, slow.yaml ]\ngateways:\n  - { name: g, between: [ 'fast:b', "
            "'slow:b' ], rules: [ { filter: '400', direction: forward } ] }\n")
    with Bus.from_yaml(text, name=str(write("", "rig.yaml"))) as rig:
        assert talk(rig, "fast:") == alone
        mine = [{k: v for k, v in event.items() if k != "bus"} for event in rig.events()
                if event.get("bus") == "fast" and event["t"] <= events[-1]["t"]]
        assert mine == events
        rig.run("60ms")
        assert {e["frame"] for e in rig.events("rx") if e["bus"] == "slow"} == {"300#00", "400#"}


def test_warnings_are_not_printed(capfd):
    with Bus.from_yaml(EMPTY + "faults: [ { name: x, when: { time: 3us }, do: { flip: sof } } ]\n"
                       ) as bus:
        bus.run("1ms")
        assert len(bus.warnings) == 1 and ": warning: time: " in bus.warnings[0]
    assert capfd.readouterr() == ("", "")


def test_from_dict_takes_what_yaml_is_read_as():
    config = {"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}, {"name": "b"}]}
    with Bus.from_dict(config) as bus:
        assert [node.name for node in bus] == ["a", "b"]
        assert bus.buses[0].bitrate == 500000 and bus.buses[0].dbitrate is None


def test_what_is_no_configuration_is_refused():
    with pytest.raises(Error, match="None is no configuration; expected a dict"):
        Bus.from_dict(None)
    with pytest.raises(Error, match="there is no file 'foo: 1'"):
        canwire.Scenario("foo: 1")


@pytest.mark.parametrize("seconds", [math.nan, math.inf, -1])
def test_what_is_no_time_is_refused(seconds):
    with Bus.from_yaml(EMPTY) as bus, pytest.raises(Error, match="a time is 0 s or more"):
        bus.run(duration=seconds)


def test_a_bus_is_not_copied():
    with Bus.from_yaml(EMPTY) as bus, pytest.raises(Error, match="a bus cannot be copied"):
        copy.copy(bus)


# ---- Frames --------------------------------------------------------------------------------------


def test_frames_come_at_the_times_of_the_bus():
    with Bus.from_yaml(EMPTY) as bus:
        bus["a"].listen(own=True)
        bus.send("a", "123#DEADBEEF")
        got = bus.recv("b", timeout="1s")
        assert (got, got.t_ns, bus.now_ns) == (Frame(0x123, bytes.fromhex("DEADBEEF"),
                                                     t_ns=RX_NS), RX_NS, RX_NS)
        assert bus.recv("a") is None
        own = bus.recv("a", timeout="1ms")
        assert (own.own, own.t_ns) == (True, TX_NS)
        assert bus.recv("c").t_ns == RX_NS
        assert bus.recv("b", timeout="1ms") is None and bus.now_ns == TX_NS + 1_000_000
        bus.send("b", "124#", at="5ms")
        assert bus.recv("a", timeout=None).t_ns > 5_000_000


@pytest.mark.parametrize("text", ["123#", "7FF#1122334455667788", "00000123#01", "123#R", "123#R8",
                                  "1FFFFFFF#R4", "123#1122334455667788_F", "123##0",
                                  "123##11122", "00000001##3" + "AB" * 64])
def test_frames_of_each_kind_arrive_unchanged(text):
    with Bus.from_yaml(EMPTY.replace("500000", "500000, dbitrate: 2000000")) as bus:
        bus.send("a", text)
        sent = Frame.parse(text)
        got = bus.recv("b", timeout="10ms")
        # the controller sets ESI by itself
        assert str(got) == str(Frame.parse(text.replace("##3", "##1")))
        assert (got.id, got.extended, got.remote, got.fd) == (sent.id, sent.extended, sent.remote,
                                                              sent.fd)


@pytest.mark.parametrize("text", ["", "12#", "800#", "20000000#", "123#1", "123#R9", "123#GG",
                                  "123#112233445566778899", "123#11_8", "123##"])
def test_what_is_no_frame_is_refused(text):
    with pytest.raises(ValueError):
        Frame.parse(text)


@pytest.mark.parametrize("frame, why", [
    (Frame(0x800), "at most 7FF"), (Frame(1, bytes(9)), "at most 8 bytes"),
    (Frame(1, error=True), "only received"), (Frame(1, fd=True, remote=True), "no remote frames"),
    (Frame(1, dlc=9), "raw DLC")])
def test_frames_that_cannot_exist_are_refused(frame, why):
    with Bus.from_yaml(EMPTY) as bus, pytest.raises(Error, match=why):
        bus.send("a", frame)


@pytest.mark.parametrize("values, error, why", [
    ((1 << 40,), ValueError, "0x10000000000 is no identifier; expected 0 to 0x7FF"),
    ((-1,), ValueError, "-0x1 is no identifier"),
    (("5",), TypeError, "'5' is not an identifier; expected a whole number"),
    ((1, [300]), ValueError, "expected numbers from 0 to 255"),
    ((1, "AB"), TypeError, "'AB' are no data; expected bytes"),
    ((1, 5), TypeError, "5 are no data"),
    ((1, b"", False, True, False, False, False, 20), ValueError, "remote frame; expected 0 to 8")])
def test_wrong_values_are_no_other_frame(values, error, why):
    with pytest.raises(error, match=why):
        Frame(*values)


def test_data_may_be_numbers():
    assert Frame(1, [1, 255]) == Frame(1, b"\x01\xff") == Frame.parse("001#01FF")


def test_what_is_sent_is_a_frame():
    with Bus.from_yaml(EMPTY) as bus, pytest.raises(TypeError, match="5 is no frame; expected"):
        bus.send("a", 5)


def test_a_full_queue_drops_with_an_event():
    with Bus.from_yaml(EMPTY) as bus:
        for _ in range(17):
            bus.send("a", "123#")
        bus.run("100us")
        assert [e["why"] for e in bus.events("drop")] == ["queue-full"]
        assert bus["a"].room == 0 and bus["a"].status.queue == 16


# ---- Faults, states, settings --------------------------------------------------------------------


def test_a_node_goes_to_bus_off_and_is_restarted():
    with Bus.from_yaml(EMPTY) as bus:
        engine = bus["a"]
        engine.listen(errors=True)
        bus.inject(name="broken", do={"stuck": "recessive", "on": "a.tx"})
        engine.send("123#CAFE")
        assert bus.run(event="a:bus-off") is Stop.EVENT
        assert (engine.state, engine.tec, engine.status.bus_off) == ("bus-off", 256, 1)
        assert bus.events("state", "a")[-1]["t"] == bus.now
        while (error := engine.recv()) and error.id != 0x40:  # CAN_ERR_BUSOFF
            assert error.error
        assert error and error.t == bus.now
        with pytest.raises(Error, match="not bus-off"):
            bus["b"].restart()
        bus.clear("broken")
        engine.restart()
        engine.send("124#")  # R12: behind the request it waits
        assert bus.run("1s", event="a:error-active") is Stop.EVENT
        assert bus.now == pytest.approx(error.t + 128 * 11 / 500000)
        engine.send("123#CAFE")
        assert [str(bus.recv("b", timeout="1s")) for _ in range(2)] == ["123#CAFE", "124#"]
        assert [e["frame"] for e in bus.events("drop")] == ["123#CAFE"]  # the one before
        assert engine.state == "error-active"


def test_rules_are_added_all_or_none_and_cleared():
    with Bus.from_yaml(EMPTY) as bus:
        with pytest.raises(ConfigError, match=r"rule:1:\d+: .*unknown key 'flop'"):
            bus.inject([FLIP, {"name": "x", "do": {"flop": "sof"}}])
        assert bus.rules() == []
        bus.inject(FLIP)
        bus.inject("{ name: later, when: { manual: yes }, do: { restart: a } }")
        assert bus.rules() == ["flip", "later"]
        bus.fire("later")
        with pytest.raises(Error, match="there is no rule 'nothing'"):
            bus.clear("nothing")
        with pytest.raises(Error, match="rule flip is finished, or has no"):
            bus.fire("flip")
        bus.send("a", "123#DEADBEEF")
        bus.run()
        assert len(bus.events("error")) == 3
        bus.clear()
        assert bus.rules() == []


def test_settings_change_and_nodes_leave():
    with Bus.from_yaml(EMPTY) as bus:
        bus["b"].set(listen_only=True)
        bus["c"].detach()
        assert not bus["c"].status.attached
        bus.send("a", "123#")
        bus.run("1ms")
        assert bus["a"].status.ack_errors > 0
        bus["c"].attach()
        assert bus.run(event="a:tx") is Stop.EVENT
        with pytest.raises(Error, match="no setting|unknown|expected"):
            bus["a"].set(colour="red")


# ---- Runs ----------------------------------------------------------------------------------------


def test_a_run_ends_with_what_is_awaited():
    with Bus.from_yaml(EMPTY) as bus:
        bus.send("a", "123#", at="1ms")
        assert bus.run("2ms", event="tx:123") is Stop.EVENT
        assert bus.events()[-1]["event"] == "tx" and bus.events()[-1]["t"] == bus.now
        assert bus.run("2ms", event="tx:123") is Stop.TIME
        assert bus.run(event="any") is Stop.END
        bus.send("a", "124#")
        assert bus.run(event="any") is Stop.EVENT
        assert bus.new_events()[-1]["event"] == "rx"
        assert bus.run(frame_at="b") is Stop.FRAME
        with pytest.raises(Error, match="there is no event 'nonsense'"):
            bus.run(event="nonsense")
        with pytest.raises(Error, match="expected"):
            bus.run("2")


def test_a_run_ends_with_the_bit_of_own_frames_and_errors():
    with Bus.from_yaml(EMPTY) as bus:
        bus["a"].listen(own=True)
        bus.send("a", "123#")
        assert bus.run("1s", frame_at="a") is Stop.FRAME
        assert bus.now == bus.events("tx")[-1]["t"]
    alone = "bus: { bitrate: 500000 }\nnodes: [ { name: a, berr-reporting: on } ]\n"
    with Bus.from_yaml(alone) as bus:
        bus["a"].listen(errors=True)
        bus.send("a", "123#")
        assert bus.run("1s", frame_at="a") is Stop.FRAME
        assert bus["a"].recv().t == bus.now == bus.events("error")[0]["t"]


BUSY = """
bus: {{ name: busy, bitrate: 500000, {rate} }}
seed: 7
defaults: {{ restart-ms: 1, berr-reporting: on, lost-arbitration-reporting: on }}
nodes:
  - {{ name: a, {more} traffic: [ {{ send: "100##1001122334455667788", every: 700us }} ] }}
  - {{ name: b, traffic: [ {{ send: 100#0011, every: 700us, offset: 100us }} ] }}
  - {{ name: c, traffic: [ {{ send: 7FF#, every: 900us }} ] }}
faults:
  - {{ name: noise, do: {{ noise: 1e-3 }} }}
  - {{ name: off, when: {{ time: 7ms }}, do: {{ bus-off: c }} }}
"""


@pytest.mark.parametrize("more", ["", "ppm: 90,"], ids=["one clock", "own clocks"])
@pytest.mark.parametrize("rate", ["dbitrate: 2000000", ""])
def test_a_run_stops_where_each_frame_comes(rate, more):
    """They are frames, own frames and errors. Nothing but the stops differs from one run."""
    text = BUSY.format(rate=rate, more=more)
    text = text if rate else text.replace("100##1001122334455667788", "101#0011223344556677")
    late = 2000 if rate or more else 0  # ns: a bit, where nodes have bits of their own
    with Bus.from_yaml(text) as whole, Bus.from_yaml(text) as bus:
        for node in (*whole, *bus):
            node.listen(own=True, errors=True)
        whole.run(0.02)
        number, found = 0, [[] for _ in bus]
        while bus.now < 0.02:
            number += 1
            end = min(bus.now_ns + number * 7919 % 300_000, 20_000_000)  # in the middle of bits
            stop = Stop(bus._run(end, None, _library.ANY_NODE))
            taken = [[*iter(lambda node=node: bus._take(node.number), None)] for node in bus]
            times = {frame.t_ns for frames in taken for frame in frames}
            assert stop is (Stop.FRAME if times else Stop.TIME)
            assert all(0 <= bus.now_ns - time <= late for time in times)
            for node, frames in zip(found, taken):
                node += frames
        assert found == [[*iter(lambda node=node: whole._take(node.number), None)]
                         for node in whole]
        assert bus.events() == whole.events() and len(bus.events("error")) > 9
        assert all(any(frame.error for frame in frames) for frames in found)


def test_traffic_without_end_needs_a_time():
    text = EMPTY.replace("{ name: a }", "{ name: a, traffic: [ { send: 123#, every: 1ms } ] }")
    with Bus.from_yaml(text) as bus:
        with pytest.raises(Error, match=r"scenario.yaml:3:\d+: this never ends"):
            bus.run()
        bus.run(duration="5.9ms")
        assert len(bus.events("tx")) == 6


def test_reset_repeats_a_run_to_the_byte():
    text = EMPTY.replace("{ name: a }", "{ name: a, traffic: [ { send: 123#00, every: 1ms, "
                         "count: 50 } ] }")
    text += "faults: [ { name: coin, when: { probability: 0.3 }, do: { flip: 'crc[3]' } } ]\n"
    with Bus.from_yaml(text) as bus:
        bus.run()
        first = bus.take_lines()
        bus.inject(name="more", do={"flip": "sof"})
        bus.clear("coin")
        bus["a"].set(listen_only=True)
        bus.reset()
        assert bus.rules() == ["coin"] and bus.now == 0 and bus.recv("b") is None
        bus.run()
        assert bus.take_lines() == first
        bus.reset(seed=1)
        bus.run()
        other = bus.take_lines()
        assert other != first and bus.buses[0].seed == 1
    with Bus.from_yaml(text, seed=1) as bus:
        bus.run()
        assert bus.take_lines() == other


def test_many_scenarios_take_no_new_memory():
    """A child counts its heap: the same after 50 and after 2000 scenarios."""
    code = """if True:
        import ctypes, canwire
        class Info(ctypes.Structure):
            _fields_ = [(n, ctypes.c_size_t) for n in "arena a b c hblkhd d e uordblks f g".split()]
        libc = ctypes.CDLL(None)
        libc.mallinfo2.restype = Info
        def used():
            info = libc.mallinfo2()
            return info.uordblks + info.hblkhd
        bus = canwire.Bus.from_yaml('''
        bus: { name: b, bitrate: 500000 }
        nodes: [ { name: a, traffic: [ { send: 123#DEADBEEF, every: 1ms, count: 5 } ] },
                 { name: b } ]
        expect: [ { delivered: 5, to: [ b ] } ]
        ''', events="error")
        bus["a"].listen(own=True)
        def scenario(i):
            bus.reset(i)
            bus.inject("{ name: f, when: { count: 3 }, do: { flip: 'crc[1]' } }")
            bus.run()
            assert len(bus.events()) == 6 and bus["b"].recv()
        for i in range(50): scenario(i)
        before = used()
        for i in range(2000): scenario(i)
        print(used() - before)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120,
                          check=True, env={**os.environ, "PYTHONMALLOC": "pymalloc",
                                           "PYTHONPATH": str(ROOT / "lib/python/src")})
    assert int(done.stdout) < 100_000 and done.stderr == ""


def test_threads_have_buses_of_their_own():
    results = [None] * 4

    def work(index):
        with Bus(SCENARIOS[index]) as bus:
            for _ in range(20):
                bus.reset()
                run_like_sim(bus, arguments_of(SCENARIOS[index]))
            results[index] = bus.events()

    workers = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert results == [lines_of(SCENARIOS[i].with_suffix(".events")) for i in range(4)]


# ---- Results -------------------------------------------------------------------------------------


def test_expectations_are_judged():
    with Bus.from_yaml(EMPTY + "expect: [ { name: one, delivered: 1, frame: '123', to: [ b ] } ]\n"
                       ) as bus:
        assert [e["met"] for e in bus.expectations()] == [False]
        bus.send("a", "123#")
        bus.run()
        bus.check()
        bus.expect(delivered=1, frame="124", from_="a")
        bus.expect("[ { errors: 0, node: b }, { state: bus-off, reached: never, node: a } ]")
        bus.send("a", "123#")
        bus.run()
        with pytest.raises(ExpectationError) as error:
            bus.check()
        assert str(error.value) == ("one: wanted 1 frame 123 to b, got 2\n"
                                    "wanted 1 frame 124 from a, got 0")
        with pytest.raises(ConfigError, match="expectation:1:"):
            bus.expect(delivered="many")
        bus.reset()
        assert len(bus.expectations()) == 1


def test_what_is_lost_is_told():
    text = EMPTY.replace("name: a", "name: a, queue: 2") + \
        "faults: [ { name: late, when: { frame: '124' }, do: { drop: tx } } ]\n"
    never = {"bus": "small", "rule": "late", "why": "never matched",
             "help": "no node sends such a frame"}
    with Bus.from_yaml(text, events="none") as bus:
        assert bus.lost() == [never]
        for i in range(4):
            bus.send("a", f"12{i}#")
        bus.run()
        assert bus.lost() == [
            {"bus": "small", "node": "a", "why": "queue-full", "frames": 2, "ids": "122, 123",
             "help": "queue: more than 2, offsets or less traffic"}, never]
        bus.reset()
        bus.send("a", "124#")
        bus.run()
        assert bus.lost() == []


def test_kinds_of_events_are_chosen():
    with Bus.from_yaml(EMPTY, events="tx,drop") as bus:
        bus.send("a", "123#")
        bus.run()
        assert [e["event"] for e in bus.events()] == ["tx"]
        bus.keep_events("none")
        bus.send("a", "123#")
        bus.run()
        assert len(bus.events()) == 1 and bus.events(node="b") == []
        with pytest.raises(Error, match="there is no event 'rain'"):
            bus.keep_events("rain")


def test_events_have_the_names_that_rules_had():
    """Another rule may have the number of one that was cleared."""
    with Bus.from_yaml(EMPTY) as bus:
        for name in ("first", "second"):
            bus.inject(name=name, when={"frame": "123", "count": 1}, do={"flip": "crc[3]"})
            bus.send("a", "123#11")
            bus.run(duration="2ms")
            bus.clear(name)
        assert [e["rule"] for e in bus.events("fault")] == ["first", "second"]


def test_wrong_names_are_explained():
    with Bus.from_yaml(EMPTY) as bus:
        with pytest.raises(Error, match="there is no node 'd'; there is a, b, c"):
            bus.node("d")
        with pytest.raises(Error, match="there is no bus 'x'; there is small"):
            bus.rules(bus="x")


# ---- The library ---------------------------------------------------------------------------------


def test_structures_are_those_of_the_header(tmp_path):
    """Compiles the offsets of all members, and the constants."""
    lines = ["#include <stdio.h>", f'#include "{HEADER}"', "int main(void) {"]
    for name, structure in _library.STRUCTURES.items():
        lines.append(f'printf("{name} %zu\\n", sizeof({name}));')
        lines += [f'printf("{name}.{member} %zu %zu\\n", offsetof({name}, {member}), '
                  f"sizeof((({name} *)0)->{member}));" for member, _ in structure._fields_]
    constants = ["ABI", "NEVER", "NO_NODE", "ANY_NODE", "OK", "INVALID", "REFUSED", "NO_MEMORY",
                 "FAILED", "AT_TIME", "AT_FRAME", "AT_EVENT", "AT_END", "FRAME_FD", "FRAME_BRS",
                 "FRAME_ESI", "FRAME_OWN", "LISTEN_RX", "LISTEN_OWN", "LISTEN_ERRORS", "NO_FRAME",
                 "MARK_TX", "MARK_STUFF", "MARK_DATA", "MARK_ACTIVE", "MARK_PASSIVE"]
    lines += [f'printf("{name} %lld\\n", (long long)CANWIRE_SIM_{name});' for name in constants]
    lines += [f'printf("{name} %d\\n", CANWIRE_SIM_{name.replace("-", "_").upper()});'
              for name in canwire.bus.STATES]
    source, program = tmp_path / "layout.c", tmp_path / "layout"
    source.write_text("\n".join([*lines, "}"]))
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-o", program, source], check=True)
    found = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    expected = []
    for name, structure in _library.STRUCTURES.items():
        expected.append(f"{name} {ctypes.sizeof(structure)}")
        expected += [f"{name}.{member} {getattr(structure, member).offset} "
                     f"{getattr(structure, member).size}" for member, _ in structure._fields_]
    expected += [f"{name} {getattr(_library, name)}" for name in constants]
    expected += [f"{name} {i}" for i, name in enumerate(canwire.bus.STATES)]
    assert found.splitlines() == expected
    for packed, name in (_library.FRAME, "frame"), (_library.WAITED, "waited"):
        assert packed.size == ctypes.sizeof(_library.STRUCTURES[f"canwire_sim_{name}"])
    members = {member for member, _ in _library.STRUCTURES["canwire_sim_node"]._fields_}
    assert members == set(canwire.NodeStatus._fields)


def test_only_the_functions_of_the_header_are_visible():
    path = Path(os.environ["CANWIRE_SIM_LIBRARY"])
    visible = subprocess.run(["nm", "-D", "--defined-only", path], capture_output=True, text=True,
                             check=True).stdout.split("\n")
    names = sorted(line.split()[2] for line in visible if line)
    declared = [word.split("(")[0].lstrip("*") for word in HEADER.read_text().split()
                if word.lstrip("*").startswith("canwire_sim_") and "(" in word]
    assert names == sorted({name for name in declared if not name.endswith("()")})
    assert names == sorted(f"canwire_sim_{name}" for name in _library.FUNCTIONS)


def test_the_library_ends_no_program_and_has_no_global_state():
    path = Path(os.environ["CANWIRE_SIM_LIBRARY"])
    needed = subprocess.run(["nm", "-D", "--undefined-only", path], capture_output=True, text=True,
                            check=True).stdout
    names = {line.split()[-1].split("@")[0] for line in needed.splitlines()}
    assert not names & {"exit", "_exit", "quick_exit", "signal", "sigaction", "raise", "kill",
                        "stderr", "stdout", "getenv", "setlocale", "chdir", "rand"}
    own = subprocess.run(["readelf", "-Ws", path], capture_output=True, text=True,
                         check=True).stdout
    sections = subprocess.run(["readelf", "-WS", path], capture_output=True, text=True,
                              check=True).stdout
    writable = {found[1] for found in re.finditer(r"\[ *(\d+)\] \.(?:bss|data) ", sections)}
    state = {line.split()[7] for line in own.splitlines()
             if line.split()[3:4] == ["OBJECT"] and line.split()[6] in writable}
    assert {name for name in state if not name.startswith(("completed.", "__dso_handle",
                                                           "__TMC_END__"))} == set()


def test_the_version_is_that_of_the_tool():
    assert _library.library().version().decode() in tool("--version").stdout


def test_a_closed_bus_refuses_all_calls():
    bus = Bus.from_yaml(EMPTY)
    node = bus["a"]
    bus.close()
    bus.close()
    for call in (bus.run, bus.events, bus.stats, bus.reset, bus.rules, bus.check, node.restart,
                 node.recv, node.listen, node.detach, lambda: node.status, lambda: bus.now,
                 lambda: node.room, lambda: bus.buses, lambda: bus.name, lambda: node.send("123#"),
                 lambda: bus.inject("{}"), lambda: bus.send("a", "123#", at="1ms")):
        with pytest.raises(Error, match="the bus is closed"):
            call()


def test_threads_may_use_one_bus_and_close_it():
    bus = Bus.from_yaml(EMPTY)

    def work():
        try:
            while True:
                bus.send("a", "123#")
                bus.run(duration="1ms")
                bus.events()
        except Error as problem:
            ended.append(str(problem))

    ended = []
    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    while bus.now < 0.01:
        pass
    bus.close()
    for thread in threads:
        thread.join(60)
    assert ended == ["the bus is closed"] * 3
