# SPDX-License-Identifier: MIT
"""Files that do not answer: pipes in place of files, and a disk that hangs (hanging_disk.c).

The bus goes on, whatever the requests, and ends on demand. Its ECUs are sockets, so this needs no
CAN in the kernel. CANWIRE and CANWIRED are the programs.
"""

import contextlib
import fcntl
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import threading

import pytest

from simtool import CANWIRE, CANWIRED, ROOT, answer, journal_text, kill_all, stop_canwired
from test_record import wait_until

PATIENCE_S = 60
FRAMES = 200
FRAME = struct.Struct("=IB3x8s")
ERROR = 0x20000000
SANITIZERS = {"ASAN_OPTIONS": "detect_leaks=1:verify_asan_link_order=0"}  # the library is first

BUS = """bus: {{ name: day, bitrate: 1000000 }}
control: ../day.sock
nodes:
  - {{ name: engine, port: "unix:../engine.sock", queue: 1024 }}
  - {{ name: dash, port: "unix:../dash.sock" }}
{more}"""
PROFILE = "profiles: [ { file: profile.yaml } ]\n"
REPLAY = "  - { name: load, traffic: [ { replay: drive.log } ] }\n"
NOISE = "faults: [ { name: noise, do: { noise: 1e-9 } } ]\n"


@pytest.fixture(name="library", scope="session")
def fixture_library(tmp_path_factory):
    library = tmp_path_factory.mktemp("disk") / "hanging_disk.so"
    subprocess.run(["cc", "-std=c17", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o",
                    library, ROOT / "tests/support/hanging_disk.c"], check=True)
    return library


class Bus:
    """A canwired between two ECUs, with a disk that may hang."""

    def __init__(self, folder, library, *words, more=""):
        self.folder, self.log, self.flag = folder, folder / "stderr", folder / "hang"
        (folder / "disk").mkdir(exist_ok=True)
        self.write(more)
        environment = dict(os.environ, **SANITIZERS, LD_PRELOAD=str(library), HANG=str(self.flag))
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [CANWIRED, "-c", "disk/bus.yaml", *words], cwd=folder, stderr=log, env=environment)
        wait_until(lambda: " bit/s, " in self.log.read_text() or self.process.poll() is not None,
                   "the bus")
        self.engine, self.dash = self.connect("engine"), self.connect("dash")
        self.next = 0

    def write(self, more):
        (self.folder / "disk/bus.yaml").write_text(BUS.format(more=more))

    def connect(self, name):
        ecu = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ecu.settimeout(PATIENCE_S)
        ecu.connect(str(self.folder / f"{name}.sock"))
        return ecu

    def canwire(self, *words, status=0):
        return answer(self.folder, *words, status=status)

    def status(self):
        return json.loads(self.canwire("status", "./day.sock", "--json"))

    def receive(self):
        """Returns the next frame of the engine at the dash; error frames are ignored."""
        while True:
            can_id, _, data = FRAME.unpack(self.dash.recv(72)[:16])
            if not can_id & ERROR and can_id == 0x123:
                return int.from_bytes(data, "big")

    def carries_frames(self):
        """Checks that so many more frames go through, in their order."""
        for _ in range(FRAMES):
            self.engine.send(FRAME.pack(0x123, 8, self.next.to_bytes(8, "big")))
            assert self.receive() == self.next
            self.next += 1

    @contextlib.contextmanager
    def hanging(self, name="disk/"):
        """Lets the disk hang for files of such a name; it works again at the end."""
        flag = self.folder / "flag"
        flag.write_text(name)
        flag.rename(self.flag)
        try:
            yield
        finally:
            self.flag.unlink()

    def wait_hanging(self):
        wait_until((self.folder / "hang.waits").exists, "somebody who waits for the disk")
        (self.folder / "hang.waits").unlink()

    def stop(self):
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="bus")
def fixture_bus(tmp_path, library):
    started = []

    def start(*words, **more):
        started.append(Bus(tmp_path, library, *words, **more))
        return started[-1]

    yield start
    kill_all(each.process for each in started)


