# SPDX-License-Identifier: MIT
# pylint: disable=redefined-outer-name
"""canwire.campaign: the rows are those of `canwire campaign run`, whatever runs the shards, and
whatever is killed in the middle.
"""

import concurrent.futures as futures
import ctypes
import fcntl
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys

import pytest

import campaigns
import canwire
from campaigns import Gate
from simtool import CANWIRE, ROOT

KILLED = """
import concurrent.futures as futures, canwire
canwire.campaign("campaign.yaml", futures.ThreadPoolExecutor(2), shards=8, out="rows.ndjson")
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    """The files of a campaign in the current folder, and the tool of the build."""
    folder = tmp_path / "work"
    folder.mkdir()
    campaigns.write_files(folder)
    campaigns.clear_variables(monkeypatch)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("CANWIRE", CANWIRE)
    return folder


@pytest.fixture(name="wanted")
def fixture_wanted(place):
    return campaigns.rows("campaign.yaml", place)


@pytest.fixture(name="gate")
def fixture_gate(tmp_path, monkeypatch):
    """A tool that stops at shard 5 of 8."""
    made = Gate(tmp_path, "5/8")
    monkeypatch.setenv("CANWIRE", str(made.tool))
    yield made
    made.open()


def processes(count=2, **more):
    return futures.ProcessPoolExecutor(count, multiprocessing.get_context("fork"), **more)


# ---- rows ----------------------------------------------------------------------------------------

@pytest.mark.parametrize("make", [lambda: None, lambda: futures.ThreadPoolExecutor(3), processes],
                         ids=["tool", "threads", "processes"])
def test_rows_are_those_of_the_tool(place, wanted, make):
    executor = make()
    result = canwire.campaign("campaign.yaml", executor, shards=7, out="rows.ndjson")
    assert (place / "rows.ndjson").read_bytes() == wanted
    assert result.path == place / "rows.ndjson" and not (place / "rows.ndjson.parts").exists()
    outcomes = [row["outcome"] for row in result]
    assert len(result) == len(outcomes) == wanted.count(b"\n") and not result.passed
    assert result.counts == {name: outcomes.count(name) for name in ("passed", "failed")}
    assert f"{len(outcomes)} rows: " in result.message
    if executor:
        executor.shutdown()


def test_more_shards_than_rows_and_no_file(place, wanted):
    with futures.ThreadPoolExecutor(2) as executor:
        result = canwire.campaign(place / "campaign.yaml", executor, shards=900)
        short = canwire.campaign("campaign.yaml", executor)
    assert [row["number"] for row in result] == list(range(len(result)))
    assert short.path.read_bytes() == wanted
    path = short.path
    del short
    assert not path.exists()  # it goes with the result


def test_rows_that_make_no_scenario_are_rows(place):
    text = (place / "campaign.yaml").read_text().replace("from: 1, to: 5", "from: 0, to: 1")
    (place / "campaign.yaml").write_text(text)
    with futures.ThreadPoolExecutor(2) as executor:
        result = canwire.campaign("campaign.yaml", executor, shards=3)
    assert result.counts["invalid"] == len(result) / 2 and "could not be run:" in result.message


ECUS = """scenario:
  bus: { name: powertrain, bitrate: 500000 }
  nodes: [ { name: engine }, { name: dash } ]
until: 30ms
virtual: on
ecu:
  - { node: engine, run: "cangen engine -g 10 -I 123 -L 2 -D i", ready: { frame: "123" } }
  - { node: dash, run: "candump -n 1 dash; [ $CANWIRE_SEED != 2 ] || exit 4" }
