# SPDX-License-Identifier: MIT
"""A campaign for tests on several machines: its files and its rows. Its tool can stop at a shard
until the test lets it go on.
"""

import os
import shlex
import shutil
import subprocess
import time

import pytest

from simtool import CANWIRE, TIMEOUT_S

PATIENCE_S = 120
FILES = {
    "campaign.yaml": """scenario: buses/bus.yaml
vary:
  - { name: bit, each-bit: { frame: "123#DEADBEEF", from: engine, at: gearbox } }
  - { set: bus.bitrate, values: [ 250000, 500000 ] }
  - { set: nodes.engine.queue, range: { from: 1, to: 5, step: 1 } }
""",
    "buses/bus.yaml": """bus: { name: powertrain, bitrate: 500000 }
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 10ms, count: 3 } ] }
  - { name: gearbox, traffic: [ { replay: ../drive.log } ] }
  - name: dash
profiles: [ { file: late.yaml } ]
expect:
  - { name: calm, errors: { max: 5 } }
""",
    "buses/late.yaml": """faults:
  - { name: late, when: { frame: "321", count: 1 }, do: { flip: "crc[0]" } }
""",
    "drive.log": "(0.001) engine 321#11\n(0.002) engine 322#2211\n",
}
VARIABLES = ("CI_NODE_", "SLURM_", "JOB_COMPLETION")  # those of the machine that runs the tests
GATE = """#!/bin/bash
# notes its shards in the file runs; stops at the shard STOP until the file go is there; the file
# held has the process id of the caller and its own
shard=$(sed -n 's/.* --shard \\([^ ]*\\) .*/\\1/p' <<<" $* ")
[ -z "$JOB_COMPLETION_INDEX" ] || shard=$((JOB_COMPLETION_INDEX + 1))/8 # of Kubernetes
[ -z "$shard" ] || echo "$shard" >>FOLDER/runs
if [ "$shard" = STOP ]; then
    [ -e FOLDER/go ] || { echo "$PPID $$" >FOLDER/half; mv FOLDER/half FOLDER/held; }
    until [ -e FOLDER/go ]; do sleep 0.05; done
fi
exec TOOL "$@"
"""


def write_files(folder):
    """Writes the files of a campaign into a folder; the path of the first one."""
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "campaign.yaml"


def rows(file, folder):
    """Returns the rows of one run without trouble, as bytes."""
    done = subprocess.run([CANWIRE, "campaign", "run", file, "--shard", "1/1"], cwd=folder,
                          capture_output=True, timeout=TIMEOUT_S, check=False)
    assert done.returncode in (0, 3), done.stderr  # no row, or some, has failed
    return done.stdout


def clear_variables(monkeypatch):
    for name in list(os.environ):
        if name.startswith(VARIABLES):
            monkeypatch.delenv(name)


class Gate:
    """A tool, in the folder `bin`, that stops at a shard until open() is called."""

    def __init__(self, folder, shard):
        self.folder = folder
        self.tool = folder / "bin/canwire"
        self.tool.parent.mkdir()
        text = GATE.replace("STOP", shard).replace("FOLDER", shlex.quote(str(folder)))
        self.tool.write_text(text.replace("TOOL", shlex.quote(CANWIRE)))
        self.tool.chmod(0o755)

    def wait(self):
        """Waits for the shard; the process ids of the caller of the tool and of the tool."""
        held = self.folder / "held"
        wait_for(held.exists)
        text = held.read_text()
        held.unlink()
        return map(int, text.split())

    def runs(self):
        """Returns the shards that were begun since the last call."""
        file = self.folder / "runs"
        shards = file.read_text().split() if file.exists() else []
        file.unlink(missing_ok=True)
        return shards

    def open(self):
        (self.folder / "go").touch()


def wait_for(condition):
    """Waits until condition() is true."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it has not come"
        time.sleep(0.05)


def need(*programs):
    """Skips a test where a program is not installed."""
    path = f"{os.environ['PATH']}:/usr/sbin:/sbin"
    missing = [name for name in programs if not shutil.which(name, path=path)]
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed (scripts/install-deps test)")
