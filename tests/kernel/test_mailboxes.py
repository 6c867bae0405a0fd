# SPDX-License-Identifier: MIT
"""Mailboxes of controllers on real vcan: an ECU writes to them and reads from them. LCM and the
status count; a reload keeps what has been written, and a journal runs again.
"""

import pytest

from canbits import Frame
from conftest import wait_until
from test_faults import Shell
from test_journal import Night, again, assert_same

BUS = """
bus: { name: faults, bitrate: 500000 }
control: faults.sock
lcm: { period: 50ms }
nodes:
  - name: sensor
    port: vcan0
    controller:
      model: full
      service-time: 20ms
      mailboxes:
        - { direction: tx, id: 123, reply: auto, data: DATA }
        - { direction: tx }
        - { direction: rx, id: "200:7F0" }
  - { name: tester, port: vcan1 }
faults:
  - { name: hello, when: { manual: yes }, do: { counters: sensor, rec: 0 } }
""".replace("DATA", "00")
REQUEST = Frame.parse("123#R")


def ask(tester):
    tester.send(REQUEST)
    return tester.receive(1)


def sensor_status(daemon):
    return Shell(daemon).status("faults")["nodes"][0]


def test_a_controller_answers_for_its_ecu_and_lcm_counts(vcan, canwired, can_socket, listen):
    vcan(2)
    messages = listen("faults", controllers=True)
    daemon = canwired(BUS)
    sensor, tester = can_socket("vcan0"), can_socket("vcan1")
    assert ask(tester) == [Frame.parse("123#00")]
    sensor.send(Frame.parse("123#1122334455667788"), Frame.parse("321#01"))
    assert tester.receive(1) == [Frame.parse("321#01")]  # and not 123
    assert ask(tester) == [Frame.parse("123#1122334455667788")]
    # of two frames for one mailbox the sensor reads the newer one, and no others
    tester.send(Frame.parse("300#"), Frame.parse("205#01"), Frame.parse("206#0202"))
    assert sensor.receive(1) == [Frame.parse("206#0202")]
    last = wait_until(lambda: next((m for m in messages.controllers if m.node == "sensor" and
                                    m.overwritten and not m.waiting), None), "node_controller_t")
    node = sensor_status(daemon)
    names = ("filtered", "overruns", "overwritten", "replies", "stored")
    assert [node[n] for n in names] == [getattr(last, n) for n in names] == [1, 0, 1, 2, 1]
    assert (last.model, last.bus) == ("full", "faults")
    assert any(m.node == "tester" and m.model == "queue" for m in messages.controllers)
    text = Shell(daemon).run("status", "faults")
    assert "between controller and ECU" in text and "overwritten" in text
    daemon.stop()
    assert sensor.drain() == []


def test_a_reload_keeps_what_has_been_written(vcan, canwired, can_socket):
    vcan(2)
    daemon = canwired(BUS)
    sensor, tester = can_socket("vcan0"), can_socket("vcan1")
    daemon.config.write_text(BUS.replace("data: 00", "data: 0A0B"))
    Shell(daemon).run("reload", "faults")
    assert ask(tester) == [Frame.parse("123#0A0B")]  # the ECU has written nothing
    sensor.send(Frame.parse("123#77"))
    wait_until(lambda: sensor_status(daemon)["stored"] == 1, "the data")
    daemon.config.write_text(BUS.replace("data: 00", "data: 0C"))
    Shell(daemon).run("reload", "faults")
    assert ask(tester) == [Frame.parse("123#77")]
    assert sensor_status(daemon)["stored"] == 1
    daemon.stop()


@pytest.mark.deep
def test_the_journal_of_a_run_with_mailboxes_runs_again_to_the_byte(vcan, launch, can_socket,
                                                                    tmp_path):
    vcan(2)
    night = Night(launch, tmp_path, BUS)
    sensor, tester = can_socket("vcan0"), can_socket("vcan1")
    for n in range(60):
        sensor.send(Frame.parse(f"123#{n:02X}"), Frame.parse(f"4{n:02X}#"))
        tester.send(REQUEST, Frame.parse(f"20{n % 16:X}#{n:02X}"))
        if n == 30:
            night.daemon.config.write_text(BUS.replace("20ms", "10ms"))
            night.run("reload")
    wait_until(lambda: night.live.read_text().count('"tx"') > 150, "frames")
    _, live = night.morning()
    replayed, _ = again(night.journal)
    assert '"overrun"' in live
    assert_same(replayed, live, 200)
