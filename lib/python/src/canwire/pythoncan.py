# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""The interface `canwire` of python-can.

    can.Bus(interface="canwire", channel="powertrain", node="engine")

is a node of the running bus `powertrain`, when there is one. Else the channel is a bus inside of
this process, in real time, and each can.Bus on it is a node of its own. It has arbitration, bit
timing and errors, which the interface `virtual` lacks.
"""

from __future__ import annotations

import json
import os
import pathlib
import random
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import can
from can.broadcastmanager import (LimitedDurationCyclicSendTaskABC, ModifiableCyclicTaskABC,
                                  RestartableCyclicTaskABC)

from . import _library
from .bus import Bus, ConfigError, Error
from .frame import ERR_FLAG, Frame

RUN_FOLDER = "/run/canwire"
QUEUE = 512  # frames of a node in a bus of this process
GUESTS = 62
#: A node that acknowledges, so that a single program can send, as it can on `virtual`.
LISTENER = "listener"
STATES = {"error-active": can.BusState.ACTIVE, "error-warning": can.BusState.ACTIVE,
          "error-passive": can.BusState.PASSIVE, "bus-off": can.BusState.ERROR,
          "sleeping": can.BusState.PASSIVE}


def to_frame(message: can.Message) -> Frame:
    """Turns a message into a frame for a node."""
    if message.is_error_frame:
        raise ValueError("error frames cannot be sent: inject a fault")
    return Frame(message.arbitration_id, bytes(message.data or b""), message.is_extended_id,
                 message.is_remote_frame, message.is_fd, message.bitrate_switch,
                 message.error_state_indicator, message.dlc if message.is_remote_frame else None)


def to_message(frame: Frame, timestamp: float, channel: Any) -> can.Message:
    """Turns a frame of a node into a message."""
    return can.Message(timestamp=timestamp, arbitration_id=frame.id,
                       is_extended_id=frame.extended or frame.error,
                       is_remote_frame=frame.remote, is_error_frame=frame.error, is_fd=frame.fd,
                       bitrate_switch=frame.brs, error_state_indicator=frame.esi,
                       data=frame.data, dlc=frame.dlc if frame.remote else len(frame.data),
                       is_rx=not frame.own, channel=channel)


def _refuse(problem: object) -> can.CanInitializationError:
    return can.CanInitializationError(f"canwire: {problem}")


# ---- Buses in this process -----------------------------------------------------------------------


class Wire:
    """A bus in this process, and the nodes of it that are in use.

    In real time it is where the clock is, whenever somebody looks at it. So it needs no thread.
    """

    all: dict[Any, Wire] = {}
    lock = threading.RLock()  # of this table

    def __init__(self, key: Any, bus: Bus, virtual: bool):
        self.key, self.bus, self.virtual = key, bus, virtual
        self.changed = threading.Condition(threading.RLock())
        self.start_ns, self.epoch = time.monotonic_ns(), time.time()
        self.used: set[int] = set()
        self.coming = 0  # programs that have the bus, but no node yet
        self.leaving: set[int] = set()
        self.tasks: list[VirtualTask] = []

    @classmethod
    def open(cls, key: Any, make: Callable[[], Bus], virtual: bool) -> Wire:
        """Returns the bus of a channel; makes it for its first user."""
        with cls.lock:
            if key not in cls.all:
                cls.all[key] = cls(key, make(), virtual)
            wire = cls.all[key]
            if wire.virtual != virtual:
                time_of = "virtual" if wire.virtual else "real"
                raise _refuse(f"channel {key!r} is in use in {time_of} time")
            wire.coming += 1
            return wire

    def end_unused(self) -> None:
        """Ends the bus when no program has it."""
        with self.lock:
            if not self.used and not self.coming and self.all.get(self.key) is self:
                del self.all[self.key]
                self.bus.close()

    def names(self) -> list[str]:
        """Returns the names of nodes for programs."""
        return [name for info in self.bus.buses for name in
                (f"{info.name}:{node}" if len(self.bus.buses) > 1 else node for node in info.nodes)
                if node_is_for_programs(name)]

    def take_node(self, name: str | None) -> int:
        """Takes a node for a program; without a name the first one that is free."""
        with self.changed:
            self.advance()
            if name is not None:
                try:
                    nodes = [self.bus.node(name)]
                except Error as problem:
                    raise _refuse(problem) from None
            else:
                nodes = [self.bus.node(one) for one in self.names()]
            free = [node for node in nodes if node.number not in self.used]
            if not free:
                raise _refuse(f"node {name} is in use" if name else
                              f"all nodes of channel {self.key!r} are in use")
            node = free[0]
            self.used.add(node.number)
            self.leaving.discard(node.number)
            if not node.status.attached:
                node.attach()
                self.integrate()
            return node.number

    def integrate(self) -> None:
        """Waits until a node that comes onto the bus takes part: 11 recessive bits, and as many
        more as a frame can have."""
        bits = 1e9 / min(info.bitrate for info in self.bus.buses)
        if self.virtual:
            self.run_to(self.bus.now_ns + round(12 * bits))
            return
        end = self.now_ns() + round(12 * bits)
        while (rest := end - self.now_ns()) > 0:
            time.sleep(rest / 1e9)
        self.advance()

    def give_back(self, number: int) -> None:
        """Takes a node off the bus when its last frame has gone; the last user ends the bus."""
        with self.lock, self.changed:
            self.used.discard(number)
            node = self.bus.nodes[number]
            node.listen(False)
            if node.name.startswith("guest-"):
                self.leaving.add(number)
            self.changed.notify_all()
            self.end_unused()

    # ---- time -------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Returns the time of the programs, as time of the bus."""
        return self.bus.now_ns if self.virtual else time.monotonic_ns() - self.start_ns

    def timestamp(self, frame: Frame) -> float:
        """Returns the time of a frame as that of programs."""
        return frame.t if self.virtual else self.epoch + frame.t

    def run_to(self, end_ns: int, number: int = _library.NO_NODE) -> None:
        """Lets time go on, with the periodic frames up to there."""
        while True:
            due = min((task.next_ns for task in self.tasks), default=_library.NEVER)
            stop = self.bus._run(min(end_ns, due), None, number)
            if stop == _library.AT_FRAME or due >= end_ns:
                return
            for task in [task for task in self.tasks if task.next_ns == due]:
                task.release()

    def advance(self) -> None:
        """Brings a bus in real time to now."""
        if self.virtual:
            return
        self.run_to(max(self.now_ns(), self.bus.now_ns))
        for number in [*self.leaving]:
            status = self.bus.nodes[number].status
            if status.queue + status.inbox == 0:
                self.leaving.discard(number)
                self.bus.nodes[number].detach()

    def next_s(self) -> float:
        """Returns the time up to the next frame that may come, in seconds."""
        due = self.bus._library.next(self.bus._sim)
        return max(due - self.now_ns(), 0) / 1e9

    def wait(self, seconds: float | None) -> None:
        """Waits until a frame may come, or somebody does something."""
        ahead = self.next_s()
        if ahead < 1000:
            seconds = ahead if seconds is None else min(seconds, ahead)
        self.changed.wait(seconds if seconds is None else max(seconds, 20e-6))

    # ---- frames -----------------------------------------------------------------------------

    def receive(self, number: int, timeout: float | None) -> Frame | None:
        """Takes the next frame of a node, and waits for one."""
        with self.changed:
            if self.virtual:
                return self.receive_virtually(number, timeout)
            end = None if timeout is None else time.monotonic() + timeout
            while True:
                if number not in self.used:
                    raise can.CanOperationError("canwire: the bus is closed")
                self.advance()
                frame = self.bus._take(number)
                rest = None if end is None else end - time.monotonic()
                if frame or (rest is not None and rest <= 0):
                    return frame
                self.wait(rest)

    def receive_virtually(self, number: int, timeout: float | None) -> Frame | None:
        if number not in self.used:
            raise can.CanOperationError("canwire: the bus is closed")
        frame = self.bus._take(number)
        if frame or timeout == 0:
            return frame
        if timeout is not None:
            self.run_to(self.bus.now_ns + round(timeout * 1e9), number)
            return self.bus._take(number)
        while not (frame := self.bus._take(number)):
            due = self.bus._library.next(self.bus._sim)
            if due == _library.NEVER and not self.tasks:
                self.changed.wait()  # for another thread
                if number not in self.used:
                    raise can.CanOperationError("canwire: the bus is closed")
            else:
                self.run_to(self.bus.now_ns + 1_000_000, number)
        return frame

    def send(self, number: int, frame: Frame, timeout: float | None) -> None:
        """Hands a frame in; waits for room in the queue."""
        node = self.bus.nodes[number]
        end = None if timeout is None else time.monotonic() + timeout
        with self.changed:
            self.advance()
            while node.room <= node.status.inbox:
                if node.state == "bus-off":
                    raise can.CanOperationError("canwire: the node is bus-off")
                rest = None if end is None else end - time.monotonic()
                if rest is not None and rest <= 0:
                    raise can.CanOperationError("canwire: the queue of the node is full")
                if self.virtual:
                    self.run_to(self.bus.now_ns + 100_000)
                else:
                    self.wait(rest)
                    self.advance()
            try:
                node.send(frame, at=None if self.virtual else self.now_ns() / 1e9)
            except Error as problem:
                raise can.CanOperationError(f"canwire: {problem}") from None
            self.changed.notify_all()


