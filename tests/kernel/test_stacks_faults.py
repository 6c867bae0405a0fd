# SPDX-License-Identifier: MIT
"""Long ISO-TP transfers while something breaks: what a rig wants to know about its stack.

The faults come at the hundredth frame of a transfer, on the bus, so that no load of the machine
moves them.
"""

import contextlib
import itertools
import signal
import threading
import time

import pytest

from stacks import Failed, Rig, break_off, bus_text, exchange, payload
from test_stacks import MESSAGE, fixture_kernel_isotp, fixture_rig  # pylint: disable=unused-import

WITNESS = '  - { name: witness }\n'
AT_100 = '{{ frame: "7E0", from: client, skip: 100, count: 1 }}'


def rule(name, do, when=AT_100):
    return f"faults: [ {{ name: {name}, when: {when.format()}, do: {do} }} ]\n"


def test_a_bad_crc_in_a_consecutive_frame_is_not_seen(rig, kernel_isotp):
    """The controller sends it again, by itself, in its place."""
    r = rig(more=rule("crc", '{ flip: "crc[3]", at: [server] }'))
    failures = exchange(*kernel_isotp())
    client = r.nodes()["client"]
    assert client["retransmissions"] == 1 and client["tec"] == 0
    assert client["tx_frames"] == client["handed_in"]
    if failures == 0:
        assert client["tx_frames"] == 586 + 1  # its flow control for the answer
    r.stop()


def test_noise_is_not_seen(rig, kernel_isotp):
    r = rig(more=rule("noise", "{ noise: 1e-4 }", "{{}}"))
    exchange(*kernel_isotp())
    client, server = r.nodes().values()
    assert client["retransmissions"] + server["retransmissions"] > 0
    assert client["undetected_errors"] == server["undetected_errors"] == 0
    r.stop()


def test_an_ecu_that_is_cut_off_for_half_a_second(rig, kernel_isotp):
    """No node acknowledges meanwhile, so the frame is repeated until the ECU is back. Then the
    transfer goes on, before ISO-TP gives up after a second."""
    r = rig(more=rule("cut", "{ disconnect: server, for: 500ms }"))
    exchange(*kernel_isotp())
    client = r.nodes()["client"]
    assert client["errors"]["ack"] > 1000
    assert client["error_passive"] == 1 and client["bus_off"] == 0
    r.stop()


def test_an_ecu_that_is_cut_off_for_two_seconds(rig, kernel_isotp):
    """ISO-TP gives up. The rest of the transfer comes late and does no harm; the next one
    succeeds."""
    r = rig(more=rule("cut", "{ disconnect: server, for: 2s }"))
    client, server = kernel_isotp()
    break_off(client, server, lambda: r.nodes()["client"]["errors"]["ack"] > 0)
    exchange(client, server)
    assert r.nodes()["client"]["errors"]["ack"] > 4000
    r.stop()


def test_a_babbling_idiot_delays_but_loses_nothing(rig, kernel_isotp):
    r = rig(more=WITNESS + rule("idiot", '{ babble: "000#", as: witness, for: 400ms }'))
    exchange(*kernel_isotp())
    nodes = r.nodes()
    assert nodes["client"]["arbitration_lost"] > 0
    assert nodes["witness"]["tx_frames"] > 1000
    r.stop()


@pytest.mark.parametrize("restart_ms", [100, 0])
def test_a_server_that_goes_bus_off(rig, kernel_isotp, restart_ms):
    """Another node acknowledges, so the server misses frames and its ISO-TP gives up. With
    restart-ms the server comes back by itself; without, it does not answer until it is
    restarted."""
    r = rig(server=f", restart-ms: {restart_ms}", more=WITNESS + rule("off", "{ bus-off: server }"))
    client, server = kernel_isotp()
    break_off(client, server, lambda: r.nodes()["server"]["bus_off"] == 1)
    if restart_ms == 0:
        assert r.nodes()["server"]["state"] == "bus-off"
        server.drain()
        with pytest.raises(Failed):
            client.send(payload(100))  # no flow control: the kernel gives up after a second
        client.drain()
        r.run("restart", "server")
    exchange(client, server)
    assert r.nodes()["server"]["restarts"] == 1
    assert r.nodes()["client"]["dropped"]["queue-full"] == 0
    r.stop()


# ---- Time that is skipped ------------------------------------------------------------------------


def test_transfers_go_on_after_canwired_was_stopped(vcan, canwired, kernel_isotp):
    """The daemon is stopped for 1.1 s in the middle of long transfers, twice, with something due,
    so that the bus skips the time. Transfers under way may fail, later ones do not, and nothing is
    lost."""
    vcan(2)
    load = '  - { name: load, traffic: [ { send: "100#", every: 5ms } ] }\n'
    r = Rig(canwired(bus_text(more=load + "catch-up: 50ms\n")), "stacks")
    client, server = kernel_isotp()
    for _ in range(2):
        with contextlib.suppress(Failed):
            client.send(payload(MESSAGE))
        r.daemon.process.send_signal(signal.SIGSTOP)
        time.sleep(1.1)  # no wait: at least so long
        r.daemon.process.send_signal(signal.SIGCONT)
        for end in client, server:
            end.drain()
        exchange(client, server, 18)
        exchange(client, server)
    assert r.shell.status("stacks")["bus"]["skips"] >= 2
    for _ in range(3):
        exchange(client, server)
    r.stop()


def stop_now_and_then(process, ended):
    while not ended.wait(0.05):  # poll: in a loop
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.1)
        process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize("block_size", [0, 8])
def test_transfers_go_through_many_skips(vcan, canwired, kernel_isotp, block_size):
    """Each is too long for the bus to catch up with, and too short for ISO-TP to give up."""
    vcan(2)
    load = '  - { name: load, traffic: [ { send: "100#", every: 1ms } ] }\n'
    r = Rig(canwired(bus_text(bitrate=250000, more=load + "catch-up: 20ms\n")), "stacks")
    client, server = kernel_isotp(block_size)
    ended = threading.Event()
    stopper = threading.Thread(target=stop_now_and_then, args=(r.daemon.process, ended))
    stopper.start()
    try:
        for transfers in itertools.count(1):
            exchange(client, server)
            if transfers >= 4 and r.shell.status("stacks")["bus"]["skips"] > 5:
                break
    finally:
        ended.set()
        stopper.join()
    r.stop()
