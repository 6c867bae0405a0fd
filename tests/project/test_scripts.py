# SPDX-License-Identifier: MIT
"""The scripts that developers call: what they look at, and what they leave behind."""

import os
import pathlib
import shutil
import signal
import subprocess
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PATIENCE_S = 60  # until something that must come counts as missing


def write_script(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/bash\n{text}\n")
    path.chmod(0o755)


def copy_script(name, root):
    (root / "scripts").mkdir(parents=True, exist_ok=True)
    return shutil.copy(ROOT / "scripts" / name, root / "scripts")


# ---- check -----------------------------------------------------------------------------------

LINES, SHELL = "no line of code has more than 100 columns", "shell scripts"


def check(root):
    """Of a tree that has hardly anything: what scripts/check says of lines and of shell scripts."""
    done = subprocess.run([copy_script("check", root), "none.a"], capture_output=True, text=True,
                          check=False, timeout=600)
    assert done.returncode == 1, "the library is not there"
    return {name: (word, done.stdout) for word in ("ok", "FAILED") for name in (LINES, SHELL)
            if f"{word}: {name}\n" in done.stdout}


def test_check_looks_at_files_that_are_not_in_git(tmp_path):
    (tmp_path / "lib").mkdir()
    source = tmp_path / "lib/a.c"
    source.write_text("int a;" + " " * 94 + "\n")
    write_script(tmp_path / "tests/a.sh", "echo hello")
    write_script(tmp_path / "build/b.py", "#" * 200)
    assert {name: word for name, (word, _) in check(tmp_path).items()} == {LINES: "ok", SHELL: "ok"}
    source.write_text("int a;" + " " * 95 + "\n")
    write_script(tmp_path / "tests/a.sh", "cd $1")
    found = check(tmp_path)
    assert found[LINES][0] == "FAILED" and "lib/a.c:1: 101 columns" in found[LINES][1]
    assert found[SHELL][0] == "FAILED" and "In tests/a.sh line 2:" in found[SHELL][1]


# ---- soak ------------------------------------------------------------------------------------

NOTE = 'echo $$ >"$0.new" && mv "$0.new" "$0.pid" && '  # its process, in one go


class Soak:
    """scripts/soak with other programs in place of the guest and of the differential test."""

    def __init__(self, root, guest, differential):
        self.programs = [root / "scripts/guest", root / "differential"]
        for program, text in zip(self.programs, (guest, differential)):
            write_script(program, NOTE + text)
        self.process = subprocess.Popen(  # pylint: disable=consider-using-with
            [copy_script("soak", root), "1s", "7", self.programs[1], "canwired"],
            stdout=subprocess.PIPE, text=True, start_new_session=True,
            # what starts these tests in the background may have it ignored
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def pids(self):
        """Of the two, once both run."""
        files = [program.with_name(program.name + ".pid") for program in self.programs]
        deadline = time.monotonic() + PATIENCE_S
        while not all(file.exists() for file in files):
            assert time.monotonic() < deadline, "they do not start"
            time.sleep(0.02)
        return [int(file.read_text()) for file in files]

    def end(self):
        """Its exit status and what it wrote."""
        output = self.process.communicate(timeout=PATIENCE_S)[0]
        return self.process.returncode, output


@pytest.fixture(name="soak")
def fixture_soak(tmp_path):
    soaks = []

    def start(guest, differential):
        soaks.append(Soak(tmp_path, guest, differential))
        return soaks[-1]

    yield start
    for each in soaks:
        try:
            os.killpg(each.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        each.process.communicate()


def runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_soak_that_is_stopped_leaves_nothing_behind(soak, number):
    one = soak("exec sleep 300", "exec sleep 300")
    pids = one.pids()
    if number == signal.SIGINT:  # as a terminal does
        os.killpg(one.process.pid, number)
    else:
        one.process.send_signal(number)
    assert one.end()[0] == 128 + number
    assert [pid for pid in pids if runs(pid)] == []


@pytest.mark.parametrize("guest, differential, status", [(0, 0, 0), (1, 0, 1), (0, 1, 1)])
def test_a_soak_fails_when_one_of_the_two_fails(soak, guest, differential, status):
    found = soak(f"exit {guest}", f'echo "the rest: $*"; exit {differential}').end()
    assert found[0] == status
    assert "the rest: --bits 1666666 --seed 700000" in found[1]
