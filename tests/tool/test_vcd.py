# SPDX-License-Identifier: MIT
"""`canwire sim --vcd`: the dump says what was on the wire, and other programs read it.

Needs no CAN in the kernel. CANWIRE is the tool, by default build/release/canwire.
"""

import bisect
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from simtool import ROOT, TIMEOUT_S, canwire, raw, sim

UNITS = 20  # of the dump in a bit at 500 kbit/s: 100 ns
JOIN = 11  # the first SOF

FRAMES = ["123#DEADBEEF", "7FF#R4", "000#", "12345678#00FF00FF", "1FFFFFFF#R",
          "555#0000000000000000",
          "001#1122334455667788_F", "100#F8F8F8F83C"]

ONE_BAD_BIT = """
bus: { name: powertrain, bitrate: 500000 }
nodes:
  - name: engine
    traffic: [ { send: 123#DEADBEEF } ]
  - name: gearbox
  - name: dash
faults:
  - name: one-bad-bit
    when: { frame: "123", count: 1 }
    do: { flip: "crc[3]", at: [gearbox] }
"""

ARBITRATION = """
bus: { name: small, bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 123#DEADBEEF } ]
  - name: b
    traffic: [ { send: 12C# } ]
"""


def several(frames, bitrate=500000):
    sends = "".join(f"      - {{ send: {f}, offset: {i}ms }}\n" for i, f in enumerate(frames))
    return (f"bus: {{ name: several, bitrate: {bitrate} }}\nnodes:\n  - name: a\n"
            f"    traffic:\n{sends}  - name: b\n")


