# SPDX-License-Identifier: MIT
"""Programs for ARM64 on a bus for ARM64, in the emulator of user programs (`make test-arm64`).

`canwire run` gives them its library, which the emulated dynamic linker loads. tests/daemon also
runs with the emulated canwired.
"""

import os
import re
import shlex
import subprocess
import zipfile
from pathlib import Path

import pytest

from simtool import ROOT

RUN, SYSTEM = shlex.split(os.environ["ARM64_RUN"]), Path(os.environ["ARM64_ROOT"])
PYTHON = next((SYSTEM / "usr/bin").glob("python3.*[0-9]"))
# The emulator does not bring the kernel's times of messages to a program.
TIMELESS = [(r"bytes, now", "bytes, never"), (r"(&(?:stamp|nano)\) +)ok", r"\1ENOENT"),
            (r"(_s\(\)\) < 1000 +)1 ok", r"\g<1>0 ok")]
SOCKETS = """
import socket, struct, sys
bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
bus.bind(("can0",))
frame = struct.Struct("=IB3x8s")
number, size, data = frame.unpack(bus.recv(16))
bus.send(frame.pack(number + 1, size, data[::-1]))
print(hex(number), size, data)
"""
WHEEL = """
import canwire, platform
bus = canwire.Bus.from_dict({"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}, {"name": "b"}]})
bus.send("a", "123#11")
print(platform.machine(), bus.recv("b", "1s"), bus.run(), bus.stats()["bus"]["frames"])
"""


@pytest.fixture(name="starter")
def fixture_starter(tmp_path):
    """starter(PROGRAM) is a script that starts a program for ARM64."""
    def make(program):
        path = tmp_path / f"start-{program.name}"
        path.write_text(f"#!/bin/busybox sh\nexec {shlex.join(RUN)} {program} \"$@\"\n")
        path.chmod(0o755)
        return path
    return make


def test_the_calls_of_socketcan_give_what_they_give_here(bus, calls):
    expected = (ROOT / "tests/preload/calls.expected").read_text()
    for here, emulated in TIMELESS:
        expected, count = re.subn(here, emulated, expected)
        assert count > 0
    r = bus(bus=", dbitrate: 2000000")
    assert r.run("engine=can0", calls, "can0").stdout == expected
    r.stop()


def test_can_utils_talk(bus, starter):
    r = bus()
    dump = r.begin("dash=can0", starter(SYSTEM / "usr/bin/candump"), "-L", "-n", "2", "can0")
    r.wait_for_clients("dash", 1)
    for frame in ("123#DEADBEEF", "1ABCDEF0#R"):
        r.run("engine=can1", starter(SYSTEM / "usr/bin/cansend"), "can1", frame)
    lines = [line.split(" ", 1)[1] for line in dump.communicate()[0].splitlines()]
    assert lines == ["can0 123#DEADBEEF", "can0 1ABCDEF0#R"]
    r.stop()


def test_a_program_in_python_talks(bus, starter):
    r = bus()
    program = r.begin("dash=can0", starter(PYTHON), "-c", SOCKETS)
    r.wait_for_clients("dash", 1)
    engine = r.client("engine")
    engine.send(0x123, b"\1\2\3")
    got = engine.receive()
    assert (got.can_id, got.data) == (0x124, b"\0\0\0")
    assert program.communicate()[0] == "0x123 3 b'\\x01\\x02\\x03\\x00\\x00\\x00\\x00\\x00'\n"


def test_the_wheel_works(tmp_path):
    subprocess.run(["make", "-s", "ARCH=arm64", "LTO=no", "build/arm64/wheel/libcanwire-sim.so"],
                   cwd=ROOT, check=True)
    done = subprocess.run([ROOT / "scripts/wheel", "build/arm64/wheel/libcanwire-sim.so", tmp_path],
                          cwd=ROOT, check=True, capture_output=True, text=True,
                          env={**os.environ, "CC": os.environ["ARM64_CC"]})
    wheel = Path(done.stdout.split()[0])
    assert wheel.match("canwire-*-py3-none-manylinux_2_*_aarch64.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(tmp_path / "site")
        assert {"canwire/libyaml-0.so.2", "canwire/libjansson.so.4"} <= set(packed.namelist())
    environment = {key: value for key, value in os.environ.items()
                   if key != "CANWIRE_SIM_LIBRARY"}
    done = subprocess.run([*RUN, PYTHON, "-c", WHEEL], capture_output=True, text=True, check=True,
                          env={**environment, "PYTHONPATH": str(tmp_path / "site")})
    assert done.stdout == "aarch64 123#11 Stop.END 1\n"
