# SPDX-License-Identifier: MIT
"""Counts instructions with valgrind, as the slope between two sizes: what starting costs does not
count, and all runs of a program give the same."""

import json
import os
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CAR = ROOT / "tests/bench/car.yaml"
TIMEOUT_S = 600
# The C library takes the functions that each x86-64 processor has: others take other numbers of
# instructions.
PLAIN = "glibc.cpu.hwcaps=" + ",".join(f"-{feature}" for feature in (
    "AVX", "AVX2", "AVX512VL", "AVX512BW", "AVX_Fast_Unaligned_Load", "BMI2", "ERMS", "LZCNT",
    "RTM", "SSSE3", "SSE4_1", "SSE4_2"))


def output_of(command, **options):
    """Returns what a command writes."""
    result = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, text=True,
                            timeout=TIMEOUT_S, check=False, **options)
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}: status {result.returncode}")
    return result.stdout


def count(command):
    """Returns what a command writes, and the instructions of it and of the processes that it
    starts."""
    result = subprocess.run(
        ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", *map(str, command)],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        env={**os.environ, "GLIBC_TUNABLES": PLAIN})
    if result.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}: {result.stderr.strip()}")
    counts = re.findall(r"Collected : (\d+)", result.stderr)
    return result.stdout, sum(map(int, counts))


def of_work(bench, name, units):
    """Returns the instructions of a unit of a work of the program bench."""
    def run(units):
        done, instructions = count([bench, name, units])
        return int(done), instructions

    small, large = run(units), run(3 * units)
    return (large[1] - small[1]) / (large[0] - small[0])


# ---- canwire sim ---------------------------------------------------------------------------------

SIM_MS = 200, 600


def sim_command(tool, output, until_ms, file=CAR):
    """Returns the command of `canwire sim` with one output, to /dev/null, for so much bus time.
    Without any output the tool prints a summary."""
    outputs = [] if output == "nothing" else [f"--{output}", "/dev/null"]
    return [str(tool), "sim", str(file), *outputs, "--until", f"{until_ms}ms"]


def of_span(tool, output, file=CAR):
    """Returns the instructions of the time between the two of SIM_MS."""
    short, long = [count(sim_command(tool, output, ms, file))[1] for ms in SIM_MS]
    return long - short


def of_sim(tool, output):
    """Returns the instructions of a frame of the car."""
    def frames(until_ms):
        stats = output_of([tool, "sim", CAR, "--until", f"{until_ms}ms", "--stats", "-"])
        return json.loads(stats)["bus"]["frames"]

    short, long = map(frames, SIM_MS)
    return of_span(tool, output) / (long - short)


# ---- Campaigns -----------------------------------------------------------------------------------

# A scenario of three nodes: 17 frames in 0.1 s. The factors beside the seed are below.
CAMPAIGN_BUS = """bus: { name: small, bitrate: 500000 }
nodes:
  - name: engine
    traffic: [ { send: 123#DEADBEEF, every: 10ms, jitter: 1ms } ]
  - name: gearbox
    traffic: [ { send: 234#0102030405060708, every: 20ms, offset: 1ms } ]
  - name: dash
    traffic: [ { send: 345#11, every: 50ms, offset: 2ms } ]
"""
CAMPAIGN = """scenario: bus.yaml
until: 100ms
vary:
%s  - { set: seed, range: { from: 1, to: %d, step: 1 } }
"""
WRONG_BIT = '  - { name: bit, each-bit: { frame: "123#DEADBEEF", from: engine, skip: 3 } }\n'
OTHER_VALUE = "  - { set: nodes.dash.queue, range: { from: 1, to: 32, step: 1 } }\n"

# By name: the factors before and behind the seed, the rows for each seed, options, and seeds for
# times and for instructions.
CAMPAIGNS = {
    "seed": ("", "", 1, [], (2000, 40000), (200, 400)),
    "bit": (WRONG_BIT, "", 78, [], (50, 500), (10, 20)),
    "value": ("", OTHER_VALUE, 32, [], (100, 1000), (10, 20)),
    "reload": ("", OTHER_VALUE, 32, ["--reload"], (5, 50), (2, 4)),
}


def campaign_command(tool, folder, kind, seeds):
    """Returns the command of a campaign with so many seeds, whose files it writes."""
    before, behind, _, options, *_ = CAMPAIGNS[kind]
    (folder / "bus.yaml").write_text(CAMPAIGN_BUS)
    file = folder / f"{kind}-{seeds}.yaml"
    file.write_text(CAMPAIGN % (before, seeds) + behind)
    return [tool, "campaign", "run", file, "--jobs", "1", *options]


def of_campaign(tool, folder, kind):
    """Returns the instructions of one more row, of a process that works and one that takes rows."""
    width, sizes = CAMPAIGNS[kind][2], CAMPAIGNS[kind][5]
    few, many = [count(campaign_command(tool, folder, kind, size))[1] for size in sizes]
    return (many - few) / (sizes[1] - sizes[0]) / width
