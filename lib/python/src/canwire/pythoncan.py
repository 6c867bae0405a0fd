# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""The interface `canwire` of python-can.

    can.Bus(interface="canwire", channel="powertrain", node="engine")

is a node of the running bus `powertrain`, when there is one. Else the channel is a bus inside of
this process, in real time, and each can.Bus on it is a node of its own. It has arbitration, bit
timing and errors, which the interface `virtual` lacks.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import pathlib
import random
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import can
from can.broadcastmanager import (LimitedDurationCyclicSendTaskABC, ModifiableCyclicTaskABC,
                                  RestartableCyclicTaskABC)

from . import _library
from .bus import Bus, Error
from .frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, Frame
from .nodebus import (BUS_LOG, STATES, Fields, NodeBus, channels, fields_of, message_of, to_frame,
                      to_message, told)
from .virtualtime import current

LOG = logging.getLogger("can.canwire")
RUN_FOLDER = "/run/canwire"  # without CANWIRE_RUN
QUEUE = 512  # frames of a node in a bus of this process
GUESTS = 62
#: A node that acknowledges, so that a single program can send, as it can on `virtual`.
LISTENER = "listener"
SLICE_NS = 1_000_000  # of bus time in virtual time, before other threads may have the bus
LONGEST_NS = 1000 * SLICE_NS
PATIENCE_NS = 2_000_000_000  # of bus time in virtual time, for room in a queue


def _refuse(problem: object) -> can.CanInitializationError:
    return can.CanInitializationError(f"canwire: {problem}")


# ---- Buses in this process -----------------------------------------------------------------------


