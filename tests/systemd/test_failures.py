# SPDX-License-Identifier: MIT
"""Failures of the service as an administrator sees them, and its shipped examples."""

import contextlib
import json
import re
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path

import pytest

from conftest import (PAIR, PATIENCE_S, ROOT, Bus, Frame, can_socket, checked, links, run,
                      systemctl, wait_until)
from readme import SYSTEM, Reader, blocks_of, build_sudo
from scrape import ask

CONFIGS = Path("/etc/canwire")
EXAMPLES = Path("/usr/local/share/doc/canwire/examples")


pytestmark = pytest.mark.usefixtures("installed")


@pytest.fixture(name="new")
def fixture_new():
    """new(NAME, change) is a bus that has not been started."""
    buses = []

    def make(name, change=lambda text: text):
        buses.append(Bus(name, change(PAIR.format(name))))
        return buses[-1]

    yield make
    for bus in buses:
        bus.close()


def told(bus, part):
    return [m["MESSAGE"] for m in bus.messages() if part in m["MESSAGE"]]


def failed_units():
    return {line.split()[0] for line in
            systemctl("--failed", "--plain", "--no-legend").splitlines()}


# ---- A unit that fails ---------------------------------------------------------------------------


def test_a_bus_that_ends_with_a_failed_expectation_is_failed(new):
    """However it is stopped, it is not started again."""
    bus = new("judge", lambda text: text + "expect-report: /var/lib/canwire/judge.xml\n"
                                           "expect: [ { name: silent, seen: never } ]\n")
    for stop in (("stop", bus.unit), ("kill", "--signal=SIGTERM", bus.unit)):
        bus.start()
        assert bus.carries()
        wait_until(lambda: "1 expectation failed" in bus.show("StatusText"), "the verdict")
        systemctl(*stop)
        wait_until(lambda: bus.show("ActiveState") == "failed", "the end")
        assert (bus.show("Result"), bus.show("ExecMainStatus")) == ("exit-code", "3")
        assert bus.show("NRestarts") == "0"
        assert bus.show("StatusText").startswith("expectation failed at ")
        assert 'failures="1"' in Path("/var/lib/canwire/judge.xml").read_text()
    [first, _] = told(bus, "expectation failed")
    assert ": silent: wanted no frame, got one at " in first
    systemctl("reset-failed", bus.unit)


def test_a_bad_configuration_fails_at_once_and_shows(new):
    bus = new("bad", lambda text: text.replace("500000", "500k"))
    assert "failed" in systemctl("start", bus.unit, status=1)
    assert bus.show("ActiveState") == "failed" and bus.show("NRestarts") == "0"
    assert (bus.show("Result"), bus.show("ExecMainStatus")) == ("exit-code", "1")
    assert bus.unit in failed_units()
    assert bus.show("StatusText") == (
        f"{bus.config}:2:28: bitrate: expected a decimal integer 5000..1000000, not '500k' "
        "(write 500000)")
    bus.config.write_text(PAIR.format("bad"))
    bus.start()
    assert bus.carries() and bus.unit not in failed_units()


def test_monitoring_names_failed_units(new):
    """Beside a bus that is well, and with the name of a bus that is not there."""
    good, bad = new("good"), new("bad", lambda text: text.replace("500000", "500k"))
    systemctl("reset-failed")  # some may be left by other tests
    good.start()
    assert checked().startswith("CANWIRE OK - ")
    systemctl("start", bad.unit, status=1)
    line = checked(status=2)
    assert line.startswith("CANWIRE CRITICAL - good: load ") and f"; {bad.unit} has failed" in line
    line = checked("bad", "--wait", "0ms", status=2)
    assert f"; {bad.unit} has failed" in line
    assert checked("good").startswith("CANWIRE OK - ")


def test_a_real_can0_that_is_missing_is_waited_for(new):
    bus = new("mp", lambda text: text.replace("port: mp1", "port: can0") + "missing-port: wait\n")
    bus.start()
    assert "mp0" in links() and "can0" not in links()
    assert systemctl("show", "-P", "ActiveState", bus.vcan_unit).strip() == "active"
    assert "b link missing" in checked("mp", status=1)


def test_a_path_that_can_never_be_made_fails_at_once(new):
    bus = new("never", lambda text: text + "record: [ { file: /etc/canwire/never.log } ]\n")
    assert "failed" in systemctl("start", bus.unit, status=1)
    assert bus.show("ExecMainStatus") == "1"
    assert bus.show("ActiveState") == "failed" and bus.unit in failed_units()
    assert "Read-only file system" in bus.show("StatusText")


