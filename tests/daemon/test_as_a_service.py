# SPDX-License-Identifier: MIT
"""canwired where its unit has set CANWIRE_SERVICE. The unit itself is in tests/systemd."""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess

import pytest

from simtool import CANWIRE, CANWIRED, TIMEOUT_S, stop_canwired
from failing import SANITIZERS
from test_record import wait_until

GOOD = "bus: { name: day, bitrate: 500000 }\nnodes: [ { name: a }, { name: b } ]\n"
BAD = GOOD.replace("500000", "fast")
CONTROL = "control: day.sock\n"


def environment(instance, **more):
    service = {"CANWIRE_SERVICE": instance} if instance else {}
    return dict(os.environ, **SANITIZERS, **service, **more)


def ended(folder, text, instance, **more):
    """Returns a canwired that cannot start, and what it has told the service manager."""
    (folder / "bus.yaml").write_text(text)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.bind(str(folder / "notify"))
        notify.settimeout(TIMEOUT_S)
        done = subprocess.run([CANWIRED, "-c", "bus.yaml"], cwd=folder, capture_output=True,
                              text=True, timeout=TIMEOUT_S, check=False, env=environment(
                                  instance, NOTIFY_SOCKET=str(folder / "notify"), **more))
        told = notify.recv(4096).decode()  # whole: a datagram
    (folder / "notify").unlink()
    return done, told


@pytest.mark.parametrize("instance", [None, "day"])
def test_how_it_ends_says_if_another_start_helps(tmp_path, instance):
    done, told = ended(tmp_path, BAD, instance)
    assert done.returncode == 1
    assert told == f"STATUS={done.stderr.rstrip()}" and "bitrate: expected" in told
    done, told = ended(tmp_path, GOOD + "control: none/day.sock\n", instance)
    assert done.returncode == 1, "another start would find the same"
    assert told == "STATUS=" + done.stderr.removeprefix("canwired: error: ").rstrip()
    assert "bus.yaml:3:10: control none/day.sock: the directory does not exist" in told


@pytest.mark.parametrize("text, why", [
    (GOOD + "record: [ { file: none/a.log } ]\n", "No such file or directory"),
    (GOOD + "record: [ { file: bus.yaml/a.log } ]\n", "Not a directory"),
    (GOOD + "record: [ { file: folder.log } ]\n", "that is no regular file"),
    (GOOD + "control: bus.yaml/day.sock\n", "Not a directory"),
    (GOOD + "control: folder.log\n", "there is something that is no socket"),
    (GOOD + "control: file.log\n", "there is something that is no socket"),
    (GOOD.replace("name: a ", 'name: a, port: "unix:folder.log" '), "something that is no socket"),
    (GOOD + f"record: [ {{ file: {'x' * 300}.log }} ]\n", "File name too long"),
    (GOOD.replace("name: a ", 'name: a, port: "unix:none/a.port" '), "does not exist"),
])
def test_a_path_that_cannot_be_is_a_bad_configuration(tmp_path, text, why):
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "file.log").touch()
    done, told = ended(tmp_path, text, "day")
    assert done.returncode == 1 and why in told
    assert re.match(r"STATUS=bus.yaml:[23]:[0-9]+: ", told), told


def test_a_socket_that_is_in_use_may_be_free_later(tmp_path):
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(tmp_path / "day.sock"))
        other.listen()
        done, told = ended(tmp_path, GOOD + CONTROL, "day")
    assert done.returncode == 75 and "in use" in told


def test_why_it_is_tried_again_is_kept_until_it_starts(tmp_path):
    """ExecStartPre= of the unit says it again, since systemd forgets the status."""
    kept, run = tmp_path / "day.failure", {"CANWIRE_RUN": str(tmp_path)}
    ended(tmp_path, BAD, "day", **run)
    assert not kept.exists(), "it is not tried again"
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(tmp_path / "day.sock"))
        other.listen()
        ended(tmp_path, GOOD + CONTROL, None, **run)
        assert not kept.exists(), "it is not the service"
        _, told = ended(tmp_path, GOOD + CONTROL, "day", **run)
    assert kept.read_text() == told.removeprefix("STATUS=") + "\n"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.bind(str(tmp_path / "notify"))
        notify.settimeout(TIMEOUT_S)
        (tmp_path / "bus.yaml").write_text(GOOD + CONTROL.replace("day", "free"))
        with subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=tmp_path, env=environment(
                "day", NOTIFY_SOCKET=str(tmp_path / "notify"), **run)) as bus:
            while notify.recv(4096) != b"READY=1":
                pass
            assert not kept.exists()
            bus.terminate()


