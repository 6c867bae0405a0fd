# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""A bus of python-can at a node, in virtual time.

    with canwire.VirtualTime(bus):
        with can.Bus(interface="canwire", channel="tester") as tester: ...

or NodeBus("tester"). Several of them at one node see each other's frames when the bus has sent
them, as programs at one interface do.
"""

from __future__ import annotations

import logging
from collections import deque
from typing import Any, Tuple

import can

from . import _library
from .bus import Error, Node
from .frame import EFF_FLAG, ERR_FLAG, LENGTHS, RTR_FLAG, Frame
from .virtualtime import VirtualTime, current

BUS_LOG = logging.getLogger("can.bus")  # of python-can, for what all interfaces tell
STATES = {"error-active": can.BusState.ACTIVE, "error-warning": can.BusState.ACTIVE,
          "error-passive": can.BusState.PASSIVE, "bus-off": can.BusState.ERROR,
          "sleeping": can.BusState.PASSIVE}


def to_message(frame: Frame, timestamp: float, channel: Any, own: bool) -> can.Message:
    """Turns a frame of a node into a message."""
    if not (frame.remote or frame.error or frame.fd or own):  # most are so
        return can.Message(timestamp=timestamp, arbitration_id=frame.id,
                           is_extended_id=frame.extended, channel=channel, data=frame.data)
    return can.Message(timestamp=timestamp, arbitration_id=frame.id,
                       is_extended_id=frame.extended or frame.error,
                       is_remote_frame=frame.remote, is_error_frame=frame.error, is_fd=frame.fd,
                       bitrate_switch=frame.brs, error_state_indicator=frame.esi,
                       data=frame.data, dlc=frame.dlc if frame.remote else len(frame.data),
                       is_rx=not own, channel=channel)


def message_of(can_id: int, flags: int, length: int, data: bytes, timestamp: float,
               channel: Any) -> can.Message:
    """Makes a message of the members of a canwire_sim_frame."""
    number, extended = can_id & 0x1FFFFFFF, can_id >= EFF_FLAG
    if not flags and not can_id & (RTR_FLAG | ERR_FLAG):  # most are so, and arguments take time
        return can.Message(timestamp=timestamp, arbitration_id=number, is_extended_id=extended,
                           channel=channel, data=data[:length])
    remote, error = bool(can_id & RTR_FLAG), bool(can_id & ERR_FLAG)
    return can.Message(timestamp=timestamp, arbitration_id=number,
                       is_extended_id=extended or error, is_remote_frame=remote,
                       is_error_frame=error, channel=channel, dlc=length, data=data[:length],
                       is_fd=bool(flags & _library.FRAME_FD),
                       is_rx=not flags & _library.FRAME_OWN,
                       bitrate_switch=bool(flags & _library.FRAME_BRS),
                       error_state_indicator=bool(flags & _library.FRAME_ESI))


def why_not(message: can.Message, fd: bool) -> str | None:
    """Returns why a message can be no frame, or None."""
    data, remote = message.data or b"", message.is_remote_frame
    if message.is_error_frame:
        return "error frames cannot be sent: inject a fault"
    if message.is_fd and not fd:
        return "the node knows no CAN FD frames"
    if message.is_fd and remote:
        return "there are no remote frames of CAN FD"
    if not 0 <= message.arbitration_id <= (0x1FFFFFFF if message.is_extended_id else 0x7FF):
        return f"there is no identifier {message.arbitration_id:#x}"
    most = 64 if message.is_fd else 8
    if len(data) > most or (remote and not 0 <= message.dlc <= 8):
        return f"a frame of this kind has at most {most} bytes"
    return None


#: Of a canwire_sim_frame: identifier with flags, flags, length, raw DLC, data.
Fields = Tuple[int, int, int, int, bytes]


def fields_of(message: can.Message, fd: bool) -> Fields:
    """Returns what a frame of a node has. Raises can.CanOperationError when it is none."""
    problem = why_not(message, fd)
    if problem:
        raise can.CanOperationError(f"canwire: {problem}")
    can_id = message.arbitration_id | (EFF_FLAG if message.is_extended_id else 0)
    if message.is_remote_frame:
        return can_id | RTR_FLAG, 0, message.dlc, 0, b""
    data = bytes(message.data or b"")
    flags = 0
    if message.is_fd:
        flags = (_library.FRAME_FD | (_library.FRAME_BRS if message.bitrate_switch else 0)
                 | (_library.FRAME_ESI if message.error_state_indicator else 0))
    return can_id, flags, len(data), 0, data


def to_frame(message: can.Message, fd: bool) -> Frame:
    """Turns a message into a frame for a node. Raises can.CanOperationError when it is none."""
    can_id, flags, length, _, data = fields_of(message, fd)
    remote = bool(message.is_remote_frame)
    return Frame._of(id=can_id & 0x1FFFFFFF, data=data, extended=bool(message.is_extended_id),
                     remote=remote, fd=bool(message.is_fd), brs=bool(flags & _library.FRAME_BRS),
                     esi=bool(flags & _library.FRAME_ESI), dlc=length if remote else None,
                     error=False, own=False, t_ns=0)


class Told:
    """Makes errors of canwire errors of python-can."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, _: Any, problem: BaseException | None, *more: Any) -> None:
        if isinstance(problem, Error):
            raise can.CanOperationError(f"canwire: {problem}") from None


