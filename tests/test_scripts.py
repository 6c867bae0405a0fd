# SPDX-License-Identifier: MIT
"""The scripts that developers call: what they look at."""

import pathlib
import shutil
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent


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
