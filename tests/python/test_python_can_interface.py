# SPDX-License-Identifier: MIT
"""The interface `canwire` of python-can, in this process and at a running bus."""

import asyncio
import configparser
import json
import os
import socket
import subprocess
import threading
import time
import tomllib

import can
import pytest

from canwire import pythoncan
from canwire.pythoncan import Wire
from simtool import CANWIRED, ROOT, canwire as tool, kill_all, listens
from test_record import wait_until

PATIENCE_S = 60
# It tells Python of the entry points, as an installation does.
INSTALLED = ROOT / "tests/python/installed/canwire-0.dist-info/entry_points.txt"

RUNNING = """
bus: { name: running, bitrate: 500000, dbitrate: 2000000 }
control: running.sock
nodes:
  - { name: engine, port: "unix:engine.sock", restart-ms: 0 }
  - { name: dash, port: "unix:dash.sock" }
  - { name: other }
"""


@pytest.fixture(name="running")
def fixture_running(tmp_path):
    yield from start(tmp_path, RUNNING)


def start(tmp_path, text):
    (tmp_path / "b.yaml").write_text(text)
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen([CANWIRED, "-c", "b.yaml"], cwd=tmp_path, stderr=log)
    path = tmp_path / "running.sock"
    wait_until(lambda: listens(path) or process.poll() is not None, "the bus")
    yield str(path)
    kill_all([process])


@pytest.fixture(name="opened")
def fixture_opened():
    """opened(...) is a can.Bus(interface="canwire", ...) that is shut down at the end."""
    buses = []

    def opened(*arguments, **more):
        buses.append(can.Bus(*arguments, interface="canwire", **more))
        return buses[-1]
    yield opened
    for bus in reversed(buses):
        bus.shutdown()


def message(can_id=0x123, data=b"\x11\x22", **more):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **more)


def first_node(control):
    return json.loads(tool("status", control, "--json").stdout)["nodes"][0]


def content(got):
    assert got is not None
    return got.arbitration_id, bytes(got.data), got.is_rx


# ---- The package ---------------------------------------------------------------------------------


def test_the_entry_points_are_those_of_the_package():
    project = tomllib.loads((ROOT / "lib/python/pyproject.toml").read_text())["project"]
    installed = configparser.ConfigParser()
    installed.read(INSTALLED)
    assert {name: dict(installed[name]) for name in installed.sections()} == \
        project["entry-points"]


# ---- In this process -----------------------------------------------------------------------------


def test_buses_in_this_process_share_a_channel(opened):
    one, two = opened(channel="shared"), opened(channel="shared", receive_own_messages=True)
    other = opened(channel="elsewhere")
    two.send(message())
    assert content(one.recv(PATIENCE_S)) == (0x123, b"\x11\x22", True)
    assert content(two.recv(PATIENCE_S)) == (0x123, b"\x11\x22", False)
    assert other.recv(0) is None and one.protocol is can.CanProtocol.CAN_FD
    assert {"interface": "canwire", "channel": "shared"} in can.detect_available_configs("canwire")


@pytest.mark.parametrize("more", [(), (None,), (True, None)], ids=["4.1", "4.3", "4.4"])
def test_versions_of_python_can_start_periodic_frames(opened, more):
    one, two = (opened(channel="periodic", virtual_time=True) for _ in range(2))
    task = one._send_periodic_internal([message()], 0.01, None, *more)
    times = [two.recv(1).timestamp for _ in range(3)]
    assert [round(b - a, 6) for a, b in zip(times, times[1:])] == [0.01, 0.01]
    task.stop()


def test_a_bus_ends_with_its_last_program_and_what_was_sent_arrives(opened):
    one, two = opened(channel="end"), opened(channel="end")
    one.send(message())
    one.shutdown()
    assert content(two.recv(PATIENCE_S))[0] == 0x123
    with pytest.raises(can.CanOperationError, match="closed"):
        one.recv(0)
    two.shutdown()
    assert not [c for c in can.detect_available_configs("canwire") if c["channel"] == "end"]


