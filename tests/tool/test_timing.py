# SPDX-License-Identifier: MIT
"""`canwire timing`: segments from delays, segments as Linux finds them, text, JSON and refusals.

Linux' results are compared with can-calc-bit-timing of can-utils, for all its controllers, clocks
and rates. Needs no CAN in the kernel. tests/unit/config/test_timing*.c has the rules.
"""

import json
import re
import shutil
import subprocess

import pytest
from can import bit_timing

from simtool import CANWIRE, ROOT, TIMEOUT_S, canwire

KEYS = ["brp", "prop-seg", "phase-seg1", "phase-seg2", "sjw", "sample-point", "tolerance"]


def timing(*words, status=0):
    return canwire("timing", *words, status=status)


def values(*words):
    """Returns the values of the JSON object."""
    line, end = timing(*words, "--json").stdout.split("\n")
    found = json.loads(line)
    assert end == "" and list(found) == KEYS
    return list(found.values())


def refusal(*words):
    result = timing(*words, status=1)
    assert result.stdout == "" and "usage" not in result.stderr
    return result.stderr


# ---- From delays ---------------------------------------------------------------------------------


@pytest.mark.parametrize("clock, bitrate, quanta, delay, segments, sample, tolerance", [
    ("16MHz", 500000, 16, "500ns", [2, 4, 5, 6, 4], 0.625, 1.238),
    ("16MHz", 1000000, 16, "600ns", [1, 10, 2, 3, 2], 0.8125, 0.488),
    ("10MHz", 1000000, 10, "600ns", [1, 6, 1, 2, 1], 0.8, 0.391),
    ("16MHz", 125000, 16, "5300ns", [8, 11, 2, 2, 2], 0.875, 0.485),
    ("16000kHz", 50000, 20, "10.3us", [16, 11, 4, 4, 4], 0.8, 0.781),
])
def test_known_answers(clock, bitrate, quanta, delay, segments, sample, tolerance):
    words = ["--clock", clock, "--bitrate", bitrate, "--tq", quanta, "--delay", delay]
    found = values(*words)
    assert found[:6] == [*segments, sample]
    assert f"{found[6]:.5f}" == f"{tolerance / 100:.5f}"
    assert f"tolerance     {tolerance} %: " in timing(*words).stdout


def test_a_bit_that_is_too_short_for_the_round_trip_is_refused():
    assert refusal("--clock", "8MHz", "--bitrate", 1000000, "--tq", 8, "--delay", "600ns") == (
        "canwire timing: the round trip takes 5 of 8 tq: 2 tq left for the phase segments, "
        "3 needed\n")


def test_a_line_has_5_ns_a_metre_and_its_transceivers():
    words = ["--clock", "16MHz", "--bitrate", 500000, "--tq", 16]
    whole = values(*words, "--delay", "700ns")
    assert values(*words, "--length", "40m") == whole
    assert values(*words, "--length", "20m", "--tx-delay", "150ns", "--rx-delay", "100ns") == whole
    assert values(*words, "--tx-delay", "350ns", "--rx-delay", "0ns") == whole
    assert "for a round trip of 301 ns" in timing(*words, "--length", "1mm").stdout


@pytest.mark.parametrize("text", ["80%", "80.0%", "0.8", "0.80", "0.800"])
def test_a_sample_point_has_two_forms(text):
    assert values("--clock", "10MHz", "--bitrate", 1000000, "--sample-point", text)[:6] == [
        1, 5, 2, 2, 2, 0.8]


def test_a_sample_point_that_is_not_met_is_told():
    words = ["--clock", "16MHz", "--bitrate", 500000, "--sample-point"]
    assert "sample-point  81.25 %, the nearest to 80 %\n" in timing(*words, "80%").stdout
    assert "sample-point  87.5 %\n" in timing(*words, "87.5%").stdout


@pytest.mark.parametrize("text", ["0.", "0.8750", "1.0", ".8", "0.8%%", "0.8x", "8e-1", "5%", "80"])
def test_a_wrong_sample_point_is_refused(text):
    assert "87.5% or 0.875" in refusal("--clock", "10MHz", "--bitrate", 1000000,
                                       "--sample-point", text)


def test_without_tq_the_best_number_is_taken():
    words = ["--clock", "80MHz", "--bitrate", 500000]
    for more in (["--delay", "500ns"], []):
        best = values(*words, *more)
        others = [values(*words, *more, "--tq", n) for n in (8, 10, 16, 20)]
        assert best in others
        if more:
            assert best[6] == max(other[6] for other in others)
        else:
            assert abs(best[5] - .875) == min(abs(other[5] - .875) for other in others)


