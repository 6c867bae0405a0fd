# SPDX-License-Identifier: MIT
"""`canwire timing`: segments from delays, segments as Linux finds them, text, JSON and refusals.

Linux' results are compared with can-calc-bit-timing of can-utils, for all its controllers, clocks
and rates. Needs no CAN in the kernel. tests/unit/test_timing*.c has the rules.
"""

import json
import re
import shutil
import subprocess

import pytest

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


@needs_calculator
def test_segments_are_those_of_can_utils():
    assert compare() >= 150


@needs_calculator
@pytest.mark.parametrize("bitrate", [666666, 83333, 33333, 95238, 5000, 2000000])
def test_at_other_bit_rates_too(bitrate):
    assert compare("-b", str(bitrate)) >= 5


@needs_calculator
@pytest.mark.parametrize("clock", [8000000, 12000000, 25000000, 40000000, 48000000, 59970000,
                                   80000000])
def test_with_other_clocks_too(clock):
    assert compare("-c", str(clock)) >= 50


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
