# SPDX-License-Identifier: MIT
"""canwire campaign with a program of Python that is the bus by itself: `bus: own`."""

import json
import os
import shlex
import subprocess
import sys

import jsonschema
import pytest
import yaml

from simtool import CANWIRE, ROOT, SCHEMAS, TIMEOUT_S, canwire, run

SCHEMA = json.loads((SCHEMAS / "canwire-campaign.schema.json").read_text())
SOURCE = str(ROOT / "lib/python/src")
BUS = """bus: { name: powertrain, bitrate: 500000 }
nodes:
  - name: engine
  - name: dash
  - { name: gearbox, traffic: [ { send: 200#0000, every: 10ms } ] }
faults:
  - { name: hit, when: { frame: "123", skip: 2, count: 1 }, do: { flip: "crc[3]", at: [ dash ] } }
expect:
  - { name: answered, frame: "321", from: dash, seen: yes }
"""
# two ECUs in threads, which know nothing of canwire
PROGRAM = """import threading, time
import can
import canwire

def engine():
    with can.Bus(interface="canwire", channel="engine") as bus:
        for speed in range(1000):
            bus.send(can.Message(arbitration_id=0x123, data=[speed & 255], is_extended_id=False))
            time.sleep(0.01)

def dash():
    bus = can.Bus(interface="canwire", channel="dash")
    def got(message):
        if message.arbitration_id == 0x123 and message.data[0] % 5 == 0:
            print(f"{time.time():.6f} {message.data[0]}")
            bus.send(can.Message(arbitration_id=0x321, data=message.data, is_extended_id=False))
    can.Notifier(bus, [got])
    while True:
        time.sleep(1)

with canwire.row() as bus:
    threading.Thread(target=engine, name="engine").start()
    threading.Thread(target=dash, name="dash").start()
    BODY
"""
POSITIONS = '  - { name: at, set: faults.hit.do.flip, values: [ "crc[3]", "eof[2]", "id[4]" ] }\n'
ONE = "  - { set: seed, values: [ 7 ] }\n"


@pytest.fixture(autouse=True)
def fixture_package(monkeypatch):
    """The program finds the package of this tree, and its library. One with sanitizers is of no use
    to Python."""
    monkeypatch.setenv("PYTHONPATH", SOURCE)
    monkeypatch.setenv("CANWIRE_SIM_LIBRARY", str(ROOT / "build/release/libcanwire-sim.so"))
    for name in list(os.environ):
        if name.startswith(("CI_NODE_", "SLURM_", "JOB_COMPLETION")):
            monkeypatch.delenv(name)


@pytest.fixture(name="make")
def fixture_make(write):
    """make(body) writes a campaign with the program; its path."""
    def make(body="pass", vary=ONE, more="until: 200ms\n", program=PROGRAM, bus=BUS):
        write(bus)
        write(program.replace("BODY", body), "bench.py")
        text = f"scenario: bus.yaml\n{more}ecu: {{ bus: own, name: bench, run: " \
            f"\"exec {sys.executable} $CANWIRE_CAMPAIGN/bench.py\" }}\nvary:\n{vary}"
        jsonschema.validate(yaml.load(text, yaml.BaseLoader), SCHEMA)
        return write(text, "campaign.yaml")
    return make


def rows_of(text):
    return [json.loads(line) for line in text.splitlines()]


def campaign(file, *arguments, status=0):
    return rows_of(canwire("campaign", "run", file.name, *arguments, status=status,
                           cwd=file.parent).stdout)


def log_of(file, row):
    return (file.parent / row["ecus"]["bench"]["log"]).read_text()


# ---- rows ----------------------------------------------------------------------------------------

def test_rows_are_the_same_byte_for_byte(make):
    file = make(vary=POSITIONS)
    texts, logs = [], []
    for jobs in "1", "2":
        canwire("campaign", "run", file.name, "--out", f"rows{jobs}", "--work", "work", "--keep",
                "--jobs", jobs, cwd=file.parent)
        texts.append((file.parent / f"rows{jobs}").read_text())
        logs.append([log_of(file, row) for row in rows_of(texts[-1])])
    assert texts[0] == texts[1] and logs[0] == logs[1]
    rows = rows_of(texts[0])
    assert [row["factors"]["at"] for row in rows] == ["crc[3]", "eof[2]", "id[4]"]
    for row in rows:
        assert row["outcome"] == "passed" and row["t"] == 0.2 and row["faults"] == 1
        assert row["expectations"] == {"met": 1, "failed": []}
        assert row["nodes"]["engine"]["tx_frames"] == 20
        assert row["nodes"]["dash"]["tx_frames"] == 4
        assert row["ecus"]["bench"]["ready"] is None and row["ecus"]["bench"]["end"] == "exit 0"
    # a single receiver with a wrong bit in the CRC or in EOF asks for the frame again
    assert rows[0]["error_frames"] == rows[1]["error_frames"] == 1
    assert rows[0]["first_error"] != rows[1]["first_error"]
    times = [float(line.split()[0]) for line in logs[0][0].splitlines()]
    assert len(times) == 4 and times[1] == pytest.approx(0.05, abs=0.001)


