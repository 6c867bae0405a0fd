# SPDX-License-Identifier: MIT
"""The same file and seed give the same bytes: with each compiler, optimisation and machine word.

`canwire sim` is built by gcc as it is released, and by clang without optimisation. All its outputs
are compared, for some of the scenarios, the shipped examples and a large random one. `make
test-deep` takes all scenarios, and also gcc without optimisation and clang with it. `make
test-arm64` compares all with an emulated ARM64. The library alone is also built for
32 bits: tests/determinism/digest.c runs random scenarios of the differential test and hashes all
their results.
"""

import os
import platform
import random
import subprocess
from pathlib import Path

import pytest

from depth import DEEP, some

ROOT = Path(__file__).resolve().parents[2]
EMULATED = os.environ.get("ARM64") == "yes"
SCENARIOS = sorted((ROOT / "tests/scenarios").glob("*.yaml"))
SCENARIOS = SCENARIOS if EMULATED else some(SCENARIOS, 4)
EXAMPLES = sorted(path for path in (ROOT / "config").rglob("*.yaml")
                  if "\nnodes:" in path.read_text())  # a rig has no VCD
TIMEOUT_S = 600
BUILDS = {"release": {"CC": "gcc"}, "debug-clang": {"VARIANT": "debug", "CC": "clang"}}
if DEEP:
    BUILDS |= {"determinism/gcc-O0": {"CC": "gcc", "CFLAGS": "-O0"},
               "determinism/clang-O2": {"CC": "clang", "CFLAGS": "-O2"}}
if EMULATED:
    BUILDS = {"release": {"CC": "gcc"}, "arm64": {"ARCH": "arm64", "LTO": "no"}}
OUTPUTS = ["events", "log", "stats", "vcd"]
# The second option has the headers of the kernel, as gcc-multilib has them in its first place.
NARROW = f"gcc -m32 -idirafter /usr/include/{platform.machine()}-linux-gnu"
DIGEST_BITS = 2_000_000 if DEEP else 500_000