class Wire:
    """A bus in this process, and the nodes of it that are in use.

    In real time it is where the clock is, whenever somebody looks at it. So it needs no thread.
    """

    all: dict[Any, Wire] = {}
    lock = threading.RLock()  # of this table

    def __init__(self, key: Any, bus: Bus, virtual: bool, config: Any = None):
        self.key, self.bus, self.virtual, self.config = key, bus, virtual, config
        self.changed = threading.Condition(threading.RLock())
        self.end_turn = self.changed.release
        self.asking: list[None] = []  # an entry for each thread that waits for the lock
        self.waiting = 0  # threads that wait for a change
        self.start_ns = self.epoch = 0  # monotonic time, and that of programs, at time 0 of the bus
        self.start_clock()
        self.listen_only = [node.status.listen_only for node in bus]
        self.used: set[int] = set()
        self.coming = 0  # programs that have the bus, but no node yet
        self.leaving: set[int] = set()
        self.tasks: list[VirtualTask] = []
        bus._resets.append(self.begin_again)
        bus._runs.append(self.follow)

    @classmethod
    def open(cls, key: Any, make: Callable[[], Bus], virtual: bool, config: Any = None) -> Wire:
        """Returns the bus of a channel; makes it for its first user."""
        with cls.lock:
            if key not in cls.all:
                cls.all[key] = cls(key, make(), virtual, config)
            wire = cls.all[key]
            if wire.virtual != virtual:
                time_of = "virtual" if wire.virtual else "real"
                raise _refuse(f"channel {key!r} is in use in {time_of} time")
            if config is not None and config != wire.config:
                raise _refuse(f"channel {key!r} is in use with another configuration")
            wire.coming += 1
            return wire

    def take_turn(self) -> None:
        """Gets the bus alone. A thread that lets time go on sees that others want it."""
        if self.changed.acquire(False):
            return
        self.asking.append(None)
        try:
            self.changed.acquire()
        finally:
            self.asking.pop()

    @contextlib.contextmanager
    def turn(self) -> Iterator[None]:
        """Has the bus alone."""
        self.take_turn()
        try:
            yield
        finally:
            self.end_turn()

    def wait_for_change(self, seconds: float | None = None) -> None:
        """Lets others have the bus until one of them has done something."""
        self.waiting += 1
        try:
            self.changed.wait(seconds)
        finally:
            self.waiting -= 1

    def let_others(self) -> bool:
        """Lets other threads have the bus, if any wants it."""
        if not self.asking:
            return False
        self.changed.release()
        try:
            for _ in range(20):
                if not self.asking:
                    break
                time.sleep(50e-6)
        finally:
            self.changed.acquire()
        return True

    def begin_again(self, before: int) -> None:
        """Is called when the bus has gone back to time 0."""
        with self.turn():
            for task in self.tasks:
                task.shift(-before)
            self.start_clock()
            self.leaving.clear()
            for number in self.used:
                self.bus.nodes[number].attach()

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
        with self.turn():
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
            self.wait_for_change(rest / 1e9)
        self.advance()

    def give_back(self, number: int) -> None:
        """Takes a node off the bus when its last frame has gone; the last user ends the bus."""
        with self.lock, self.turn():
            self.used.discard(number)
            self.tasks = [task for task in self.tasks if task.number != number]
            node = self.bus.nodes[number]
            node.listen(False)
            if node.status.listen_only != self.listen_only[number]:
                node.set(listen_only=self.listen_only[number])
            if node.name.startswith("guest-"):
                self.leaving.add(number)
                self.see_off()
            self.changed.notify_all()
            self.end_unused()

    def see_off(self) -> None:
        """Takes nodes off the bus whose program has gone, and which have nothing to send. Frames
        in bus-off are lost, but not those since the request to restart."""
        for number in [*self.leaving]:
            node = self.bus.nodes[number]
            if node.status.queue + node.status.inbox == 0 or node.room == _library.TAKES_NONE:
                self.leaving.discard(number)
                node.detach()

    # ---- time -------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Returns the time of the programs, as time of the bus."""
        return self.bus.now_ns if self.virtual else time.monotonic_ns() - self.start_ns

    def run_to(self, end_ns: int, number: int = _library.NO_NODE) -> None:
        """Lets time go on, with the periodic frames up to there."""
        while True:
            due = min((task.next_ns for task in self.tasks), default=_library.NEVER)
            stop = self.bus._run(min(end_ns, due), None, number)
            self.see_off()
            if stop == _library.AT_FRAME or due >= end_ns:
                return
            for task in [task for task in self.tasks if task.next_ns == due]:
                task.release()

    def start_clock(self) -> None:
        """Notes the time of programs at time 0 of a bus in real time."""
        if not self.virtual:
            self.start_ns, self.epoch = time.monotonic_ns(), time.time()

    def follow(self) -> None:
        """Lets the clock of a bus in real time follow when somebody has run it by hand."""
        ahead = 0 if self.virtual else self.bus.now_ns - self.now_ns()
        if ahead > 0:
            self.start_ns -= ahead
            self.epoch -= ahead / 1e9

    def advance(self) -> None:
        """Brings a bus in real time to now."""
        if not self.virtual:
            self.run_to(self.now_ns())

    def wait(self, seconds: float | None, due_ns: int) -> None:
        """Waits in real time until a frame may come, or somebody does something."""
        ahead = max(due_ns - self.now_ns(), 0) / 1e9
        if ahead < 1000:
            seconds = ahead if seconds is None else min(seconds, ahead)
        self.wait_for_change(seconds if seconds is None else max(seconds, 20e-6))

    # ---- frames -----------------------------------------------------------------------------

    def check_used(self, number: int) -> None:
        if number not in self.used:
            raise can.CanOperationError("canwire: the bus is closed")

    def wait_for_room(self, number: int, timeout: float | None) -> None:
        node = self.bus.nodes[number]
        longest = PATIENCE_NS if self.virtual else _library.NEVER // 2
        end = self.now_ns() + (longest if timeout is None else round(timeout * 1e9))
        while not node.room:
            rest = end - self.now_ns()
            if rest <= 0:
                raise can.CanOperationError("canwire: the queue of the node is full")
            if self.virtual:
                self.run_to(self.bus.now_ns + min(rest, 100_000))
                self.let_others()
            else:
                self.wait(min(rest / 1e9, 3600), self.bus._library.next(self.bus._sim))
                self.advance()
            self.check_used(number)


def node_is_for_programs(name: str) -> bool:
    return name.rpartition(":")[2] != LISTENER