def node_is_for_programs(name: str) -> bool:
    return name.rpartition(":")[2] != LISTENER


class VirtualTask(LimitedDurationCyclicSendTaskABC, ModifiableCyclicTaskABC,
                  RestartableCyclicTaskABC):
    """Periodic frames in virtual time."""

    def __init__(self, wire: Wire, number: int, messages: Sequence[can.Message], period: float,
                 duration: float | None, autostart: bool,
                 modifier: Callable[[can.Message], None] | None):
        super().__init__(messages, period, duration)
        self.wire, self.number, self.modifier = wire, number, modifier
        self.step_ns = round(period * 1e9)
        self.next_ns = self.end_ns = self.index = 0
        if autostart:
            self.start()

    def start(self) -> None:
        with self.wire.changed:
            if self not in self.wire.tasks:
                self.next_ns = self.wire.bus.now_ns
                self.end_ns = (_library.NEVER if self.duration is None
                               else self.next_ns + round(self.duration * 1e9))
                self.wire.tasks.append(self)
                self.wire.changed.notify_all()

    def stop(self) -> None:
        with self.wire.changed:
            if self in self.wire.tasks:
                self.wire.tasks.remove(self)

    def release(self) -> None:
        """Sends the present message, at its time."""
        if self.next_ns >= self.end_ns:
            self.stop()
            return
        message = self.messages[self.index]
        if self.modifier is not None:
            self.modifier(message)
        self.wire.bus.nodes[self.number].send(to_frame(message))
        self.index = (self.index + 1) % len(self.messages)
        self.next_ns += self.step_ns