def test_of_several_errors_the_first_is_shown(tmp_path):
    done, told = ended(tmp_path, BAD + "faults: 1\n", "day")
    first, second = done.stderr.splitlines()
    assert told == f"STATUS={first}" and "faults" in second


@pytest.mark.parametrize("profile, why", [
    (None, "profile.yaml: No such file or directory"),
    ("faults: 1\n", "profile.yaml:1:9: faults: expected a list"),
])
def test_of_a_profile_the_reason_is_shown(tmp_path, profile, why):
    """The last line says which file names it."""
    if profile:
        (tmp_path / "profile.yaml").write_text(profile)
    done, told = ended(tmp_path, GOOD + "profiles: [ { file: ./profile.yaml } ]\n", "day")
    first, last = done.stderr.splitlines()
    assert told == f"STATUS={first}" and why in first
    assert last == "bus.yaml:3:13: profiles: there are errors in ./profile.yaml"


@contextlib.contextmanager
def running(folder, text, instance, *within):
    folder.mkdir()
    (folder / "bus.yaml").write_text(text)
    log = folder / "log"
    with log.open("w") as errors:
        with subprocess.Popen([*within, CANWIRED, "-c", "bus.yaml"], cwd=folder, stderr=errors,
                              env=environment(instance)) as process:
            wait_until(lambda: " bit/s, " in log.read_text() or process.poll() is not None, "it")
            try:
                yield log.read_text(), process.pid
            finally:
                stop_canwired(process, log)


def test_two_units_with_a_bus_of_one_name(tmp_path):
    name = f"bus: {{ name: b{os.getpid()}, bitrate: 500000 }}\n"
    text = name + GOOD.split("\n", 1)[1] + CONTROL
    with running(tmp_path / "a", text, "one") as (first, pid):
        with running(tmp_path / "b", text, "two") as (second, _):
            told = f"canwired@one, pid {pid}, runs a bus of the same name"
            assert told in second and "same name" not in first
        with running(tmp_path / "c", text, None) as (by_hand, _):
            assert "same name" not in by_hand
    with running(tmp_path / "d", text, "two") as (later, _):
        assert "same name" not in later


def test_sockets_that_only_the_service_sees(tmp_path):
    """tmp_path is below /tmp, or else nothing is said."""
    within = str(tmp_path).startswith(("/tmp/", "/var/tmp/"))
    with running(tmp_path / "a", GOOD + f"control: {tmp_path}/day.sock\n", "day") as (log, _):
        assert (log.count("of its own, where nobody else finds it: use /run/canwire") ==
                int(within))
    with running(tmp_path / "b", GOOD + f"control: {tmp_path}/day.sock\n", None) as (log, _):
        assert "of its own" not in log


@pytest.mark.parametrize("text, why", [
    (BAD, "bus.yaml:1:28: bitrate: expected "),
    (GOOD + CONTROL + "record: [ { file: none/a.log } ]\n",
     "bus.yaml:4:19: record none/a.log: ")])
def test_clients_of_a_bad_bus_get_the_reason(tmp_path, text, why):
    (tmp_path / "bus.yaml").write_text(text)
    with socket.socket(socket.AF_UNIX) as listener, socket.socket(socket.AF_UNIX) as client:
        listener.bind(str(tmp_path / "day.sock"))
        listener.listen()
        client.settimeout(TIMEOUT_S)
        client.connect(str(tmp_path / "day.sock"))
        client.sendall(b'{"request":"status"}\n')
        start = 'exec env LISTEN_PID=$$ LISTEN_FDS=1 LISTEN_FDNAMES=control "$@" 3<&0'
        done = subprocess.run(["sh", "-c", start, "sh", CANWIRED, "-c", "bus.yaml"], cwd=tmp_path,
                              stdin=listener, capture_output=True, text=True, timeout=TIMEOUT_S,
                              check=False, env=environment("day"))
        assert done.returncode == 1
        assert client.makefile().readline().startswith(f'{{"ok":false,"error":"{why}')


