# SPDX-License-Identifier: MIT
"""Requests by HTTP at `metrics`, written by hand so that they can be wrong, and names of metrics by
the tables of the counters."""

import json
import socket
from pathlib import Path
from typing import NamedTuple

from simtool import CANWIRE

PATIENCE_S = 120
TABLES = Path(CANWIRE).with_name("tables.json")  # of the same build
PREFIXES = {"bus": "canwire_bus_", "node": "canwire_node_", "host": "canwire_host_",
            "sleep": "canwire_sleep_", "interface": "canwire_interface_",
            "tunnel": "canwire_tunnel_"}
UNITS = {"frames": ("frames", 0), "bytes": ("bytes", 0), "bits": ("bit_times", 0),
         "errors": ("errors", 0), "times": ("", 0), "ns": ("seconds", 9),
         "permille": ("ratio", 3), "10^-6": ("ratio", 6), "10^-12": ("errors", 12)}
ENDS = {"permille": "permille", "10^-6": "ppm", "10^-12": "ppt"}  # of names, where not the unit


class Answer(NamedTuple):
    status: int
    head: dict
    body: str


def family(table, counter):
    """The name of a counter as a metric, and the digits behind its point."""
    unit, digits = UNITS[counter["unit"]]
    words = counter["name"].split("_")
    if words[-1] == ENDS.get(counter["unit"], counter["unit"]):
        words.pop()
    return PREFIXES[table] + "_".join(filter(None, [*words, unit])), digits


def counters():
    """Each counter of the tables: its table, its row, its metric, the digits of that."""
    tables = json.loads(TABLES.read_text())
    return [(table, row, *family(table, row)) for table in PREFIXES for row in tables[table]]


def connect(address):
    """Connects to HOST:PORT, or to a path."""
    if isinstance(address, Path):
        end = socket.socket(socket.AF_UNIX)
        end.settimeout(PATIENCE_S)
        end.connect(str(address))
    else:
        end = socket.create_connection(address, PATIENCE_S)
    return end


def read_all(end):
    parts = []
    while part := end.recv(1 << 16):
        parts.append(part)
    return b"".join(parts)


def parse(text):
    head, _, body = text.decode().partition("\r\n\r\n")
    first, *lines = head.split("\r\n")
    return Answer(int(first.split()[1]), dict(line.lower().split(": ", 1) for line in lines), body)


def ask(address, request=b"GET /metrics HTTP/1.1\r\nHost: a\r\n\r\n"):
    """The answer to a request, up to the end of the connection."""
    with connect(address) as end:
        end.sendall(request)
        return parse(read_all(end))


def accepting(media):
    return f"GET /metrics HTTP/1.1\r\nHost: a\r\nAccept: {media}\r\n\r\n".encode()
