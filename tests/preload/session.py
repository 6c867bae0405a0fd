# SPDX-License-Identifier: MIT
"""Sessions with python-can's `socketcan` interface: session.py NAME runs one of them.

Two sockets are at can0; can1 is another node. The bus knows CAN FD.
"""

import sys
import time

import can

PATIENCE_S = 60


def open_bus(channel="can0", **more):
    return can.Bus(interface="socketcan", channel=channel, **more)


def message(can_id, data=b"", **more):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=can_id > 0x7FF, **more)


def receive(bus):
    got = bus.recv(PATIENCE_S)  # whole: a message
    assert got is not None
    return got


def sending():
    with open_bus() as a, open_bus() as b, open_bus("can1") as other:
        a.send(message(0x123, b"\1\2\3"))
        for bus, is_rx, channel in ((b, False, "can0"), (other, True, "can1")):
            got = receive(bus)
            assert (got.arbitration_id, bytes(got.data)) == (0x123, b"\1\2\3"), got
            assert (got.is_rx, got.channel) == (is_rx, channel), got
            assert abs(got.timestamp - time.time()) < PATIENCE_S
        other.send(message(0x12345678, is_remote_frame=True, dlc=3))
        got = receive(a)
        assert got.is_remote_frame and got.is_extended_id and got.dlc == 3 and got.is_rx, got
        assert a.recv(0) is None  # whole: no message


def own_messages():
    with open_bus(receive_own_messages=True) as a, open_bus(local_loopback=False) as b:
        a.send(message(0x100), timeout=PATIENCE_S)
        got = receive(a)
        assert got.arbitration_id == 0x100 and not got.is_rx
        b.send(message(0x101))
        a.send(message(0x102))
        assert receive(a).arbitration_id == 0x102


def filters():
    some = [{"can_id": 0x200, "can_mask": 0x7F0, "extended": False}]
    with open_bus("can1") as a, open_bus(can_filters=some) as b:
        for can_id in (0x1FF, 0x20A, 0x00045678, 0x20B):
            a.send(message(can_id))
        assert [receive(b).arbitration_id for _ in range(2)] == [0x20A, 0x20B]
        b.set_filters(None)
        a.send(message(0x300))
        assert receive(b).arbitration_id == 0x300


def fd_frames():
    with open_bus(fd=True) as a, open_bus("can1", fd=True) as b, open_bus("can1") as old:
        a.send(message(0x111, bytes(range(48)), is_fd=True, bitrate_switch=True))
        a.send(message(0x112, b"x"))
        got = receive(b)
        assert got.is_fd and got.bitrate_switch and bytes(got.data) == bytes(range(48)), got
        assert not receive(b).is_fd
        assert receive(old).arbitration_id == 0x112


def all_interfaces():
    with open_bus("") as everything, open_bus() as a, open_bus("can1") as b:
        a.send(message(0x1))
        b.send(message(0x2))
        got = {(m.arbitration_id, m.channel) for m in (receive(everything) for _ in range(4))}
        assert got == {(1, "can0"), (1, "can1"), (2, "can0"), (2, "can1")}, got


def periodic():
    """python-can lets CAN_BCM send."""
    with open_bus() as a, open_bus("can1") as b:
        task = a.send_periodic([message(0x150, b"\0"), message(0x150, b"\1")], 0.005)
        assert type(task).__module__ == "can.interfaces.socketcan.socketcan"
        got = [receive(b) for _ in range(10)]
        assert {m.arbitration_id for m in got} == {0x150}
        assert [m.data[0] for m in got] == [0, 1] * 5
        task.modify_data([message(0x150, b"\2"), message(0x150, b"\3")])
        while receive(b).data[0] < 2:
            pass
        task.stop()
        a.send(message(0x151))
        while receive(b).arbitration_id != 0x151:
            pass
        task.start()
        assert receive(b).arbitration_id == 0x150
        a.stop_all_periodic_tasks()


def periodic_fd_for_a_while():
    with open_bus(fd=True) as a, open_bus("can1", fd=True) as b:
        a.send_periodic(message(0x160, bytes(20), is_fd=True), 0.005, duration=0.05)
        got = [receive(b) for _ in range(10)]
        assert all(m.is_fd and len(m.data) == 20 for m in got)


def error_frames():
    """The parent sets can0's node bus-off when it reads the line. The node restarts by itself, and
    what is sent then waits until it is back (R12)."""
    with open_bus() as a, open_bus("can1") as b:
        print("ready", flush=True)
        got = receive(a)
        assert got.is_error_frame and got.arbitration_id & 0x40, got
        got = receive(a)
        assert got.is_error_frame and got.arbitration_id & 0x100, got
        a.send(message(0x123))
        assert receive(b).arbitration_id == 0x123


def notifier():
    with open_bus() as a, open_bus("can1") as b:
        buffer, lines = can.BufferedReader(), []
        with can.Notifier(b, [buffer, lines.append]):
            for number in range(100):
                a.send(message(0x400 + number), timeout=PATIENCE_S)
            got = [buffer.get_message(PATIENCE_S).arbitration_id for _ in range(100)]
        assert sorted(got) == list(range(0x400, 0x464)) and len(lines) == 100


def in_asyncio():
    import asyncio

    async def talk():
        with open_bus() as a, open_bus("can1") as b:
            reader = can.AsyncBufferedReader()
            with can.Notifier(b, [reader], loop=asyncio.get_running_loop()):
                a.send(message(0x77))
                assert (await asyncio.wait_for(reader.get_message(), PATIENCE_S)
                        ).arbitration_id == 0x77

    asyncio.run(talk())


NAMES = ("sending", "own_messages", "filters", "fd_frames", "all_interfaces", "periodic",
         "periodic_fd_for_a_while", "error_frames", "notifier", "in_asyncio")

if __name__ == "__main__":
    globals()[sys.argv[1]]()
