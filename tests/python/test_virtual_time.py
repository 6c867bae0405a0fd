# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""Virtual time for a whole program. All times are times of the bus, so none depends on a load."""

import asyncio
import concurrent.futures
import os
import queue
import signal
import sys
import threading
import time

import can
import pytest

from canwire import Bus, Deadlock, Error, Stop, VirtualTime
from canwire.nodebus import NodeBus
from canwire.virtualtime import _REAL

BUS = "bus: { name: x, bitrate: 500000 }\nnodes: [ { name: engine }, { name: dash } ]"
LOADED = ("bus: { name: x, bitrate: 500000 }\nnodes: [ { name: engine, traffic: "
          "[ { send: 123#01, every: 10ms } ] }, { name: dash } ]")
REAL = time.monotonic, time.sleep, threading.Lock, threading.Thread.start, queue.SimpleQueue


@pytest.fixture(name="clock")
def fixture_clock():
    with VirtualTime(Bus.from_yaml(BUS), epoch=0) as clock:
        yield clock


def test_clocks_are_those_of_the_bus(clock):
    begin = time.monotonic()
    time.sleep(3600)
    assert time.time() == clock.now == 3600 and time.time_ns() == 3600 * 10**9
    assert time.monotonic() - begin == pytest.approx(3600)
    clock.bus.run("3601s")
    assert time.time() == 3601
    with pytest.raises(ValueError):
        time.sleep(-1)


def test_frames_wake_the_thread_that_waits_for_them(clock):
    clock.bus.send("engine", "123#DEADBEEF")
    frame = clock.bus.recv("dash", timeout=1)
    assert str(frame) == "123#DEADBEEF" and frame.t == time.time()
    assert clock.bus.recv("dash", timeout=1) is None
    assert time.time() == pytest.approx(1 + frame.t, abs=1e-9)


def test_threads_run_one_by_one_in_the_order_of_their_times(clock):
    found, inbox = [], queue.Queue()

    def work(name, pause):
        for number in range(3):
            time.sleep(pause)
            inbox.put((name, number, time.time()))

    threads = [threading.Thread(target=work, args=one) for one in (("a", 1), ("b", 0.375))]
    for thread in threads:
        thread.start()
    while True:
        try:
            found.append(inbox.get(timeout=2))
        except queue.Empty:
            break
    assert found == [("b", 0, 0.375), ("b", 1, 0.75), ("a", 0, 1), ("b", 2, 1.125), ("a", 1, 2),
                     ("a", 2, 3)]
    for thread in threads:
        thread.join()
        assert not thread.is_alive()
    assert clock.now == 5


def test_what_is_made_of_locks_keeps_its_time_outs(clock):
    event = threading.Event()
    threading.Timer(100, event.set).start()
    assert not event.wait(50) and event.wait(60) and clock.now == 100
    lock = threading.RLock()
    with lock, lock:
        late = threading.Thread(target=lambda: found.append(lock.acquire(timeout=7)))
        found = []
        late.start()
        late.join()
    assert found == [False] and clock.now == 107
    barrier = threading.Barrier(2, timeout=5)
    with pytest.raises(threading.BrokenBarrierError):
        barrier.wait()
    assert clock.now == 112


def test_executors(clock):
    def work(pause):
        time.sleep(pause)
        return time.time()

    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        assert list(pool.map(work, [3, 1, 2])) == [3, 1, 2]
    assert clock.now == 3


def test_asyncio_waits_on_the_bus(clock):
    async def work(pause):
        await asyncio.sleep(pause)
        return time.time()

    async def main():
        assert await asyncio.gather(work(2), work(1)) == [2, 1]
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(asyncio.Event().wait(), 7)
        loop = asyncio.get_running_loop()
        frame = loop.run_in_executor(None, clock.bus.recv, "dash", 5)
        await asyncio.sleep(1)
        clock.bus.send("engine", "123#DEADBEEF")
        assert (await frame).t == pytest.approx(time.time(), abs=1e-6)
        return time.time()

    assert 10 < asyncio.run(main()) < 10.001  # 2 + 7 + 1 s, and a frame


def test_a_loop_that_polls_comes_to_its_end(clock):
    end = time.monotonic() + 0.001
    while time.monotonic() < end:
        pass
    looks = 0
    while clock.bus.recv("dash", 0) is None and looks < 1000:
        looks += 1
    assert clock.now < 0.02


def test_two_runs_are_the_same():
    def run():
        seen = []
        with VirtualTime(Bus.from_yaml(LOADED), epoch=0) as clock:
            def listen(name):
                for _ in range(20):
                    frame = clock.bus.recv("dash", 0.015)
                    seen.append((name, str(frame), time.time()))
            threads = [threading.Thread(target=listen, args=(name,)) for name in "abc"]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        return seen

    first = run()
    assert len({name for name, frame, _ in first if frame != "None"}) == 3
    assert run() == first == run()


