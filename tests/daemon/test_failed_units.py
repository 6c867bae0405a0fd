# SPDX-License-Identifier: MIT
"""`canwire status --check` names the failed units of systemd, here of a systemctl of the test.

CANWIRE and CANWIRED are the programs.
"""

import os
import re
import signal
import subprocess

import pytest

from simtool import CANWIRE, CANWIRED, kill_all
from test_record import wait_until

OK, _, CRITICAL, UNKNOWN = range(4)


def unit(name, active, sub, restarts=0, job=""):
    """As `systemctl show` has a unit; it sorts the properties in its own way."""
    return (f"NRestarts={restarts}\nId={name}.service\nActiveState={active}\nSubState={sub}\n"
            f"Job={job}\n")


FAILED = "\n".join((unit("canwired@night", "failed", "failed"),
                    unit("canwire-vcan@day-2", "failed", "failed")))
BUS = """bus: { name: day, bitrate: 500000 }
control: run/canwire/day.sock
nodes: [ { name: load, traffic: [ { send: 123#11, every: 10ms } ] }, { name: dash } ]
"""
MOUNTS = 'mount --bind run /run && exec "$@"'


class Machine:
    """A /run of its own, with a bus, and a systemctl."""

    def __init__(self, folder):
        self.folder, self.process = folder, None
        for name in "run/canwire", "run/systemd/system", "bin":
            (folder / name).mkdir(parents=True)
        self.systemctl("true")

    def start(self):
        (self.folder / "day.yaml").write_text(BUS)
        log = self.folder / "stderr"
        with log.open("w") as errors:
            self.process = subprocess.Popen([CANWIRED, "-c", "day.yaml"], cwd=self.folder,
                                            stderr=errors)
        wait_until(lambda: " bit/s, " in log.read_text(), "the bus")

    def systemctl(self, script):
        file = self.folder / "bin/systemctl"
        file.write_text(f'#!/bin/sh\necho "$@" >>"{self.folder}/asked"\n{script}\n')
        file.chmod(0o755)

    def fails(self, units=FAILED):
        (self.folder / "show").write_text(units)
        names = re.findall("^Id=(.*)$", units, re.MULTILINE)
        (self.folder / "list-units").write_text(
            "".join(f"{name} loaded failed failed CAN bus of virtual ECUs\n" for name in names))
        self.systemctl(f'echo noise >&2; cat "{self.folder}/$1"')

    def check(self, *words, **more):
        """Returns exit status and line; nothing else is said."""
        environment = {name: value for name, value in os.environ.items() if name != "CANWIRE_RUN"}
        environment["PATH"] = f"{self.folder}/bin:{environment['PATH']}"
        done = subprocess.run(
            ["unshare", "--map-root-user", "--mount", "sh", "-c", MOUNTS, "sh", CANWIRE, "status",
             "--check", "--wait", "0ms", *words], cwd=self.folder,
            env=environment | more.pop("env", {}), capture_output=True, text=True, timeout=60,
            check=False, **more)
        assert done.stderr == "" and done.stdout.count("\n") == 1, done
        return done.returncode, done.stdout.strip()

    def asked(self):
        file = self.folder / "asked"
        return file.read_text() if file.exists() else ""


@pytest.fixture(name="machine")
def fixture_machine(tmp_path):
    machine = Machine(tmp_path)
    yield machine
    kill_all([machine.process] if machine.process else [])


def test_failed_units_are_critical_beside_a_bus_that_is_well(machine):
    machine.start()
    status, line = machine.check()
    assert status == OK and line.startswith("CANWIRE OK - day: load ")
    asked = ("list-units --state=failed,activating,inactive --plain --no-legend --no-pager "
             "canwired@*.service canwire-vcan@*.service canwire-usb@*.service\n")
    assert machine.asked() == asked
    machine.fails()
    status, line = machine.check()
    assert status == CRITICAL and line.startswith("CANWIRE CRITICAL - day: load ")
    assert ("sinks; canwired@night.service has failed; canwire-vcan@day-2.service has failed "
            "| day_load=") in line
    assert machine.asked() == 2 * asked + (
        "show --property=Id,ActiveState,SubState,NRestarts,Job --no-pager canwired@night.service "
        "canwire-vcan@day-2.service\n")


