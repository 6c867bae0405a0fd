# SPDX-License-Identifier: MIT
"""canwire analyse: response times against the literature, and against simulated runs."""

import json
import random
import re
import subprocess

import pytest

from depth import DEEP
from simtool import CANWIRE, canwire, sim

PAPER = """
bus: { name: paper, bitrate: 125000 }
nodes:
  - { name: a, traffic: [ { send: '001#00000000000000', every: 2500us } ] }
  - { name: b, traffic: [ { send: '002#00000000000000', every: 3500us } ] }
  - { name: c, traffic: [ { send: '003#00000000000000', every: 3500us } ] }
"""


def analyse(path, *arguments, status=0):
    return json.loads(canwire("analyse", path, "--json", *arguments, status=status).stdout)


def by_id(result):
    return {m["id"]: m for m in result["messages"]}


@pytest.fixture
def write(tmp_path):
    def to_file(text):
        path = tmp_path / "bus.yaml"
        path.write_text(text)
        return path
    return to_file


def test_the_counter_example_of_davis_burns_bril_and_lukkien(write):
    messages = by_id(analyse(write(PAPER)))
    assert {m["bits"] for m in messages.values()} == {125}
    assert [messages[i]["response_ns"] for i in ("001", "002", "003")] == [
        2_000_000, 3_000_000, 3_500_000]
    assert [messages[i]["blocking_ns"] for i in ("001", "002", "003")] == [1_000_000, 1_000_000, 0]


def test_the_table_says_the_same_and_what_was_seen(write):
    text = canwire("analyse", write(PAPER), "--simulate", "1s").stdout.splitlines()
    assert text[0].split() == ["NODE", "FRAME", "EVERY", "BITS", "BLOCKED", "RESPONSE", "SEEN"]
    assert text[3].split()[:6] == ["c", "003", "3.500", "125", "0.000", "3.500"]


def test_a_message_that_is_late_gives_the_status_3(write):
    path = write(PAPER.replace("'003#00000000000000', every: 3500us", "'003#', every: 1ms"))
    result = analyse(path, status=3)
    assert by_id(result)["003"]["late"] and by_id(result)["003"]["response_ns"] is None
    assert "no bound" in canwire("analyse", path, status=3).stdout


@pytest.mark.parametrize("frame, bits", [
    ("123#", 55), ("123#R8", 55), ("123#0011223344556677", 135), ("12345678#", 80),
    ("12345678#0011223344556677", 160), ("123#00", 65), ("12345678#00", 90)])
def test_longest_frames(write, frame, bits):
    """47 + 8n + (33 + 8n) / 4, and 67 + 8n + (53 + 8n) / 4 for extended ones."""
    result = analyse(write("bus: { bitrate: 500000 }\nnodes:\n"
                           f"  - {{ name: a, traffic: [ {{ send: '{frame}', every: 1s }} ] }}\n"))
    assert result["messages"][0]["bits"] == bits
    assert result["messages"][0]["length_ns"] == bits * 2000


def longest_of(tmp_path, name, kind, count, rng):
    """Sends frames with data that has many stuff bits, and returns the longest time of one."""
    flags, extended, length = kind
    send = []
    for _ in range(count):
        data = bytes(rng.choice((0x00, 0x0F, 0x1E, 0x3C, 0x78, 0xF0, 0xE1, 0xC3, 0x87, 0xFF))
                     for _ in range(length)).hex()
        identifier = f"{rng.choice((0, 0x0F0F0F0F, 0x10F0F0F0)):08X}" if extended else "078"
        send.append(f"(1.0) can0 {identifier}{flags}{data}")
    (tmp_path / "log").write_text("\n".join(send) + "\n")
    path = tmp_path / f"{name}.yaml"
    path.write_text("bus: { bitrate: 500000, dbitrate: 2000000, sample-point: 80%, "
                    "dsample-point: 80% }\nnodes:\n"
                    "  - { name: a, queue: 4096, traffic: [ { replay: log } ] }\n  - name: b\n")
    ends = [json.loads(line)["t"] for line in sim(path, "--events", "-").stdout.splitlines()
            if '"tx"' in line]
    return max(b - a for a, b in zip(ends, ends[1:]))


