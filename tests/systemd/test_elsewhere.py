# SPDX-License-Identifier: MIT
"""make install below a prefix where systemd does not look by itself."""

import os
import subprocess
from pathlib import Path

import pytest

from conftest import PAIR, RMEM_MAX, RMEM_MAX_DEFAULT, ROOT, Bus, systemctl

PREFIX = Path("/opt/canwire")
ACCOUNTS = ("/lib/sysusers.d/canwire.conf", "/lib/tmpfiles.d/canwire.conf")


def install_files(what):
    places = {"PREFIX": str(PREFIX), "UNITDIR": "/etc/systemd/system",
              "SYSCONFDIR": "/etc"}
    done = subprocess.run([ROOT / "scripts/install-files", what], capture_output=True, text=True,
                          check=False, env=os.environ | places)
    assert done.returncode == 0, done.stderr


@pytest.fixture(name="elsewhere")
def fixture_elsewhere():
    assert not [f for f in ACCOUNTS for p in ("/usr", "/usr/local") if Path(p + f).exists()]
    RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
    install_files("install")
    yield
    install_files("uninstall")
    systemctl("daemon-reload")


@pytest.mark.deep
def test_what_is_installed_elsewhere_runs(elsewhere):  # pylint: disable=unused-argument
    """User, runtime directory and room at sockets are there at once."""
    assert RMEM_MAX.read_text() == "8388608\n"
    assert Path("/run/canwire").group() == "canwire"
    bus = Bus("opt", PAIR.format("opt"))
    bus.start()
    assert bus.carries()
    process = Path(f"/proc/{bus.pid()}")
    assert (process.owner(), os.readlink(process / "exe")) == ("canwire", f"{PREFIX}/bin/canwired")
    bus.close()
