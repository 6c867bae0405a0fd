# SPDX-License-Identifier: MIT
"""The wheel: it is installed without a network, and needs no compiler and no library."""

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile

import pytest

from simtool import ROOT

VERSION = re.search(r"^VERSION := (.*)", (ROOT / "Makefile").read_text(), re.M)[1]
PROGRAM = """
import importlib.metadata as metadata, pathlib, canwire
from canwire import _library
bus = canwire.Bus.from_dict({"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}, {"name": "b"}]})
bus.send("a", "123#11")
print(bus.recv("b", "1s"), bus.run(), metadata.version("canwire"), bus.stats()["bus"]["frames"])
print([point.name for point in metadata.entry_points(group="can.interface")])
print(pathlib.Path(_library.library().path).parent == pathlib.Path(canwire.__file__).parent)
print(sorted(line.split("/")[-1].strip() for line in open("/proc/self/maps")
             if "/canwire/" in line and ".so" in line and " r-xp " in line))
"""


@pytest.fixture(name="made", scope="module")
def fixture_made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(["flock", "build", "make", "-s", "build/release/wheel/libcanwire-sim.so"],
                   cwd=ROOT, check=True)  # another process may have the same wish
    done = subprocess.run([ROOT / "scripts/wheel", VERSION,
                           ROOT / "build/release/wheel/libcanwire-sim.so", folder], check=True,
                          capture_output=True, text=True)
    return done.stdout.split()


def test_a_wheel_works_in_a_fresh_environment(made, tmp_path):
    venv.create(tmp_path / "venv", with_pip=False)
    python = tmp_path / "venv/bin/python"
    environment = {key: value for key, value in os.environ.items()
                   if key not in ("CANWIRE_SIM_LIBRARY", "PYTHONPATH")}
    environment["HOME"] = str(tmp_path)
    subprocess.run([sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-index",
                    "--disable-pip-version-check", made[0]], check=True, env=environment,
                   cwd=tmp_path)
    done = subprocess.run([python, "-c", PROGRAM], capture_output=True, text=True, check=True,
                          env=environment, cwd=tmp_path)
    frame, points, own, loaded = done.stdout.splitlines()
    assert frame == f"123#11 Stop.END {VERSION} 1" and points == "['canwire']" and own == "True"
    assert loaded == "['libcanwire-sim.so', 'libjansson.so.4', 'libyaml-0.so.2']"


def test_the_wheel_is_for_any_python_3_of_this_c_library(made):
    assert re.search(r"canwire-[\d.]+-py3-none-manylinux_2_\d+_\w+\.whl$", made[0])
    with zipfile.ZipFile(made[0]) as wheel:
        names = wheel.namelist()
        record = wheel.read(f"canwire-{VERSION}.dist-info/RECORD").decode().splitlines()
    assert "canwire/py.typed" in names
    assert [line.split(",")[0] for line in record] == names


def test_the_source_package_has_all_of_the_package(made):
    with tarfile.open(made[1]) as sources:
        names = sources.getnames()
    head = f"canwire-{VERSION}"
    for wanted in ("PKG-INFO", "VERSION", "LICENSE", "README.md", "pyproject.toml",
                   "src/canwire/bus.py"):
        assert f"{head}/{wanted}" in names
    assert not [name for name in names if "__pycache__" in name or name.endswith(".so")]
