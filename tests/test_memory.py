# SPDX-License-Identifier: MIT
"""No memory: whatever allocation fails, a program ends with a word and status 1, or does it all.

Each program runs many times; in run n, allocation n fails (failing_heap.c). A canwired that runs
may end, too, but it never takes over half a configuration. Needs no CAN in the kernel.
CANWIRE is the tool, by default build/release/canwire; canwired is beside it. With sanitizers, which
also find what is leaked on the way out, only some of the allocations have their turn.
"""

import os
import re
import subprocess
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CANWIRE = (ROOT / os.environ.get("CANWIRE", "build/release/canwire")).resolve()
PATIENCE_S = 60
STRIDE = 17 if b"__asan_init" in CANWIRE.read_bytes() else 1
OUTPUTS = ("log", "pcapng", "stats", "junit", "vcd", "svg")
SANITIZERS = {"ASAN_OPTIONS": "detect_leaks=1:verify_asan_link_order=0"}  # failing_heap.c is first

TRACE = """(0.000000) can0 7FF#01
(0.001000) can0 100#01
(0.002000) can0 700#R
"""
BUS = """bus: { name: memory, bitrate: 500000 }
nodes:
  - { name: engine, restart-ms: 100 }
  - name: load
    traffic: [ { send: 123#DEADBEEF, every: 5ms, count: 3 },
               { replay: drive.log, only: "700:700" } ]
  - { name: dash, traffic: [ { reply: 700#11, to: "700" } ] }
profiles: [ { file: PROFILES/deaf-ecu.yaml, with: { victim: dash } } ]
faults:
  - name: crc
    when: { frame: "123", count: 1, time: 1ms.. }
    do: { flip: "crc[3]", at: [engine] }
expect:
  - { delivered: 3, frame: "123", from: load, to: engine }
  - { name: never, state: bus-off, node: engine, reached: never }
"""
LIVE = """bus: { name: memory, bitrate: 500000 }
control: memory.sock
nodes:
  - { name: engine, port: "unix:engine.sock" }
  - { name: load, traffic: [ { send: 123#DEADBEEF, every: 5ms }, { replay: drive.log } ] }
faults:
  - { name: crc, when: { frame: "123", count: 1 }, do: { flip: "crc[3]", at: [engine] } }
"""
STOPPED = LIVE + "record: [ { file: no/such/folder/bus.log } ]\n"


@pytest.fixture(name="folder")
def fixture_folder(tmp_path):
    (tmp_path / "drive.log").write_text(TRACE)
    (tmp_path / "bus.yaml").write_text(BUS.replace("PROFILES", str(ROOT / "config/profiles")))
    (tmp_path / "live.yaml").write_text(LIVE)
    (tmp_path / "stopped.yaml").write_text(STOPPED)
    return tmp_path


def start(folder, environment=None):
    """A canwired with a journal, when it runs."""
    log = folder / "stderr"
    with log.open("w") as errors:
        process = subprocess.Popen([CANWIRE.with_name("canwired"), "-c", "live.yaml", "--journal",
                                    "old.journal"], cwd=folder, stderr=errors, env=environment)
    deadline = time.monotonic() + PATIENCE_S
    while "nodes at" not in log.read_text():
        if process.poll() is not None or time.monotonic() > deadline:
            process.kill()
            raise AssertionError(log.read_text())
        time.sleep(0.02)
    return process


@pytest.fixture(name="running")
def fixture_running(folder):
    """A canwired with a journal and with memory enough; stops it when it is called."""

    def stop():
        process.terminate()
        assert process.wait(PATIENCE_S) == 0, (folder / "stderr").read_text()

    process = start(folder)
    try:
        yield stop
    finally:
        process.kill()
        process.wait()


@pytest.fixture(name="library", scope="module")
def fixture_library(tmp_path_factory):
    library = tmp_path_factory.mktemp("heap") / "failing_heap.so"
    subprocess.run(["cc", "-std=c17", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o",
                    library, ROOT / "tests/failing_heap.c"], check=True)
    return library


def heap(folder, library):
    return dict(os.environ, **SANITIZERS, LD_PRELOAD=str(library), FAIL=str(folder / "fail"))


class Run:
    """One run of a program in which allocation number n fails, if it gets as far as that."""

    def __init__(self, folder, library, words, n):
        fail = folder / "fail"
        for left in (folder / "engine.sock", *folder.glob("new.journal*"),
                     *(folder / name for name in OUTPUTS)):
            left.unlink(missing_ok=True)
        fail.write_text(str(n))
        result = subprocess.run(words, cwd=folder, env=heap(folder, library), capture_output=True,
                                timeout=PATIENCE_S, check=False)
        self.n, self.status = n, result.returncode
        self.stdout, self.stderr = result.stdout, result.stderr.decode()
        self.failed = not fail.exists()
        self.files = {name: (folder / name).read_bytes() for name in OUTPUTS
                      if (folder / name).exists()}

    def outcome(self):
        return self.status, self.stdout, self.stderr, self.files

    def check(self, good, told):
        """Nothing has changed, or it is told."""
        assert "Sanitizer" not in self.stderr and "runtime error" not in self.stderr, self.stderr
        if self.outcome() != good.outcome():
            assert self.status == 1, f"allocation {self.n}: status {self.status}, {self.stderr}"
            assert re.search(told, self.stderr), f"allocation {self.n}: {self.stderr}"