@pytest.mark.parametrize("kind", [("##1", False, 8), ("##1", False, 64), ("##0", False, 24),
                                  ("##1", True, 16), ("#", False, 8), ("#", True, 8)])
def test_no_frame_is_longer_than_its_bound(tmp_path, write, kind):
    """Frames that follow each other at once, so the time between their ends is that of one."""
    flags, extended, length = kind
    longest = longest_of(tmp_path, "run", kind, 400, random.Random(length))
    frame = ("12345678" if extended else "123") + flags + "00" * length
    result = analyse(write("bus: { bitrate: 500000, dbitrate: 2000000, sample-point: 80%, "
                           "dsample-point: 80% }\nnodes:\n"
                           f"  - {{ name: a, traffic: [ {{ send: '{frame}', every: 1s }} ] }}\n"))
    bound = result["messages"][0]["length_ns"] * 1e-9
    assert longest <= bound < 1.25 * longest


def random_bus(rng):
    """Nodes with messages of random periods, offsets and jitters, of about 30 to 90 % load."""
    nodes, used = [], set()
    fd = rng.random() < 0.3
    for name in "abcde"[:rng.randint(2, 5)]:
        traffic = []
        for _ in range(rng.randint(1, 4)):
            while (identifier := rng.randrange(0x700)) in used:
                pass
            used.add(identifier)
            text = f"{identifier:03X}" if rng.random() < 0.7 else f"{identifier << 18:08X}"
            data = bytes(rng.choice((0, 0xFF, 0x0F)) for _ in range(rng.randint(0, 8))).hex()
            flags = "##1" if fd and rng.random() < 0.5 else "#"
            every = rng.choice((1000, 2000, 2500, 5000, 10000))
            traffic.append(f"{{ send: '{text}{flags}{data}', every: {every}us, "
                           f"offset: {rng.randrange(every)}us, jitter: {rng.randrange(500)}us }}")
        model = ", controller: { model: basic }" if rng.random() < 0.3 else ""
        nodes.append(f"  - {{ name: {name}{model}, traffic: [ {', '.join(traffic)} ] }}\n")
    rate = ", dbitrate: 2000000" if fd else ""
    return f"bus: {{ bitrate: {rng.choice((250000, 500000))}{rate} }}\nnodes:\n" + "".join(nodes)


def simulated(path, time):
    """Returns what is found of a bus, which may lose frames in its simulation."""
    result = subprocess.run([CANWIRE, "analyse", path, "--json", "--simulate", time],
                            stdout=subprocess.PIPE, check=False)
    assert result.returncode in (0, 3)
    return json.loads(result.stdout)


@pytest.mark.figures
def test_no_simulated_message_is_later_than_its_bound(tmp_path):
    bounded = 0
    seeds = 60 if DEEP else 20
    for seed in range(seeds):
        path = tmp_path / f"{seed}.yaml"
        path.write_text(random_bus(random.Random(seed)))
        for m in simulated(path, "2s")["messages"]:
            bounded += m["response_ns"] is not None
            assert m["response_ns"] is None or m["seen_ns"] <= m["response_ns"], (seed, m)
    assert bounded > 5 * seeds


def worst_case(messages, me, bit):
    """The longest response of a message. The longest frame below it has just begun. All others come
    at once, as late as they may, and then at the ends of their periods."""
    above = [m for m in messages if m["rank"] <= me["rank"]]
    released = [(k * m["period_ns"] - (m["jitter_ns"] if k else 0), m["rank"], k)
                for m in above for k in range(400)]
    released.sort()
    lengths = {m["rank"]: m["length_ns"] for m in above}
    now, worst, waiting, q = me["blocking_ns"], 0, [], 0
    while True:
        while released and released[0][0] <= now + bit:
            waiting.append(released.pop(0))
        if not waiting:
            return worst
        first = min(waiting, key=lambda r: r[1:])
        waiting.remove(first)
        if first[1] == me["rank"]:
            response = me["jitter_ns"] + now + me["length_ns"] - q * me["period_ns"]
            worst, q = max(worst, response), q + 1
        now += lengths[first[1]]