def test_a_controller_limits_the_prescaler():
    words = ["--clock", "80MHz", "--bitrate", 50000, "--tq", 16, "--delay", "500ns"]
    assert values(*words)[0] == 100
    assert values(*words, "--controller", "bxcan")[0] == 100
    assert "brp would be 100, sja1000 has 1 to 64" in refusal(*words, "--controller", "sja1000")


def test_all_controllers_are_in_the_help():
    told = timing("--help").stdout.partition("Controllers:")[2].split()
    assert len(told) == len(set(told)) >= 30
    for name in told:
        values("--clock", "16MHz", "--bitrate", 250000, "--controller", name)


def test_a_clock_that_cannot_be_divided_is_refused():
    assert refusal("--clock", "33.333333MHz", "--bitrate", 500000) == (
        "canwire timing: a clock of 33333333 Hz cannot be divided into 8 to 25 tq at 500000 "
        "bit/s\n")


@pytest.mark.parametrize("words, message", [
    (["--bitrate", 500000], "both are needed"),
    (["--clock", "16MHz"], "both are needed"),
    (["--clock", "16MHz", "--bitrate", 500000, "bus.yaml"], "only options"),
    (["--clock", "16MHz", "--bitrate", 500000, "--delay", "1us", "--length", "1m"], "whole round"),
    (["--clock", "16MHz", "--bitrate", 500000, "--kernel", "--tq", 16], "Linux knows no --tq"),
    (["--clock", "16MHz", "--bitrate", 500000, "--kernel", "--length", "1m"], "no delays"),
])
def test_options_that_do_not_go_together_are_wrong_usage(words, message):
    error = timing(*words, status=2).stderr
    assert message in error and "usage: canwire timing" in error


@pytest.mark.parametrize("version", ["", "6", "4.7", "2.6.31", "6.12x", " 6.12", "-6.1", "v6.1"])
def test_a_wrong_version_of_linux_is_refused(version):
    assert "4.8 or later" in refusal("--clock", "16MHz", "--bitrate", 500000,
                                     f"--kernel={version}")


@pytest.mark.parametrize("option, value", [
    ("--clock", "99kHz"), ("--clock", "1.1GHz"), ("--length", "11km"), ("--delay", "1s"),
    ("--bitrate", "500k"), ("--bitrate", "20000001"), ("--tq", "26"), ("--sjw", "129")])
def test_values_have_limits(option, value):
    assert f"{option} {value}: expected " in refusal("--clock", "16MHz", "--bitrate", 500000,
                                                     option, value)


def test_the_example_of_the_manual_is_true():
    page = (ROOT / "daemon/man/canwire.1.md").read_text(encoding="utf-8")
    command, shown = re.search(r"^    \$ canwire timing (.*)\n((?:    .+\n)+)", page,
                               re.MULTILINE).groups()
    assert timing(*command.split()).stdout == re.sub(r"^    ", "", shown, flags=re.MULTILINE)
    other = timing("--clock", "16MHz", "--bitrate", 500000, "--delay", "500ns", "--tq", 8).stdout
    assert "tolerance     0.99 %: " in other


# ---- Of a configuration --------------------------------------------------------------------------

# tq of 125 ns, and 62.5 ns on the line and in the transceivers of `far`
BUS = """
bus: { name: body, bitrate: 500000, sample-point: 80%, line: { delay: 5ns/m } }
nodes:
  - { name: near, clock: 16MHz, brp: 2, prop-seg: 4, phase-seg1: 5, phase-seg2: 6, sjw: 4 }
  - { name: far, clock: 16MHz, ppm: 600, brp: 2, prop-seg: 6, phase-seg1: 5, phase-seg2: 4, sjw: 3,
      tx-delay: 40ns, rx-delay: { dominant: 20ns, recessive: 60ns }, position: 20m, stub: 50cm }
  - { name: odd, clock: 8MHz, brp: 1, prop-seg: 8, phase-seg1: 4, phase-seg2: 4, ppm: -100 }
"""


@pytest.fixture(name="table")
def fixture_table(tmp_path):
    def table(text, *words, status=0):
        path = tmp_path / "bus.yaml"
        path.write_text(text)
        return timing(path, *words, status=status)

    return table