class Inside:
    """A node of a bus in this process."""

    def __init__(self, channel: Any, key: Any, name: str | None, make: Callable[[], Bus],
                 virtual: bool, own: bool, errors: bool):
        self.channel = channel
        self.wire = Wire.open(key, make, virtual)
        try:
            self.number = self.wire.take_node(name)
        finally:
            with Wire.lock:
                self.wire.coming -= 1
                self.wire.end_unused()
        self.node = self.wire.bus.nodes[self.number]
        while self.wire.bus._take(self.number):
            pass  # of an earlier user
        self.node.listen(True, own, errors)
        info = self.wire.bus.buses[[info.name for info in self.wire.bus.buses].index(
            self.node.bus_name)]
        self.fd = info.fd
        self.text = f"node {self.node.name} of {self.node.bus_name}, in this process"

    def receive(self, timeout: float | None) -> can.Message | None:
        frame = self.wire.receive(self.number, timeout)
        return frame and to_message(frame, self.wire.timestamp(frame), self.channel)

    def send(self, message: can.Message, timeout: float | None) -> None:
        self.wire.send(self.number, to_frame(message), timeout)

    def state(self) -> can.BusState:
        with self.wire.changed:
            self.wire.advance()
            return STATES[self.node.state]

    def set_state(self, state: can.BusState) -> None:
        with self.wire.changed:
            self.wire.advance()
            self.node.set(listen_only=state is can.BusState.PASSIVE)

    def close(self) -> None:
        self.wire.give_back(self.number)


