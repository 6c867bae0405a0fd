# SPDX-License-Identifier: MIT
"""No failing call of the C library breaks a canwired or loses anything in silence.

test_calls.py has programs that end by themselves. Here a scenario runs once for each site of calls
of canwired. It has a start, two ECUs, a rule, a setting, a reload, recordings, a journal, a watch
and an end. The call fails once, or with all of its kind from then on. Each request is then done, or
refused and not done at all, or canwired ends with a message and status 1. The counts of frames
balance in any case. They give the frames expected at the ECUs, in the recordings, in the journal
and at a watch. A missing frame is reported by an additional message, by a counter, or by the end of
the connection.
"""

import contextlib
import json
import re
import select
import signal
import socket
import struct
import subprocess
import time

import pytest

from failing import FULL, WORKERS, Calls, Try, build_library, plan, run_all
from simtool import CANWIRE, CANWIRED, kill_all

PATIENCE_S = 60
FRAME = struct.Struct("=IB3x8s")
TRACE = "(0.000000) can0 7F0#01\n(0.001000) can0 7F0#02\n"
BUS = """bus: { name: day, bitrate: 1000000 }
control: day.sock
nodes:
  - { name: engine, port: "unix:engine.sock" }
  - { name: dash, port: "unix:dash.sock" }
  - { name: load, traffic: [ { send: 7E0#01, every: 1ms, count: 3 }, { replay: drive.log } ] }
record: [ { file: day.log }, { file: day.pcapng }, { file: day.vcd, size: 64kB } ]
faults:
  - { name: crc, when: { frame: "100", count: 1 }, do: { flip: "crc[3]", at: [dash] } }
LCM"""
LCM = {
    "file": "lcm: { url: 'file://lcm.events?mode=w', period: 10s, events: [rx, tx] }\n",
    "udpm": "lcm: { url: 'udpm://239.255.76.67:7667?ttl=0', period: 10s, events: [rx, tx] }\n",
    "none": "",
}
RULE = "{ name: mine, when: { manual: yes }, do: { bus-off: load } }"
AFTER = """  - { name: more, when: { manual: yes }, do: { bus-off: load } }
"""
ENGINE_FRAMES = 10
ERROR_FRAME = 0x20000000
LIBEV_GIVES_UP = "libev: pipe_w not active"  # it cannot watch its own pipe, and there is no way out


def frame(identifier, number):
    return FRAME.pack(identifier, 8, struct.pack("<Q", number))


def is_cut(connection):
    """Returns True when the other end is closed."""
    poll = select.poll()
    poll.register(connection, select.POLLRDHUP)
    return bool(poll.poll(0))


@contextlib.contextmanager
def answered(what):
    """Accepts the end of a connection as an answer."""
    try:
        yield
    except TimeoutError:
        raise AssertionError(f"{what}: it does not answer") from None
    except OSError:
        pass