class Vcd:
    """A dump, parsed strictly: unknown words are errors. Times are in its own units."""

    def __init__(self, text):
        header, body = text.split("$enddefinitions $end\n")
        self.scale = re.search(r"\$timescale (\d+ [munpf]?s) \$end", header).group(1)
        self.scope = re.search(r"\$scope module (\S+) \$end", header).group(1)
        self.types, self.ids = {}, {}
        for kind, size, key, name in re.findall(r"\$var (\S+) (\d+) (\S+) (\S+) \$end", header):
            assert name not in self.ids and key not in self.ids.values()
            assert int(size) == {"wire": 1, "string": 1, "real": 64}[kind]
            self.types[key], self.ids[name] = kind, key
        self.changes = {key: [] for key in self.types}
        self.times = []
        for line in body.splitlines():
            self.take(line)
        self.end = self.times[-1]

    def take(self, line):
        if line.startswith("#"):
            assert not self.times or int(line[1:]) > self.times[-1]
            self.times.append(int(line[1:]))
            return
        if line in ("$dumpvars", "$end"):
            return
        change = re.fullmatch(r"([01])(\S+)|r(-?\d+) (\S+)|s(\S*) (\S+)", line)
        assert change, line
        level, wire, number, real, text, string = change.groups()
        if wire:
            key, value, kind = wire, int(level), "wire"
        elif real:
            key, value, kind = real, int(number), "real"
        else:
            key, value, kind = string, text, "string"
        assert self.types[key] == kind
        self.changes[key].append((self.times[-1], value))

    def values(self, name):
        """Returns [(time, value)] of a variable, from the start of the dump on."""
        return self.changes[self.ids[name]]

    def at(self, name, time):
        changes = self.values(name)
        return changes[bisect.bisect(changes, time, key=lambda change: change[0]) - 1][1]

    def bits(self, name, first, count, units=UNITS):
        """Returns the values in the middle of so many bits as a text."""
        return "".join(str(self.at(name, (first + i) * units + units // 2)) for i in range(count))


def dump(path, *arguments):
    return Vcd(sim(path, "--vcd", "-", *arguments).stdout)


def stuff_bits(frame):
    return int(re.search(r"(\d+) of them stuff", canwire("bits", frame).stdout).group(1))


SCENARIOS = sorted((ROOT / "tests/scenarios").glob("*.yaml"))

NOISE_AT_REST = """
bus: { name: noisy, bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 123#DEADBEEF, every: 7ms } ]
  - name: b
    restart-ms: 3
  - name: c
faults:
  - { name: noise, do: { noise: 1e-3 } }
  - { name: off, when: { time: 13ms }, do: { bus-off: b } }
  - { name: twice, when: { time: 20001us }, do: { counters: c, rec: 99 } }
  - { name: again, when: { time: 20003us }, do: { counters: c, rec: 0 } }
"""


@pytest.mark.parametrize("window", [[], ["--from", "1003us", "--to", "3999us"]])
@pytest.mark.parametrize("path", [*SCENARIOS, NOISE_AT_REST], ids=lambda p: Path(p).stem[:40])
def test_what_is_left_out_changes_nothing(path, window, write, tmp_path):
    """With --step every node is simulated in every bit and every bit is shown."""
    file = path if isinstance(path, Path) else write(path)
    for name, more in (("short", []), ("long", ["--step"])):
        sim(file, "--until", "60ms", *window, *more, "--vcd", tmp_path / name)
    assert (tmp_path / "short").read_bytes() == (tmp_path / "long").read_bytes()


# ---- What it says --------------------------------------------------------------------------------


def test_the_wire_is_that_of_canwire_bits(write):
    vcd = dump(write(several(FRAMES)))
    for i, frame in enumerate(FRAMES):
        bits = raw(frame)
        first = JOIN if i == 0 else i * 500
        for level in ("wire", "a.sampled", "b.sampled"):
            assert vcd.bits(level, first, len(bits)) == bits, frame
        assert vcd.bits("wire", first - JOIN, JOIN) == "1" * JOIN
        assert vcd.bits("a.driven", first, len(bits)) == bits[:-9] + "1" + bits[-8:]
        assert vcd.bits("b.driven", first, len(bits)) == "1" * (len(bits) - 9) + "0" + "1" * 8
        for node in "ab":
            assert vcd.bits(f"{node}.stuff", first, len(bits)).count("1") == stuff_bits(frame)
    assert vcd.scope == "several"


def test_fields_follow_each_other(write):
    vcd = dump(write(several(["123#DEADBEEF"])))
    for node in "ab":
        changes = vcd.values(f"{node}.field")
        assert [name for _, name in changes] == [
            "integrating", "sof", "id", "rtr", "ide", "r0", "dlc", "data[0]", "data[1]", "data[2]",
            "data[3]", "crc", "crc-delimiter", "ack-slot", "ack-delimiter", "eof", "intermission"]
        assert [time // UNITS for time, _ in changes] == [
            0, 11, 12, 23, 24, 25, 26, 30, 38, 46, 55, 63, 79, 80, 81, 82, 89]
    assert vcd.end == (11 + 78 + 3) * UNITS


def test_a_fault_an_error_and_counters(write):
    vcd = dump(write(ONE_BAD_BIT))
    hit = 67 * UNITS  # crc[3], behind a stuff bit
    assert vcd.values("rule") == [(0, ""), (hit, "one-bad-bit"), (hit + UNITS, "")]
    assert vcd.values("fault") == [(0, 0), (hit, 1), (hit + UNITS, 0)]
    assert vcd.at("wire", hit) == vcd.at("dash.sampled", hit) != vcd.at("gearbox.sampled", hit)
    assert vcd.values("gearbox.error") == [(0, ""), (81 * UNITS, "crc"), (82 * UNITS, "")]
    assert vcd.values("engine.error") == [(0, ""), (82 * UNITS, "form"), (83 * UNITS, "")]
    assert [n for _, n in vcd.values("gearbox.field")][-20:][:3] == [
        "error-flag", "error-wait", "error-delimiter"]
    assert vcd.values("engine.tec") == [(0, 0), (83 * UNITS, 8), (178 * UNITS, 7)]
    assert vcd.values("gearbox.rec")[:2] == [(0, 0), (82 * UNITS, 1)]
    assert vcd.values("engine.state") == [(0, "error-active")]


def test_states_change_at_the_end_of_a_bit(write):
    path = write(several(["555#"]).replace("  - name: b\n", """  - name: b
faults:
  - { name: preset, when: { time: 10us }, do: { counters: a, tec: 130 } }
"""))
    vcd = dump(path)
    assert vcd.values("a.state") == [(0, "error-active"), (100, "error-passive")]
    assert vcd.values("a.tec")[:2] == [(0, 0), (100, 130)]
    assert vcd.values("rule") == [(0, ""), (100, "preset"), (120, "")]


def test_rules_of_one_bit_stand_together(write):
    names = "abcdefghijklmnopqrstuvwxyz012345678901234567890123456789"
    rules = "".join(f"  - {{ name: {i}{names}, when: {{ time: 10us }}, "
                    f"do: {{ counters: a, tec: {i} }} }}\n"
                    for i in range(6))
    vcd = dump(write(several(["555#"]) + "faults:\n" + rules))
    told = vcd.at("rule", 100)
    assert told.startswith(f"0{names}+1{names}+") and told.endswith("+") and len(told) < 256


def test_arbitration_is_seen_in_the_levels(write):
    vcd = dump(write(ARBITRATION))
    lost = (12 + 7) * UNITS  # id[7]: 123 is 00100100011, 12C is 00100101100
    assert (vcd.at("a.driven", lost), vcd.at("b.driven", lost), vcd.at("wire", lost)) == (0, 1, 0)
    assert vcd.bits("b.driven", 20, 30) == "1" * 30


def test_wires_of_a_partitioned_bus(write):
    vcd = dump(write(several(["555#"]) + "faults:\n  - { name: cut, when: { time: 2us }, "
                     "do: { partition: [[a], [b]], for: 1ms } }\n"), "--until", "60us")
    assert vcd.at("wire", JOIN * UNITS) == vcd.at("a.sampled", JOIN * UNITS) == 0
    assert [value for _, value in vcd.values("b.sampled")] == [1]
    assert vcd.values("rule") == [(0, ""), (20, "cut"), (40, "")]


@pytest.mark.parametrize("bitrate, scale, units", [
    (1000000, "100 ns", 10), (800000, "10 ns", 125), (500000, "100 ns", 20), (125000, "100 ns", 80),
    (83333, "1 us", 12), (10000, "10 us", 10), (5000, "10 us", 20), (761905, "100 ps", 13125),
])
def test_a_bit_is_a_whole_number_of_units(write, bitrate, scale, units):
    vcd = dump(write(several(["555#55"], bitrate)))
    assert vcd.scale == scale
    assert vcd.values("a.field")[1] == (JOIN * units, "sof")
    assert vcd.bits("wire", JOIN, 50, units) == raw("555#55")[:50]


# ---- How much, and from where to where -----------------------------------------------------------


def test_idle_time_costs_nothing(write):
    path = write(several(["555#55"]))
    short, long = (sim(path, "--vcd", "-", "--until", t).stdout for t in ("1ms", "1001ms"))
    assert short.splitlines()[:-1] == long.splitlines()[:-1]
    assert (short.splitlines()[-1], long.splitlines()[-1]) == ("#10000", "#10010000")


@pytest.mark.parametrize("begin, end", [("0s", "100us"), ("50us", "164us"), ("164us", "200us"),
                                        ("51us", "163us"), ("131us", "1s"), ("2us", "4us")])
def test_a_window_is_that_part_of_the_whole(write, begin, end):
    path = write(ONE_BAD_BIT)
    whole, part = dump(path), dump(path, "--from", begin, "--to", end)
    first = int(begin[:-2] if begin.endswith("us") else 0) // 2 * UNITS
    last = min((int(end[:-2]) + 1) // 2 * UNITS if end.endswith("us") else whole.end, whole.end)
    assert (part.times[0], part.end) == (first, last)
    for name in whole.ids:
        # counters and states of the last bit come at its end, levels of the next one do not
        after = name.split(".")[-1] in ("tec", "rec", "state")
        wanted = [(t, v) for t, v in whole.values(name) if first < t < last + after]
        assert part.values(name) == [(first, whole.at(name, first))] + wanted, name


def test_the_window_does_not_change_the_run(write):
    path = write(several(FRAMES))
    plain = sim(path, "--events", "-", "--stats", "-").stdout
    windowed = sim(path, "--events", "-", "--stats", "-", "--vcd", "/dev/null", "--from",
                   "1ms", "--to", "1100us").stdout
    assert windowed == plain


def test_the_dump_repeats(write):
    path = write(ONE_BAD_BIT)
    assert len({sim(path, "--vcd", "-").stdout for _ in range(2)}) == 1


@pytest.mark.parametrize("window", [("--from", "2us", "--to", "2us"),
                                    ("--from", "3us", "--to", "2us"),
                                    ("--from", "soon"), ("--to", "5"), ("--to", "0s")])
def test_a_bad_window_is_status_one(write, window):
    assert window[0] in sim(write(ARBITRATION), "--vcd", "-", *window, status=1).stderr


def test_a_window_behind_the_end_is_status_one(write):
    result = sim(write(ARBITRATION), "--vcd", "-", "--from", "1s", status=1)
    assert "--from" in result.stderr and result.stdout == ""


def test_a_window_of_nothing_is_status_two(write):
    assert "usage:" in sim(write(ARBITRATION), "--from", "1us", status=2).stderr


def test_an_output_that_cannot_be_written_is_status_one(write, tmp_path):
    path = write(ARBITRATION)
    assert "nowhere" in sim(path, "--vcd", tmp_path / "nowhere/f", status=1).stderr
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    assert "/dev/full" in sim(path, "--vcd", "/dev/full", status=1).stderr


# ---- Other programs ------------------------------------------------------------------------------


def need(program, package):
    if not shutil.which(program):
        pytest.skip(f"{program} is not installed (package {package})")


def decoded(path, line, bitrate):
    """Returns the frames of sigrok's decoder: identifier, then data bytes or the DLC of a
    remote."""
    out = subprocess.run(
        ["sigrok-cli", "-l", "1", "-i", str(path), "-P",
         f"can:can_rx={line}:nominal_bitrate={bitrate}:fast_bitrate={bitrate}"],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=True).stdout
    frames = []
    for text in out.splitlines():
        text = text.removeprefix("can-1: ")
        if text == "Start of frame":
            frames.append({"data": [], "remote": False})
        elif found := re.fullmatch(r"(Full )?Identifier: \d+ \(0x([0-9a-f]+)\)", text):
            frames[-1]["id"] = int(found.group(2), 16)
        elif found := re.fullmatch(r"Data byte \d: 0x([0-9a-f]+)", text):
            frames[-1]["data"].append(int(found.group(1), 16))
        elif text.startswith("Remote transmission request: remote"):
            frames[-1]["remote"] = True
        elif found := re.fullmatch(r"CRC-15 sequence: 0x([0-9a-f]+)", text):
            frames[-1]["crc"] = int(found.group(1), 16)
        elif text == "ACK slot: ACK":
            frames[-1]["ack"] = True
    return frames


def test_sigrok_decodes_the_wire(write, tmp_path):
    need("sigrok-cli", "sigrok-cli")
    # its decoder mistakes the CRC for data when the DLC is over 8, or not 0 in a remote frame
    frames_sent = [frame.replace("#R4", "#R").replace("_F", "") for frame in FRAMES]
    for bitrate in (500000, 1000000, 83333):
        sim(write(several(frames_sent, bitrate)), "--vcd", tmp_path / "f.vcd")
        for line in ("wire", "b.sampled"):
            frames = decoded(tmp_path / "f.vcd", line, bitrate)
            assert len(frames) == len(frames_sent)
            for frame, got in zip(frames_sent, frames):
                identifier, data = frame.split("#")
                remote = data.startswith("R")
                payload = [] if remote else list(bytes.fromhex(data))
                crc = re.search(r"crc +([0-9A-F]{4})", canwire("bits", frame).stdout).group(1)
                assert (got["id"], got["data"]) == (int(identifier, 16), payload)
                assert got["remote"] == remote and got["crc"] == int(crc, 16) and got["ack"]


def sigrok_levels(path, line):
    """Returns the levels that sigrok reads from a dump, one for each unit."""
    shown = subprocess.run(["sigrok-cli", "-l", "1", "-i", str(path), "-C", line, "-O", "csv"],
                           capture_output=True, text=True, timeout=TIMEOUT_S, check=True).stdout
    return "".join(level for level in shown.splitlines() if level in ("0", "1"))


def test_sigrok_reads_a_run_with_errors_to_its_end(write, tmp_path):
    need("sigrok-cli", "sigrok-cli")
    count = 12
    path = write(ONE_BAD_BIT.replace("send: 123#DEADBEEF",
                                     f"send: 123#DEADBEEF, every: 1ms, count: {count}")
                 .replace("count: 1 }", "every: 4 }") +
                 "  - { name: preset, when: { time: 6500us }, do: { counters: dash, tec: 130 } }\n")
    sim(path, "--vcd", tmp_path / "f.vcd")
    vcd = Vcd((tmp_path / "f.vcd").read_text())
    assert max(value for _, value in vcd.values("engine.tec")) >= 8
    assert vcd.at("dash.state", vcd.end) == "error-passive"
    errors = len([text for _, text in vcd.values("gearbox.error") if text == "crc"])
    assert errors == 4  # of 16 attempts
    for line in ("wire", "engine.driven", "gearbox.sampled"):
        levels = sigrok_levels(tmp_path / "f.vcd", line)
        bits = vcd.end // UNITS
        assert levels[UNITS // 2:bits * UNITS:UNITS] == vcd.bits(line, 0, bits)
    # its decoder knows no error frames: of a flag and the frame behind it makes one of its own
    whole = [f for f in decoded(tmp_path / "f.vcd", "wire", 500000)
             if f["data"] == [0xDE, 0xAD, 0xBE, 0xEF]]
    assert len(whole) == count and {f["id"] for f in whole} == {0x123}


def test_sigrok_sees_all_levels_by_their_names(write, tmp_path):
    need("sigrok-cli", "sigrok-cli")
    sim(write(ONE_BAD_BIT), "--vcd", tmp_path / "f.vcd")
    shown = subprocess.run(["sigrok-cli", "-l", "1", "-i", tmp_path / "f.vcd", "--show"], text=True,
                           capture_output=True, timeout=TIMEOUT_S, check=True).stdout
    levels = [f"{n}.{what}" for n in ("engine", "gearbox", "dash")
              for what in ("driven", "sampled", "stuff")]
    assert re.findall(r"- (?:\S+powertrain\.)?(\S+): logic", shown) == ["wire", *levels, "fault"]


def test_gtkwave_reads_what_was_written(write, tmp_path):
    need("vcd2fst", "gtkwave, which is not among scripts/install-deps: it brings a desktop")
    sim(write(ONE_BAD_BIT.replace("count: 1", "count: 9")), "--vcd", tmp_path / "f.vcd")
    subprocess.run(["vcd2fst", "f.vcd", "f.fst"], cwd=tmp_path, timeout=TIMEOUT_S, check=True)
    back = subprocess.run(["fst2vcd", "f.fst"], cwd=tmp_path, text=True, capture_output=True,
                          timeout=TIMEOUT_S, check=True).stdout
    written = Vcd((tmp_path / "f.vcd").read_text())
    # it writes its own header and other identifiers
    names = dict(re.findall(r"\$var \S+ \d+ (\S+) (\S+) \$end", back))
    text = re.sub(r"\$var string 0", "$var string 1", back)
    text = re.sub(r"\$timescale\s+(\d+)(\S+)\s+\$end", r"$timescale \1 \2 $end", text)
    read = Vcd(text)
    assert sorted(names.values()) == sorted(written.ids)
    for name in written.ids:
        assert read.values(name) == written.values(name), name


@pytest.fixture(name="inside", scope="module")
def fixture_inside(tmp_path_factory):
    """The dump of one frame: b has a clock that is slow by 1000 ppm, 12 m away; 20 quanta a bit."""
    path = tmp_path_factory.mktemp("inside")
    keys = "clock: 40MHz, brp: 4, prop-seg: 7, phase-seg1: 8, phase-seg2: 4, sjw: 2"
    (path / "bus.yaml").write_text(f"""
bus: {{ name: can, bitrate: 500000 }}
nodes:
  - {{ name: a, {keys}, traffic: [{{ send: 123#00FF00FF00 }}] }}
  - {{ name: b, {keys}, ppm: -1000, position: 12m }}
""")
    done = sim(path / "bus.yaml", "--vcd", path / "v")
    assert done.returncode == 0, done.stderr
    return Vcd((path / "v").read_text())


def gaps(times):
    return [b - a for a, b in zip(times, times[1:])]


def test_quanta_of_a_bus_whose_nodes_have_clocks(inside):
    assert inside.scale == "100 ps"
    for name, quantum in (("a", 1000), ("b", 1001)):  # 100 ns, and 1000 ppm more
        times = [t for t, _ in inside.values(f"{name}.tq")][2:]
        assert len(times) > 100 * 20
        assert set(gaps(times)) <= {quantum, quantum + 1}


def test_sample_points_come_20_quanta_apart_but_for_synchronisations(inside):
    for name, quantum in (("a", 1000), ("b", 1001)):
        samples = [t for t, value in inside.values(f"{name}.sample") if value]
        quanta = [round(gap / quantum) for gap in gaps(samples)]
        assert quanta.count(20) > len(quanta) * 3 / 4
        assert all(abs(20 - q) <= 2 for q in quanta[12:])


def test_levels_change_at_their_true_times(inside):
    samples = {t for t, value in inside.values("b.sample") if value}
    assert {t for t, _ in inside.values("b.sampled")[1:]} <= samples
    sof = JOIN * 20000
    assert inside.values("a.driven")[1] == (sof, 0) == inside.values("wire")[1]
    assert inside.at("fault", sof) == 0
    ack = inside.values("b.driven")[1]
    assert ack[1] == 0 and ack[0] % 20000 != 0  # by the clock of b


def test_the_synchronisations_and_phase_errors_of_each_node(inside):
    syncs = [text for _, text in inside.values("b.sync") if text]
    assert syncs.count("hard") == 1 and syncs.count("resync") > 4
    hard = next(t for t, text in inside.values("b.sync") if text == "hard")
    # the edge of SOF has 12 m of line behind it, and is seen at the end of the quantum it is in
    assert JOIN * 20000 + 600 < hard <= JOIN * 20000 + 600 + 1001
    errors = {value for _, value in inside.values("b.phase_error")}
    assert errors <= {-1, 0} and -1 in errors  # 10 bits late by 0.2 quanta (T5)


def test_equal_clocks_have_the_dump_of_the_grid(tmp_path):
    dumps = []
    for keys in ("", "clock: 40MHz, sample-point: 80%"):
        nodes = "".join(f"  - {{ name: {n}{', ' if keys else ''}{keys} }}\n" for n in "bc")
        (tmp_path / "bus.yaml").write_text(
            "bus: { name: can, bitrate: 500000 }\nnodes:\n"
            f"  - {{ name: a, {keys}{', ' if keys else ''}traffic: [{{ send: 123#00 }}] }}\n"
            + nodes)
        done = sim(tmp_path / "bus.yaml", "--vcd", tmp_path / "v")
        assert done.returncode == 0, done.stderr
        dumps.append((tmp_path / "v").read_text())
    assert dumps[0] == dumps[1] and ".tq" not in dumps[0]
