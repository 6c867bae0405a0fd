# SPDX-License-Identifier: MIT
"""CAN buses in virtual time, inside of this program.

>>> from canwire import Bus
>>> bus = Bus.from_yaml('''
... bus: { name: powertrain, bitrate: 500000 }
... nodes: [ { name: engine }, { name: dash } ]
... ''')
>>> bus.send("engine", "123#DEADBEEF")
>>> str(bus.recv("dash", timeout="10ms"))
'123#DEADBEEF'
"""

from __future__ import annotations

import ctypes
import json
import os
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import Any, NamedTuple, Union

from . import _library, columns
from .frame import Frame

#: A time of the bus: seconds as a number, or a text with its unit, "10ms" or "100bit".
Time = Union[int, float, str]

STATES = ("error-active", "error-warning", "error-passive", "bus-off", "sleeping")
SLICE_NS = 1_000_000_000  # of bus time between two looks at the signals of Python


class Error(Exception):
    """canwire refuses a call; the text says why."""


class ConfigError(Error):
    """A text in YAML is wrong: a line FILE:LINE:COLUMN: message for each error."""


class ExpectationError(Error, AssertionError):
    """Expectations were not met; `failed` has them as dicts."""

    def __init__(self, failed: list[dict[str, Any]]):
        super().__init__("\n".join(f"{e['name']}: wanted {e['wanted']}, got {e['got']}"
                                   if e["name"] != e["wanted"] else
                                   f"wanted {e['wanted']}, got {e['got']}" for e in failed))
        self.failed = failed


def _closed_error() -> Error:
    return Error("the bus is closed")


class Stop(Enum):
    """Why a run has ended."""

    TIME = _library.AT_TIME  #: the time has come
    FRAME = _library.AT_FRAME  #: a frame waits at a node
    EVENT = _library.AT_EVENT  #: the awaited event has come
    END = _library.AT_END  #: all traffic is done, or there was none for 10 s of bus time


class Ahead(NamedTuple):
    """The next event, see Bus.next_event()."""

    comes: bool  #: an event comes at that time; otherwise none comes before it
    t_ns: int


class NodeStatus(NamedTuple):
    """A node now, and what it has counted since time 0."""

    state: str
    tec: int
    rec: int
    attached: bool
    queue: int
    inbox: int
    tx_frames: int
    rx_frames: int
    dropped: int
    rx_dropped: int
    arbitration_lost: int
    retransmissions: int
    bit_errors: int
    stuff_errors: int
    form_errors: int
    crc_errors: int
    ack_errors: int
    overloads: int
    bus_off: int
    restarts: int
    fd: bool
    listen_only: bool


class BusInfo(NamedTuple):
    """A bus, as its configuration describes it."""

    name: str
    seed: int
    bitrate: int
    dbitrate: int | None
    fd: bool
    nodes: tuple[str, ...]


