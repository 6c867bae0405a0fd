# SPDX-License-Identifier: MIT
"""Time-triggered nodes of canwired: status, settings, a reload, a journal that has the same run.

Nodes have schedules here, so this needs no CAN in the kernel.
"""

import json
import subprocess

import pytest

from simtool import CANWIRE, ROOT, kill_all
from test_record import wait_until
from test_retime import Watched

MATRIX = (ROOT / "config/time-triggered/matrix.yaml").read_text().replace(
    "nodes:", "control: day.sock\nnodes:", 1).replace(
        "name: matrix", "name: day").partition("expect:")[0]


@pytest.fixture(name="watched")
def fixture_watched(tmp_path):
    started = []

    def start(text=MATRIX):
        started.append(Watched(tmp_path, text))
        return started[-1]

    yield start
    kill_all(process for each in started for process in (each.bus.process, each.watch))


def references(run, node=1):
    return run.bus.status()["nodes"][node]["schedule"]["references"]


def test_status_has_local_times_and_slots(watched):
    run = watched()
    wait_until(lambda: references(run) > 3, "cycles")
    text = run.bus.canwire("status", "./day.sock")
    assert "<TIME-TRIGGERED>" in text and "local-time" in text and "global" in text
    assert "at 2000 200#F0 exclusive: slots" in text and "schedule cycle" in text
    front = run.bus.status()["nodes"][1]
    assert front["local_time"]["master"] == "master" and front["schedule"]["cycles"] == 2
    assert front["schedule"]["triggers"][0]["sent"] > 0
    assert front["schedule"]["triggers"][1]["arbitration_lost"] > 0  # it always loses
    run.end()


def test_settings_and_captures_are_in_the_journal(watched):
    run = watched(MATRIX + "  - { name: logger }\n")
    run.set("rear", "ppm=90")
    assert "it has a schedule" in run.refused("front", "time-triggered=off")
    for word, on in (("on", True), ("off", False)):  # a node without schedule
        run.set("logger", f"time-triggered={word}")
        run.wait_events(40)
        assert run.bus.status()["nodes"][3]["settings"]["time-triggered"] is on
    named = subprocess.Popen([CANWIRE, "watch", "./day.sock", "capture", "--json"],
                             cwd=run.bus.folder, stdout=subprocess.PIPE, text=True)
    try:
        captures = [json.loads(named.stdout.readline()) for _ in range(9)]
    finally:
        named.kill()
        named.wait()
    assert {e["event"] for e in captures} == {"capture"} and captures[0]["local-time"] >= 0
    run.wait_events(40)
    assert run.count("capture") == 0
    run.end()


def test_a_reload_keeps_counters_and_cycles(watched):
    run = watched()
    wait_until(lambda: references(run) > 3, "cycles")
    before = run.bus.status()["nodes"]
    run.reload(("ppm: 100 ", "ppm: 50 "))
    run.wait_events(40)
    after = run.bus.status()["nodes"]
    for old, new in zip(before, after):
        assert new["schedule"]["references"] > old["schedule"]["references"]
        assert new["local_time"]["captures"] > old["local_time"]["captures"]
        assert new["schedule"]["triggers"][0]["slots"] > old["schedule"]["triggers"][0]["slots"]
    assert all(t["missed"] == 0 for n in after for t in n["schedule"]["triggers"])
    run.reload(("{ at: 2000, slot: 50us, cycle: 0, send: 200#F0 }",
                "{ at: 2500, slot: 50us, cycle: 0, send: 202#F0 }"))
    wait_until(lambda: run.live.read_text().count("202#F0") > 3, "frames of the new slot")
    assert references(run) > after[1]["schedule"]["references"]
    run.end()