vary: [ { set: seed, range: { from: 1, to: 4, step: 1 } } ]
"""


def test_programs_at_nodes(place):
    (place / "ecus.yaml").write_text(ECUS)
    done = subprocess.run([CANWIRE, "campaign", "run", "ecus.yaml", "--shard", "1/1"], check=False,
                          capture_output=True)
    with futures.ThreadPoolExecutor(3) as executor:
        result = canwire.campaign("ecus.yaml", executor, shards=3, out="rows.ndjson")
    assert (place / "rows.ndjson").read_bytes() == done.stdout
    rows = list(result)
    assert [row["outcome"] for row in rows] == ["passed", "crashed", "passed", "passed"]
    assert rows[1]["why"] == "dash: exit status 4"
    assert "123" in (place / rows[1]["ecus"]["dash"]["log"]).read_text()
    assert [path.name for path in (place / "ecus.yaml.d").iterdir()] == ["row-1"]


def test_the_example_of_the_page(place, wanted):
    text = (ROOT / "daemon/man/canwire-campaign.7.md").read_text(encoding="utf-8")
    example, = (block for block in re.findall(r"```python\n(.*?)```", text, re.S)
                if "canwire.campaign(" in block)
    (place / "example.py").write_text(example)
    done = subprocess.run([sys.executable, "example.py"], check=True, capture_output=True,
                          text=True, env={**os.environ, "PYTHONPATH": f"{ROOT}/lib/python/src"})
    assert (place / "rows.ndjson").read_bytes() == wanted
    assert done.stdout.startswith("{'passed': 30, 'failed': 750} ['canwire campaign run campaign")


# ---- what is killed ------------------------------------------------------------------------------

def test_a_tool_that_is_killed_is_started_again(place, wanted, gate):
    with futures.ThreadPoolExecutor(9) as executor:
        running = executor.submit(canwire.campaign, "campaign.yaml", executor, shards=8, out="rows")
        _, tool = gate.wait()
        gate.open()
        os.kill(tool, signal.SIGKILL)
        running.result()
    assert (place / "rows").read_bytes() == wanted


def test_a_task_is_not_tried_for_ever(place, monkeypatch):
    tool = place / "canwire"
    tool.write_text(f'#!/bin/bash\n[ "$2" != run ] || {{ echo >>{place}/runs; kill -9 $$; }}\n'
                    f'exec {CANWIRE} "$@"\n')
    tool.chmod(0o755)
    monkeypatch.setenv("CANWIRE", str(tool))
    with futures.ThreadPoolExecutor(1) as executor:
        with pytest.raises(canwire.CampaignError, match="shard 1/1: the tool ended with -9"):
            canwire.campaign("campaign.yaml", executor, shards=1, retries=2)
    assert (place / "runs").read_text() == "\n" * 3


def test_a_killed_process_of_a_pool_breaks_it_and_the_next_call_goes_on(place, wanted, gate):
    with processes(1) as executor:
        with futures.ThreadPoolExecutor(1) as thread:
            running = thread.submit(canwire.campaign, "campaign.yaml", executor, shards=8,
                                    out="rows.ndjson")
            worker, _ = gate.wait()
            os.kill(worker, signal.SIGKILL)
            with pytest.raises(canwire.CampaignError, match="rows.ndjson.parts: call again"):
                running.result()
    parts = place / "rows.ndjson.parts"
    assert {path.name for path in parts.glob("*.ndjson")} == {f"{n}.ndjson" for n in range(1, 5)}
    before = (parts / "2.ndjson").stat()
    gate.open()
    with processes(2) as executor:
        # the number of shards is that of the first call
        canwire.campaign("campaign.yaml", executor, out="rows.ndjson")
    assert (place / "rows.ndjson").read_bytes() == wanted and before.st_size and not parts.exists()


def test_a_killed_campaign_goes_on(place, wanted, gate):
    path = f"{ROOT}/lib/python/src"
    process = subprocess.Popen(  # pylint: disable=consider-using-with
        [sys.executable, "-c", KILLED], env={**os.environ, "PYTHONPATH": path})
    gate.wait()
    parts = place / "rows.ndjson.parts"
    campaigns.wait_for(lambda: len(list(parts.glob("[1-8].ndjson"))) == 7)
    process.kill()
    process.wait()
    gate.open()
    calls = []
    with futures.ThreadPoolExecutor(2) as executor:
        submit = executor.submit
        executor.submit = lambda *task: calls.append(task) or submit(*task)
        canwire.campaign("campaign.yaml", executor, out="rows.ndjson")
    assert (place / "rows.ndjson").read_bytes() == wanted and len(calls) == 1


# ---- what goes on, and what does not -------------------------------------------------------------

def test_a_file_that_is_whole_is_only_checked(place, wanted):
    (place / "rows.ndjson").write_bytes(wanted)
    result = canwire.campaign("campaign.yaml", futures.Executor(), out="rows.ndjson")
    assert len(result) == wanted.count(b"\n")
    (place / "rows.ndjson").write_bytes(wanted.replace(b"250000", b"125000"))
    with pytest.raises(canwire.CampaignError, match="it has other rows than this campaign"):
        canwire.campaign("campaign.yaml", futures.Executor(), out="rows.ndjson")
    with futures.ThreadPoolExecutor(2) as executor:
        canwire.campaign("campaign.yaml", executor, shards=3, out="rows.ndjson", resume=False)
    assert (place / "rows.ndjson").read_bytes() == wanted


def stop_in_the_middle(gate):
    """Leaves the parts of 8 shards but one."""
    with processes(1) as executor, futures.ThreadPoolExecutor(1) as thread:
        running = thread.submit(canwire.campaign, "campaign.yaml", executor, shards=8, out="rows")
        os.kill(next(gate.wait()), signal.SIGKILL)
        assert isinstance(running.exception(), canwire.CampaignError)
    gate.open()


@pytest.mark.parametrize("change, message", [
    ("campaign.yaml", "it is of another campaign"),
    ("drive.log", "it is of another campaign"),
    (None, "it is 8 shards, not 9"),
])
def test_parts_of_another_campaign_are_refused(place, gate, change, message):
    stop_in_the_middle(gate)
    if change:
        (place / change).write_text((place / change).read_text().replace("321", "320") + "\n")
    with futures.ThreadPoolExecutor(2) as executor:
        with pytest.raises(canwire.CampaignError, match=message):
            canwire.campaign("campaign.yaml", executor, out="rows", shards=None if change else 9)
        canwire.campaign("campaign.yaml", executor, out="rows", shards=9, resume=False)
    assert (place / "rows").read_bytes() == campaigns.rows("campaign.yaml", place)


def test_parts_are_of_one_caller_at_a_time(place):
    (place / "rows.parts").mkdir()
    with open(place / "rows.parts/campaign.json", "a", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(canwire.CampaignError, match="another program is writing it"):
            canwire.campaign("campaign.yaml", futures.ThreadPoolExecutor(1), out="rows")


def test_what_is_wrong_is_told(place, monkeypatch):
    with pytest.raises(canwire.ConfigError, match="nowhere.yaml"):
        canwire.campaign("nowhere.yaml", futures.Executor(), out="rows")
    with pytest.raises(TypeError, match="is no concurrent.futures.Executor"):
        canwire.campaign("campaign.yaml", 7)
    with pytest.raises(ValueError, match="shards is 0"):
        canwire.campaign("campaign.yaml", futures.Executor(), shards=0)
    assert not (place / "rows.parts").exists()
    monkeypatch.setattr("canwire.campaigns.find_tool", lambda: None)
    with pytest.raises(canwire.CampaignError, match="there is no tool canwire"):
        canwire.campaign("campaign.yaml")


def test_a_worker_with_another_version_is_refused(place, tmp_path, monkeypatch):
    """The tool has a newer version from the second question on."""
    tool = place / "canwire"
    tool.write_text(f'#!/bin/bash\n[ "$1" = --version ] || exec {CANWIRE} "$@"\n'
                    f'[ -e {tmp_path}/asked ] || {{ touch {tmp_path}/asked; '
                    f'exec {CANWIRE} "$@"; }}\n'
                    'echo canwire 99.0.0\n')
    tool.chmod(0o755)
    monkeypatch.setenv("CANWIRE", str(tool))
    with futures.ThreadPoolExecutor(1) as executor:
        with pytest.raises(canwire.CampaignError, match="canwire is canwire 99.0.0, not canwire 0"):
            canwire.campaign("campaign.yaml", executor)


# ---- workers without the files -------------------------------------------------------------------

CLONE_NEWNS, MS_REC, MS_PRIVATE = 0x20000, 0x4000, 0x40000


def hide(folder):
    """Mounts an empty folder over one, for this process alone."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNS) or libc.mount(None, b"/", None, MS_REC | MS_PRIVATE, None) or \
            libc.mount(b"none", os.fsencode(folder), b"tmpfs", 0, None):
        raise OSError(ctypes.get_errno(), "mount")