def test_a_wait_that_nothing_ends_is_an_error(clock):
    """The error says where each thread waits."""
    other = threading.Thread(target=threading.Event().wait, name="other", daemon=True)
    other.start()
    with pytest.raises(Deadlock, match="(?s)MainThread:.*nobody_sets.*other:") as caught:
        nobody_sets = threading.Event()
        nobody_sets.wait()
    assert "test_virtual_time.py" in str(caught.value)
    assert clock.now == 600


def test_threads_outside_can_wake_those_inside():
    """They have real time, and what they change is seen when all inside wait."""
    inbox = []

    def outside():
        inbox.append(release.acquire(timeout=60))
        event.set()

    release = threading.Lock()
    release.acquire()  # pylint: disable=consider-using-with
    thread = threading.Thread(target=outside)
    thread.start()
    with VirtualTime(Bus.from_yaml(BUS), patience=60):
        event = threading.Event()
        release.release()
        event.wait()
        assert inbox == [True]
    thread.join()


def test_all_is_as_before_behind_it():
    with VirtualTime(Bus.from_yaml(BUS)) as clock:
        with pytest.raises(RuntimeError, match="two buses"):
            VirtualTime(Bus.from_yaml(BUS)).__enter__()  # pylint: disable=unnecessary-dunder-call
        stop = threading.Event()
        late = threading.Thread(target=stop.wait)
        late.start()
        time.sleep(5)
        assert clock.now == 5
    assert REAL == (time.monotonic, time.sleep, threading.Lock, threading.Thread.start,
                    queue.SimpleQueue)
    assert late.is_alive()  # it waits on, in real time
    stop.set()
    late.join()
    clock.bus.run("6s")
    assert clock.bus.now == 6


def test_a_node_whose_time_is_over_refuses():
    with VirtualTime(Bus.from_yaml(BUS)):
        bus = NodeBus("engine")
    for call in (lambda: bus.recv(0), lambda: bus.send(can.Message()), lambda: bus.state):
        with pytest.raises(can.CanOperationError, match="over"):
            call()
    bus.shutdown()


# ---- Threads that wait in vain, and those that fail ----------------------------------------------


def test_threads_that_only_poll_do_not_keep_a_program_waiting(clock):
    ended = []

    def poll():
        while not ended:
            clock.bus.recv("dash", 1)

    thread = threading.Thread(target=poll)
    thread.start()
    with pytest.raises(Deadlock, match="(?s)waits, or only polls.*MainThread:.*Thread-"):
        threading.Event().wait()
    assert 600 <= clock.now < 602
    ended.append(True)
    thread.join()


def test_a_late_timer_is_no_polling(clock):
    event = threading.Event()
    threading.Timer(10_000, event.set).start()
    assert event.wait() and clock.now == 10_000


def test_forever_may_be_longer():
    with VirtualTime(Bus.from_yaml(BUS), forever=5000) as clock:
        worker = threading.Thread(target=lambda: [time.sleep(1) for _ in range(2000)])
        worker.start()
        worker.join()
        assert clock.now == 2000


def test_looks_at_a_clock_under_a_lock_of_real_time_stop_nobody():
    lock, seen = threading.Lock(), []

    def other():
        with lock:
            seen.append(time.monotonic())

    with VirtualTime(Bus.from_yaml(BUS)) as clock:
        with lock:
            thread = threading.Thread(target=other)
            thread.start()
            for _ in range(1000):
                time.monotonic()
        thread.join()
        assert len(seen) == 1 and 0.008 < clock.now < 0.01


def test_a_loop_at_a_clock_sees_what_other_threads_do(clock):
    seen = []
    threading.Timer(0.001, lambda: seen.append(clock.now)).start()
    end = time.monotonic() + 1
    while not seen and time.monotonic() < end:
        pass
    assert seen and clock.now < 0.1


def test_what_a_wish_raises_comes_to_its_thread(clock):
    found, closed = [], []

    def wants():
        if closed:
            raise OSError("closed")

    def other():
        try:
            clock.wait(wants)
        except OSError as problem:
            found.append(str(problem))

    thread = threading.Thread(target=other)
    thread.start()
    time.sleep(1)
    assert found == []
    closed.append(True)
    time.sleep(1)
    assert found == ["closed"] and clock.now == 2
    thread.join()


def interrupt(got):
    """Sends a signal until the main thread has got it. Python may see one only with the next, when
    it comes at the beginning of a wait."""
    while not got():
        os.kill(os.getpid(), signal.SIGUSR1)
        end = _REAL.monotonic() + 2
        while not got() and _REAL.monotonic() < end:
            _REAL.sleep(0.001)


def test_a_signal_interrupts_a_thread_that_waits(clock):
    class Alarm(Exception):
        pass

    def on_signal(*_):
        raise Alarm

    before = signal.signal(signal.SIGUSR1, on_signal)
    try:
        event, done, begin = threading.Event(), [], time.monotonic()

        def work():
            time.sleep(1)
            interrupt(lambda: clock._signals)
            assert event.wait(5)
            time.sleep(1)
            done.append(time.monotonic() - begin)

        worker = threading.Thread(target=work)
        worker.start()
        with pytest.raises(Alarm):
            threading.Event().wait()
        assert done == []
        event.set()
        worker.join()  # the threads run one by one again
        assert done == [pytest.approx(2)]
    finally:
        signal.signal(signal.SIGUSR1, before)