def fail_each(folder, library, words, told="(?i)out of memory|cannot allocate memory"):
    """Runs a program once more for each of its allocations. Returns how many it makes."""
    good = Run(folder, library, words, 0)
    n = 1
    while (run := Run(folder, library, words, n)).failed:
        run.check(good, told)
        n += STRIDE
    assert run.outcome() == good.outcome()
    return n, good


def test_check(folder, library):
    count, good = fail_each(folder, library, [CANWIRE, "check", "bus.yaml"])
    assert count > 500 and good.status == 0


def test_sim(folder, library):
    outputs = [word for name in OUTPUTS for word in (f"--{name}", name)]
    count, good = fail_each(folder, library, [CANWIRE, "sim", "bus.yaml", "--events", "-", *outputs,
                                              "--to", "3ms"])
    assert count > 1000 and good.status == 0 and len(good.files) == len(OUTPUTS)


@pytest.mark.parametrize("words, least", [
    (["faults", "./memory.sock", "--json"], 50),
    (["faults", "./memory.sock"], 50),
    (["set", "./memory.sock", "load", "restart-ms=100"], 20),
    (["clear", "./memory.sock"], 20),
])
@pytest.mark.usefixtures("running")
def test_clients(folder, library, words, least):
    count, good = fail_each(folder, library, [CANWIRE, *words])
    assert count > least and good.status == 0, good.stderr


def test_a_journal_that_is_run_again(folder, library, running):
    rule = "{ name: mine, when: { frame: 7FF }, do: { flip: 'crc[3]', at: [engine] } }"
    for words in (["inject", "./memory.sock", rule], ["reload", "./memory.sock"]):
        subprocess.run([CANWIRE, *words], cwd=folder, timeout=PATIENCE_S, check=True,
                       stdout=subprocess.DEVNULL)
    running()
    count, good = fail_each(folder, library, [CANWIRE, "sim", "--journal", "old.journal",
                                              "--events", "-"])
    assert count > 500 and good.status == 0, good.stderr


def test_canwired_at_its_start(folder, library):
    """Its last step at the start fails always, so that it ends. A journal may say what it lacks."""
    count, good = fail_each(
        folder, library,
        [CANWIRE.with_name("canwired"), "-c", "stopped.yaml", "--journal", "new.journal"],
        "(?i)out of memory|cannot allocate memory|"
        "journal new.journal: at least . lines? (is|are) missing")
    assert count > 300 and "record no/such/folder/bus.log: No such file" in good.stderr


def test_canwired_while_it_runs(folder, library):
    """What a client asks for is done, or refused and not done at all; or it ends and says why."""

    def rules():
        """What is in effect, or nothing when canwired has ended."""
        return subprocess.run([CANWIRE, "faults", "./memory.sock"], cwd=folder, timeout=PATIENCE_S,
                              check=False, capture_output=True, text=True).stdout

    def shows(text, names):
        return all(re.search(f"^{name} ", text, re.M) for name in names)

    def attempt(words, n):
        """The client's status and message, what is in effect then, and whether n was reached."""
        fail.write_text(str(n))
        result = subprocess.run([CANWIRE, *words], cwd=folder, timeout=PATIENCE_S, check=False,
                                capture_output=True, text=True)
        failed = not fail.exists()
        fail.unlink(missing_ok=True)
        return result.returncode, result.stderr, rules(), failed

    def fail_each_request(words, text, added):
        """Returns how often it was done, refused and the end, when allocation 1, 2, 3 … failed."""
        outcomes, n, failed, process = [0, 0, 0], 1, True, None
        try:
            while failed:
                if not process:
                    (folder / "live.yaml").write_text(LIVE)
                    process, before = start(folder, heap(folder, library)), rules()
                (folder / "live.yaml").write_text(text)
                status, error, after, failed = attempt(words, n)
                if not after:  # perhaps it was this client for whom there was no memory
                    after = rules()
                case = f"{words[0]}, allocation {n}: {error} {(folder / 'stderr').read_text()}"
                if after and status == 0:
                    assert shows(after, added), case
                elif after:
                    if "it ended the connection" in error:  # no memory for the client or its reply
                        assert after == before or shows(after, added), case
                    else:
                        assert re.search("(?i)out of memory|cannot allocate", error), case
                        assert after == before, case
                else:
                    assert process.wait(PATIENCE_S) == 1, case
                    assert "out of memory" in (folder / "stderr").read_text(), case
                outcomes[2 if not after else 0 if status == 0 else 1] += 1
                if after and after != before:
                    process.terminate()
                    assert process.wait(PATIENCE_S) == 0, case
                process = process if after == before else None
                n += STRIDE
        finally:
            if process:
                process.kill()
                process.wait()
        return outcomes

    fail = folder / "fail"
    rule = "{{ name: {}, when: {{ manual: yes }}, do: {{ bus-off: load }} }}"
    done, refused, _ = fail_each_request(["reload", "./memory.sock"],
                                         f"{LIVE}  - {rule.format('more')}\n", ["more"])
    assert done > 0 and refused > 0
    one, two = rule.format("one"), rule.format("two")
    done, refused, _ = fail_each_request(["inject", "./memory.sock", f"[ {one}, {two} ]"], LIVE,
                                         ["one", "two"])
    assert done > 0 and refused > 0
