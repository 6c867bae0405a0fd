# SPDX-License-Identifier: MIT
"""canwire campaign run --resume: rows of an earlier run are continued, or refused."""

import fcntl
import json
import shutil
import threading

import pytest

from test_campaign import BUS, MANY, campaign, fixture_make, fixture_no_shard

__all__ = ["fixture_make", "fixture_no_shard"]
FEW = "scenario: bus.yaml\nvary:\n" \
    "  - { set: nodes.dash.queue, range: { from: 1, to: 9, step: 1 } }\n"


@pytest.fixture(name="torn")
def fixture_torn(make, tmp_path):
    """torn(text, bus, rows) leaves some rows of a campaign, and half of the next one. It returns
    the campaign, the file that its rows go to, and all rows."""
    def tear(text=FEW, bus=BUS, rows=4):
        file, out = make(text, bus), tmp_path / "rows.ndjson"
        lines = campaign("run", file).stdout.splitlines(True)
        part = "".join(lines[:rows]) + lines[rows][:50]
        (tmp_path / "rows.ndjson.part").write_text(part)
        return file, out, "".join(lines)
    return tear


def test_it_says_what_was_there_and_checked(torn):
    file, out, wanted = torn()
    message = campaign("run", file, "--out", out, "--resume").stderr
    assert f"{out}.part: 4 rows are there; the first and the last one, made again, are the same" \
        in message
    assert out.read_text() == wanted
    message = campaign("run", file, "--out", out, "--resume").stderr
    assert f"{out}: 9 rows are there; the first and the last one" in message


def test_one_row_is_made_again_once(torn):
    file, out, wanted = torn(rows=1)
    message = campaign("run", file, "--out", out, "--resume").stderr
    assert "1 row is there; made again, it is the same" in message
    assert out.read_text() == wanted


def refused(file, out):
    """Returns the message; what is there stays as it is."""
    part = out.with_suffix(".ndjson.part")
    before = part.read_bytes()
    result = campaign("run", file, "--out", out, "--resume", status=1)
    assert part.read_bytes() == before[:part.stat().st_size] and not out.exists()
    assert part.read_bytes() == b"".join(before.splitlines(True)[:4])
    return result.stderr


def test_rows_of_a_scenario_that_has_changed(torn, write):
    file, out, _ = torn()
    write(BUS.replace("max: 3", "max: 4"))  # an expectation that is met in both cases
    again = campaign("run", file, "--out", out, "--resume", status=0).stderr
    assert "9 rows: 9 passed" in again  # nothing in a row says how many errors are allowed
    out.unlink()
    file, out, _ = torn()
    write(BUS.replace("every: 10ms", "every: 11ms"))
    message = refused(file, out)
    assert f"{out}.part: row 0 is another one when it is made again: the campaign, its scenario, " \
        "a file that it names, or canwire has changed since" in message


def test_rows_of_a_profile_and_of_a_log_that_have_changed(torn, tmp_path):
    profile = "parameters: { victim: ~ }\nfaults:\n  - name: late\n" \
        "    when: { frame: 123, skip: 1, count: 1 }\n    do: { flip: sof, at: [ $victim ] }\n"
    log = "(0.001000) can0 321#11\n(0.002000) can0 322#11\n"
    bus = BUS.replace("  - name: gearbox\n",
                      "  - name: gearbox\n    traffic: [ { replay: drive.log } ]\n")
    text = bus.replace("max: 3", "max: 9").replace(
        "expect:", "profiles: [ { file: profile.yaml, with: { victim: dash } } ]\nexpect:")
    for name, changed in ("drive.log", log.replace("0.002", "0.050")), \
            ("profile.yaml", profile.replace("skip: 1", "skip: 2")):
        (tmp_path / "drive.log").write_text(log)
        (tmp_path / "profile.yaml").write_text(profile)
        file, out, wanted = torn(bus=text)
        assert json.loads(wanted.splitlines()[0])["faults"] == 2
        (tmp_path / name).write_text(changed)
        assert "is another one when it is made again" in refused(file, out)


