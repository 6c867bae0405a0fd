# SPDX-License-Identifier: MIT
"""No file that is written is also something else: what is read, another output, another program's.

Every input is held against every output, by every name that one file can have.
"""

import contextlib
import fcntl
import itertools
import os
import re
import signal
import socket
import stat
import subprocess

import pytest

from simtool import (CANWIRE, CANWIRED, TIMEOUT_S, canwire, journal_text, kill_all, sim,
                     stop_canwired)
from test_record import wait_until

BUS = """bus: {{ name: day, bitrate: 500000 }}
nodes:
  - name: engine
    traffic: [ {{ send: 123#DEADBEEF, every: 5ms{count} }}, {{ replay: in.log }} ]
  - {{ name: dash }}
profiles: [ {{ file: profile.yaml }} ]
"""
PROFILE = """
faults:
  - { name: f, when: { frame: "123", count: 1 }, do: { flip: "crc[3]", at: [dash] } }
"""
READ = {"bus.yaml": "the configuration", "profile.yaml": "the profile", "in.log": "replay"}
OUTPUTS = ["--events", "--log", "--pcapng", "--stats", "--vcd", "--svg", "--junit"]


# ---- One file by many names ----------------------------------------------------------------------


def as_it_is(folder, name):
    del folder
    return name


def with_dots(folder, name):
    return f"../{folder.name}/./{name}"


def absolute(folder, name):
    return str(folder / name)


def by_symlink(folder, name):
    (folder / "symlink").symlink_to(name)
    return "symlink"


def by_two_symlinks(folder, name):
    (folder / "second").symlink_to(folder / name)
    (folder / "first").symlink_to("second")
    return "first"


def by_folder(folder, name):
    (folder / "other").symlink_to(".")
    return f"other/{name}"


def by_hard_link(folder, name):
    (folder / "hard").hardlink_to(folder / name)
    return "hard"


TO_NEW_FILES = [as_it_is, with_dots, absolute, by_symlink, by_two_symlinks, by_folder]
TO_FILES = [*TO_NEW_FILES, by_hard_link]


@pytest.fixture(name="folder")
def fixture_folder(tmp_path):
    """Makes a bus with all files that it reads, and its journal."""
    (tmp_path / "bus.yaml").write_text(BUS.format(count=", count: 3"))
    (tmp_path / "profile.yaml").write_text(PROFILE)
    (tmp_path / "in.log").write_text("(1.000000) can0 123#11\n")
    return tmp_path


def contents(folder):
    return {p.name: p.read_text() for p in folder.iterdir() if p.is_file()}


def assert_named(message, *words):
    """Checks that the message is one line that names all."""
    assert len(message.splitlines()) == 1 and "is the same file as" in message, message
    assert ",:" not in message and ", (" not in message, message
    for word in words:
        assert word in message, message


# ---- canwire sim ---------------------------------------------------------------------------------


@pytest.mark.parametrize("how", TO_FILES, ids=lambda f: f.__name__)
@pytest.mark.parametrize("option, read", itertools.product(OUTPUTS, READ))
def test_no_output_of_a_simulation_is_what_it_reads(folder, option, read, how):
    path = how(folder, read)
    before = contents(folder)
    message = sim("bus.yaml", option, path, status=1, cwd=folder).stderr
    assert_named(message, f"{option} {path} ", f"{READ[read]} ")
    assert (re.search(r"bus.yaml:4:\d+", message) is not None) == (read == "in.log")
    assert contents(folder) == before


@pytest.mark.parametrize("how", TO_FILES, ids=lambda f: f.__name__)
@pytest.mark.parametrize("option", OUTPUTS)
def test_no_output_of_a_simulation_is_its_journal(folder, option, how):
    (folder / "j").write_text("no journal is looked for behind the check\n")
    journal = folder / "day.journal"
    run_bus_with_journal(folder)
    path = how(folder, "day.journal")
    before = journal.read_bytes()
    message = sim("--journal", "day.journal", option, path, status=1, cwd=folder).stderr
    assert_named(message, f"{option} {path} ", "--journal day.journal")
    assert journal.read_bytes() == before


