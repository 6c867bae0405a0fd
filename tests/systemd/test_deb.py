# SPDX-License-Identifier: MIT
"""The Debian packages (`make deb` has made them): installed, used, purged."""

import grp
import os
import pwd
import socket
from pathlib import Path

import pytest

from conftest import PAIR, RMEM_MAX, RMEM_MAX_DEFAULT, ROOT, Bus, run, systemctl

ELSEWHERE = ["/etc", "/run", "/var"]  # folders in which a package may leave unlisted files
PYTHON_CACHE = Path("/usr/lib/python3/dist-packages/canwire/__pycache__")
NOT_OURS = ["/run/systemd", "/run/log", "/run/lock", "/var/lib/dpkg", "/var/lib/apt", "/var/cache",
            "/var/log", "/var/backups"]  # files of systemd and dpkg


def run_at_a_node(*program):
    """Runs a program with the library of the package; a listener is enough to begin."""
    config, port = Path("/run/run.yaml"), Path("/run/run.sock")
    config.write_text('bus: { bitrate: 500000 }\nnodes: [ { name: x, port: "unix:run.sock" } ]\n')
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(port))
        listener.listen()
        try:
            return run("canwire", "run", "--bus", config, "--as", "x", *program).split()
        finally:
            config.unlink()
            port.unlink()


def find_package(name):
    found = sorted((ROOT / "build/deb").glob(f"{name}_*.deb"))
    assert len(found) == 1, f"there is no package, or more than one; make deb: {found}"
    return found[0]


@pytest.fixture(scope="module", name="package")
def fixture_package():
    return find_package("canwire")


def dpkg(*words):
    """Triggers would make the database of man pages anew."""
    return run("dpkg", "--no-triggers", "--force-unsafe-io", *words)


def tree():
    prune = [word for path in NOT_OURS for word in ("-path", path, "-prune", "-o")]
    return set(run("find", *ELSEWHERE, *prune, "-print").splitlines())


def accounts():
    return {u.pw_name for u in pwd.getpwall()}, {g.gr_name for g in grp.getgrall()}


def units():
    return run("systemctl", "list-units", "--all", "--plain", "--no-legend", "canwire*@*")


def files_of(package):
    """Returns the paths of a package that are no folders; its database of all packages is slow to
    read."""
    lines = run("dpkg-deb", "--contents", package).splitlines()
    return [Path("/", line.split()[5]) for line in lines if not line.startswith("d")]


def test_it_is_installed_used_and_purged_without_a_trace(package):
    before, accounts_before, python = tree(), accounts(), find_package("python3-canwire")
    files = [*files_of(package), *files_of(python)]
    RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
    dpkg("-i", package, python)
    assert RMEM_MAX.read_text() == "8388608\n"
    assert len(files) > 40 and [f for f in files if not f.is_file()] == []
    assert Path("/etc/canwire").is_dir() and Path("/run/canwire").is_dir()
    for name in ("canwire", "canwired"):  # sbin, which comes first for root, has links
        assert Path(run("which", name).strip()).resolve() == Path("/usr/bin") / name
    assert "LD_PRELOAD=/usr/bin/../lib/canwire/libcanwire-socketcan.so" in run_at_a_node("env")
    assert "canwire" in accounts()[0] and "canwire" in accounts()[1]
    use_python()
    bus = use()
    dpkg("--purge", "python3-canwire", "canwire")
    assert [f for f in [*files, PYTHON_CACHE] if f.exists()] == []
    assert units() == ""  # nor one that has failed
    kept = [names | {"canwire"} for names in accounts_before]
    assert list(accounts()) == kept, "the user's number is not to be used again"
    assert tree() - before == {"/etc/canwire", str(bus.config)}, "a configuration is the user's"
    assert "no packages found" in run("dpkg-query", "-W", "canwire", status=1)


@pytest.mark.deep
def test_limits_of_the_kernel_are_not_raised_against_the_administrator(package):
    mask = Path("/etc/sysctl.d/10-canwire.conf")
    mask.parent.mkdir(exist_ok=True)
    mask.symlink_to("/dev/null")
    try:
        RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
        dpkg("-i", package)
        assert RMEM_MAX.read_text() == RMEM_MAX_DEFAULT + "\n"
    finally:
        mask.unlink()
        dpkg("--purge", "canwire")


@pytest.mark.deep
def test_limits_of_the_kernel_are_never_lowered(package):
    RMEM_MAX.write_text("16777216")
    try:
        dpkg("-i", package)
        assert RMEM_MAX.read_text() == "16777216\n"
    finally:
        RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
        dpkg("--purge", "canwire")


# A scenario, python-can and the plugin of pytest, with the Python of the system.
PROGRAM = """
import importlib.metadata, canwire, can
from canwire import _library
bus = canwire.Bus.from_dict({"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}, {"name": "b"}]})
bus.inject(name="x", when={"frame": "123", "count": 1}, do={"flip": "crc[3]", "at": ["b"]})
bus.send("a", "123#11")
print(canwire.__file__, _library.library().path, bus.recv("b", "1s"), bus["a"].tec)
with can.Bus(interface="canwire", channel="x") as one, can.Bus("x", interface="canwire") as other:
    one.send(can.Message(arbitration_id=0x123, data=[7]))
    print(other.recv(60).data[0])
plugins = importlib.metadata.entry_points(group="pytest11")
print([point.load().__name__ for point in plugins if point.name == "canwire"])
"""


def use_python():
    """Runs PROGRAM. Debian has python-can and pytest, too; here they are those of the tests."""
    others = next((ROOT / "build/venv/lib").glob("python3*/site-packages"))
    said = run("env", "-C", "/run", f"PYTHONPATH={others}", "/usr/bin/python3", "-c", PROGRAM)
    assert said.splitlines() == [
        "/usr/lib/python3/dist-packages/canwire/__init__.py /usr/lib/canwire/libcanwire-sim.so "
        "123#11 8", "7", "['canwire.pytest_plugin']"]
    assert len(list(PYTHON_CACHE.glob("bus.*.pyc"))) == 1
    assert "depends on canwire" in run("dpkg", "--no-triggers", "-r", "canwire", status=1)


def use():
    """Returns a bus that is enabled and runs when the package is removed."""
    bus = Bus("pack", PAIR.format("pack"))
    systemctl("enable", "--now", bus.unit)
    assert bus.carries()
    assert bus.status()["bus"]["name"] == "pack"
    assert os.stat(bus.socket).st_gid == grp.getgrnam("canwire").gr_gid
    assert "/usr/bin/canwired" in bus.show("ExecStart")
    return bus