def build(name, how, *programs):
    """Returns the folder with these programs, which make builds with these variables."""
    folder = f"build/{name}"
    variables = [f"{key}={value}" for key, value in how.items()]
    (ROOT / folder).mkdir(parents=True, exist_ok=True)
    result = subprocess.run(  # one at a time: other tests may want the same
        ["flock", ROOT / folder, "make", "--no-print-directory", "-s", f"-j{os.cpu_count()}",
         *variables, f"BUILD={folder}", *(f"{folder}/{p}" for p in programs)],
        cwd=ROOT, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return ROOT / folder


def started(name, how):
    """Returns the folder of the programs of a build, or of scripts that start them."""
    place = "run/" if "ARCH" in how else ""
    return build(name, how, f"{place}canwire", f"{place}digest") / place


@pytest.fixture(name="builds", scope="module")
def fixture_builds():
    return {name: started(name, how) for name, how in BUILDS.items()}


def arguments_of(path):
    for line in path.read_text().splitlines():
        if line.startswith("# arguments:"):
            return line.partition(":")[2].split()
    return []


def outputs(tool, folder, path, *arguments, begin="0"):
    """Returns all outputs of a run by name, including standard error and summary. VCD: 20 ms."""
    end = f"{int(begin.removesuffix('ms')) + 20}ms"
    files = [word for name in OUTPUTS for word in (f"--{name}", folder / name)]
    files += ["--from", begin, "--to", end]
    result = subprocess.run([tool, "sim", path, *arguments, *files], capture_output=True,
                            timeout=TIMEOUT_S, check=False)
    summary = subprocess.run([tool, "sim", path, *arguments], capture_output=True,
                             timeout=TIMEOUT_S, check=False)
    assert result.returncode == summary.returncode == 0, result.stderr
    found = {name: (folder / name).read_bytes() for name in OUTPUTS}
    return {**found, "stderr": result.stderr, "summary": summary.stdout}


def assert_same_for_all(builds, tmp_path, path, *arguments, **more):
    first = None
    for name, folder in builds.items():
        got = outputs(folder / "canwire", tmp_path, path, *arguments, **more)
        first = first or got
        different = [output for output in got if got[output] != first[output]]
        assert not different, f"{name}: {different}"
    return first


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_a_scenario_is_the_same_for_all(path, builds, tmp_path):
    assert_same_for_all(builds, tmp_path, path, *arguments_of(path))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_the_same_for_all(path, builds, tmp_path):
    assert_same_for_all(builds, tmp_path, path, "--until", "100ms")


# ---- A large random scenario ---------------------------------------------------------------------

ACTIONS = [
    'flip: "crc[{0}]"', 'flip: "data[0.{0}]", bits: 3', 'flip: "id[{0}]", at: [n1, n2]',
    'force: dominant, from: "eof[{0}]", at: [n3]', 'glitch: "10x01", from: "dlc[1]"',
    'noise: 1e-4', 'noise: 1e-5, at: [n{0}]', "no-ack: [n0, n1, n2, n3, n4, n5]", "wrong-crc: n{0}",
    "error-flag: n{0}", "counters: n{0}, tec: 120", "overload: n{0}, frames: 2",
    "disconnect: n{0}, for: 3ms", "partition: [[n0, n1, n2], [n1{0}]], for: 2ms", "drop: tx",
    "delay: 1ms, side: tx", "duplicate: 2, side: tx", "reorder: 3, side: tx",
    "change: {{ xor: 0F, dlc: {0} }}, at: [n{0}]", "drop: rx, at: [n{0}]", "bus-off: n{0}",
    "stuck: recessive, on: n{0}.tx, for: 1ms", "send: 00{0}#, as: n{0}", "set: n{0}, one-shot: on",
    "hardware-reset: n{0}", "software-reset: n{0}", "raw: 7F{0}#01, as: n{0}, mac: off",
    "raw: {{ frame: 12345{0}78#01, srr: dominant }}, as: n{0}",
]
NODES = 20
RULES = 40


def random_bus():
    """Returns a busy bus, with rules of all kinds that act seldom."""
    draw = random.Random(2024)
    lines = ["bus: { name: large, bitrate: 500000 }", "seed: 99", "nodes:"]
    for node in range(NODES):
        lines.append(f"  - name: n{node}")
        lines.append(f"    restart-ms: {draw.choice([1, 5, 20])}")
        lines.append(f"    order: {draw.choice(['priority', 'fifo'])}")
        lines.append("    traffic:")
        for _ in range(3):
            number = draw.randrange(0x40) * 32 + node
            frame = f"{number:03X}#{draw.randbytes(draw.randrange(9)).hex()}"
            if draw.random() < 0.3:
                frame = f"{draw.randrange(1 << 24) * 32 + node:08X}#R{draw.randrange(9)}"
            lines.append(f"      - {{ send: {frame}, every: {draw.randrange(5, 90)}ms, "
                         f"offset: {draw.randrange(900)}us, jitter: {draw.randrange(1, 5000)}us }}")
        lines.append(f"      - {{ reply: {draw.randrange(0x800):03X}#11, "
                     f"to: {draw.randrange(8)}00:700, "
                     f"delay: {draw.randrange(500)}us, count: {draw.randrange(1, 30)} }}")
    lines.append("  - { name: player, traffic: [ { replay: "
                 f"{ROOT}/tests/traces/drive.pcapng, count: 50 }}, {{ replay: "
                 f"{ROOT}/tests/traces/drive.asc, speed: max, count: 30, only: 7FF }} ] }}")
    lines.append("faults:")
    for rule in range(RULES):
        action = ACTIONS[rule % len(ACTIONS)].format(draw.randrange(2))
        when = f"probability: {draw.choice(['0.01', '0.05', '3e-3'])}, hold-off: 2ms, " \
               "frame: \"0:0\""
        if action.startswith(("noise", "stuck", "disconnect", "partition")):
            when = f"time: {draw.randrange(1000)}ms..{draw.randrange(1001, 2000)}ms"
        lines.append(f"  - {{ name: r{rule}, when: {{ {when} }}, do: {{ {action} }} }}")
    return "\n".join(lines) + "\n"


def test_a_large_random_scenario_is_the_same_for_all(builds, tmp_path):
    path = tmp_path / "large.yaml"
    path.write_text(random_bus())
    got = assert_same_for_all(builds, tmp_path, path, "--until", "2s", begin="1000ms")
    kinds = {kind for kind in (b"fault", b"error", b"state", b"restart", b"drop", b"overload",
                               b"arbitration-lost", b"rx", b"tx")
             if b'"event":"' + kind + b'"' in got["events"]}
    assert len(kinds) == 9, kinds  # else it says little
    assert got["events"].count(b"\n") > 10000
    stepped = assert_same_for_all({"step": builds["release"]}, tmp_path, path, "--until", "2s",
                                  "--step", begin="1000ms")
    assert stepped == got


# ---- The library ---------------------------------------------------------------------------------


def digest(folder):
    result = subprocess.run([folder / "digest", str(DIGEST_BITS)], capture_output=True, text=True,
                            timeout=TIMEOUT_S, check=True)
    lines = result.stdout.splitlines()
    assert len(lines) > 20 and len({line.split()[2] for line in lines}) == len(lines)
    return lines


def test_random_scenarios_are_the_same_for_all_compilers(builds):
    first, *others = map(digest, builds.values())
    assert all(other == first for other in others)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="gcc -m32 is for x86-64")
def test_random_scenarios_are_the_same_on_32_bits(builds):
    # without optimisation: compiled in a third of the time, and what is written behind an end hits
    variant = "san" if DEEP else "mutant"
    narrow = build("determinism/gcc-m32", {"CC": NARROW, "VARIANT": variant}, "digest")
    header = (narrow / "digest").read_bytes()[:5]
    assert header == b"\x7fELF\x01"  # 32 bits
    assert digest(narrow) == digest(builds["release"])


@pytest.mark.skipif(platform.machine() != "x86_64", reason="gcc -m32 is for x86-64")
def test_the_programs_compile_for_32_bits():
    sources = sorted(ROOT.glob("daemon/**/*.c"))
    assert len(sources) > 80
    # as objects: linking would need other packages' libraries of 32 bits
    build("determinism/gcc-m32-O0", {"CC": NARROW, "CFLAGS": "-O0"},
          *(str(source.relative_to(ROOT).with_suffix(".o")) for source in some(sources, 8)))