def run_bus_with_journal(folder):
    log = folder / "stderr"
    with log.open("w") as errors:
        process = subprocess.Popen([CANWIRED, "-c", "bus.yaml", "--journal", "day.journal"],
                                   cwd=folder, stderr=errors)
    try:
        wait_until(lambda: " bit/s, " in log.read_text(), "the bus")
        assert "could not be written" not in stop_canwired(process, log)
    finally:
        kill_all([process])


@pytest.mark.parametrize("there", [True, False], ids=["there", "new"])
@pytest.mark.parametrize("how", TO_FILES[1:], ids=lambda f: f.__name__)
def test_no_two_outputs_of_a_simulation_are_one_file(folder, how, there):
    if there:
        (folder / "out").write_text("before\n")
    elif how is by_hard_link:
        pytest.skip("there is no other name for what is not there")
    path = how(folder, "out")
    for first, second in itertools.permutations(OUTPUTS, 2):
        message = sim("bus.yaml", first, "out", second, path, status=1, cwd=folder).stderr
        assert_named(message, f"{first} out", f"{second} {path}")
    assert (folder / "out").exists() == there
    assert not there or (folder / "out").read_text() == "before\n"


@pytest.mark.parametrize("words", [[], ["--events", "-"], ["--log", "-", "--stats", "-"]])
def test_standard_output_is_not_what_is_read(folder, words):
    """With >> a shell leaves to the program what is there."""
    before = contents(folder)
    with (folder / "bus.yaml").open("a") as out:
        result = subprocess.run([CANWIRE, "sim", "bus.yaml", *words], cwd=folder, stdout=out,
                                stderr=subprocess.PIPE, text=True, timeout=TIMEOUT_S, check=False)
    assert result.returncode == 1
    assert_named(result.stderr, "standard output", "the configuration bus.yaml")
    assert contents(folder) == before


def test_standard_output_is_not_another_output(folder):
    with (folder / "out").open("w") as out:
        result = subprocess.run([CANWIRE, "sim", "bus.yaml", "--events", "-", "--log", "out"],
                                cwd=folder, stdout=out, stderr=subprocess.PIPE, text=True,
                                timeout=TIMEOUT_S, check=False)
    assert result.returncode == 1
    assert_named(result.stderr, "standard output", "--log out")


def test_what_is_no_regular_file_takes_many_outputs(folder):
    sim("bus.yaml", "--events", "/dev/null", "--log", "/dev/null", "--vcd", "/dev/null", cwd=folder)
    text = sim("bus.yaml", "--events", "-", "--log", "-", "--stats", "-", cwd=folder).stdout
    assert '"event":"tx"' in text and "engine 123#DEADBEEF" in text and '"bitrate"' in text


def test_files_that_only_look_alike_are_no_reason(folder):
    (folder / "sub").mkdir()
    sim("bus.yaml", "--log", "sub/in.log", "--events", "in.log.1", "--stats", "bus", cwd=folder)


def test_an_output_that_another_program_writes_is_refused(folder):
    (folder / "out").write_text("before\n")
    with (folder / "out").open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        result = sim("bus.yaml", "--log", "out", status=1, cwd=folder)
    assert "out: another program is writing it" in result.stderr
    assert (folder / "out").read_text() == "before\n"
    sim("bus.yaml", "--log", "out", cwd=folder)


# ---- Configurations ------------------------------------------------------------------------------


def write_records(folder, *records):
    entries = "".join(f"  - {{ {record} }}\n" for record in records)
    head = BUS.format(count="") + "control: day.sock\nrecord:\n"
    (folder / "bus.yaml").write_text(head + entries)


