# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""Virtual time for a whole program: its clocks and time-outs mean time on a bus.

    with canwire.VirtualTime(bus):
        ...  # unmodified code: python-can, can-isotp, udsoncan, canopen

Inside, one thread runs at a time. It runs until it waits: for a lock, an event, a queue, a frame or
a time. Then the next thread that can go on does so. When all of them wait, the bus goes on, up to
the first time-out or the first frame that a thread waits for. So computing takes no time on the
bus, and waiting takes exactly the time that it says. The same program does the same in each run.

For the thread that enters and for threads that are started inside, it takes the place of:

* `time.sleep`, `monotonic`, `perf_counter` and `time`, with their `_ns`
* `threading.Lock`, `RLock` and all that is made of them (Condition, Event, Semaphore, Barrier,
  Timer, Queue), if it is made inside; `queue.SimpleQueue`; `Thread.start`, `join` and `is_alive`
* waiting of asyncio's loops

config/pytest.md says what it cannot do.
"""

import collections
import math
import queue
import selectors
import sys
import threading
import time
import traceback
import types

from ._library import ANY_NODE, AT_FRAME, AT_TIME, NO_NODE
from .bus import Stop

__all__ = ["Deadlock", "VirtualTime", "current"]

NS = 1_000_000_000
FOREVER_NS = 600 * NS  # bus time after which a thread that waits without time-out waits in vain
SPINS = 100             # looks at a clock, or at a queue, after which a thread waits ...
SPIN_NS = 10_000        # ... for this long, so that polling loops end
STEP_NS = NS            # a run of the bus, so that Ctrl-C is not late

# the functions that virtual time takes the place of
_REAL = types.SimpleNamespace(
    sleep=time.sleep, monotonic=time.monotonic, monotonic_ns=time.monotonic_ns,
    perf_counter=time.perf_counter, perf_counter_ns=time.perf_counter_ns,
    time=time.time, time_ns=time.time_ns,
    Lock=threading.Lock, RLock=threading.RLock, get_ident=threading.get_ident,
    start=threading.Thread.start, join=threading.Thread.join, is_alive=threading.Thread.is_alive,
    SimpleQueue=queue.SimpleQueue)
# modules whose waits are for other processes, or that must not be stopped
_SPARED = {"subprocess", "multiprocessing", "_thread", "_queue", "execnet", "xdist", "_pytest",
           "pytest", "pluggy", "hypothesis", "canwire"}

_clock = None  # the VirtualTime that is entered


class Deadlock(RuntimeError):
    """Every thread waits, and nothing on the bus will wake one of them."""


def current():
    """Returns the VirtualTime that the calling thread is in, or None."""
    return _clock if _clock is not None and _clock.mine() is not None else None


class _Thread:
    """A thread in virtual time."""

    def __init__(self, ident, name):
        self.ident, self.name = ident, name
        self.gate = _REAL.Lock()  # it waits here while others run
        self.gate.acquire()       # pylint: disable=consider-using-with
        self.wants = self.value = None
        self.node = None          # it waits for frames of this one
        self.deadline = None      # ns
        self.spins = 0
        self.starts = False  # it starts a thread, and waits for it in real time
        self.failure = None


class VirtualTime:
    """A context in which the time of this program is that of a bus.

    epoch: `time.time()` at time 0 of the bus; by default now. patience: how many seconds of real
    time a thread outside may take to wake one inside, before there is a Deadlock.
    """

    def __init__(self, bus, epoch=None, patience=1.0):
        self.bus = bus
        self._epoch, self._patience = epoch, patience
        self._mutex = _REAL.RLock()  # a finalizer may release a lock meanwhile
        self._threads = {}
        self._reached = 0  # ns
        self._ready, self._sleepers = collections.deque(), {}
        self._running = None
        self.hosts = {}     # of NodeBus
        self._first = None  # the thread that has entered
        self._over = False
        self._patches = []
        self._base = {}

    # ---- what programs use -------------------------------------------------------------------

    @property
    def now(self):
        """The time on the bus, in seconds."""
        return self.now_ns / NS

    @property
    def is_over(self):
        """True when it has been left."""
        return self._over

    @property
    def now_ns(self):
        """... in nanoseconds."""
        return max(self.bus.now_ns, self._reached)

    def receive(self, node, timeout=None):
        """Waits for a frame of a node, by its number."""
        return self.wait(lambda: self.bus._take(node), timeout, node)

    def run_to(self, ns):
        """Waits up to a time of the bus."""
        self.wait(lambda: None, max(ns - self.now_ns, 0) / NS)
        return Stop.TIME

    def sleep(self, seconds):
        """Waits for so long on the bus."""
        if seconds < 0:
            raise ValueError("sleep length must be non-negative")
        if seconds == 0:
            self._let_others_run()
        self.wait(lambda: None, seconds)

    def time_at(self, ns):
        """Returns what `time.time()` is at a time of the bus."""
        return (self._base["time"] + ns) / NS

    def wait(self, wants, timeout=None, node=None):
        """Waits until wants() returns something true, and returns that. When `timeout` seconds are
        over on the bus, it returns what wants() returned last. Any thread calls wants(), when
        others have run, and when `node`, a number, has received a frame."""
        me = self.mine()
        if me is None:
            return self._wait_outside(wants, timeout)
        with self._mutex:
            value = wants()
            if value or (timeout is not None and timeout <= 0):
                if value:
                    return value
                timeout = self._spin(me)
                if timeout is None:
                    return value
            me.wants, me.value, me.node = wants, value, node
            me.deadline = None if timeout is None else self.now_ns + math.ceil(timeout * NS)
            self._sleepers[me.ident] = me
            self._pass_on()
        me.gate.acquire()  # pylint: disable=consider-using-with
        if me.failure is not None:
            failure, me.failure = me.failure, None
            raise failure
        if self._over and not me.value:  # left meanwhile
            return self._wait_outside(wants, timeout)
        return me.value

    # ---- the threads -------------------------------------------------------------------------

    def mine(self):
        """Returns what is known of the calling thread, or None when it is not in virtual time."""
        return self._threads.get(_REAL.get_ident())

    def _wait_outside(self, wants, timeout):
        """Waits in real time: a thread that is outside, or after the end."""
        end = None if timeout is None else _REAL.monotonic() + timeout
        while not (value := wants()):
            if end is not None and _REAL.monotonic() >= end:
                break
            _REAL.sleep(0.001)
        return value

    def _let_others_run(self):
        me = self.mine()
        with self._mutex:
            self._wake()
            if not self._ready:
                return
            self._ready.append(me)
            self._pass_on()
        me.gate.acquire()  # pylint: disable=consider-using-with

    def _spin(self, me):
        """Counts a look that does not wait. Returns a time to wait for, or None."""
        me.spins += 1
        return SPIN_NS / NS if me.spins > SPINS else None

    def looked(self):
        """Is called when a thread has looked at the clock."""
        me = self.mine()
        if me is not None and me is self._running and self._spin(me) is not None:
            self.wait(lambda: None, SPIN_NS / NS)

    def adopt(self, adopted):
        """Takes the calling thread in, which waits for its turn."""
        me = _Thread(_REAL.get_ident(), threading.current_thread().name)
        with self._mutex:
            self._threads[me.ident] = me
            self._ready.append(me)
            adopted.release()
        me.gate.acquire()  # pylint: disable=consider-using-with

    def leave(self):
        """Lets the calling thread go, which ends."""
        with self._mutex:
            me = self._threads.pop(_REAL.get_ident(), None)
            if me is not None and me is self._running:
                self._pass_on()

    def _wake(self):
        """Makes threads ready whose wish is fulfilled, or whose time is over."""
        now = self.now_ns
        for me in list(self._sleepers.values()):
            me.value = me.wants()
            if me.value or (me.deadline is not None and me.deadline <= now):
                del self._sleepers[me.ident]
                self._ready.append(me)

    def _pass_on(self):
        """Lets the next thread run. When all wait, the bus goes on."""
        self._running = None
        self._wake()
        while not self._ready and self._sleepers:
            try:
                self._advance()
            except BaseException as problem:  # pylint: disable=broad-except
                self._fail(problem)
        if self._ready:
            self._running = self._ready.popleft()
            self._running.gate.release()

    def _fail(self, problem):
        """Lets the first thread fail, or all that wait when it does not."""
        first = self._sleepers.get(self._first)
        for me in [first] if first else list(self._sleepers.values()):
            me.failure = problem
            del self._sleepers[me.ident]
            self._ready.append(me)

    def _advance(self):
        deadlines = [me.deadline for me in self._sleepers.values() if me.deadline is not None]
        begin = self.now_ns
        until = min(deadlines, default=begin + FOREVER_NS)
        while not self._ready and self.now_ns < until:
            nodes = {me.node for me in self._sleepers.values() if me.node is not None}
            node = NO_NODE if not nodes else nodes.pop() if len(nodes) == 1 else ANY_NODE
            step = min(until, self.now_ns + STEP_NS)
            stop = self.bus._run(step, None, node)
            if stop == AT_TIME:
                self._reached = step  # the bus itself may be at the end of a bit before
            for me in self._threads.values():
                me.spins = 0
            self._wake()
            if stop == AT_FRAME:
                self.bus._take_all()  # frames that nobody has taken would end the next run, too
        if not self._ready:
            self._wake()
        if not self._ready and not deadlines:
            self._wait_for_others()

    def _wait_for_others(self):
        """Waits for threads outside, such as those that read files."""
        end = _REAL.monotonic() + self._patience
        while not self._ready and _REAL.monotonic() < end:
            self._mutex.release()
            _REAL.sleep(0.005)
            self._mutex.acquire()  # pylint: disable=consider-using-with
            self._wake()
        if not self._ready:
            raise Deadlock("every thread waits, and nothing on the bus will wake one:\n" +
                           "\n".join(map(self._describe, self._sleepers.values())))

    def _describe(self, me):
        frame = sys._current_frames().get(me.ident)
        while frame is not None and frame.f_globals.get("__name__") == __name__:
            frame = frame.f_back
        if frame is None:
            return f"  {me.name}"
        where = traceback.extract_stack(frame, limit=3)
        return f"  {me.name}:\n" + "".join(traceback.format_list(where)).rstrip()

    # ---- entering and leaving ----------------------------------------------------------------

    def __enter__(self):
        global _clock  # pylint: disable=global-statement
        if _clock is not None:
            raise RuntimeError("virtual time is not for two buses at once; put them into a rig")
        offset = self.now_ns
        self._base = {"monotonic": _REAL.monotonic_ns() - offset,
                      "perf_counter": _REAL.perf_counter_ns() - offset,
                      "time": (_REAL.time_ns() - offset if self._epoch is None
                               else round(self._epoch * NS))}
        me = _Thread(_REAL.get_ident(), threading.current_thread().name)
        self._threads[me.ident] = self._running = me
        self._first, self._over = me.ident, False
        _clock = self.bus._clock = self
        self._patch()
        return self

    def __exit__(self, *_):
        global _clock  # pylint: disable=global-statement
        with self._mutex:
            self._unpatch()
            _clock = self.bus._clock = None
            # the others go on in real time
            threads, self._threads = self._threads, {}
            self._running, self._over = None, True
            self._sleepers.clear()
            self._ready.clear()
        for me in threads.values():
            if me.ident != _REAL.get_ident() and me.gate.locked():
                me.gate.release()

    # ---- patches -----------------------------------------------------------------------------

    def _set(self, owner, name, value):
        self._patches.append((owner, name, getattr(owner, name)))
        setattr(owner, name, value)

    def _clocks(self):
        """Returns pairs of a function of `time` and the one in its place."""
        def reads(name, scale):
            real, base = getattr(_REAL, name), self._base[name.removesuffix("_ns")]

            def read():
                if self.mine() is None:
                    return real()
                self.looked()
                now = base + self.now_ns
                return now if scale is None else now / scale
            return real, read

        def sleep(seconds):
            if self.mine() is None:
                return _REAL.sleep(seconds)
            if hasattr(seconds, "__index__"):
                seconds = seconds.__index__()
            return self.sleep(seconds)

        for name in ("monotonic", "perf_counter", "time"):
            yield reads(name, NS)
            yield reads(name + "_ns", None)
        yield _REAL.sleep, sleep

    def _patch(self):
        pairs = [*self._clocks(), (_REAL.Lock, _Lock), (_REAL.RLock, threading._PyRLock),
                 (_REAL.SimpleQueue, queue._PySimpleQueue), *_interfaces()]
        places = {id(real): other for real, other in pairs}
        for name, module in list(sys.modules.items()):
            if isinstance(module, types.ModuleType) and name.split(".")[0] not in _SPARED:
                for key, value in list(vars(module).items()):
                    if id(value) in places:
                        self._set(module, key, places[id(value)])
        self._set(threading, "_allocate_lock", _Lock)
        self._set(threading.Thread, "start", _start)
        self._set(threading.Thread, "join", _join)
        self._set(threading.Thread, "is_alive", _is_alive)
        self._set(selectors.DefaultSelector, "select", _selector(selectors.DefaultSelector.select))

    def _unpatch(self):
        for owner, name, value in reversed(self._patches):
            setattr(owner, name, value)
        self._patches.clear()


# ---- what takes the place of others --------------------------------------------------------------


def _interfaces():
    """Yields python-can's tables of interfaces with "canwire" in them, and without."""
    try:
        from can import interfaces
    except ImportError:
        return
    yield interfaces.BACKENDS, {**interfaces.BACKENDS, "canwire": ("canwire.nodebus", "NodeBus")}
    yield interfaces.VALID_INTERFACES, interfaces.VALID_INTERFACES | {"canwire"}