def test_a_reader_is_woken_by_a_sender_in_another_thread(opened):
    one, two = opened(channel="threads"), opened(channel="threads")
    got = []
    reader = threading.Thread(target=lambda: got.append(two.recv(PATIENCE_S)))
    reader.start()
    one.send(message())
    reader.join()
    assert content(got[0])[0] == 0x123


def test_faults_change_the_state(opened):
    one = opened(channel="faults", virtual_time=True)
    two = opened(channel="faults", virtual_time=True)
    assert one.state is can.BusState.ACTIVE
    one.simulation.inject(name="broken", do={"stuck": "recessive", "on": "guest-1.tx"})
    one.send(message())
    assert two.recv(0.0008) is None and one.state is can.BusState.PASSIVE
    assert two.recv(1) is None and one.state is can.BusState.ERROR
    errors = []
    while (got := one.recv(0)) is not None:
        errors.append(got)
    assert all(error.is_error_frame for error in errors)
    assert [error.arbitration_id for error in errors][-1] & 0x40  # CAN_ERR_BUSOFF


def test_periodic_frames_in_virtual_time_have_exact_times(opened):
    one = opened(channel="virtual", virtual_time=True)
    two = opened(channel="virtual", virtual_time=True)
    task = one.send_periodic(message(), 0.5, duration=3)
    times = [two.recv(1).timestamp for _ in range(6)]
    assert times == pytest.approx([times[0] + 0.5 * k for k in range(6)], abs=1e-9)
    assert two.recv(10) is None and two.simulation.now == pytest.approx(times[5] + 10)
    task.start()
    changed = message(data=b"\x33\x44")
    task.modify_data(changed)
    assert content(two.recv(1))[1] == b"\x33\x44"
    task.stop()
    assert two.recv(1000) is None
    two.set_filters([{"can_id": 0x124, "can_mask": 0x7FF, "extended": False}])
    one.send(message())
    one.send(message(0x124))
    assert content(two.recv(1))[0] == 0x124


def test_a_configuration_has_nodes_by_name(opened, write):
    path = str(write("""
bus: { name: car, bitrate: 250000 }
nodes:
  - { name: engine }
  - { name: dash }
  - { name: load, traffic: [ { send: 321#, offset: 1ms } ] }
"""))
    dash = opened(channel=f"{path}:dash", virtual_time=True)
    engine = opened(channel=path, virtual_time=True)
    assert engine.channel_info.startswith("canwire: node engine of car")
    assert engine.protocol is can.CanProtocol.CAN_20
    engine.send(message())
    assert content(dash.recv(1))[0] == 0x123
    assert content(dash.recv(1))[0] == 0x321
    with pytest.raises(can.CanInitializationError, match="node dash is in use"):
        opened(channel=path, node="dash", virtual_time=True)
    with pytest.raises(can.CanInitializationError, match="there is no node 'gearbox'; there is"):
        opened(channel=path, node="gearbox", virtual_time=True)
    with pytest.raises(can.CanInitializationError, match="is in use in virtual time"):
        opened(channel=path)
    with pytest.raises(can.CanInitializationError, match=r"scenario.yaml:1:\d+: "):
        opened(channel="bad", config="{ bus: {}, nodes: [] }")
    with pytest.raises(can.CanInitializationError, match="there is no running bus 'x'"):
        opened(channel="x", private=False)
    with pytest.raises(can.CanOperationError, match="error frames cannot be sent"):
        engine.send(can.Message(is_error_frame=True))


def test_a_full_queue_makes_a_sender_wait(opened):
    one = opened(channel="slow")
    one.simulation["listener"].detach()  # nobody acknowledges
    with pytest.raises(can.CanOperationError, match="queue of the node is full"):
        for _ in range(600):
            one.send(message(), timeout=0)
    with pytest.raises(can.CanOperationError, match="queue of the node is full"):
        one.send(message(), timeout=0.01)
    one.simulation["listener"].attach()
    one.send(message(), timeout=PATIENCE_S)


# ---- A running bus -------------------------------------------------------------------------------


