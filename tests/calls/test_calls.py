# SPDX-License-Identifier: MIT
"""No failing call of the C library breaks anything or loses anything in silence.

Each program is run once to list its sites of calls (failing.py). Then it is run for each site,
whose call fails once, and again with all of its kind failing from then on. After each:

* no crash, and with sanitizers neither an error nor a leak;
* everything is as without the failure, or a message that there was not before says what is not;
  a program that ends by that has an exit status that is not 0.

CANWIRE is the tool, by default build/release/canwire; canwired is beside it. With sanitizers only
some of the runs are made. CALLS=all makes all of them, with every errno that a call may have, and
at later calls of a site (make calls).
"""

import concurrent.futures
import contextlib
import json
import shutil
import socket
import subprocess
import threading

import pytest

from failing import WORKERS, Calls, Try, build_library, plan, run_all
from simtool import CANWIRE, CANWIRED, ROOT, TIMEOUT_S, canwire, kill_all, listens
from test_journal import lines as journal_lines
from test_record import wait_until

TRACE = "(0.000000) can0 7FF#01\n(0.000500) can0 100#01\n(0.001000) can0 700#R\n"
BUS = """bus: { name: calls, bitrate: 500000 }
nodes:
  - { name: engine, restart-ms: 100 }
  - name: load
    traffic: [ { send: 123#DEADBEEF, every: 1ms, count: 2 },
               { replay: drive.log, only: "700:700" } ]
  - { name: dash, traffic: [ { reply: 700#11, to: "700" } ] }
profiles: [ { file: PROFILES/deaf-ecu.yaml, with: { victim: dash } } ]
faults:
  - name: crc
    when: { frame: "123", count: 1, time: 1ms.. }
    do: { flip: "crc[3]", at: [engine] }
expect:
  - { delivered: 2, frame: "123", from: load, to: engine }
  - { name: never, state: bus-off, node: engine, reached: never }
"""
OUTPUTS = ("log", "events", "pcapng", "stats", "junit", "vcd", "svg")


@pytest.fixture(name="library", scope="module")
def fixture_library():
    return build_library()


class Outcome:
    """The results of a run: status, standard output, messages, files."""

    def __init__(self, folder, words, environment, outputs, part=None):
        for name in outputs:
            (folder / name).unlink(missing_ok=True)
        if part is not None:
            (folder / "rows.part").write_bytes(part)
        before = contents(folder, outputs)
        result = subprocess.run(words, cwd=folder, env=environment, capture_output=True,
                                stdin=subprocess.DEVNULL, timeout=TIMEOUT_S, check=False)
        self.status, self.stdout = result.returncode, result.stdout
        self.messages = result.stderr.decode(errors="replace").splitlines()
        self.files = {name: (folder / name).read_bytes() for name in outputs
                      if (folder / name).exists()}
        self.harmed = contents(folder, outputs) != before

    def same_output(self, good):
        return (self.status, self.stdout, self.files) == (good.status, good.stdout, good.files)

    def wrong(self, good, silent):
        """Returns a violation, or None; silent: no message is possible."""
        text = "\n".join(self.messages)
        if self.status < 0 or "Sanitizer" in text or "runtime error" in text:
            return f"it crashes: {self.status}"
        if self.harmed:
            return "what it reads has changed"
        if self.same_output(good):
            return None
        if self.status == 0 or self.status == 2:
            return f"status {self.status}"
        if not silent and not set(self.messages) - set(good.messages):
            return "no message"
        return None


def contents(folder, outputs):
    """Returns the contents of files that are read and not written."""
    return {file.name: file.read_bytes() for file in folder.iterdir()
            if file.is_file() and file.name not in (*outputs, "calls")}


