# SPDX-License-Identifier: MIT
"""VCD and pictures of nodes that have bits of their own: the wire is what the nodes drive.

The levels at each moment are those of `unit/test_clocks.c`. Here they are in the files.
"""

import random
import re

import pytest

from depth import some
from simtool import sim

UNITS = 10  # of a dump in a nanosecond


def random_bus(seed, at):
    """A bus off the grid with rules that change levels. at: where they act."""
    draw = random.Random(seed)
    count, fd = draw.randint(2, 4), draw.random() < 0.6
    text = ["bus: { name: b, bitrate: 500000%s }" % (", dbitrate: 2000000" if fd else ""), "nodes:"]
    for i in range(count):
        frame = f"{draw.randrange(0x800):03X}" + ("##1" if fd and draw.random() < 0.6 else "#")
        frame += draw.randbytes(draw.randint(0, 8)).hex()
        text += [f"  - name: n{i}", f"    ppm: {draw.choice([0, 100, -900, 1500, -3000])}",
                 f"    tx-delay: {draw.choice([0, 0, 80, 200])}ns",
                 f'    traffic: [ {{ send: "{frame}", every: {draw.randint(150, 900)}us, '
                 f"offset: {draw.randint(0, 300)}us, count: 3 }} ]"]
    text += ["faults:"]
    for i in range(4):
        place = at.format(draw.randrange(count))
        time = f"offset: {draw.randint(0, 6000)}ns, for: {draw.randint(20, 4000)}ns"
        when = f"time: {draw.randint(20, 900)}us"
        if i % 2:
            when, time = 'frame: "000:000", every: 2', f'from: "bit[{draw.randint(1, 60)}]", {time}'
        level = draw.choice(["dominant", "recessive"])
        text += [f"  - {{ name: r{i}, when: {{ {when} }}, "
                 f"do: {{ pulse: {level}, {time}, at: {place} }} }}"]
    return "\n".join(text) + "\n"


def levels(dump):
    """Returns [(time, wire, levels that nodes drive, in a bit with a fault)]."""
    header, body = dump.split("$enddefinitions $end\n")
    nodes = re.findall(r"\$var wire 1 (d\d+) ", header)
    now, moments = {}, []
    for block in re.split(r"^#", body, flags=re.M)[1:]:
        time, *changes = block.splitlines()
        now |= {c[1:]: int(c[0]) for c in changes if c[0] in "01"}
        moments.append((int(time), now["w"], [now[n] for n in nodes], now["m"]))
    return moments


@pytest.mark.parametrize("at", ["[n{}]", "n{}.rx", "n{}.tx"])
@pytest.mark.parametrize("seed", some(range(4), 2))
def test_the_wire_is_what_the_nodes_drive(seed, at, write):
    """These rules leave the wire alone."""
    dump = sim(write(random_bus(seed, at)), "--until", "1ms", "--vcd", "-").stdout
    moments = levels(dump)
    assert len({tuple(driven) for _, _, driven, _ in moments}) > 2
    assert [m for m in moments if m[1] != min(m[2])] == []


@pytest.mark.parametrize("seed", range(4))
def test_rules_change_the_wire_in_bits_with_faults(seed, write):
    moments = levels(sim(write(random_bus(seed, "wire")), "--until", "1ms", "--vcd", "-").stdout)
    changed = [m for m in moments if m[1] != min(m[2])]
    assert changed and all(m[3] for m in changed)


OWN_CLOCKS = """
bus: { name: b, bitrate: 500000, dbitrate: 2000000 }
nodes:
  - { name: n0, ppm: 300, traffic: [ { send: "555##1AA55", every: 300us, count: 3 } ] }
  - { name: n1, ppm: -400 }
faults:
  - { name: p, when: { time: 100us }, do: { pulse: dominant, offset: 697ns, for: 240ns, at: %s } }
"""


@pytest.mark.parametrize("at, changed", [("[n0]", []), ("wire", [100_697, 100_937])])
def test_a_pulse_is_on_the_wire_only_where_it_acts(at, changed, write):
    """The bus is idle then."""
    done = sim(write(OWN_CLOCKS % at), "--from", "98us", "--to", "110us", "--vcd", "-")
    moments = levels(done.stdout)
    assert all(driven == [1, 1] for _, _, driven, _ in moments)
    edges = [b[0] for a, b in zip(moments, moments[1:]) if a[1] != b[1]]
    assert len(edges) == len(changed)
    assert all(abs(a - b * UNITS) <= 1 for a, b in zip(edges, changed))


def test_a_picture_has_the_levels_of_the_dump(write, tmp_path):
    """The wire of a picture changes as often as that of the dump, and at the same places."""
    path = write(OWN_CLOCKS % "wire")
    sim(path, "--from", "20us", "--to", "60us", "--vcd", tmp_path / "v", "--svg", tmp_path / "s",
        "--until", "200us")
    moments = levels((tmp_path / "v").read_text())
    edges = [b[0] for a, b in zip(moments, moments[1:]) if a[1] != b[1]]
    wire = re.search(r'<g class="wire">.*?<path [^>]*fill="none" d="([^"]*)"',
                     (tmp_path / "s").read_text(), re.S)
    drawn = [float(x) for x in re.findall(r"H([\d.]+)V", wire.group(1))]
    assert len(drawn) == len(edges) > 20
    scale = (drawn[-1] - drawn[0]) / (edges[-1] - edges[0])
    for place, edge in zip(drawn, edges):
        assert abs(drawn[0] + (edge - edges[0]) * scale - place) < 2


def test_a_picture_marks_secondary_sample_points(write, tmp_path):
    path = write("""
bus: { name: b, bitrate: 500000, dbitrate: 2000000 }
nodes:
  - name: a
    tx-delay: 110ns
    rx-delay: 110ns
    tdc-mode: auto
    traffic: [ { send: "123##1DEADBEEF", every: 10ms, count: 1 } ]
  - name: c
""")
    sim(path, "--until", "1ms", "--svg", tmp_path / "s")
    text = (tmp_path / "s").read_text()
    nodes = re.findall(r'<g class="node (\w)">(.*?)(?=<g class="node|$)', text, re.S)
    marks = {name: sum(part.count('class="late-sample"') for n, part in nodes if n == name)
             for name in "ac"}
    assert marks["a"] > 40 and marks["c"] == 0
