# SPDX-License-Identifier: MIT
"""The units under a real systemd: started, reloaded, killed by the watchdog, contained."""

import json
import os
import pwd
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from conftest import (FRAME, RMEM_MAX, RMEM_MAX_DEFAULT, ROOT, can_socket, checked, drop_in,
                      links, run, systemctl, wait_until)

CONFIGS = Path("/etc/canwire")
EXPOSURE_MAX = 1.5  # of 10
EXPOSURE_MAX_ROOT = 2.0  # of a unit that starts as root
WATCHDOG = "[Service]\nWatchdogSec=4s\n"  # the tests need not wait for so long
PROBE = Path("/run/probe.py")
PROBED = Path("/run/canwire/probed")  # findings of the probe


@pytest.fixture(scope="module", autouse=True)
def fixture_drop_ins(installed):  # pylint: disable=unused-argument
    """Adds to the units what the tests need."""
    shutil.copy(ROOT / "tests/systemd/probe.py", PROBE)
    drop_in("canwired@", WATCHDOG)
    drop_in("canwired@contained", f"[Service]\nExecStartPre=python3 {PROBE} {PROBED}\n")
    drop_in("canwired@real", (ROOT / "systemd/realtime.conf").read_text())
    drop_in("canwired@room", "[Service]\nWatchdogSec=0\n")  # it is stopped for a while
    systemctl("daemon-reload")


def test_units_are_well_formed():
    """That their man pages are there, tests/project/test_install.py looks after."""
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "canwired@x.service", "canwire-vcan@x.service",
         "canwire-usb@x.service", "canwire.target",
         "canwired@x.socket"],
        capture_output=True, text=True, check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def exposure(unit):
    """Returns the rating of a unit by `systemd-analyze security`, 0 to 10; before systemd 250 it
    asks process 1."""
    path = Path("/usr/local/lib/systemd/system") / unit
    version = int(run("systemctl", "--version").split()[1])
    what = ["--offline=yes", path] if version >= 250 else [unit.replace("@", "@x")]
    text = run("systemd-analyze", "security", "--no-pager", *what)
    return float(re.search(r"Overall exposure level for \S+: ([0-9.]+) ", text)[1])


@pytest.mark.parametrize("unit, most", [
    ("canwired@.service", EXPOSURE_MAX),
    ("canwire-vcan@.service", EXPOSURE_MAX),
    ("canwire-usb@.service", EXPOSURE_MAX_ROOT),
])
def test_units_are_hardly_exposed(unit, most):
    assert exposure(unit) <= most


def test_a_bus_starts_with_its_interfaces_and_they_stay_when_it_stops(bus):
    run("ip", "netns", "add", "ecu")
    one = bus("one", lambda text: text.replace(
        "port: one1", "port: one1, peer: { name: can0, netns: ecu }"))
    assert one.show("ActiveState") == "active"
    assert one.show("StatusText").startswith("one: 2 nodes at 500000 bit/s, ")
    assert {"one0", "one1"} <= links()
    in_ecu = ["ip", "netns", "exec", "ecu"]
    with subprocess.Popen(["timeout", "60", *in_ecu, "candump", "-L", "-n", "1", "can0"],
                          stdout=subprocess.PIPE, text=True) as dump:
        receivers = [*in_ecu, "cat", "/proc/net/can/rcvlist_all"]
        wait_until(lambda: re.search(r"^ *can0 ", run(*receivers), re.MULTILINE), "candump")
        run("cansend", "one0", "123#DEADBEEF")
        assert dump.communicate()[0].endswith("can0 123#DEADBEEF\n")
    systemctl("stop", one.unit)
    assert not one.socket.exists()
    assert {"one0", "one1"} <= links()
    systemctl("stop", one.vcan_unit)
    assert not {"one0", "one1"} & links()
    run("ip", "netns", "del", "ecu")


def test_it_is_contained(bus):
    pid = bus("contained").pid()
    assert PROBED.read_text() == "done\n"
    status = Path(f"/proc/{pid}/status").read_text()
    fields = dict(line.split(":\t") for line in status.splitlines())
    none = "0000000000000000"
    assert [fields[f"Cap{set}"] for set in ("Inh", "Prm", "Eff", "Bnd", "Amb")] == [none] * 5
    assert (fields["NoNewPrivs"], fields["Seccomp"]) == ("1", "2")
    user = pwd.getpwnam("canwire")
    assert fields["Uid"].split() == [str(user.pw_uid)] * 4
    assert fields["Gid"].split() == [str(user.pw_gid)] * 4