@pytest.mark.parametrize("count, lines", [(2, 1), (29, 3)])
def test_all_ports_that_other_hosts_do_not_reach_are_named(tmp_path, count, lines):
    """In a network without addresses the unit counts as what it is by default."""
    ports = [f"tcp:0.0.0.0:{20000 + i}" for i in range(count)]
    nodes = "".join(f'  - {{ name: n{i}, port: "{port}" }}\n' for i, port in enumerate(ports))
    text = "bus: { name: day, bitrate: 500000 }\nmetrics: 0.0.0.0\nnodes:\n" + nodes
    with running(tmp_path / "a", text, "day", "unshare", "--net", "--map-root-user") as (log, _):
        told = [line for line in log.splitlines() if "IPAddressDeny=" in line]
        assert len(told) == lines
        assert all("IPAddressAllow=" in line and "canwired(8)" in line for line in told)
        assert [name.split("/")[0] for line in told for name in
                line.split("warning: ")[1].split(": the")[0].split(", ")] == \
            [*ports, "0.0.0.0:9464"]


def test_what_the_unit_lets_through_is_not_warned_of(tmp_path):
    """Nothing drops packets here, and there is no network yet."""
    text = ("bus: { name: day, bitrate: 500000 }\nnodes:\n"
            "  - { name: a, port: 'tcp:0.0.0.0:20000' }\n"
            "  - { name: b, port: 'cannelloni:udp,listen=0.0.0.0:20001,peer=192.0.2.7:20001' }\n")
    lo = "ip link set lo up && exec \"$@\""
    with running(tmp_path / "a", text, "day", "unshare", "--net", "--map-root-user", "sh", "-c", lo,
                 "sh") as (log, _):
        assert "IPAddressDeny=" not in log


class Service:
    """A bus as its unit runs it, whose sockets are in the folder `run`."""

    def __init__(self, folder, text):
        self.folder, self.log = folder, folder / "log"
        self.environment = environment("day", NOTIFY_SOCKET=str(folder / "notify"),
                                       CANWIRE_RUN=str(folder / "run"))
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.bind(str(folder / "notify"))
        self.manager.settimeout(TIMEOUT_S)
        (folder / "run").mkdir()
        self.write(text)
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=folder, stderr=log,
                                            env=self.environment)
        wait_until(lambda: " bit/s, " in self.log.read_text(), "the bus")

    def write(self, text):
        (self.folder / "bus.yaml").write_text(text)

    def canwire(self, *words, status=0):
        done = subprocess.run([CANWIRE, *words], cwd=self.folder, capture_output=True, text=True,
                              timeout=TIMEOUT_S, check=False, env=self.environment)
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    def reload(self, status=0):
        """Reloads as the unit does."""
        return self.canwire("reload", "--config", "bus.yaml", "--pid", str(self.process.pid),
                            status=status)

    def wait_for_status(self, good):
        """Waits for a line that the service manager shows."""
        for _ in range(100):
            told = self.manager.recv(4096).decode()  # whole: a datagram
            if told.startswith("STATUS=") and good(told):
                return told
        raise AssertionError(f"the last status is {told}")

    def told_until_ready(self):
        """Returns what the service manager was told in a reload, behind its begin."""
        while not self.manager.recv(4096).startswith(b"RELOADING=1"):  # whole: a datagram
            pass
        told = [self.manager.recv(4096).decode()]  # whole: a datagram
        while told[-1] != "READY=1":
            told.append(self.manager.recv(4096).decode())  # whole: a datagram
        return told

    def stop(self):
        stop_canwired(self.process, self.log)
        self.manager.close()


@pytest.fixture(name="service")
def fixture_service(tmp_path):
    made = []

    def start(text):
        made.append(Service(tmp_path, text))
        return made[-1]

    yield start
    for one in made:
        one.stop()


IN_RUN = GOOD + "control: run/day.sock\n"
REFUSED = "; reload refused: "


def test_the_state_after_a_reload_is_told_before_its_end(service):
    one = service(IN_RUN)
    for text, state, status in ((IN_RUN.replace("{ name: b }", "{ name: b }, { name: c }"),
                                 "day: 3 nodes at ", 0),
                                (BAD, REFUSED, 1), (IN_RUN, "day: 2 nodes at ", 0)):
        one.write(text)
        one.reload(status=status)
        last = [line for line in one.told_until_ready() if line.startswith("STATUS=")][-1]
        assert state in last and (REFUSED in last) == (status == 1)