def test_responses_are_those_of_the_worst_case_step_by_step(tmp_path):
    """An independent simulation of frames, as they come in the worst case."""
    checked = more = 0
    for seed in range(40):
        rng = random.Random(1000 + seed)
        text = random_bus(rng).replace(", controller: { model: basic }", "")
        path = tmp_path / f"{seed}.yaml"
        path.write_text(text)
        result = subprocess.run([CANWIRE, "analyse", path, "--json"], stdout=subprocess.PIPE,
                                check=False)
        messages = json.loads(result.stdout)["messages"]
        bit = 4000 if "bitrate: 250000" in text else 2000
        for rank, m in enumerate(messages):
            m["rank"] = rank
        for m in messages:
            assert m["exact"]
            if m["response_ns"] is None:
                continue
            assert worst_case(messages, m, bit) == m["response_ns"], (seed, m)
            checked += 1
            more += m["response_ns"] > m["blocking_ns"] + m["jitter_ns"] + m["length_ns"]
    assert checked > 200 and more > 100


def ends_of(path, until):
    events = (json.loads(line) for line in sim(path, "--until", until, "--events", "-")
              .stdout.splitlines())
    ends = {}
    for e in events:
        if e["event"] == "tx":
            ends.setdefault(e["frame"], []).append(round(e["t"] * 1e9))
    return ends


def bus_of(traffic):
    return "bus: { bitrate: 500000 }\nnodes:\n  - { name: listener }\n" + "".join(
        f"  - {{ name: n{i}, traffic: [ {{ {text} }} ] }}\n" for i, text in enumerate(traffic))


def random_messages(rng):
    """Messages of different nodes, sorted by priority, of 60 to 95 % load."""
    messages = []
    for identifier in sorted(rng.sample(range(0x100, 0x700), rng.randint(3, 6))):
        data = bytes(rng.choice((0, 0xFF, 0x0F)) for _ in range(rng.randint(0, 8))).hex().upper()
        messages.append({"frame": f"{identifier:03X}#{data}", "jitter_ns": 0,
                         "period_ns": rng.randrange(600, 1500, 2) * 1000})
    return messages


def find_lengths(write, messages):
    """The time of each frame on the wire, with its intermission."""
    alone = ends_of(write(bus_of(f"send: '{m['frame']}', offset: {i + 1}ms"
                                 for i, m in enumerate(messages))), "10ms")
    for i, m in enumerate(messages):
        m["rank"] = i
        m["length_ns"] = alone[m["frame"]][0] - (i + 1) * 1_000_000 + 3 * 2000


@pytest.mark.parametrize("seed", range(12))
def test_the_bus_does_what_the_worst_case_says(write, seed):
    """All others come when the SOF of the frame that blocks is just over. The longest response
    on the bus is that of the analysis with the real lengths, but for the intermission."""
    rng = random.Random(seed)
    messages = random_messages(rng)
    find_lengths(write, messages)
    while True:
        me = rng.choice(messages[:-1])
        above = messages[:me["rank"] + 1]
        if sum(m["length_ns"] / m["period_ns"] for m in above) < 0.95:
            break
    blocker = max(messages[me["rank"] + 1:], key=lambda m: m["length_ns"])
    path = write(bus_of([f"send: '{blocker['frame']}', offset: 1ms"] + [
        f"send: '{m['frame']}', offset: 1004us, every: {m['period_ns'] // 1000}us"
        for m in above]))
    seen = [end - 1_004_000 - i * me["period_ns"]
            for i, end in enumerate(ends_of(path, "40ms")[me["frame"]])]
    me["blocking_ns"] = blocker["length_ns"] - 4000
    assert max(seen) == worst_case(messages, me, 2000) - 3 * 2000


@pytest.mark.parametrize("model, exact", [
    ("", True), (", order: fifo", False), (", controller: { model: basic }", False)])
def test_bounds_are_told_from_exact_results(write, model, exact):
    path = write(PAPER.replace("name: c", "name: c" + model).replace("3500us", "10ms"))
    assert by_id(analyse(path))["003"]["exact"] == exact
    assert ("~" in canwire("analyse", path).stdout) != exact


