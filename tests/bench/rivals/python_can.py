# SPDX-License-Identifier: MIT
"""Times python-can's virtual bus: four nodes on a channel, one sends a frame, three receive it.

Output: a line of JSON. Frames are delivered at once: no bit rate, no arbitration, no errors.
"""
import json
import time

import can

NODES = 4
FRAMES = 2000
ROUNDS = 7


def deliver(buses, messages):
    for number, message in enumerate(messages):
        sender = number % NODES
        buses[sender].send(message)
        for node, bus in enumerate(buses):
            if node != sender and bus.recv(timeout=0) is None:
                raise SystemExit("a frame was not delivered")


def main():
    buses = [can.Bus(interface="virtual", channel="bench") for _ in range(NODES)]
    messages = [can.Message(arbitration_id=n * 37 % 0x800, is_extended_id=False,
                            data=bytes((n + i) % 256 for i in range(8))) for n in range(FRAMES)]
    best_ns = float("inf")
    for _ in range(ROUNDS):
        start = time.process_time_ns()
        deliver(buses, messages)
        best_ns = min(best_ns, (time.process_time_ns() - start) / FRAMES)
    for bus in buses:
        bus.shutdown()
    print(json.dumps({"ns": round(best_ns, 1), "nodes": NODES, "version": can.__version__}))


main()
