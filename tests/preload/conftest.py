# SPDX-License-Identifier: MIT
"""A bus whose nodes have sockets, and programs that `canwire run` runs at them.

Nothing here needs CAN in the kernel.
"""

import json
import os
import subprocess

import pytest

from busclient import Client
from simtool import CANWIRE, CANWIRED, ROOT, TIMEOUT_S, canwire, kill_all, listens, stop_canwired
from test_record import wait_until

# these are programs for another architecture, which `make test-arm64` builds
collect_ignore = [] if "ARM64_RUN" in os.environ else ["test_arm64.py"]

BUS = """bus: {{ name: share, bitrate: {bitrate}{bus} }}
control: share.sock
guests: {{ count: 8, port: "unix:guests.sock", queue: 64 }}
nodes:
  - {{ name: engine, port: "unix:engine.sock"{engine} }}
  - {{ name: dash, port: "unix:dash.sock" }}
  - {{ name: idle }}
  - {{ name: real, port: vcan77 }}
"""
# canwired refuses an interface that is not there, so only configurations name it
WITHOUT_REAL = BUS.replace("  - {{ name: real, port: vcan77 }}\n", "")


class Bus:
    def __init__(self, folder, **more):
        self.folder, self.log, self.programs = folder, folder / "stderr", []
        self.text = WITHOUT_REAL.format(**{"bitrate": 500000, "bus": "", "engine": "", **more})
        (folder / "bus.yaml").write_text(self.text)
        self.start()

    def start(self):
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=self.folder,
                                            stderr=log)
        wait_until(lambda: listens(self.folder / "share.sock") or
                   self.process.poll() is not None, "the bus")

    def words(self, node, *program, interface=()):
        words = [CANWIRE, "run", "--bus", "./share.sock"]
        for one in node.split():
            words += ["--as", *one.split("=")[:1]]
            words += ["--interface", one.split("=")[1]] if "=" in one else []
        return [*words, "--", *map(str, program)]

    def run(self, node, *program, status=0):
        """Runs a program to its end. node: NODE or NODE=INTERFACE, several with blanks."""
        done = subprocess.run(self.words(node, *program), cwd=self.folder, capture_output=True,
                              text=True, timeout=TIMEOUT_S, check=False)
        assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
        return done

    def begin(self, node, *program, **more):
        """Starts a program, which is ended with the test."""
        self.programs.append(subprocess.Popen(
            self.words(node, *program), cwd=self.folder, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, **{"stdin": subprocess.DEVNULL, **more}))
        return self.programs[-1]

    def client(self, node="dash", *words, **more):
        return Client(self.folder / f"{node}.sock", *words, **more)

    def nodes(self):
        status = json.loads(canwire("status", "./share.sock", "--json", cwd=self.folder).stdout)
        return {node["name"]: node for node in status["nodes"]}

    def wait_for_clients(self, node, count):
        wait_until(lambda: len(self.nodes()[node]["clients"]) == count, "the programs")

    def stop(self):
        return stop_canwired(self.process, self.log)


@pytest.fixture
def bus(tmp_path):
    """bus(KEY=TEXT…) starts a canwired."""
    buses = []

    def make(**more):
        buses.append(Bus(tmp_path, **more))
        return buses[-1]

    yield make
    for one in buses:
        kill_all([one.process, *one.programs])


def build_program(folder, name):
    """Compiles tests/preload/NAME.c; returns the path of the program."""
    subprocess.run([os.environ.get("CC", "cc"), "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra",
                    "-Werror", "-pthread", "-o", folder / name,
                    ROOT / f"tests/preload/{name}.c"], check=True)
    return folder / name


@pytest.fixture(scope="session")
def calls(tmp_path_factory):
    """The path of the program calls.c."""
    return build_program(tmp_path_factory.mktemp("calls"), "calls")


@pytest.fixture(scope="session")
def threads(tmp_path_factory):
    """The path of the program threads.c."""
    return build_program(tmp_path_factory.mktemp("threads"), "threads")
