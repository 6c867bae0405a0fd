# SPDX-License-Identifier: MIT
"""Sockets at paths, of the control socket and of ports: one canwired each, whatever others do.

Actions of others come at exactly the intended moment (between_calls.c), and at random.
"""

import contextlib
import json
import os
import signal
import socket
import stat
import struct
import subprocess

import pytest

from simtool import CANWIRE, CANWIRED, ROOT, TIMEOUT_S, canwire, kill_all, stop_canwired
from failing import SANITIZERS
from test_record import wait_until

CONTROL = """bus: {{ name: day, bitrate: 500000 }}
control: {path}
nodes: [ {{ name: engine }}, {{ name: dash }} ]
"""
PORT = """bus: {{ name: day, bitrate: 500000 }}
nodes: [ {{ name: engine, port: "unix:{path}" }}, {{ name: dash }} ]
"""
KINDS = {"control": CONTROL, "port": PORT}
IN_USE = "in use; is another canwired running for this bus?"
ROUNDS = 12
SO_PASSRIGHTS = 83
GROUP_ID = 54321


@pytest.fixture(name="library", scope="module")
def fixture_library(tmp_path_factory):
    library = tmp_path_factory.mktemp("between") / "between_calls.so"
    subprocess.run(["cc", "-std=c17", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o",
                    library, ROOT / "tests/support/between_calls.c", "-ldl"], check=True)
    return library


@pytest.fixture(name="start")
def fixture_start(tmp_path):
    """start(text, KEY=VALUE...) is a canwired and the file with its messages."""
    started = []

    def start(text, file="bus.yaml", pass_fds=(), **environment):
        config = tmp_path / file
        if not config.exists() or config.read_text() != text:  # others may be reading it
            config.write_text(text)
        log = tmp_path / f"stderr{len(started)}"
        with log.open("w") as errors:
            started.append(subprocess.Popen(
                [CANWIRED, "-c", file], cwd=tmp_path, stderr=errors, pass_fds=pass_fds,
                env=dict(os.environ, **SANITIZERS, **environment)))
        return started[-1], log

    yield start
    kill_all(started)


def is_up(log):
    return " bit/s, " in log.read_text()


def settle(process, log):
    """Returns True when it runs; waits until that is known."""
    wait_until(lambda: is_up(log) or process.poll() is not None, "a start or an end")
    return process.poll() is None


def sockets_and_locks(folder):
    return sorted(p.name for p in folder.iterdir() if ".sock" in p.name)


# ---- One at a time -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_canwired_that_does_not_listen_yet_is_not_taken_for_one_that_is_gone(
        kind, start, library, tmp_path):
    hold = tmp_path / "hold"
    hold.touch()
    first, first_log = start(KINDS[kind].format(path="a.sock"), LD_PRELOAD=str(library),
                             HOLD_LISTEN=str(hold))
    wait_until((tmp_path / "hold.held").exists, "the first between bind() and listen()")
    for _ in range(3):
        second, second_log = start(KINDS[kind].format(path="a.sock"))
        assert second.wait(TIMEOUT_S) == 1
        assert IN_USE in second_log.read_text()
    hold.unlink()
    assert settle(first, first_log)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM if kind == "control"
                       else socket.SOCK_SEQPACKET) as client:
        client.connect(str(tmp_path / "a.sock"))
    stop_canwired(first, first_log)
    assert sockets_and_locks(tmp_path) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.parametrize("kind", KINDS)
def test_a_signal_while_it_starts_is_seen_to_when_it_runs(kind, number, start, library, tmp_path):
    hold = tmp_path / "hold"
    hold.touch()
    process, log = start(KINDS[kind].format(path="a.sock"), LD_PRELOAD=str(library),
                         HOLD_LISTEN=str(hold))
    wait_until((tmp_path / "hold.held").exists, "the start between bind() and listen()")
    process.send_signal(number)
    hold.unlink()
    if number == signal.SIGHUP:
        wait_until(lambda: "configuration reloaded" in log.read_text()
                   or process.poll() is not None, "the reload")
        stop_canwired(process, log)
    assert process.wait(TIMEOUT_S) == 0
    assert "stopped: 0 frames" in log.read_text()
    assert sockets_and_locks(tmp_path) == []