def test_messages_have_fields(bus):
    one = bus("fields", lambda text: text.replace("fields0", "fields0, queue: 16") + "lcm: {}\n")
    with can_socket("fields0") as a:
        for _ in range(100):
            a.send(FRAME.pack())
    wait_until(lambda: one.messages("CANWIRE_NODE=a"), "a message about a node")
    start = one.messages("CANWIRE_BUS=fields")[0]
    assert start["MESSAGE"] == "fields: 2 nodes at 500000 bit/s, classical CAN"
    assert (start["PRIORITY"], start["SYSLOG_IDENTIFIER"]) == ("6", "canwired")
    assert "CANWIRE_NODE" not in start
    lost = one.messages("CANWIRE_NODE=a")[0]
    assert lost["MESSAGE"].startswith("node a: ") and "queue full" in lost["MESSAGE"]
    assert (lost["PRIORITY"], lost["CANWIRE_BUS"]) == ("4", "fields")


def room_warnings(one):
    return [m["PRIORITY"] for m in one.messages() if "sysctl net.core.rmem_max=8388608" in
            m["MESSAGE"]]


def test_its_sockets_have_room(bus):
    """A thousand and more frames wait while it has to wait itself; less, and it warns."""
    count = 4000
    one = bus("room", lambda text: text + "catch-up: 60s\n")
    pid = one.pid()
    os.kill(pid, signal.SIGSTOP)
    with can_socket("room0") as a:
        for _ in range(count):
            a.send(FRAME.pack())
    os.kill(pid, signal.SIGCONT)
    a = wait_until(lambda: (n := one.status()["nodes"][0])["interface"]["read"] == count and n,
                   "all that is read")
    assert a["interface"]["kernel_dropped"] == 0
    assert room_warnings(one) == []
    RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
    systemctl("restart", one.unit)
    assert room_warnings(one) == []  # as long as nothing is lost
    RMEM_MAX.write_text("8388608")


@pytest.mark.deep
def test_errors_of_a_bad_configuration_are_errors_in_the_journal(bus):
    one = bus("wrong")
    good = one.config.read_text()
    one.config.write_text("bus: { bitrate: fast }\nnodes: 1\n")
    assert "failed" in systemctl("restart", one.unit, status=1)
    errors = [m for m in one.messages() if "wrong.yaml:" in m["MESSAGE"]]
    assert {m["MESSAGE"].split(" ")[0] for m in errors} == {
        f"{one.config}:1:17:", f"{one.config}:2:8:"}
    assert {m["PRIORITY"] for m in errors} == {"3"}
    one.config.write_text(good)
    one.start()
    assert one.show("ActiveState") == "active"


def test_a_reload_is_over_when_the_bus_has_gone_over(bus):
    one = bus("reload")
    pid = one.pid()
    with one.config.open("a") as file:
        file.write("  - { name: c, port: reload2 }\n")
    systemctl("reload", one.unit)
    assert [n["name"] for n in one.status()["nodes"]] == ["a", "b", "c"]
    assert "reload2" in links()
    assert (one.pid(), one.show("ActiveState")) == (pid, "active")
    assert one.carries()


@pytest.mark.deep
def test_a_bad_reload_fails_and_changes_nothing(bus):
    one = bus("worse")
    good = one.config.read_text()
    one.config.write_text(good.replace("500000", "fast"))
    assert "failed" in systemctl("reload", one.unit, status=1)
    assert [m for m in one.messages() if "bitrate: expected" in m["MESSAGE"]]
    wait_until(lambda: "reload refused: " in one.show("StatusText"), "the status")
    assert one.show("ActiveState") == "active"
    one.config.write_text(good.replace("500000", "250000"))
    assert "failed" in systemctl("reload", one.unit, status=1)
    assert [m["PRIORITY"] for m in one.messages() if "bus.bitrate cannot change" in m["MESSAGE"]
            ] == ["3"]
    wait_until(lambda: "reload refused: " in one.show("StatusText"), "the status")
    assert one.show("ActiveState") == "active"
    assert one.carries()
    one.config.write_text(good)
    systemctl("reload", one.unit)
    wait_until(lambda: "refused" not in one.show("StatusText"), "the status")


