# SPDX-License-Identifier: MIT
"""The journal of a car whose traffic the configuration determines.

It takes little of the disk, and a run of it is the same, packed or as text. Another run is told,
with the second.

Needs no CAN in the kernel.
"""

import json
import subprocess
import zlib

import pytest

from simtool import (CANWIRED, ROOT, canwire, journal_lines, journal_text, kill_all, sim,
                     stop_canwired)
from test_record import wait_until

CAR = (ROOT / "tests/bench/car.yaml").read_text()
TICKS_PER_S = 80_000_000
MARKS = 4  # one a second
FRAMES_PER_S = 4096
BYTES_AN_HOUR = 60_000_000


def seconds(tick):
    """Returns a time as messages have it."""
    return f"{tick // TICKS_PER_S}.{tick % TICKS_PER_S * 25 // 2:09d} s"


class Car:
    """A canwired that simulates the car, until it has written some marks."""

    def __init__(self, folder):
        self.journal, self.log = folder / "car.journal", folder / "log"
        (folder / "car.yaml").write_text(CAR)
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "car.yaml", "--journal",
                                             "car.journal"], cwd=folder, stderr=log)

    def wait(self):
        wait_until(lambda: journal_text(self.journal).count('"mark"') >= MARKS, "the marks")

    def stop(self):
        self.wait()
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="drive", scope="module")
def fixture_drive(tmp_path_factory):
    """Returns the journal of a drive."""
    car = Car(tmp_path_factory.mktemp("car"))
    try:
        car.stop()
    finally:
        kill_all([car.process])
    return car.journal


def marks(journal):
    return [line for line in journal_lines(journal) if "mark" in line]


def simulated(folder, until):
    """Returns the events of the car, without a journal."""
    (folder / "alone.yaml").write_text(CAR)
    return sim(folder / "alone.yaml", "--until", f"{until / 80}us", "--events", "-").stdout


def reseal(lines):
    """Puts the checksums of changed lines right."""
    crc, sealed = 0, []
    for line in lines:
        body, found, _ = line.partition(',"crc"')
        crc = zlib.crc32((body if found else f"{line}\n").encode(), crc)
        sealed.append(f'{body},"crc":"{crc:08x}"}}' if found else line)
        crc = 0 if found else crc
    return "\n".join(sealed) + "\n"


# ---- What it takes -------------------------------------------------------------------------------

def test_an_hour_of_a_car_takes_little_of_the_disk(drive):
    """It was 1.7 GB when each frame was a line. A machine with other work may skip time."""
    frames = journal_lines(drive)[-1]["end"]["frames"]
    hour = drive.stat().st_size / frames * FRAMES_PER_S * 3600
    print(f"{hour / 1e6:.1f} MB an hour, {frames} frames")
    assert frames > FRAMES_PER_S and hour <= BYTES_AN_HOUR


# ---- It is the run -------------------------------------------------------------------------------

def test_a_run_of_it_has_all_frames_at_their_time(drive, tmp_path):
    end = marks(drive)[-1]["at"]
    again = sim("--journal", drive, "--events", "-", "--until", f"{end / 80}us")
    assert again.stderr == ""
    assert again.stdout == simulated(tmp_path, end) != ""
    whole = canwire("check", "--journal", drive).stdout
    frames = journal_lines(drive)[-1]["end"]
    assert f" {frames['frames'] + frames['pending']} inputs, " in whole and " ended)" in whole


@pytest.mark.parametrize("command", [["zstdcat"], ["sh", "-c", "zstdcat $0 | zstd -19 --check"],
                                     ["sh", "-c", "zstdcat $0 | head -n 99"],
                                     ["head", "-c", "3000"]], ids=" ".join)
def test_it_can_be_a_text_or_packed_anew_or_cut(drive, tmp_path, command):
    other = tmp_path / "other"
    other.write_bytes(subprocess.run([*command, drive], stdout=subprocess.PIPE, check=True).stdout)
    whole = sim("--journal", drive, "--events", "-").stdout
    run = sim("--journal", other, "--events", "-")
    is_cut = "head" in " ".join(command)
    assert ("the journal is cut off at" in run.stderr) == is_cut
    assert run.stdout and (whole.startswith(run.stdout) if is_cut else whole == run.stdout)
    checked = canwire("check", "--journal", other, status=int(is_cut))
    assert ("cut off: canwired has not written its end" in checked.stderr) == is_cut


def test_zstd_finds_nothing_wrong_with_it(drive):
    subprocess.run(["zstd", "-qt"], stdin=drive.open("rb"), check=True)


def test_a_kill_leaves_what_is_complete(tmp_path):
    car = Car(tmp_path)
    try:
        car.wait()
    finally:
        kill_all([car.process])
    end = journal_lines(car.journal)[-1]["at"]
    run = sim("--journal", car.journal, "--events", "-")
    assert f"the journal is cut off at {seconds(end)} " in run.stderr
    assert end >= marks(car.journal)[-1]["at"]
    assert simulated(tmp_path, end).startswith(run.stdout) and run.stdout.count('"tx"') > 4000


# ---- Another run ---------------------------------------------------------------------------------

def play_changed(folder, lines):
    (folder / "changed").write_text(reseal(lines))
    return sim("--journal", folder / "changed", status=1).stderr


def test_another_digest_is_told_with_its_second(drive, tmp_path):
    lines = journal_text(drive).splitlines()
    known = marks(drive)
    digest = known[2]["digest"]
    lines = [line.replace(digest, f"{int(digest, 16) ^ 1:016x}") for line in lines]
    number = next(i for i, line in enumerate(lines, 1) if json.loads(line).get("at") ==
                  known[2]["at"] and '"mark"' in line)
    said = play_changed(tmp_path, lines)
    assert f"/changed:{number}:" in said and said.count("\n") == 1
    assert ("this run is another one than that of the journal: the configuration sends something "
            f"else between {seconds(known[1]['at'])} and {seconds(known[2]['at'])}; it was written "
            "by canwire ") in said


@pytest.mark.parametrize("change", [("080#0D", "080#0C"), ("080#0D, every: 10ms, offset: 0us",
                                                           "080#0D, every: 10ms, offset: 1us")])
def test_other_traffic_is_told(drive, tmp_path, change):
    assert change[0] in CAR
    said = play_changed(tmp_path, [line.replace(*change)
                                   for line in journal_text(drive).splitlines()])
    assert f"sends something else between {seconds(0)} and " in said


def test_frames_that_do_not_come_are_told(drive, tmp_path):
    lines = journal_text(drive).splitlines()
    last = max(i for i, line in enumerate(lines) if '"sent":' in line)
    lines[last] = lines[last].replace('"sent":', '"sent":99999')
    said = play_changed(tmp_path, lines)
    assert f"/changed:{last + 1}:" in said
    assert " of the frames of the configuration do not come; " in said


# ---- Damage --------------------------------------------------------------------------------------

def test_damage_is_told_with_its_place(drive, tmp_path):
    broken = bytearray(drive.read_bytes())
    broken[len(broken) // 2] ^= 0x10
    (tmp_path / "broken").write_bytes(broken)
    checked = canwire("check", "--journal", tmp_path / "broken", status=1)
    assert ": damaged: " in checked.stderr and " behind " in checked.stderr
    run = sim("--journal", tmp_path / "broken", "--events", "-", status=1)
    assert ": damaged: " in run.stderr
    assert sim("--journal", drive, "--events", "-").stdout.startswith(run.stdout)
