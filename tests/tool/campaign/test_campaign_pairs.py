# SPDX-License-Identifier: MIT
"""canwire campaign report: the classes of rows for pairs of values of two factors."""

import collections
import html.parser
import itertools
import json
import re

import pytest

from test_campaign_report import (CAMPAIGN, class_of, fixture_no_shard, fixture_rows, in_json,
                                  report, wilson)

__all__ = ["fixture_no_shard", "fixture_rows"]
FAILED = {"expectation failed but detected", "failed undetected"}
WORST = re.compile(r"^(\S.*?) +(\d+) +(\d+)  (\d+\.\d+) % \((\d+\.\d+) to (\d+\.\d+) %\)$")


def counted(every):
    """The classes of rows, by ((factor, value), (factor, value))."""
    found = collections.defaultdict(collections.Counter)
    for row in every:
        for pair in itertools.combinations(row["factors"].items(), 2):
            found[pair][class_of(row)] += 1
    return found


def worst_of(text):
    """The table of the worst pairs of values: the name of its last column but one, and its rows."""
    lines = text.splitlines()
    at, = [i for i, line in enumerate(lines) if line.startswith("the worst pairs of values ")]
    end = lines.index("", at)
    return lines[at].split()[-2], [WORST.match(line).groups() for line in lines[at + 1:end]]


class Maps(html.parser.HTMLParser):
    """The tables in elements with the class `map`: lists of lists of (text, title)."""

    def __init__(self, page):
        super().__init__()
        self.maps, self.inside, self.title = {}, False, None
        self.name, self.tag = "", None
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tag = tag
        if tag == "h3":
            self.name = ""
        if attrs.get("class") == "map":
            self.inside = True
            self.maps[self.name] = []
        if self.inside and tag == "tr":
            self.maps[self.name].append([])
        if self.inside and tag in ("td", "th"):
            self.maps[self.name][-1].append(["", attrs.get("title"), attrs.get("style")])

    def handle_endtag(self, tag):
        self.inside = self.inside and tag != "div"
        self.tag = None

    def handle_data(self, data):
        if self.tag == "h3":
            self.name += data
        if self.inside and self.tag in ("td", "th"):
            self.maps[self.name][-1][-1][0] += data


def test_each_pair_of_values_has_its_classes(rows):
    file, every = rows()
    wanted = counted(every)
    seen = 0
    for pair in in_json(file)["pairs"]:
        first, second = pair["factors"]
        assert len(pair["values"]) == pair["met"]
        for one in pair["values"]:
            mine, = [classes for ((a, x), (b, y)), classes in wanted.items()
                     if (a, b) == (first, second) and [str(x), str(y)] == one["values"]]
            seen += 1
            assert one["rows"] == sum(mine.values())
            assert {name: one[name] for name in one.keys() - {"values", "rows", "failed"}} == mine
            failed = sum(mine[name] for name in FAILED)
            assert one["failed"]["rows"] == failed
            assert one["failed"]["share"] == pytest.approx(failed / one["rows"])
            assert one["failed"]["high"] == pytest.approx(wilson(failed, one["rows"])[1])
        # in the order of the campaign, where crc[9] is before eof[6], and 20 behind 1
        assert pair["values"][0]["values"][0] == str(every[0]["factors"][first])
    assert seen == len(wanted) == 33 + 22 + 6


def test_the_worst_pairs_are_the_first_ones(rows):
    file, every = rows()
    wanted = []
    for ((first, x), (second, y)), classes in counted(every).items():
        failed = sum(classes[name] for name in FAILED)
        low, high = wilson(failed, sum(classes.values()))
        if failed:
            wanted.append((f"{first} {x}, {second} {y}", sum(classes.values()), failed,
                           low, high))
    by_name = {one[0]: one for one in wanted}
    name, table = worst_of(report(file).stdout)
    assert name == "failed" and len(table) == 10 < len(wanted)
    lows = [by_name[values][3] for values, *_ in table]
    assert lows == sorted(lows, reverse=True)
    assert lows == pytest.approx(sorted((one[3] for one in wanted), reverse=True)[:10])
    for values, count, failed, share, low, high in table:
        one = by_name[values]
        assert (int(count), int(failed)) == one[1:3]
        assert (float(share), float(low), float(high)) == pytest.approx(
            (100 * one[2] / one[1], 100 * one[3], 100 * one[4]), abs=0.0006)
    # many rows come before few ones with the same share
    shares = [float(one[3]) for one in table]
    assert shares[0] == shares[1] == 100 and int(table[0][1]) > int(table[-1][1])


