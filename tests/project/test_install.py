# SPDX-License-Identifier: MIT
"""make install puts everything where it belongs, and make uninstall takes exactly that away."""

import os
import pathlib
import re
import stat
import subprocess
import tempfile

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
NOBODY = 65534
MUST = [  # of each kind
    "/bin/canwire", "/bin/canwired", "/bin/canwire-usb", "/lib/canwire/libcanwire-socketcan.so",
    "/lib/canwire/libcanwire-sim.so", "/include/canwire-sim.h",
    "/lib/systemd/system/canwired@.service",
    "/lib/systemd/system/canwire-vcan@.service", "/lib/systemd/system/canwired@.socket",
    "/lib/systemd/system/canwire-usb@.service", "/share/man/man8/canwire-usb.8",
    "/lib/sysusers.d/canwire.conf",
    "/lib/tmpfiles.d/canwire.conf", "/lib/sysctl.d/10-canwire.conf",
    "/share/bash-completion/completions/canwire", "/share/bash-completion/completions/canwired",
    "/share/bash-completion/completions/canwire-usb",
    "/share/bash-completion/completions/canwire-restbus",
    "/share/man/man1/canwire.1", "/share/man/man5/canwire.yaml.5",
    "/share/man/man7/canwire-faults.7", "/share/man/man7/canwire-operation.7",
    "/share/man/man7/canwire-lcm.7", "/share/man/man7/canwire-run.7",
    "/share/man/man8/canwired.8", "/bin/canwire-restbus", "/lib/canwire/restbus.py",
    "/share/man/man1/canwire-restbus.1", "/share/canwire/restbus/car.dbc",
    "/share/canwire/canwire.schema.json", "/share/canwire/profiles/cable-cut.yaml",
    "/share/canwire/campaign/parallel.sh", "/share/canwire/lcm/event_t.lcm",
    "/share/canwire/example.yaml",
    "/share/doc/canwire/README.md", "/share/man/man7/canwire-control.7",
    "/share/doc/canwire/DESIGN.md",
    "/share/doc/canwire/examples/realtime.conf",
    "/share/doc/canwire/examples/slower-restarts.conf",
    "/share/doc/canwire/examples/powertrain.yaml", "/share/doc/canwire/examples/rig.yaml",
    "/share/doc/canwire/examples/rig-body.yaml", "/share/doc/canwire/examples/rig-chassis.yaml",
]


@pytest.fixture(name="make")
def fixture_make(tmp_path):
    """make("install") calls make for a folder; returns what it wrote to standard error."""
    destination = tmp_path / "root"
    destination.mkdir()

    def make(target, prefix="/usr", **more):
        variables = {"DESTDIR": destination, "PREFIX": prefix, **more}
        done = subprocess.run(
            ["make", "-s", target, *(f"{k}={v}" for k, v in variables.items())],
            cwd=ROOT, capture_output=True, text=True, check=True,
            env={k: v for k, v in os.environ.items() if not k.startswith("MAKE")},
        )
        return done.stderr

    make.root = destination
    return make


def tree(root):
    """Returns each path below a folder, with its mode and content."""
    return {
        str(path.relative_to(root)): (stat.filemode(path.stat().st_mode),
                                      path.read_bytes() if path.is_file() else None)
        for path in root.rglob("*")
    }


def populate(root):
    """Makes the earlier state of a system: files of others, and empty folders."""
    for name in ("usr/bin/other", "usr/share/man/man1/other.1", "usr/share/doc/other/README"):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("other\n")
    for name in ("usr/sbin", "usr/share/man/man7", "etc", "usr/lib/systemd"):
        (root / name).mkdir(parents=True)


@pytest.mark.parametrize("prepare", [lambda root: None, populate], ids=["empty", "populated"])
def test_uninstall_leaves_what_was_there_before(make, prepare):
    prepare(make.root)
    before = tree(make.root)
    make("install")
    assert len(tree(make.root)) > len(before) + 40
    make("uninstall")
    assert tree(make.root) == before
    assert "nothing is installed" in make("uninstall")


@pytest.mark.parametrize("prefix", ["/usr", "/opt/canwire"])
def test_everything_is_where_it_belongs(make, prefix):
    make("install", prefix)
    files = {f"/{name}" for name, (_, content) in tree(make.root).items() if content is not None}
    assert [path for path in MUST if prefix + path not in files] == []
    conf = {"/usr": "/etc"}.get(prefix, f"{prefix}/etc")
    assert (make.root / f"{conf[1:]}/canwire").is_dir()
    for unit in (make.root / prefix[1:] / "lib/systemd/system").iterdir():
        text = unit.read_text()
        assert not re.search("@[A-Z]", text), unit
        programs = re.findall(r"^Exec\w+=(/\S+)", text, re.MULTILINE)
        runs = unit.suffix == ".service"
        assert bool(programs) == runs and set(programs) <= files, unit
        assert f"{conf}/canwire/%i.yaml" in text or not runs
        pages = re.findall(r"man:(\S+)\((\d)\)", text)
        assert pages and {f"{prefix}/share/man/man{n}/{page}.{n}" for page, n in pages} <= files
    polkit = f"{prefix}/share" if prefix == "/usr" else conf
    assert f"{polkit}/polkit-1/rules.d/50-canwire.rules" in files
    extcap, = (f for f in files if f.endswith("/wireshark/extcap/canwire"))
    assert f"exec {prefix}/bin/canwire extcap " in (make.root / extcap[1:]).read_text()
    modes = {name: mode for name, (mode, _) in tree(make.root).items()}
    assert modes[f"{prefix[1:]}/bin/canwire"] == "-rwxr-xr-x"
    assert modes[extcap[1:]] == "-rwxr-xr-x"
    assert modes[f"{prefix[1:]}/share/canwire/example.yaml"] == "-rw-r--r--"
    assert modes[f"{prefix[1:]}/share/canwire/campaign/parallel.sh"] == "-rwxr-xr-x"