@pytest.mark.parametrize("text, why", [
    (IN_RUN.replace("{ name: a }", "{ name: a"), "bus.yaml:"),
    (IN_RUN.replace("500000", "fast"), "bus.yaml:1:28: bitrate: expected "),
    (IN_RUN + "profiles: [ { file: bad.yaml } ]\n", "bad.yaml"),
    (IN_RUN.replace("500000", "250000"), "bus.bitrate cannot change while the bus runs"),
    (IN_RUN.replace("run/day.sock", "run/night.sock"),
     "control cannot change while the bus runs"),
    (IN_RUN.replace("run/day.sock", "none/day.sock"),
     "control none/day.sock: the directory does not exist"),
], ids=["YAML", "value", "profile", "bit rate", "control", "control nowhere"])
def test_a_refused_reload_stays_in_the_status(service, tmp_path, text, why):
    (tmp_path / "bad.yaml").write_text("1\n")
    one = service(IN_RUN)
    one.write(text)
    assert why in one.reload(status=1)
    told = one.wait_for_status(lambda told: REFUSED in told)
    assert why in told.split(REFUSED)[1]
    assert "reload refused: " in one.canwire("status", "day")
    assert "reload refused: " in one.canwire("status", "--check", "day", status=1)
    one.write(IN_RUN)
    one.reload()
    one.wait_for_status(lambda told: REFUSED not in told)
    assert "reload refused: " not in one.canwire("status", "day")


@pytest.mark.parametrize("text, why", [
    (BAD, "bitrate: expected"), (GOOD + "control: nowhere/day.sock\n", "no such bus")])
def test_a_bus_that_its_file_does_not_lead_to_gets_a_signal(service, text, why):
    """Its socket is not where those of services are."""
    one = service(GOOD + CONTROL)
    one.write(text)
    assert why in one.reload(status=1)
    one.wait_for_status(lambda told: REFUSED in told)


@pytest.mark.parametrize("text", [IN_RUN, BAD, "bus: {", IN_RUN + "control: none/x.sock\n"],
                         ids=["the same socket", "bad", "YAML", "another socket"])
def test_a_file_of_another_bus_reloads_nothing(service, tmp_path, text):
    one = service(IN_RUN)
    (tmp_path / "other.yaml").write_text(text)
    told = one.canwire("reload", "--config", "other.yaml", "--pid", str(one.process.pid), status=1)
    assert told.endswith(f"run/day.sock: it runs with bus.yaml, not with other.yaml\n"), told
    assert "reload" not in one.log.read_text() and "refused" not in one.canwire("status", "day")
    (tmp_path / "link.yaml").symlink_to("bus.yaml")
    for name in "./bus.yaml", "././bus.yaml", tmp_path / "bus.yaml", "run/../bus.yaml", "link.yaml":
        one.canwire("reload", "--config", str(name), "--pid", str(one.process.pid))
    (tmp_path / "bus.yaml").unlink()
    assert "No such file" in one.reload(status=1)


def test_a_reload_tells_of_kept_rules_that_do_not_fit_any_more(service):
    one = service(IN_RUN)
    rule = "{{name: {}, do: {{noise: 1e-9, at: [{}]}}}}"
    for name, node in ("first", "b"), ("second", "a"):
        one.canwire("inject", "--keep", "day", rule.format(name, node))
    one.write(IN_RUN.replace("name: b", "name: c"))
    told = one.reload()
    why = "inject:1:38: at: there is no node 'b'; allowed: a, c"
    assert told == ("canwire: bus run/day.sock: rules of inject, which are kept, are refused: "
                    f"{why}\n")
    one.wait_for_status(lambda told: told.endswith(f"; rules of inject are refused: {why}"))
    line = one.canwire("status", "--check", "day", status=1)
    assert f", rules of inject are refused: {why} | " in line
    shown = one.canwire("status", "day")
    assert f"kept inject: first (refused: {why})\nkept inject: second\n" in shown
    one.write(IN_RUN)
    assert one.reload() == ""
    one.wait_for_status(lambda told: "refused" not in told)


NO_RULES = "{faults: []}"