@contextlib.contextmanager
def mounted(folder):
    run("mount", "-t", "tmpfs", "-o", "mode=777", "tmpfs", folder)
    try:
        yield
    finally:
        run("umount", "--lazy", folder)


@pytest.mark.parametrize("folder, good", [("/var/lib/canwire/disk", True), ("/srv/disk", False)])
def test_a_reload_judges_a_disk_that_is_mounted_meanwhile_as_a_start_does(new, folder, good):
    """The sandbox makes all others read-only at the next start."""
    bus, folder = new("disk"), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    run("mount", "--make-rshared", "/")  # as systemd has it on a machine, though not in the guest
    bus.start()
    with mounted(folder):
        bus.config.write_text(PAIR.format("disk") + f"record: [ {{ file: {folder}/a.log }} ]\n")
        for action in "reload", "restart":
            systemctl(action, bus.unit, status=int(not good))
            wait_until(lambda: good or "Read-only file system" in bus.show("StatusText"),
                       "the refusal")
            assert (folder / "a.log").exists() == good
        systemctl("stop", bus.unit)


@pytest.mark.deep
def test_a_port_that_is_missing_is_tried_again(new):
    """Its interface needs a namespace that is not there yet."""
    bus = new("late", lambda text: text.replace(
        "port: late1", "port: late1, peer: { name: can0, netns: later }"))
    assert "failed" in systemctl("start", bus.unit, status=1)
    wait_until(lambda: int(bus.show("NRestarts")) > 0, "another try")
    assert bus.show("ActiveState") in ("activating", "inactive")
    assert bus.unit not in failed_units()
    line = checked(status=2)
    assert f"{bus.unit} has failed and is tried again" in line
    wait_until(lambda: bus.show("ExecMainStatus") == "75", "an end")
    why = re.compile(r"(Trying again after: )?/etc/canwire/late\.yaml:[56]:\d+: node [ab]: port "
                     r"late[01]: No such device \(canwire vcan up FILE makes it\)")
    wait_until(lambda: (found := why.fullmatch(bus.show("StatusText"))) and found[1],
               "the reason during the next try")
    wait_until(lambda: (found := why.fullmatch(bus.show("StatusText"))) and not found[1],
               "the reason after it")
    run("ip", "netns", "add", "later")
    try:
        wait_until(lambda: bus.show("ActiveState") == "active", "the bus")
    finally:
        systemctl("stop", bus.unit, bus.vcan_unit)
        run("ip", "netns", "del", "later")


def test_clients_of_a_bad_bus_get_the_reason(new):
    """systemd's socket would start it again and again for a client that waits."""
    bus = new("early", lambda text: text.replace("500000", "fast"))
    systemctl("start", "canwired@early.socket")
    try:
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(PATIENCE_S)
            client.connect(str(bus.socket))
            reply = json.loads(client.makefile().readline())
        assert not reply["ok"] and reply["error"].startswith(f"{bus.config}:2:30: bitrate: ")
        wait_until(lambda: bus.show("ActiveState") == "failed", "its end")
        assert systemctl("is-active", "canwired@early.socket").strip() == "active"
    finally:
        systemctl("stop", "canwired@early.socket")


# ---- What the unit keeps from a bus --------------------------------------------------------------


@pytest.mark.deep
def test_files_that_the_service_does_not_see_are_told(new):
    bus = new("hidden", lambda text: text + "record: [ { file: /tmp/hidden.log } ]\n")
    bus.start()
    warning, = told(bus, "the service has a /tmp of its own")
    assert warning.startswith(f"{bus.config}:7:19: record: /tmp/hidden.log: ")
    assert not Path("/tmp/hidden.log").exists()
    for path, hint in (("/home/hidden.log", "(the service does not see /home)"),
                       ("/tmp/drive.log", "(the service has a /tmp of its own)"),
                       ("/etc/canwire/none.log", "No such file or directory")):
        bus.config.write_text(PAIR.format("hidden") +
                              f"  - {{ name: c, traffic: [ {{ replay: {path} }} ] }}\n")
        systemctl("restart", bus.unit, status=1)
        assert bus.show("StatusText").endswith(hint)
    bus.config.write_text(PAIR.format("hidden") + "record: [ { file: hidden.log } ]\n")
    systemctl("restart", bus.unit, status=1)
    assert told(bus, "(the service may write to /run/canwire and /var/lib/canwire)")


