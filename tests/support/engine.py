# SPDX-License-Identifier: MIT
"""Fixtures of the tests with the engines of others; their modules import them."""

import os

import pytest

import campaigns
from campaigns import Gate
from simtool import CANWIRE


@pytest.fixture(name="place")
def fixture_place(tmp_path, monkeypatch):
    """The current folder, with a campaign; canwire of the build is in PATH."""
    campaigns.write_files(tmp_path)
    campaigns.clear_variables(monkeypatch)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{os.path.dirname(CANWIRE)}:{os.environ['PATH']}:/usr/sbin:/sbin")
    return tmp_path


@pytest.fixture(name="gate")
def fixture_gate(place, monkeypatch):
    """A canwire, the first one in PATH, that stops at shard 5 of 8."""
    gate = Gate(place, "5/8")
    monkeypatch.setenv("CANWIRE", str(gate.tool))
    monkeypatch.setenv("PATH", f"{gate.tool.parent}:{os.environ['PATH']}")
    yield gate
    gate.open()