class Node:
    """A node of a bus; it belongs to a Bus and ends with it."""

    def __init__(self, bus: Bus, number: int, name: str, bus_name: str):
        self._bus = bus
        self.number = number
        self.name = name
        self.bus_name = bus_name

    def __repr__(self) -> str:
        return f"<canwire.Node {self.bus_name}:{self.name} {self.state}>"

    @property
    def status(self) -> NodeStatus:
        """State and counters at this moment."""
        raw = _library.CNode()
        self._bus._check(self._bus._library.get_node(self._bus._sim, self.number,
                                                     ctypes.byref(raw)))
        values = {name: getattr(raw, name) for name in NodeStatus._fields}
        flags = {name: bool(values[name]) for name in ("attached", "fd", "listen_only")}
        return NodeStatus(**{**values, **flags, "state": STATES[raw.state]})

    @property
    def state(self) -> str:
        """error-active, error-warning, error-passive, bus-off or sleeping."""
        return self.status.state

    @property
    def tec(self) -> int:
        """The transmit error counter."""
        return self.status.tec

    @property
    def rec(self) -> int:
        """The receive error counter."""
        return self.status.rec

    @property
    def room(self) -> int:
        """The frames that its queue still takes; 4096 while it drops all: in bus-off before the
        restart, listen-only, off the bus."""
        return self._bus._library.room(self._bus._sim, self.number)

    def send(self, frame: Frame | str, at: Time | None = None) -> None:
        """Hands a frame to the node, now or at a later time. Events show what becomes of it."""
        if isinstance(frame, str):
            frame = Frame.parse(frame)
        if not isinstance(frame, Frame):
            raise TypeError(f"{frame!r} is no frame; expected a canwire.Frame or a text, such as "
                            "123#DEADBEEF")
        self._send_raw(frame._to_c(), 0 if at is None else self._bus._time_ns(at, self.number),
                       frame)

    def _send_raw(self, raw: _library.CFrame, at_ns: int, frame: Frame | None = None) -> None:
        """Hands a frame of the library to the node."""
        bus = self._bus
        status = bus._library.send(bus._sim, self.number, raw, at_ns)
        if status < 0:
            bus._check(status)
        if bus._observer is not None:
            bus._note("send", self.name, frame or Frame._from_c(raw), at_ns)

    def listen(self, frames: bool = True, own: bool = False, errors: bool = False) -> None:
        """Says what is kept for recv(): frames of others, own ones that were sent successfully,
        error frames."""
        what = (frames * _library.LISTEN_RX | own * _library.LISTEN_OWN
                | errors * _library.LISTEN_ERRORS)
        self._bus._check(self._bus._library.listen(self._bus._sim, self.number, what))

    def recv(self, timeout: Time | None = 0) -> Frame | None:
        """Takes the next frame that the node has received. If there is none, time goes on until one
        comes, but no longer than the timeout. Without one (None) it goes on to the end of the
        traffic. Returns None when there is no frame."""
        return self._bus._recv(self.number, timeout)

    def restart(self) -> None:
        """Restarts the node, which is bus-off, as `ip link set can0 type can restart` does."""
        self._bus._check(self._bus._library.restart(self._bus._sim, self.number))
        self._bus._note("restart", self.name)

    def set(self, **settings: Any) -> None:
        """Changes settings, with the keys of a node in the configuration:
        set(listen_only=True, restart_ms=100)."""
        keys = {key.replace("_", "-"): value for key, value in settings.items()}
        self._bus._check(self._bus._library.set(self._bus._sim, self.number,
                                                json.dumps(keys).encode()))
        self._bus._note("set", self.name, keys)

    def detach(self) -> None:
        """Takes the node off the bus, as `ip link set can0 down` does."""
        self._bus._check(self._bus._library.attach(self._bus._sim, self.number, 0))
        self._bus._note("detach", self.name)

    def attach(self) -> None:
        """Puts it on the bus again."""
        self._bus._check(self._bus._library.attach(self._bus._sim, self.number, 1))
        self._bus._note("attach", self.name)