def test_programs_at_a_running_bus(running, opened):
    engine = opened(channel=f"{running}:engine", receive_own_messages=True)
    dash = opened(channel=running, node="dash")
    assert engine.protocol is can.CanProtocol.CAN_FD and engine.fileno() > 0
    engine.send(message())
    got = dash.recv(PATIENCE_S)
    assert content(got) == (0x123, b"\x11\x22", True) and got.timestamp > 1.6e9
    assert content(engine.recv(PATIENCE_S)) == (0x123, b"\x11\x22", False)
    engine.send(can.Message(arbitration_id=0x1234567, data=bytes(48), is_fd=True,
                            bitrate_switch=True))
    fd = dash.recv(PATIENCE_S)
    assert (fd.is_fd, fd.bitrate_switch, fd.is_extended_id, fd.dlc) == (True, True, True, 48)
    dash.send(can.Message(arbitration_id=0x222, is_remote_frame=True, dlc=3,
                          is_extended_id=False))
    engine.recv(PATIENCE_S)  # its own
    remote = engine.recv(PATIENCE_S)
    assert remote.is_remote_frame and remote.dlc == 3


@pytest.mark.parametrize("channel", ["{}", "unix:engine.sock"])
def test_a_bus_that_is_just_starting_is_waited_for(tmp_path, opened, monkeypatch, channel):
    """The first look finds none, and starts it."""
    started = []

    def look_again(_):
        if not started:
            started.append(start(tmp_path, RUNNING))
            next(started[0])

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pythoncan, "START_PATIENCE_S", PATIENCE_S)
    monkeypatch.setattr(pythoncan.time, "sleep", look_again)
    control = tmp_path / "running.sock"
    engine = opened(channel=channel.format(control), node="engine" if channel == "{}" else None)
    monkeypatch.undo()
    engine.send(message())
    wait_until(lambda: first_node(str(control))["tx_frames"] == 1, "the frame")
    engine.shutdown()
    assert next(started[0], None) is None


def test_filters_are_those_of_the_port(running, opened):
    engine, dash = opened(channel=running, node="engine"), opened(channel=running, node="dash")
    dash.set_filters([{"can_id": 0x200, "can_mask": 0x700, "extended": False}])
    for can_id in (0x123, 0x234, 0x345, 0x256):
        engine.send(message(can_id))
    assert [dash.recv(PATIENCE_S).arbitration_id for _ in range(2)] == [0x234, 0x256]
    dash.set_filters(None)
    engine.send(message(0x345))
    assert dash.recv(PATIENCE_S).arbitration_id == 0x345


def test_the_state_comes_from_error_frames(running, opened):
    engine = opened(channel=running, node="engine", ignore_rx_error_frames=True)
    seen = opened(channel=running, node="engine")
    assert engine.state is can.BusState.ACTIVE
    tool("inject", running, "{ name: broken, do: { stuck: recessive, on: engine.tx } }")
    engine.send(message())
    while seen.state is not can.BusState.ERROR:
        got = seen.recv(PATIENCE_S)
        assert got is not None
    assert engine.recv(0) is None and engine.state is can.BusState.ERROR
    tool("clear", running, "broken")
    tool("restart", running, "engine")
    while seen.state is not can.BusState.ACTIVE:
        assert seen.recv(PATIENCE_S) is not None
    wait_until(lambda: first_node(running)["state"] == "error-active", "the recovery")
    late = opened(channel=running, node="engine")
    assert late.state is can.BusState.ACTIVE
    late.state = can.BusState.PASSIVE
    assert first_node(running)["settings"]["listen-only"] is True


def test_a_running_bus_needs_a_node_with_a_socket(running, opened):
    with pytest.raises(can.CanInitializationError, match="node= is one of: engine, dash"):
        opened(channel=running)
    with pytest.raises(can.CanInitializationError, match="no node 'other' with a port unix:PATH"):
        opened(channel=running, node="other")
    with pytest.raises(can.CanInitializationError, match="No such file"):
        opened(channel="unix:/nowhere/x.sock")
    # no bus in this process takes the place of one that does not run
    for path in ("/nowhere/x.sock", "x.sock", "./powertrain"):
        with pytest.raises(can.CanInitializationError, match="there is no running bus"):
            opened(channel=path)
    port = running.replace("running.sock", "dash.sock")
    assert opened(channel=f"unix:{port}").recv(0) is None


