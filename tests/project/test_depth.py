# SPDX-License-Identifier: MIT
"""The samples of `make test`: always the same, of every module, and all in `make test-deep`."""

import os
import subprocess
import sys

import pytest

from simtool import ROOT

MODULES = {
    "test_a": "def test_long(): pass\ntest_long = pytest.mark.deep(test_long)\n"
              "@pytest.mark.parametrize('n', range(5))\ndef test_cases(n): pass\n",
    "test_b": "".join(f"def test_{n}(): pass\n" for n in range(40)),
    "test_c": "pytestmark = pytest.mark.kept\n" +
              "".join(f"def test_{n}(): pass\n" for n in range(10)),
    "test_d": "def test_alone(): pass\n",
}


@pytest.fixture(name="collect")
def fixture_collect(tmp_path):
    """collect(depth, options...) returns the chosen tests of MODULES."""
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    deep: a\n    kept: b\n"
                                         f"pythonpath = {ROOT}/tests/support\n")
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["depth"]\n')
    for name, text in MODULES.items():
        (tmp_path / f"{name}.py").write_text(f"import pytest\n{text}")

    def collect(depth, *options):
        out = subprocess.run([sys.executable, "-m", "pytest", "-q", "--collect-only",
                              "-p", "no:cacheprovider", *options, tmp_path], cwd=tmp_path,
                             capture_output=True, text=True, check=True, timeout=600,
                             env={**os.environ, "TESTS": depth}).stdout
        return [line.rpartition("/")[2] for line in out.splitlines() if "::" in line]

    return collect


def test_a_sample_has_all_but_what_is_for_the_deep_run(collect):
    every = collect("deep", "--cases=2", "--every=4")
    assert len(every) == 1 + 5 + 40 + 10 + 1
    assert set(every) - set(collect("sample")) == {"test_a.py::test_long"}


def test_a_sample_is_always_the_same_and_of_every_module(collect):
    some = collect("sample", "--cases=2", "--every=4")
    assert some == collect("sample", "--cases=2", "--every=4")
    found = {name: [one for one in some if one.startswith(name)] for name in MODULES}
    assert len(found["test_c"]) == 10 and len(found["test_d"]) == 1
    assert 0 < len(found["test_b"]) < 20
    assert collect("sample", "--cases=2")[:3] == [f"test_a.py::test_cases[{n}]" for n in (0, 2, 4)]