def test_folders_can_be_chosen(make):
    make("install", "/usr", SYSCONFDIR="/conf", UNITDIR="/units", EXTCAPDIR="/sharks")
    text = (make.root / "units/canwired@.service").read_text()
    assert "/usr/bin/canwired -c /conf/canwire/%i.yaml" in text
    assert (make.root / "conf/canwire").is_dir()
    assert (make.root / "sharks/canwire").is_file()
    assert not (make.root / "etc").exists()


def test_the_earlier_places_lead_to_the_programs(make):
    """An earlier version had them in sbin; it may be that one that is replaced."""
    old = make.root / "usr/sbin/canwired"
    old.parent.mkdir(parents=True)
    old.write_text("earlier")
    make("install")
    for name in ("canwired", "canwire-usb"):
        link = make.root / "usr/sbin" / name
        assert os.readlink(link) == f"../bin/{name}" and link.is_file()
        assert not (make.root / "usr/bin" / name).is_symlink()


def test_one_folder_of_both_names_has_the_programs(make):
    (make.root / "usr/bin").mkdir(parents=True)
    (make.root / "usr/sbin").symlink_to("bin")
    make("install")
    for name in ("canwired", "canwire-usb"):
        path = make.root / "usr/bin" / name
        assert path.is_file() and not path.is_symlink()


@pytest.fixture(name="home")
def fixture_home():
    """The home of a user without rights. That of pytest is for root alone."""
    with tempfile.TemporaryDirectory() as folder:
        if os.geteuid() == 0:
            os.chown(folder, NOBODY, NOBODY)
        yield pathlib.Path(folder)


def as_user(home, *command):
    """Runs a command as that user."""
    user = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}
    return subprocess.run([*(user if os.geteuid() == 0 else []), *command], cwd=ROOT, text=True,
                          capture_output=True, check=False, env={**environment, "HOME": str(home)})


@pytest.mark.parametrize("prefix", ["~/x", "{home}/x"])
def test_a_user_installs_for_himself(home, prefix):
    """All of it is below the prefix, and what is there runs."""
    done = as_user(home, "make", "-s", "install", f"PREFIX={prefix.format(home=home)}")
    assert done.returncode == 0, done.stderr
    assert f"the programs are in {home}/x/bin, not in PATH" in done.stderr
    assert f"the units read {home}/x/etc/canwire" in done.stderr
    assert [path.name for path in home.iterdir()] == ["x"]
    files = {str(path.relative_to(home / "x")) for path in (home / "x").rglob("*")}
    assert [path for path in MUST if path[1:] not in files] == []
    for program in ("canwire", "canwired", "canwire-usb", "canwire-restbus"):
        found = as_user(home, home / "x/bin" / program, "--help")
        assert (found.returncode, found.stderr) == (0, ""), program
    as_user(home, "make", "-s", "uninstall", f"PREFIX={home}/x")
    assert list(home.iterdir()) == []


def test_a_prefix_with_blanks_is_refused(home):
    done = as_user(home, "make", "-s", "install", "PREFIX=~/a b")
    assert done.returncode != 0 and "no paths with blanks" in done.stderr
    assert list(home.iterdir()) == []


def test_installing_again_changes_nothing_and_forgets_nothing(make):
    make("install")
    once = tree(make.root)
    make("install")
    assert tree(make.root) == once
    make("uninstall")
    assert tree(make.root) == {}


def test_what_a_new_version_has_no_more_goes(make):
    make("install")
    once = tree(make.root)
    manifest = make.root / "usr/share/canwire/manifest"
    old = make.root / "usr/share/canwire/profiles/old.yaml"
    old.write_text("faults: []\n")
    manifest.write_text(manifest.read_text() + "file /usr/share/canwire/profiles/old.yaml\n")
    make("install")
    assert tree(make.root) == once


def test_configurations_stay(make):
    make("install")
    config = make.root / "etc/canwire/rig.yaml"
    config.write_text("bus: { bitrate: 500000 }\n")
    make("uninstall")
    assert set(tree(make.root)) == {"etc", "etc/canwire", "etc/canwire/rig.yaml"}


@pytest.mark.parametrize("program", ["bin/canwire", "bin/canwired", "bin/canwire-usb"])
def test_programs_are_hardened(make, program):
    """As those of Debian's packages: what readelf says of what is installed."""
    make("install")
    path = make.root / "usr" / program

    def readelf(option):
        return subprocess.run(["readelf", "-W", option, path], capture_output=True, text=True,
                              check=True).stdout

    assert re.search(r"Type:\s+DYN", readelf("-h"))
    segments, dynamic, symbols = readelf("-l"), readelf("-d"), readelf("-s")
    assert "GNU_RELRO" in segments and re.search(r"FLAGS_1.*NOW.*PIE", dynamic)
    assert "TEXTREL" not in dynamic and not re.search("R(UN)?PATH", dynamic)
    assert re.search(r"GNU_STACK .* RW ", segments)
    assert "__stack_chk_fail" in symbols
    assert re.search(r"__(sprintf|snprintf|vsnprintf|memcpy|fprintf|printf)_chk", symbols)