class Run:
    """One canwired from its start to its end, with all observations."""

    def __init__(self, folder, calls, lcm):
        self.folder, self.calls = folder, calls
        for left in folder.iterdir():
            if left.name not in ("calls", "drive.log"):
                left.unlink()
        (folder / "drive.log").write_text(TRACE)
        self.text = BUS.replace("LCM", LCM[lcm])
        (folder / "bus.yaml").write_text(self.text)
        self.ecus, self.sent = {}, 0
        self.received = {"engine": [], "dash": []}
        self.gone = set()  # ECUs whose connection has ended
        self.status, self.watched = None, b""
        self.ended_early, self.cut_off = False, 0
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(folder / "notify"))
            with (folder / "stderr").open("w") as errors:
                self.process = subprocess.Popen(
                    [CANWIRED, "-c", "bus.yaml", "--journal", "day.journal"], cwd=folder,
                    stderr=errors,
                    env=calls.environment(NOTIFY_SOCKET=str(folder / "notify")))
            try:
                self.go_through()
            finally:
                kill_all([self.process])
                for each in self.ecus.values():
                    each.close()
        self.messages = (folder / "stderr").read_text(errors="replace").splitlines()
        self.left = sorted(each.name for each in folder.iterdir()
                           if each.is_socket() and each.name != "notify")

    # ---- Steps

    def has_ended(self):
        return self.process.poll() is not None

    def connect(self, name, kind):
        """Connects to a socket of canwired. Returns None when it has ended, or when the socket will
        not exist."""
        path = self.folder / name
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline and not self.has_ended():
            with contextlib.suppress(FileNotFoundError, ConnectionRefusedError):
                client = socket.socket(socket.AF_UNIX, kind)
                client.settimeout(PATIENCE_S)
                try:
                    client.connect(str(path))
                    return client
                except OSError:
                    client.close()
                    raise
            time.sleep(0.001)
        assert self.has_ended(), f"{name}: nobody listens"
        return None

    def ask(self, request, **more):
        """Returns the reply; None when the connection or canwired ends."""
        client = self.connect("day.sock", socket.SOCK_STREAM)
        if not client:
            return None
        with client, answered(request):
            client.sendall(json.dumps({"request": request, **more}).encode() + b"\n")
            self.wait_for_reply(client)
            line = client.makefile("rb").readline()
            if line.endswith(b"\n"):
                reply = json.loads(line)
                assert reply["ok"] or reply.get("error"), reply
                return reply
        self.cut_off += 1
        return None

    def wait_for_reply(self, client):
        """Waits for a reply. Once canwired has reported that clients have to wait, the calls work
        again."""
        poll = select.poll()
        poll.register(client, select.POLLIN)
        deadline = time.monotonic() + PATIENCE_S
        while not poll.poll(50) and time.monotonic() < deadline:
            if "no connection can be accepted" in (self.folder / "stderr").read_text():
                self.calls.order(False)

    def ask_for(self, what):
        """Returns the reply to a request that changes nothing; asks again when the connection
        ends."""
        for _ in range(5):
            reply = self.ask(what)
            if reply and reply["ok"]:
                return reply[what]
            if self.has_ended():
                return None
        return None

    def settle(self):
        """Waits until nothing is queued any more, and all releases have been made."""
        deadline = time.monotonic() + PATIENCE_S
        while not self.has_ended():
            status = self.ask_for("status")
            if not status:
                return
            self.status = status
            if status["bus"]["pending"] == 0 and status["bus"]["time_ns"] > 5000000:
                return
            assert time.monotonic() < deadline, status
            time.sleep(0.001)

    def send(self, count):
        try:
            for number in range(count):
                self.ecus["engine"].send(frame(0x100, number))
                self.sent += 1
        except OSError:
            self.gone.add("engine")

    def receive(self):
        for name, ecu in self.ecus.items():
            ecu.setblocking(False)
            try:
                while data := ecu.recv(64):
                    if not FRAME.unpack(data)[0] & ERROR_FRAME:
                        self.received[name].append(data)
                self.gone.add(name)
            except BlockingIOError:
                pass
            except OSError:
                self.gone.add(name)

    def change(self, request, **more):
        """Requests a change, which is done or refused, and then not done at all."""
        before = self.names()
        reply = self.ask(request, **more)
        if before is None or self.has_ended():
            return
        self.settle()  # a reload waits for the end of a frame
        after = self.names()
        added = {"inject": {"mine"}, "reload": {"more"}}[request]
        if after is None:
            return
        if reply and reply["ok"]:
            wanted = [(before | added) - ({"mine"} if request == "reload" else set())]
        elif reply:
            wanted = [before]
        else:  # it may have been done, or not
            wanted = [before, (before | added) - ({"mine"} if request == "reload" else set())]
        assert after in wanted, f"{request}: {reply}, there are {after}"

    def names(self):
        faults = self.ask_for("faults")
        return None if faults is None else {rule["name"] for rule in faults}

    def watch_frames(self, watch):
        """Waits until the watch has all events so far, or its end."""
        wanted = self.node("engine")["tx_frames"] if self.status else 0
        with answered("watch"):
            while self.watched.count(b'"frame":"100#') < wanted and b'"lost"' not in self.watched:
                data = watch.recv(1 << 16)
                self.watched += data
                if not data or self.has_ended():
                    return

    def go_through(self):
        watch = self.connect("day.sock", socket.SOCK_STREAM)
        if not watch:
            return
        with watch:
            with contextlib.suppress(OSError):
                watch.sendall(b'{"request":"watch","events":["tx","fault"]}\n')
            for name in ("engine", "dash"):
                self.ecus[name] = self.connect(f"{name}.sock", socket.SOCK_SEQPACKET)
                if not self.ecus[name]:
                    del self.ecus[name]
                    return
            self.settle()
            self.send(ENGINE_FRAMES)
            self.settle()
            self.change("inject", text=RULE)
            self.ask("set", node="dash", settings={"restart-ms": 100})
            (self.folder / "bus.yaml").write_text(self.text.replace("LCM", "").replace(
                "do: { flip: \"crc[3]\", at: [dash] } }\n",
                "do: { flip: \"crc[3]\", at: [dash] } }\n" + AFTER).replace("day.pcapng",
                                                                         "night.pcapng"))
            self.change("reload")
            self.send(ENGINE_FRAMES)
            self.settle()
            self.receive()
            self.watch_frames(watch)
            if is_cut(watch):
                self.gone.add("watch")
            self.ended_early = self.has_ended()
            self.process.send_signal(signal.SIGTERM)
            with answered("end"):
                while data := watch.recv(1 << 16):
                    self.watched += data
        try:
            self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise AssertionError("it does not end") from None

    # ---- What there is in the end

    def frames_in(self, name):
        path = self.folder / name
        return [line.split()[2] for line in path.read_text().splitlines()] if path.exists() else []

    def journal_is_whole(self):
        result = subprocess.run([CANWIRE, "sim", "--journal", "day.journal", "--until", "1s",
                                 "--stats", "-"], cwd=self.folder, capture_output=True,
                                timeout=PATIENCE_S, check=False)
        return result.returncode == 0 and b'"frames"' in result.stdout

    def warnings(self):
        return {re.sub(r"\d+", "#", line) for line in self.messages
                if re.search("^(?!canwired: )|warning: |error: |out of memory", line)}

    def node(self, name):
        return next(node for node in self.status["nodes"] if node["name"] == name)

    def missing(self):
        """Yields missing frames, by the counts of canwired, that no message reports."""
        tx_frames = sum(node["tx_frames"] for node in self.status["nodes"])
        told = {each["file"].rsplit("/")[-1]: each["state"] != "recording" or each["lost"] > 0
                for each in self.status["recordings"]}
        read = self.node("engine")["interface"]["read"]
        if read != self.sent and "engine" not in self.gone:
            yield f"of {self.sent} frames of the ECU {read} were read"
        for name, frames in self.received.items():
            written = self.node(name)["interface"]["written"]
            if len(frames) != written and name not in self.gone:
                yield f"of {written} frames for {name} {len(frames)} have arrived"
        logged = len(self.frames_in("day.log"))
        if logged != tx_frames and not told["day.log"]:
            yield f"of {tx_frames} frames {logged} are in day.log"
        for name, is_told in told.items():
            if not is_told and not (self.folder / name).exists():
                yield f"there is no {name}"
        seen = self.watched.count(b'"frame":"100#')
        if (seen != self.node("engine")["tx_frames"] and b'{"lost"' not in self.watched
                and "watch" not in self.gone):
            yield f"a watch has seen {seen} frames"
        if not self.journal_is_whole():
            yield "the journal is not whole"

    def wrong(self, good, site):
        """Returns a violation, or None, when calls at a site have failed."""
        text = "\n".join(self.messages)
        if site.call == "epoll_ctl" and LIBEV_GIVES_UP in text:
            return None
        if self.process.returncode < 0 or "Sanitizer" in text or "runtime error" in text:
            return f"it crashes: {self.process.returncode}"
        if "unaccounted" in text or not all(node["conserved"] for node in
                                            (self.status or {"nodes": []})["nodes"]):
            return "frames are unaccounted for"
        told = site.group == "tell" or bool(self.warnings() - good.warnings())
        if self.process.returncode != 0:
            return None if told else "no message of its end"
        if self.ended_early:
            return "it ends by itself with status 0"
        if told:
            return None
        if not self.status:
            return "it does not answer"
        if site.call == "timerfd_settime" and self.calls.failed():  # the status has woken the bus
            return "it does not say that it may sleep for too long"
        missing = list(self.missing())
        return "in silence: " + "; ".join(missing) if missing else None


