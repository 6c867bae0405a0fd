# SPDX-License-Identifier: MIT
"""The objects of a soak: interfaces, a canwired with sanitizers, ECUs and clients at its socket."""

import collections
import contextlib
import json
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/kernel"), str(ROOT / "tests/support")]

from canbits import CLASSIC, ERROR, EXTENDED, FD, REMOTE, Frame  # noqa: E402
from compiled import compiled  # noqa: E402
from conftest import MULTICAST_ROUTE, ip  # noqa: E402
from schedule import INTERFACES, PORTS, UNIX, base_config  # noqa: E402

PATIENCE_S = 60  # until canwired counts as hanging; not a measure of speed
KEPT = 12  # clients, readers: then the oldest goes
SMALL_BUFFER = 4096  # of readers that do not read
CAN_RAW_ERR_FILTER = 2  # not in every Python
SANITIZERS = {
    # ASan keeps freed memory to find uses of it, but only a little, so that the memory in use is
    # visible. heap.c comes before the runtime.
    "ASAN_OPTIONS": "detect_leaks=1:quarantine_size_mb=4:thread_local_quarantine_size_kb=64"
                    ":verify_asan_link_order=0",
    "UBSAN_OPTIONS": "print_stacktrace=1",
}
ECU_ENDS = {name: name for name in INTERFACES} | {"vx0": "vx0e"}


class Trouble(Exception):
    """A violation."""