class Program:
    """A program in a folder of its own, run once for each call that fails."""

    def __init__(self, folder, library, words, outputs=()):
        self.folder, self.words, self.outputs = folder, words, outputs
        self.before = self.last = None
        self.calls = Calls(folder, library)

    def run(self):
        self.last = Outcome(self.folder, self.words, self.calls.environment(), self.outputs,
                            self.before)
        return self.last

    def list_sites(self):
        self.calls.list_sites()
        good = self.run()
        return good, self.calls.sites()

    def attempt(self, each, good):
        """Returns the violation, and True when the call was reached."""
        self.calls.fail(each)
        outcome = self.run()
        wrong = outcome.wrong(good, each.site.group == "tell")
        return (wrong and f"{wrong}: {each.text(self.words[0])}\n    status {outcome.status}, " +
                " | ".join(outcome.messages[-4:]), self.calls.failed() > 0)


def fail_each(programs):
    """Makes all tries of a program, which exists several times in folders of their own."""
    good, sites = programs[0].list_sites()
    tries = plan(sites)
    reached = run_all(programs, programs[0].words[0], tries,
                      lambda program, each: program.attempt(each, good))
    assert reached == len(tries)
    return good, sites


@pytest.fixture(name="programs")
def fixture_programs(tmp_path, library):
    """programs(words, outputs, files) is a program as often as it can run at the same time."""
    def make(words, outputs=(), **files):
        result = []
        for i in range(WORKERS):
            folder = tmp_path / str(i)
            folder.mkdir()
            (folder / "drive.log").write_text(TRACE)
            (folder / "bus.yaml").write_text(BUS.replace("PROFILES",
                                                         str(ROOT / "config/profiles")))
            for name, text in files.items():
                (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
            result.append(Program(folder, library, words, outputs))
        return result

    return make


# ---- The tool alone ------------------------------------------------------------------------------


def test_check(programs):
    good, sites = fail_each(programs([CANWIRE, "check", "bus.yaml"]))
    assert good.status == 0 and len(sites) > 100


def test_sim_with_each_output(programs):
    words = [word for name in OUTPUTS for word in (f"--{name}", name)]
    good, sites = fail_each(programs([CANWIRE, "sim", "bus.yaml", *words, "--to", "1ms"], OUTPUTS))
    assert good.status == 0 and len(good.files) == len(OUTPUTS) and len(sites) > 300


@pytest.mark.parametrize("output", [None, *OUTPUTS])
def test_sim_to_standard_output(programs, output):
    words = [f"--{output}", "-"] if output else []
    good, _ = fail_each(programs([CANWIRE, "sim", "bus.yaml", *words]))
    assert good.status == 0


def test_an_output_that_stays_without_a_run_is_told(programs):
    """The picture would be too long: there is to be no output, and the log was not there before."""
    program = programs([CANWIRE, "sim", "bus.yaml", "--svg", "svg", "--log", "log",
                        "--until", "10s", "--to", "10s"], OUTPUTS)[0]
    good, sites = program.list_sites()
    assert good.status == 1 and not good.files
    sites = [site for site in sites if site.call == "unlink"]
    assert sites
    for each in [Try(site, "EACCES", lasting=lasting) for site in sites for lasting in (0, 1)]:
        program.calls.fail(each)
        outcome = program.run()
        assert outcome.status == 1 and outcome.files
        for name in outcome.files:
            assert any(f"{name}: it is empty and cannot be removed: Permission denied" in message
                       for message in outcome.messages), outcome.messages


JOURNAL = "".join(json.dumps(entry) + "\n" for entry in journal_lines()).encode()
PACKED = subprocess.run(["zstd", "-c"], input=JOURNAL, capture_output=True, check=True).stdout
OF_A_JOURNAL = tuple(name for name in OUTPUTS if name != "junit")


@pytest.mark.parametrize("journal", [JOURNAL, PACKED], ids=["text", "packed"])
def test_sim_of_a_journal(programs, journal):
    words = [word for name in OF_A_JOURNAL for word in (f"--{name}", name)]
    good, sites = fail_each(programs([CANWIRE, "sim", "--journal", "day.journal", *words,
                                      "--to", "1ms"], OF_A_JOURNAL, **{"day.journal": journal}))
    assert good.status == 0 and len(good.files) == len(OF_A_JOURNAL) and len(sites) > 300


@pytest.mark.parametrize("journal", [JOURNAL, PACKED], ids=["text", "packed"])
def test_check_of_a_journal(programs, journal):
    good, _ = fail_each(programs([CANWIRE, "check", "--journal", "day.journal"],
                                 **{"day.journal": journal}))
    assert good.status == 0 and good.stdout + "\n".join(good.messages).encode()


@pytest.mark.parametrize("words", [["bits", "123#DEADBEEF"], ["help"], ["--version"]])
def test_bits_and_help(programs, words):
    good, _ = fail_each(programs([CANWIRE, *words]))
    assert good.status == 0 and good.stdout


CAMPAIGN = """scenario: bus.yaml
vary:
  - { set: nodes.engine.queue, values: [ 1, 2 ] }
  - { set: faults.crc.do.flip, values: [ "crc[3]", "crc[9]" ] }
  - { set: seed, values: [ 1, 2, 3 ] }
"""


def rows_are_wrong(good, outcome):
    """Tells a row that is neither as without the failure, nor lost."""
    for name, content in outcome.files.items():
        wanted = good.files["rows"].splitlines(True)
        for i, line in enumerate(content.splitlines(True)):
            if not line.endswith(b"\n") and name == "rows.part":
                continue  # it was cut
            if line != wanted[i] and json.loads(line)["outcome"] not in ("crashed", "time-out"):
                return f"row {i} is wrong: {line[:200]!r}"
            if json.loads(line)["number"] != i:
                return f"row {i} has another number"
    if "rows" in outcome.files and outcome.files["rows"].count(b"\n") != 12:
        return "rows are missing"
    return None


@pytest.mark.parametrize("words", [[], ["--resume"]], ids=["new", "resume"])
def test_campaign(programs, words):
    """A row is as it should be, or tells that its process was lost, or is not there."""
    some = programs([CANWIRE, "campaign", "run", "campaign.yaml", "--jobs", "1", "--out", "rows",
                     *words], ["rows", "rows.part"], **{"campaign.yaml": CAMPAIGN})
    some[0].calls.order(False)
    first = some[0].run().files["rows"].splitlines(True)
    for each in some:
        each.before = b"".join(first[:5]) + first[5][:40] if words else None
    good, sites = some[0].list_sites()
    assert good.status == 0 and good.files["rows"] == b"".join(first)
    assert {"fork", "socketpair", "fsync", "rename", "flock"} <= {site.call for site in sites}

    def attempt(program, each):
        wrong, reached = program.attempt(each, good)
        return wrong or rows_are_wrong(good, program.last), reached
    run_all(some, CANWIRE, plan(sites), attempt)


def test_campaign_show(programs):
    good, _ = fail_each(programs([CANWIRE, "campaign", "show", "campaign.yaml", "9"],
                                 **{"campaign.yaml": CAMPAIGN}))
    assert good.status == 0 and b"crc[9]" in good.stdout


def test_campaign_report(programs):
    """Without memory it says so, and not that rows are bad."""
    file = CAMPAIGN.replace("3 ]", "18446744073709551615 ]")
    some = programs([CANWIRE, "campaign", "report", "rows"], **{"campaign.yaml": file})
    canwire("campaign", "run", "campaign.yaml", "--out", "rows", cwd=some[0].folder)
    for each in some[1:]:
        shutil.copy(some[0].folder / "rows", each.folder)
    good, sites = some[0].list_sites()
    assert good.status == 0 and b"12 rows" in good.stdout

    def attempt(program, each):
        wrong, reached = program.attempt(each, good)
        text = str(program.last.messages)
        told = "out of memory" in text or "Cannot allocate memory" in text
        return wrong or (program.last.status != 0 and not told and
                         f"{text}: {each.text(CANWIRE)}"), reached
    run_all(some, CANWIRE, plan([site for site in sites if site.group == "memory"]), attempt)


# ---- Clients -------------------------------------------------------------------------------------

LIVE = """bus: { name: calls, bitrate: 500000 }
control: day.sock
nodes:
  - { name: engine }
  - { name: load, traffic: [ { send: 123#DEADBEEF, every: 5ms } ] }
  - { name: gone }
faults:
  - { name: crc, when: { manual: yes }, do: { bus-off: engine } }
  - { name: spare, when: { manual: yes }, do: { bus-off: engine } }
  - { name: end, when: { time: 0s }, do: { bus-off: gone } }
"""
RULE = "{ name: mine, when: { manual: yes }, do: { bus-off: load } }"
EVENTS = b"""{"t":0.001000000,"node":"load","event":"tx","frame":"123#DEADBEEF"}
{"t":0.001500000,"node":"engine","event":"state","state":"error-passive","tec":128,"rec":0}
{"lost":3}
{"t":0.002000000,"node":"load","event":"tx","frame":"123#DEADBEEF"}
"""


class Bus(threading.Thread):
    """A control socket that answers as a canwired did the first time. A watch gets EVENTS, and then
    the bus has ended. Each client finds it in the same state. The nodes and rules that one test
    changes are for that test alone, as the tests have no order."""

    answers = {}

    def __init__(self, folder, real):
        super().__init__(daemon=True)
        self.real = real
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(folder / "bus.sock"))
        self.listener.listen(8)
        self.start()

    def run(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.serve, args=[client], daemon=True).start()

    def serve(self, client):
        with client, contextlib.suppress(OSError):  # it has gone
            for line in client.makefile("rb"):
                if line not in self.answers:
                    self.answers[line] = self.ask(line)
                client.sendall(self.answers[line])
                if json.loads(line)["request"] == "watch":
                    client.sendall(EVENTS)
                    return

    def ask(self, line):
        with socket.socket(socket.AF_UNIX) as real:
            real.connect(str(self.real))
            real.sendall(line)
            return real.makefile("rb").readline()

    def close(self):
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.join()