class Place:
    """A folder in which canwired runs repeatedly."""

    def __init__(self, folder, library, lcm):
        folder.mkdir()
        self.folder, self.lcm = folder, lcm
        self.calls = Calls(folder, library)

    def run(self):
        return Run(self.folder, self.calls, self.lcm)

    def attempt(self, each, good):
        self.calls.fail(each)
        try:
            run = self.run()
            wrong = run.wrong(good, each.site)
            rest = f"\n    status {run.process.returncode}, " + " | ".join(run.messages[-5:])
        except AssertionError as error:
            wrong, rest = str(error), "\n    " + (self.folder / "stderr").read_text()[-500:]
        return wrong and f"{wrong}: {each.text(CANWIRED)}{rest}", self.calls.failed() > 0


@pytest.fixture(name="library", scope="module")
def fixture_library():
    return build_library()


@pytest.mark.parametrize("lcm", LCM if FULL else ["file"])
def test_canwired(tmp_path, library, lcm):
    places = [Place(tmp_path / str(i), library, lcm) for i in range(2 * WORKERS)]
    places[0].calls.list_sites()
    good = places[0].run()
    assert good.process.returncode == 0 and not list(good.missing()), good.messages
    assert len(good.frames_in("day.log")) == 2 * ENGINE_FRAMES + 5 and not good.gone
    tries = plan(places[0].calls.sites())
    reached = run_all(places, CANWIRED, tries,
                      lambda place, each: place.attempt(each, good))
    assert reached > len(tries) / 2  # when clients come, and how often, depends on the machine


def test_sockets_at_which_nobody_can_listen_are_removed(tmp_path, library):
    place = Place(tmp_path / "a", library, "file")
    place.calls.list_sites()
    place.run()
    tries = [Try(site, "EADDRINUSE", number + 1) for site in place.calls.sites()
             if site.call == "listen" for number in range(site.count)]
    assert len(tries) == 3, "the control socket and two ports"
    for each in tries:
        place.calls.fail(each)
        run = place.run()
        assert (run.process.returncode, run.left) == (1, []), run.messages
