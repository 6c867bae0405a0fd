# SPDX-License-Identifier: MIT
"""A test that never ends fails, and its report shows what the processes wait for."""

import subprocess
import sys

from simtool import ROOT


def test_a_test_that_hangs_fails_and_shows_the_processes(tmp_path):
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["hang"]\n')
    (tmp_path / "test_it.py").write_text(
        "import subprocess\n"
        "def test_it():\n    subprocess.run(['sleep', '7654'], capture_output=True)\n"
        "def test_next():\n    pass\n")
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", "--timeout=3", "-o",
                           f"pythonpath={ROOT / 'tests/support'}", tmp_path], cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed, 1 passed" in done.stdout, done.stdout
    assert "processes while test_it.py::test_it hung" in done.stdout, done.stdout
    assert "sleep 7654" in done.stdout, done.stdout