RECORDS = {
    "rotated to another": (["file: a.log, files: 3", "file: a.log.1, format: candump"],
                           ["record a.log,", "rotated to a.log.1", "record a.log.1 "]),
    "the other way round": (["file: a.log.2, format: candump", "file: a.log, files: 3"],
                            ["record a.log,", "rotated to a.log.2", "record a.log.2 "]),
    "both rotated": (["file: a.log.1, format: candump, files: 3", "file: a.log, files: 3"],
                     ["record a.log", "record a.log.1"]),
    "by another name": (["file: a.log", "file: other/a.log"], ["a.log", "other/a.log"]),
    "a symbolic link to what it rotates": (["file: a.log", "file: new.log"],
                                           ["record a.log", "a.log.1", "record new.log"]),
}


@pytest.mark.parametrize("records, named", RECORDS.values(), ids=RECORDS)
def test_no_recording_is_another(folder, records, named):
    (folder / "other").symlink_to(".")
    (folder / "new.log").symlink_to("a.log.1")
    write_records(folder, *records)
    for program, words in [(CANWIRE, ["check", "bus.yaml"]), (CANWIRED, ["-c", "bus.yaml"])]:
        result = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True,
                                timeout=TIMEOUT_S, check=False)
        assert result.returncode == 1
        assert re.search(r"^bus.yaml:1\d:\d+: ", result.stderr), result.stderr
        for word in named:
            assert word in result.stderr
    assert not (folder / "a.log").exists()


# The recording, and the socket, or its lock, that has the same file.
SOCKETS = {
    "control, rotated": ("file: rec.log, files: 3", "control: rec.log.1",
                         ["record rec.log, which is rotated to rec.log.1,", "control rec.log.1 "]),
    "control": ("file: day.sock, format: candump", "control: other/day.sock",
                ["record day.sock ", "control other/day.sock "]),
    "control's lock": ("file: day.sock.lock, format: candump", "control: day.sock",
                       ["record day.sock.lock ", "control day.sock.lock "]),
    "a port, rotated": ("file: rec.log, files: 3", "port: unix:rec.log.2",
                        ["record rec.log, which is rotated to rec.log.2,", "port rec.log.2 "]),
    "a port's lock": ("file: other/ecu.lock, format: candump", "port: unix:ecu",
                      ["record other/ecu.lock ", "port ecu.lock "]),
    "a port's lock, rotated": ("file: a, format: candump", "port: unix:lock",
                               ["record a, which is rotated to a.4,", "port lock.lock "]),
}


def write_sockets(folder, record, key):
    """Writes a configuration, with the port at a third node."""
    port, control = (key, "") if key.startswith("port") else ("", key)
    nodes = f"  - {{ name: gateway, {port} }}\nprofiles:" if port else "profiles:"
    (folder / "bus.yaml").write_text(BUS.format(count="").replace("profiles:", nodes) +
                                     f"{control}\nrecord: [ {{ {record} }} ]\n")


@pytest.mark.parametrize("there", [True, False], ids=["there", "new"])
@pytest.mark.parametrize("record, key, named", SOCKETS.values(), ids=SOCKETS)
def test_no_recording_takes_the_place_of_a_socket(folder, record, key, named, there):
    (folder / "other").symlink_to(".")
    (folder / "lock.lock").touch()
    (folder / "a.4").hardlink_to(folder / "lock.lock")
    with socket.socket(socket.AF_UNIX) as stale:
        if there and not named[1].endswith(".lock "):
            stale.bind(str(folder / key.split(":")[-1].strip()))
        write_sockets(folder, record, key)
        for program, words in [(CANWIRE, ["check", "bus.yaml"]), (CANWIRED, ["-c", "bus.yaml"])]:
            result = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True,
                                    timeout=TIMEOUT_S, check=False)
            assert result.returncode == 1
            assert_named(result.stderr, *named)
            assert re.match(r"bus.yaml:\d+:\d+: record ", result.stderr)


