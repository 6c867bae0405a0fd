# SPDX-License-Identifier: MIT
"""The choice of tests: `make test` takes a sample of some kinds, by a fixed rule, and `make
test-deep` takes all.

A test with the mark `deep` is for the latter alone; tests/README.md says what only those find. Of a
test with parameters, --cases N runs the first case and each Nth behind it. With --every N one in N
tests runs, but all in modules with the mark `kept`.
"""

import collections
import os
import zlib

DEEP = os.environ.get("TESTS") == "deep"


def some(items, every):
    """Returns the first one and each of so many items behind it, or all of them."""
    return list(items) if DEEP else list(items)[::every]


def pytest_addoption(parser):
    for option, of_what in (("--cases", "case of a test"), ("--every", "test")):
        parser.addoption(option, type=int, default=1, metavar="N", help=f"run each Nth {of_what}")


def is_one_of(item, every):
    """Returns True for one of so many tests. The name decides, so that tests that come and go do
    not change the choice among the others."""
    return bool(item.get_closest_marker("kept")) or \
        zlib.crc32(item.nodeid.rpartition("/")[2].encode()) % every == 0


def pytest_collection_modifyitems(config, items):
    """Takes away the tests that are not to run. Each module keeps one at least."""
    if DEEP:
        return
    every, cases = config.getoption("every"), config.getoption("cases")
    numbers, modules, chosen = collections.Counter(), {}, set()
    for item in items:
        if item.get_closest_marker("deep"):
            continue
        name = item.nodeid.partition("[")[0]
        if numbers[name] % cases == 0 and is_one_of(item, every):
            chosen.add(item)
        numbers[name] += 1
        modules.setdefault(item.path, []).append(item)
    chosen |= {tests[0] for tests in modules.values() if not chosen & set(tests)}
    config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
    items[:] = [item for item in items if item in chosen]