class VirtualTask(LimitedDurationCyclicSendTaskABC, ModifiableCyclicTaskABC,
                  RestartableCyclicTaskABC):
    """Periodic frames in virtual time."""

    def __init__(self, end: Inside, messages: Sequence[can.Message], period: float,
                 duration: float | None, autostart: bool,
                 modifier: Callable[[can.Message], None] | None):
        super().__init__(messages, period, duration)
        self.step_ns = round(period * 1e9)
        if self.step_ns <= 0:
            raise ValueError(f"a period of {period} s: it must be longer than 0")
        self.wire, self.number, self.end, self.modifier = end.wire, end.number, end, modifier
        self.next_ns = self.end_ns = self.index = 0
        if autostart:
            self.start()

    def start(self) -> None:
        with self.wire.turn():
            self.wire.check_used(self.number)
            if self not in self.wire.tasks:
                self.index, self.next_ns = 0, self.wire.bus.now_ns
                self.end_ns = (self.next_ns + round(self.duration * 1e9) if self.duration
                               else _library.NEVER)  # as other interfaces do with 0
                self.wire.tasks.append(self)
                self.wire.changed.notify_all()

    def stop(self) -> None:
        with self.wire.turn():
            if self in self.wire.tasks:
                self.wire.tasks.remove(self)

    def shift(self, ns: int) -> None:
        """Moves its times."""
        self.next_ns += ns
        self.end_ns += ns if self.end_ns != _library.NEVER else 0

    def release(self) -> None:
        """Sends the present message, at its time. An error ends the task and is logged, as with
        other interfaces; it is not one of the thread that lets time go on."""
        if self.next_ns >= self.end_ns:
            self.stop()
            return
        message = self.messages[self.index]
        self.index = (self.index + 1) % len(self.messages)
        self.next_ns += self.step_ns
        try:
            if self.modifier is not None:
                self.modifier(message)
            self.end.put(message)
        except Exception:  # pylint: disable=broad-except
            LOG.exception("canwire: a periodic frame")
            self.stop()


class Inside:
    """A node of a bus in this process."""

    def __init__(self, channel: Any, key: Any, name: str | None, make: Callable[[], Bus],
                 virtual: bool, own: bool, errors: bool, config: Any):
        self.channel = channel
        self.wire = Wire.open(key, make, virtual, config)
        try:
            self.number = self.wire.take_node(name)
        finally:
            with Wire.lock:
                self.wire.coming -= 1
                self.wire.end_unused()
        self.node = self.wire.bus.nodes[self.number]
        with self.wire.turn():
            while self.wire.bus._take(self.number):
                pass  # of an earlier user
            self.node.listen(True, own, errors)
        self.sent, self.waited = _library.CFrame(), _library.CWaited()  # used in turns
        self.fd = self.node.status.fd
        self.text = f"node {self.node.name} of {self.node.bus_name}, in this process"

    def now(self) -> float:
        return self.wire.now_ns() / 1e9

    # ---- frames -----------------------------------------------------------------------------

    def receive(self, timeout: float | None) -> can.Message | None:
        wire = self.wire
        wire.take_turn()
        try:
            return self.receive_virtually(timeout) if wire.virtual else self.receive_now(timeout)
        except Error as problem:
            raise can.CanOperationError(f"canwire: {problem}") from None
        finally:
            wire.end_turn()

    def go_on(self, until_ns: int, span_ns: int) -> can.Message | None:
        """Takes the next message. Without one, time goes on until there is one, up to a time and
        for so long at most; `waited` then has the times."""
        wire, bus, number = self.wire, self.wire.bus, self.number
        if number not in wire.used:
            wire.check_used(number)
        if bus._inboxes and (frame := bus._take(number)):  # of a canwire.VirtualTime
            return to_message(frame, wire.epoch + frame.t, self.channel, frame.own)
        found = bus._library.wait(bus._sim, number, until_ns, span_ns, self.waited)
        if wire.leaving:
            wire.see_off()
        if found <= 0:
            bus._check(found)
            return None
        _, _, t_ns, can_id, flags, length, _, data = _library.WAITED.unpack_from(self.waited)
        return message_of(can_id, flags, length, data, wire.epoch + t_ns / 1e9, self.channel)

    def receive_now(self, timeout: float | None) -> can.Message | None:
        """Takes the next message in real time, and waits for one."""
        wire, end, rest = self.wire, None, None
        while (message := self.go_on(time.monotonic_ns() - wire.start_ns, _library.NEVER)) is None:
            if timeout is not None:
                now = time.monotonic()
                end = now + timeout if end is None else end
                rest = end - now
                if rest <= 0:
                    break
            wire.wait(rest, self.waited.next)
        return message

    def receive_virtually(self, timeout: float | None) -> can.Message | None:
        """Lets time go on to the next message."""
        wire, part, rest = self.wire, SLICE_NS, 0
        if timeout is not None:
            rest = max(round(timeout * 1e9), 0)
            if not wire.tasks:  # their frames would come in between
                message = self.go_on(_library.NEVER, min(rest, part))
                if message is not None or rest <= part:
                    return message
                wire.let_others()
                rest -= part
        begin = wire.bus.now_ns
        end = _library.NEVER if timeout is None else begin + rest
        while True:
            now = wire.bus.now_ns
            end -= max(begin - now, 0)  # the bus was reset
            begin = now
            message = self.go_on(0, 0)
            if message is not None or now >= end:
                return message
            if timeout is None and self.waited.next == _library.NEVER and not wire.tasks:
                wire.wait_for_change()  # by another thread
                continue
            wire.run_to(min(end, now + part), self.number)
            if not wire.bus._has(self.number):
                part = SLICE_NS if wire.let_others() else min(2 * part, LONGEST_NS)

    def send(self, message: can.Message, timeout: float | None) -> None:
        """Hands a message in; waits for room in the queue."""
        wire, fields = self.wire, fields_of(message, self.fd)
        wire.take_turn()
        try:
            if self.number not in wire.used:
                wire.check_used(self.number)
            while not self.offer(fields):
                wire.wait_for_room(self.number, timeout)
            if wire.waiting:
                wire.changed.notify_all()
        except Error as problem:
            raise can.CanOperationError(f"canwire: {problem}") from None
        finally:
            wire.end_turn()

    def offer(self, fields: Fields) -> bool:
        """Hands a frame in where there is room for it."""
        wire, bus = self.wire, self.wire.bus
        at_ns = 0 if wire.virtual else time.monotonic_ns() - wire.start_ns
        _library.FRAME.pack_into(self.sent, 0, 0, *fields)
        taken = bus._library.offer(bus._sim, self.number, self.sent, at_ns)
        if wire.leaving:
            wire.see_off()
        if taken <= 0:
            return bus._check(taken) != 0
        if bus._observer is not None:
            bus._note("send", self.node.name, Frame._from_c(self.sent), at_ns)
        return True

    def put(self, message: can.Message) -> None:
        """Hands a message in now, whatever becomes of it."""
        self.node.send(to_frame(message, self.fd))

    # ---- state ------------------------------------------------------------------------------

    def state(self) -> can.BusState:
        with told, self.wire.turn():
            self.wire.advance()
            return STATES[self.node.state]

    def set_state(self, state: can.BusState) -> None:
        with told, self.wire.turn():
            self.wire.advance()
            self.node.set(listen_only=state is can.BusState.PASSIVE)

    def close(self) -> None:
        if self.wire.bus.is_open:
            self.wire.give_back(self.number)