def test_no_journal_takes_the_place_of_a_socket(folder):
    write_records(folder, "file: a.log")
    for journal, other in [("day.sock", "control day.sock "),
                           ("day.sock.lock", "control day.sock.lock ")]:
        result = subprocess.run([CANWIRED, "-c", "bus.yaml", "--journal", journal], cwd=folder,
                                capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        assert result.returncode == 1
        assert_named(result.stderr, f"--journal {journal} ", other)


def test_a_reload_takes_no_socket_for_a_recording(folder):
    write_sockets(folder, "file: a.log", "control: rec.log.1")
    with running(folder):
        for record, other in [("file: rec.log", "control rec.log.1"),
                              ("file: rec.log.1.lock, format: vcd", "control rec.log.1.lock")]:
            write_sockets(folder, record, "control: rec.log.1")
            message = canwire("reload", "./rec.log.1", status=1, cwd=folder).stderr
            assert_named(message, "record rec.log", other)
        assert canwire("status", "./rec.log.1", cwd=folder).stdout


def test_no_socket_of_others_is_rotated_away(folder):
    write_records(folder, "file: a.log, files: 4")
    (folder / "a.log.1").write_text("before\n")
    for name in ["a.log.2", "a.log.3"]:
        with socket.socket(socket.AF_UNIX) as other:
            other.bind(str(folder / name))
            result = subprocess.run([CANWIRED, "-c", "bus.yaml"], cwd=folder, capture_output=True,
                                    text=True, timeout=TIMEOUT_S, check=False)
        assert result.returncode == 1
        assert "record a.log: there is something that is no regular file" in result.stderr
        assert (folder / name).is_socket() and (folder / "a.log.1").read_text() == "before\n"
        (folder / name).unlink()


def test_names_beyond_those_that_are_kept_are_free(folder):
    write_records(folder, "file: a.log, files: 3", "file: a.log.3, format: candump",
                  "file: b.log, files: 1", "file: b.log.1, format: candump")
    canwire("check", "bus.yaml", cwd=folder)


@pytest.mark.parametrize("how", TO_FILES, ids=lambda f: f.__name__)
@pytest.mark.parametrize("read", READ)
def test_no_recording_is_what_the_bus_reads(folder, read, how):
    path = how(folder, read)
    write_records(folder, f"file: {path}, format: candump")
    before = contents(folder)
    message = canwire("check", "bus.yaml", status=1, cwd=folder).stderr
    assert_named(message, "record " + path.replace("/./", "/"), READ[read], "bus.yaml:9:")
    result = subprocess.run([CANWIRED, "-c", "bus.yaml"], cwd=folder, capture_output=True,
                            text=True, timeout=TIMEOUT_S, check=False)
    assert result.returncode == 1 and message.strip().split(": ", 1)[1] in result.stderr
    assert contents(folder) == before


@pytest.mark.parametrize("read", READ)
def test_what_the_bus_reads_is_not_rotated_away(folder, read):
    """A file that a recording becomes, by another name."""
    (folder / "a.log.2").hardlink_to(folder / read)
    write_records(folder, "file: a.log, files: 3")
    message = canwire("check", "bus.yaml", status=1, cwd=folder).stderr
    assert_named(message, "record a.log", "a.log.2", READ[read])


# The file of --journal, and what of its own it must not be, with a recording beside it.
JOURNALS = {
    "the configuration": ("bus.yaml", [], "the configuration bus.yaml"),
    "the profile": ("profile.yaml", [], "the profile profile.yaml"),
    "the replay": ("in.log", [], "replay in.log"),
    "a recording": ("a.log", ["file: a.log"], "record a.log"),
    "what a recording is rotated to": ("a.log.2", ["file: a.log"], "record a.log"),
    "rotated to a recording": ("day", ["file: day.1, format: candump"], "record day.1"),
    "a number that it does not keep": ("day", ["file: day.700, format: candump"],
                                       "record day.700"),
}


@pytest.mark.parametrize("journal, records, other", JOURNALS.values(), ids=JOURNALS)
def test_no_journal_is_something_else(folder, journal, records, other):
    if records:
        write_records(folder, *records)
    before = contents(folder)
    for path in [journal, folder / journal]:
        result = subprocess.run([CANWIRED, "-c", "bus.yaml", "--journal", path], cwd=folder,
                                capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        assert result.returncode == 1
        assert_named(result.stderr, f"--journal {path}", other)
    assert contents(folder) == before


# ---- While the bus runs --------------------------------------------------------------------------


@contextlib.contextmanager
def running(folder, *words, config="bus.yaml"):
    log = folder / f"stderr-{config}"
    with log.open("w") as errors:
        process = subprocess.Popen([CANWIRED, "-c", config, *words], cwd=folder, stderr=errors)
    try:
        wait_until(lambda: " bit/s, " in log.read_text() or process.poll() is not None, "the bus")
        assert process.poll() is None, log.read_text()
        yield log
        stop_canwired(process, log)
    finally:
        kill_all([process])


RELOADS = {
    "the configuration": "bus.yaml",
    "the profile": "profile.yaml",
    "the replay": "in.log",
    "the journal": "day.journal",
    "what the journal is rotated to": "day.journal.1",
}


@pytest.mark.parametrize("record", RELOADS.values(), ids=RELOADS)
def test_a_reload_is_refused_as_a_start_is(folder, record):
    write_records(folder, "file: a.log")
    with running(folder, "--journal", "day.journal"):
        write_records(folder, "file: a.log", f"file: ../{folder.name}/{record}, format: candump")
        config = (folder / "bus.yaml").read_text()
        message = canwire("reload", "./day.sock", status=1, cwd=folder).stderr
        assert "is the same file as" in message and "bus.yaml:10:" in message
        assert (folder / "bus.yaml").read_text() == config
        assert (folder / "profile.yaml").read_text() == PROFILE
        write_records(folder, "file: a.log", "file: b.log")
        canwire("reload", "./day.sock", cwd=folder)
    assert '"end":' in journal_text(folder / "day.journal")


SECOND = "bus: { name: other, bitrate: 500000 }\nnodes: [ { name: a }, { name: b } ]\n"
TAKEN = {
    "its recording": ("record: [ { file: a.log } ]", [], "record a.log: another program"),
    "by another name": ("record: [ { file: other/a.log } ]", [], "a.log: another program"),
    "what it becomes": ("record: [ { file: a, format: candump, files: 4 } ]", [],
                        "record a: another program"),
    "its journal": ("", ["--journal", "day.journal"], "journal day.journal: another program"),
    "journal into its recording": ("", ["--journal", "a.log"], "journal a.log: another program"),
}


@pytest.mark.parametrize("text, words, message", TAKEN.values(), ids=TAKEN)
def test_a_file_that_another_canwired_writes_is_refused(folder, text, words, message):
    (folder / "other").symlink_to(".")
    write_records(folder, "file: a.log", "file: a.2, format: candump")
    (folder / "second.yaml").write_text(SECOND + text)
    with running(folder, "--journal", "day.journal"):
        inodes = {p.name: p.stat().st_ino for p in folder.iterdir()}
        second = subprocess.run([CANWIRED, "-c", "second.yaml", *words], cwd=folder,
                                capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        assert second.returncode == 1 and message in second.stderr
        assert {p.name: p.stat().st_ino for p in folder.iterdir()} == inodes
    if text:  # it is free when its writer has gone
        with running(folder, *words, config="second.yaml"):
            pass


def test_a_tool_does_not_write_what_the_bus_reads_or_writes(folder):
    write_sockets(folder, "file: a.log, files: 3", "port: unix:ecu")
    with (folder / "bus.yaml").open("a") as out:
        out.write("control: day.sock\n")
    (folder / "link").symlink_to("bus.yaml")
    (folder / "hard").hardlink_to(folder / "bus.yaml")
    (folder / "elsewhere").mkdir()
    with running(folder, "--journal", "day.journal"):
        inodes = {p.name: p.stat().st_ino for p in folder.iterdir()}
        for file, other in [("a.log", "record"), ("a.log.2", "record"), ("day.journal", "journal"),
                            ("bus.yaml", "configuration"), ("link", "configuration"),
                            ("profile.yaml", "input"),
                            ("in.log", "input"), ("day.sock", "control"),
                            ("day.sock.lock", "control"), ("ecu", "port"), ("ecu.lock", "port"),
                            ("hard", "configuration")]:
            result = canwire("record", "../day.sock", f"../{file}", "--format", "candump", status=1,
                             cwd=folder / "elsewhere")
            assert re.search(rf"\.\./{file} is the same file as the (bus' )?{other} ",
                             result.stderr)
            assert str(folder) in result.stderr
        (folder / "quick.yaml").write_text(SECOND)
        result = sim("quick.yaml", "--log", "a.log", status=1, cwd=folder)
        assert "a.log: another program is writing it" in result.stderr
        assert {p.name: p.stat().st_ino for p in folder.iterdir() if p.name in inodes} == inodes


def test_a_recording_keeps_its_lock_when_it_is_rotated(folder):
    """The first file hands the lock to its successors, without a moment in which it is free."""
    (folder / "bus.yaml").write_text(
        BUS.format(count="").replace("every: 5ms", "every: 100us") +
        "control: day.sock\nrecord: [ { file: a.log, size: 64kB, files: 1000 } ]\n")

    def is_free(path):
        try:
            with path.open() as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # else it has been rotated since it was opened
                return os.fstat(file.fileno()).st_ino == path.stat().st_ino
        except BlockingIOError:
            return False
        except FileNotFoundError:  # between two files
            return False

    with running(folder):
        seen = 0
        while not (folder / "a.log.3").exists():
            seen += is_free(folder / "a.log")
        assert seen == 0


EVIL = {"C1 in UTF-8": "\u009b31m", "a C1 byte": b"\x9b31m", "a new line": "a\nb.yaml:1:1: fine",
        "an escape": "\x1b[31m", "DEL": "a\x7fb", "half a character": b"a\xe2\x82"}


@pytest.mark.parametrize("name", EVIL.values(), ids=EVIL)
def test_no_name_of_a_file_or_of_rules_reaches_the_terminal_as_it_is(folder, name):
    name = os.fsencode(name) + b".yaml"
    (folder / os.fsdecode(name)).write_text("bus: {}\n")
    write_records(folder, "file: a.log")
    with running(folder):
        for words in [["check", name], ["inject", "./day.sock", name]]:
            result = subprocess.run([CANWIRE, *words], cwd=folder, capture_output=True,
                                    timeout=TIMEOUT_S, check=False)
            assert result.returncode == 1
            for line in result.stderr.splitlines():
                text = line.decode()  # it is UTF-8
                assert not re.search("[\x00-\x1f\x7f-\x9f]", text), text
                assert not text.startswith("b.yaml:"), text


def test_characters_of_other_languages_are_shown(folder):
    (folder / "größe-測試.yaml").write_text("bus: {}\n")
    assert "größe-測試.yaml:1:" in canwire("check", "größe-測試.yaml", status=1, cwd=folder).stderr


def test_what_is_recorded_is_not_for_everybody(folder):
    write_records(folder, "file: a.log")
    before = os.umask(0)
    try:
        with running(folder, "--journal", "day.journal"):
            canwire_record(folder)
    finally:
        os.umask(before)
    for name in ["a.log", "day.journal", "b.log"]:
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o640


def canwire_record(folder):
    process = subprocess.Popen([CANWIRE, "record", "./day.sock", "b.log"], cwd=folder,
                               stderr=subprocess.PIPE, text=True)
    assert "writing b.log" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 0
