# SPDX-License-Identifier: MIT
"""A short soak of canwired with sanitizers on real vcan; and that a soak notices what is wrong."""

import collections
import copy
import io
import itertools
import os
from pathlib import Path

import pytest

import soak
from depth import DEEP
from schedule import WEIGHTS, Schedule

ROOT = Path(__file__).resolve().parents[2]
SANITIZED = os.environ.get("CANWIRED_SAN") or ROOT / "build/san-gcc/canwired"
SEED = 1
ACTIONS = 80 if DEEP else 40  # ten seconds and more

NODE = {
    "conserved": True, "handed_in": 5, "made_by_rules": 1, "tx_frames": 3, "queue": 1, "held": 1,
    "dropped": {"queue-full": 1}, "rx_accepted": 4, "rx_made_by_rules": 0, "rx_frames": 2,
    "rx_held": 1, "rx_dropped": {"fault": 1},
}
KEYS = [key for key in NODE if isinstance(NODE[key], int) and key != "conserved"]
STATUS = {"nodes": [NODE],
          "bus": {"time_ns": 10, "bits": 5, "frames": 3, "error_frames": 2, "skips": 1}}


def test_a_short_soak_finds_nothing():
    out = io.StringIO()
    good = soak.run(SANITIZED, SEED, actions=ACTIONS, out=out)
    print(out.getvalue())
    assert good


def test_the_seed_is_the_schedule():
    def first(seed):
        return [str(action) for action in itertools.islice(Schedule(seed), 300)]

    assert first(7) == first(7)
    assert first(7) != first(8)
    kinds = {action.name for action in itertools.islice(Schedule(7), len(WEIGHTS))}
    assert kinds == set(WEIGHTS)


def test_books_that_balance_are_no_trouble():
    soak.check_status(STATUS, STATUS)


@pytest.mark.parametrize("key", KEYS)
def test_a_frame_too_many_is_noticed(key):
    status = copy.deepcopy(STATUS)
    status["nodes"][0][key] += 1
    with pytest.raises(soak.Trouble, match="unaccounted"):
        soak.check_status(status, None)


def test_books_of_the_daemon_that_do_not_balance_are_noticed():
    with pytest.raises(soak.Trouble, match="unaccounted"):
        soak.check_node(NODE | {"conserved": False})


def test_a_counter_that_goes_back_is_noticed():
    later = copy.deepcopy(STATUS)
    later["bus"]["frames"] -= 1
    with pytest.raises(soak.Trouble, match="frames went from 3 to 2"):
        soak.check_status(later, STATUS)


@pytest.mark.parametrize("text", [
    "x.c:1:2: runtime error: overflow", "==1==ERROR: AddressSanitizer",
    "engine: frames are unaccounted for: came 1"])
def test_a_report_is_noticed(text):
    soak.check_text("soak: 7 nodes")
    with pytest.raises(soak.Trouble, match="canwired reports"):
        soak.check_text(text)


AT_REST = soak.Measure(1000, 30000, collections.Counter(socket=1))


def test_what_stays_within_the_slack_is_flat():
    soak.check_flat(AT_REST, AT_REST._replace(heap_kib=1000 + soak.HEAP_SLACK_KIB,
                                              memory_kib=30000 + soak.MEMORY_SLACK_KIB))


@pytest.mark.parametrize("more", [
    {"heap_kib": 1001 + soak.HEAP_SLACK_KIB}, {"memory_kib": 30001 + soak.MEMORY_SLACK_KIB},
    {"files": collections.Counter(socket=2)}, {"files": collections.Counter(pipe=1)}])
def test_what_grows_is_noticed(more):
    with pytest.raises(soak.Trouble, match="memory has grown|open files"):
        soak.check_flat(AT_REST, AT_REST._replace(**more))


def test_a_daemon_that_dies_is_noticed():
    out = io.StringIO()
    assert not soak.run("/bin/false", SEED, actions=ACTIONS, out=out)
    assert "canwired has ended with status" in out.getvalue()
