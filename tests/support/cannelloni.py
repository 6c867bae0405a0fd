# SPDX-License-Identifier: MIT
"""The other end of a tunnel of cannelloni, written from its doc/udp_format.md and
doc/tcp_protocol.md alone."""

import socket
import struct
import time

PATIENCE_S = 120
GREETING = b"CANNELLONIv1"
RTR, FD = 0x40000000, 0x80


def pack(can_id, data=b"", flags=None, length=None):
    """Returns a frame, of CAN FD if it has flags."""
    length = len(data) if length is None else length
    fd = b"" if flags is None else bytes([flags])
    return struct.pack(">IB", can_id, length | (FD if fd else 0)) + fd + data


def packet(number, *frames, count=None, version=2, operation=0):
    count = len(frames) if count is None else count
    return struct.pack(">BBBH", version, operation, number, count) + b"".join(frames)


def unpack(stream, partial=False):
    """Splits frames: identifier, data, and flags or None; a remote frame has its length as data.
    Returns them, and what is no whole frame."""
    frames = []
    while len(stream) >= 5:
        can_id, length = struct.unpack_from(">IB", stream)
        begin = 5 + bool(length & FD)
        end = begin + (0 if can_id & RTR else length & 127)
        if len(stream) < end:
            break
        flags = stream[5] if length & FD else None
        frames.append((can_id, length & 127 if can_id & RTR else stream[begin:end], flags))
        stream = stream[end:]
    assert partial or not stream
    return frames, stream


class Datagrams:
    """An end of UDP. `packets` are those that have come: number and frames."""

    def __init__(self, host="127.0.0.1"):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.bind((host, 0))
        self.port = self.socket.getsockname()[1]
        self.packets, self.waiting = [], []

    def to(self, port, host="127.0.0.1"):
        self.socket.connect((host, port))
        return self

    def send(self, number, *frames, **more):
        self.socket.send(packet(number, *frames, **more))

    def receive(self):
        """Returns the next frame."""
        while not self.waiting:
            received = self.socket.recv(65536)
            version, operation, number, count = struct.unpack_from(">BBBH", received)
            self.waiting, _ = unpack(received[5:])
            assert (version, operation, count) == (2, 0, len(self.waiting)), received
            self.packets.append((number, list(self.waiting), len(received)))
        return self.waiting.pop(0)


class Stream:
    """A connection, as it has been made; both greet."""

    def __init__(self, connection, greeting=GREETING):
        self.socket = connection
        self.socket.settimeout(PATIENCE_S)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.rest, self.waiting = b"", []
        self.socket.sendall(greeting)
        if greeting == GREETING:
            got = b""
            while len(got) < len(GREETING):
                got += self.socket.recv(len(GREETING) - len(got)) or b"the end"
            assert got == GREETING

    def send(self, *frames):
        self.socket.sendall(b"".join(frames))

    def receive(self):
        while not self.waiting:
            part = self.socket.recv(4096)
            assert part, "the port has closed the connection"
            self.waiting, self.rest = unpack(self.rest + part, partial=True)
        return self.waiting.pop(0)

    def ends(self):
        try:
            while self.socket.recv(4096):
                pass
        except ConnectionResetError:
            pass
        return True

    def close(self):
        self.socket.close()


def connect(port):
    """Connects as soon as the port listens, which may have refused an earlier connection."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return Stream(socket.create_connection(("127.0.0.1", port)))
        except (AssertionError, ConnectionError):
            assert time.monotonic() < deadline
            time.sleep(0.02)