@pytest.mark.parametrize("left", ["nothing", "a socket", "a socket and a lock"])
@pytest.mark.parametrize("kind", KINDS)
def test_of_four_that_start_at_once_one_runs(kind, left, start, tmp_path):
    for _ in range(ROUNDS):
        if left != "nothing":
            with socket.socket(socket.AF_UNIX) as gone:
                gone.bind(str(tmp_path / "a.sock"))
        if left == "a socket and a lock":
            (tmp_path / "a.sock.lock").touch(mode=0o600)
        all_four = [start(KINDS[kind].format(path="a.sock")) for _ in range(4)]
        up = [(process, log) for process, log in all_four if settle(process, log)]
        assert len(up) == 1
        for process, log in all_four:
            if process != up[0][0]:
                assert process.returncode == 1 and IN_USE in log.read_text()
        stop_canwired(*up[0])
        assert sockets_and_locks(tmp_path) == []


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_killed_one_leaves_is_no_hindrance(kind, start, tmp_path):
    for _ in range(2):
        process, log = start(KINDS[kind].format(path="a.sock"))
        assert settle(process, log)
        process.kill()
        process.wait()
        assert sockets_and_locks(tmp_path) == ["a.sock", "a.sock.lock"]
    process, log = start(KINDS[kind].format(path="a.sock"))
    assert settle(process, log)
    stop_canwired(process, log)
    assert sockets_and_locks(tmp_path) == []


def test_of_four_that_start_at_once_one_gets_all_ports(start, tmp_path):
    text = PORT.format(path="a.sock").replace("name: dash", 'name: dash, port: "unix:b.sock"')
    for _ in range(ROUNDS):
        all_four = [start(text) for _ in range(4)]
        up = [(process, log) for process, log in all_four if settle(process, log)]
        assert len(up) == 1
        stop_canwired(*up[0])
        assert sockets_and_locks(tmp_path) == []


@pytest.mark.parametrize("kind, socket_type", [("control", socket.SOCK_STREAM),
                                               ("port", socket.SOCK_SEQPACKET)])
def test_descriptors_that_are_sent_along_are_refused(kind, socket_type, start, tmp_path):
    process, log = start(KINDS[kind].format(path="a.sock"))
    assert settle(process, log)
    with socket.socket(socket.AF_UNIX, socket_type) as client:
        try:
            client.setsockopt(socket.SOL_SOCKET, SO_PASSRIGHTS, 1)
        except OSError:
            stop_canwired(process, log)
            pytest.skip("this kernel cannot refuse descriptors (Linux 6.16 can)")
        client.connect(str(tmp_path / "a.sock"))
        with pytest.raises(PermissionError):
            socket.send_fds(client, [b"x"], [0])
    stop_canwired(process, log)


def test_the_same_path_by_another_name_is_in_use(start, tmp_path):
    (tmp_path / "other").symlink_to(".")
    process, log = start(CONTROL.format(path="a.sock"))
    assert settle(process, log)
    second, second_log = start(CONTROL.format(path="other/a.sock"))
    assert second.wait(TIMEOUT_S) == 1 and IN_USE in second_log.read_text()
    third, third_log = start(PORT.format(path="a.sock"))
    assert third.wait(TIMEOUT_S) == 1 and IN_USE in third_log.read_text()
    stop_canwired(process, log)


def test_the_path_stays_taken_when_its_socket_is_removed_by_hand(start, tmp_path):
    process, log = start(CONTROL.format(path="a.sock"))
    assert settle(process, log)
    (tmp_path / "a.sock").unlink()
    second, second_log = start(CONTROL.format(path="a.sock"))
    assert second.wait(TIMEOUT_S) == 1 and IN_USE in second_log.read_text()
    stop_canwired(process, log)