# ---- Running buses -------------------------------------------------------------------------------

HEAD = struct.Struct("=BBHIIIQQ")  # type, flags, size, number, lost, reserved, realtime, bus time
HELLO_BODY = struct.Struct("=8sIIII36s")  # magic, version, options, error mask, MTU, name
CLASSICAL, FD_BODY = struct.Struct("=IB2xB8s"), struct.Struct("=IBB2x64s")
FILTER = struct.Struct("=II")
MOST_FILTERS = 512
HELLO, FRAME, OPTIONS, FILTERS, DROPPED, ERROR = range(1, 7)
LOCAL, OWN = 1, 2
LOOPBACK, RECV_OWN, FD = 1, 2, 4
FDF, BRS, ESI = 4, 1, 2
PATIENCE_S = 30
START_PATIENCE_S = 2.0  # for a bus that is just starting, as `canwire --wait`
PAUSE_S = 0.01  # between two looks for it


def starting(look: Callable[[], Any]) -> Any:
    """Returns the result of look(), which may have none before a bus has started."""
    end = time.monotonic() + START_PATIENCE_S
    while not (result := look()) and time.monotonic() < end:
        time.sleep(PAUSE_S)
    return result


def connect(to_bus: socket.socket, path: str) -> None:
    """Connects to a bus, which may be just starting."""
    def try_it() -> bool:
        try:
            to_bus.connect(path)
        except (FileNotFoundError, ConnectionRefusedError):
            return False
        return True

    if not starting(try_it):
        to_bus.connect(path)  # raises the reason