def test_a_row_has_the_keys_of_any_row_and_its_replay_repeats_it(make):
    file = make()
    row, = campaign(file, "--keep")
    plain = file.parent / "plain.yaml"
    plain.write_text("scenario: bus.yaml\nuntil: 200ms\nvary:\n" + ONE)
    other, = rows_of(canwire("campaign", "run", plain, status=3).stdout)
    assert list(other) == [key for key in row if key not in ("ecus", "replay")]
    words = shlex.split(row["replay"])
    assert words == ["canwire", "sim", "campaign.yaml.d/row-0/result.yaml", "--until",
                     "200000000ns"]
    stats = json.loads(run(CANWIRE, *words[1:], "--stats", "-", cwd=file.parent).stdout)
    assert stats["bus"]["frames"] == row["frames"] > 40
    for node in stats["nodes"]:
        assert node["tx_frames"] == row["nodes"][node["name"]]["tx_frames"]
    assert row["seed"] == 7
    campaign(file)
    assert not (file.parent / "campaign.yaml.d").exists()


@pytest.mark.parametrize("more, t", [("until: 200ms\n", 0.2), ("", 5)])
def test_a_body_goes_on_up_to_the_end_of_the_row_or_to_its_own(make, more, t):
    body = "while True: time.sleep(0.003)" if more else "time.sleep(5)"
    row, = campaign(make(body, more=more))
    assert row["outcome"] == "passed" and row["t"] == t


def test_asyncio_and_rules_of_the_program(make):
    program = """import asyncio, can, canwire
async def main(bus):
    with can.Bus(interface="canwire", channel="dash") as dash:
        reader = can.AsyncBufferedReader()
        can.Notifier(dash, [reader], loop=asyncio.get_running_loop())
        await asyncio.sleep(0.05)
        bus.inject({"name": "late", "when": {"count": 2}, "do": {"flip": "crc[1]"}})
        while True:
            await reader.get_message()
            dash.send(can.Message(arbitration_id=0x321, is_extended_id=False))

with canwire.row() as bus:
    asyncio.run(main(bus))
"""
    rows = [campaign(make(program=program), "--keep")[0] for _ in range(2)]
    assert rows[0] == rows[1] and rows[0]["outcome"] == "passed"
    assert rows[0]["faults"] == 2 and rows[0]["nodes"]["dash"]["tx_frames"] >= 15


def test_isotp_between_two_threads(make):
    program = """import threading, can, isotp, canwire

def stack(node, rxid, txid):
    bus = can.Bus(interface="canwire", channel=node)
    address = isotp.Address(rxid=rxid, txid=txid)
    found = isotp.NotifierBasedCanStack(bus, can.Notifier(bus, []), address=address)
    found.start()
    return found

def server():
    served = stack("dash", 0x700, 0x321)
    while True:
        served.send(bytes(reversed(served.recv(block=True, timeout=60))))

with canwire.row() as bus:
    threading.Thread(target=server).start()
    client = stack("engine", 0x321, 0x700)
    for size in range(20, 60, 10):
        client.send(bytes(range(size)))
        answer = client.recv(block=True, timeout=1)
        assert answer == bytes(reversed(range(size))), answer
        print(size)
"""
    file = make(program=program, more="until: 2s\n")
    rows = [campaign(file, "--keep")[0] for _ in range(2)]
    assert rows[0] == rows[1] and rows[0]["outcome"] == "passed" and rows[0]["t"] == 2
    assert log_of(file, rows[0]).split() == ["20", "30", "40", "50"]
    assert rows[0]["nodes"]["dash"]["tx_frames"] >= 4 + 4 * 4


# ---- failures ------------------------------------------------------------------------------------