@pytest.mark.deep
def test_who_reads_a_file_is_told(new):
    bus = new("secret")
    bus.config.chmod(0o600)
    systemctl("start", bus.unit, status=1)
    assert bus.show("StatusText") == f"{bus.config}: Permission denied (as the user canwire)"
    assert bus.show("ActiveState") == "failed"
    shutil.chown(bus.config, group="canwire")
    bus.config.chmod(0o640)
    bus.start()


@pytest.mark.deep
def test_other_hosts_that_do_not_get_through_are_told(new):
    bus = new("guests", lambda text: text.replace("port: guests1", 'port: "tcp:0.0.0.0:29999"'))
    run("ip", "address", "add", "192.0.2.7/32", "dev", "lo")
    try:
        bus.start()
        command, = re.findall(r"sudo (systemctl set-property \S+ IPAddressAllow=\S+)",
                              "".join(told(bus, "IPAddressDeny=")))
        assert command.split()[2] == bus.unit
        assert command.endswith("IPAddressAllow=192.0.2.7/32"), "the network that this host is in"
        run(*command.split())
        systemctl("restart", bus.unit)
        assert len(told(bus, "IPAddressDeny=")) == 1
        with socket.create_connection(("192.0.2.7", 29999), timeout=PATIENCE_S) as client:
            assert client.makefile("rb").read(6) == b"< hi >"
    finally:
        systemctl("revert", bus.unit)
        run("ip", "address", "del", "192.0.2.7/32", "dev", "lo")


@pytest.mark.deep
def test_hosts_that_get_through_later_are_not_warned_of(new):
    """The machine is in no network when the bus starts."""
    bus = new("later", lambda text: text.replace("port: later1", 'port: "tcp:0.0.0.0:29998"'))
    try:
        bus.start()
        text, = told(bus, "IPAddressDeny=")
        assert "IPAddressAllow=192.168.0.0/16 or whatever" in text
        systemctl("set-property", bus.unit, "IPAddressAllow=192.168.0.0/16")
        systemctl("restart", bus.unit)
        assert len(told(bus, "IPAddressDeny=")) == 1
        bus.config.write_text(bus.config.read_text().replace("tcp:0.0.0.0:29998",
            "cannelloni:udp,listen=0.0.0.0:29998,peer=203.0.113.7:29998"))
        systemctl("restart", bus.unit)
        assert told(bus, "IPAddressDeny=")[1:], "not its network"
        systemctl("set-property", bus.unit, "IPAddressAllow=203.0.113.0/24")
        systemctl("restart", bus.unit)
        assert len(told(bus, "IPAddressDeny=")) == 2
    finally:
        systemctl("revert", bus.unit)


def test_programs_of_this_machine_read_metrics(new):
    """The unit lets the service listen at 127.0.0.1, and at the folder of its sockets."""
    bus = new("metered", lambda text: text + "metrics: 29464\n")
    bus.start()
    assert told(bus, "IPAddressDeny=") == []
    assert 'canwire_bus_frames_total{bus="metered"}' in ask(("127.0.0.1", 29464)).body
    bus.config.write_text(bus.config.read_text().replace(
        "metrics: 29464", "metrics: unix:/run/canwire/metered.metrics"))
    systemctl("reload", bus.unit)
    assert ask(Path("/run/canwire/metered.metrics")).status == 200
    systemctl("stop", bus.unit)


# ---- Several units -------------------------------------------------------------------------------


@pytest.mark.deep
def test_two_buses_of_one_name_are_told(new):
    first, second = new("first"), new("second", lambda text: text.replace("name: second",
                                                                          "name: first"))
    first.start()
    second.start()
    assert told(first, "of the same name") == []
    assert told(second, f"canwired@first, pid {first.pid()}, runs a bus of the same name, first: ")
    systemctl("stop", first.unit)
    systemctl("restart", second.unit)
    assert len(told(second, "of the same name")) == 1


@pytest.mark.deep
def test_interfaces_of_a_running_bus_stay(new):
    def share(text):
        return text.replace("using0", "made0").replace("using1", "made1")

    maker, user = new("made"), new("using", share)
    maker.start()
    systemctl("stop", maker.unit)
    user.start()
    systemctl("stop", maker.vcan_unit)
    assert {"made0", "made1"} <= links() and maker.carries()
    run("journalctl", "--sync")
    journal = run("journalctl", "-u", maker.vcan_unit, "-o", "cat")
    assert (f"made0 stays: it is in use by bus using of canwired, pid {user.pid()}: "
            "stop it first\n") in journal
    assert maker.vcan_unit in failed_units()
    systemctl("stop", user.unit)
    systemctl("reset-failed", maker.vcan_unit)
    run("canwire", "vcan", "down", maker.config)
    assert not {"made0", "made1"} & links()