# ---- Others who may write there ------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("link", ["a.sock", "a.sock.lock"])
def test_links_are_not_followed(kind, link, start, tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine\n")
    victim.chmod(0o600)
    for target in [victim, tmp_path / "nothing"]:
        (tmp_path / link).symlink_to(target)
        process, log = start(KINDS[kind].format(path="a.sock"))
        assert process.wait(TIMEOUT_S) == 1, log.read_text()
        assert (tmp_path / link).is_symlink()
        (tmp_path / link).unlink()
    assert victim.read_text() == "mine\n" and stat.S_IMODE(victim.stat().st_mode) == 0o600
    assert not (tmp_path / "nothing").exists()


needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files to any group")


@needs_root
@pytest.mark.parametrize("call", ["bind", "getgrnam"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_takes_the_place_of_the_socket_is_given_to_nobody(
        kind, call, start, library, tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine\n")
    process, log = start(KINDS[kind].format(path="a.sock"), LD_PRELOAD=str(library), SWAP_AT=call,
                         SWAP_PATH=str(tmp_path / "a.sock"), SWAP_TARGET=str(victim),
                         GROUP_ID=str(GROUP_ID))
    if settle(process, log):
        stop_canwired(process, log)
    else:
        assert "somebody else has changed the directory meanwhile" in log.read_text()
    assert victim.stat().st_gid == os.getegid()
    assert (tmp_path / "a.sock").is_symlink()


@needs_root
def test_the_socket_is_for_the_group(start, library, tmp_path):
    process, log = start(CONTROL.format(path="a.sock"), LD_PRELOAD=str(library),
                         GROUP_ID=str(GROUP_ID))
    assert settle(process, log)
    made = (tmp_path / "a.sock").stat()
    assert made.st_gid == GROUP_ID and stat.S_IMODE(made.st_mode) == 0o660
    stop_canwired(process, log)


SWAPPER = """
import os, sys
path, victim = sys.argv[1:]
print(flush=True)
while True:
    for act in (lambda: os.rename(path, path + ".stolen"), lambda: os.symlink(victim, path),
                lambda: os.unlink(path)):
        try:
            act()
        except OSError:
            pass
"""


@needs_root
def test_somebody_who_swaps_all_the_time_gets_nothing(start, library, tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine\n")
    with subprocess.Popen(["python3", "-c", SWAPPER, tmp_path / "a.sock", victim],
                          stdout=subprocess.PIPE) as swapper:
        swapper.stdout.readline()
        with contextlib.closing(swapper.stdout):
            for _ in range(30):
                process, log = start(CONTROL.format(path="a.sock"), LD_PRELOAD=str(library),
                                     GROUP_ID=str(GROUP_ID))
                if settle(process, log):
                    stop_canwired(process, log)
                assert victim.stat().st_gid == os.getegid()
            swapper.send_signal(signal.SIGKILL)


RECORD = CONTROL + "record: [ {{ file: rec/a.log, size: 64kB, files: 4 }} ]\n"
BUSY = "traffic: [ {{ send: 123#1122334455667788, every: 250us }} ]"


def test_a_recording_stays_in_its_folder(start, tmp_path):
    """Another folder takes the place of its own before it is rotated."""
    (tmp_path / "rec").mkdir()
    (tmp_path / "victim").mkdir()
    text = RECORD.replace("name: engine ", "name: engine, " + BUSY).format(path="a.sock")
    process, log = start(text)
    assert settle(process, log)
    (tmp_path / "rec").rename(tmp_path / "moved")
    (tmp_path / "rec").symlink_to("victim")
    wait_until((tmp_path / "moved/a.log.2").exists, "two rotations")
    stop_canwired(process, log)
    assert list((tmp_path / "victim").iterdir()) == []


# ---- Sockets of the service manager --------------------------------------------------------------

LAUNCH = """
import os, sys
os.dup2(int(sys.argv[1]), 3)
os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1", LISTEN_FDNAMES=sys.argv[2])
os.execv(sys.argv[3], sys.argv[3:])
"""


@pytest.fixture(name="activate")
def fixture_activate(tmp_path):
    """activate(text, listener) is a canwired that has got the socket as systemd passes it."""
    started = []

    def activate(text, listener, name="control"):
        (tmp_path / "bus.yaml").write_text(text)
        log = tmp_path / f"activated{len(started)}"
        with log.open("w") as errors:
            started.append(subprocess.Popen(
                ["python3", "-c", LAUNCH, str(listener.fileno()), name, CANWIRED, "-c", "bus.yaml"],
                cwd=tmp_path, stderr=errors, pass_fds=[listener.fileno()]))
        return started[-1], log

    yield activate
    kill_all(started)


def listen(path, kind=socket.SOCK_STREAM):
    listener = socket.socket(socket.AF_UNIX, kind)
    listener.bind(str(path))
    listener.listen()
    return listener


PEER = struct.Struct("3i")  # process, user, group
WITHOUT_CONTROL = CONTROL.replace("control: {path}\n", "")


@pytest.mark.parametrize("text", [CONTROL.format(path="a.sock"), WITHOUT_CONTROL.format()],
                         ids=["named", "not named"])
def test_a_socket_of_the_service_manager_is_the_control_socket(activate, text, tmp_path):
    with listen(tmp_path / "a.sock") as listener, socket.socket(socket.AF_UNIX) as early:
        early.connect(str(tmp_path / "a.sock"))  # before it is started
        early.sendall(b'{"request":"status"}\n')
        for _ in range(2):  # it is started, and later again
            process, log = activate(text, listener)
            assert settle(process, log), log.read_text()
            if early:
                early.settimeout(TIMEOUT_S)
                assert json.loads(early.makefile().readline())["ok"]
                early = None
            status = subprocess.run([CANWIRE, "status", "./a.sock", "--json"], cwd=tmp_path,
                                    capture_output=True, timeout=TIMEOUT_S, check=True).stdout
            assert json.loads(status)["bus"]["name"] == "day"
            with socket.socket(socket.AF_UNIX) as client:  # `canwire reload --pid` asks for that
                client.connect(str(tmp_path / "a.sock"))
                peer = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, PEER.size)
                assert PEER.unpack(peer)[0] == process.pid
            canwire("reload", "--config", "bus.yaml", "--pid", process.pid, cwd=tmp_path)
            assert "a socket of the service manager" in stop_canwired(process, log)
            assert sockets_and_locks(tmp_path) == ["a.sock"]


def test_what_the_service_manager_passes_must_fit(activate, tmp_path):
    with listen(tmp_path / "other.sock") as listener:
        process, log = activate(CONTROL.format(path="a.sock"), listener)
        assert process.wait(TIMEOUT_S) == 1
        assert "the service manager listens at" in log.read_text()
    with listen(tmp_path / "packets", socket.SOCK_SEQPACKET) as listener:
        process, log = activate(CONTROL.format(path="packets"), listener)
        assert process.wait(TIMEOUT_S) == 1
        assert "'control' is no Unix stream socket that listens" in log.read_text()


def test_a_socket_of_another_name_is_left_alone(activate, tmp_path):
    with listen(tmp_path / "other.sock") as listener:
        process, log = activate(CONTROL.format(path="a.sock"), listener, "something")
        assert settle(process, log)
        assert (tmp_path / "a.sock").exists()
        stop_canwired(process, log)


def test_an_activated_one_and_another_are_not_at_one_path(activate, start, tmp_path):
    with listen(tmp_path / "a.sock") as listener:
        process, log = activate(CONTROL.format(path="a.sock"), listener)
        assert settle(process, log)
        second, second_log = start(CONTROL.format(path="a.sock"), "second.yaml")
        assert second.wait(TIMEOUT_S) == 1 and IN_USE in second_log.read_text()
        third, third_log = activate(CONTROL.format(path="a.sock"), listener)
        assert third.wait(TIMEOUT_S) == 1 and IN_USE in third_log.read_text()
        stop_canwired(process, log)