def test_the_nodes_of_a_configuration_as_json(table):
    bus = json.loads(table(BUS, "--json").stdout)
    near, far, odd = bus.pop("nodes")
    assert bus == {"bus": "body", "bitrate": 500000, "sample-point": 0.8}
    assert set(KEYS) < set(near)
    assert [near[key] for key in KEYS] == [2, 4, 5, 6, 4, 0.625, 0.012376237]
    assert (near["tq"], near["sample-point-error"], near["ppm"]) == (125, -0.175, 0)
    # 17 tq in place of 16: 58823.529 ppm below; 17 x (1 - 100 ppm) against 16 x (1 + 600 ppm)
    assert odd["bitrate-error"] == -58823.529
    need = (17 * 1000600 - 16 * 999900) / (17 * 1000600 + 16 * 999900)
    limit = min(far["tolerance"], odd["tolerance"])
    assert far["clock-node"] == "odd" and odd["clock-node"] == "far"
    assert far["tolerance-left"] == pytest.approx(limit - need, abs=2e-9)
    assert odd["tolerance-left"] == far["tolerance-left"]
    assert odd["resynchronisations"] == 15
    # 4 tq are 500 ns; the transceivers take 40 + 60 ns, and 200 ns are 40 m with the stub
    assert near["line-node"] == "far" and near["longest-line"] == 39.5
    assert near["round-trip"] == 2 * (20 + 0.5) * 5 + 100


def test_the_sufficient_tolerance_is_shown_too(table):
    segments = "clock: 16MHz, brp: 8, prop-seg: 11, phase-seg1: 2, phase-seg2: 2, sjw: 2"
    nodes = json.loads(table(f"""
bus: {{ bitrate: 125000 }}
nodes: [ {{ name: a, {segments} }}, {{ name: b, {segments}, ppm: 1000 }} ]
""", "--json").stdout)["nodes"]
    need = 1000 / 2001000
    assert nodes[0]["sufficient"] == 0.002427184
    assert nodes[0]["tolerance-left"] == pytest.approx(2 / 412 - need, abs=2e-9)
    assert nodes[0]["sufficient-left"] == pytest.approx(1 / 412 - need, abs=2e-9)


def test_the_nodes_of_a_configuration_as_a_table(table):
    bus, title, *rows = table(BUS).stdout.splitlines()
    assert bus == "bus body: bitrate 500000 sample-point 0.8 line-delay 5 ns/m"
    assert len({len(row) for row in [title, *rows]}) == 1
    # near and odd: (17 - 16 x 0.9999) / (17 + 16 x 0.9999) is 3.0353 %; sjw 2 allows 0.5882
    assert rows[0].split() == ["near", "125", "4-5-6/4", "2", "62.5", "-17.5", "0", "0",
                               "-2.448", "-2.448", "odd", "39.5", "far", "15"]
    assert [row.split()[0] for row in rows] == ["near", "far", "odd"]


def test_without_keys_of_time_all_nodes_have_the_bits_of_the_bus(table):
    text = "{ bus: { bitrate: 800000 }, nodes: [ { name: a }, { name: b } ] }"
    for node in json.loads(table(text, "--json").stdout)["nodes"]:
        assert node["bitrate-error"] == 0 and node["tq"] == 78.125
        assert node["tolerance-left"] == node["tolerance"] and node["resynchronisations"] == 0


def test_a_node_alone_has_nobody_to_differ_from(table):
    text = "{ bus: { bitrate: 500000 }, nodes: [ { name: a } ] }"
    assert "tolerance-left" not in json.loads(table(text, "--json").stdout)["nodes"][0]
    assert table(text).stdout.splitlines()[2].split()[8:] == ["-"] * 6


def test_a_bad_configuration_has_no_table(table):
    result = table("{ bus: { bitrate: 1 }, nodes: [ { name: a } ] }", status=1)
    assert result.stdout == "" and "bus.yaml:1:19: bitrate" in result.stderr


DOOR = """
bus: { name: door, bitrate: 500000 }
defaults: { clock: 16MHz, brp: 2, prop-seg: 4, phase-seg1: 5, phase-seg2: 6, sjw: 4 }
nodes:
  - { name: lock, ppm: -100 }
  - { name: dash, brp: 2, prop-seg: 11, phase-seg1: 2, phase-seg2: 2, sjw: 2, ppm: 300 }
"""


