# SPDX-License-Identifier: MIT
"""Times messages of python-can, and events, in a program. Output: a line of JSON.

Four nodes on a channel: one sends a frame, three receive it. `virtual` of python-can delivers at
once, without bit rate, arbitration and errors. With canwire it is in virtual time, at nodes in the
time of their bus (VirtualTime), and in real time. Times are CPU time of the process, the best of
some rounds. In real time they include a sleep for each frame, which `sleep` has alone.
"""
import json
import time

import can
import canwire

NODES = "abcd"
FRAMES = 1000
ROUNDS = 7
SLEEP_S = 230e-6  # as long as a frame
CONFIG = {"bus": {"bitrate": 500_000}, "nodes": [{"name": name} for name in NODES]}
EVENTS_MS = 2000
TRAFFIC = [{"send": "123#DEADBEEF", "every": "500us"}]


def best_ns(work, count):
    """Returns the CPU time for each of so many."""
    best = float("inf")
    for _ in range(ROUNDS):
        start = time.process_time_ns()
        work()
        best = min(best, (time.process_time_ns() - start) / count)
    return round(best, 1)


def time_messages(channels, **options):
    buses = [can.Bus(channel=channel, **options) for channel in channels]
    messages = [can.Message(arbitration_id=n * 37 % 0x800, is_extended_id=False,
                            data=bytes((n + i) % 256 for i in range(8))) for n in range(FRAMES)]

    def deliver():
        for number, message in enumerate(messages):
            sender = number % len(NODES)
            buses[sender].send(message)
            for node, bus in enumerate(buses):
                if node != sender and bus.recv(timeout=1) is None:
                    raise SystemExit("a frame was not delivered")

    found = best_ns(deliver, FRAMES)
    for bus in buses:
        bus.shutdown()
    return found


def time_at_nodes():
    """Returns the same at nodes in the time of their bus."""
    with canwire.Bus.from_dict(CONFIG, events="none") as bus, canwire.VirtualTime(bus):
        return time_messages(NODES, interface="canwire")


def time_events(take):
    """Returns the time in which a program gets each event, behind the run."""
    config = {**CONFIG, "nodes": [{**node, "traffic": TRAFFIC} for node in CONFIG["nodes"]]}
    best = float("inf")
    with canwire.Bus.from_dict(config, listen=False) as bus:
        for _ in range(ROUNDS):
            bus.reset()
            bus.run(EVENTS_MS / 1000)
            start = time.process_time_ns()
            count = take(bus)
            best = min(best, (time.process_time_ns() - start) / count)
    return round(best, 1)


def time_frames_of_pandas():
    try:
        import pandas as _  # pylint: disable=import-outside-toplevel
    except ImportError:
        return None
    return time_events(lambda bus: len(bus.take_columns().frame()))


def time_sleep():
    def sleep():
        for _ in range(FRAMES // 4):
            time.sleep(SLEEP_S)
    return best_ns(sleep, FRAMES // 4)


def main():
    same = ["bench"] * len(NODES)
    print(json.dumps({
        "version": can.__version__, "nodes": len(NODES),
        "virtual": time_messages(same, interface="virtual"),
        "virtual_time": time_messages(same, interface="canwire", virtual_time=True),
        "at_nodes": time_at_nodes(),
        "real_time": time_messages(same, interface="canwire", private=True),
        "sleep": time_sleep(),
        "events": time_events(lambda bus: len(bus.events())),
        "columns": time_events(lambda bus: bus.take_columns().rows),
        "pandas": time_frames_of_pandas()}))


main()
