# SPDX-License-Identifier: MIT
"""Campaigns on Dask: a cluster of this machine, whose workers are killed."""

import concurrent.futures as futures
import os
import shutil
import signal
import subprocess
import sys

import pytest

import campaigns
import canwire
from engine import fixture_gate, fixture_place  # pylint: disable=unused-import
from simtool import CANWIRE, ROOT, TIMEOUT_S

distributed = pytest.importorskip("distributed", reason="scripts/venv installs distributed")


@pytest.fixture(name="client")
def fixture_client(gate):  # the workers inherit the tool of the gate
    assert os.environ["CANWIRE"] == str(gate.tool)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None,
                                  silence_logs=50) as cluster, \
            distributed.Client(cluster) as client:
        yield client


def test_rows_of_a_killed_worker_are_made_again(place, gate, client):
    with futures.ThreadPoolExecutor(1) as thread:
        running = thread.submit(canwire.campaign, "campaign.yaml", executor=client, shards=8,
                                out="rows.ndjson")
        worker, _ = gate.wait()
        os.kill(worker, signal.SIGKILL)
        gate.open()
        result = running.result()
    assert (place / "rows.ndjson").read_bytes() == campaigns.rows("campaign.yaml", place)
    assert len(result) == sum(1 for _ in result) == 780
    again = canwire.campaign("campaign.yaml", executor=client.get_executor(), shards=3)
    assert again.path.read_bytes() == (place / "rows.ndjson").read_bytes()


def test_the_recipe_goes_on_after_its_end(place, gate):
    recipe = shutil.copy(ROOT / "config/campaign/on_dask.py", place)
    words = [sys.executable, recipe, "campaign.yaml", "rows.ndjson"]
    more = {"env": {**os.environ, "PYTHONPATH": str(ROOT / "lib/python/src")}, "cwd": place}
    # another number of shards than the recipe would have, so that the gate stops one
    with futures.ThreadPoolExecutor(3) as threads:
        running = threads.submit(canwire.campaign, "campaign.yaml", threads, shards=8,
                                 out="rows.ndjson", retries=0)
        _, tool = gate.wait()
        os.kill(tool, signal.SIGKILL)
        assert isinstance(running.exception(), canwire.CampaignError)
    assert (place / "rows.ndjson.parts").exists()
    gate.open()
    done = subprocess.run(words, check=True, capture_output=True, text=True, timeout=TIMEOUT_S,
                          **more)
    assert done.stdout.startswith("{'passed': ")
    assert (place / "rows.ndjson").read_bytes() == campaigns.rows("campaign.yaml", place)
    assert CANWIRE != os.environ["CANWIRE"]
