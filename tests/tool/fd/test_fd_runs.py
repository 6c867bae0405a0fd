# SPDX-License-Identifier: MIT
"""CAN FD from `canwire sim` to other programs and back. sigrok, tshark and python-can read what a
bus has carried. A bus carries what python-can has written. Needs no CAN in the kernel.
"""

import json
import re
import shutil

import can
import pytest

from simtool import run, sim

ALL_64 = "".join(f"{n:02X}" for n in range(64))
FRAMES = ["123##1DEADBEEF", "12345678##0" + "11" * 8, "7FE##1" + "22" * 12, "00000001##1" + ALL_64,
          "7FF##0", "123#DEADBEEF"]
BUS = """
bus: { name: fd, bitrate: 500000, sample-point: 0.8, dbitrate: 2000000, dsample-point: 0.8 }
nodes:
  - name: a
    traffic:
%s
  - name: b
"""


@pytest.fixture
def carry(tmp_path):
    """Lets a bus carry frames, a millisecond apart, and returns the file that `option` writes."""
    def run_bus(option, name, frames=tuple(FRAMES)):
        sends = "\n".join(f'      - {{ send: "{frame}", offset: {n}ms }}'
                          for n, frame in enumerate(frames))
        (tmp_path / "bus.yaml").write_text(BUS % sends)
        sim(tmp_path / "bus.yaml", option, tmp_path / name)
        return tmp_path / name
    return run_bus


def need(program):
    if not shutil.which(program):
        pytest.skip(f"{program} is not installed")


def text_of(message):
    name = f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}"
    flags = f"#{message.bitrate_switch + 2 * message.error_state_indicator}"
    return f"{name}#{flags if message.is_fd else ''}{message.data.hex().upper()}"


# ---- What a bus has carried ----------------------------------------------------------------------

@pytest.mark.parametrize("line", ["wire", "b.sampled"])
def test_sigrok_decodes_the_wire(carry, line):
    """Identifiers and data; its CRC of CAN FD frames is wrong before libsigrokdecode 0.6."""
    need("sigrok-cli")
    path = carry("--vcd", "f.vcd")
    lines = run("sigrok-cli", "-l", "1", "-i", path, "-P",
                f"can:can_rx={line}:nominal_bitrate=500000:fast_bitrate=2000000").stdout
    frames = []
    for text in lines.splitlines():
        text = text.removeprefix("can-1: ")
        if text == "Start of frame":
            frames.append({"data": "", "fd": False, "brs": 0})
        elif found := re.fullmatch(r"(Full )?Identifier: \d+ \(0x([0-9a-f]+)\)", text):
            frames[-1]["id"] = int(found.group(2), 16)
        elif text == "Flexible data format: 1":
            frames[-1]["fd"] = True
        elif text == "Bit rate switch: 1":
            frames[-1]["brs"] = 1
        elif found := re.fullmatch(r"Data byte \d+: 0x([0-9a-f]+)", text):
            frames[-1]["data"] += f"{int(found.group(1), 16):02X}"
    assert len(frames) == len(FRAMES)
    for sent, seen in zip(FRAMES, frames):
        name, flag, data = re.fullmatch(r"([0-9A-F]+)#(#\d)?(.*)", sent).groups()
        assert (seen["id"], seen["data"], seen["fd"]) == (int(name, 16), data, bool(flag))
        assert seen["brs"] == (flag == "#1")


def test_tshark_reads_the_capture(carry):
    need("tshark")
    path = carry("--pcapng", "f.pcapng")
    fields = ["can.id", "can.flags.xtd", "canfd.flags.brs", "canfd.flags.esi", "can.len",
              "data.data"]
    words = [word for field in fields for word in ("-e", field)]
    seen = []
    for line in run("tshark", "-r", path, "-T", "fields", *words).stdout.splitlines():
        identifier, extended, brs, esi, length, data = line.split("\t")
        name = f"{int(identifier, 0):0{8 if extended in ('1', 'True') else 3}X}"
        assert int(length) == len(data) // 2 and esi in ("", "0", "False")
        flag = f"#{int(brs in ('1', 'True'))}" if brs else ""
        seen.append(f"{name}#{flag}{data.upper()}")
    assert seen == FRAMES
    assert "Malformed" not in run("tshark", "-r", path, "-V").stdout