@contextlib.contextmanager
def asking(bus, *words):
    """Runs a client that asks for a reload meanwhile."""
    with subprocess.Popen([CANWIRE, "reload", "./day.sock", *words], cwd=bus.folder, text=True,
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as client:
        try:
            yield client
        finally:
            client.kill()


# ---- Pipes ---------------------------------------------------------------------------------------

FILES = {"configuration": ("bus.yaml", ""), "profile": ("profile.yaml", PROFILE),
         "replay": ("drive.log", REPLAY)}


@pytest.mark.parametrize("name, more", FILES.values(), ids=FILES)
def test_a_reload_takes_no_pipe_for_a_file(bus, name, more):
    running = bus()
    running.write(more)
    (running.folder / "disk" / name).unlink(missing_ok=True)
    os.mkfifo(running.folder / "disk" / name)
    told = running.canwire("reload", "./day.sock", status=1)
    assert f"{name}: not a regular file" in told
    running.process.send_signal(signal.SIGHUP)
    wait_until(lambda: "reload: nothing was changed" in running.log.read_text(), "the refusal")
    assert f"{name}: not a regular file" in running.log.read_text()
    running.carries_frames()
    running.stop()


@pytest.mark.parametrize("name, more", FILES.values(), ids=FILES)
def test_a_start_takes_no_pipe_for_a_file(tmp_path, name, more):
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk/bus.yaml").write_text(BUS.format(more=more))
    (tmp_path / "disk" / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / "disk" / name)
    result = subprocess.run([CANWIRED, "-c", "disk/bus.yaml"], cwd=tmp_path, capture_output=True,
                            text=True, timeout=PATIENCE_S, check=False)
    assert result.returncode == 1
    assert f"{name}: not a regular file" in result.stderr


def test_the_tool_still_reads_pipes(tmp_path):
    text = BUS.format(more="")
    for words in (["check", "/dev/stdin"], ["sim", "/dev/stdin", "--until", "1ms"]):
        subprocess.run([CANWIRE, *words], input=text, text=True, cwd=tmp_path, check=True,
                       timeout=PATIENCE_S, stdout=subprocess.DEVNULL)


# ---- A disk that hangs ---------------------------------------------------------------------------


def fill(running):
    (running.folder / "disk/profile.yaml").write_text(NOISE)
    (running.folder / "disk/drive.log").write_text("(0.000000) can0 7FF#\n")


@pytest.mark.parametrize("name, more", FILES.values(), ids=FILES)
def test_the_bus_goes_on_while_a_reload_waits(bus, name, more):
    running = bus()
    running.write(more)
    fill(running)
    with contextlib.ExitStack() as stack:
        with running.hanging(f"disk/{name}"):
            client = stack.enter_context(asking(running))
            running.wait_hanging()
            running.carries_frames()
            assert len(running.status()["nodes"]) == 2
            assert client.poll() is None
        assert client.wait(PATIENCE_S) == 0, client.stderr.read()
    wait_until(lambda: "configuration reloaded" in running.log.read_text(), "the reload")
    running.carries_frames()
    running.stop()


@pytest.mark.parametrize("how", ["request", "SIGHUP"])
def test_it_ends_while_a_reload_waits(bus, how):
    running = bus("--journal", "day.journal")
    with running.hanging():
        if how == "SIGHUP":
            running.process.send_signal(signal.SIGHUP)
            running.wait_hanging()
            running.process.send_signal(signal.SIGHUP)  # waits for the first one
            running.carries_frames()
            log = running.stop()
            assert log.count("canwired is stopping") == 1
            assert "error" not in log.replace("error frames", "")
        else:
            with asking(running) as client:
                running.wait_hanging()
                running.carries_frames()
                running.stop()
                assert client.wait(PATIENCE_S) == 1
                assert "canwired is stopping" in client.stderr.read()
    assert '"end":' in journal_text(running.folder / "day.journal")


def test_who_asks_meanwhile_gets_what_the_file_says_then(bus):
    running = bus("--verbose")
    fill(running)
    with contextlib.ExitStack() as stack:
        with running.hanging("disk/bus.yaml"):
            clients = [stack.enter_context(asking(running))]
            running.wait_hanging()
            clients += [stack.enter_context(asking(running)) for _ in range(2)]
            wait_until(lambda: running.log.read_text().count("control: client") == 3, "them")
            running.write("  - { name: more }\n")
            running.carries_frames()
        assert [client.wait(PATIENCE_S) for client in clients] == [0, 0, 0]
    wait_until(lambda: len(running.status()["nodes"]) == 3, "the new node")
    assert 1 <= running.stop().count("configuration reloaded") <= 2


def test_replies_come_in_their_order(bus):
    running = bus()
    with socket.socket(socket.AF_UNIX) as control:
        control.connect(str(running.folder / "day.sock"))
        with running.hanging():
            control.sendall(b'{"id":1,"request":"reload"}\n{"id":2,"request":"status"}\n')
            control.shutdown(socket.SHUT_WR)
            running.wait_hanging()
            running.carries_frames()
            control.settimeout(0)
            with pytest.raises(BlockingIOError):
                control.recv(1)  # whole: there is nothing
        control.settimeout(PATIENCE_S)
        replies = [json.loads(line) for line in control.makefile()]
    assert [(reply["id"], reply["ok"]) for reply in replies] == [(1, True), (2, True)]
    running.stop()


def test_a_client_that_does_not_wait_is_no_trouble(bus):
    running = bus()
    with running.hanging():
        with asking(running) as client:
            running.wait_hanging()
            client.kill()
            client.wait(PATIENCE_S)
        running.carries_frames()
    running.canwire("reload", "./day.sock")
    running.stop()


def test_a_reload_that_takes_too_long_is_given_up(bus):
    running = bus()
    with running.hanging():
        told = running.canwire("reload", "./day.sock", status=1)
        assert "takes longer than 10 s and is given up" in told
        running.carries_frames()
    running.canwire("reload", "./day.sock")  # the result of the first one is not wanted any more
    wait_until(lambda: "configuration reloaded" in running.log.read_text(), "the reload")
    assert running.stop().count("configuration reloaded") == 1


# ---- A recording ---------------------------------------------------------------------------------

RECORD = "record: [ { file: data/a.log } ]\n"


def recording_is(running, wanted):
    return lambda: [each["state"] for each in running.status()["recordings"]] == [wanted]


def test_the_bus_goes_on_while_a_recording_waits_for_its_file(bus):
    running = bus()
    running.write(RECORD)
    (running.folder / "disk/data").mkdir()
    with running.hanging("second:disk/data/"):
        running.canwire("reload", "./day.sock")
        running.wait_hanging()
        running.carries_frames()
        assert recording_is(running, "waiting")()
        assert "record disk/data/a.log: begun" not in running.log.read_text()
        running.write("")  # it is taken away, and wanted again, before it has begun
        running.canwire("reload", "./day.sock")
        running.write(RECORD)
        running.canwire("reload", "./day.sock")
        wait_until(recording_is(running, "waiting"), "the third configuration")
        running.carries_frames()
    wait_until(recording_is(running, "recording"), "the recording")
    running.carries_frames()
    log = running.stop()
    assert log.count("record disk/data/a.log: begun") == 1
    first, second = running.folder / "disk/data/a.log.1", running.folder / "disk/data/a.log"
    assert len(first.read_text().splitlines()) == FRAMES  # frames that came meanwhile
    assert len(second.read_text().splitlines()) >= FRAMES


def test_it_ends_while_a_recording_waits_for_its_file(bus):
    running = bus("--journal", "day.journal")
    running.write(RECORD)
    (running.folder / "disk/data").mkdir()
    with running.hanging("second:disk/data/"):
        running.canwire("reload", "./day.sock")
        running.wait_hanging()
        running.carries_frames()
        assert "record disk/data/a.log: not all of it could be written" in running.stop()
    assert '"end":' in journal_text(running.folder / "day.journal")


def test_a_recording_that_cannot_be_begun_is_refused_by_reload_and_start_alike(bus):
    running = bus()
    told = r"disk/bus.yaml:6:\d+: record disk/data/a.log: No such file or directory"
    running.write(RECORD)
    assert re.search(told, running.canwire("reload", "./day.sock", status=1))
    assert running.status()["recordings"] == []
    running.carries_frames()
    (running.folder / "disk/data").mkdir()
    (running.folder / "disk/data/a.log").mkdir()
    assert "no regular file" in running.canwire("reload", "./day.sock", status=1)
    (running.folder / "disk/data/a.log").rmdir()
    running.canwire("reload", "./day.sock")
    wait_until(recording_is(running, "recording"), "the recording")
    running.canwire("reload", "./day.sock")  # canwired itself writes the file, which is no obstacle
    running.carries_frames()
    assert recording_is(running, "recording")()
    shutil.move(running.folder / "disk/data", running.folder / "disk/moved")
    assert re.search(told, running.canwire("reload", "./day.sock", status=1))
    running.carries_frames()
    running.stop()
    words = [CANWIRED, "-c", "disk/bus.yaml"]
    start = subprocess.run(words, cwd=running.folder, capture_output=True, text=True, check=False)
    assert start.returncode != 0 and re.search(told, start.stderr)


def test_a_file_that_another_program_writes_is_refused_by_a_reload(bus):
    running = bus()
    running.write("record: [ { file: a.log, files: 3 } ]\n")
    for name in ("a.log", "a.log.2"):  # one that is rotated, too
        with open(running.folder / "disk" / name, "w", encoding="ascii") as other:
            fcntl.flock(other, fcntl.LOCK_EX)
            assert "another program is writing it" in running.canwire("reload", "./day.sock",
                                                                      status=1)
    running.canwire("reload", "./day.sock")
    running.stop()


# ---- A file that is replayed ---------------------------------------------------------------------

ENTRIES = 12000  # more than are read ahead


def replayed(running, count):
    return lambda: running.status()["nodes"][2]["tx_frames"] >= count


@pytest.mark.parametrize("speed", ["original", "max"])
def test_the_bus_goes_on_while_a_replay_waits(bus, tmp_path, speed):
    running = bus()
    with (tmp_path / "disk/drive.log").open("w") as out:
        for i in range(ENTRIES):
            out.write(f"({i / 5000:.6f}) can0 7FE#{i:016X}\n")
    running.write(REPLAY.replace("drive.log", f"drive.log, speed: {speed}"))
    seen = []

    def listen(ecu):
        while len(seen) < ENTRIES and (frame := ecu.recv(72)):
            can_id, _, data = FRAME.unpack(frame[:16])
            if can_id == 0x7FE:
                seen.append(int.from_bytes(data, "big"))

    running.engine.close()
    listener = running.connect("engine")
    thread = threading.Thread(target=listen, args=(listener,), daemon=True)
    thread.start()
    running.canwire("reload", "./day.sock")
    with running.hanging("disk/drive.log"):
        running.wait_hanging()
        wait_until(lambda: "reading it takes long" in running.log.read_text(), "what it lacks")
        before = running.status()["nodes"][2]["tx_frames"]
        assert 0 < before < ENTRIES
        for i in range(FRAMES):
            running.dash.send(FRAME.pack(0x123, 8, i.to_bytes(8, "big")))
        wait_until(lambda: running.status()["nodes"][1]["tx_frames"]
                   + running.status()["nodes"][1]["dropped"]["queue-full"] == FRAMES, "frames")
    thread.join(PATIENCE_S)
    assert seen == list(range(ENTRIES))
    running.stop()


def test_it_ends_while_a_replay_waits(bus, tmp_path):
    running = bus()
    with (tmp_path / "disk/drive.log").open("w") as out:
        out.write("(0.000000) can0 7FE#\n" * ENTRIES)
    running.write(REPLAY.replace("drive.log", "drive.log, speed: max"))
    running.canwire("reload", "./day.sock")
    with running.hanging("disk/drive.log"):
        running.wait_hanging()
        running.carries_frames()
        running.stop()




def test_rules_that_are_kept_wait_for_the_disk_beside_the_bus(bus):
    """Their client is told when they are written, or cannot be."""
    b = bus()
    rule = '{name: x, when: {frame: "7FF"}, do: {flip: "crc[3]"}}'
    words = ["inject", "--keep", "./day.sock", rule]
    with b.hanging(".rules.new"), subprocess.Popen(
            [CANWIRE, *words], cwd=b.folder, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE) as client:
        b.wait_hanging()
        b.carries_frames()
        out, errors = client.communicate(timeout=PATIENCE_S)
        assert (client.returncode, out) == (1, "")
        assert "are not injected: the disk does not answer\n" in errors
        assert json.loads(b.canwire("faults", "./day.sock", "--json")) == []
        b.carries_frames()
    assert b.canwire(*words) == "x\n"
    assert json.loads((b.folder / "day.sock.rules").read_text())["kept"][0]["rules"] == ["x"]
    b.carries_frames()
    log = b.stop()
    assert log.count("not written: the disk does not answer") == 1


def test_the_end_does_not_wait_for_rules(bus):
    b = bus()
    b.canwire("inject", "./day.sock", '{name: x, when: {frame: "7FF"}, do: {flip: "crc[3]"}}')
    with b.hanging(".rules"):
        b.canwire("inject", "./day.sock", '{name: y, when: {frame: "7FF"}, do: {flip: sof}}')
        assert "the disk does not answer" in b.stop()
