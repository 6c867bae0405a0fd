# SPDX-License-Identifier: MIT
"""The lines of `ip -batch` that tests need most, without its process. Its start takes a tenth of a
second in the guest, and most tests need it twice.
"""

import os
import socket
import struct

NEWLINK, DELLINK, ERROR = 16, 17, 2
REQUEST, ACK, CREATE_NEW = 1, 4, 0x600
IFNAME, MTU, LINKINFO, KIND = 3, 4, 18, 1
UP = 1
HEAD, LINK = struct.Struct("=IHHII"), struct.Struct("=BxHiII")


def attribute(kind, data):
    return struct.pack("=HH", 4 + len(data), kind) + data + bytes(-len(data) % 4)


def text(kind, word):
    return attribute(kind, word.encode() + b"\0")


def parse(line):
    """Returns type, flags and body of the message for a line, or None where it is another one."""
    flags, change, attributes = 0, 0, b""
    match line.split():
        case ["link", "add", name, "type", "vcan"]:
            kind, options = NEWLINK, CREATE_NEW
            attributes = attribute(LINKINFO, text(KIND, "vcan"))
        case ["link", "del", name]:
            kind, options = DELLINK, 0
        case ["link", "set", name, *words] if words[-1:] in (["up"], ["down"]):
            kind, options, change, flags = NEWLINK, 0, UP, UP if words[-1] == "up" else 0
            if words[:-1]:
                if len(words) != 3 or words[0] != "mtu":
                    return None
                attributes = attribute(MTU, struct.pack("=I", int(words[1])))
        case _:
            return None
    return kind, options, LINK.pack(0, 0, 0, flags, change) + text(IFNAME, name) + attributes


def change(lines):
    """Does what the lines say, in their order; returns False when it does not know one of them."""
    messages = [parse(line) for line in lines]
    if None in messages:
        return False
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        for line, (kind, options, body) in zip(lines, messages):
            size = HEAD.size + len(body)
            kernel.send(HEAD.pack(size, kind, REQUEST | ACK | options, 0, 0) + body)
            answer = kernel.recv(65536)
            _, answered, *_ = HEAD.unpack_from(answer)
            number = -struct.unpack_from("=i", answer, HEAD.size)[0]
            assert answered == ERROR, answered
            if number:
                raise OSError(number, f"ip {line}: {os.strerror(number)}")
    return True
