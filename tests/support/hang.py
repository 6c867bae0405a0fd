# SPDX-License-Identifier: MIT
"""Shows the processes of a test that hung. pytest-timeout ends it; this adds them to its report.

The limit, --timeout of scripts/test, is for a test that would never end, far above what a slow
machine needs.
"""

import os
import subprocess
import threading

import pytest

COLUMNS = "pid,ppid,stat,wchan:24,etimes,args"


def processes():
    """Returns lines of ps: those of the tests, and those of canwire whose parents have gone."""
    lines = subprocess.run(["ps", "-e", "--forest", "-ww", "-o", COLUMNS], capture_output=True,
                           text=True, check=False).stdout.splitlines()
    family, chosen = {os.getpid()}, lines[:1]
    for line in lines[1:]:  # a forest has parents first
        pid, parent = map(int, line.split(maxsplit=2)[:2])
        if pid in family or parent in family or (parent == 1 and "canwire" in line):
            family.add(pid)
            chosen.append(line)
    return "\n".join(chosen)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Looks at the processes shortly before a test is ended, as its end kills some."""
    limit_s = item.config.getoption("timeout", None) or 0
    if not limit_s:
        return (yield)
    timer = threading.Timer(limit_s * 0.9, lambda: setattr(item, "seen", processes()))
    timer.daemon = True
    timer.start()
    try:
        return (yield)
    finally:
        timer.cancel()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """Adds what was seen to the report of a test that failed."""
    report = yield
    if report.failed and hasattr(item, "seen"):
        report.sections.append((f"processes while {item.nodeid} hung", item.seen))
    return report
