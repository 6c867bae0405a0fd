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

canwire-pytest(7) says what it cannot do.
"""

import collections
import math
import os
import queue
import selectors
import sys
import threading
import time
import traceback
import types

from ._library import ANY_NODE, AT_FRAME, AT_TIME, NO_NODE
from .bus import Error, Stop

__all__ = ["Deadlock", "VirtualTime", "current"]

NS = 1_000_000_000
FOREVER_S = 600   # of bus time: then a wait without time-out is in vain

SPINS = 100       # looks at a clock, or at a queue, that take no time

SPIN_NS = 10_000  # for each later one, so that polling loops end

CREEPS = 1000     # later looks at a clock, before other threads run

STEP_NS = NS      # a run of the bus, so that Ctrl-C is not late

# the functions that virtual time takes the place of
_REAL = types.SimpleNamespace(
    sleep=time.sleep, monotonic=time.monotonic, monotonic_ns=time.monotonic_ns,
    perf_counter=time.perf_counter, perf_counter_ns=time.perf_counter_ns,
    time=time.time, time_ns=time.time_ns,
    Lock=threading.Lock, RLock=threading.RLock, get_ident=threading.get_ident,
    start=threading.Thread.start, join=threading.Thread.join, is_alive=threading.Thread.is_alive,
    select=selectors.DefaultSelector.select, SimpleQueue=queue.SimpleQueue)
# modules whose waits are for other processes, or that must not be stopped
_SPARED = {"subprocess", "multiprocessing", "_thread", "_queue", "execnet", "xdist", "_pytest",
           "pytest", "pluggy", "hypothesis", "canwire"}

_clock = None  # the VirtualTime that is entered


class Deadlock(RuntimeError):
    """The thread that has entered waits, and nothing will wake it."""


class Over(BaseException):
    """Virtual time has come to its end, for the thread that has entered."""


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
        self.since = 0            # ns: it waits
        self.deadline = None      # ns
        self.waits = 0            # since the first thread waits without a time-out
        self.spins = 0
        self.starts = False  # it starts a thread, and waits for it in real time
        self.failure = None


class VirtualTime:
    """A context in which the time of this program is that of a bus.

    epoch: `time.time()` at time 0 of the bus; by default now. patience: how many seconds of real
    time a thread outside may take to wake one inside, before there is a Deadlock. forever: how many
    seconds of bus time the thread that enters may wait without a time-out.
    """

    def __init__(self, bus, epoch=None, patience=1.0, forever=FOREVER_S):
        self.bus = bus
        self._epoch, self._patience, self._forever_ns = epoch, patience, round(forever * NS)
        self._mutex = _REAL.RLock()  # a finalizer may release a lock meanwhile
        self._threads = {}
        self._reached = 0  # ns of the bus
        self._earlier = 0  # ns before the bus was reset; time of programs never goes back
        self._ready, self._sleepers = collections.deque(), {}
        self._running = None
        self._signals = collections.deque()  # threads that a signal has interrupted
        self.hosts = {}     # of NodeBus, by the numbers of nodes
        self._first = None  # the thread that has entered
        self._over = False
        self._end_ns = 0
        self._ends_threads, self._last_ns = False, None
        self._patches, self._tables = [], []
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

    @property
    def _ns(self):
        """The time of programs, which goes on when the bus is reset."""
        now, reached = self.bus.now_ns, self._reached
        return self._earlier + (now if now > reached else reached)

    def receive(self, node, timeout=None):
        """Waits for a frame of a node, by its number."""
        def wants():
            frame = self.bus._take(node)
            if frame is None and self._over:
                raise Error("the virtual time of the bus is over")
            return frame
        return self.wait(wants, timeout, node)

    def run_to(self, ns, node=None):
        """Waits up to a time of the bus, or to a frame at a node."""
        def wants():
            if node is not None and self.bus._has(node):
                return Stop.FRAME
            return Stop.TIME if self.now_ns >= ns or self._over else None
        timeout = None if self.mine() is None else (ns - self.now_ns) / NS
        stop = self.wait(wants, timeout, node) or Stop.TIME
        if self._over and stop is Stop.TIME:  # left meanwhile
            return Stop(self.bus._run(ns, None, NO_NODE if node is None else node))
        return stop

    def sleep(self, seconds):
        """Waits for so long on the bus."""
        if seconds < 0:
            raise ValueError("sleep length must be non-negative")
        if seconds == 0:
            self._let_others_run()
        self.wait(lambda: None, seconds)

    def time_at(self, ns):
        """Returns what `time.time()` is at a time of the bus."""
        return (self._base["time"] + self._earlier + ns) / NS

    def wait(self, wants, timeout=None, node=None):
        """Waits until wants() returns something true, and returns that. When `timeout` seconds are
        over on the bus, it returns what wants() returned last. Any thread calls wants(), when
        others have run, and when `node`, a number, has received a frame. Its error comes to the
        thread that waits."""
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
            if timeout is not None and self._is_alone(me):
                return self._wait_alone(me, wants, timeout, node)
            self._begin(me, timeout)
            me.wants, me.value, me.node = wants, value, node
            self._sleepers[me.ident] = me
            self._give_way(me)
        self._stand(me)
        if self._over and not me.value:  # left meanwhile
            rest = None if me.deadline is None else (me.deadline - self._end_ns) / NS
            return self._wait_outside(wants, rest)
        return me.value

    def _is_alone(self, me):
        """Returns True for the only thread, when nothing but its time-out ends its waits."""
        return len(self._threads) == 1 and me is self._running and self._last_ns is None and \
            not self._ready and not self._signals

    def _wait_alone(self, me, wants, timeout, node):
        """Does what wait() does, for the only thread. It gives way to nobody."""
        node = NO_NODE if node is None else node
        now = self._ns
        end = now + math.ceil(round(timeout * NS, 3))
        while True:
            stop = self._run_bus(min(end, now + STEP_NS), node)
            me.spins = 0
            value, now = wants(), self._ns
            if value or now >= end:
                return value
            if stop == AT_FRAME:
                self.bus._take_all()  # a frame that nobody has taken would end the next run, too

    def _end_threads(self, last_ns):
        """Lets other threads end when it is left. At `last_ns` of the bus, None: never, the thread
        that has entered gets Over when it waits."""
        self._ends_threads, self._last_ns = True, last_ns

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

    def _begin(self, me, timeout):
        """Notes when a wait begins and ends."""
        me.since, me.deadline = self._ns, None
        me.waits += 1
        if timeout is not None:
            me.deadline = me.since + math.ceil(round(timeout * NS, 3))
        elif me.ident == self._first:
            for other in self._threads.values():
                other.waits = 0

    def _give_way(self, me):
        """Lets the next thread run, unless this one has run beside another after a signal."""
        if self._running in (me, None):
            self._pass_on()

    def _stand(self, me):
        """Waits until it is the turn of this thread."""
        try:
            me.gate.acquire()  # pylint: disable=consider-using-with
        except BaseException as problem:  # pylint: disable=broad-except
            # a signal, which comes to the main thread: it waits for its turn, but not for long
            me.failure = problem
            self._signals.append(me)
            self._interrupt(me)
        if me.failure is not None:
            failure, me.failure = me.failure, None
            raise failure
        if self._over and self._ends_threads:
            raise SystemExit  # the thread ends without a message

    def _interrupt(self, me):
        """Waits for the turn of a thread that a signal has interrupted. When it does not come, or
        with a second signal, it runs beside another thread."""
        turn = False
        try:
            turn = me.gate.acquire(timeout=self._patience)
        except BaseException:
            me.failure = None
            raise
        finally:
            if not turn:
                with self._mutex:
                    self._sleepers.pop(me.ident, None)
                    for queued in (self._ready, self._signals):
                        if me in queued:
                            queued.remove(me)
                    me.gate.acquire(False)  # pylint: disable=consider-using-with

    def _let_others_run(self):
        me = self.mine()
        with self._mutex:
            self._wake()
            if not self._ready:
                return
            self._ready.append(me)
            self._give_way(me)
        self._stand(me)

    def _spin(self, me):
        """Counts a look that does not wait. Returns a time to wait for, or None."""
        me.spins += 1
        return SPIN_NS / NS if me.spins > SPINS else None

    def looked(self):
        """Is called when a thread has looked at the clock. It may hold a lock of real time, for
        which another would wait in vain. So time goes on without others, for many looks."""
        me = self._threads.get(_REAL.get_ident())
        if me is None or me is not self._running:
            return
        me.spins += 1
        if me.spins <= SPINS:
            return
        if me.spins > SPINS + CREEPS:
            self.wait(lambda: None, SPIN_NS / NS)
        else:
            with self._mutex:
                self._run_bus(self._ns + SPIN_NS, NO_NODE)

    def adopt(self, adopted):
        """Takes the calling thread in, which waits for its turn."""
        me = _Thread(_REAL.get_ident(), threading.current_thread().name)
        with self._mutex:
            over = self._over
            if not over:
                self._threads[me.ident] = me
                self._ready.append(me)
            adopted.release()
        if not over:
            self._stand(me)

    def leave(self):
        """Lets the calling thread go, which ends."""
        with self._mutex:
            me = self._threads.pop(_REAL.get_ident(), None)
            if me is not None and me is self._running:
                self._pass_on()

    def _wake(self):
        """Makes threads ready whose wish is fulfilled, or whose time is over."""
        now = self._ns
        while self._signals:
            me = self._signals.popleft()
            if self._sleepers.pop(me.ident, None):
                self._ready.appendleft(me)
        for me in list(self._sleepers.values()):
            try:
                me.value = me.wants()
            except Exception as problem:  # pylint: disable=broad-except
                me.failure = problem
            if me.value or me.failure or (me.deadline is not None and me.deadline <= now):
                del self._sleepers[me.ident]
                self._ready.append(me)

    def _pass_on(self):
        """Lets the next thread run. When all wait, the bus goes on."""
        self._running = None
        while not self._ready:
            try:
                self._wake()
                if self._ready or not self._sleepers:
                    break
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

    def _limit(self):
        """Returns the time up to which the first thread may wait without a time-out, or None while
        others have a time-out that is no polling."""
        first = self._sleepers.get(self._first)
        timed = [me for me in self._sleepers.values() if me.deadline is not None]
        if first is None:
            return None if timed else self._ns + self._forever_ns
        if first.deadline is not None or any(me.waits <= SPINS for me in timed):
            return None
        return first.since + self._forever_ns

    def _advance(self):
        deadlines = [me.deadline for me in self._sleepers.values() if me.deadline is not None]
        limit = self._limit()
        last = None if self._last_ns is None else self._earlier + self._last_ns
        if last is not None and self._ns >= last:
            raise Over
        until = min(ns for ns in [*deadlines, limit, last] if ns is not None)
        while not self._ready and not self._signals and self._ns < until:
            nodes = {me.node for me in self._sleepers.values() if me.node is not None}
            node = NO_NODE if not nodes else nodes.pop() if len(nodes) == 1 else ANY_NODE
            stop = self._run_bus(min(until, self._ns + STEP_NS), node)
            for me in self._threads.values():
                me.spins = 0
            self._wake()
            if stop == AT_FRAME and (node == ANY_NODE or not self._ready):
                self.bus._take_all()  # frames that nobody has taken would end the next run, too
        if not self._ready:
            self._wake()
        if not self._ready and limit is not None and self._ns >= limit:
            self._wait_for_others()

    def _run_bus(self, ns, node):
        """Lets the bus go on up to a time of programs."""
        end = ns - self._earlier
        stop = self.bus._run(end, None, node)
        if stop == AT_TIME:
            self._reached = end  # the bus itself may be at the end of a bit before
        return stop

    def bus_resets(self, before):
        """Is called when the bus has gone back to time 0: the time of programs does not."""
        with self._mutex:
            self._earlier, self._reached = self._earlier + max(before, self._reached), 0
            for host in self.hosts.values():
                host.forget()

    def _wait_for_others(self):
        """Waits for threads outside, such as those that read files."""
        end = _REAL.monotonic() + self._patience
        while not self._ready and not self._signals and _REAL.monotonic() < end:
            self._mutex.release()
            try:
                _REAL.sleep(0.005)
            finally:
                self._mutex.acquire()  # pylint: disable=consider-using-with
            self._wake()
        if not self._ready and not self._signals:
            polls = any(me.deadline is not None for me in self._sleepers.values())
            where = "\n".join(map(self._describe, self._sleepers.values()))
            raise Deadlock(f"every thread waits{', or only polls' if polls else ''}, and nothing "
                           f"on the bus will wake one:\n{where}")

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
        offset = self._ns
        self._base = {"monotonic": _REAL.monotonic_ns() - offset,
                      "perf_counter": _REAL.perf_counter_ns() - offset,
                      "time": (_REAL.time_ns() - offset if self._epoch is None
                               else round(self._epoch * NS))}
        me = _Thread(_REAL.get_ident(), threading.current_thread().name)
        self._threads[me.ident] = self._running = me
        self._first, self._over = me.ident, False
        _clock = self.bus._clock = self
        self.bus._resets.append(self.bus_resets)
        self._patch()
        return self

    def __exit__(self, *_):
        global _clock  # pylint: disable=global-statement
        if self._over:
            return  # in a child of os.fork()
        with self._mutex:
            self._unpatch()
            self._end_ns = self._ns if self.bus.is_open else self._earlier + self._reached
            self._over = True
            self.bus._resets.remove(self.bus_resets)
            _clock = self.bus._clock = None
            # the others go on in real time
            threads, self._threads = self._threads, {}
            self._running = None
            self._sleepers.clear()
            self._ready.clear()
        for me in threads.values():
            if me.ident != _REAL.get_ident() and me.gate.locked():
                me.gate.release()

    # ---- patches -----------------------------------------------------------------------------

    def _set(self, owner, name, value):
        self._patches.append((owner, name, getattr(owner, name), value))
        setattr(owner, name, value)

    def read(self, name):
        """Returns the time of a clock, in nanoseconds."""
        self.looked()
        return self._base[name] + self._ns

    def _patch(self):
        self._tables = list(_interfaces())
        _replace({id(real): (real, other) for real, other in [*_PLACES, *self._tables]})
        self._set(threading, "_allocate_lock", _Lock)
        self._set(threading.Thread, "start", _start)
        self._set(threading.Thread, "join", _join)
        self._set(threading.Thread, "is_alive", _is_alive)
        self._set(selectors.DefaultSelector, "select", _select)

    def _unpatch(self):
        """Puts all back, also in modules that were imported meanwhile."""
        for owner, name, value, other in reversed(self._patches):
            if getattr(owner, name) is other:
                setattr(owner, name, value)
        self._patches.clear()
        _replace({id(other): (other, real) for real, other in [*_PLACES, *self._tables]})


def _replace(places):
    """Puts other objects into the places of some, in all modules."""
    for name, module in list(sys.modules.items()):
        if isinstance(module, types.ModuleType) and name.split(".")[0] not in _SPARED:
            for key, value in list(vars(module).items()):
                if id(value) in places:
                    setattr(module, key, places[id(value)][1])


def _end_in_child():
    """A process that is made by os.fork() has real time, and no other threads."""
    if _clock is not None:
        _clock._threads.clear()
        _clock.__exit__()


os.register_at_fork(after_in_child=_end_in_child)


# ---- what takes the place of others --------------------------------------------------------------
# All of it has real time for a thread that is in no virtual time, so a program may keep it.


def _interfaces():
    """Yields python-can's tables of interfaces with "canwire" in them, when no installation has
    told of it, and without."""
    try:
        from can import interfaces
    except ImportError:
        return
    if "canwire" not in interfaces.BACKENDS:
        yield interfaces.BACKENDS, {**interfaces.BACKENDS,
                                    "canwire": ("canwire.pythoncan", "CanwireBus")}
        yield interfaces.VALID_INTERFACES, interfaces.VALID_INTERFACES | {"canwire"}


def _clock_of(name):
    """Returns a function in place of one of `time`."""
    real, base, whole = getattr(_REAL, name), name.removesuffix("_ns"), name.endswith("_ns")

    def read():
        clock = current()
        if clock is None:
            return real()
        ns = clock.read(base)
        return ns if whole else ns / NS

    read.__name__ = name
    return read


def _sleep(seconds):
    clock = current()
    if clock is None:
        return _REAL.sleep(seconds)
    if hasattr(seconds, "__index__"):
        seconds = seconds.__index__()
    return clock.sleep(seconds)


class _Lock:
    """threading.Lock: a thread in virtual time lets others run, and the bus, while it waits."""

    def __init__(self):
        self._lock = _REAL.Lock()
        self.locked = self._lock.locked

    def acquire(self, blocking=True, timeout=-1):
        if timeout != -1 and (timeout < 0 or not blocking):
            return self._lock.acquire(blocking, timeout)  # it says what is wrong
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


class _RLock(threading._RLock):
    """threading.RLock, made of the lock above."""


class _SimpleQueue(queue._PySimpleQueue):
    """queue.SimpleQueue, made of the locks above."""


def _start(thread):
    """Thread.start: the new thread is in virtual time when the one that starts it is."""
    clock = current()
    if clock is None or thread._started.is_set():
        _REAL.start(thread)  # a thread that was started before is an error
        return
    adopted, run = _REAL.Lock(), thread.run
    adopted.acquire()  # pylint: disable=consider-using-with
    thread._canwire_ended = ended = _REAL.Lock()
    ended.acquire()  # pylint: disable=consider-using-with

    def run_in_virtual_time():
        try:
            clock.adopt(adopted)
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
    if clock is None or ended is None or thread is threading.current_thread():
        _REAL.join(thread, timeout)
    elif clock.wait(lambda: not ended.locked(), timeout):
        _REAL.join(thread)


def _is_alive(thread):
    ended = getattr(thread, "_canwire_ended", None)
    return _REAL.is_alive(thread) and (ended is None or ended.locked())


def _select(selector, timeout=None):
    clock = current()
    if clock is None:
        return _REAL.select(selector, timeout)
    return clock.wait(lambda: _REAL.select(selector, 0), timeout) or []


# pairs of an object, and the one in its place
_PLACES = [*((getattr(_REAL, name), _clock_of(name)) for name in (
    "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "time", "time_ns")),
    (_REAL.sleep, _sleep), (_REAL.Lock, _Lock), (_REAL.RLock, _RLock),
    (_REAL.SimpleQueue, _SimpleQueue)]
