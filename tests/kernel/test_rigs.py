# SPDX-License-Identifier: MIT
"""Rigs on real vcan: two buses in one canwired, and two kinds of gateways between them. One is the
rig's own; the other is an ECU with a port on each bus, in which cangw of can-utils runs."""

import contextlib
import subprocess

import lcm
import pytest

from conftest import LCM_URL, PATIENCE_S, listeners, wait_until

BODY = """bus: {{ name: body, bitrate: 125000 }}
control: {folder}/body.sock
nodes:
  - {{ name: airbag, port: vcan0 }}
  - {{ name: gw{body} }}
"""
SAFETY = """bus: {{ name: safety, bitrate: 500000 }}
control: {folder}/safety.sock
lcm: {{ period: 100ms }}
nodes:
  - {{ name: lamp, port: vcan1 }}
  - {{ name: gw{safety} }}
"""
GATEWAY = """gateways:
  - name: central
    between: [ "body:gw", "safety:gw" ]
    rules: [ { filter: "050", id: "020", delay: 100us }, { filter: "7FF", direction: backward } ]
"""


@pytest.fixture
def rig(canwired, tmp_path):
    """rig(gateways, body=", port: vcan2") starts one."""

    def start(gateways, body="", safety=""):
        (tmp_path / "body.yaml").write_text(BODY.format(folder=tmp_path, body=body))
        (tmp_path / "safety.yaml").write_text(SAFETY.format(folder=tmp_path, safety=safety))
        daemon = canwired(f"buses: [ {tmp_path}/body.yaml, {tmp_path}/safety.yaml ]\n{gateways}")
        assert daemon.notifications.count("READY=1") == 1
        return daemon

    return start


@contextlib.contextmanager
def candump(interface, count):
    """Returns an unmodified candump that ends after so many frames."""
    command = ["candump", "-n", str(count), interface]
    before = listeners(interface)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        wait_until(lambda: listeners(interface) > before, "candump")
        yield process
        process.kill()


def lines_of(process):
    return [line.split() for line in process.communicate(timeout=PATIENCE_S)[0].splitlines()]


def cansend(interface, *frames):
    for frame in frames:
        subprocess.run(["cansend", interface, frame], check=True, timeout=PATIENCE_S)


def test_programs_of_can_utils_talk_through_the_gateway_of_a_rig(vcan, rig):
    vcan(2)
    daemon = rig(GATEWAY)
    with candump("vcan1", 2) as lamp:
        cansend("vcan0", "050#01", "051#02", "050#03")
        assert lines_of(lamp) == [["vcan1", "020", "[1]", "01"], ["vcan1", "020", "[1]", "03"]]
    with candump("vcan0", 1) as airbag:
        cansend("vcan1", "123#44", "7FF#55")
        assert lines_of(airbag) == [["vcan0", "7FF", "[1]", "55"]]
    daemon.stop()


def test_cangw_is_an_ecu_with_ports_on_two_buses(vcan, rig):
    """The gateway is a program: the kernel's, set up by an unmodified cangw."""
    vcan(4)
    daemon = rig("", body=", port: vcan2", safety=", port: vcan3")
    rule = ["-s", "vcan2", "-d", "vcan3", "-e", "-f", "050:7FF",
            "-m", "SET:I:020.0.0000000000000000"]
    subprocess.run(["cangw", "-A", *rule], check=True)
    try:
        with candump("vcan1", 2) as lamp:
            cansend("vcan0", "050#01", "051#02", "050#03")
            assert lines_of(lamp) == [["vcan1", "020", "[1]", "01"], ["vcan1", "020", "[1]", "03"]]
    finally:
        subprocess.run(["cangw", "-F"], check=True)
    daemon.stop()


def test_gateways_are_told_over_lcm(vcan, rig, lcm_types):
    vcan(2)
    subscriber, told = lcm.LCM(LCM_URL), []
    subscriber.subscribe("CANWIRE\\.safety\\.GATEWAY",
                         lambda _, data: told.append(lcm_types.gateway_t.decode(data)))
    daemon = rig(GATEWAY)
    cansend("vcan1", "123#44", "7FF#55", "7FF#66")

    def all_forwarded():
        subscriber.handle_timeout(100)
        return [m for m in told if m.forwarded == 2]

    message = wait_until(all_forwarded, "two frames")[0]
    assert (message.bus, message.name) == ("safety", "central")
    assert (message.node, message.other) == ("gw", "body:gw")
    assert (message.lost, message.dropped) == (0, 0)
    daemon.stop()