def test_the_table_of_the_manual_is_true(table):
    page = (ROOT / "daemon/man/canwire.1.md").read_text(encoding="utf-8")
    shown = re.search(r"^    bus door.*\n(?:    .+\n)+", page, re.MULTILINE)[0].splitlines()
    for line, told in zip(shown, table(DOOR).stdout.splitlines(), strict=True):
        assert told.startswith(line.strip().removesuffix("  ..."))


# ---- As Linux ------------------------------------------------------------------------------------


def test_text_tells_how_far_off_the_bit_rate_is():
    words = ["--kernel", "--controller", "mscan", "--clock", "33MHz"]
    assert timing(*words, "--bitrate", 800000).stdout.startswith(
        "bit           14 tq of 90.909 ns: 785714 bit/s, 1.79 % below 800000\n")
    assert timing(*words, "--bitrate", 500000).stdout.startswith(
        "bit           11 tq of 181.818 ns: 500000 bit/s\n")


def calculator(*words):
    done = subprocess.run(["can-calc-bit-timing", *words], capture_output=True, text=True,
                          timeout=TIMEOUT_S, check=True)
    return done.stdout


def rows(text):
    """Yields controller, clock, version of Linux, bit rate, and segments or None."""
    for table in re.split(r"^(?=Bit timing parameters for )", text, flags=re.MULTILINE)[1:]:
        head, *lines = table.split("\n")
        name, clock = re.match(r"Bit timing .* for (\S+).* with ([\d.]+) MHz", head).groups()
        algorithm = re.search(r"algo 'v([\d.]+)'", head)
        for line in lines:
            found = re.match(r" *(\d+)((?: +\d+){7}) ", line)
            if found or "not possible" in line:
                bitrate = int(line.split()[0])
                # The oldest version with a table of this form is that of Linux 4.8.
                yield (name, round(float(clock) * 1e6), algorithm[1] if algorithm else "4.8",
                       bitrate, [int(n) for n in found[2].split()[1:6]] if found else None)


def compare(*words, wish=()):
    """Compares each row; returns the number of those with segments. canwire refuses segments that
    the controller lacks."""
    count = 0
    for name, clock, version, bitrate, segments in rows(calculator(*words)):
        ours = ["--clock", clock, "--bitrate", bitrate, "--controller", name, *wish,
                f"--kernel={version}", "--json"]
        result = subprocess.run([CANWIRE, "timing", *map(str, ours)], capture_output=True,
                                text=True, timeout=TIMEOUT_S, check=False)
        if result.returncode == 0:
            found = json.loads(result.stdout)
            assert [*(found[key] for key in KEYS[1:5]), found["brp"]] == segments, ours
            count += 1
        else:
            assert segments is None or is_impossible(segments, result.stderr), (ours, segments)
    return count


def is_impossible(segments, error):
    """The calculator does not check the smallest prop-seg + phase-seg1. At a sample point that is
    not possible, its segments are what it has tried last, or zeros."""
    least = re.search(r"prop-seg \+ phase-seg1 would be (\d+), ", error)
    if least:
        return sum(segments[:2]) == int(least[1])
    return "has no segments" in error


needs_calculator = pytest.mark.skipif(shutil.which("can-calc-bit-timing") is None,
                                      reason="can-calc-bit-timing of can-utils is not installed")


@pytest.mark.figures
@needs_calculator
def test_segments_are_those_of_can_utils():
    assert compare() >= 150


@needs_calculator
@pytest.mark.parametrize("bitrate", [666666, 83333, 33333, 95238, 5000, 2000000])
def test_at_other_bit_rates_too(bitrate):
    assert compare("-b", str(bitrate)) >= 5


@pytest.mark.figures
@needs_calculator
@pytest.mark.parametrize("clock", [8000000, 12000000, 25000000, 40000000, 48000000, 59970000,
                                   80000000])
def test_with_other_clocks_too(clock):
    assert compare("-c", str(clock)) >= 50


@pytest.mark.figures
@needs_calculator
@pytest.mark.parametrize("permille", [500, 612, 700, 750, 800, 900])
def test_at_wished_sample_points_too(permille):
    wish = ["--sample-point", f"{permille / 1000}"]
    assert compare("-s", str(permille), wish=wish) >= 100


def test_newer_versions_take_the_smallest_prescaler_and_a_larger_sjw():
    words = ["--clock", "66.66MHz", "--bitrate", 1000000, "--controller", "mscan"]
    assert values(*words, "--kernel=5.18")[:5] == [6, 3, 4, 3, 1]
    assert values(*words, "--kernel=5.19")[:5] == [3, 7, 8, 6, 1]
    assert values(*words, "--kernel=6.3")[:5] == [3, 7, 8, 6, 3]
    assert values(*words, "--kernel") == values(*words, "--kernel=6.3")