class _Lock:
    """threading.Lock: a thread in virtual time lets others run, and the bus, while it waits."""

    def __init__(self):
        self._lock = _REAL.Lock()
        self.locked = self._lock.locked

    def acquire(self, blocking=True, timeout=-1):
        if self._lock.acquire(False):
            return True
        if not blocking:
            return False
        clock = current()
        if clock is None or clock.mine().starts:
            return self._lock.acquire(True, timeout)
        return bool(clock.wait(lambda: self._lock.acquire(False), None if timeout < 0 else timeout))

    def release(self):
        self._lock.release()

    def _at_fork_reinit(self):
        self._lock._at_fork_reinit()

    def __enter__(self):
        return self.acquire()

    def __exit__(self, *_):
        self.release()


def _start(thread):
    """Thread.start: the new thread is in virtual time when the one that starts it is."""
    clock = current()
    if clock is None:
        _REAL.start(thread)
        return
    adopted, run = _REAL.Lock(), thread.run
    adopted.acquire()  # pylint: disable=consider-using-with
    thread._canwire_ended = ended = _REAL.Lock()
    ended.acquire()  # pylint: disable=consider-using-with

    def run_in_virtual_time():
        clock.adopt(adopted)
        try:
            run()
        finally:
            ended.release()
            clock.leave()

    thread.run = run_in_virtual_time
    me = clock.mine()
    me.starts = True
    try:
        _REAL.start(thread)
        adopted.acquire()  # pylint: disable=consider-using-with
    finally:
        me.starts = False


def _join(thread, timeout=None):
    clock, ended = current(), getattr(thread, "_canwire_ended", None)
    if clock is None or ended is None:
        _REAL.join(thread, timeout)
    elif clock.wait(lambda: not ended.locked(), timeout):
        _REAL.join(thread)


def _is_alive(thread):
    ended = getattr(thread, "_canwire_ended", None)
    return _REAL.is_alive(thread) and (ended is None or ended.locked())


def _selector(real):
    def wait(self, timeout=None):
        clock = current()
        if clock is None:
            return real(self, timeout)
        return clock.wait(lambda: real(self, 0), timeout) or []

    return wait