def may_mount(folder):
    with processes(1, initializer=hide, initargs=(folder,)) as executor:
        return not isinstance(executor.submit(os.getpid).exception(), futures.BrokenExecutor)


@pytest.mark.parametrize("inside", [".", "deep/down"])
def test_files_go_to_workers_that_do_not_have_them(place, monkeypatch, inside):
    if not may_mount(place):
        pytest.skip("this process may not mount")
    folder = place / inside
    folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(folder)
    file = os.path.relpath(place / "campaign.yaml")
    with processes(2, initializer=hide, initargs=(place,)) as executor:
        canwire.campaign(file, executor, shards=5, out="rows.ndjson")
        assert (folder / "rows.ndjson").read_bytes() == campaigns.rows(file, folder)
        with pytest.raises(canwire.CampaignError, match="give the campaign by a relative path"):
            canwire.campaign(place / "campaign.yaml", executor, shards=5)


def test_files_that_values_name_are_given(place):
    if not may_mount(place):
        pytest.skip("this process may not mount")
    shutil.copy(place / "drive.log", place / "other.log")
    with open(place / "campaign.yaml", "a", encoding="utf-8") as file:
        file.write("  - { set: \"nodes.gearbox.traffic[0].replay\", values: [ ../other.log ] }\n")
    with processes(2, initializer=hide, initargs=(place,)) as executor:
        result = canwire.campaign("campaign.yaml", executor, shards=5, files=["other.log"])
    assert result.path.read_bytes() == campaigns.rows("campaign.yaml", place)