@pytest.mark.parametrize("file, why", [
    ("drive.log", "Read-only file system"),
    ("/var/lib/canwire/missing/drive.log", "No such file or directory"),
])
def test_a_reload_refuses_what_a_start_refuses(bus, file, why):
    one = bus("alike")
    good = one.config.read_text()
    one.config.write_text(good + f"record: [ {{ file: {file} }} ]\n")
    assert "failed" in systemctl("reload", one.unit, status=1)
    told = [m for m in one.messages() if f"{file}: {why}" in m["MESSAGE"]]
    assert [m["PRIORITY"] for m in told] == ["3"]
    assert one.carries() and one.status()["recordings"] == []
    assert "failed" in systemctl("restart", one.unit, status=1)
    assert len([m for m in one.messages() if m["MESSAGE"] == told[0]["MESSAGE"]]) > 1
    one.config.write_text(good)
    one.start()
    assert one.carries()


@pytest.mark.deep
def test_a_bus_without_control_socket_is_reloaded_by_signal(bus):
    one = bus("mute", lambda text: text.replace("control: /run/canwire/mute.sock\n", ""))
    pid = one.pid()
    with one.config.open("a") as file:
        file.write("  - { name: c, port: mute2 }\n")
    systemctl("reload", one.unit)
    assert [m for m in one.messages() if m["MESSAGE"] == "mute: configuration reloaded, 3 nodes"]
    assert (one.pid(), one.show("ActiveState")) == (pid, "active")
    assert one.carries()


@pytest.mark.deep
def test_a_reload_that_would_be_of_another_bus_is_refused(bus):
    one, two = bus("one"), bus("two")
    one.config.write_text(one.config.read_text().replace("/one.sock", "/two.sock"))
    assert "failed" in systemctl("reload", one.unit, status=1)
    assert [m for m in one.messages() if "control cannot change while the bus runs" in m["MESSAGE"]]
    assert not [m for m in two.messages() if "reloaded" in m["MESSAGE"]]


@pytest.mark.deep
def test_interfaces_that_were_deleted_are_made_again(bus):
    one = bus("gone")
    run("ip", "link", "del", "gone0")
    systemctl("restart", one.unit)
    assert one.carries()
    run("ip", "link", "del", "gone1")
    os.kill(one.pid(), signal.SIGKILL)
    wait_until(lambda: "gone1" in links() and one.show("ActiveState") == "active", "the restart")
    assert one.carries()
    run("ip", "link", "del", "gone0")
    systemctl("reload", one.unit)
    wait_until(lambda: one.status()["nodes"][0]["link"] == "up", "the interface")
    assert one.carries()
    assert one.show("NRestarts") == "1", "none of it has failed"


def test_a_bus_that_hangs_is_killed_and_comes_back(bus):
    one = bus("hang")
    pid = one.pid()
    os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: one.show("NRestarts") == "1" and one.show("ActiveState") == "active",
               "the watchdog and the restart")
    assert one.pid() != pid
    assert "Watchdog timeout" in run("journalctl", "-u", one.unit, "--no-pager")
    assert one.carries()


@pytest.mark.deep
def test_a_bus_that_is_killed_comes_back(bus):
    one = bus("kill")
    pid = one.pid()
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: one.pid() not in (0, pid) and one.show("ActiveState") == "active",
               "the restart")
    assert one.carries()
    assert one.status()["pid"] == one.pid()


@pytest.mark.deep
def test_injected_rules_and_a_crash(bus):
    one = bus("rules")
    rule = '{{name: {}, when: {{frame: "7FF"}}, do: {{flip: "crc[3]"}}}}'
    run("canwire", "inject", one.name, rule.format("passing"))
    run("canwire", "inject", "--keep", one.name, rule.format("stays"))
    pid = one.pid()
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: one.pid() not in (0, pid) and one.show("ActiveState") == "active",
               "the restart")
    assert "1 injected rule was lost with the crash at 20" in one.show("StatusText")
    assert [m["PRIORITY"] for m in one.messages() if m["MESSAGE"].endswith(": passing")] == ["4"]
    faults = json.loads(run("canwire", "faults", one.name, "--json"))
    assert [fault["name"] for fault in faults] == ["stays"]
    run("canwire", "clear", one.name)


def test_recordings_have_a_place(bus):
    one = bus("record", lambda text: text + "record: [ { file: /var/lib/canwire/record.log } ]\n")
    assert one.carries()
    systemctl("stop", one.unit)
    text = Path("/var/lib/canwire/record.log").read_text()
    assert text.endswith(" record0 123#DEADBEEF\n") and text.count("\n") == 1


