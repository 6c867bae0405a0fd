# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""A bus of python-can at a node, in virtual time.

    with canwire.VirtualTime(bus):
        with can.Bus(interface="canwire", channel="tester") as tester: ...

or NodeBus("tester"). Several of them at one node see each other's frames when the bus has sent
them, as programs at one interface do.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import can

from .frame import Frame
from .virtualtime import VirtualTime, current

STATES = {"error-active": can.BusState.ACTIVE, "error-warning": can.BusState.ACTIVE,
          "error-passive": can.BusState.PASSIVE}


class Host:
    """The programs at one node."""

    def __init__(self, clock: VirtualTime, name: str):
        self.clock, self.node = clock, clock.bus.node(name)
        self.buses: list[NodeBus] = []
        self.sent: deque[tuple[Frame, NodeBus]] = deque()
        self.node.listen(own=True, errors=True)

    def pump(self) -> None:
        """Passes on what the node has received."""
        while (frame := self.clock.bus._take(self.node.number)) is not None:
            sender = self._sender(frame) if frame.own else None
            for bus in self.buses:
                if bus is not sender or bus.own:
                    bus.inbox.append((frame, bus is sender))

    def _sender(self, frame: Frame) -> NodeBus | None:
        for number, (sent, sender) in enumerate(self.sent):
            if str(sent) == str(frame):
                del self.sent[number]
                return sender
        return None


def to_message(frame: Frame, clock: VirtualTime, channel: str, own: bool) -> can.Message:
    return can.Message(timestamp=clock.time_at(frame.t_ns), arbitration_id=frame.id,
                       is_extended_id=frame.extended, is_remote_frame=frame.remote,
                       is_error_frame=frame.error, is_fd=frame.fd, bitrate_switch=frame.brs,
                       error_state_indicator=frame.esi, data=frame.data, is_rx=not own,
                       dlc=frame.dlc if frame.remote else len(frame.data), channel=channel)


def to_frame(message: can.Message) -> Frame:
    return Frame(message.arbitration_id, bytes(message.data or b""), message.is_extended_id,
                 message.is_remote_frame, message.is_fd, message.bitrate_switch,
                 message.error_state_indicator, message.dlc if message.is_remote_frame else None)


class NodeBus(can.BusABC):
    """A node of the bus whose virtual time it is. channel: its name."""

    def __init__(self, channel: Any, can_filters: Any = None, receive_own_messages: bool = False,
                 fd: bool = False, **kwargs: Any):
        clock = current()
        if clock is None:
            raise can.CanInitializationError("interface canwire needs canwire.VirtualTime")
        self.clock, self.own, self.inbox = clock, receive_own_messages, deque()
        hosts = clock.hosts
        if channel not in hosts:
            hosts[channel] = Host(clock, channel)
        self._host = hosts[channel]
        self._host.buses.append(self)
        self.channel_info = f"canwire node {channel}"
        if hasattr(can, "CanProtocol"):  # since python-can 4.3
            self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        self.channel = channel
        super().__init__(channel, can_filters=can_filters, **kwargs)

    def _check_open(self) -> None:
        if getattr(self, "_is_shutdown", False):  # python-can has it since 4.2
            raise can.CanOperationError("the bus is closed")
        if self.clock.is_over:
            raise can.CanOperationError("the virtual time of the bus is over")

    def _next(self) -> tuple[Frame, bool] | None:
        self._host.pump()
        return self.inbox.popleft() if self.inbox else None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._check_open()
        found = self.clock.wait(self._next, timeout, self._host.node.number)
        if not found:
            return None, False
        return to_message(found[0], self.clock, self.channel, found[1]), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hands a frame to the node. When its queue is full, this waits; without a time-out it
        fails at once."""
        self._check_open()
        node = self._host.node
        if not node.room and not self.clock.wait(lambda: node.room, timeout or 0, node.number):
            raise can.CanOperationError(f"the queue of {node.name} is full")
        frame = to_frame(msg)
        self._host.sent.append((frame, self))
        node.send(frame)

    @property
    def state(self) -> can.BusState:
        self._check_open()
        return STATES.get(self._host.node.state, can.BusState.ERROR)

    def shutdown(self) -> None:
        super().shutdown()
        self._is_shutdown = True
        if self in self._host.buses:
            self._host.buses.remove(self)