def test_an_ordinary_user_finds_the_nodes_of_a_bus(running, opened, monkeypatch):
    monkeypatch.setenv("CANWIRE_RUN", os.path.dirname(running))
    with pytest.raises(can.CanInitializationError,
                       match=f"no running bus 'ci' in {os.path.dirname(running)}$"):
        opened(channel="ci", node="engine")
    found = can.detect_available_configs("canwire")
    assert found[:2] == [{"interface": "canwire", "channel": f"running:{node}"}
                         for node in ("engine", "dash")]
    engine, dash = (can.Bus(**config) for config in found[:2])

    async def receive():
        reader = can.AsyncBufferedReader()
        with can.Notifier(dash, [reader], loop=asyncio.get_running_loop()):
            engine.send(message())
            return await asyncio.wait_for(reader.get_message(), PATIENCE_S)

    with engine, dash:
        assert content(asyncio.run(receive()))[:2] == (0x123, b"\x11\x22")


@pytest.mark.parametrize("virtual", [False, True])
def test_a_bus_that_is_closed_refuses(virtual):
    bus = can.Bus(interface="canwire", channel="closing", virtual_time=virtual, private=True)
    bus.shutdown()
    for call in (lambda: bus.recv(0), lambda: bus.send(message()), lambda: bus.simulation,
                 lambda: bus.state, lambda: bus.send_periodic(message(), 0.1)):
        with pytest.raises(can.CanOperationError):
            call()


def test_a_bus_stays_while_a_program_comes_to_it(opened):
    first = can.Bus(interface="canwire", channel="coming", private=True)
    wire = Wire.open("coming", pytest.fail, False)  # the other program has no node yet
    first.shutdown()
    number = wire.take_node(None)
    wire.coming -= 1
    assert opened("coming", private=True).simulation is wire.bus
    wire.give_back(number)


# ---- Rules of python-can -------------------------------------------------------------------------


def test_a_reader_in_virtual_time_leaves_the_bus_to_others(opened):
    """It waits for a frame that another thread sends, while other traffic goes on."""
    config = {"bus": {"bitrate": 500000}, "nodes": [
        {"name": "a"}, {"name": "b", "traffic": [{"send": "321#01", "every": "1ms"}]}]}
    one, two = (opened("starving", node=name, config=config, virtual_time=True) for name in "ab")
    got = []
    reader = threading.Thread(target=lambda: got.append(two.recv()))
    reader.start()
    for _ in range(3):
        assert one.state is can.BusState.ACTIVE
    one.send(message())
    reader.join(PATIENCE_S)
    assert content(got[0])[0] == 0x123


def test_time_outs_of_senders_are_those_of_the_bus_in_virtual_time(opened):
    one = opened("deaf", virtual_time=True)
    one.simulation["listener"].detach()  # nobody acknowledges
    with pytest.raises(can.CanOperationError, match="full"):
        for _ in range(600):
            one.send(message(), timeout=0)
    before = one.simulation.now
    with pytest.raises(can.CanOperationError, match="full"):
        one.send(message(), timeout=0.5)
    assert one.simulation.now == pytest.approx(before + 0.5, abs=1e-5)
    with pytest.raises(can.CanOperationError, match="full"):
        one.send(message())
    assert one.simulation.now == pytest.approx(before + 2.5, abs=1e-5)


@pytest.mark.parametrize("virtual", [False, True])
def test_a_node_is_given_back_as_it_was(opened, virtual):
    stays = opened("leave", virtual_time=virtual)
    sim = stays.simulation
    for _ in range(3):
        bus = can.Bus("leave", interface="canwire", virtual_time=virtual)
        bus.state = can.BusState.PASSIVE
        assert sim["guest-2"].status.listen_only
        bus.shutdown()
        assert not sim["guest-2"].status.attached and not sim["guest-2"].status.listen_only
    bus = can.Bus("leave", interface="canwire", virtual_time=virtual)
    bus.send(message())
    bus.shutdown()
    assert content(stays.recv(PATIENCE_S))[0] == 0x123
    stays.recv(0.001)
    assert not sim["guest-2"].status.attached


