# SPDX-License-Identifier: MIT
"""The version stands in the Makefile; whatever else tells it has it from there, or is held here."""

import ctypes
import os
import pathlib
import re
import subprocess
import sys

import pytest

from simtool import CANWIRE, ROOT

VERSION = re.search(r"^VERSION := (.*)", (ROOT / "Makefile").read_text(), re.M)[1]
QUOTED = [  # documents that quote what a program says
    ("daemon/embed/canwire-sim.h", r'version of canwire, "([\d.]+)"'),
    ("daemon/man/canwire-control.7.md", r'\{"version":"([\d.]+)"'),
    ("daemon/man/canwire-journal.7.md", r'"canwire":"([\d.]+)"'),
    ("daemon/man/canwire-journal.7.md", r", canwire ([\d.]+), begun"),
    ("config/campaign/kubernetes.yaml", r"image: \S+/canwire:([\d.]+)"),
]


def output(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


@pytest.mark.parametrize("program", ["canwire", "canwired", "canwire-usb"])
def test_programs_tell_it(program):
    assert output(pathlib.Path(CANWIRE).with_name(program), "--version") == f"{program} {VERSION}\n"


def test_the_library_tells_it():
    library = ctypes.CDLL(os.environ["CANWIRE_SIM_LIBRARY"])
    library.canwire_sim_version.restype = ctypes.c_char_p
    assert library.canwire_sim_version().decode() == VERSION


def test_man_pages_tell_it():
    page = output(sys.executable, ROOT / "scripts/man", "--build", pathlib.Path(CANWIRE).parent,
                  ROOT / "daemon/man/canwire.1.md")
    assert re.search(r'^\.TH .* "canwire (.*)"$', page, re.M)[1] == VERSION


def test_the_change_log_begins_with_it():
    first = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)[1]
    assert first == VERSION


@pytest.mark.parametrize("name, pattern", QUOTED)
def test_documents_quote_it(name, pattern):
    found = re.findall(pattern, (ROOT / name).read_text())
    assert found and set(found) == {VERSION}


def test_no_other_file_defines_it():
    """A build with another version in the Makefile says that one everywhere."""
    files = output("git", "ls-files", "daemon", "lib", "scripts").splitlines() \
        if (ROOT / ".git").exists() else []
    quoted = {name for name, _ in QUOTED}
    assert [name for name in files if name not in quoted
            and VERSION in (ROOT / name).read_text(errors="replace")] == []
