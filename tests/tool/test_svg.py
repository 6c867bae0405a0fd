# SPDX-License-Identifier: MIT
"""`canwire sim --svg`: what stands in the picture, counted in its elements.

Needs no CAN in the kernel. CANWIRE is the tool, by default build/release/canwire.
"""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from simtool import ROOT, canwire, raw, sim

SVG = "{http://www.w3.org/2000/svg}"
PICTURE = ROOT / "config/picture/one-bad-bit"

SMALL = """
bus: { name: small, bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: FRAME } ]
  - name: b
"""


def small(frame="123#DEADBEEF", more=""):
    return SMALL.replace("FRAME", frame) + more


class Picture:
    def __init__(self, text):
        self.root = ElementTree.fromstring(text)
        self.rows = self.classed("row")
        self.text = ["".join(t.itertext()) for t in self.root.iter(SVG + "text")]

    def classed(self, name, under=None):
        everything = (self.root if under is None else under).iter()
        return [e for e in everything if name in e.get("class", "").split()]

    def node(self, name):
        """Its lanes, one a row."""
        return [lane for lane in self.classed("node") if lane.get("class") == f"node {name}"]

    def count(self, what, name):
        return sum(len(self.classed(what, lane)) for lane in self.node(name))

    def fields(self, name):
        return [e.get("class").split()[1] for lane in self.node(name)
                for e in self.classed("field", lane)]

    def texts(self, what, name):
        return ["".join(e.itertext()) for lane in self.node(name) for e in self.classed(what, lane)]

    def hits(self):
        """Returns (x of the marker, names beside them) of rules."""
        lanes = self.classed("rules")
        return ([int(re.match(r"M(-?\d+)", e.get("d")).group(1)) + 4 for lane in lanes
                 for e in self.classed("hit", lane)],
                ["".join(e.itertext()) for lane in lanes for e in self.classed("note", lane)])


def picture(path, *arguments):
    return Picture(sim(path, "--svg", "-", *arguments).stdout)


