# SPDX-License-Identifier: MIT
"""Ports of IP that a test may have, though other tests and programs run beside it."""

import errno
import random
import socket
import time
from pathlib import Path

PATIENCE_S = 120
taken = []  # locks on ports of this process


def first_ephemeral():
    """The least port that the kernel may give to any socket, at any time."""
    return int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])


def lock(port):
    """Returns whether the port was free of other tests; the kernel unlocks it with this process."""
    mine = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        mine.bind(f"\0canwire-test-port-{port}")
    except OSError:
        mine.close()
        return False
    taken.append(mine)
    return True


def free_port(kind=socket.SOCK_STREAM, host="127.0.0.1"):
    """A port that stays free until this process opens it.

    One that the kernel names would not: once closed, it goes to the next who asks for any port.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    end = first_ephemeral()
    ports = range(2 * end // 3, 7 * end // 8)  # not 20000 and 29536, which protocols have
    for port in random.sample(ports, len(ports)):
        if lock(port):
            with socket.socket(family, kind) as probe:
                try:
                    probe.bind((host, port))
                except OSError:
                    continue
            return port
    raise AssertionError(f"all ports from {ports.start} to {ports.stop - 1} are taken")


def bind_soon(end, address):
    """For a port that a protocol fixes: any socket may have it for a while if it is ephemeral."""
    limit = time.monotonic() + PATIENCE_S
    while True:
        try:
            return end.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE or time.monotonic() > limit:
                raise
            time.sleep(0.1)