# ---- CAN FD --------------------------------------------------------------------------------------

DATA_KEYS = ["dbrp", "dprop-seg", "dphase-seg1", "dphase-seg2", "dsjw", "dtq", "dsample-point",
             "dtolerance"]


def both(clock, bitrate, dbitrate, *words):
    """Returns the JSON object with both phases."""
    found = json.loads(timing("--clock", clock, "--bitrate", bitrate, "--dbitrate", dbitrate,
                              *words, "--json").stdout)
    assert list(found) == [*KEYS, *DATA_KEYS] + ["tdco"] * (found["dbrp"] <= 2)
    return found


def tolerance_of(t):
    """Returns T10 of the data phase, as python-can computes it."""
    bit = 1 + t["prop-seg"] + t["phase-seg1"] + t["phase-seg2"]
    dbit = 1 + t["dprop-seg"] + t["dphase-seg1"] + t["dphase-seg2"]
    return max(0, min(
        bit_timing._oscillator_tolerance_condition_3(data_sjw=t["dsjw"], dbt=dbit),
        bit_timing._oscillator_tolerance_condition_4(
            nom_phase_seg1=t["phase-seg1"], nom_phase_seg2=t["phase-seg2"],
            data_phase_seg2=t["dphase-seg2"], nbt=bit, dbt=dbit, data_brp=t["dbrp"],
            nom_brp=t["brp"]),
        bit_timing._oscillator_tolerance_condition_5(
            data_sjw=t["dsjw"], data_brp=t["dbrp"], nom_brp=t["brp"],
            data_phase_seg2=t["dphase-seg2"], nom_phase_seg2=t["phase-seg2"], nbt=bit, dbt=dbit)))


@pytest.mark.parametrize("clock", [20, 40, 80])
@pytest.mark.parametrize("words", [[], ["--kernel"], ["--tq", 20], ["--controller", "flexcan_fd"],
                                   ["--dsample-point", "80%", "--sample-point", "80%"]])
@pytest.mark.parametrize("dbitrate", [1000000, 2000000, 4000000])
def test_both_phases_have_their_rates_and_the_tolerance_of_t10(clock, words, dbitrate):
    t = both(f"{clock}MHz", 500000, dbitrate, *words)
    quanta = 1 + t["prop-seg"] + t["phase-seg1"] + t["phase-seg2"]
    dquanta = 1 + t["dprop-seg"] + t["dphase-seg1"] + t["dphase-seg2"]
    assert clock * 1000000 / (t["brp"] * quanta) == 500000
    assert clock * 1000000 / (t["dbrp"] * dquanta) == dbitrate
    assert t["dtq"] == t["dbrp"] * 1000 / clock
    assert t["dtolerance"] == pytest.approx(tolerance_of(t), abs=2e-9)
    if "tdco" in t:
        longest = 31 if "flexcan_fd" in words else 65535
        assert t["tdco"] == min(longest, t["dbrp"] * (dquanta - t["dphase-seg2"]))


@pytest.mark.parametrize("controller", ["any", "m_can", "mcp251xfd", "rockchip_canfd"])
def test_a_configuration_finds_the_same_phases(table, controller):
    found = both("80MHz", 500000, 2000000, "--controller", controller)
    text = ("bus: { bitrate: 500000, dbitrate: 2000000 }\n"
            f"nodes: [ {{ name: a, controller: {controller} }} ]")
    bus = json.loads(table(text, "--json").stdout)
    assert bus["dbitrate"] == 2000000
    node = bus["nodes"][0]
    assert {key: node[key] for key in found} == found
    assert node["tdc-mode"] == "auto"


def test_a_node_without_a_data_phase_has_no_keys_of_it(table):
    text = ("bus: { bitrate: 500000, dbitrate: 2000000 }\n"
            "nodes: [ { name: a }, { name: b, kind: classical } ]")
    nodes = json.loads(table(text, "--json").stdout)["nodes"]
    assert ["dbrp" in node for node in nodes] == [True, False]


