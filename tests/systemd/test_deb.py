# SPDX-License-Identifier: MIT
"""The Debian package (`make deb` has made it): installed, used, purged."""

import grp
import os
import pwd
from pathlib import Path

import pytest

from conftest import PAIR, RMEM_MAX, RMEM_MAX_DEFAULT, ROOT, Bus, run, systemctl

ELSEWHERE = ["/etc", "/run", "/var"]  # folders in which a package may leave unlisted files
NOT_OURS = ["/run/systemd", "/run/log", "/run/lock", "/var/lib/dpkg", "/var/lib/apt", "/var/cache",
            "/var/log", "/var/backups"]  # files of systemd and dpkg


def run_at_a_node(*program):
    """Runs a program with the library of the package; it needs no bus to begin."""
    config, port = Path("/run/run.yaml"), Path("/run/run.sock")
    config.write_text('bus: { bitrate: 500000 }\nnodes: [ { name: x, port: "unix:run.sock" } ]\n')
    port.touch()
    try:
        return run("canwire", "run", "--bus", config, "--as", "x", *program).split()
    finally:
        config.unlink()
        port.unlink()


@pytest.fixture(scope="module", name="package")
def fixture_package():
    found = sorted((ROOT / "build/deb").glob("canwire_*.deb"))
    assert len(found) == 1, f"there is no package, or more than one; make deb: {found}"
    return found[0]


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
    before, accounts_before, files = tree(), accounts(), files_of(package)
    RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
    dpkg("-i", package)
    assert RMEM_MAX.read_text() == "8388608\n"
    assert len(files) > 40 and [f for f in files if not f.is_file()] == []
    assert Path("/etc/canwire").is_dir() and Path("/run/canwire").is_dir()
    assert run("which", "canwire", "canwired").split() == ["/usr/bin/canwire", "/usr/sbin/canwired"]
    assert "LD_PRELOAD=/usr/bin/../lib/canwire/libcanwire-socketcan.so" in run_at_a_node("env")
    assert "canwire" in accounts()[0] and "canwire" in accounts()[1]
    bus = use()
    dpkg("--purge", "canwire")
    assert [f for f in files if f.exists()] == []
    assert units() == ""
    kept = [names | {"canwire"} for names in accounts_before]
    assert list(accounts()) == kept, "the user's number is not to be used again"
    assert tree() - before == {"/etc/canwire", str(bus.config)}, "a configuration is the user's"
    assert "no packages found" in run("dpkg-query", "-W", "canwire", status=1)


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


def test_limits_of_the_kernel_are_never_lowered(package):
    RMEM_MAX.write_text("16777216")
    try:
        dpkg("-i", package)
        assert RMEM_MAX.read_text() == "16777216\n"
    finally:
        RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
        dpkg("--purge", "canwire")


def use():
    """Returns a bus that is enabled and runs when the package is removed."""
    bus = Bus("pack", PAIR.format("pack"))
    systemctl("enable", "--now", bus.unit)
    assert bus.carries()
    assert bus.status()["bus"]["name"] == "pack"
    assert os.stat(bus.socket).st_gid == grp.getgrnam("canwire").gr_gid
    assert "/usr/sbin/canwired" in bus.show("ExecStart")
    return bus