def test_a_bus_is_found_by_its_own_name_too(service, tmp_path):
    """Unit and socket are called `unit`, the bus `day`."""
    one = service(GOOD + "control: run/unit.sock\n")
    for command in "faults", "clear", "reload":
        assert one.canwire(command, "day") == one.canwire(command, "unit")
    one.canwire("inject", "day", NO_RULES)
    for words in (["status"], ["status", "--json"], ["status", "--check"]):
        assert "day" in one.canwire(*words, "day")
    assert "those in " in one.canwire("status", "night", status=1)
    (tmp_path / "other.yaml").write_text(GOOD)
    run = tmp_path / "run"
    for name in "bus", "bus.yaml", "./bus.yaml", str(tmp_path / "bus.yaml"):
        for command in "status", "faults":
            assert one.canwire(command, name, status=1) == (
                f"canwire: bus {name}: that is a configuration; its buses in {run}: unit\n")
    assert one.canwire("status", "./other.yaml", status=1) == (
        "canwire: bus ./other.yaml: that is a file, and no socket of a bus\n")
    (tmp_path / "run/alias.sock").symlink_to("unit.sock")
    assert one.canwire("status", "day").startswith("day: "), "two names of one socket"
    with running(tmp_path / "b", GOOD + f"control: {tmp_path}/run/other.sock\n", None):
        told = one.canwire("status", "day", status=1)
        assert told == ("canwire: bus day: several buses have this name; take one of their sockets "
                        f"in {tmp_path}/run: other, unit\n")
        one.canwire("status", "other")
    with running(tmp_path / "c", GOOD.replace("name: day", "name: else") +
                 f"control: {tmp_path}/run/day.sock\n", None):
        assert one.canwire("status", "day").startswith("else: "), "a socket goes first"
    with running(tmp_path / "d", GOOD.replace("name: day", "name: else") +
                 f"control: {tmp_path}/run/a.sock\n", None):
        one.canwire("set", "day", "a", "restart-ms=7")  # a node of that name


@contextlib.contextmanager
def stopped(pid):
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def test_a_bus_that_hangs_may_have_the_name(service, tmp_path):
    one = service(GOOD + "control: run/unit.sock\n")
    other = GOOD.replace("name: day", "name: else") + f"control: {tmp_path}/run/other.sock\n"
    with running(tmp_path / "b", other, None) as (_, pid):
        with stopped(pid):
            told = one.canwire("inject", "day", NO_RULES, status=1)
            assert told == ("canwire: bus day: unit has this name, and maybe one that does not "
                            f"answer; take one of their sockets in {tmp_path}/run: unit, other\n")
            one.canwire("inject", "unit", NO_RULES)
            for words in (["status"], ["status", "--check"]):
                assert "day: " in one.canwire(*words, "day"), "who looks does no harm"
        one.canwire("inject", "day", NO_RULES)
        with stopped(one.process.pid):
            told = one.canwire("inject", "day", NO_RULES, status=1)
            assert told == (f"canwire: bus day: not found; those in {tmp_path}/run: other, unit; "
                            "it may be one that does not answer: unit\n")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root is somebody else")
def test_what_is_for_other_users_is_no_bus_that_is_not_there(service, tmp_path):
    one = service(GOOD + "control: run/unit.sock\n")
    (tmp_path / "run").chmod(0o755)
    for folder in tmp_path, *tmp_path.parents:
        if folder.stat().st_uid == os.geteuid() and not folder.stat().st_mode & 0o001:
            folder.chmod(0o755)
    tool = shutil.copy(CANWIRE, tmp_path / "canwire")

    def nobody(*words, status=1):
        done = subprocess.run([tool, *words], env=one.environment, capture_output=True, text=True,
                              user=65534, group=65534, extra_groups=[], timeout=TIMEOUT_S,
                              check=False)
        assert done.returncode == status, done.stderr
        return done.stdout + done.stderr

    denied = "Permission denied"
    assert nobody("faults", "day") == (
        f"canwire: bus day: not found; those in {tmp_path}/run: unit; it may be one of other "
        f"users (are you in the group canwire?): unit: {denied}\n")
    assert denied in nobody("faults", "unit")
    for words, status in ((["status"], 1), (["status", "--check"], 2), (["top", "--once"], 1)):
        told = nobody(*words, status=status)
        assert denied in told and "no bus" not in told
    for mode in 0o711, 0o700:
        (tmp_path / "run").chmod(mode)
        for words in ["faults", "day"], ["status"], ["status", "--json"], ["top", "--once"]:
            told = nobody(*words)
            assert denied in told and "no such bus" not in told and "no bus" not in told
        assert denied in nobody("status", "--check", status=2)