# ---- Running buses -------------------------------------------------------------------------------

HEAD = struct.Struct("=BBHIIIQQ")  # type, flags, size, number, lost, reserved, realtime, bus time
HELLO_BODY = struct.Struct("=8sIIII36s")  # magic, version, options, error mask, MTU, name
CLASSICAL, FD_BODY = struct.Struct("=IB2xB8s"), struct.Struct("=IBB2x64s")
FILTER = struct.Struct("=II")
HELLO, FRAME, OPTIONS, FILTERS, DROPPED, ERROR = range(1, 7)
LOCAL, OWN = 1, 2
LOOPBACK, RECV_OWN, FD = 1, 2, 4
EFF_FLAG, RTR_FLAG = 0x80000000, 0x40000000
FDF, BRS, ESI = 4, 1, 2
PATIENCE_S = 30


def ask(path: str, request: dict[str, Any]) -> dict[str, Any]:
    """Sends a request to the control socket of a bus."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as control:
        control.settimeout(PATIENCE_S)
        control.connect(path)
        control.sendall(json.dumps(request).encode() + b"\n")
        reply = json.loads(control.makefile("rb").readline())
    if not reply.get("ok"):
        raise _refuse(reply.get("error", "the bus refuses"))
    return reply


def ports_of(path: str) -> dict[str, str]:
    """Returns the nodes of a running bus that have a socket, with its path."""
    status = ask(path, {"request": "status"})["status"]
    found = {}
    for node in status["nodes"]:
        port = node.get("port") or ""
        if port.startswith("unix:"):
            found[node["name"]] = os.path.join(status["directory"], port[len("unix:"):])
    return found


def is_socket_path(channel: Any) -> bool:
    """Returns True for what names a socket, or a file, and no bus."""
    return isinstance(channel, str) and ("/" in channel or channel.endswith(".sock"))


def find_running(channel: Any) -> str | None:
    """Returns the control socket of the running bus that a channel names, or None."""
    if not isinstance(channel, str) or not channel:
        return None
    path = channel if is_socket_path(channel) else f"{RUN_FOLDER}/{channel}.sock"
    try:
        return path if pathlib.Path(path).is_socket() else None
    except OSError:
        return None


class Outside:
    """A client of the port of a node; config/ports.md describes the protocol."""

    def __init__(self, channel: Any, path: str, own: bool, errors: bool, control: str | None,
                 node: str | None):
        self.channel, self.errors, self.control, self.node = channel, errors, control, node
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.now = can.BusState.ACTIVE
        self.sending = threading.Lock()
        try:
            self.socket.settimeout(PATIENCE_S)
            self.socket.bind("")  # an address makes it a client
            self.socket.connect(path)
            options = LOOPBACK | FD | (RECV_OWN if own else 0)
            self.write(HELLO, HELLO_BODY.pack(b"canwire", 1, options, 0x1FFFFFFF, 0,
                                              f"python-{os.getpid()}".encode()))
            kind, _, body, _ = self.read()
            if kind != HELLO:
                raise _refuse(f"{path}: {body[4:].rstrip(bytes(1)).decode('utf-8', 'replace')}")
        except OSError as problem:
            self.socket.close()
            raise _refuse(f"{path}: {problem}") from None
        except can.CanInitializationError:
            self.socket.close()
            raise
        self.fd = HELLO_BODY.unpack(body)[4] == 72
        if control and node:
            status = ask(control, {"request": "status"})["status"]
            self.now = next(STATES[one["state"]] for one in status["nodes"]
                            if one["name"] == node)
        self.text = f"node {node or path} of a running bus"

    def write(self, kind: int, body: bytes) -> None:
        self.socket.send(HEAD.pack(kind, 0, HEAD.size + len(body), 0, 0, 0, 0, 0) + body)

    def read(self) -> tuple[int, int, bytes, int]:
        packed = self.socket.recv(8192)
        if not packed:
            raise can.CanOperationError("canwire: the bus has ended the connection")
        kind, flags, _, _, _, _, realtime_ns, _ = HEAD.unpack_from(packed)
        return kind, flags, packed[HEAD.size:], realtime_ns

    def receive(self, timeout: float | None) -> can.Message | None:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            rest = None if end is None else max(end - time.monotonic(), 0)
            if not select.select([self.socket], [], [], rest)[0]:
                return None
            try:
                kind, flags, body, realtime_ns = self.read()
            except OSError as problem:
                raise can.CanOperationError(f"canwire: {problem}") from None
            message = self.unpack(flags, body, realtime_ns) if kind == FRAME else None
            if message is not None and (self.errors or not message.is_error_frame):
                return message

    def unpack(self, flags: int, body: bytes, realtime_ns: int) -> can.Message:
        if len(body) == FD_BODY.size:
            can_id, length, bits, data = FD_BODY.unpack(body)
        else:
            can_id, length, _, data = CLASSICAL.unpack(body)
            bits = 0
        remote = bool(can_id & RTR_FLAG)
        frame = Frame(can_id & 0x1FFFFFFF, b"" if remote else data[:length],
                      bool(can_id & EFF_FLAG), remote, len(body) == FD_BODY.size,
                      bool(bits & BRS), bool(bits & ESI), length if remote else None,
                      bool(can_id & ERR_FLAG), bool(flags & (LOCAL | OWN)))
        if frame.error:
            self.note(frame)
        return to_message(frame, realtime_ns / 1e9, self.channel)

    def note(self, error: Frame) -> None:
        """Learns the state of the node from an error frame (linux/can/error.h)."""
        if error.id & 0x40:
            self.now = can.BusState.ERROR
        elif error.id & 0x100:
            self.now = can.BusState.ACTIVE
        elif error.id & 0x4 and error.data[1] & 0x30:
            self.now = can.BusState.PASSIVE
        elif error.id & 0x4 and error.data[1] & 0x4C:
            self.now = can.BusState.ACTIVE

    def send(self, message: can.Message, timeout: float | None) -> None:
        frame = to_frame(message)
        can_id = frame.id | frame.extended * EFF_FLAG | frame.remote * RTR_FLAG
        if frame.fd:
            body = FD_BODY.pack(can_id, len(frame.data), FDF | frame.brs * BRS | frame.esi * ESI,
                                frame.data)
        else:
            body = CLASSICAL.pack(can_id, (frame.dlc or 0) if frame.remote else len(frame.data), 0,
                                  frame.data)
        with self.sending:
            if not select.select([], [self.socket], [], timeout)[1]:
                raise can.CanOperationError("canwire: the queue of the node is full")
            try:
                self.write(FRAME, body)
            except OSError as problem:
                raise can.CanOperationError(f"canwire: {problem}") from None

    def filter(self, filters: Sequence[dict[str, Any]] | None) -> None:
        """Lets the port filter."""
        pairs = []
        for one in filters or [{"can_id": 0, "can_mask": 0}]:
            can_id, mask = one["can_id"], one["can_mask"]
            if "extended" in one:
                mask |= EFF_FLAG
                can_id |= EFF_FLAG if one["extended"] else 0
            pairs.append(FILTER.pack(can_id, mask))
        with self.sending:
            self.write(FILTERS, b"".join(pairs))

    def state(self) -> can.BusState:
        return self.now

    def set_state(self, state: can.BusState) -> None:
        if not self.control or not self.node:
            raise NotImplementedError("the state can be set where the channel is that of a bus")
        ask(self.control, {"request": "set", "node": self.node, "settings":
                           {"listen-only": state is can.BusState.PASSIVE}})

    def close(self) -> None:
        self.socket.close()


# ---- The interface -------------------------------------------------------------------------------


def split(channel: Any, node: str | None) -> tuple[Any, str | None]:
    """Splits BUS:NODE, where no bus or file has the whole name."""
    if node is None and isinstance(channel, str) and ":" in channel and \
            not channel.startswith("unix:") and not os.path.exists(channel):
        channel, _, node = channel.rpartition(":")
    return channel, node


def is_configuration(channel: Any) -> bool:
    """Returns True for the name of a file that describes a bus."""
    return isinstance(channel, (str, os.PathLike)) and str(channel).endswith((".yaml", ".yml"))


def make_default(key: Any, bitrate: int, data_bitrate: int) -> Bus:
    """Makes a bus whose nodes are programs."""
    return Bus.from_dict({
        "bus": {"name": "python", "bitrate": bitrate, "dbitrate": data_bitrate},
        "defaults": {"queue": QUEUE, "order": "fifo"},  # as an interface of Linux
        "guests": {"count": GUESTS, "port": "unix:python.sock"},
        "nodes": [{"name": LISTENER}]}, name=f"channel-{key}.yaml", listen=False, events="none")


def make(channel: Any, config: Any, bitrate: int, data_bitrate: int) -> Bus:
    """Makes the bus of a channel in this process."""
    try:
        if isinstance(config, dict):
            return Bus.from_dict(config, listen=False, events="none")
        if config is not None:
            return Bus.from_yaml(config, listen=False, events="none")
        if is_configuration(channel):
            return Bus.from_yaml(channel, listen=False, events="none")
        return make_default(channel, bitrate, data_bitrate)
    except ConfigError as problem:
        raise _refuse(problem) from None


class CanwireBus(can.BusABC):
    """A node of a bus of canwire.

    :param channel: the name of a running bus, the path of its control socket, or `unix:PATH`, the
        port of a node; NAME:NODE chooses a node. Else it names a bus in this process: a file in
        YAML, or any other object, for a bus of its own that all instances with this channel share.
    :param node: the name of the node; without it, one that is free.
    :param config: what the bus in this process is, as for Bus.from_yaml() or Bus.from_dict().
    :param private: True: in this process, also when a bus of that name runs; False: never.
    :param virtual_time: recv() lets the time of the bus in this process go on, instead of waiting.
    :param receive_own_messages: own messages are received when the bus has sent them.
    :param ignore_rx_error_frames: error frames are no messages; `state` knows of them all the same.
    :param bitrate, data_bitrate: of a new bus in this process without `config`.
    """

    def __init__(self, channel: Any = "channel-0", *, node: str | None = None, config: Any = None,
                 private: bool | None = None, virtual_time: bool = False,
                 receive_own_messages: bool = False, ignore_rx_error_frames: bool = False,
                 bitrate: int = 500_000, data_bitrate: int | None = None, can_filters: Any = None,
                 **kwargs: Any):
        self.channel = channel
        self._virtual = virtual_time
        where, node = split(channel, node)
        own, errors = receive_own_messages, not ignore_rx_error_frames
        running = None if config is not None or private or virtual_time else find_running(where)
        if isinstance(where, str) and where.startswith("unix:"):
            self._end: Inside | Outside = Outside(channel, where[len("unix:"):], own, errors,
                                                  None, None)
        elif running:
            self._end = self._attach(channel, running, node, own, errors)
        elif private is False or (private is None and config is None and is_socket_path(where)
                                  and not is_configuration(where)):
            raise _refuse(f"there is no running bus {where!r}")
        else:
            data_rate = data_bitrate or max(bitrate, min(4 * bitrate, 2_000_000))
            self._end = Inside(channel, where if config is None else (where, str(config)), node,
                               lambda: make(where, config, bitrate, data_rate), virtual_time, own,
                               errors)
        self.channel_info = f"canwire: {self._end.text}"
        if hasattr(can, "CanProtocol"):  # since python-can 4.3
            self._can_protocol = can.CanProtocol.CAN_FD if self._end.fd else can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    @staticmethod
    def _attach(channel: Any, control: str, node: str | None, own: bool,
                errors: bool) -> Outside:
        ports = ports_of(control)
        if node is None and len(ports) != 1:
            raise _refuse(f"which node of {control}? node= is one of: {', '.join(ports) or 'none'}")
        name = node or next(iter(ports))
        if name not in ports:
            raise _refuse(f"{control} has no node {name!r} with a port unix:PATH; there is "
                          f"{', '.join(ports) or 'none'}")
        return Outside(channel, ports[name], own, errors, control, name)

    @property
    def simulation(self) -> Bus:
        """The canwire.Bus in this process, to inject faults and read its statistics."""
        self._check_open()
        if not isinstance(self._end, Inside):
            raise can.CanOperationError("canwire: this bus runs outside of this process")
        return self._end.wire.bus

    def _check_open(self) -> None:
        if getattr(self, "_is_shutdown", False):  # python-can has it since 4.2
            raise can.CanOperationError("canwire: the bus is closed")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self._check_open()
        if not self._virtual:
            return super().recv(timeout)
        end = None if timeout is None else self._now() + timeout
        while True:  # in virtual time, which the clock of python-can does not know
            message, _ = self._recv_internal(timeout)
            if message is None or self._matches_filters(message):
                return message
            timeout = None if end is None else max(end - self._now(), 0)

    def _now(self) -> float:
        return self._end.wire.bus.now  # type: ignore[union-attr]

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._check_open()
        return self._end.receive(timeout), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._check_open()
        self._end.send(msg, timeout)

    def _send_periodic_internal(self, msgs: Any, period: float, duration: float | None = None,
                                *more: Any) -> Any:
        """more: nothing before python-can 4.3, [autostart before] modifier_callback since then."""
        self._check_open()
        if not self._virtual:
            return super()._send_periodic_internal(msgs, period, duration, *more)
        msgs = [msgs] if isinstance(msgs, can.Message) else msgs
        autostart = more[0] if len(more) > 1 else True
        return VirtualTask(self._end.wire, self._end.number, msgs,  # type: ignore[union-attr]
                           period, duration, autostart, more[-1] if more else None)

    def _apply_filters(self, filters: Any) -> None:
        if isinstance(self._end, Outside):
            self._end.filter(filters)

    @property
    def state(self) -> can.BusState:
        """ACTIVE, PASSIVE (error-passive) or ERROR (bus-off). To set it to PASSIVE makes the node
        listen-only, to ACTIVE ends that."""
        self._check_open()
        return self._end.state()

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        self._check_open()
        self._end.set_state(new_state)

    def fileno(self) -> int:
        if isinstance(self._end, Outside):
            return self._end.socket.fileno()
        raise NotImplementedError("a bus in this process has no file")

    def shutdown(self) -> None:
        was_open = not getattr(self, "_is_shutdown", False)
        super().shutdown()
        self._is_shutdown = True
        if was_open and hasattr(self, "_end"):
            self._end.close()

    @staticmethod
    def _detect_available_configs() -> list[dict[str, Any]]:
        """Returns the nodes of running buses that have a socket, the channels that are in use in
        this process, and one more."""
        found = []
        for path in sorted(pathlib.Path(RUN_FOLDER).glob("*.sock")):
            try:
                found += [{"interface": "canwire", "channel": f"{path.stem}:{node}"}
                          for node in ports_of(str(path))]
            except (OSError, ValueError, KeyError, can.CanError):
                continue  # it is no control socket, or nobody answers
        with Wire.lock:
            used = [*Wire.all]
        while (extra := f"channel-{random.randint(0, 9999)}") in used:
            pass
        return [*found, *({"interface": "canwire", "channel": key} for key in [*used, extra])]