def test_slow_clocks_make_frames_longer(write):
    """A bit 1 % longer, and one more for the differences of clocks."""
    path = write(PAPER.replace("name: b", "name: b, ppm: -10000").replace("00us", "0ms"))
    length = by_id(analyse(path))["001"]["length_ns"]
    assert length == pytest.approx(1_000_000 / 0.99 + 8000, abs=20)


def test_loads_by_stuffing(write):
    result = analyse(write(PAPER.replace("3500us", "10ms").replace("2500us", "10ms")))
    assert result["load_longest_ppm"] == 300_000
    assert result["load_mean_ppm"] < result["load_ppm"] < result["load_longest_ppm"]
    assert sum(n["load_mean_ppm"] for n in result["nodes"]) == result["load_mean_ppm"]
    assert 225_000 < result["load_mean_ppm"] < 260_000


def test_identifiers_with_stuff_bits_are_named(write):
    path = write(PAPER.replace("001#", "555#"))
    assert {i: m["id_stuff_bits"] for i, m in by_id(analyse(path, status=3)).items()} == {
        "002": 2, "003": 2, "555": 0}
    assert "stuff bits: 002 003" in canwire("analyse", path, status=3).stdout


def test_errors_at_random(write):
    path = write(PAPER.replace("3500us", "20ms").replace("2500us", "20ms"))
    result = analyse(path, "--error-rate", "1e-5")
    assert result["error_every_ns"] == 800_000_000
    assert result["frame_error_rate"] == pytest.approx(1 - (1 - 1e-5) ** 125)
    assert result["undetected_per_hour"] == pytest.approx(
        150 * 3600 * result["frame_error_rate"] * 4.7e-11)
    message = by_id(result)["003"]
    assert message["errors_survived"] == int((20 - 3) / 1.248)
    assert 0 < message["late_probability"] < 1e-20
    often = by_id(analyse(path, "--error-rate", "1000/s", "--error-every", "10ms", status=0))
    assert often["003"]["late_probability"] > 0.5
    table = canwire("analyse", path, "--error-rate", "1e-5").stdout.splitlines()
    assert table[0].split()[-2:] == ["ERRORS", "P(LATE)"]


@pytest.mark.parametrize("rate", ["0", "1", "2", "-1", "x", "10/", "/s", "0/s", "1e-5/s"])
def test_bad_error_rates(write, rate):
    result = canwire("analyse", write(PAPER), f"--error-rate={rate}", status=1)
    assert f"--error-rate {rate}: expected" in result.stderr


def test_ports_and_replays_make_it_incomplete(write, tmp_path):
    (tmp_path / "log").write_text("(1.0) can0 123#\n")
    assert analyse(write(PAPER))["complete"]
    path = write(PAPER + "  - { name: d, traffic: [ { replay: log } ] }\n")
    assert not analyse(path)["complete"]
    assert "not known" in canwire("analyse", path).stdout


@pytest.mark.parametrize("nodes, note", [
    ("  - { name: d, time-triggered: on, local-time: { unit: 1us }, schedule: { reference: '003', "
     "triggers: [ { at: 900, slot: 50us, send: '020#00' } ] } }\n", "Triggers of nodes whose"),
    ("  - { name: d, time-triggered: on, local-time: { unit: 1us }, schedule: { reference: '010', "
     "triggers: [ { at: 900, slot: 50us, send: '020#00' } ] } }\n", "Triggers of nodes whose"),
    ("  - { name: d, controller: { model: full, mailboxes: [ { direction: tx, id: 123, "
     "reply: auto, data: 00FF } ] } }\n", "Frames of ports, replays and replies"),
    ("  - { name: d, sleep: on, wake-time: 2ms }\n", "Nodes may sleep")])
def test_what_is_not_known_is_told(write, nodes, note):
    assert analyse(write(PAPER))["notes"] == []
    path = write(PAPER + nodes)
    result = analyse(path)
    assert not result["complete"]
    assert [n for n in result["notes"] if n.startswith(note)]
    assert f"\n{note}" in canwire("analyse", path).stdout