def test_an_expectation_that_is_not_met(make):
    file = make(bus=BUS.replace('"321"', '"322"'))
    row, = campaign(file, status=3)
    assert row["outcome"] == "failed" and row["expectations"]["failed"][0]["name"] == "answered"


def test_an_exception_is_a_crash_with_all_keys_up_to_there(make):
    row, = campaign(make("time.sleep(0.1); raise ValueError('no speed')"), status=3)
    assert (row["outcome"], row["why"]) == ("crashed", "bench: ValueError: no speed")
    assert row["t"] == 0.1 and row["nodes"]["engine"]["tx_frames"] == 10
    assert row["ecus"]["bench"]["end"] == "exit 1" and "replay" in row


def test_an_exception_in_a_thread_is_a_crash_at_the_end_of_the_row(make):
    file = make(program=PROGRAM.replace("            time.sleep(0.01)",
                                        "            time.sleep(0.01 / (5 - speed))"))
    row, = campaign(file, status=3)
    assert (row["outcome"], row["t"]) == ("crashed", 0.2)
    assert row["why"].startswith("bench: engine: ZeroDivisionError: ")
    assert "ZeroDivisionError" in log_of(file, row) and "SystemExit" not in log_of(file, row)


def test_a_deadlock_is_a_crash(make):
    row, = campaign(make("threading.Event().wait()", more="", program=PROGRAM.replace(
        "target=dash", "target=print").replace("target=engine", "target=print")), status=3)
    assert row["outcome"] == "crashed" and row["why"].startswith("bench: Deadlock: every thread")


@pytest.mark.parametrize("body, why", [
    ("import os; os._exit(3)", "bench: exit status 3"),
    ("import os; os.kill(os.getpid(), 11)", "bench: signal SEGV")])
def test_an_end_without_a_result(make, body, why):
    row, = campaign(make(body), status=3)
    assert (row["outcome"], row["why"]) == ("crashed", why) and "replay" not in row


def test_a_program_that_takes_too_long(make):
    row, = campaign(make("while True: pass", more="until: 1s\nlimit: 2s\n"), status=3)
    assert row["outcome"] == "time-out" and row["ecus"]["bench"]["end"] != "exit 0"


@pytest.mark.parametrize("body, why", [
    ("bus['dash'].detach(); time.sleep(0.01)", "bench: no scenario can say: detach dash at"),
    ("time.sleep(0.01); bus.inject({'name': 'x', 'when': {'manual': True}, "
     "'do': {'flip': 'crc[1]'}}); bus.fire('x')", "bench: no scenario can say: the rule x at")])
def test_what_a_scenario_cannot_say_is_a_broken_row(make, body, why):
    row, = campaign(make(body), status=1)
    assert row["outcome"] == "broken" and row["why"].startswith(why)


def test_a_program_that_makes_no_row(make):
    row, = campaign(make(program="print('hello')\n"), status=1)
    assert (row["outcome"], row["why"]) == (
        "broken", "bench: it has ended without a row; canwire.row() makes it")


# ---- files and programs by hand ------------------------------------------------------------------

@pytest.mark.parametrize("ecu, message", [
    ("{ bus: own, node: dash, run: x }", "node: with 'bus: own' the program is all nodes"),
    ("{ bus: own, run: x, ready: { line: x } }", "ready: with 'bus: own'"),
    ("[ { bus: own, run: x }, { node: dash, run: x } ]", "must be the only one"),
    ("{ run: x }", "'node' is missing"),
    ("{ bus: mine, run: x }", "canwired")])
def test_a_bad_file(write, ecu, message):
    write(BUS)
    text = f"scenario: bus.yaml\nuntil: 1s\necu: {ecu}\nvary:\n{ONE}"
    assert message in canwire("campaign", "plan", write(text, "campaign.yaml"), status=1).stderr
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(yaml.load(text, yaml.BaseLoader), SCHEMA)


def by_hand(write, program, **options):
    return subprocess.run([sys.executable, write(program, "bench.py")], capture_output=True,
                          text=True, timeout=TIMEOUT_S, check=False, cwd=write(BUS).parent,
                          **options)


def test_by_hand(write):
    done = by_hand(write, PROGRAM)
    assert done.returncode == 1 and "give scenario= and until= to run it by hand" in done.stderr
    program = PROGRAM.replace("row()", "row('bus.yaml', until='200ms')").replace("BODY", "pass")
    done = by_hand(write, program)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 4