@pytest.mark.deep
def test_logrotate_renames_as_the_page_of_recordings_says(bus):
    one = bus("turn", lambda text: text + "record: [ { file: /var/lib/canwire/turn.log } ]\n")
    page = (ROOT / "daemon/man/canwire-record.7.md").read_text()
    config, state = Path("/run/rotate.conf"), Path("/run/rotate.state")
    config.write_text(re.search(r"```\n(/var[^`]*postrotate[^`]*)```", page)[1])
    config.chmod(0o644)
    files = [Path(f"/var/lib/canwire/turn.log{end}") for end in ("", ".1")]
    try:
        assert one.carries()
        run("logrotate", "--force", "--state", state, config)
        wait_until(files[0].exists, "the next file")
        assert one.carries()
        systemctl("stop", one.unit)
        assert [file.read_text().count("123#DEADBEEF") for file in files] == [1, 1]
        assert {file.owner() for file in files} == {"canwire"}
    finally:
        for file in files:
            file.unlink(missing_ok=True)


@pytest.mark.deep
def test_the_stop_of_one_bus_leaves_the_others(bus):
    one, two = bus("one"), bus("two")
    systemctl("stop", one.unit)
    assert not one.socket.exists()
    assert two.socket.exists()
    assert two.status()["bus"]["name"] == "two"
    one.start()
    assert one.status()["bus"]["name"] == "one"


@pytest.mark.deep
def test_members_of_the_group_may_control_it_and_others_not(bus):
    bus("group")
    become = ["setpriv", "--reuid", "65534", "--clear-groups", "--regid"]
    assert "group: bitrate 500000" in run(*become, "canwire", "canwire", "status", "group")
    assert "denied" in run(*become, "65534", "canwire", "status", "group", status=1)


def test_members_of_the_group_may_reload_it_and_others_not(bus):
    """polkit asks the groups of the user, not of the process."""
    one = bus("policy")
    run("useradd", "member", "--groups", "canwire")
    run("useradd", "stranger")
    systemctl("restart", "polkit")
    reload = ["systemctl", "--no-ask-password", "reload", one.unit]
    run("runuser", "-u", "member", "--", *reload)
    assert [m for m in one.messages() if "configuration reloaded" in m["MESSAGE"]]
    denied = "authentication required"
    assert denied in run("runuser", "-u", "stranger", "--", *reload, status=1)
    assert denied in run("runuser", "-u", "member", "--", *reload[:2], "stop", one.unit, status=1)


@pytest.mark.deep
def test_the_target_is_for_all_buses(bus):
    one, two = bus("one"), bus("two")
    systemctl("stop", "canwire.target")
    assert [each.show("ActiveState") for each in (one, two)] == ["inactive", "inactive"]
    systemctl("enable", one.unit)
    try:
        systemctl("start", "canwire.target")
        wait_until(lambda: one.show("ActiveState") == "active", "the bus that is enabled")
        assert two.show("ActiveState") == "inactive"
        pid = one.pid()
        systemctl("restart", "canwire.target")
        wait_until(lambda: one.pid() not in (0, pid), "the restart")
        wait_until(lambda: one.show("ActiveState") == "active", "the bus again")
        assert one.carries()
    finally:
        systemctl("disable", one.unit)
        systemctl("stop", "canwire.target")


@pytest.mark.deep
def test_monitoring(bus):
    one = bus("watched")
    assert checked(one.name).startswith("CANWIRE OK - watched: ")
    run("ip", "link", "set", "watched1", "down")
    assert "b link down" in checked(one.name, status=1)
    systemctl("stop", one.unit)
    assert "CRITICAL" in checked(one.name, "--wait", "0ms", status=2)


def test_real_time_is_a_drop_in(bus):
    one = bus("real", lambda text: text + "lcm: {}\n")
    pid = one.pid()
    tasks = sorted(int(t) for t in os.listdir(f"/proc/{pid}/task"))
    assert tasks[0] == pid and len(tasks) == 2
    assert [os.sched_getscheduler(t) for t in tasks] == [
        os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.SCHED_OTHER]
    assert os.sched_getparam(pid).sched_priority == 50
    assert os.sched_getaffinity(pid) == {1}
    assert one.carries()


RIG = """
buses: [ rig-one.yaml, rig-two.yaml ]
gateways:
  - { name: g, between: [ "rig-one:gw", "rig-two:gw" ], rules: [ { filter: "123" } ] }
"""
RIG_BUS = """
bus: {{ name: rig-{0}, bitrate: {1} }}
control: /run/canwire/rig-{0}.sock
nodes: [ {{ name: ecu, port: rig{2} }}, {{ name: gw }}{3} ]
"""