class Client:
    """Requests at the control socket, and their replies."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(str(path))
        self.lines = self.socket.makefile("rb")

    def ask(self, request, **keys):
        self.socket.sendall(json.dumps({"request": request} | keys).encode() + b"\n")
        line = self.lines.readline()
        if not line:
            raise ConnectionResetError("canwired has closed the connection")
        return json.loads(line)

    def close(self):
        self.lines.close()
        self.socket.close()


def drain(s, size=65536):
    """Reads what is there; False when the other end has gone."""
    try:
        while s.recv(size, socket.MSG_DONTWAIT):
            pass
        return False
    except BlockingIOError:
        return True
    except OSError:
        return False


class Rig:
    def __init__(self, program):
        self.folder = Path(tempfile.mkdtemp(prefix="soak-", dir="/run"))
        self.config = self.folder / "bus.yaml"
        self.errors = self.folder / "stderr"
        self.links = dict.fromkeys(INTERFACES, "up")
        self.writers, self.readers, self.clients = {}, [], []
        self.body = None
        self.routed = True
        self.outcomes = collections.Counter()
        self.real_offset_ns = time.time_ns() - time.monotonic_ns()
        for name in INTERFACES:
            self.create(name)
        self.write_config(base_config())
        self.heap_file = self.folder / "heap"
        environment = dict(os.environ, **SANITIZERS, LD_PRELOAD=str(compiled("heap.so")),
                           HEAP=str(self.heap_file))
        with self.errors.open("w") as errors:
            self.process = subprocess.Popen([program, "-c", self.config], stderr=errors,
                                            env=environment)
        self.client = None

    def connect(self):
        """Opens the connection that always exists, as soon as there is a socket."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                self.client = Client(self.folder / "soak.sock")
                return
            except OSError:
                self.check_alive()
                if time.monotonic() > deadline:
                    raise Trouble("canwired does not listen") from None
                time.sleep(0.05)

    def write_config(self, config):
        """Writes the configuration in one step, as an editor does: canwired may read the file at
        any time."""
        new = self.folder / "new.yaml"
        new.write_bytes(config if isinstance(config, bytes) else json.dumps(config).encode())
        new.rename(self.config)

    def ask(self, request, **keys):
        """Sends a request of the client that always exists; also counts refusals."""
        try:
            reply = self.client.ask(request, **keys)
        except (OSError, ValueError) as e:
            self.check_alive()
            raise Trouble(f"no reply to {request}: {e}") from e
        self.outcomes["accepted" if reply["ok"] else "refused"] += 1
        return reply

    def check_alive(self):
        if self.process.poll() is not None:
            raise Trouble(f"canwired has ended with status {self.process.returncode}")

    def keep(self, where, s):
        where.append(s)
        while len(where) > KEPT:
            where.pop(0).close()

    def pump(self):
        """Reads for the clients that read."""
        for where in (self.readers, self.clients):
            where[:] = [s for s in where if not s.reads or drain(s) or s.close()]

    # ---- Interfaces and machine ------------------------------------------------------------------

    @staticmethod
    def create(name):
        kind = f"vxcan peer name {ECU_ENDS[name]}" if name != ECU_ENDS[name] else "vcan"
        ip(f"link add {name} type {kind}", *(f"link set {end} up" for end in Rig.ends(name)))

    @staticmethod
    def ends(name):
        return sorted({name, ECU_ENDS[name]})

    def set_mtu(self, name, mtu):
        for end in self.ends(name):
            ip(f"link set {end} down", f"link set {end} mtu {mtu}", f"link set {end} up")

    def link(self, interface, way):
        """Changes an interface. A calm period in between may have brought it back already."""
        if way.startswith("back") and self.links[interface] == "up":
            return
        away = f"{interface}away"
        if way == "down":
            ip(f"link set {interface} down")
        elif way == "deleted":
            ip(f"link del {interface}")
        elif way == "renamed":
            ip(f"link set {interface} down", f"link set {interface} name {away}",
               f"link set {away} up")
        elif way == "mtu":
            self.set_mtu(interface, 72)
        elif way == "flap":
            ip(f"link set {interface} down", f"link set {interface} up")
        elif way == "anew":
            ip(f"link del {interface}")
            self.create(interface)
        elif way == "peer-down":
            ip(f"link set {ECU_ENDS[interface]} down")
        elif way == "back-from-deleted":
            self.create(interface)
        elif way == "back-from-renamed":
            ip(f"link set {away} down", f"link set {away} name {interface}",
               f"link set {interface} up")
        elif way == "back-from-mtu":
            self.set_mtu(interface, 16)
        else:
            ip(*(f"link set {end} up" for end in self.ends(interface)))
        self.links[interface] = "up" if way.startswith("back") or way in ("flap", "anew") else way

    def stop(self, seconds):
        """Stops the process for a while, as swapping or a debugger would."""
        self.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)  # no wait: at least so long
        self.process.send_signal(signal.SIGCONT)

    def clock(self, seconds):
        """Sets the clock of the guest; that of the host must not change."""
        if os.environ.get("CANWIRE_PLACE") == "qemu":
            time.clock_settime_ns(time.CLOCK_REALTIME, time.time_ns() + seconds * 10**9)

    def route(self, there):
        if there == self.routed:
            return
        ip(f"route {'add' if there else 'del'} {MULTICAST_ROUTE}")
        self.routed = there

    # ---- ECUs ------------------------------------------------------------------------------------

    def writer(self, port):
        """Returns the sending program; starts it anew when the interface was away."""
        if port not in self.writers:
            self.writers[port] = self.open_port(port)
        return self.writers[port]

    def open_port(self, port):
        if port == UNIX:
            s = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            s.setblocking(False)
            s.connect(str(self.folder / UNIX.removeprefix("unix:")))
            return s
        s = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
        s.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        s.bind((ECU_ENDS[port],))
        return s

    def write(self, port, messages):
        """Writes as many messages as possible; counts refusals of the kernel."""
        for message in messages:
            try:
                self.writer(port).send(message)
                self.outcomes["frames written"] += 1
            except BlockingIOError:
                self.outcomes["frames that would block"] += 1
                return
            except OSError:
                self.outcomes["frames not written"] += 1
                if s := self.writers.pop(port, None):
                    s.close()
                return

    def burst(self, port, count, seed):
        r = random.Random(seed)
        self.write(port, [random_frame(r).pack() for _ in range(count)])

    def garbage_frames(self, port, count, seed):
        r = random.Random(seed)
        self.write(port, [random_garbage(r, port == UNIX) for _ in range(count)])

    def reader(self, interface, reads):
        try:
            s = Kept(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW, reads)
            s.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
            if not reads:
                s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER)
            s.bind((ECU_ENDS[interface],))
            self.keep(self.readers, s)
        except OSError:
            self.outcomes["readers without interface"] += 1

    def unix_ecu(self, does):
        if does == "vanish" and UNIX in self.writers:
            self.writers.pop(UNIX).close()
        elif does == "drain" and UNIX in self.writers:
            drain(self.writers[UNIX])
        else:
            self.connect_unix(second=does == "second")

    def connect_unix(self, second):
        try:
            if second:
                self.open_port(UNIX).close()
            else:
                self.writer(UNIX)
        except OSError:
            self.outcomes["no Unix port"] += 1

    # ---- Control ---------------------------------------------------------------------------------

    def inject(self, text):
        self.ask("inject", text=text)

    def bad_inject(self, text):
        if self.ask("inject", text=text)["ok"]:
            raise Trouble(f"accepted: inject {text[:100]}")

    def clear(self, rule):
        self.ask("clear", rule=rule)

    def clear_all(self, injected):
        self.ask("clear", **({"injected": True} if injected else {}))

    def fire(self, rule):
        self.ask("fire", rule=rule)

    def rules_shown(self):
        self.ask("faults")

    def set(self, node, settings):
        self.ask("set", node=node, settings=settings)

    def bad_set(self, node, settings):
        if self.ask("set", node=node, settings=settings)["ok"] and settings:
            raise Trouble(f"accepted: set {node} {settings}")

    def restart(self, node):
        self.ask("restart", node=node)

    def reload(self, config):
        self.write_config(config)
        reply = self.ask("reload")
        if config == base_config() and not reply["ok"]:
            raise Trouble(f"a good configuration is refused: {reply}")

    def hangup(self, config):
        self.write_config(config)
        self.process.send_signal(signal.SIGHUP)

    def bad_reload(self, kind, config, signal):
        text = json.dumps(config).encode()
        broken = {"binary": bytes(range(256)), "cut": text[:len(text) // 2], "empty": b""}
        self.write_config(broken.get(kind, text))
        if kind == "gone":
            self.config.unlink()
        if signal:
            self.process.send_signal(HANGUP)
        elif self.ask("reload")["ok"]:
            raise Trouble(f"accepted: a configuration with a wrong {kind}")

    # ---- Clients that misbehave ------------------------------------------------------------------

    def a_client(self, reads=False):
        s = Kept(socket.AF_UNIX, socket.SOCK_STREAM, 0, reads)
        s.setblocking(False)
        try:
            s.connect(str(self.folder / "soak.sock"))
        except OSError:
            self.outcomes["connections refused"] += 1
        return s

    def push(self, s, data):
        """Sends as much as canwired takes within a moment."""
        try:
            s.settimeout(0.2)  # poll: what is not taken by then counts as cut off
            s.sendall(data)
        except OSError:
            self.outcomes["clients cut off"] += 1
        s.settimeout(0)

    def watch(self, reads):
        s = self.a_client(reads)
        self.push(s, b'{"request":"watch"}\n')
        self.keep(self.clients, s)

    def vanish(self, after):
        s = self.a_client()
        self.push(s, after.encode())
        s.close()

    def flood(self, requests):
        """Asks and does not listen."""
        s = self.a_client()
        self.push(s, b'{"request":"status"}\n' * requests)
        self.keep(self.clients, s)

    def garbage(self, size, seed, lines):
        data = random.Random(seed).randbytes(size)
        s = self.a_client(reads=True)
        self.push(s, data.replace(b"\x00", b"\n") if lines else data.replace(b"\n", b"{"))
        self.keep(self.clients, s)

    def crowd(self, clients):
        """Opens more connections than there is room for."""
        for s in [self.a_client() for _ in range(clients)]:
            s.close()

    def half_close(self):
        s = self.a_client(reads=True)
        self.push(s, b'{"request":"faults"}\n{"request":"status"}\n')
        try:
            s.shutdown(socket.SHUT_WR)
        except OSError:
            self.outcomes["clients cut off"] += 1
        self.keep(self.clients, s)

    # ---- Looking at it ---------------------------------------------------------------------------

    def status(self):
        return self.ask("status")["status"]

    def text(self):
        return self.errors.read_text(errors="replace")

    def memory_kib(self):
        status = Path(f"/proc/{self.process.pid}/status").read_text(encoding="ascii")
        return int(re.search(r"VmRSS:\s*(\d+)", status)[1])

    def heap_kib(self):
        """Returns the allocated KiB once they are constant."""
        deadline, before = time.monotonic() + PATIENCE_S, None
        while time.monotonic() < deadline:
            time.sleep(0.5)  # heap.c writes more often
            now = int(self.heap_file.read_text(encoding="ascii")) // 1024
            if now == before:
                break
            before = now
        return now

    def files(self):
        """Counts open files by kind."""
        folder, kinds = Path(f"/proc/{self.process.pid}/fd"), collections.Counter()
        for file in folder.iterdir():
            with contextlib.suppress(FileNotFoundError):  # closed meanwhile
                kinds[re.sub(r"\d+", "N", os.readlink(file))] += 1
        return kinds

    # ---- Calm and end ----------------------------------------------------------------------------

    def calm(self):
        """Restores everything, ends misbehaving clients, and clears all rules."""
        for name, state in self.links.items():
            if state != "up":
                self.link(name, f"back-from-{state}")
        if not self.routed:
            self.route(True)
        if os.environ.get("CANWIRE_PLACE") == "qemu":
            time.clock_settime_ns(time.CLOCK_REALTIME,
                                  time.monotonic_ns() + self.real_offset_ns)
        self.close_all()
        self.ask("clear")
        self.reload(base_config())

    def close_all(self):
        for s in (*self.writers.values(), *self.readers, *self.clients):
            s.close()
        self.writers, self.readers, self.clients = {}, [], []

    def close(self):
        self.close_all()
        if self.client:
            self.client.close()
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for name, state in self.links.items():
            if state != "deleted":
                ip(f"link del {name}{'away' if state == 'renamed' else ''}")
        if not self.routed:
            self.route(True)
        shutil.rmtree(self.folder)


HANGUP = signal.SIGHUP


class Kept(socket.socket):
    """A socket, and a flag for reading it."""

    def __init__(self, family, kind, protocol, reads):
        super().__init__(family, kind, protocol)
        self.reads = reads


def random_frame(r):
    identifier = r.randrange(0x800) if r.random() < 0.7 else EXTENDED | r.randrange(0x20000000)
    if r.random() < 0.05:
        return Frame(identifier | REMOTE, r.randint(0, 8))
    length = r.randint(0, 8)
    return Frame(identifier, r.randint(9, 15) if length == 8 and r.random() < 0.2 else length,
                 r.randbytes(length))


def random_garbage(r, unix):
    """Returns messages that are no frames of a classical bus."""
    kinds = [
        CLASSIC.pack(ERROR | r.randrange(0x400), 8, 0, r.randbytes(8)),
        CLASSIC.pack(r.randrange(0x800, 0x20000000), 8, 0, r.randbytes(8)),
        FD.pack(r.randrange(0x800), r.choice((0, 8, 12, 64)), r.randrange(8), r.randbytes(64)),
    ]
    if unix:
        kinds += [r.randbytes(r.randint(1, 200)), CLASSIC.pack(1, 200, 99, bytes(8))]
    return r.choice(kinds)
