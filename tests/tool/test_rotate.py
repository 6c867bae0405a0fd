# SPDX-License-Identifier: MIT
"""Recordings that another program renames, removes or shortens: nothing goes where nobody looks.

The two ways of logrotate are those that canwire-record(7) shows. CANWIRE and CANWIRED are the
programs.
"""

import json
import re
import shutil
import socket
import subprocess

import pytest

from simtool import CANWIRE, ROOT
from test_record import (  # pylint: disable=unused-import
    PATIENCE_S, fixture_bus, lines, tshark, wait_until)

RECORD = ROOT / "daemon/man/canwire-record.7.md"


def entries(running, name):
    return running.recordings()[name]["entries"]


def wait_more(running, name, count=10):
    """Waits for so many more entries, counted from now on."""
    enough = entries(running, name) + count
    wait_until(lambda: entries(running, name) >= enough, f"{count} more entries")


def frames_of(stderr):
    return int(re.search(r"stopped: (\d+) frames", stderr).group(1))


def test_a_renamed_file_is_begun_anew_and_no_frame_is_lost(bus, tmp_path):
    running = bus("file: a.log")
    with socket.socket(socket.AF_UNIX) as control:
        control.settimeout(PATIENCE_S)
        control.connect(str(tmp_path / "rec.sock"))
        told = control.makefile("rw")
        told.write('{"request":"watch","events":["record"]}\n')
        told.flush()
        told.readline()
        wait_more(running, "a.log")
        (tmp_path / "a.log").rename(tmp_path / "old.log")
        event = json.loads(told.readline())
    assert (event["file"], event["state"]) == ("a.log", "recording")
    wait_more(running, "a.log")
    stderr = running.stop()
    assert "record a.log: somebody has renamed the file; begun anew" in stderr
    both = lines(tmp_path / "old.log") + lines(tmp_path / "a.log")
    assert len(both) == frames_of(stderr) and lines(tmp_path / "a.log")
    assert sorted(both) == both


def test_a_renamed_file_that_has_a_name_of_the_rotation_is_no_obstacle(bus, tmp_path):
    running = bus("file: a.log, files: 3")
    wait_more(running, "a.log")
    (tmp_path / "a.log").rename(tmp_path / "a.log.1")
    (tmp_path / "a.log").write_text("")  # logrotate's `create`
    wait_until(lambda: "begun anew" in running.log.read_text(), "the look at it")
    wait_more(running, "a.log")
    stderr = running.stop()
    assert "stopped: another" not in stderr
    assert len(lines(tmp_path / "a.log.1") + lines(tmp_path / "a.log")) == frames_of(stderr)


def test_a_file_that_is_gone_is_begun_anew(bus, tmp_path):
    running = bus("file: a.log", "file: b.pcapng", "file: c.vcd")
    wait_more(running, "a.log")
    for name in ("a.log", "b.pcapng", "c.vcd"):
        (tmp_path / name).unlink()
    wait_until(lambda: (tmp_path / "a.log").exists() and (tmp_path / "b.pcapng").exists()
               and (tmp_path / "c.vcd").exists(), "the files again")
    for name in ("a.log", "b.pcapng", "c.vcd"):
        wait_more(running, name)
    assert running.stop().count("somebody has removed the file, with what was in it") == 3
    assert lines(tmp_path / "a.log") and tshark(tmp_path / "b.pcapng", "can.id")
    assert (tmp_path / "c.vcd").read_text().startswith("$version")


@pytest.mark.parametrize("name", ["a.log", "b.pcapng", "c.vcd"])
def test_a_shortened_file_has_no_zeros_and_has_its_begin(bus, tmp_path, name):
    running = bus(f"file: {name}")
    wait_more(running, name)
    path = tmp_path / name
    shutil.copy(path, tmp_path / "copy")
    with path.open("r+b") as file:
        file.truncate(0)
    wait_until(lambda: "somebody has made the file shorter" in running.log.read_text(), "the look")
    wait_more(running, name)
    stderr = running.stop()
    if name == "a.log":
        assert "\0" not in path.read_text() and lines(path)
        assert len(lines(tmp_path / "copy") + lines(path)) <= frames_of(stderr)
    elif name == "b.pcapng":
        assert tshark(path, "can.id")
    else:
        assert path.read_text().startswith("$version") and "$dumpvars" in path.read_text()


def stanza(words, folder):
    """Returns the part of the page with these words, for recordings in a folder."""
    text, = [part for part in re.findall(r"```\n(/var.*?)```", RECORD.read_text(), re.S)
             if words in part]
    text = text.replace("/var/lib/canwire", str(folder)).replace("    su canwire canwire\n", "")
    return text.replace("systemctl reload 'canwired@*'", f"{CANWIRE} reload {folder}/rec.sock")


def logrotate(folder, text):
    (folder / "rotate.conf").write_text(text)
    (folder / "rotate.conf").chmod(0o644)
    folder.chmod(0o755)
    done = subprocess.run(
        ["/usr/sbin/logrotate", "--force", "--state", folder / "rotate.state",
         folder / "rotate.conf"],
        check=False, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr


def test_logrotate_renames_and_loses_nothing(bus, tmp_path):
    running = bus("file: a.log, size: 1000GB")
    for _ in range(3):
        wait_more(running, "a.log")
        begun = running.recordings()["a.log"]["files_begun"]
        logrotate(tmp_path, stanza("postrotate", tmp_path))
        wait_until(lambda n=begun: running.recordings()["a.log"]["files_begun"] == n + 1,
                   "the next file")
    wait_more(running, "a.log")
    frames = frames_of(running.stop())
    for packed in tmp_path.glob("a.log.*.gz"):
        subprocess.run(["gunzip", packed], check=True)
    parts = [tmp_path / name for name in ("a.log.3", "a.log.2", "a.log.1", "a.log")]
    assert sum(len(lines(part)) for part in parts) == frames


def test_logrotate_copies_and_truncates(bus, tmp_path):
    running = bus("file: a.log, size: 1000GB")
    wait_more(running, "a.log", 40)
    logrotate(tmp_path, stanza("copytruncate", tmp_path))
    wait_until(lambda: "somebody has made the file shorter" in running.log.read_text(), "the look")
    wait_more(running, "a.log", 40)
    running.stop()
    first, second = lines(tmp_path / "a.log.1"), lines(tmp_path / "a.log")
    assert len(first) >= 40 and second and first[-1] < second[0]