def test_periodic_frames_end_with_their_node(opened):
    one, two = opened("tasks", virtual_time=True), opened("tasks", virtual_time=True)
    one.send_periodic(message(), 0.1, store_task=False)
    assert two.recv(1) is not None
    one.shutdown()
    while two.recv(0.01):
        pass
    assert two.recv(10) is None


def test_periodic_frames_that_fail_end_and_are_logged(opened, caplog):
    one, two = opened("modifier", virtual_time=True), opened("modifier", virtual_time=True)
    calls = []

    def modify(sent):
        calls.append(sent)
        sent.data[0] += 1
        if len(calls) == 3:
            raise RuntimeError("no more")

    one.send_periodic(message(data=b"\x00"), 1, modifier_callback=modify)
    assert [two.recv(2).data[0] for _ in range(2)] == [1, 2]
    assert two.recv(100) is None and len(calls) == 3 and "no more" in caplog.text
    for period in (0, -1):
        with pytest.raises(ValueError, match="longer than 0"):
            one.send_periodic(message(), period)
    task = one.send_periodic(message(), 1, duration=0)  # as with others: without an end
    assert [two.recv(2) is None for _ in range(5)] == [False] * 5
    task.stop()
    nested = one.send_periodic(message(), 1, modifier_callback=lambda _: one.recv(0.1))
    assert two.recv(2) is not None
    nested.stop()


def test_a_reset_takes_a_bus_in_use_back(opened):
    one, two = opened("again", virtual_time=True), opened("again", virtual_time=True)
    task = one.send_periodic(message(), 1)
    assert [two.recv(2) is None for _ in range(3)] == [False] * 3
    one.simulation.reset()
    got = two.recv(2)
    assert got is not None and got.timestamp < 1.001
    task.stop()
    real, other = opened("again-real"), opened("again-real")
    real.simulation.reset()
    real.send(message())
    assert other.recv(PATIENCE_S) is not None
    real.simulation.run(duration=1000)  # by hand: the clock follows
    real.send(message())
    got = other.recv(PATIENCE_S)
    assert got is not None and abs(got.timestamp - time.time()) < PATIENCE_S


def test_filters_let_error_frames_pass(opened):
    one = opened("error-filter", virtual_time=True, can_filters=[{"can_id": 1, "can_mask": 0x7FF}])
    one.simulation.inject(name="off", do={"bus-off": "guest-1"})
    assert one.recv(1).is_error_frame
    other = opened("error-filter", virtual_time=True)
    for can_id in (2, 1):
        other.send(message(can_id))
    one.simulation["guest-1"].restart()
    other.recv(1)
    other.send(message(2))
    other.send(message(1))
    while (got := one.recv(1)).is_error_frame:
        pass
    assert got.arbitration_id == 1


def test_frames_behind_a_restart_outlive_their_program(opened):
    """R12: what is sent while a node recovers waits."""
    one, other = (opened("recovers", virtual_time=True) for _ in "ab")
    one.simulation.inject(name="off", do={"bus-off": "guest-1"})
    assert one.recv(1).is_error_frame
    one.simulation["guest-1"].restart()
    for can_id in (1, 2):
        one.send(message(can_id))
    one.shutdown()
    assert [other.recv(PATIENCE_S).arbitration_id for _ in "12"] == [1, 2]


def test_frames_behind_a_restart_wait_for_room(opened):
    config = {"bus": {"bitrate": 500000}, "nodes": [{"name": "a", "queue": 4}, {"name": "b"}]}
    one = opened("full", virtual_time=True, config=config)
    other = opened("full", virtual_time=True)
    one.simulation.inject(name="off", do={"bus-off": "a"})
    assert one.recv(1).is_error_frame
    one.simulation["a"].restart()
    for can_id in range(20):
        one.send(message(can_id), timeout=PATIENCE_S)
    assert [other.recv(PATIENCE_S).arbitration_id for _ in range(20)] == list(range(20))


