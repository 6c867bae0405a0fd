# SPDX-License-Identifier: MIT
"""The end of an installation. Modules run in the order of their names: this is the last one."""

from pathlib import Path

import pytest

from conftest import PAIR, ROOT, Bus, links, run, systemctl

pytestmark = pytest.mark.usefixtures("installed")
WANTS = Path("/etc/systemd/system/multi-user.target.wants")


def test_uninstall_ends_what_runs():
    bus = Bus("going", PAIR.format("going"))
    systemctl("enable", "--now", bus.unit, "canwired@asked.socket")
    assert bus.carries() and (WANTS / bus.unit).is_symlink()
    pid = bus.pid()
    run(ROOT / "scripts/install-files", "uninstall")
    assert not Path(f"/proc/{pid}").exists() and not {"going0", "going1"} & links()
    assert not (WANTS / bus.unit).is_symlink()
    assert [m for m in bus.messages() if "stopped: " in m["MESSAGE"]]
    assert systemctl("list-units", "--all", "--plain", "--no-legend", "canwire*@*") == ""
    bus.config.unlink()