def ask(path: str, request: dict[str, Any]) -> dict[str, Any]:
    """Sends a request to the control socket of a bus."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as control:
            control.settimeout(PATIENCE_S)
            connect(control, path)
            control.sendall(json.dumps(request).encode() + b"\n")
            reply = json.loads(control.makefile("rb").readline())
    except (OSError, ValueError) as problem:
        raise can.CanOperationError(f"canwire: {path}: {problem}") from None
    if not reply.get("ok"):
        raise can.CanOperationError(f"canwire: {reply.get('error', 'the bus refuses')}")
    return reply


def state_of(path: str, name: str) -> can.BusState:
    """Returns the state of a node of a running bus."""
    for node in ask(path, {"request": "status"})["status"]["nodes"]:
        if node["name"] == name:
            return STATES[node["state"]]
    raise can.CanOperationError(f"canwire: {path} has no node {name!r} any more")


def ready(fd: int, what: int, seconds: float | None) -> bool:
    """Waits until a socket is ready; its number may be any."""
    poll = select.poll()
    poll.register(fd, what)
    if seconds is None:
        return bool(poll.poll())
    return bool(poll.poll(min(math.ceil(max(seconds, 0) * 1000), 1_000_000_000)))


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


def run_folder() -> str:
    """Returns the folder of the control sockets, as the tool finds it."""
    return os.environ.get("CANWIRE_RUN") or RUN_FOLDER


def find_running(channel: Any) -> str | None:
    """Returns the control socket of the running bus that a channel names, or None."""
    if not isinstance(channel, str) or not channel:
        return None
    path = channel if is_socket_path(channel) else f"{run_folder()}/{channel}.sock"
    try:
        return path if pathlib.Path(path).is_socket() else None
    except OSError:
        return None


def must_run(where: Any, node: str | None, private: bool | None, config: Any,
             virtual_time: bool) -> bool:
    """Returns True for a channel that can be no bus in this process."""
    if isinstance(where, str) and where.startswith("unix:"):
        return False
    if private is False:
        return True
    if private or config is not None or is_configuration(where):
        return False
    if is_socket_path(where):
        return True
    return (node not in (None, LISTENER) and not str(node).startswith("guest-")
            and isinstance(where, str) and where not in Wire.all
            and not virtual_time)  # a new bus in this process has no such node


class Outside:
    """A client of the port of a node; canwire-ports(7) describes the protocol."""

    def __init__(self, channel: Any, path: str, own: bool, errors: bool, control: str | None,
                 node: str | None):
        self.channel, self.errors, self.control, self.node = channel, errors, control, node
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.known = can.BusState.ACTIVE  # of a bus whose control socket is not known
        self.sending = threading.Lock()
        try:
            self.socket.settimeout(PATIENCE_S)
            self.socket.bind("")  # an address makes it a client
            connect(self.socket, path)
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
        self.closed = False
        self.text = f"node {node or path} of a running bus"

    def write(self, kind: int, body: bytes, more: int = 0) -> None:
        self.socket.send(HEAD.pack(kind, 0, HEAD.size + len(body), 0, 0, 0, 0, 0) + body, more)

    def read(self, more: int = 0) -> tuple[int, int, bytes, int]:
        packed = self.socket.recv(8192, more)
        if not packed:
            raise can.CanOperationError("canwire: the bus is closed" if self.closed else
                                        "canwire: the bus has ended the connection")
        kind, flags, _, _, _, _, realtime_ns, _ = HEAD.unpack_from(packed)
        return kind, flags, packed[HEAD.size:], realtime_ns

    @staticmethod
    def now() -> float:
        return time.monotonic()

    def receive(self, timeout: float | None) -> can.Message | None:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            rest = None if end is None else max(end - time.monotonic(), 0)
            try:
                if not ready(self.socket.fileno(), select.POLLIN, rest):
                    return None
                kind, flags, body, realtime_ns = self.read(socket.MSG_DONTWAIT)
            except BlockingIOError:
                continue  # another thread was first
            except (OSError, ValueError) as problem:
                raise can.CanOperationError(f"canwire: {problem}") from None
            message = self.unpack(flags, body, realtime_ns / 1e9) if kind == FRAME else None
            if kind == ERROR:
                LOG.warning("canwire: %s", body[4:].rstrip(bytes(1)).decode("utf-8", "replace"))
            if message is not None and (self.errors or not message.is_error_frame):
                return message

    def unpack(self, flags: int, body: bytes, timestamp: float) -> can.Message:
        own = _library.FRAME_OWN if flags & (LOCAL | OWN) else 0
        if len(body) == FD_BODY.size:
            can_id, length, bits, data = FD_BODY.unpack(body)
            own |= (_library.FRAME_FD | (_library.FRAME_BRS if bits & BRS else 0)
                    | (_library.FRAME_ESI if bits & ESI else 0))
        else:
            can_id, length, _, data = CLASSICAL.unpack(body)
        if can_id & ERR_FLAG:
            self.note(can_id, data)
        return message_of(can_id, own, length, data, timestamp, self.channel)

    def note(self, error: int, data: bytes) -> None:
        """Learns the state of the node from an error frame (linux/can/error.h)."""
        if error & 0x40:
            self.known = can.BusState.ERROR
        elif error & 0x100:
            self.known = can.BusState.ACTIVE
        elif error & 0x4 and data[1] & 0x30:
            self.known = can.BusState.PASSIVE
        elif error & 0x4 and data[1] & 0x4C:
            self.known = can.BusState.ACTIVE

    def send(self, message: can.Message, timeout: float | None) -> None:
        can_id, flags, length, _, data = fields_of(message, self.fd)
        if flags & _library.FRAME_FD:
            bits = (FDF | (BRS if flags & _library.FRAME_BRS else 0)
                    | (ESI if flags & _library.FRAME_ESI else 0))
            body = FD_BODY.pack(can_id, length, bits, data)
        else:
            body = CLASSICAL.pack(can_id, length, 0, data)
        end = None if timeout is None else time.monotonic() + timeout
        if not self.sending.acquire(timeout=-1 if timeout is None else max(timeout, 0)):
            raise can.CanOperationError("canwire: the queue of the node is full")
        try:
            self.send_body(body, end)
        except (OSError, ValueError) as problem:
            raise can.CanOperationError(f"canwire: {problem}") from None
        finally:
            self.sending.release()

    def send_body(self, body: bytes, end: float | None) -> None:
        while True:
            rest = None if end is None else max(end - time.monotonic(), 0)
            if not ready(self.socket.fileno(), select.POLLOUT, rest):
                raise can.CanOperationError("canwire: the queue of the node is full")
            with contextlib.suppress(BlockingIOError):
                self.write(FRAME, body, socket.MSG_DONTWAIT)
                return

    def filter(self, filters: Sequence[dict[str, Any]] | None) -> None:
        """Lets the port filter, which is faster. The interface does it all the same."""
        if not filters or len(filters) > MOST_FILTERS:
            filters = [{"can_id": 0, "can_mask": 0}]
        pairs = []
        for one in filters:
            can_id, mask = one["can_id"] & 0x1FFFFFFF, one["can_mask"] & 0x1FFFFFFF
            if "extended" in one:
                mask |= EFF_FLAG
                can_id |= EFF_FLAG if one["extended"] else 0
            pairs.append(FILTER.pack(can_id, mask))
        with self.sending:
            try:
                self.write(FILTERS, b"".join(pairs))
            except OSError as problem:
                raise can.CanOperationError(f"canwire: {problem}") from None

    def state(self) -> can.BusState:
        if self.control and self.node:
            return state_of(self.control, self.node)
        return self.known

    def set_state(self, state: can.BusState) -> None:
        if not self.control or not self.node:
            raise NotImplementedError("the state can be set where the channel is that of a bus")
        ask(self.control, {"request": "set", "node": self.node, "settings":
                           {"listen-only": state is can.BusState.PASSIVE}})

    def close(self) -> None:
        self.closed = True
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)  # wakes those that read
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
    except (Error, OSError, TypeError, ValueError) as problem:
        raise _refuse(problem) from None


def is_node_of_virtual_time(channel: Any = "channel-0", *_: Any, private: bool | None = None,
                            config: Any = None, virtual_time: bool = False, **__: Any) -> bool:
    """Returns True for a bus that is opened in virtual time and says nothing else."""
    if current() is None or private is not None or config is not None or virtual_time:
        return False
    return not isinstance(channel, str) or not (
        "/" in channel or channel.startswith("unix:") or channel.endswith((".yaml", ".yml")))


class CanwireBus(can.BusABC):
    """A node of a bus of canwire.

    In canwire.VirtualTime a channel is a node of the bus whose time it is, see NodeBus.

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

    def __new__(cls, *arguments: Any, **options: Any) -> Any:
        if cls is CanwireBus and is_node_of_virtual_time(*arguments, **options):
            return NodeBus(*arguments, **options)
        return super().__new__(cls)

    def __init__(self, channel: Any = "channel-0", *, node: str | None = None, config: Any = None,
                 private: bool | None = None, virtual_time: bool = False,
                 receive_own_messages: bool = False, ignore_rx_error_frames: bool = False,
                 bitrate: int = 500_000, data_bitrate: int | None = None, can_filters: Any = None,
                 **kwargs: Any):
        self.channel = channel
        self._virtual = virtual_time
        where, node = split(channel, node)
        for key, rate in ("bitrate", bitrate), ("data_bitrate", data_bitrate):
            if not isinstance(rate, (int, type(None))):
                raise _refuse(f"{key} {rate!r} is no number of bit/s, such as 500000")
        own, errors = receive_own_messages, not ignore_rx_error_frames
        running = None if config is not None or private or virtual_time else find_running(where)
        if not running and must_run(where, node, private, config, virtual_time):
            running = starting(lambda: find_running(where))
        if isinstance(config, os.PathLike):
            config = os.fspath(config)
        if isinstance(where, str) and where.startswith("unix:"):
            self._end: Inside | Outside = Outside(channel, where[len("unix:"):], own, errors,
                                                  None, None)
        elif running:
            self._end = self._attach(channel, running, node, own, errors)
        elif must_run(where, node, private, config, virtual_time):
            place = "" if is_socket_path(where) else f" in {run_folder()}"
            raise _refuse(f"there is no running bus {where!r}{place}")
        else:
            data_rate = data_bitrate or max(bitrate, min(4 * bitrate, 2_000_000))
            self._end = self._inside(channel, where, node, virtual_time, own, errors, config,
                                     lambda: make(where, config, bitrate, data_rate))
        self.channel_info = f"canwire: {self._end.text}"
        if hasattr(can, "CanProtocol"):  # since python-can 4.3
            self._can_protocol = can.CanProtocol.CAN_FD if self._end.fd else can.CanProtocol.CAN_20
        try:
            super().__init__(channel=channel, can_filters=can_filters, **kwargs)
        except BaseException:  # wrong filters, for example
            self._end.close()
            raise

    @staticmethod
    def _inside(channel: Any, where: Any, node: str | None, virtual: bool, own: bool, errors: bool,
                config: Any, make_bus: Callable[[], Bus]) -> Inside:
        try:
            return Inside(channel, where, node, make_bus, virtual, own, errors, config)
        except (Error, TypeError) as problem:  # a channel that cannot be a key
            raise _refuse(problem) from None

    @staticmethod
    def _attach(channel: Any, control: str, node: str | None, own: bool,
                errors: bool) -> Outside:
        try:
            ports = ports_of(control)
        except can.CanOperationError as problem:
            raise can.CanInitializationError(str(problem)) from None
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
        message, matches = self._recv_internal(timeout)
        if self._virtual or message is None:
            return message  # the clock of python-can does not know the time of the bus
        if not matches and not self._matches_filters(message):  # of a class derived from this one
            return super().recv(timeout)
        BUS_LOG.log(self.RECV_LOGGING_LEVEL, "Received: %s", message)
        return message

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Returns the next message that the filters let pass. Error frames always do, as they do
        with `socketcan`."""
        self._check_open()
        if not self.filters:
            return self._end.receive(timeout), True
        end = None if timeout is None else self._end.now() + timeout
        while True:
            message = self._end.receive(timeout)
            if message is None or message.is_error_frame or self._matches_filters(message):
                return message, True
            timeout = None if end is None else max(end - self._end.now(), 0)

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
        return VirtualTask(self._end, msgs, period, duration,  # type: ignore[arg-type]
                           autostart, more[-1] if more else None)

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
        this process, and one more. In virtual time they are the nodes of its bus."""
        clock = current()
        if clock is not None:
            return [{"interface": "canwire", "channel": name} for name in channels(clock)]
        found = []
        for path in sorted(pathlib.Path(run_folder()).glob("*.sock")):
            try:
                found += [{"interface": "canwire", "channel": f"{path.stem}:{node}"}
                          for node in ports_of(str(path))]
            except (KeyError, TypeError, can.CanError):
                continue  # it is no control socket, or nobody answers
        with Wire.lock:
            used = [*Wire.all]
        while (extra := f"channel-{random.randint(0, 9999)}") in used:
            pass
        return [*found, *({"interface": "canwire", "channel": key} for key in [*used, extra])]