def test_failed_units_where_no_bus_runs(machine):
    machine.fails()
    assert machine.check() == (
        CRITICAL, "CANWIRE CRITICAL - no bus runs in /run/canwire; canwired@night.service has "
        "failed; canwire-vcan@day-2.service has failed")


def test_where_no_bus_runs_without_a_failure_somebody_has_stopped_them(machine):
    assert machine.check() == (
        CRITICAL, "CANWIRE CRITICAL - no bus runs in /run/canwire; no unit has failed: they are "
        "stopped, or just start")
    status, line = machine.check("day")
    assert status == CRITICAL and line.endswith(
        "; canwired@day.service has not failed: it is stopped, or just starts")
    machine.fails(unit("canwired@day", "inactive", "dead"))
    assert machine.check("day") == (status, line)
    assert "failed" not in machine.check("./day.sock")[1]


@pytest.mark.parametrize("active, sub, restarts, job, told", [
    ("activating", "auto-restart", 0, "", True),
    ("activating", "auto-restart-queued", 7, "", True),
    ("inactive", "dead", 7, 123, True),
    ("activating", "start", 7, 123, True),
    ("activating", "start", 0, 123, False),
    ("inactive", "dead", 0, 123, False),
    ("inactive", "dead", 7, "", False),
    ("active", "running", 7, "", False),
    ("reloading", "reload", 7, 123, False),
    ("deactivating", "stop-sigterm", 7, 123, False),
])
def test_a_unit_that_is_tried_again_is_critical(machine, active, sub, restarts, job, told):
    """In all states that it goes through; one that starts for the first time, or that somebody has
    stopped, is not."""
    machine.start()
    machine.fails(unit("canwired@night", active, sub, restarts, job))
    status, line = machine.check()
    assert status == (CRITICAL if told else OK)
    assert ("; canwired@night.service has failed and is tried again | " in line) == told
    assert ("tried again" in machine.check("night")[1]) == told


def test_a_name_is_for_its_own_units_and_only_when_its_bus_is_not_there(machine):
    machine.fails()
    status, line = machine.check("night")
    assert status == CRITICAL and line.endswith("; canwired@night.service has failed")
    assert "day-2" not in line
    status, line = machine.check("day")
    assert status == CRITICAL and "canwired@day.service has not failed" in line
    machine.start()
    machine.fails(unit("canwired@day", "failed", "failed"))
    assert machine.check("day")[0] == OK


@pytest.mark.parametrize("script, why", [
    ("exit 3", "exit status 3"),
    ("kill -9 $$", "ended by signal 9"),
    ("exec sleep 1000", "no answer within 5 s"),
    ("exec sleep 1000 >&-", "no answer within 5 s"),
    ("test $1 = show && exit 4; echo canwired@night.service loaded", "exit status 4"),
], ids=["fails", "killed", "hangs", "hangs-silently", "fails-later"])
def test_without_an_answer_failed_units_are_not_known(machine, script, why):
    machine.start()
    machine.systemctl(script)
    status, line = machine.check()
    assert status == UNKNOWN
    assert f"; failed units are not known: systemctl: {why} | day_load=" in line
    assert machine.check("day")[0] == OK


def test_without_systemctl_failed_units_are_not_known(machine):
    machine.start()
    (machine.folder / "bin/systemctl").write_text("")
    (machine.folder / "bin/systemctl").chmod(0o644)
    bins = {"PATH": f"{machine.folder}/bin"}
    for name in "mount", "sh", "unshare":
        (machine.folder / "bin" / name).symlink_to(
            subprocess.run(["which", name], capture_output=True, text=True, check=True)
            .stdout.strip())
    status, line = machine.check(env=bins)
    assert status == UNKNOWN and "not known: systemctl: Permission denied" in line


def test_a_monitor_that_ignores_its_children(machine):
    machine.start()
    ignore = lambda: signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # noqa: E731
    assert machine.check(preexec_fn=ignore)[0] == OK


def test_nothing_is_asked_without_systemd_or_for_other_folders(machine):
    machine.start()
    machine.fails()
    elsewhere = {"CANWIRE_RUN": str(machine.folder / "run/canwire")}
    assert machine.check(env=elsewhere)[0] == OK
    (machine.folder / "run/systemd/system").rmdir()
    assert machine.check()[0] == OK
    assert machine.asked() == ""
