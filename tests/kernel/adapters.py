# SPDX-License-Identifier: MIT
"""Adapters for tests with a real can0: a bus, its canwire-usb, and the kernel's view of them."""

import json
import os
import subprocess
import tempfile
from pathlib import Path

import pytest

from conftest import CANWIRED, PATIENCE_S, Daemon, wait_until
from test_faults import Shell

CANWIRE_USB = os.environ.get("CANWIRE_USB") or Path(CANWIRED).with_name("canwire-usb")

BUS = """
bus: {{ name: usb, bitrate: 500000{more} }}
control: usb.sock
nodes:
{nodes}
"""


def run(*words, check=True):
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert not check or done.returncode == 0, (words, done.stderr)
    return done.stdout


def ip(line, check=True):
    return run("ip", *line.split(), check=check)


def node(name, interface, more="", port=""):
    return (f"  - {{ name: {name}, port: {{ usb: {interface}, socket: {name}.usb{port} }}{more} }}")


class Rig:
    """canwired and canwire-usb for one bus."""

    def __init__(self, nodes, more="", user=None):
        self.words = ["--user", user] if user else []
        self.folder = Path(tempfile.mkdtemp(dir="/run"))
        self.folder.chmod(0o755)  # processes without privileges read the configuration
        self.text = BUS.format(nodes="\n".join(nodes), more=more)
        self.daemon = self.adapters = None
        self.start_daemon()
        self.start_adapters()

    def start_daemon(self):
        (self.folder / "notify").unlink(missing_ok=True)
        self.daemon = Daemon(self.folder, self.text)
        self.daemon.wait_ready()
        self.shell = Shell(self.daemon)

    def start_adapters(self):
        with (self.folder / "usb.log").open("a") as log:
            self.adapters = subprocess.Popen([CANWIRE_USB, *self.words, self.daemon.config],
                                             stderr=log)

    def log(self):
        text = (self.folder / "usb.log").read_text()
        assert "Sanitizer" not in text and "runtime error:" not in text, text
        return text

    def wait_for(self, *interfaces):
        """Waits until all have their names. Before, the kernel may have given a name to another
        adapter."""
        def there_or_dead():
            return all(map(has_its_name, interfaces)) or self.adapters.poll() is not None

        wait_until(there_or_dead, interfaces)
        assert self.adapters.poll() is None, self.log()

    def servers(self):
        """Returns the processes that answer the kernel, by the start."""
        children = run("pgrep", "-P", str(self.adapters.pid), check=False).split()
        return [int(child) for child in children]

    def node(self, name):
        nodes = self.shell.status("usb")["nodes"]
        return next(n for n in nodes if n["name"] == name)

    def close(self):
        self.adapters.terminate()
        assert self.adapters.wait(PATIENCE_S) == 0, self.log()
        self.daemon.close()
        self.log()


def exists(interface):
    return Path(f"/sys/class/net/{interface}").exists()


def usb_of(interface):
    return Path(f"/sys/class/net/{interface}/device").resolve().parent


def serial(interface):
    """The serial number of an adapter is the name that it is to have."""
    return (usb_of(interface) / "serial").read_text().strip()


def has_its_name(interface):
    try:
        return serial(interface) == interface
    except OSError:  # it is not there, or is just getting a name
        return False


def details(interface):
    return json.loads(ip(f"-j -details -statistics link show {interface}"))[0]


def can_info(interface):
    return details(interface)["linkinfo"]


def state(interface):
    return can_info(interface)["info_data"]["state"]


def counter(interface):
    bec = can_info(interface)["info_data"].get("berr_counter", {"tx": 0, "rx": 0})
    return bec["tx"], bec["rx"]


def statistics(interface):
    folder = Path(f"/sys/class/net/{interface}/statistics")
    return {file.name: int(file.read_text()) for file in folder.iterdir()}


def tx_packets(interface):
    return int(Path(f"/sys/class/net/{interface}/statistics/tx_packets").read_text())


def batch(*lines):
    """Runs `ip` commands; a process costs much in an emulated machine."""
    subprocess.run(["ip", "-batch", "-"], input="\n".join(lines) + "\n", text=True, check=True,
                   timeout=PATIENCE_S)


def lines_up(interface, options):
    return (f"link set {interface} down", f"link set {interface} type can {options}",
            f"link set {interface} up")


def up(interface, options="bitrate 500000"):
    batch(*lines_up(interface, options))


def add_group(path, line):
    with Path(path).open("a", encoding="ascii") as file:
        file.write(line + "\n")


@pytest.fixture(scope="module", name="quiet_kernel")
def fixture_quiet_kernel():
    """The sockets are for a group, so that what answers the kernel needs no privileges. The kernel
    must have nothing to complain about."""
    before = {path: Path(path).read_text() for path in ("/etc/passwd", "/etc/group")}
    add_group("/etc/group", "canwire:x:990:")
    add_group("/etc/passwd", "canwire:x:990:990::/:/bin/false")
    run("dmesg", "-C")
    yield True
    for path, text in before.items():
        Path(path).write_text(text)
    log = run("dmesg")
    assert "peak_usb" in log
    for word in ("WARNING", "BUG", "Oops", "Call Trace", "unhandled", "refcount", "blocked for"):
        assert word not in log, log