def test_python_can_reads_the_log(carry):
    assert [text_of(m) for m in can.CanutilsLogReader(carry("--log", "f.log"))] == FRAMES


# ---- How long bits last --------------------------------------------------------------------------

def changes(path, name):
    """Returns the values of a signal in a dump, each with its time in ns."""
    header, body = path.read_text().split("$enddefinitions $end\n")
    count, unit = re.search(r"\$timescale (\d+) (\w+) \$end", header).groups()
    scale = int(count) * {"ps": 0.001, "ns": 1, "us": 1000}[unit]
    handle = re.search(rf"\$var \w+ \d+ (\S+) {re.escape(name)} \$end", header).group(1)
    now, found = 0, []
    for line in body.splitlines():
        if line.startswith("#"):
            now = int(line[1:]) * scale
        elif found_value := re.fullmatch(rf"(?:s(\S*) |([01])){re.escape(handle)}", line):
            found.append((now, found_value.group(1) or found_value.group(2) or ""))
    return found


def test_bits_of_a_dump_have_their_lengths(carry):
    """BRS 1700 ns, bits behind it 500, the CRC delimiter 800, all others 2000."""
    path = carry("--vcd", "f.vcd", ["123##1" + "55" * 64])
    fields = changes(path, "a.field")
    begins = {}
    for n, (begin, field) in enumerate(fields[:-1]):
        begins.setdefault(field, (begin, fields[n + 1][0] - begin))
    assert begins["brs"][1] == 1700
    assert begins["crc-delimiter"][1] == 800
    assert begins["esi"][1] == 500 and begins["dlc"][1] == 4 * 500
    assert begins["sof"][1] == begins["res"][1] == begins["fdf"][1] == 2000
    assert begins["ack-slot"][1] == 2 * 2000 and begins["eof"][1] == 7 * 2000
    first, last = begins["data[0]"][0], begins["data[63]"][0] + 8 * 500
    edges = [t for t, _ in changes(path, "wire") if first <= t < last]
    assert len(edges) == 512 and {b - a for a, b in zip(edges, edges[1:])} == {500}


def test_fields_of_nodes_with_clocks_of_their_own_begin_with_their_bits(tmp_path):
    """Clocks that hardly differ have the same picture, up to a synchronisation of each bit."""
    found = []
    for ppm in "", ", ppm: 1":
        (tmp_path / "bus.yaml").write_text(
            "bus: { name: t, bitrate: 500000, dbitrate: 2000000 }\nnodes:\n"
            f"  - {{ name: a, traffic: [ {{ send: '123##1DEADBEEF' }} ]{ppm} }}\n  - name: b\n")
        sim(tmp_path / "bus.yaml", "--vcd", tmp_path / "f.vcd")
        found.append([[c for c in changes(tmp_path / "f.vcd", f"{node}.{name}") if c[0] > 25000]
                      for node in "ab" for name in ("field", "stuff")])
    assert {"res", "brs", "esi", "data[3]", "stuff-count", "crc"} < {f for _, f in found[0][0]}
    for equal, apart in zip(*found):
        assert [value for _, value in equal] == [value for _, value in apart]
        assert all(abs(a - b) < 130 for (a, _), (b, _) in zip(equal, apart))


@pytest.mark.parametrize("begin", range(30, 190, 9))
def test_a_dump_begins_at_any_time(carry, tmp_path, begin):
    """No bit need begin just then, since bits have several lengths."""
    every = changes(carry("--vcd", "all.vcd", ["123##1" + "55" * 24]), "wire")
    part = tmp_path / "part.vcd"
    sim(tmp_path / "bus.yaml", "--vcd", part, "--from", f"{begin}us")
    rest = changes(part, "wire")
    due = [change for change in every if change[0] >= 1000 * begin + 2000]
    assert rest[-len(due):] == due if due else len(rest) <= 2


