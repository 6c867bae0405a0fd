# SPDX-License-Identifier: MIT
"""A program that speaks as to socketcand, by its doc/protocol.md and canwire-ports(7)."""

import re
import socket

PATIENCE_S = 120


class Talker:
    """A connection; with a bus it has been opened, with a mode that is entered."""

    def __init__(self, port, bus=None, mode=None, host="127.0.0.1", room=None):
        self.socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        self.socket.settimeout(PATIENCE_S)
        if room:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room)
        self.socket.connect((host, port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.got = ""
        assert self.receive() == "< hi >"
        if bus:
            assert self.ask(f"open {bus}") == "< ok >"
        if mode:
            assert self.ask(mode) == "< ok >"

    def raw(self, text):
        self.socket.sendall(text.encode())

    def send(self, *commands):
        self.raw("".join(f"< {command} >" for command in commands))

    def receive(self):
        """Returns the next message."""
        while ">" not in self.got:
            part = self.socket.recv(4096).decode()
            assert part, "the port has closed the connection"
            self.got += part
        message, self.got = re.match(r"(<[^<>]*>)(.*)", self.got, re.S).groups()
        return message

    def ask(self, command):
        self.send(command)
        return self.receive()

    def frame(self):
        """Returns identifier and data of the next message, a frame."""
        kind, can_id, *_, data = re.fullmatch(
            r"< (frame) ([0-9A-F]+) \d+\.\d{6} ((?:[0-9A-F]{2} ?)*) ?>", self.receive()).groups()
        assert kind == "frame"
        return can_id, data.replace(" ", "")

    def ends(self):
        """Returns True when the port closes the connection, whatever comes before."""
        try:
            while part := self.socket.recv(4096):
                self.got += part.decode()
        except ConnectionResetError:
            pass
        return True

    def close(self):
        self.socket.close()