def test_a_rig_is_one_unit(bus):
    """Its two buses, each with an ECU, have a gateway between them."""
    files = [CONFIGS / "rig-one.yaml", CONFIGS / "rig-two.yaml"]
    files[0].write_text(RIG_BUS.format("one", 500000, 0, ""))
    files[1].write_text(RIG_BUS.format("two", 125000, 1, ""))
    try:
        rig = bus("rig", lambda _: RIG)
        assert rig.carries()
        assert "rig-one: load " in rig.show("StatusText")
        pid = rig.pid()
        files[1].write_text(RIG_BUS.format("two", 125000, 1, ", { name: third, port: rig2 }"))
        systemctl("reload", rig.unit)
        status = json.loads(run("canwire", "status", "rig-two", "--json"))
        assert [n["name"] for n in status["nodes"]] == ["ecu", "gw", "third"]
        assert "rig2" in links() and rig.pid() == pid
        [forward] = [g["forward"]["rules"][0] for g in status["gateways"]]
        assert forward["forwarded"] == 1
        fields = [m.get("CANWIRE_BUS") for m in rig.messages(f"_PID={pid}")
                  if "reloaded" in m["MESSAGE"]]
        assert sorted(fields) == ["rig-one", "rig-two"]
        files[1].write_text(RIG_BUS.format("two", 125000, 1, "").replace("name: gw", "name: gone"))
        assert "failed" in systemctl("reload", rig.unit, status=1)
        assert rig.carries()
    finally:
        for file in files:
            file.unlink()


# ---- Real CAN interfaces -------------------------------------------------------------------------


USB_BUS = """
bus: { name: usb, bitrate: 500000 }
control: /run/canwire/usb.sock
nodes:
  - { name: a, port: { usb: can0 } }
  - { name: b, port: { usb: can0, netns: ecu } }
"""
USB_UNIT = "canwire-usb@usb.service"


@pytest.fixture(name="usb_config")
def fixture_usb_config():
    config = Path("/etc/canwire/usb.yaml")
    config.write_text(USB_BUS)
    run("ip", "netns", "add", "ecu")
    yield config
    systemctl("stop", USB_UNIT, "canwired@usb.service")
    config.unlink()
    run("ip", "netns", "del", "ecu")


def show_usb(name, unit=USB_UNIT):
    return systemctl("show", "-P", name, unit).strip()


def usb_nodes():
    status = json.loads(run("canwire", "status", "usb", "--json"))
    return {node["name"]: node for node in status["nodes"]}


def test_usb_interfaces_are_there_when_their_unit_has_started(usb_config):
    systemctl("start", USB_UNIT)
    assert "can0" in links() and "can0" in run("ip", "netns", "exec", "ecu", "ip", "-o", "link")
    wait_until(lambda: len(usb_nodes()["a"]["clients"]) == 1, "the adapter to connect")
    assert usb_nodes()["a"]["link"] == "down"
    for prefix in ([], ["ip", "netns", "exec", "ecu"]):
        run(*prefix, "ip", "link", "set", "can0", "type", "can", "bitrate", "500000")
        run(*prefix, "ip", "link", "set", "can0", "up")
    wait_until(lambda: {n["link"] for n in usb_nodes().values()} == {"up"}, "both on the bus")
    run("cansend", "can0", "123#1122")
    wait_until(lambda: usb_nodes()["b"]["rx_frames"] == 1, "the frame")

    main = int(systemctl("show", "-P", "MainPID", USB_UNIT))
    children = run("pgrep", "-P", str(main)).split()
    assert len(children) == 2
    for process, capabilities in [(main, 1 << 12), *((int(child), 0) for child in children)]:
        status = Path(f"/proc/{process}/status").read_text()
        assert int(re.search(r"^CapPrm:\t(\w+)$", status, re.M)[1], 16) == capabilities
        assert re.search(r"^Seccomp:\t2$", status, re.M)

    usb_config.write_text(USB_BUS.replace("usb: can0 }", "usb: diag }"))
    both = "2 of 2 plugged in: can0 plugged in, can0 of ecu plugged in"
    wait_until(lambda: show_usb("StatusText") == both, "its status")
    systemctl("reload", USB_UNIT)
    wait_until(lambda: {"diag"} <= links() and "can0" not in links(), "the other name")
    systemctl("stop", USB_UNIT)
    wait_until(lambda: "diag" not in links(), "the interface to go")
    assert systemctl("show", "-P", "Result", USB_UNIT).strip() == "success"


