# SPDX-License-Identifier: MIT
"""A machine is switched off while a bus runs, and boots again. Namespaces, interfaces, bus and ECU
are there in their order, at the first attempt. The recording of before is kept.

The guest of boot.py boots twice with one disk.
"""

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 900


def boot(disk, which):
    done = subprocess.run(
        [ROOT / "scripts/guest", "-t", str(LIMIT_S), "--systemd", "--disk", disk, "--",
         "python3", ROOT / "tests/reboot/boot.py", which],
        cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_all_is_there_again_after_a_reboot(tmp_path):
    disk = tmp_path / "disk"
    assert boot(disk, "first") == "first: well\n"
    assert boot(disk, "second") == "second: well\n"