def test_both_phases_as_text():
    text = timing("--clock", "80MHz", "--bitrate", 500000, "--dbitrate", 2000000).stdout
    nominal, data = text.split("\n\n")
    assert nominal.startswith("bit           160 tq of 12.5 ns: 500000 bit/s\n")
    assert data.splitlines() == [
        "data phase",
        "bit           40 tq of 12.5 ns: 2000000 bit/s",
        "dbrp          1",
        "dprop-seg     14 tq",
        "dphase-seg1   15 tq",
        "dphase-seg2   10 tq",
        "dsjw          5 tq",
        "dsample-point 75 %",
        "dtolerance    0.532 %: 0.625 % by dsjw, 0.741 % behind an error, 0.532 % where the rate "
        "changes",
        "tdco          30 clocks"]


@pytest.mark.parametrize("words, message", [
    (["--dbitrate", 400000], "--dbitrate 400000: the data phase is not slower than --bitrate"),
    (["--dbitrate", 2000000, "--controller", "sja1000"], "sja1000 knows no CAN FD frames"),
    (["--dbitrate", 20000000], "data phase: "),
    (["--dbitrate", 2000000, "--dsample-point", "9%"], "--dsample-point 9%: expected a part of"),
])
def test_a_data_phase_that_is_not_possible_is_refused(words, message):
    assert message in refusal("--clock", "16MHz", "--bitrate", 500000, *words)


def test_a_sample_point_of_the_data_phase_needs_its_rate():
    result = timing("--clock", "16MHz", "--bitrate", 500000, "--dsample-point", "80%", status=2)
    assert "--dsample-point: it needs --dbitrate" in result.stderr


def test_the_data_phases_of_a_configuration_as_a_table(table):
    """The limit of c is 3 / (2 x ((320 - 20) / 2 + 6 + 80)): 160 tq are a nominal bit."""
    text = ("bus: { name: fd, bitrate: 500000, dbitrate: 2000000 }\n"
            "nodes: [ { name: engine }, { name: b, kind: classical },\n"
            "  { name: c, tdc-mode: off, dbrp: 2, dprop-seg: 6, dphase-seg1: 7, dphase-seg2: 6 } ]")
    nominal, data = table(text).stdout.split("\n\n")
    assert len(nominal.splitlines()) == 5
    assert data.splitlines() == [
        "data phase: dbitrate 2000000",
        "NODE    DTQ/NS     SEGMENTS  DBRP  SAMPLE/%  TOLERANCE/%     TDC  TDCV  TDCO   SSP/NS"
        "  MARGIN/NS",
        "engine    12.5   14-15-10/5     1        75        0.531    auto     0    30      375"
        "        125",
        "c           25      6-7-6/3     2        70        0.635     off     -     -        -"
        "        150"]


def test_a_run_tells_the_errors_of_each_node_by_type(tmp_path):
    """The node compares its bits before they are back, and goes bus-off by 32 bit errors."""
    path = tmp_path / "fd.yaml"
    path.write_text("""bus: { bitrate: 500000, dbitrate: 2000000 }
nodes:
  - { name: a, tx-delay: 110ns, rx-delay: 110ns, tdc-mode: manual, tdcv: 1, tdco: 4,
      traffic: [ { send: "123##1DEADBEEF" } ] }
  - { name: b }
  - { name: c, kind: classical, listen-only: on }
""")
    assert "cannot send at the data rate" in canwire("check", path).stderr
    lines = canwire("sim", path).stdout.splitlines()
    table = [line.split() for line in lines[lines.index(next(
        line for line in lines if line.startswith("errors  "))):]]
    assert table[:2] == [["errors", "bit", "stuff", "form", "crc", "ack"],
                         ["a", "32", "0", "0", "0", "0"]]
    assert table[2][0] == "b" and sum(map(int, table[2][1:])) == 32


def test_secondary_sample_points_have_a_margin(table):
    """Bits of 40 clocks of 12.5 ns come back after 220 ns, so in the 18th clock (D13)."""
    text = ("bus: { bitrate: 500000, dbitrate: 2000000 }\n"
            "defaults: { tx-delay: 110ns, rx-delay: { dominant: 110ns, recessive: 120ns } }\n"
            "nodes: [ { name: wrong, tdc-mode: manual, tdcv: 1, tdco: 4 },\n"
            "  { name: auto, tdc-mode: auto, tdco: 20 } ]")
    rows = [line.split() for line in table(text).stdout.splitlines()[-2:]]
    assert [row[7:] for row in rows] == [["1", "4", "62.5", "-167.5"],
                                         ["17", "20", "462.5", "232.5"]]