def test_a_map_has_the_share_of_each_pair_of_values(rows):
    file, every = rows()
    wanted = counted(every)
    maps = Maps(report(file, "--html", "-").stdout).maps
    assert list(maps) == ["position with hits", "position with frame", "hits with frame"]
    for name, (head, *lines) in maps.items():
        first, second = name.split(" with ")
        rows_of, columns_of = head[0][0].split(" \\ ")
        assert {first, second} == {rows_of, columns_of}
        assert len(lines) * (len(head) - 1) == len(
            [pair for pair in wanted if [one for one, _ in pair] == [first, second]])
        for line in lines:
            for column, (text, title, style) in zip(head[1:], line[1:]):
                value = {rows_of: line[0][0], columns_of: column[0]}
                mine, = [classes for ((a, x), (b, y)), classes in wanted.items()
                         if (a, b, str(x), str(y)) == (first, second, value[first], value[second])]
                every_row = sum(mine.values())
                failed = sum(mine[one] for one in FAILED)
                assert float(text) == pytest.approx(100 * failed / every_row, abs=0.051)
                assert title.startswith(f"{first} {value[first]}, {second} {value[second]}: "
                                        f"{every_row} rows; failed {failed}, ")
                for one, count in mine.items():
                    assert f"; {one} {count}" in title
                assert (style is not None) == (failed > 0)


def test_a_map_shows_the_worst_values_of_many(rows):
    text = CAMPAIGN.replace('[ "200", "7FF" ]', '[ "200" ]') + \
        "  - { set: seed, range: { from: 1, to: 45, step: 1 } }\n"
    file, every = rows(text + "sample: { random: 600 }\n")
    page = report(file, "--html", "-").stdout
    maps = Maps(page).maps
    # `frame` has one value: its pairs say nothing more
    assert list(maps) == ["position with hits", "position with seed", "hits with seed"]
    assert [len(table) - 1 for table in maps.values()] == [11, 40, 40]
    assert page.count("<p>The 40 worst of 45 values of seed.</p>") == 2
    seeds = [int(line[0][0]) for line in maps["hits with seed"][1:]]
    assert seeds == sorted(seeds) and len(set(seeds)) == 40
    met = {(row["factors"]["position"], str(row["factors"]["seed"])) for row in every}
    head, *lines = maps["position with seed"]
    empty = 0
    for line in lines:
        for column, (shown, title, _) in zip(head[1:], line[1:]):
            empty += shown == ""
            assert (shown == "") == ((column[0], line[0][0]) not in met)
            assert (shown == "") == title.endswith(": no row")
    assert 0 < empty < 440
    assert "frame 200" not in "".join(one[0] for one in worst_of(report(file).stdout)[1])


def test_without_failures_it_shows_what_is_degraded(rows):
    calm = CAMPAIGN.replace('[ "200", "7FF" ]', '[ "7FE", "7FF" ]').replace(
        "[ 1, 20, 300 ]", "[ 1, 20 ]")
    file, every = rows(calm)
    assert {class_of(row) for row in every} == {"corrected by retransmission", "degraded",
                                               "no effect"}
    name, table = worst_of(report(file).stdout)
    assert name == "degraded"
    degraded = collections.Counter()
    for pair, classes in counted(every).items():
        degraded[", ".join(f"{one} {value}" for one, value in pair)] = classes["degraded"]
    assert all(int(one[2]) == degraded[one[0]] > 0 for one in table)
    assert Maps(report(file, "--html", "-").stdout).maps
    good = calm.replace("[ 1, 20 ]", "[ 1 ]")
    file, every = rows(good)
    assert "degraded" not in {class_of(row) for row in every}
    assert "the worst pairs" not in report(file).stdout
    assert "Pairs of values" not in report(file, "--html", "-").stdout


def test_too_many_pairs_of_values_are_counted_together(rows, tmp_path):
    """A hundred rows with 64 factors, each with new values: 2016 pairs of factors."""
    _, every = rows()
    failed = next(row for row in every if row["outcome"] == "failed")
    file = tmp_path / "many.ndjson"
    factors = 64
    file.write_text("".join(json.dumps({
        **failed, "number": number, "repeat": "canwire campaign run none.yaml",
        "factors": {f"f{i}": number for i in range(factors)}}) + "\n" for number in range(100)))
    text = report(file).stdout
    # 65536 / 2016 for each pair of factors, and 65536 for those that come first
    assert re.search(r"^2016 pairs of factors have more pairs of values than are told apart$", text,
                     re.MULTILINE)
    page = report(file, "--html", "-").stdout
    assert f"and {2016 - 50} further pairs of factors" in page
    assert page.count('<div class="map">') == 50
    assert re.search(r"<p>\d+ rows have further pairs of values, which are not told", page)
    assert ': not told apart">?</td>' in page
    # one pair of factors has all of its rows
    file.write_text("".join(json.dumps({
        **failed, "number": number, "repeat": "canwire campaign run none.yaml",
        "factors": {"a": number, "b": -number}}) + "\n" for number in range(100)))
    pair, = in_json(file)["pairs"]
    assert [one["values"] for one in pair["values"]] == [[str(n), str(-n)] for n in range(100)]