def test_who_stops_the_interfaces_stops_the_bus_first(new):
    bus = new("under")
    bus.start()
    pid = bus.pid()
    systemctl("restart", bus.vcan_unit)
    wait_until(lambda: bus.pid() not in (0, pid) and bus.show("ActiveState") == "active",
               "the restart")
    assert bus.carries()
    systemctl("stop", bus.vcan_unit)
    assert bus.show("ActiveState") == "inactive" and not {"under0", "under1"} & links()
    assert told(bus, "stopped: ") and not told(bus, "gone") and not told(bus, "missing")
    assert not {bus.unit, bus.vcan_unit} & failed_units()


# ---- Examples ------------------------------------------------------------------------------------


def copied(*paths):
    for path in paths:
        shutil.copy(path, CONFIGS)


def clean(*units):
    systemctl("disable", "--now", *(f"canwired@{unit}.service" for unit in units))
    systemctl("stop", *(f"canwire-vcan@{unit}.service" for unit in units))
    for path in CONFIGS.iterdir():
        path.unlink()


@pytest.fixture(name="reader")
def fixture_reader():
    """Somebody without rights but sudo. /run is mounted so that there is none."""
    with tempfile.TemporaryDirectory(dir="/var/lib") as name:
        folder = Path(name)
        folder.chmod(0o755)
        build_sudo(folder)
        with Reader(f"{folder}:{SYSTEM}") as reader:
            yield reader
    clean("powertrain")


@pytest.mark.parametrize("page", ["README.md", "daemon/man/canwired.8.md"])
def test_the_lines_of_the_documents_run_a_bus(reader, page):
    """All but the installation, which is done."""
    block = next(block for block in blocks_of((ROOT / page).read_text())
                 if "sudo systemctl enable --now canwired@" in block)
    reader.paste(re.sub(r"^sudo make install.*\n", "", block, flags=re.MULTILINE))
    assert "powertrain: bitrate 500000 up" in reader.said()
    assert "Active: active (running)" in reader.said()
    with can_socket("pt-engine") as engine, can_socket("pt-dash") as dash:
        engine.send(Frame.parse("124#07").pack())
        wait_until(lambda: Frame.unpack(dash.recv(16)) == Frame.parse("124#07"),  # whole: a frame
                   "the frame")
    log = Path("/var/lib/canwire/powertrain.log")
    wait_until(lambda: "124#07" in log.read_text(), "a line")


@pytest.mark.parametrize("name", ["demo", "demo-fd", "demo-usb", "example"])
def test_the_other_examples_run_as_services(name):
    """Those that need more say so themselves: canwire-usb@, an LCM server, files."""
    text = (EXAMPLES.parents[2] / f"canwire/{name}.yaml").read_text()
    bus = re.search(r"^bus: *\{ *name: ([^,]+)|^bus:\n +name: (\S+)", text, re.MULTILINE)
    bus = bus[1] or bus[2]
    (CONFIGS / f"{name}.yaml").write_text(text)
    systemctl("enable", "--now", f"canwired@{name}")
    try:
        wait_until(lambda: json.loads(run("canwire", "status", bus, "--json"))["bus"]["bits"] > 0,
                   "the bus")
        systemctl("reload", f"canwired@{name}")
    finally:
        clean(name)


@pytest.mark.parametrize("files, buses", [
    ([EXAMPLES / f"rig{bus}.yaml" for bus in ("", "-body", "-chassis")], ("body", "chassis")),
    (sorted(Path("/usr/local/share/canwire/rig").glob("*.yaml")) or
     [Path("/usr/local/share/canwire/rig") / f"{name}.yaml" for name in
      ("body", "powertrain", "rig")], ("body", "powertrain"))], ids=["service", "first"])
def test_the_rigs_have_their_control_sockets(files, buses):
    copied(*files)
    systemctl("enable", "--now", "canwired@rig")
    try:
        for bus in buses:
            wait_until(lambda bus=bus: json.loads(run("canwire", "status", bus, "--json"))["bus"]
                       ["frames"] > 0, "a frame")
        systemctl("reload", "canwired@rig")
    finally:
        clean("rig")