def levels(path_data, width):
    """Returns the levels of a wave with bits of that width: high lines are recessive."""
    bits, x, y = "", None, None
    ends = [int(n) for n in re.findall(r"(?:M\d+ |V)(\d+)", path_data)]
    for command, first, second in re.findall(r"([MHV])(\d+)(?: (\d+))?", path_data):
        if command == "M":
            x, y = int(first), int(second)
        elif command == "V":
            y = int(first)
        else:
            bits += ("1" if y == min(ends) else "0") * ((int(first) - x) // width)
            x = int(first)
    return bits


# ---- Frames --------------------------------------------------------------------------------------

BASE = ["sof", "id", "rtr", "ide", "r0", "dlc"]
TAIL = ["crc", "crc-delimiter", "ack-slot", "ack-delimiter", "eof", "intermission"]


@pytest.mark.parametrize("frame, fields, labels", [
    ("555#55555555", [*BASE, *[f"data[{i}]" for i in range(4)], *TAIL],
     ["id 555", "dlc 4", *[f"data[{i}] 55" for i in range(4)]]),
    ("123#R8", [*BASE, *TAIL], ["id 123", "dlc 8"]),
    ("12345678#R8", ["sof", "id", "srr", "ide", "id", "rtr", "r1", "r0", "dlc", *TAIL],
     ["id 48D", "id 05678", "dlc 8"]),
])
def test_fields_of_a_frame(write, frame, fields, labels):
    bits = len(raw(frame))
    shown = picture(write(small(frame)), "--from", "22us", "--to", f"{22 + 2 * (bits + 3)}us")
    # a part that crosses the end of a row is in both rows
    assert list(dict.fromkeys(shown.fields("a"))) == list(dict.fromkeys(fields))
    assert len(shown.fields("a")) == len(fields) + len(shown.rows) - 1
    assert shown.fields("b") == shown.fields("a")
    crc = re.search(r"crc +([0-9A-F]{4})", canwire("bits", frame).stdout).group(1)
    for node in "ab":
        valued = [t for t in shown.texts("label", node) if " " in t]
        assert list(dict.fromkeys(valued)) == [*labels, f"crc {crc}"]


@pytest.mark.parametrize("frame", ["000#", "7FF#FFFFFFFF", "123#DEADBEEF", "100#F8F8F8F83C",
                                   "1FFFFFFF#R"])
def test_stuff_bits_are_marked(write, frame):
    wanted = int(re.search(r"(\d+) of them stuff", canwire("bits", frame).stdout).group(1))
    shown = picture(write(small(frame)))
    assert [shown.count("stuff", node) for node in "ab"] == [wanted, wanted]


def test_waves_are_the_levels(write):
    frame = "123#55"
    bits = raw(frame)
    shown = picture(write(small(frame)), "--from", "22us", "--to", f"{22 + 2 * len(bits)}us")
    width = 720 // len(bits)
    wire = shown.classed("wire")[0].find(SVG + "path").get("d")
    digits = "".join(e.text for e in shown.classed("wire")[0].find(SVG + "g"))
    assert levels(wire, width) == digits == bits
    for node, driven in (("a", bits[:-9] + "1" + bits[-8:]),
                         ("b", "1" * (len(bits) - 9) + "0" + "1" * 8)):
        lane = shown.node(node)[0]
        assert levels(shown.classed("sampled", lane)[0].get("d"), width) == bits
        assert levels(shown.classed("driven", lane)[0].get("d"), width) == driven


def test_events_stand_beside_their_nodes(write):
    shown = picture(write(small()))
    assert shown.texts("note", "a") == ["sent 123#DEADBEEF"]
    assert shown.texts("note", "b") == ["received 123#DEADBEEF"]
    assert shown.hits() == ([], [])


def test_arbitration_splits_the_identifier(write):
    shown = picture(write(small().replace(
        "- name: b", "- name: b\n    traffic: [ { send: 12C# } ]")),
                    "--to", "100us")
    assert shown.texts("note", "b") == ["arbitration lost"]
    assert shown.fields("a").count("id") == 1 and shown.fields("b").count("id") == 2
    assert [t for t in shown.texts("label", "b") if "id" in t][:2] == ["id", "id 123"]


# ---- Errors and faults ---------------------------------------------------------------------------


def test_the_picture_in_the_readme_is_what_the_tool_draws():
    assert "](config/picture/one-bad-bit.svg)" in (ROOT / "README.md").read_text()
    drawn = sim(PICTURE.with_suffix(".yaml"), "--svg", "-", "--from", "120us", "--to", "200us")
    assert drawn.stdout == PICTURE.with_suffix(".svg").read_text(), "make picture draws it again"


def test_errors_and_their_flags():
    shown = picture(PICTURE.with_suffix(".yaml"), "--from", "120us", "--to", "200us")
    nodes = ("engine", "gearbox", "dash")
    assert {name: shown.fields(name).count("error-flag") for name in nodes} == {
        "engine": 1, "gearbox": 1, "dash": 1}
    assert shown.fields("gearbox")[-5:] == [
        "ack-delimiter", "error-flag", "error-wait", "error-delimiter", "intermission"]
    assert shown.texts("note", "engine") == ["form error, TEC 8"]
    assert shown.texts("note", "gearbox") == ["crc error, REC 1", "REC 9"]
    assert "active error flag" in shown.texts("label", "dash")
    assert {name: shown.count("fault", name) for name in ("engine", "gearbox", "dash")} == {
        "engine": 0, "gearbox": 1, "dash": 0}
    xs, names = shown.hits()
    first, width = 112, 18  # bit 60, and of each
    assert (xs, names) == ([first + 7 * width + width // 2], ["one-bad-bit"])


def test_states_and_passive_flags(write):
    shown = picture(write(small("555#00", """faults:
  - { name: weak, when: { time: 4us }, do: { counters: a, tec: 124 } }
  - { name: hit, when: { frame: "555", count: 2 }, do: { flip: "data[0.2]" } }
""")))
    assert shown.texts("note", "a")[:3] == [
        "TEC 124, error-warning", "bit error, TEC 132, error-passive", "bit error, TEC 140"]
    assert "passive error flag" in shown.texts("label", "a")
    assert shown.fields("a").count("suspend") >= 2  # one may cross the end of a row
    assert "error-passive" in shown.text  # at the beginning of a row
    assert len(shown.classed("fault", shown.classed("wire")[0])) == 1
    assert shown.hits()[1] == ["weak", "hit", "hit"]


def test_overload_frames(write):
    shown = picture(write(small("7FF#R8", """faults:
  - { name: busy, when: { frame: "7FF" }, do: { overload: b, frames: 2 } }
""")))
    for node in "ab":
        assert shown.fields(node).count("overload-flag") == 2
        assert shown.texts("note", node).count("overload") == 2


def test_wires_of_a_partitioned_bus(write):
    path = write(small("555#00", """faults:
  - { name: torn, when: { time: 40us }, do: { partition: [[a], [b]], for: 1ms } }
"""))
    assert len(picture(path, "--to", "40us").classed("wire")) == 1
    cut = picture(path, "--to", "42us")
    assert len(cut.classed("wire")) == 2
    assert [t for t in cut.text if t in ("a", "b")] == ["a", "b", "a", "b"]  # wires, then nodes
    second = cut.classed("wire")[1]
    assert levels(second.find(SVG + "path").get("d"), 24) == "1"  # of its only bit


def test_a_silent_node_is_off(write):
    shown = picture(write(small("555#00", """faults:
  - { name: kill, when: { time: 30us }, do: { bus-off: a } }
  - { name: away, when: { time: 50us }, do: { disconnect: b } }
""")), "--until", "100us")
    assert shown.fields("a")[-1] == "bus-off" and shown.fields("b")[-1] == "off"
    assert shown.texts("note", "a") == ["TEC 256, bus-off"]
    for node, end in (("a", 15), ("b", 25)):
        driven = shown.classed("driven", shown.node(node)[0])[0].get("d")
        assert len(levels(driven, 720 // 50)) == end


def test_drops_and_restarts_are_noted(write):
    shown = picture(write("""
bus: { name: small, bitrate: 500000 }
nodes:
  - { name: a, queue: 1, traffic: [ { send: 555#00 }, { send: 556#, offset: 60us } ] }
  - { name: b }
faults:
  - { name: kill, when: { time: 500us }, do: { bus-off: b } }
  - { name: mend, when: { time: 600us }, do: { restart: b } }
"""), "--until", "4ms", "--to", "3ms")
    assert "dropped (queue-full) 556#" in shown.texts("note", "a")
    notes = shown.texts("note", "b")
    assert any(n.startswith("TEC 256, bus-off") for n in notes)
    assert any("restart" in n for n in notes)


def test_hits_of_one_rule_close_together_are_named_once(write):
    shown = picture(write(small("555#00", """faults:
  - { name: storm, when: { time: 0s..20us }, do: { noise: 1, for: 20us } }
""")), "--until", "40us")
    xs, names = shown.hits()
    assert len(xs) == 10 and names == ["storm"]


def test_hits_without_a_name_of_their_own_are_joined_to_one_that_has(write):
    shown = picture(write(small("555#00", """faults:
  - { name: storm, when: { time: 20us }, do: { noise: 0.3, for: 400us } }
  - { name: other, when: { time: 100us }, do: { counters: b, tec: 20 } }
""")), "--until", "500us")
    xs, names = shown.hits()
    joints = [re.findall(r"(\d+) ", e.get("d")) for e in shown.classed("joint")]
    assert len(joints) > 4 and len(xs) == len(names) + len(joints)
    assert all(int(x) in xs for joint in joints for x in joint)


def text_spans(shown, node):
    """Returns [(left, right, y, x of the line)] of the notes of a node, a list for each row."""
    rows = []
    for lane in shown.node(node):
        lines = [[int(n) for n in re.match(r"M(\d+) (\d+)V(\d+)$", e.get("d")).groups()]
                 for e in lane if e.tag == SVG + "path" and re.match(r"M\d+ \d+V\d+$", e.get("d"))]
        spans = []
        for e in shown.classed("note", lane):
            x, width = int(e.get("x")), len(e.text) * 6
            left = x - width if e.get("text-anchor") == "end" else x
            own = x + 4 if e.get("text-anchor") == "end" else x - 4
            spans.append((left, left + width, int(e.get("y")), own))
        assert {line[0] for line in lines} == {span[3] for span in spans}
        rows.append((spans, lines))
    return rows


def test_lines_of_notes_go_through_no_text(write):
    path = write(small("555#00", """faults:
  - { name: storm, when: { time: 20us }, do: { noise: 0.2, for: 400us } }
"""))
    count = 0
    for end in range(110, 330, 14):
        shown = picture(path, "--until", "500us", "--to", f"{end}us")
        for node in "ab":
            for spans, lines in text_spans(shown, node):
                for left, right, y, _ in spans:
                    count += 1
                    assert 0 <= left and right <= int(shown.root.get("width"))
                    assert not [x for x, _, low in lines if left < x < right and low >= y]
    assert count > 100


def test_names_have_room(write):
    name = "engine-control-unit-front-right-"
    longest = name + "m" * (32 - len(name))
    shown = picture(write(small().replace("name: b", f"name: {longest}")))
    assert longest in shown.text
    first = min(int(e.get("x")) for e in shown.classed("field"))
    assert first >= 14 + 32 * 6.62
    assert min(int(e.get("x")) for e in picture(write(small())).classed("field")) == 112


def test_lines_of_rules_are_below_all_that_has_text():
    shown = picture(PICTURE.with_suffix(".yaml"), "--from", "120us", "--to", "200us")
    order = list(shown.root.iter())
    line = next(i for i, e in enumerate(order) if e.get("stroke-dasharray") == "1 3")
    behind = [e for e in order[line:] if "field" in e.get("class", "").split()]
    assert len(behind) == len(shown.classed("field"))
    assert all(re.fullmatch("#[0-9a-f]{6}", e.get("fill")) and not e.get("fill-opacity")
               for e in behind)


@pytest.mark.parametrize("until, to, told", [
    ("100us", "200us", "0 to 100 \u00b5s (the run ended before 200 \u00b5s)"),
    ("200us", "200us", "0 to 200 \u00b5s"), ("200us", "99us", "0 to 100 \u00b5s")])
def test_a_run_that_ends_too_early_is_in_the_caption(write, until, to, told):
    shown = picture(write(small()), "--until", until, "--to", to)
    assert f"500000 bit/s, {told}" in shown.text


@pytest.mark.parametrize("to, end", [("1200us", "1200us"), ("1201us", "1202us")])
def test_traffic_without_an_end_ends_with_the_window(write, tmp_path, to, end):
    path = write(small("100#, every: 1ms"))
    assert "never ends" in sim(path, "--svg", "-", status=1).stderr
    wanted = sim(path, "--svg", "-", "--until", "20ms", "--to", to).stdout
    log = tmp_path / "log"
    assert sim(path, "--svg", "-", "--to", to, "--events", log).stdout == wanted
    assert log.read_text() == sim(path, "--events", "-", "--until", end).stdout


# ---- Window and size -----------------------------------------------------------------------------


@pytest.mark.parametrize("bits, rows", [(1, 1), (2, 1), (79, 1), (80, 1), (81, 2), (161, 3),
                                        (2000, 25)])
def test_rows(write, bits, rows):
    text = sim(write(small()), "--svg", "-", "--until", "10ms", "--to", f"{2 * bits}us").stdout
    shown = Picture(text)
    assert len(shown.rows) == rows
    width = int(shown.root.get("width"))
    assert 680 <= width <= 860
    lanes = shown.classed("wire")
    assert sum(len(lane.findall(SVG + "g/" + SVG + "text")) for lane in lanes) == bits
    edges = [int(x) for x in re.findall(r" x=\"(-?\d+)\"", text)]
    assert min(edges) >= 0 and max(edges) <= width


@pytest.mark.parametrize("window", [["--until", "10ms"], ["--to", "4002us"],
                                    ["--from", "1us", "--to", "4001us"]])
def test_too_many_bits_are_status_one(write, window):
    result = sim(write(small()), "--svg", "-", "--events", "-", "--until", "10ms", *window,
                 status=1)
    assert "2000" in result.stderr and "--from" in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize("window", [
    ["--from", "3us", "--to", "2us"], ["--from", "1ms", "--to", "1ms"],
    ["--from", "soon"], ["--to", "0s"], ["--from", "1s"]])
def test_a_bad_window_is_refused(write, window):
    result = sim(write(small()), "--svg", "-", *window, status=1)
    assert window[0] in result.stderr and result.stdout == ""


def test_a_window_of_nothing_says_what_is_wrong(write):
    result = sim(write(small()), "--svg", "-", "--from", "1ms", "--to", "1ms", status=1)
    assert result.stderr == "canwire sim: --to 1ms: expected a time after that of --from, 1ms\n"


@pytest.mark.parametrize("before", [None, "what was there"])
def test_a_picture_that_becomes_too_long_leaves_its_file_alone(write, tmp_path, before):
    out = tmp_path / "f.svg"
    if before:
        out.write_text(before)
    path = write(small("123#, every: 1ms, count: 10"))
    result = sim(path, "--svg", out, "--log", tmp_path / "log", status=1)
    assert "2000" in result.stderr and "--from" in result.stderr
    assert out.exists() == bool(before) and (not before or out.read_text() == before)
    assert len((tmp_path / "log").read_text().splitlines()) == 10


def test_the_picture_repeats_and_goes_to_a_file(write, tmp_path):
    path = write(small())
    assert sim(path, "--svg", tmp_path / "f.svg").stdout == ""
    assert (tmp_path / "f.svg").read_text() == sim(path, "--svg", "-").stdout


def test_an_output_that_cannot_be_written_is_status_one(write, tmp_path):
    assert "nowhere" in sim(write(small()), "--svg", tmp_path / "nowhere/f", status=1).stderr
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    assert "/dev/full" in sim(write(small()), "--svg", "/dev/full", status=1).stderr


CLOCK = "clock: 40MHz, brp: 4, prop-seg: 7, phase-seg1: 8, phase-seg2: 4, sjw: 2"


def clocks(ppm):
    return f"""
bus: {{ name: can, bitrate: 500000 }}
nodes:
  - {{ name: a, {CLOCK}, traffic: [{{ send: 123#00FF00FF00 }}] }}
  - {{ name: b, {CLOCK}, ppm: {ppm} }}
"""


def test_what_nodes_do_by_their_own_clocks(write):
    shown = picture(write(clocks(-1000)))
    samples = shown.count("sample", "b")
    assert samples > 90
    # a bit of 14 pixels has 20 quanta: of these, each third is at least 1.5 pixels behind the last
    assert abs(shown.count("tq", "b") - 20 / 3 * samples) < 60
    assert shown.count("hard", "b") == 1 and shown.count("resync", "b") > 4
    assert {"-1"} <= set(shown.texts("phase-error", "b")) <= {"-1", "0"}


def test_equal_clocks_have_the_picture_of_common_bits(write):
    shown = picture(write(clocks(0)))
    assert shown.count("tq", "a") == shown.count("sample", "a") == 0