@pytest.mark.deep
def test_usb_interfaces_come_back_with_the_module(usb_config):  # pylint: disable=unused-argument
    systemctl("start", USB_UNIT)
    main = show_usb("MainPID")
    run("rmmod", "vhci_hcd")
    run("modprobe", "vhci_hcd")
    wait_until(lambda: show_usb("MainPID") not in ("0", main)
               and show_usb("ActiveState") == "active", "the restart")
    run("journalctl", "--sync")
    log = run("journalctl", "--no-pager", "-u", USB_UNIT)
    assert "the module vhci_hcd has been removed, and all adapters with it" in log
    assert "can0" in links() and "can0" in run("ip", "netns", "exec", "ecu", "ip", "-o", "link")


def test_usb_interfaces_come_with_a_module_that_is_late(usb_config):
    """As long as it is missing, the unit is tried again and has not failed."""
    modprobe = "modprobe@vhci_hcd.service"
    run("modprobe", "-r", "vhci_hcd")
    systemctl("mask", "--runtime", modprobe)
    try:
        systemctl("start", "--no-block", USB_UNIT)
        waits = "Waiting for the module vhci_hcd (modprobe vhci-hcd peak_usb)"
        wait_until(lambda: show_usb("StatusText") == waits, "its status")
        assert show_usb("ActiveState") == "activating"
        systemctl("stop", USB_UNIT)
        assert (show_usb("ActiveState"), show_usb("Result")) == ("inactive", "success")
        systemctl("start", "--no-block", USB_UNIT)
        wait_until(lambda: show_usb("StatusText") == waits, "its status again")
        run("modprobe", "vhci_hcd")
        wait_until(lambda: show_usb("ActiveState") == "active", "the adapters")
        assert show_usb("NRestarts") == "0"
        assert "can0" in links()
    finally:
        systemctl("unmask", "--runtime", modprobe)
    usb_config.write_text(USB_BUS.replace("can0", "x/y"))
    assert "failed" in systemctl("restart", USB_UNIT, status=1)
    assert (show_usb("ActiveState"), show_usb("ExecMainStatus")) == ("failed", "1")
    assert show_usb("StatusText").startswith(f"{usb_config}:5:29: usb: expected the name of an ")
    systemctl("reset-failed", USB_UNIT, "canwired@usb.service")


def sample(path):
    """Returns the file that canwired(8) shows behind its path."""
    text = (ROOT / "daemon/man/canwired.8.md").read_text()
    block = re.search(rf"`{re.escape(path)}`[^\n]*\n\n((?:(?:    [^\n]*)?\n)+)", text)[1]
    return re.sub("^    ", "", block, flags=re.MULTILINE)


@pytest.mark.parametrize("unit, path", [
    ("systemd-udevd", "/etc/udev/rules.d/80-can0.rules"),
    ("systemd-networkd", "/etc/systemd/network/80-can0.network")])
@pytest.mark.usefixtures("usb_config")
def test_usb_interfaces_get_their_bit_rate_each_time(unit, path):
    """networkd waits for udev to know an interface."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(sample(path))
    try:
        systemctl("start", "systemd-udevd", unit)
        for verb in ("start", "restart"):
            systemctl(verb, USB_UNIT)
            wait_until(lambda: "bitrate 500000" in (shown := run("ip", "-details", "link", "show",
                                                                 "can0"))
                       and "restart-ms 100" in shown and "state UP" in shown, "its bit rate")
    finally:
        Path(path).unlink()
        systemctl("stop", "systemd-networkd.socket", unit, "systemd-udevd-control.socket",
                  "systemd-udevd-kernel.socket", "systemd-udevd")


@pytest.mark.deep
def test_usb_on_a_bus_without_such_ports_says_so_and_ends(bus):
    one = bus("plain")
    unit = f"canwire-usb@{one.name}.service"
    systemctl("start", unit)
    wait_until(lambda: show_usb("ActiveState", unit) == "inactive", "its end")
    shown = systemctl("show", "-p", "Result,NRestarts,StatusText", unit)
    assert "Result=success" in shown and "NRestarts=0" in shown
    run("journalctl", "--sync")
    assert "no node has a port { usb: ... }, there is nothing to do" in run(
        "journalctl", "--no-pager", "-u", unit)