class Bus:
    """A bus, or the buses of a rig, at time 0. Time goes on only in run() and recv().

    `listen` makes all nodes keep what they receive for recv(). `events` says which events are
    kept: "all", "none", or kinds with commas, "error,state,fault". A program that runs many
    scenarios and needs few results is faster and smaller without both.
    """

    _observer: Callable[..., None] | None = None  # sees inputs, to record them
    _clock: Any = None  # the VirtualTime whose threads use the bus
    _handle: int | None = None  # of the library
    _closed = False
    _kept = False  # it is freed by its owner, who reads it once more

    def __init__(self, file: str | os.PathLike[str], *, seed: int | None = None,
                 listen: bool = True, events: str = "all"):
        messages = ctypes.c_void_p()
        self._library = _library.library()
        sim = self._library.load(os.fsencode(file), ctypes.byref(messages))
        self._open(sim, self._library.told(messages), seed, listen, events)

    def _open(self, sim: int | None, told: str, seed: int | None, listen: bool,
              events: str) -> None:
        self._handle = sim
        self._library: Any = _library.Guarded(self._library, _closed_error)
        self._events: list[dict[str, Any]] = []
        self._known_ns, self._known_at = 0, -1  # the time after so many moves of it
        self._inboxes: dict[int, deque[Frame]] = defaultdict(deque)
        self._taking = _library.RLock()  # frames keep their order when several threads take them
        self._resets: list[Callable[[int], None]] = []  # called when time has gone back to 0
        self._runs: list[Callable[[], None]] = []  # called when a program has let time go on
        if not sim:
            raise ConfigError(told)
        self.warnings: list[str] = told.splitlines()
        names = [self._text(self._library.bus_name(sim, bus)) for bus in range(self._buses())]
        self._several = len(names) > 1
        self._nodes: list[Node] = []
        self._by_name: dict[str, Node] = {}
        for number in range(self._library.node_count(sim)):
            bus = names[self._library.bus_of_node(sim, number)]
            node = Node(self, number, self._text(self._library.node_name(sim, number)), bus)
            self._nodes.append(node)
            self._by_name[f"{bus}:{node.name}"] = node
            if self._several and node.name in self._by_name:
                del self._by_name[node.name]  # it is not clear which one is meant
            else:
                self._by_name[node.name] = node
            if listen:
                node.listen()
        self.keep_events(events)
        if seed is not None:
            self.reset(seed)

    @classmethod
    def from_yaml(cls, source: str | os.PathLike[str], *, name: str = "scenario.yaml",
                  seed: int | None = None, listen: bool = True, events: str = "all") -> Bus:
        """Makes a bus from a file, or from the text of one. A str with a line end or a '{' is a
        text. Its name stands in messages. Paths in it are relative to the directory of that
        name."""
        if not isinstance(source, str) or not ("\n" in source or "{" in source):
            return cls(source, seed=seed, listen=listen, events=events)
        self = cls.__new__(cls)
        messages = ctypes.c_void_p()
        self._library = _library.library()
        text = source.encode()
        sim = self._library.load_text(text, len(text), os.fsencode(name), ctypes.byref(messages))
        self._open(sim, self._library.told(messages), seed, listen, events)
        return self

    @classmethod
    def from_dict(cls, config: Mapping[str, Any], **options: Any) -> Bus:
        """Makes a bus from what the YAML would be read as."""
        if not isinstance(config, Mapping):
            raise Error(f"{config!r} is no configuration; expected a dict")
        return cls.from_yaml(json.dumps(config), **options)

    def close(self) -> None:
        """Frees the bus. It cannot be used afterwards."""
        self._closed = True
        if not self._kept and self._handle:
            self._library.release(self._handle)
            self._handle = None

    @property
    def is_open(self) -> bool:
        """False when it has been closed."""
        return not self._closed and bool(self._handle)

    @property
    def _sim(self) -> int:
        if self._closed or not self._handle:
            raise _closed_error()
        return self._handle

    def __del__(self) -> None:
        self._kept = False
        self.close()

    def __reduce__(self) -> Any:
        raise Error("a bus cannot be copied; make another one of its configuration")

    def __enter__(self) -> Bus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _note(self, what: str, *arguments: Any) -> None:
        """Tells an observer of an input."""
        if self._observer is not None:
            self._observer(what, *arguments)

    # ---- names ------------------------------------------------------------------------------

    @staticmethod
    def _text(text: bytes) -> str:
        return text.decode("utf-8", "replace")

    def _buses(self) -> int:
        return self._library.bus_count(self._sim)

    def _check(self, status: int) -> int:
        if status == _library.NO_MEMORY:
            raise MemoryError("libcanwire-sim has no memory")
        if status < 0:
            raise Error(self._text(self._library.message(self._sim)))
        return status

    @property
    def buses(self) -> list[BusInfo]:
        """The buses in the order of the file: one, or those of a rig."""
        found = []
        for number in range(self._buses()):
            raw = _library.CBus()
            self._check(self._library.get_bus(self._sim, number, ctypes.byref(raw)))
            nodes = self._nodes[raw.first_node:raw.first_node + raw.nodes]
            found.append(BusInfo(self._text(self._library.bus_name(self._sim, number)), raw.seed,
                                 raw.bitrate, raw.dbitrate or None, bool(raw.fd),
                                 tuple(node.name for node in nodes)))
        return found

    @property
    def name(self) -> str:
        """The name of the first bus."""
        return self._text(self._library.bus_name(self._sim, 0))

    @property
    def nodes(self) -> list[Node]:
        """The nodes of all buses, in the order of the file."""
        return list(self._nodes)

    def node(self, name: str) -> Node:
        """Returns the node of that name: "engine", or "body:engine" in a rig."""
        try:
            return self._by_name[name]
        except KeyError:
            names = ", ".join(f"{node.bus_name}:{node.name}" if self._several else node.name
                              for node in self._nodes)
            raise Error(f"there is no node {name!r}; there is {names}") from None

    def __getitem__(self, name: str) -> Node:
        return self.node(name)

    def __iter__(self) -> Iterator[Node]:
        return iter(self._nodes)

    def _bus_number(self, bus: str | None) -> int:
        names = [self._text(self._library.bus_name(self._sim, i)) for i in range(self._buses())]
        if bus is None:
            if self._several:
                raise Error(f"a rig has several buses; say which one: {', '.join(names)}")
            return 0
        if bus not in names:
            raise Error(f"there is no bus {bus!r}; there is {', '.join(names)}")
        return names.index(bus)

    # ---- time -------------------------------------------------------------------------------

    def _time_ns(self, time: Time, node: int = 0) -> int:
        if isinstance(time, str):
            bus = max(self._library.bus_of_node(self._sim, node), 0)
            return self._check(self._library.time(self._sim, bus, time.encode()))
        try:
            ns = round(time * 1_000_000_000)
        except (ValueError, OverflowError):  # of "not a number" and infinity
            ns = -1
        if not 0 <= ns < _library.NEVER:
            raise Error(f"{time}: a time is 0 s or more")
        return ns

    @property
    def now_ns(self) -> int:
        """The bus time in nanoseconds."""
        moves = self._library.moves
        if self._known_at != moves or self._closed:
            self._known_ns, self._known_at = self._library.now(self._sim), moves
        return self._known_ns

    @property
    def now(self) -> float:
        """The bus time in seconds."""
        return self.now_ns / 1e9

    def run(self, until: Time | None = None, *, duration: Time | None = None,
            event: str | None = None, frame_at: str | None = None) -> Stop:
        """Lets time go on.

        until: up to this bus time; duration: for so long. Without both the run ends when all
        traffic of the file is done, or after 10 s of bus time without any.
        event: the run ends with this event, as `canwire sim --until-event`: "engine:bus-off",
        "rx:123", "fault:RULE"; or "any" of those that are kept.
        frame_at: it ends when this node has a frame for recv().
        """
        if until is not None and duration is not None:
            raise Error("give until or duration, not both")
        end = _library.NEVER
        if until is not None:
            end = self._time_ns(until)
        elif duration is not None:
            end = self.now_ns + self._time_ns(duration)
        node = _library.NO_NODE if frame_at is None else self.node(frame_at).number
        if self._clock is not None and event is None and end != _library.NEVER:
            return self._clock.run_to(end, None if frame_at is None else node)
        if frame_at is not None and self._has(node):
            return Stop.FRAME
        return Stop(self._run_by_hand(end, event, node))

    def next_event(self, kinds: str = "all", until: Time | None = None) -> Ahead:
        """Looks for the next event of kinds that are kept, when nothing is handed in. Nothing
        happens by it.

        Returns Ahead(True, t_ns) with its time. Ahead(False, t_ns) says that none comes before that
        time. This is `until`, or 10 s from now. It is earlier when the traffic of the file or a
        gateway may hand in a frame then. Look again when time has come there.
        """
        end = _library.NEVER if until is None else self._time_ns(until)
        at = ctypes.c_int64()
        comes = self._check(self._library.next_event(self._sim, kinds.encode(), end,
                                                     ctypes.byref(at)))
        return Ahead(bool(comes), at.value)

    def _run_by_hand(self, end: int, event: str | None, node: int) -> int:
        """Lets time go on for a program, and tells those that have a clock of their own."""
        stop = self._run(end, event, node)
        for follow in self._runs:
            follow()
        return stop

    def _run(self, end: int, event: str | None, node: int) -> int:
        text = event.encode() if event is not None else None
        while True:
            part = end
            if end != _library.NEVER:
                part = min(end, self.now_ns + SLICE_NS)
            stop = self._check(self._library.run(self._sim, part, text, node))
            if stop != _library.AT_TIME or part == end:
                return stop

    def reset(self, seed: int | None = None) -> None:
        """Goes back to time 0: rules and settings are those of the file again, and no frames wait.
        seed: the seed from now on, else that of the file."""
        before = self.now_ns
        self._events.clear()
        with self._taking:
            self._inboxes.clear()
        value = None if seed is None else ctypes.byref(ctypes.c_uint64(seed))
        self._check(self._library.reset(self._sim, value))
        for follow in self._resets:
            follow(before)
        self._note("reset")

    # ---- frames -----------------------------------------------------------------------------

    def send(self, node: str, frame: Frame | str, at: Time | None = None) -> None:
        """Hands a frame to a node, see Node.send()."""
        self.node(node).send(frame, at)

    def recv(self, node: str, timeout: Time | None = 0) -> Frame | None:
        """Takes the next frame of a node, see Node.recv()."""
        return self.node(node).recv(timeout)

    def _take_all(self) -> None:
        """Takes the frames of all nodes, for _take()."""
        with self._taking:
            for node in self._nodes:
                while (frame := self._take_new(node.number)) is not None:
                    self._inboxes[node.number].append(frame)

    def _take(self, number: int) -> Frame | None:
        with self._taking:
            inbox = self._inboxes.get(number) if self._inboxes else None
            return inbox.popleft() if inbox else self._take_new(number)

    def _has(self, number: int) -> bool:
        """Returns True when a node has a frame for _take()."""
        return bool(self._inboxes.get(number)) or \
            self._check(self._library.run(self._sim, 0, None, number)) == _library.AT_FRAME

    def _take_new(self, number: int) -> Frame | None:
        raw = _library.CFrame()
        if self._check(self._library.receive(self._sim, number, raw)) == 0:
            return None
        return Frame._from_c(raw)

    def _take_raw(self, number: int, raw: _library.CFrame) -> bool:
        """Does what _take() does, without making a Frame. Returns False when there is none."""
        if self._inboxes and (frame := self._take(number)):
            ctypes.memmove(ctypes.byref(raw), ctypes.byref(frame._to_c()), ctypes.sizeof(raw))
            raw.flags |= _library.FRAME_OWN if frame.own else 0
            raw.t = frame.t_ns
            return True
        return self._check(self._library.receive(self._sim, number, raw)) != 0

    def _recv(self, number: int, timeout: Time | None) -> Frame | None:
        if self._clock is not None:
            wait = None if timeout is None else self._time_ns(timeout, number) / 1e9
            return self._clock.receive(number, wait)
        found = self._take(number)
        if found or timeout == 0:
            return found
        end = _library.NEVER
        if timeout is not None:
            end = self.now_ns + self._time_ns(timeout, number)
        self._run_by_hand(end, None, number)
        return self._take(number)

    # ---- faults -----------------------------------------------------------------------------

    def inject(self, rule: str | Mapping[str, Any] | list[Any] | None = None, *,
               bus: str | None = None, **keys: Any) -> list[str]:
        """Adds fault rules, as `canwire inject` does: YAML, what it would be read as, or the keys
        of one rule: inject(name="x", when={"frame": "123"}, do={"flip": "crc[3]"}). All of them
        are added, or none. Returns warnings."""
        if (rule is None) == (not keys):
            raise Error("give a rule, or its keys")
        text = rule if isinstance(rule, str) else json.dumps(keys if rule is None else rule)
        warnings = self._tell(self._library.inject, text, bus, "rule")
        self._note("inject", text)
        return warnings

    def _tell(self, function: Any, text: str, bus: str | None, name: str) -> list[str]:
        messages = ctypes.c_void_p()
        raw = text.encode()
        status = function(self._sim, self._bus_number(bus), raw, len(raw), name.encode(),
                          ctypes.byref(messages))
        told = self._library.told(messages)
        if status == _library.INVALID and told:
            raise ConfigError(told)
        self._check(status)
        return told.splitlines()

    def clear(self, rule: str | None = None, *, bus: str | None = None) -> None:
        """Removes a rule; without a name all that were injected."""
        self._check(self._library.clear(self._sim, self._bus_number(bus),
                                        None if rule is None else rule.encode()))
        self._note("clear", rule)

    def fire(self, rule: str, *, bus: str | None = None) -> None:
        """Fires a rule with `manual: yes`."""
        self._check(self._library.fire(self._sim, self._bus_number(bus), rule.encode()))
        self._note("fire", rule)

    def rules(self, bus: str | None = None) -> list[str]:
        """Returns the names of the rules of a bus."""
        number = self._bus_number(bus)
        raw = _library.CBus()
        self._check(self._library.get_bus(self._sim, number, ctypes.byref(raw)))
        names = (self._library.rule_name(self._sim, number, i) for i in range(raw.rules))
        return [self._text(name) for name in names if name]

    # ---- results ----------------------------------------------------------------------------

    def keep_events(self, kinds: str) -> None:
        """Says which events are kept from now on, see Bus."""
        self._check(self._library.keep_events(self._sim, kinds.encode()))
        self._note("keep_events", kinds)

    def take_lines(self) -> str:
        """Takes the new events as `canwire sim --events` writes them. Those that are taken as text
        are not in events()."""
        return self._library.text(self._library.take_events(self._sim, None))

    def take_columns(self, *names: str) -> columns.Columns:
        """Takes the new events as columns of numbers, all or the named ones. It is for many events,
        and much faster than events(), which does not have those any more."""
        for name in names:
            if name not in _library.COLUMNS:
                raise Error(f"there is no column {name!r}; there is {', '.join(_library.COLUMNS)}")
        infos = self.buses
        taken, found = columns.take(
            self._library, self._sim, names or tuple(_library.COLUMNS),
            64 if any(info.fd for info in infos) else 8, [node.name for node in self._nodes],
            [info.name for info in infos])
        self._check(taken)
        return found

    def new_events(self) -> list[dict[str, Any]]:
        """Returns the events since the last call of new_events() or events()."""
        lines = self.take_lines()
        new = json.loads(f"[{','.join(lines.splitlines())}]")
        self._events += new
        return new

    def events(self, event: str | None = None, node: str | None = None) -> list[dict[str, Any]]:
        """Returns all events since time 0, as dicts with the keys of `canwire sim --events`; or
        those of one kind, or of one node. For many of them see take_columns()."""
        self.new_events()
        return [e for e in self._events if (event is None or e["event"] == event)
                and (node is None or e.get("node") == node)]

    def stats(self, bus: str | None = None) -> dict[str, Any]:
        """Returns the statistics, as `canwire sim --stats` writes them: of a bus, or of a whole
        rig."""
        number = -1 if bus is None and self._several else self._bus_number(bus)
        return json.loads(self._library.text(self._library.stats(self._sim, number)))

    def expect(self, expectation: str | Mapping[str, Any] | list[Any] | None = None, *,
               bus: str | None = None, **keys: Any) -> list[str]:
        """Adds expectations, as under `expect` in a file: YAML, what it would be read as, or the
        keys of one: expect(delivered=3, frame="123", to=["dash"]). They judge what comes from now
        on; see check(). Returns warnings."""
        if (expectation is None) == (not keys):
            raise Error("give an expectation, or its keys")
        text = (expectation if isinstance(expectation, str)
                else json.dumps({key.rstrip("_").replace("_", "-"): value
                                 for key, value in keys.items()}
                                if expectation is None else expectation))
        return self._tell(self._library.expect, text, bus, "expectation")

    def expectations(self) -> list[dict[str, Any]]:
        """Returns the expectations, those of the file first, as dicts with `bus`, `name`, `wanted`,
        `got` and `met` up to now."""
        return json.loads(self._library.text(self._library.expectations(self._sim)))

    def lost(self) -> list[dict[str, Any]]:
        """Returns the losses up to now, as `canwire sim` tells them at its end. They are frames
        that were dropped or never sent, and rules of the file that never matched. Each is a dict
        with `bus`, `node` or `rule`, and `why`; `frames`, `ids` and `help` where there are any."""
        return json.loads(self._library.text(self._library.lost(self._sim)))

    def check(self) -> None:
        """Raises an ExpectationError with all expectations that are not met."""
        failed = [outcome for outcome in self.expectations() if not outcome["met"]]
        if failed:
            raise ExpectationError(failed)
