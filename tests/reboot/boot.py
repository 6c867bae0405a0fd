#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""boot.py first|second - what the guest of test_reboot.py does in each of its boots."""

import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
UNITS = Path("/etc/systemd/system")
PATIENCE_S = 120

BUS = """
bus: { name: boot, bitrate: 500000 }
control: /run/canwire/boot.sock
nodes:
  - { name: a, port: boot0 }
  - { name: b, port: boot1, peer: { name: can0, netns: ecu } }
record: [ { file: /var/lib/canwire/boot.log } ]
"""
NAMESPACE = """
[Unit]
Before=canwire-vcan@boot.service
[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=ip netns add ecu
[Install]
RequiredBy=canwire-vcan@boot.service
"""
ECU = """
[Unit]
Requires=canwired@boot.service
After=canwired@boot.service
[Service]
Type=oneshot
RemainAfterExit=yes
NetworkNamespacePath=/run/netns/ecu
ExecStart=cansend can0 123#DEADBEEF
[Install]
WantedBy=multi-user.target
"""
ORDER = ["namespace.service", "canwire-vcan@boot.service", "canwired@boot.service", "ecu.service"]
RECORDS = [Path("/var/lib/canwire/boot.log"), Path("/var/lib/canwire/boot.log.1")]


def run(*words):
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (words, done.stdout + done.stderr)
    return done.stdout


def show(unit, name):
    return run("systemctl", "show", "-P", name, unit).strip()


def wait_until(condition, what):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, (what, run("journalctl", "--no-pager", "-n", "60"))
        time.sleep(0.1)


def frames(record):
    return record.read_text().count(" boot1 123#DEADBEEF\n") if record.exists() else 0


def first():
    run(ROOT / "scripts/install-files", "install")
    Path("/etc/canwire/boot.yaml").write_text(BUS)
    (UNITS / "namespace.service").write_text(NAMESPACE)
    (UNITS / "ecu.service").write_text(ECU)
    run("systemctl", "daemon-reload")
    run("systemctl", "enable", *(unit for unit in ORDER if "vcan" not in unit))
    run("systemctl", "start", "ecu.service")
    wait_until(lambda: frames(RECORDS[0]) == 1, "the frame")


def second():
    """Nothing is started by hand."""
    wait_until(lambda: show("ecu.service", "ActiveState") == "active", "the ECU")
    assert [show(unit, "ActiveState") for unit in ORDER] == ["active"] * len(ORDER)
    times = [int(show(unit, "ActiveEnterTimestampMonotonic")) for unit in ORDER]
    assert times == sorted(times), dict(zip(ORDER, times))
    assert show("canwired@boot.service", "NRestarts") == "0"
    run("ip", "netns", "exec", "ecu", "ip", "link", "show", "can0")
    wait_until(lambda: [frames(record) for record in RECORDS] == [1, 1], "a frame of each boot")
    assert "OK" in run("canwire", "status", "--check")


if __name__ == "__main__":
    {"first": first, "second": second}[sys.argv[1]]()
    print(f"{sys.argv[1]}: well")
