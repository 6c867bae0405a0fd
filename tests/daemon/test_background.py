# SPDX-License-Identifier: MIT
"""canwired --background comes back when the bus is ready, or says why there is none."""

import os
import signal
import subprocess

import pytest

from simtool import CANWIRED, TIMEOUT_S, canwire
from test_record import wait_until

BUS = """bus: { name: back, bitrate: 500000 }
control: back.sock
nodes:
  - { name: engine, port: "unix:engine.sock" }
  - { name: dash, traffic: [ { send: 123#, every: 1ms } ] }
"""


@pytest.fixture(name="folder")
def fixture_folder(tmp_path):
    (tmp_path / "back.yaml").write_text(BUS)
    return tmp_path


def start(folder, *words, status=0, **environment):
    """Returns what it printed and its messages, which still come when it is over."""
    with (folder / "log").open("w") as log:
        done = subprocess.run([CANWIRED, "-c", "back.yaml", "--background", *words], cwd=folder,
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True,
                              timeout=TIMEOUT_S, check=False, env={**os.environ, **environment})
    said = (folder / "log").read_text()
    assert done.returncode == status, said
    return done.stdout, said


def test_the_bus_is_ready_when_it_comes_back(folder):
    out, said = start(folder, "--journal", "back.journal")
    process = int(out)
    try:
        assert "back: 2 nodes at 500000 bit/s" in said
        assert (folder / "back.journal").exists()
        assert "1: engine" in canwire("status", "./back.sock", "--wait", "0", cwd=folder).stdout
        assert os.getsid(process) == process != os.getsid(0)
        for number in (0, 1):
            assert os.readlink(f"/proc/{process}/fd/{number}") == "/dev/null"
    finally:
        os.kill(process, signal.SIGTERM)
    wait_until(lambda: "stopped: " in (folder / "log").read_text(), "its end")


def test_what_is_wrong_is_told_with_its_status(folder):
    process = int(start(folder)[0])
    try:
        out, said = start(folder, status=1)
        assert out == "" and "in use; is another canwired running for this bus?" in said
    finally:
        os.kill(process, signal.SIGTERM)
    (folder / "back.yaml").write_text(BUS.replace("bitrate", "bitrat"))
    out, said = start(folder, status=1)
    assert out == "" and said.startswith("back.yaml:1:")


def test_a_child_that_is_killed_is_told(folder, tmp_path_factory):
    """A library kills it in its start, at the call of setsid()."""
    made = tmp_path_factory.mktemp("kill")
    (made / "kill.c").write_text("#include <signal.h>\nint setsid(void);\n"
                                 "int setsid(void) { return raise(SIGKILL); }\n")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", made / "kill.so", made / "kill.c"], check=True)
    out, said = start(folder, status=1, LD_PRELOAD=str(made / "kill.so"),
                      ASAN_OPTIONS="verify_asan_link_order=0")
    assert out == "" and "Killed (signal 9) before the bus was ready" in said


def test_a_number_that_cannot_be_written_is_told_and_ends_the_bus(folder):
    with (folder / "log").open("w") as log, open("/dev/full", "w", encoding="ascii") as full:
        done = subprocess.run([CANWIRED, "-c", "back.yaml", "--background"], cwd=folder,
                              stdin=subprocess.DEVNULL, stdout=full, stderr=log,
                              timeout=TIMEOUT_S, check=False)
    said = (folder / "log").read_text()
    assert done.returncode == 1 and "stopped: " in said
    assert "number of the process cannot be written: No space left on device" in said
    assert not (folder / "back.sock").exists()


PASS_ON = """
import os, sys
os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1")
os.dup2(int(sys.argv[1]), 3)
os.execv(sys.argv[2], sys.argv[2:])
"""


def test_sockets_that_were_passed_are_not_lost_silently(folder):
    words = [str(CANWIRED), "-c", "back.yaml", "--background"]
    done = subprocess.run(["python3", "-c", PASS_ON, "0", *words], cwd=folder, text=True,
                          capture_output=True, stdin=subprocess.DEVNULL, timeout=TIMEOUT_S,
                          check=False)
    assert done.returncode == 1 and "LISTEN_FDS are for this process alone" in done.stderr