def test_an_error_flag_in_the_data_phase_has_its_length(tmp_path):
    """The bits of b no longer begin with those of the others (D11): six nominal ones, cut by a
    synchronisation. Its bit error shows a that the flag has come between two bits of its own."""
    (tmp_path / "bus.yaml").write_text(
        "bus: { name: t, bitrate: 500000, dbitrate: 2000000 }\nnodes:\n"
        "  - { name: a, traffic: [ { send: '123##1DEADBEEF' } ] }\n  - name: b\n  - name: c\n"
        "faults: [ { name: f, when: { count: 1 }, do: { flip: 'fixed-stuff[2]', at: b } } ]\n")
    sim(tmp_path / "bus.yaml", "--vcd", tmp_path / "f.vcd", "--to", "96us")
    b = [c for c in changes(tmp_path / "f.vcd", "b.driven") if c[0] > 60000]
    assert [level for _, level in b] == ["0", "1"] and b[0][0] == 80387
    assert 11900 < b[1][0] - b[0][0] <= 12000
    a = [c for c in changes(tmp_path / "f.vcd", "a.driven") if c[0] > 80000]
    assert a[:2] == [(81375, "1"), (82000, "0")]


ONE_BY_ONE = [f"data[2.{n}]" for n in range(1, 8)] + ["fixed-stuff[1]"]


def events_of(tmp_path, node):
    (tmp_path / "bus.yaml").write_text(
        "bus: { name: t, bitrate: 500000, dbitrate: 2000000 }\nnodes:\n"
        f"  - {{ name: a, traffic: [ {{ send: '123##100112233445566' }} ]{node} }}\n  - name: b\n"
        "faults:\n  - { name: f0, when: { count: 1 }, do: { flip: 'data[2.0]', at: b } }\n" +
        "".join(f"  - {{ name: f{n}, when: {{ count: 1, after: {{ rule: f{n - 1} }} }},\n"
                f"      do: {{ flip: '{place}', at: b }} }}\n"
                for n, place in enumerate(ONE_BY_ONE, 1)))
    result = sim(tmp_path / "bus.yaml", "--events", "-")
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_faults_come_at_the_ends_of_bits_of_the_data_phase(tmp_path):
    """Clocks that hardly differ change neither their hits nor their times, up to the rounding of a
    tick. The bits of such a bus itself are nominal ones."""
    equal = events_of(tmp_path, "")
    assert [e["rule"] for e in equal if e["event"] == "fault"] == [f"f{n}" for n in range(9)]
    apart = events_of(tmp_path, ", ppm: 1")
    assert len(apart) == len(equal)
    for one, other in zip(equal, apart):
        assert abs(one.pop("t") - other.pop("t")) < 50e-9
        assert one == other


# ---- What python-can has written -----------------------------------------------------------------

@pytest.mark.parametrize("name", ["drive.asc", "drive.log"])
def test_a_bus_carries_what_python_can_has_written(name, tmp_path):
    with can.Logger(tmp_path / name) as log:
        for n, text in enumerate(FRAMES):
            identifier, flag, data = re.fullmatch(r"([0-9A-F]+)#(#\d)?(.*)", text).groups()
            log(can.Message(timestamp=100 + n / 1000, arbitration_id=int(identifier, 16),
                            is_extended_id=len(identifier) == 8, is_fd=bool(flag), channel=0,
                            bitrate_switch=flag == "#1", data=bytes.fromhex(data)))
    (tmp_path / "replay.yaml").write_text(BUS % f"      - {{ replay: {name} }}")
    result = sim("replay.yaml", "--events", "-", cwd=tmp_path)
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [e["frame"] for e in events if e["event"] == "rx"] == FRAMES
    assert "left out" not in result.stderr