def test_a_changed_last_row(torn, tmp_path):
    file, out, _ = torn()
    part = tmp_path / "rows.ndjson.part"
    lines = part.read_text().splitlines(True)
    part.write_text("".join([*lines[:3], lines[3].replace('"faults":1', '"faults":2')]))
    assert "row 3 is another one" in refused(file, out)
    part.write_text("".join([*lines[:2], lines[2].replace('"outcome":"passed"',
                                                           '"outcome":"passed?"'), *lines[3:]]))
    assert "it has other rows" in campaign("run", file, "--out", out, "--resume", status=1).stderr


@pytest.mark.parametrize("rows, step", [(65, 64), (1000, 64), (1025, 128), (1152, 128)])
def test_a_changed_row_among_many(make, tmp_path, rows, step):
    """Each step-th row is made again."""
    file, out = make(MANY.replace("to: 2", "to: 3")), tmp_path / "rows.ndjson"
    part = tmp_path / "rows.ndjson.part"
    campaign("run", file, "--out", out)
    lines = out.read_text().splitlines(True)[:rows]
    out.unlink()

    for changed in range(step, rows, step):
        part.write_text("".join([*lines[:changed],
                                 lines[changed].replace('"faults":', '"faults":7'),
                                 *lines[changed + 1:]]))
        message = campaign("run", file, "--out", out, "--resume", status=1).stderr
        assert f"row {changed} is another one when it is made again" in message
    part.write_text("".join(lines))
    made = len({*range(0, rows, step), rows - 1})
    message = campaign("run", file, "--out", out, "--resume").stderr
    assert f"{rows} rows are there; the first and the last one" in message
    assert made == 2 or f"and {made - 2} between, made again, are the same" in message


def test_crashes_are_not_made_again(make, tmp_path):
    """They may be those of another machine; the last row that has a result is."""
    file, out = make(FEW), tmp_path / "rows.ndjson"
    lines = campaign("run", file).stdout.splitlines(True)
    lost = [json.loads(line) for line in lines[:3]]
    for row in lost[1:]:
        for key in list(row)[3:-1]:
            del row[key]
        row.update(outcome="time-out", repeat=row.pop("repeat"))
    text = lines[0] + "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in lost[1:])
    (tmp_path / "rows.ndjson.part").write_text(text)
    result = campaign("run", file, "--out", out, "--resume", status=3)
    assert "3 rows are there; made again, it is the same" in result.stderr
    assert "9 rows: 7 passed, 2 time-out" in result.stderr
    assert out.read_text() == text + "".join(lines[3:])


def test_a_part_that_another_program_writes(torn):
    file, out, _ = torn()
    with open(f"{out}.part", "rb") as other:
        before = other.read()
        fcntl.flock(other, fcntl.LOCK_EX)
        for words in ["--resume"], []:
            message = campaign("run", file, "--out", out, *words, status=1).stderr
            assert f"{out}.part: another program is writing it" in message
        other.seek(0)
        assert other.read() == before
    campaign("run", file, "--out", out, "--resume")


def test_processes_of_a_run_that_was_killed_may_hold_the_part_a_little_longer(torn):
    file, out, wanted = torn()
    with open(f"{out}.part", "rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        timer = threading.Timer(0.3, fcntl.flock, (other, fcntl.LOCK_UN))
        timer.start()
        campaign("run", file, "--out", out, "--resume")
        timer.join()
    assert out.read_text() == wanted


def test_a_large_campaign_goes_on_after_each_row(make, tmp_path):
    file, out = make(MANY), tmp_path / "rows.ndjson"
    campaign("run", file, "--out", out)
    wanted = out.read_text()
    for rows in 1, 2, 255, 256, 257, 863, 864:
        out.unlink()
        (tmp_path / "rows.ndjson.part").write_text("".join(wanted.splitlines(True)[:rows]))
        campaign("run", file, "--out", out, "--resume")
        assert out.read_text() == wanted
    shutil.move(out, tmp_path / "rows.ndjson.part")
    campaign("run", file, "--out", out)  # without --resume all rows are made anew
    assert out.read_text() == wanted