def schedule_of(name, triggers, keys=""):
    slots = ", ".join(f"{{ {t} }}" for t in triggers)
    return (f"  - {{ name: {name}, time-triggered: on, {keys}local-time: {{ unit: 1us }}, "
            f"schedule: {{ reference: '010', cycles: 4, triggers: [ {slots} ] }} }}\n")


SCHEDULED = ("bus: { bitrate: 500000 }\nnodes:\n"
             + schedule_of("m", ["at: 500, slot: 200us, send: 100#00", "at: 5ms, slot: 30us, "
                                 "send: 010#00"], "ppm: 1000, ")
             + schedule_of("s", ["at: 1000, slot: 2ms, cycle: 1, repeat: 2, send: 200#00, "
                                 "window: arbitrating"])
             + "  - { name: t, traffic: [ { send: 400#00, every: 20ms } ] }\n")


def test_triggers_are_messages_of_their_nodes(write):
    """All frames have 65 bits at most: 130 us. So 400 waits for the three others, which come once
    each. A frame in a slot waits for one frame and a bit, or for its slot and a bit. The clock of m
    is fast, so 5 ms of it are 4.995005 ms, and its slot lasts 29.970 us: 2398 ticks, rounded up."""
    path = write(SCHEDULED)
    result = analyse(path, "--simulate", "1s")
    messages = by_id(result)
    assert result["complete"] and result["notes"] == []
    assert [messages[i]["response_ns"] for i in ("010", "100", "200", "400")] == [
        29_975 + 2000 + 130_000, 262_000, 262_000, 520_000]
    assert [messages[i]["period_ns"] for i in ("010", "100", "200", "400")] == [
        4_995_000, 4_995_000, 9_990_000, 20_000_000]
    assert [messages[i].get("window") for i in ("010", "200", "400")] == [
        "exclusive", "arbitrating", None]
    assert [messages[i]["exact"] for i in ("010", "400")] == [False, True]
    assert all(m["seen_ns"] <= m["response_ns"] and m["lost"] == 0 for m in messages.values())
    assert result["load_longest_ppm"] == pytest.approx(
        130_000 * (2.5 / 4_995_000 + 1 / 20_000_000) * 1e6, abs=50)
    assert "begin in their slots, or are given up" in canwire("analyse", path).stdout


def test_triggers_lose_their_frames_to_errors_at_once(write):
    """One attempt: an error in the 65 bits at most of its frame is enough."""
    message = by_id(analyse(write(SCHEDULED), "--error-rate", "1e-5"))["200"]
    assert message["errors_survived"] == 0
    assert message["late_probability"] == pytest.approx(1 - (1 - 1e-5) ** 65)


@pytest.mark.parametrize("window, status", [("exclusive", 3), ("arbitrating", 0)])
def test_slots_that_are_not_sent(write, window, status):
    """Both triggers come at once, so that of the slave never wins. 20 cycles begin in 101 ms,
    from 5 ms on."""
    path = write("bus: { bitrate: 500000 }\nnodes:\n"
                 + schedule_of("m", ["at: 500, slot: 100us, send: 100#", "at: 5ms, slot: 30us, "
                                     "send: 010#00"])
                 + schedule_of("s", [f"at: 500, slot: 9us, send: 101#, window: {window}"]))
    message = by_id(analyse(path, "--simulate", "101ms", status=status))["101"]
    assert message["seen_ns"] is None and message["given_up"] == 20
    assert message["lost"] == (20 if window == "exclusive" else 0)
    table = canwire("analyse", path, "--simulate", "101ms", status=status).stdout
    assert ("20 lost" if window == "exclusive" else "20 given up") in table


