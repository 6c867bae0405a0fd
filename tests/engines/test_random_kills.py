# SPDX-License-Identifier: MIT
"""Kills at random moments change no byte of the rows: of the tool, and of the tools of an executor.

CANWIRE_KILLS repeats a run with the seed that a failed one has printed.
"""

import concurrent.futures as futures
import contextlib
import os
import pathlib
import random
import signal
import subprocess
import threading

import pytest

import campaigns
import canwire
from engine import fixture_place  # pylint: disable=unused-import
from simtool import CANWIRE, TIMEOUT_S

KILLS = 12
SEEDS = 6


@pytest.fixture(name="dice")
def fixture_dice(place):
    """Random numbers; the campaign becomes longer."""
    with open(place / "campaign.yaml", "a", encoding="utf-8") as file:
        file.write(f"  - {{ set: seed, range: {{ from: 1, to: {SEEDS}, step: 1 }} }}\n")
    seed = int(os.environ.get("CANWIRE_KILLS", random.randrange(1 << 32)))
    print(f"CANWIRE_KILLS={seed}")
    return random.Random(seed)


def children(process="self"):
    """Returns the process ids of the children of a process."""
    found = []
    for file in pathlib.Path(f"/proc/{process}/task").glob("*/children"):
        with contextlib.suppress(OSError):  # the thread has ended
            found += map(int, file.read_text().split())
    return found


def is_of_task(pid):
    """Returns True for a tool of a task, and not of the caller."""
    with contextlib.suppress(OSError):
        words = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        return b"--jobs" in words and b"--out" not in words or b"--version" in words
    return False


def kill(pid):
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def size(path):
    return path.stat().st_size if path.exists() else 0


def test_the_tool_and_its_processes(place, dice):
    wanted = campaigns.rows("campaign.yaml", place)
    out, part = place / "rows.ndjson", place / "rows.ndjson.part"
    words = [CANWIRE, "campaign", "run", "campaign.yaml", "--shard", "1/1", "--reload", "--jobs",
             "2", "--out", out, "--resume"]
    for number in range(KILLS):
        # its end, a third of all kills, or that of a process that makes rows
        whole, border = number % 3 == 0, size(part) + dice.randrange(len(wanted) // KILLS)
        with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as running:
            campaigns.wait_for(lambda: running.poll() is not None or size(part) > border)
            for pid in [running.pid] if whole else children(running.pid)[:1]:
                kill(pid)
            _, said = running.communicate(timeout=TIMEOUT_S)
        assert running.returncode in ((-signal.SIGKILL, 3) if whole else (3,)), said
        if out.exists():
            assert out.read_bytes() == wanted
            if not whole:
                out.rename(part)
                os.truncate(part, dice.randrange(len(wanted)))
    subprocess.run(words, check=False, timeout=TIMEOUT_S)
    assert out.read_bytes() == wanted


def test_the_tools_of_an_executor(place, dice, monkeypatch):
    monkeypatch.setenv("CANWIRE", CANWIRE)
    done = threading.Event()

    def kill_some():
        killed = 0
        campaigns.wait_for(lambda: size(place / "rows.ndjson.parts/campaign.json") > 0)
        while killed < KILLS and not done.wait(dice.random() / 10):
            tools = list(filter(is_of_task, children()))
            if tools:
                kill(dice.choice(tools))
                killed += 1
        return killed

    with futures.ThreadPoolExecutor(4) as executor:
        killer = executor.submit(kill_some)
        try:
            result = canwire.campaign("campaign.yaml", executor, shards=100, out="rows.ndjson",
                                      retries=KILLS)
        finally:
            done.set()
        assert killer.result()
    assert len(result) == 780 * SEEDS
    assert (place / "rows.ndjson").read_bytes() == campaigns.rows("campaign.yaml", place)