told = Told()


#: A frame that waits for a program, as the first arguments of message_of().
Received = Tuple[int, int, int, bytes, float]


def _on_the_wire(can_id: int, flags: int, length: int, data: bytes) -> tuple[Any, ...]:
    """Returns what is left of a frame when it comes back. It has as many bytes as the next DLC has,
    and the controller chooses ESI."""
    if can_id & RTR_FLAG:
        return can_id, length
    data = data[:length]
    if flags & _library.FRAME_FD:
        data = data.ljust(next(one for one in LENGTHS if one >= length), b"\0")
    return can_id, flags & (_library.FRAME_FD | _library.FRAME_BRS), data


class Host:
    """The programs at one node."""

    def __init__(self, clock: VirtualTime, node: Node):
        self.clock, self.node = clock, node
        self.buses: list[NodeBus] = []
        self.sent: deque[tuple[Any, NodeBus]] = deque()
        self.raw = _library.CFrame()
        self.moves = -1  # of the bus, when it was asked last
        node.listen(own=True, errors=True)

    def join(self, bus: NodeBus) -> None:
        """Lets a program take part. It gets no frame from before."""
        with self.clock._mutex:
            self.pump()
            self.buses.append(bus)

    def forget(self) -> None:
        """Drops all frames: the bus goes back to time 0."""
        self.sent.clear()
        for bus in self.buses:
            bus.inbox.clear()

    def pump(self) -> None:
        """Passes on all that the node has received."""
        while self.pump_one():
            pass

    def pump_one(self) -> bool:
        """Passes on the next frame that the node has received. Returns False without one."""
        bus = self.clock.bus
        if self.moves == bus._library.moves and not bus._inboxes:
            return False  # none can have come
        with self.clock._mutex:  # threads outside come here, too
            library = bus._library
            moves = library.moves
            if bus._inboxes:
                found = bus._take_raw(self.node.number, self.raw)
            else:
                found = library.receive(bus._sim, self.node.number, self.raw)
            if found > 0:
                self._pass_on(*_library.FRAME.unpack_from(self.raw))
                return True
            if found < 0:
                bus._check(found)
            self.moves = moves
            return False

    def _pass_on(self, t_ns: int, can_id: int, flags: int, length: int, _: int,
                 data: bytes) -> None:
        sender, timestamp = None, self.clock.time_at(t_ns)
        if flags & _library.FRAME_OWN:
            flags &= ~_library.FRAME_OWN
            sender = self._sender(_on_the_wire(can_id, flags, length, data))
        for bus in self.buses:
            if bus is sender:
                if bus.own:
                    own = flags | _library.FRAME_OWN
                    bus.inbox.append((can_id, own, length, data, timestamp))
            elif bus.errors or not can_id & ERR_FLAG:
                bus.inbox.append((can_id, flags, length, data, timestamp))

    def send(self, fields: Fields, bus: NodeBus) -> None:
        """Hands a frame to the node."""
        with self.clock._mutex:
            if self.sent:
                self.pump()
            if self.sent:
                status = self.node.status
                if status.queue + status.inbox == 0:
                    self.sent.clear()  # those that were dropped never come back
            _library.FRAME.pack_into(self.raw, 0, 0, *fields)
            self.node._send_raw(self.raw, 0)
            can_id, flags, length, _, data = fields
            self.sent.append((_on_the_wire(can_id, flags, length, data), bus))

    def _sender(self, wire: tuple[Any, ...]) -> NodeBus | None:
        for number, (sent, sender) in enumerate(self.sent):
            if sent == wire:
                del self.sent[number]
                return sender
        return None