@pytest.fixture(name="real", scope="module")
def fixture_real(tmp_path_factory):
    """Returns the control socket of a canwired."""
    folder = tmp_path_factory.mktemp("real")
    (folder / "bus.yaml").write_text(LIVE)
    with (folder / "stderr").open("w") as errors:
        process = subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=folder, stderr=errors)
    try:
        wait_until(lambda: listens(folder / "day.sock"), "the control socket")
        wait_until(lambda: '"bus-off"' in canwire("status", "./day.sock", "--json",
                                                  cwd=folder).stdout, "a node that is bus-off")
        yield folder / "day.sock"
    finally:
        kill_all([process])


@pytest.mark.parametrize("words, outputs", [
    (["status", "BUS"], []), (["status", "BUS", "--json"], []), (["faults", "BUS"], []),
    (["faults", "BUS", "--json"], []), (["set", "BUS", "load", "restart-ms=100"], []),
    (["inject", "BUS", RULE], []), (["inject", "BUS", "other.yaml"], []),
    (["fire", "BUS", "crc"], []), (["clear", "BUS", "spare"], []), (["restart", "BUS", "gone"], []),
    (["reload", "BUS"], []), (["watch", "BUS"], []), (["watch", "BUS", "--text", "tx,state"], []),
    (["record", "BUS", "a.log"], ["a.log"]), (["record", "BUS", "a.pcapng"], ["a.pcapng"]),
], ids=lambda words: " ".join(words[:3:2]))
def test_clients(programs, real, words, outputs):
    some = programs([CANWIRE, *(word.replace("BUS", "./bus.sock") for word in words)], outputs,
                    **{"other.yaml": RULE.replace("mine", "other")})
    buses = [Bus(each.folder, real) for each in some]
    try:
        good, sites = fail_each(some)
        assert good.status == int(words[0] == "watch"), good.messages
        assert len(sites) > 10
    finally:
        for each in buses:
            each.close()


@pytest.mark.parametrize("words", [["status"], ["status", "--json"]])
def test_all_buses_of_a_folder(programs, real, words, monkeypatch):
    monkeypatch.setenv("CANWIRE_RUN", ".")
    some = programs([CANWIRE, *words])
    buses = [Bus(each.folder, real) for each in some]
    try:
        good, sites = fail_each(some)
        assert good.status == 0 and len(sites) > 10, good.messages
    finally:
        for each in buses:
            each.close()