# ---- Beginning and end ---------------------------------------------------------------------------


def test_a_module_that_was_imported_meanwhile_gets_the_clock_of_the_day(tmp_path, monkeypatch):
    names = ("monotonic", "perf_counter_ns", "time", "sleep")
    (tmp_path / "imported_meanwhile.py").write_text(
        f"from time import {', '.join(names)}\nfrom threading import Lock, RLock, _PyRLock\n"
        "from queue import SimpleQueue\nkept = monotonic\n")
    monkeypatch.syspath_prepend(tmp_path)
    with VirtualTime(Bus.from_yaml(BUS), epoch=0):
        import imported_meanwhile as late
        late.sleep(3)
        assert late.time() == 3 and late.Lock is not REAL[2]
    assert [getattr(late, name) for name in names] == [getattr(time, name) for name in names]
    assert (late.Lock, late.RLock, late.SimpleQueue) == (REAL[2], threading.RLock, REAL[4])
    assert abs(late.kept() - time.monotonic()) < 60 and threading.RLock is not late._PyRLock
    with VirtualTime(Bus.from_yaml(BUS), epoch=0):
        begin = late.kept()
        late.sleep(1000)
        assert late.kept() - begin == pytest.approx(1000) and late.time() == 1000
    del sys.modules["imported_meanwhile"]


def test_time_does_not_go_back_when_the_bus_is_reset():
    with VirtualTime(Bus.from_yaml(LOADED), epoch=0) as clock, NodeBus("dash") as dash:
        woken = []
        sleeper = threading.Thread(target=lambda: [time.sleep(7), woken.append(time.time())])
        sleeper.start()
        time.sleep(5)
        assert dash.recv(0).timestamp < 0.01
        clock.bus.reset()
        assert (clock.now, time.time()) == (0, 5)
        assert dash.recv(0) is None  # no frames wait
        assert dash.recv(1).timestamp == pytest.approx(5.000_13, abs=1e-5)
        assert time.time() < 5.001
        clock.bus.run("1s")
        assert (clock.now, time.time()) == (1, 6)
        sleeper.join()
        assert woken == [7]


def test_waiting_threads_go_on_in_real_time_for_the_rest_of_their_time():
    results = []

    def wait(*arguments):
        try:
            results.append(clock.bus.recv(*arguments))
        except Error as problem:
            results.append(str(problem))

    with VirtualTime(Bus.from_yaml(BUS)) as clock:
        threads = [threading.Thread(target=wait, args=("dash", 0.3 + 1000 * k)) for k in range(2)]
        threads.append(threading.Thread(target=lambda: results.append(end.wait(1000.01))))
        end = threading.Event()
        for thread in threads:
            thread.start()
        time.sleep(1000)
        assert results == [None]
    for thread in threads:
        thread.join()
    assert sorted(map(str, results)) == ["False", "None", "the virtual time of the bus is over"]


def test_a_run_to_a_frame_lets_other_threads_run(clock):
    threading.Timer(1, clock.bus.send, ("engine", "123#")).start()
    assert clock.bus.run("9s", frame_at="dash") is Stop.FRAME
    assert clock.bus.run("9s", frame_at="dash") is Stop.FRAME  # it waits there
    assert 1 < clock.now < 1.001 and clock.bus.recv("dash")
    assert clock.bus.run("9s", frame_at="dash") is Stop.TIME and clock.now == 9


def test_a_second_signal_is_not_held_back():
    """The thread that runs never waits, so the first one is late, and the second at once."""
    class Alarm(Exception):
        pass

    def on_signal(*_):
        alarms.append(len(alarms))
        raise Alarm(str(alarms[-1]))

    before, alarms, stop = signal.signal(signal.SIGUSR1, on_signal), [], []
    try:
        with VirtualTime(Bus.from_yaml(BUS), patience=60) as clock:
            def work():
                for number in (1, 2):
                    interrupt(lambda n=number: len(alarms) == n)
                while not stop:
                    pass

            worker = threading.Thread(target=work)
            worker.start()
            with pytest.raises(Alarm, match="1"):
                threading.Event().wait()
            stop.append(True)
            worker.join()  # no stale error comes
            time.sleep(1)
            assert clock.now == 1
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_a_child_of_fork_has_real_time():
    with VirtualTime(Bus.from_yaml(BUS)) as clock:
        threads = [threading.Thread(target=time.sleep, args=(9,)) for _ in range(2)]
        for thread in threads:
            thread.start()
        child = os.fork()
        if child == 0:
            os._exit(7 if (time.sleep, threading.Lock) == REAL[1:3] and clock.is_over else 1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        for thread in threads:
            thread.join()
        assert clock.now == 9


def test_a_thread_is_started_once(clock):
    thread = threading.Thread(target=time.sleep, args=(1,))
    thread.start()
    with pytest.raises(RuntimeError, match="once"):
        thread.start()
    thread.join()
    assert not thread.is_alive() and clock.now == 1