def random_slots(rng, reference, cycle, used):
    """A time-triggered node with slots, of which some are those of others, too. Its traffic keeps
    to no slot."""
    triggers, at = [], rng.randrange(150, 600)
    while at < cycle - 400 and len(triggers) < 4:
        slot = rng.randrange(20, 900)
        while (identifier := rng.randrange(0x20, 0x7F0)) in used:
            pass
        used.add(identifier)
        each = rng.choice(("", "cycle: 1, repeat: 2, ", "cycle: 3, "))
        data = rng.choice(("", "00", "FFFF0000", "0F0F0F0F0F0F0F0F"))
        triggers.append(f"at: {at}, slot: {slot}, {each}send: '{identifier:03X}#{data}', "
                        "window: arbitrating")
        at += slot + rng.randrange(1, 700)
    if reference:
        triggers.append(f"at: {max(at, cycle)}, slot: 400us, send: '{reference:03X}#0000'")
    capture = rng.choice(("sof", "eof"))
    byte = rng.choice(("", "cycle-byte: 1, "))
    keys = rng.choice(("", f"ppm: {rng.randrange(-900, 900)}, ", "order: fifo, ",
                       "controller: { model: basic }, "))
    while (identifier := rng.randrange(0x20, 0x7F0)) in used:
        pass
    used.add(identifier)
    own = (f"traffic: [ {{ send: '{identifier:03X}#55', every: 10ms, "
           f"offset: {rng.randrange(10000)}us }} ], " if rng.random() < 0.3 else "")
    return (f"time-triggered: on, {keys}{own}local-time: {{ unit: 1us, capture: {capture} }}, "
            f"schedule: {{ reference: '010:7FE', cycles: 4, {byte}"
            f"triggers: [ {', '.join(f'{{ {t} }}' for t in triggers)} ] }}")


def random_schedules(rng):
    """A matrix with one time master or two, and traffic beside it."""
    cycle = rng.choice((2000, 3000, 5000))
    text = random_bus(rng)
    used = {int(i, 16) for i in re.findall(r"send: '([0-9A-F]{3})#", text)} | {0x10, 0x11}
    masters = [0x10, 0x11] if rng.random() < 0.3 else [0x10]
    for n, reference in enumerate([*masters, *[None] * rng.randint(1, 3)]):
        late = rng.choice((0, 400, 700)) if reference == 0x11 else 0
        text += f"  - {{ name: tt{n}, {random_slots(rng, reference, cycle + late, used)} }}\n"
    return text


@pytest.mark.figures
def test_no_bus_with_schedules_is_later_than_its_bounds(tmp_path):
    bounded = {True: 0, False: 0}
    close = 0
    seeds = 50 if DEEP else 17
    for seed in range(seeds):
        path = tmp_path / f"{seed}.yaml"
        path.write_text(random_schedules(random.Random(seed)))
        found = simulated(path, "1s")
        assert found["complete"]
        for m in found["messages"]:
            bounded["slot_ns" in m] += m["response_ns"] is not None and m["seen_ns"] is not None
            if m["response_ns"] is None or m["seen_ns"] is None:
                continue
            assert m["seen_ns"] <= m["response_ns"], (seed, m)
            close += m["seen_ns"] > m["response_ns"] / 2
    assert min(bounded.values()) > 2 * seeds and close > 2 * seeds


@pytest.mark.parametrize("every, ppm", [("5100us", 0), ("1ms", 0), ("1ms", -5000)])
def test_the_first_integration_is_no_part_of_a_response_time(write, every, ppm):
    """At time 0 all nodes wait for 11 recessive bits, and a frame without offset does so, too."""
    path = write("bus: { bitrate: 500000 }\nnodes:\n"
                 f"  - {{ name: a, traffic: [ {{ send: 400#00, every: {every} }} ] }}\n"
                 f"  - {{ name: b, ppm: {ppm} }}\n")
    message = analyse(path, "--simulate", "50ms")["messages"][0]
    assert message["lost"] == 0
    assert 0 < message["seen_ns"] <= message["response_ns"]
    assert ppm or message["response_ns"] == 130_000


ALONE = ("bus: { bitrate: 500000 }\nnodes:\n"
         "  - { name: a, traffic: [ { send: 400#00, every: 10ms, offset: 1ms } ] }\n"
         "  - { name: b, listen-only: on }\n")


def test_frames_that_never_come_are_lost(write):
    """Nobody acknowledges. The tenth frame begins at 91 ms, and its time is over at 91.13 ms."""
    path = write(ALONE)
    message = analyse(path, "--simulate", "100ms", status=3)["messages"][0]
    assert message["seen_ns"] is None and message["lost"] == 10
    assert "  10 lost" in canwire("analyse", path, "--simulate", "100ms", status=3).stdout
    assert analyse(path, "--simulate", "1100us")["messages"][0]["lost"] == 0
    assert "lost" not in analyse(path)["messages"][0]


