# SPDX-License-Identifier: MIT
"""LCM, recordings and the journal tell their state everywhere: to the service manager, in the
status as text and JSON.

CANWIRE and CANWIRED are the programs. A full disk is in tests/kernel/test_record.py.
"""

import json
import os
import re
import resource
import socket
import subprocess
import time

import pytest

from simtool import CANWIRED, answer, canwire, journal_text, kill_all, stop_canwired
from test_daemon import limit_files
from test_record import wait_until

PATIENCE_S = 60

BUS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes: [ { name: load, traffic: [ { send: 123#11, every: 10ms } ] }, { name: dash } ]
"""


class Bus:
    """A canwired with a service manager, which is this process."""

    def __init__(self, folder, more, *words, text=BUS):
        self.folder, self.log = folder, folder / "stderr"
        (folder / "day.yaml").write_text(text + more)
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.settimeout(PATIENCE_S)
        self.manager.bind(str(folder / "manager"))
        environment = dict(os.environ, NOTIFY_SOCKET=str(folder / "manager"))
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "day.yaml", *words], cwd=folder,
                                            stderr=log, env=environment)

    def line(self, *words):
        """Returns the first status line from now on that has all these texts."""
        while True:
            said = self.manager.recv(4096).decode()
            if said.startswith("STATUS=") and all(word in said for word in words):
                return said

    def canwire(self, *words, status=0):
        return answer(self.folder, *words, status=status)

    def json(self):
        return json.loads(self.canwire("status", "./day.sock", "--json"))

    def sinks(self):
        return {(s["kind"], s["name"].rsplit("/", 1)[-1]): s for s in self.json()["sinks"]}

    def stop(self):
        self.manager.close()
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="bus")
def fixture_bus(tmp_path):
    started = []

    def start(more, *words, **changes):
        started.append(Bus(tmp_path, more, *words, **changes))
        return started[-1]

    yield start
    kill_all(each.process for each in started)


def test_each_sink_is_named_with_its_state(bus):
    with socket.socket() as nobody:  # has the port, and does not listen
        nobody.bind(("127.0.0.1", 0))
        url = f"tcpq://127.0.0.1:{nobody.getsockname()[1]}"
        running = bus(f'lcm: {{ url: "{url}" }}\nrecord: [ {{ file: a.log }} ]\n',
                      "--journal", "day.journal")
        line = running.line("lcm ", "failing")
        assert f", lcm {url} failing: Connection refused" in line
        assert ", record a.log recording, journal day.journal writing" in line
        running.line("lcm ", " lost")
        sinks = running.sinks()
        lcm = sinks["lcm", url.rsplit("/", 1)[-1]]
        assert (lcm["state"], lcm["good"], lcm["written"]) == ("failing", False, 0)
        assert lcm["lost"] > 0 and lcm["why"] == "Connection refused"
        assert sinks["record", "a.log"]["good"] and sinks["record", "a.log"]["written"] > 0
        assert sinks["journal", "day.journal"]["state"] == "writing"
        wait_until(lambda: running.sinks()["journal", "day.journal"]["bytes"] > 0, "its bytes")
        text = running.canwire("status", "./day.sock")
        assert f"\nlcm {url}: failing: Connection refused messages 0 lost " in text
        assert "\nrecord a.log: recording entries " in text
        assert "\njournal day.journal: writing lines " in text
        running.stop()


def test_lcm_is_tried_again_more_and_more_rarely_and_in_silence(bus):
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        server.settimeout(60)
        port = server.getsockname()[1]
        running = bus(f'lcm: {{ url: "tcpq://127.0.0.1:{port}" }}\n')
        tried = []
        for _ in range(4):
            with server.accept()[0]:
                tried.append(time.monotonic())
        assert tried[2] - tried[1] > 1.9 and tried[3] - tried[2] > 3.9
        log = running.stop()
    assert log.count("connecting...") <= 2, "liblcm tells of its start and the first message alone"
    assert log.count("messages cannot be sent and are lost") == 1


def test_a_server_without_a_route_needs_no_multicast(bus):
    """No TCP connection goes to that address."""
    running = bus('lcm: { url: "tcpq://255.255.255.255:7700" }\n')
    running.line("lcm ", "failing: Network is unreachable")  # liblcm's own words come at the start
    wait_until(lambda: "are lost" in running.log.read_text(), "the warning")
    log = running.stop()
    assert "are lost: Network is unreachable\n" in log and "ip route" not in log


def test_a_journal_that_somebody_takes_away_is_told(bus, tmp_path):
    running = bus("", "--journal", "day.journal")
    assert ", journal day.journal writing" in running.line("journal")
    (tmp_path / "day.journal").rename(tmp_path / "old.journal")
    running.line(", journal day.journal renamed")
    sink = running.sinks()["journal", "day.journal"]
    assert (sink["state"], sink["good"]) == ("renamed", False)
    assert sink["why"] == "what is written goes on there; a restart begins another"
    assert running.stop().count("somebody has renamed the file") == 1
    assert '"end":' in journal_text(tmp_path / "old.journal").splitlines()[-1]


def test_what_a_stopped_recording_leaves_out_is_lost(bus, tmp_path):
    """Also what waited for the disk when it stopped, and over its next beginning."""
    running = bus("record: [ { file: a.log } ]\n",
                  text=BUS.replace("every: 10ms", "every: 500us, count: 4000"))
    running.line("record a.log recording")
    limit_files(running.process, 8192)
    running.line("record a.log stopped")
    limit_files(running.process, resource.RLIM_INFINITY)
    running.canwire("reload", "./day.sock")
    running.line("record a.log recording")
    wait_until(lambda: running.json()["bus"]["frames"] == 4000, "all frames")
    sink = running.sinks()["record", "a.log"]
    assert sink["written"] + sink["lost"] == 4000 and sink["lost"] > 0
    assert re.search(r"record a\.log: begun again, without \d+ entries that came before\n",
                     running.stop())
    assert sum(len(file.read_text().splitlines()) for file in tmp_path.glob("a.log*")) == \
        sink["written"]


def test_lcm_counts_what_it_sends_and_is_blocked_by_a_server_that_stalls(bus):
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        port = server.getsockname()[1]
        running = bus(f'lcm: {{ url: "tcpq://127.0.0.1:{port}", events: [rx, tx] }}\n',
                      text=BUS.replace("10ms", "250us"))
        with server.accept()[0] as stalls:
            stalls.sendall(bytes.fromhex("287617fa00000100"))  # the server's part of the greeting
            running.line(f", lcm tcpq://127.0.0.1:{port} sending")
            wait_until(lambda: running.sinks()["lcm", f"127.0.0.1:{port}"]["written"] > 0,
                       "messages")
            assert ", lcm " in running.line("blocked: nobody takes the messages, ", " lost")
        running.stop()


def test_a_server_that_never_answers_is_in_trouble(bus, tmp_path):
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        port = server.getsockname()[1]
        running = bus(f'lcm: {{ url: "tcpq://127.0.0.1:{port}" }}\n')
        running.line(f", lcm tcpq://127.0.0.1:{port} starting")
        with server.accept()[0]:
            trouble = f"lcm tcpq://127.0.0.1:{port} blocked: the server does not answer"
            running.line(f", {trouble}")
            sink = running.sinks()["lcm", f"127.0.0.1:{port}"]
            assert (sink["state"], sink["good"]) == ("blocked", False)
            assert sink["why"] == "the server does not answer"
            assert f"\n{trouble.replace(' blocked', ': blocked')}" in running.canwire(
                "status", "./day.sock")
            done = canwire("status", "./day.sock", "--check", status=1, cwd=tmp_path)
            assert trouble in done.stdout
        running.stop()
