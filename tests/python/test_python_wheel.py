# SPDX-License-Identifier: MIT
"""The packages: they are installed without a network. The wheel needs no compiler and no library.
The source package makes its library.
"""

import os
import pathlib
import re
import shutil
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


LIBRARY = "build/release/wheel/libcanwire-sim.so"


def make_packages(folder, **more):
    """Returns the paths of the wheel and of the source package."""
    done = subprocess.run([ROOT / "scripts/wheel", ROOT / LIBRARY, folder], check=True,
                          capture_output=True, text=True, env={**os.environ, **more})
    return done.stdout.split()


@pytest.fixture(name="made", scope="module")
def fixture_made(tmp_path_factory):
    subprocess.run(["flock", "build", "make", "-s", LIBRARY], cwd=ROOT,
                   check=True)  # another process may have the same wish
    return make_packages(tmp_path_factory.mktemp("wheel"))


def environment(folder, **more):
    """Returns an environment without the library of the tests."""
    plain = {key: value for key, value in os.environ.items()
             if key not in ("CANWIRE_SIM_LIBRARY", "PYTHONPATH")}
    return {**plain, "HOME": str(folder), **more}


def install_and_run(folder, package, **more):
    """Installs a package in a fresh environment; what PROGRAM prints there."""
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv/bin/python"
    subprocess.run([sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-index",
                    "--no-build-isolation", "--no-cache-dir", "--disable-pip-version-check",
                    package], check=True, cwd=folder, env=environment(folder, **more))
    done = subprocess.run([python, "-c", PROGRAM], capture_output=True, text=True, check=True,
                          env=environment(folder, **more), cwd=folder)
    return done.stdout.splitlines()


def test_a_wheel_works_in_a_fresh_environment(made, tmp_path):
    frame, points, own, loaded = install_and_run(tmp_path, made[0])
    done = subprocess.run([tmp_path / "venv/bin/canwire-restbus", "--help"], check=True,
                          capture_output=True, text=True, env=environment(tmp_path))
    assert done.stdout.startswith("usage: canwire-restbus ")
    assert frame == f"123#11 Stop.END {VERSION} 1" and points == "['canwire']" and own == "True"
    assert loaded == "['libcanwire-sim.so', 'libjansson.so.4', 'libyaml-0.so.2']"


def test_the_wheel_is_for_any_python_3_of_this_c_library(made):
    assert re.search(r"canwire-[\d.]+-py3-none-manylinux_2_\d+_\w+\.whl$", made[0])
    with zipfile.ZipFile(made[0]) as wheel:
        names = wheel.namelist()
        record = wheel.read(f"canwire-{VERSION}.dist-info/RECORD").decode().splitlines()
        licences = {name.rpartition("/")[2]: wheel.read(name).decode()
                    for name in names if "/licenses/" in name}
    assert "canwire/py.typed" in names
    assert [line.split(",")[0] for line in record] == names
    # those of the libraries that are copied
    assert sorted(licences) == ["LICENSE", "libjansson.txt", "libyaml-0.txt"]
    assert all("Permission is hereby granted" in text for text in licences.values())
    assert "Kirill Simonov" in licences["libyaml-0.txt"]
    assert "Petri Lehtinen" in licences["libjansson.txt"]


@pytest.mark.parametrize("seed", ["0", "5"])  # sets of libraries have two orders with them
def test_packages_that_are_made_again_are_the_same(made, seed, tmp_path):
    again = make_packages(tmp_path, PYTHONHASHSEED=seed)
    assert [pathlib.Path(path).read_bytes() for path in again] == \
        [pathlib.Path(path).read_bytes() for path in made]


def test_the_source_package_makes_its_library(made, tmp_path):
    # without optimisation, and with the help of earlier runs
    compiler = "ccache gcc" if shutil.which("ccache") else "gcc"
    frame, points, own, loaded = install_and_run(
        tmp_path, made[1], VARIANT="debug", CFLAGS="-g0", CC=compiler,
        CCACHE_DIR=os.environ.get("CCACHE_DIR", os.path.expanduser("~/.cache/ccache")))
    assert frame == f"123#11 Stop.END {VERSION} 1" and points == "['canwire']" and own == "True"
    assert loaded == "['libcanwire-sim.so']"  # the others are those of the system
    with tarfile.open(made[1]) as sources:
        names = sources.getnames()
    # it makes itself again, to the byte
    again = tmp_path / "again"
    again.mkdir()
    code = f"import canwire_build as build; build.build_sdist({str(again)!r})"
    shutil.unpack_archive(made[1], tmp_path)
    subprocess.run([sys.executable, "-B", "-c", code], check=True,
                   cwd=tmp_path / f"canwire-{VERSION}")
    assert next(again.iterdir()).read_bytes() == pathlib.Path(made[1]).read_bytes()
    assert not [name for name in names if "__pycache__" in name or name.endswith(".so")]


def build(folder, words="", **more):
    """Runs the backend of pip, as pip does."""
    code = f"import canwire_build as build{words}; print(build.build_wheel({str(folder)!r}))"
    return subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True,
                          cwd=ROOT / "lib/python", check=False,
                          env=environment(folder, **more))


def test_a_library_that_is_installed_is_used_when_it_is_named(tmp_path):
    done = build(tmp_path, CANWIRE_SIM_LIBRARY=os.environ["CANWIRE_SIM_LIBRARY"])
    assert done.stdout == f"canwire-{VERSION}-py3-none-any.whl\n", done.stderr
    with zipfile.ZipFile(tmp_path / done.stdout.strip()) as wheel:
        assert not [name for name in wheel.namelist() if name.endswith(".so")]
    done = build(tmp_path, CANWIRE_SIM_LIBRARY="/none.so")
    assert done.returncode == 1
    assert done.stderr == "canwire: CANWIRE_SIM_LIBRARY=/none.so cannot be loaded\n"
    code = "import canwire; canwire.Bus('bus.yaml')"
    done = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True,
                          check=False, env=environment(tmp_path, CANWIRE_SIM_LIBRARY="/none.so",
                                                       PYTHONPATH=str(ROOT / "lib/python/src")))
    assert "libcanwire-sim.so cannot be loaded: /none.so: cannot open" in done.stderr
    assert "Install this package by pip, or canwire, or set CANWIRE_SIM_LIBRARY" in done.stderr


def test_what_is_missing_is_said_with_the_packages_that_have_it(tmp_path):
    nothing = "; build.installed_library = lambda: None"
    done = build(tmp_path, nothing, PATH="/none")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "without make, cc, and none is installed" in done.stderr
    assert "sudo apt install make gcc\n" in done.stderr
    compiler = tmp_path / "compiler"  # without headers of libraries
    compiler.write_text("#!/bin/sh\nexit 1\n")
    compiler.chmod(0o755)
    done = build(tmp_path, nothing, CC=str(compiler))
    assert "sudo apt install libyaml-dev libjansson-dev\n" in done.stderr


def test_a_checkout_is_installed_for_editing(tmp_path):
    library = os.environ["CANWIRE_SIM_LIBRARY"]
    words = "; build.build_wheel = build.build_editable"
    done = build(tmp_path, words, CANWIRE_SIM_LIBRARY=library)
    with zipfile.ZipFile(tmp_path / done.stdout.strip()) as wheel:
        assert wheel.read("canwire.pth").decode() == f"{ROOT}/lib/python/src\n"
        assert f"canwire-{VERSION}.dist-info/entry_points.txt" in wheel.namelist()