def channels(clock: VirtualTime) -> list[str]:
    """Returns the names of all nodes."""
    several = len(clock.bus.buses) > 1
    return [f"{node.bus_name}:{node.name}" if several else node.name for node in clock.bus]


def _find(clock: VirtualTime, channel: Any, name: str | None) -> Node:
    """Returns the node of NODE, BUS:NODE, or BUS and NODE."""
    if channel is None:
        names = ", ".join(channels(clock))
        raise can.CanInitializationError(f"canwire: channel= is the name of a node: {names}")
    try:
        return clock.bus.node(str(channel) if name is None else f"{channel}:{name}")
    except Error as problem:
        raise can.CanInitializationError(f"canwire: {problem}") from None


class NodeBus(can.BusABC):
    """A node of the bus whose virtual time it is.

    :param channel: its name, also BUS:NODE; or the name of the bus, with `node`.
    :param receive_own_messages: own messages are received when the bus has sent them.
    :param ignore_rx_error_frames: error frames are no messages; `state` knows of them all the same.
    """

    def __init__(self, channel: Any = None, can_filters: Any = None,
                 receive_own_messages: bool = False, node: str | None = None,
                 ignore_rx_error_frames: bool = False, **kwargs: Any):
        clock = current()
        if clock is None:
            raise can.CanInitializationError("interface canwire needs canwire.VirtualTime")
        self.clock, self.own, self.errors = clock, receive_own_messages, not ignore_rx_error_frames
        self.inbox: deque[Received] = deque()
        self.channel, self._node = channel, _find(clock, channel, node)
        self._fd = self._node.status.fd
        self.channel_info = f"canwire node {self._node.name}"
        if hasattr(can, "CanProtocol"):  # since python-can 4.3
            self._can_protocol = can.CanProtocol.CAN_FD if self._fd else can.CanProtocol.CAN_20
        super().__init__(channel, can_filters=can_filters, **kwargs)
        if self._node.number not in clock.hosts:
            clock.hosts[self._node.number] = Host(clock, self._node)
        self._host = clock.hosts[self._node.number]
        self._host.join(self)

    def _check_open(self) -> None:
        if getattr(self, "_is_shutdown", False):  # python-can has it since 4.2
            raise can.CanOperationError("the bus is closed")
        if self.clock._over:
            raise can.CanOperationError("the virtual time of the bus is over")

    def _next(self) -> can.Message | None:
        if self.clock._over or getattr(self, "_is_shutdown", False):
            self._check_open()  # it may be closed while a thread waits
        while self.inbox or self._host.pump_one():
            if not self.inbox:
                continue  # it is for another program at the node
            got = self.inbox.popleft()
            message = message_of(*got, self.channel)
            if not self.filters or message.is_error_frame or self._matches_filters(message):
                return message
        return None

    def recv(self, timeout: float | None = None) -> can.Message | None:
        message = None
        if self.inbox or self._host.moves != self.clock.bus._library.moves:
            try:
                with self.clock._mutex:
                    message = self._next()
            except Error as problem:
                raise can.CanOperationError(f"canwire: {problem}") from None
        if message is None:
            return super().recv(timeout)
        self.clock.looked()  # as the one above does
        BUS_LOG.log(self.RECV_LOGGING_LEVEL, "Received: %s", message)
        return message

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        with told:
            return self.clock.wait(self._next, timeout, self._node.number), True

    def _room(self) -> bool:
        self._check_open()
        return self._node.room > 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hands a frame to the node. When its queue is full, this waits; without a time-out it
        fails at once."""
        self._check_open()
        fields = fields_of(msg, self._fd)
        with told:
            if not self._node.room and not self.clock.wait(self._room, timeout or 0,
                                                           self._node.number):
                raise can.CanOperationError(f"the queue of {self._node.name} is full")
            self._host.send(fields, self)

    @property
    def state(self) -> can.BusState:
        """ACTIVE, PASSIVE (error-passive) or ERROR (bus-off). To set it to PASSIVE makes the node
        listen-only, to ACTIVE ends that."""
        self._check_open()
        with told:
            return STATES[self._node.state]

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        self._check_open()
        with told:
            self._node.set(listen_only=new_state is can.BusState.PASSIVE)

    def shutdown(self) -> None:
        super().shutdown()
        self._is_shutdown = True
        if hasattr(self, "_host") and self in self._host.buses:
            self._host.buses.remove(self)