def test_frames_that_come_are_not_lost(write):
    message = analyse(write(ALONE.replace(", listen-only: on", "")), "--simulate", "100ms")
    assert message["messages"][0]["lost"] == 0


def test_frames_of_one_attempt_may_be_lost(write):
    """The other frame comes at the same time, and wins each arbitration."""
    path = write("bus: { bitrate: 500000 }\nnodes:\n"
                 "  - { name: a, traffic: [ { send: 400#00, every: 20ms } ] }\n"
                 "  - { name: b, one-shot: on, traffic: [ { send: 500#00, every: 10ms } ] }\n")
    lost = {i: m["lost"] for i, m in by_id(analyse(path, "--simulate", "99ms", status=3)).items()}
    assert lost == {"400": 0, "500": 5}


FULL = """
bus: {{ bitrate: 500000 }}
nodes:
  - name: a
    controller: {{ model: full, {} }}
    traffic: [ {{ send: 100#00, every: 10ms }}, {{ send: 200#00, every: 10ms }} ]
  - {{ name: b, traffic: [ {{ send: 150#00, every: 10ms }} ] }}
"""


@pytest.mark.parametrize("keys, exact", [
    ("transmit: priority", True),
    ("transmit: number", False),
    ("transmit: request", False),
    ("mailboxes: [ { direction: tx }, { direction: tx } ]", True),
    ("mailboxes: [ { direction: tx } ]", False),
    ("mailboxes: [ { direction: tx, id: 200 }, { direction: tx, id: 100 } ]", True),
    ("mailboxes: [ { direction: tx, id: 100 }, { direction: tx } ]", True),
    ("mailboxes: [ { direction: tx }, { direction: tx, id: 100 } ]", False),
    ("mailboxes: [ { direction: rx }, { direction: tx, id: '100:400' } ]", False)])
def test_mailboxes_for_all_messages_make_it_exact(write, keys, exact):
    """A frame takes the first free mailbox, so 100 may be in the only one that is for 200."""
    result = by_id(analyse(write(FULL.format(keys)), "--simulate", "100ms"))
    assert [result[i]["exact"] for i in ("100", "200", "150")] == [exact, exact, True]
    assert result["100"]["response_ns"] == (260_000 if exact else 390_000)


def test_frames_that_wait_for_a_mailbox_stay_below_the_bound(write):
    """200 is in the only mailbox and loses against 150, while 100 waits behind it."""
    text = FULL.format("mailboxes: [ { direction: tx } ]").replace(
        "200#00, every: 10ms", "200#00, every: 10ms, offset: 1ms").replace(
        "150#00, every: 10ms", "150#00, every: 10ms, offset: 1ms").replace(
        "100#00, every: 10ms", "100#00, every: 10ms, offset: 1010us")
    message = by_id(analyse(write(text), "--simulate", "100ms"))["100"]
    assert 260_000 < message["seen_ns"] <= message["response_ns"]


def test_a_rig_is_no_bus(tmp_path):
    (tmp_path / "rig.yaml").write_text("buses: [ a.yaml, b.yaml ]\n")
    result = canwire("analyse", tmp_path / "rig.yaml", status=1)
    assert "is a rig: analyse its buses one by one" in result.stderr


def test_errors_make_responses_longer(write):
    path = write(PAPER.replace("3500us", "20ms").replace("2500us", "20ms"))
    clean, noisy = by_id(analyse(path)), by_id(analyse(path, "--error-every", "10ms"))
    assert noisy["003"]["response_ns"] - clean["003"]["response_ns"] == 31 * 8000 + 1_000_000


@pytest.mark.parametrize("arguments, status", [
    ([], 2), (["bus.yaml", "--simulate", "0"], 1), (["bus.yaml", "--simulate", "x"], 1),
    (["none.yaml"], 1), (["bus.yaml", "--what"], 2), (["--help"], 0)])
def test_command_lines(write, tmp_path, arguments, status):
    write(PAPER)
    result = canwire("analyse", *arguments, status=status, cwd=tmp_path)
    assert (result.stdout if status == 0 else result.stderr) != ""
