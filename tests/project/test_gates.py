# SPDX-License-Identifier: MIT
"""The gates of instructions: what they say of dearer and cheaper work, and that the table in
tests/README.md has their values."""

import os
import subprocess
import sys

import pytest

import gates
from simtool import ROOT

VALUES = {name: 1000.0 for name in gates.texts()}


@pytest.fixture(name="limits")
def fixture_limits():
    return gates.Limits(dict(VALUES), "0123")


def complaints(limits, **values):
    return dict(limits.complaints(VALUES | {name.replace("_", "-"): value
                                            for name, value in values.items()}))


def test_the_table_has_the_limits():
    assert gates.written_table() == gates.table(gates.Limits.read())


def test_a_value_may_grow_by_one_percent(limits):
    assert not complaints(limits, clean_2=1009.9, clean_64=990.1)
    assert complaints(limits, clean_2=1010.1) == {"clean-2": "is 1.0% above the best so far"}


def test_what_becomes_better_must_be_kept(limits):
    assert "make gates WRITE=yes" in complaints(limits, node_bytes=989.0)["node-bytes"]
    better = limits.better(VALUES | {"node-bytes": 989.0, "clean-2": 1005.0}, "4567")
    assert better.values == VALUES | {"node-bytes": 989.0} and better.commit == "4567"
    assert limits.better(VALUES | {"clean-2": 1005.0}, "4567").commit == "0123"


def test_a_value_without_a_limit_is_a_complaint_until_it_is_written(limits):
    del limits.values["clean-2"]
    assert list(complaints(limits)) == ["clean-2"]
    assert limits.better(VALUES, "4567").values == VALUES


def test_limits_are_read_as_they_were_written(limits, tmp_path):
    limits.write(tmp_path / "limits")
    read = gates.Limits.read(tmp_path / "limits")
    assert (read.values, read.commit) == (limits.values, limits.commit)


def test_only_the_table_of_a_document_is_written(limits, tmp_path):
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- scripts/gates --write -->\nold\n<!-- end -->\nbehind\n")
    gates.write_table(limits, page)
    assert gates.written_table(page) == gates.table(limits)
    assert page.read_text().startswith("before\n") and page.read_text().endswith("\nbehind\n")


def test_with_another_compiler_nothing_counts_as_passed(tmp_path):
    program = tmp_path / "bench"
    program.write_text("#!/bin/sh\necho gcc 99.1\n")
    program.chmod(0o755)
    run = subprocess.run([sys.executable, ROOT / "scripts/gates", "--build", tmp_path],
                         capture_output=True, text=True, timeout=60, check=True, env=os.environ)
    assert run.stdout.startswith(f"0 passed, 0 failed, {len(VALUES)} skipped: ")
    assert "gcc 99.1" in run.stdout or "x86_64" in run.stdout