def test_a_channel_has_one_configuration(opened):
    config = {"bus": {"bitrate": 250000}, "nodes": [{"name": "a"}, {"name": "b"}, {"name": "c"}]}
    first = opened("configured", config=config)
    assert opened("configured", config=dict(config)).simulation is first.simulation
    assert opened("configured").simulation is first.simulation
    with pytest.raises(can.CanInitializationError, match="another configuration"):
        opened("configured", config={**config, "seed": 7})


def test_what_is_refused_is_an_error_of_python_can(opened, tmp_path):
    one = opened("classical", config={"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}]})
    for sent in (message(is_fd=True), message(0x800), message(data=bytes(9)),
                 message(is_remote_frame=True, dlc=9)):
        with pytest.raises(can.CanOperationError, match="canwire: "):
            one.send(sent)
    for wrong in ({"channel": []}, {"channel": "x", "config": 5}, {"channel": "x", "bitrate": 1},
                  {"channel": "x", "config": {"bus": object()}},
                  {"channel": str(tmp_path / "missing.yaml")}):
        with pytest.raises(can.CanInitializationError, match="canwire: "):
            opened(**wrong)
    dead = socket.socket(socket.AF_UNIX)
    dead.bind(str(tmp_path / "dead.sock"))
    dead.close()
    with pytest.raises(can.CanInitializationError, match="refused"):
        opened(str(tmp_path / "dead.sock"), node="a")
    one.simulation.close()
    for call in (lambda: one.recv(0), lambda: one.state, lambda: one.send(message())):
        with pytest.raises(can.CanOperationError, match="closed"):
            call()


def test_the_state_at_a_running_bus_needs_no_reader(running, opened):
    engine = opened(channel=running, node="engine")
    tool("inject", running, "{ name: off, do: { bus-off: engine } }")
    wait_until(lambda: engine.state is can.BusState.ERROR, "bus-off")
    engine.set_filters([{"can_id": 1, "can_mask": 0x7FF}])  # they do not filter error frames
    assert engine.recv(PATIENCE_S).is_error_frame


def test_several_readers_at_a_running_bus(running, opened):
    engine, dash = opened(channel=running, node="engine"), opened(channel=running, node="dash")
    got, ended = [], []

    def read():
        try:
            while True:
                got.append(dash.recv().arbitration_id)
        except can.CanOperationError as problem:
            ended.append(str(problem))

    readers = [threading.Thread(target=read) for _ in range(4)]
    for reader in readers:
        reader.start()
    for number in range(100):
        engine.send(message(number))
    wait_until(lambda: len(got) == 100, "all frames")
    dash.shutdown()
    for reader in readers:
        reader.join(PATIENCE_S / 2)
    assert sorted(got) == list(range(100)) and len(ended) == 4


def test_there_may_be_more_filters_than_a_port_has(running, opened):
    many = [{"can_id": number, "can_mask": 0x7FF, "extended": False} for number in range(600)]
    engine = opened(channel=running, node="engine")
    dash = opened(channel=running, node="dash", can_filters=many)
    for can_id in (0x700, 599):
        engine.send(message(can_id))
    assert dash.recv(PATIENCE_S).arbitration_id == 599
    dash.set_filters([{"can_id": 0xFFFFFFFF, "can_mask": 0xFFFFFFFF}])
    dash.set_filters([{"can_id": 0x124, "can_mask": 0xFFFFFFFF}])
    engine.send(message(0x124))
    assert dash.recv(PATIENCE_S).arbitration_id == 0x124


def test_a_classical_node_of_a_running_bus_refuses_fd_frames(tmp_path, opened):
    text = RUNNING.replace('"unix:dash.sock"', '"unix:dash.sock", fd: no')
    for path in start(tmp_path, text):
        dash = opened(channel=path, node="dash")
        assert dash.protocol is can.CanProtocol.CAN_20
        with pytest.raises(can.CanOperationError, match="no CAN FD frames"):
            dash.send(message(is_fd=True))


def test_a_bit_rate_is_a_number(opened):
    with pytest.raises(can.CanInitializationError, match="bitrate 'fast' is no number of bit/s"):
        opened(channel="x", bitrate="fast")
