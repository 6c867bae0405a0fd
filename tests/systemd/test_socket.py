# SPDX-License-Identifier: MIT
"""The control socket as a unit of its own, and the limits of a bus, under a real systemd."""

import grp
import json
import os
import pwd
import socket
import stat
from pathlib import Path

import pytest

from conftest import PATIENCE_S, Bus, run, systemctl, wait_until

SOCKET = Path("/run/canwire/early.sock")
NODES, CLIENTS, RECORDS = 64, 40, 16


pytestmark = pytest.mark.usefixtures("installed")


@pytest.fixture(name="early")
def fixture_early():
    bus = Bus("early", "bus: { name: early, bitrate: 500000 }\n"
              f"control: {SOCKET}\n" "nodes: [ { name: a }, { name: b } ]\n")
    systemctl("start", "canwired@early.socket")
    yield bus
    systemctl("stop", "canwired@early.socket")
    bus.close()


def ask(client):
    client.sendall(b'{"request":"status"}\n')
    return json.loads(client.makefile().readline())


def connect(path=SOCKET):
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(PATIENCE_S)
    client.connect(str(path))
    return client


def test_a_client_starts_the_bus(early):
    assert early.show("ActiveState") == "inactive"
    made = SOCKET.stat()
    assert stat.S_IMODE(made.st_mode) == 0o660
    assert (made.st_uid, made.st_gid) == (pwd.getpwnam("canwire").pw_uid,
                                          grp.getgrnam("canwire").gr_gid)
    with connect() as client:
        assert ask(client)["status"]["bus"]["name"] == "early"
    assert early.show("ActiveState") == "active"
    assert SOCKET.stat().st_ino == made.st_ino
    # it ends and leaves the socket, and another client starts it again
    first = early.pid()
    systemctl("stop", early.unit)
    assert SOCKET.stat().st_ino == made.st_ino
    assert not SOCKET.with_name("early.sock.lock").exists()
    with connect() as client:
        assert ask(client)["ok"]
    assert early.pid() not in (0, first)
    assert any("a socket of the service manager" in m["MESSAGE"] for m in early.messages())


@pytest.mark.deep
def test_a_reload_by_the_service_manager_goes_by_that_socket(early):
    systemctl("start", early.unit)
    text = early.config.read_text().replace("{ name: b }", "{ name: b }, { name: c }")
    early.config.write_text(text)
    systemctl("reload", early.unit)
    wait_until(lambda: len(early.status()["nodes"]) == 3, "the third node")


def test_the_socket_goes_with_its_unit(early):
    """So does a bus that has it: nobody could speak to that."""
    systemctl("start", early.unit)
    systemctl("stop", "canwired@early.socket")
    wait_until(lambda: early.show("ActiveState") == "inactive", "the end of the bus")
    assert not SOCKET.exists()
    systemctl("start", early.unit)  # it makes its own
    assert early.status()["bus"]["name"] == "early"
    systemctl("stop", early.unit)
    assert not SOCKET.exists()


def largest():
    nodes = "".join(f'  - {{ name: n{i}, port: "unix:/run/canwire/n{i}" }}\n' for i in range(NODES))
    records = "".join(f"  - {{ file: /var/lib/canwire/r{i}.log }}\n" for i in range(RECORDS))
    return ("bus: { name: largest, bitrate: 1000000 }\ncontrol: /run/canwire/largest.sock\n"
            f"nodes:\n{nodes}record:\n{records}")


def test_the_largest_bus_is_within_its_limits():
    bus = Bus("largest", largest())
    try:
        bus.start()
        shown = {name: bus.show(name) for name in ("MemoryMax", "TasksMax", "LimitNOFILE")}
        assert shown == {"MemoryMax": str(2 << 30), "TasksMax": "512", "LimitNOFILE": "8192"}
        limits = Path(f"/proc/{bus.pid()}/limits").read_text()
        assert any(line.split()[:5] == ["Max", "open", "files", "8192", "8192"]
                   for line in limits.splitlines())
        clients = [connect(bus.socket) for _ in range(CLIENTS)]
        ecus = []
        for i in range(NODES):
            ecus.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            ecus[-1].connect(f"/run/canwire/n{i}")
        assert all(ask(client)["ok"] for client in clients)
        status = bus.status()
        assert [r["state"] for r in status["recordings"]] == ["recording"] * RECORDS
        assert len(os.listdir(f"/proc/{bus.pid()}/fd")) < 600
        assert len(os.listdir(f"/proc/{bus.pid()}/task")) < 64
        for each in clients + ecus:
            each.close()
    finally:
        bus.close()
