# SPDX-License-Identifier: MIT
"""Messages to systemd's journal: as fields, counted when it does not take them, never in the way.

That systemd reads them so is tested in tests/systemd; here the other end of the socket is ours.
"""

import re
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from conftest import CANWIRED, PATIENCE_S, wait_until

JOURNAL = Path("/run/systemd/journal/socket")
BUS = """
bus: { name: told, bitrate: 500000 }
nodes: [ { name: a, port: vcan0 }, { name: b } ]
"""
# as systemd does: the variable names the file of standard error
AS_SERVICE = ["sh", "-c", 'JOURNAL_STREAM=$(stat -Lc %d:%i /proc/self/fd/2) exec "$@"', "sh"]


@pytest.fixture(name="journal")
def fixture_journal():
    JOURNAL.parent.mkdir(parents=True, exist_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(JOURNAL))
        end.settimeout(PATIENCE_S)
        try:
            yield end
        finally:
            JOURNAL.unlink(missing_ok=True)


def record(journal):
    """Returns the next message, by field."""
    lines = journal.recv(65536).decode().splitlines()  # whole: a datagram
    return dict(line.split("=", 1) for line in lines)


def refuse_a_reload(daemon):
    """Checks for one error and 'nothing was changed'."""
    daemon.notifications.clear()
    daemon.process.send_signal(signal.SIGHUP)
    wait_until(lambda: daemon.notified("READY=1"), "the end of the reload")


def test_fields_of_a_message(vcan, canwired, journal):
    vcan(1)
    daemon = canwired(BUS, before=AS_SERVICE)
    first = record(journal)
    assert first == {"MESSAGE": "told: 2 nodes at 500000 bit/s, classical CAN", "PRIORITY": "6",
                     "SYSLOG_IDENTIFIER": "canwired", "CANWIRE_BUS": "told"}
    daemon.config.write_text(BUS.replace("500000", "5"))
    refuse_a_reload(daemon)
    error, end = record(journal), record(journal)
    assert error["PRIORITY"] == "3" and "bus.yaml:2:" in error["MESSAGE"]
    assert end["MESSAGE"] == "reload: nothing was changed"
    assert daemon.stop() == ""
    assert record(journal)["MESSAGE"].startswith("stopped: ")


def waits_or_has_ended(process):
    """Returns "Z" after its end, "nanosleep" when it sleeps."""
    folder = Path(f"/proc/{process.pid}")
    state = folder.joinpath("stat").read_text().rsplit(")", maxsplit=1)[1].split()[0]
    return state if state == "Z" else re.search("nanosleep|$", (folder / "wchan").read_text())[0]


def test_the_journal_finds_the_process_of_the_last_message(journal, tmp_path):
    """It looks for its unit in /proc."""
    config = tmp_path / "bus.yaml"
    config.write_text(BUS.replace("500000", "5"))
    with subprocess.Popen([*AS_SERVICE, CANWIRED, "-c", config], stderr=subprocess.PIPE) as daemon:
        journal.recv(1, socket.MSG_PEEK)  # whole: it is there, and not read
        assert wait_until(lambda: waits_or_has_ended(daemon), "either") == "nanosleep"
        assert "bitrate: expected" in record(journal)["MESSAGE"]
        assert daemon.wait(PATIENCE_S) == 1


def test_a_journal_that_takes_nothing_is_told_how_much_it_lacks(vcan, canwired, journal):
    vcan(1)
    daemon = canwired(BUS, before=AS_SERVICE)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as crowd:
        with pytest.raises(BlockingIOError):
            while True:
                crowd.sendto(b"MESSAGE=crowd\n", str(JOURNAL))
    daemon.config.write_text(BUS.replace("500000", "5"))
    refuse_a_reload(daemon)  # two messages: nothing waits for them
    while record(journal)["MESSAGE"] != "crowd":
        pass
    journal.setblocking(False)
    with pytest.raises(BlockingIOError):
        while True:
            assert record(journal)["MESSAGE"] == "crowd"
    journal.settimeout(PATIENCE_S)
    refuse_a_reload(daemon)
    told = [record(journal) for _ in range(3)]
    assert told[0]["PRIORITY"] == "4"
    lost = int(told[0]["MESSAGE"].split()[0])
    assert told[0]["MESSAGE"] == f"{lost} messages lost, the journal did not take them"
    assert lost >= 2
    assert "bus.yaml:2:" in told[1]["MESSAGE"]
    assert told[2]["MESSAGE"] == "reload: nothing was changed"
    assert daemon.stop() == ""


def test_without_the_journal_standard_error_has_the_priority(vcan, canwired):
    vcan(1)
    assert not JOURNAL.exists()
    text = canwired(BUS, before=AS_SERVICE).stop()
    assert text.splitlines()[0] == "<6>told: 2 nodes at 500000 bit/s, classical CAN"
    assert text.splitlines()[-1].startswith("<6>stopped: ")
