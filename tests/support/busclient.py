# SPDX-License-Identifier: MIT
"""A client of a port, by the protocol of canwire-ports(7); written from that page alone."""

import contextlib
import socket
import struct
from typing import NamedTuple

HEAD = struct.Struct("=BBHIIIQQ")  # type, flags, size, number, lost, reserved, realtime_ns, bus_ns
HELLO_BODY = struct.Struct("=8sIIII36s")  # magic, version, options, error mask, MTU, name
FRAME_BODY = struct.Struct("=IBxxB8s")
FD_BODY = struct.Struct("=IBBxx64s")
HELLO, FRAME, OPTIONS, FILTERS, DROPPED, ERROR, FLUSH = range(1, 8)
LOCAL, OWN = 1, 2
LOOPBACK, RECV_OWN, FD, JOIN, TELL_DROPPED, FLUSHES = 1, 2, 4, 8, 16, 32
PATIENCE_S = 120


class Message(NamedTuple):
    type: int
    flags: int
    number: int
    lost: int
    realtime_ns: int
    bus_ns: int
    body: bytes

    @property
    def can_id(self):
        return int.from_bytes(self.body[:4], "little")

    @property
    def data(self):
        return self.body[8:8 + self.body[4]]

    @property
    def code(self):
        return int.from_bytes(self.body[:4], "little")

    @property
    def text(self):
        return self.body[4:].rstrip(b"\0").decode()


def unpack(packed):
    kind, flags, size, number, lost, _, realtime_ns, bus_ns = HEAD.unpack_from(packed)
    assert size == len(packed)
    return Message(kind, flags, number, lost, realtime_ns, bus_ns, packed[HEAD.size:])


class Client:
    """A client that has said hello; `welcome` is the answer to it."""

    def __init__(self, path, name="", options=LOOPBACK, error_mask=0, hello=True, version=1):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.settimeout(PATIENCE_S)
        self.socket.bind("")  # the address that makes it a client
        self.socket.connect(str(path))
        if hello:
            with contextlib.suppress(BrokenPipeError):  # turned away by now; the answer waits
                self.write(HELLO, HELLO_BODY.pack(b"canwire", version, options, error_mask, 0,
                                                  name.encode()))
            self.welcome = self.receive_answer()

    def write(self, kind, body=b"", number=0, flags=0):
        self.socket.send(HEAD.pack(kind, flags, HEAD.size + len(body), number, 0, 0, 0, 0) + body)

    def send(self, can_id, data=b"", number=0):
        self.write(FRAME, FRAME_BODY.pack(can_id, len(data), 0, data), number)

    def send_fd(self, can_id, data=b"", flags=0, number=0):
        self.write(FRAME, FD_BODY.pack(can_id, len(data), flags, data), number)

    def set_options(self, options, error_mask=0):
        self.write(OPTIONS, struct.pack("=II", options, error_mask))

    def set_filters(self, *filters):
        self.write(FILTERS, b"".join(struct.pack("=II", *f) for f in filters))

    def receive_answer(self):
        """The kernel may report first that nobody has read the hello."""
        with contextlib.suppress(ConnectionResetError):
            return self.receive()
        return self.receive()

    def receive(self):
        packed = self.socket.recv(8192)  # whole: a message
        assert packed, "the port has closed the connection"
        return unpack(packed)

    def ends(self):
        """Returns True when the port closes the connection."""
        try:
            return self.socket.recv(8192) == b""  # whole: a message
        except ConnectionResetError:
            return True

    def close(self):
        self.socket.close()
