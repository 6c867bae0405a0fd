# SPDX-License-Identifier: MIT
"""The part of scripts/demo that runs where AF_CAN exists.

engine, brakes and dash are can-utils on vcan0..2, canwired runs config/demo.yaml, and this script
subscribes to its statistics over LCM. Another canwired runs config/demo-fd.yaml on vcan4..6, and a
third one, of demo_usb.py, has a real can0.
"""

import contextlib
import importlib
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import lcm

import demo_logs
import demo_usb

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "config/demo.yaml"
FD_CONFIG = ROOT / "config/demo-fd.yaml"
CANWIRE = ROOT / "build/release/canwire"
CANWIRED = ROOT / "build/release/canwired"
BITRATE = 500000
PORTS = {"engine": "vcan0", "brakes": "vcan1", "dash": "vcan2", "tap": "vcan3"}
FLOOD_ID = "7F0"
FLOOD = ["cangen", PORTS["dash"], "-I", FLOOD_ID, "-L", "8", "-g", "1", "-c", "8"]
PATIENCE_S = 40
FD_PORTS = {"engine": "vcan4", "brakes": "vcan5", "dash": "vcan6"}
FD_LONG = "456##1" + "C0FFEE00" * 16  # BRS, 64 bytes
FD_SHORT = "123##1DEADBEEF"
CONTENTION_ATTEMPTS = 10  # on a busy machine writing may take longer than the transmission
CONTENTION_MAX_S = 0.02


class Frame(NamedTuple):
    """A line of candump -L."""

    time: float
    text: str

    @property
    def identifier(self):
        return self.text.partition("#")[0]


class Write(NamedTuple):
    """A frame with the ECU and the time of its writing."""

    time: float
    text: str
    sender: str

    @property
    def identifier(self):
        return self.text.partition("#")[0]


class Checks:
    """A claim of the demo, which fails when one does not hold."""

    def __init__(self):
        self.done, self.failed, self.skipped = 0, [], []

    def check(self, holds, claim):
        self.done += 1
        if not holds:
            self.failed.append(claim)

    def skip(self, claim, why):
        self.skipped.append(f"{claim}: {why}")


def wait_until(condition, what):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            sys.exit(f"demo: waited {PATIENCE_S} s for {what}")
        time.sleep(0.02)


def heading(number, text):
    print(f"\n\033[1m{number}. {text}\033[0m" if sys.stdout.isatty() else f"\n{number}. {text}")


# ---- Programs ------------------------------------------------------------------------------------


class Programs:
    """The programs of the demo; they end with it."""

    def __init__(self, folder):
        self.folder = folder
        self.running = []

    def start(self, *command, **options):
        self.running.append(subprocess.Popen(command, **options))
        return self.running[-1]

    def close(self):
        for process in self.running:
            if process.poll() is None:
                process.kill()
            process.wait()


class Candump:
    """A candump on an interface, and its output."""

    def __init__(self, programs, interface):
        self.log = programs.folder / interface
        with self.log.open("w") as log:
            programs.start("candump", "-L", "-r", str(16 << 20), interface, stdout=log)
        self.read_bytes = 0
        receivers = Path("/proc/net/can/rcvlist_all")
        wait_until(lambda: f" {interface} " in receivers.read_text(), f"candump {interface}")

    def size(self):
        return self.log.stat().st_size

    def take(self):
        """Returns the frames since the last call."""
        with self.log.open() as log:
            log.seek(self.read_bytes)
            lines = log.read().splitlines()
            self.read_bytes = log.tell()
        return [Frame(float(t.strip("()")), text) for t, _, text in map(str.split, lines)]


class LoadMeter:
    """canbusload on an interface; keeps the time of each line."""

    def __init__(self, programs, interface):
        command = ["stdbuf", "-oL", "canbusload", "-e", f"{interface}@{BITRATE}"]
        self.process = programs.start(*command, stdout=subprocess.PIPE, text=True)
        self.seconds = []  # (time, frames, percent)
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.process.stdout:
            words = line.split()
            if len(words) >= 5 and "@" in words[0]:
                self.seconds.append((time.time(), int(words[1]), int(words[4].rstrip("%"))))


def message_types(folder):
    """Returns a module with the LCM types of canwire."""
    types = sorted((ROOT / "config/lcm").glob("*.lcm"))
    subprocess.run(["lcm-gen", "-p", "--ppath", folder, *types], check=True)
    sys.path.insert(0, str(folder))
    return importlib.import_module("canwire")


class Subscriber:
    """Keeps all statistics that canwired publishes of a bus."""

    def __init__(self, types, bus):
        self.types = types
        self.bus, self.nodes, self.events = [], {}, []
        self.lcm = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
        for channel in ("BUS", "NODE", "EVENT"):
            name = rf"CANWIRE\.{bus}\.{channel}"
            self.lcm.subscribe(name, self.take).set_queue_capacity(1000)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            self.lcm.handle_timeout(1000)

    def take(self, channel, data):
        if channel.endswith("BUS"):
            self.bus.append(self.types.bus_stats_t.decode(data))
        elif channel.endswith("NODE"):
            node = self.types.node_stats_t.decode(data)
            self.nodes[node.node] = node
        else:
            self.events.append(self.types.event_t.decode(data))

    def load(self, begin, end):
        """Returns the percentage of busy bits between two moments, and the share of real time in
        which the bus ran."""
        during = [m for m in self.bus if begin <= m.utime_us / 1e6 <= end]
        if len(during) < 2:
            return None
        first, last = during[0], during[-1]
        bits = last.bits - first.bits
        real_ns = 1000 * (last.utime_us - first.utime_us)
        return (
            100 * (last.busy_bits - first.busy_bits) / max(bits, 1),
            (last.bus_time_ns - first.bus_time_ns) / real_ns,
        )


# ---- The parts of the demo -----------------------------------------------------------------------


class Demo:
    def __init__(self, folder, programs):
        self.checks = Checks()
        self.programs = programs
        self.folder = folder
        self.statistics = Subscriber(message_types(folder), "demo")
        self.dumps = {ecu: Candump(programs, port) for ecu, port in PORTS.items()}
        self.sender = {f.partition("#")[0]: e for e, f in map(log_frame, demo_logs.car())}
        self.sender[FLOOD_ID] = "dash"
        self.daemon = programs.start(CANWIRED, "-c", CONFIG, stderr=(folder / "stderr").open("w"))
        wait_until(lambda: self.statistics.bus, "the first statistics from LCM")
        self.load = LoadMeter(programs, PORTS["tap"])
        self.phases = []  # (name, begin, end) for the loads

    def settle(self):
        """Waits until the bus and all candumps are idle."""

        def quiet():
            before = [d.size() for d in self.dumps.values()], len(self.statistics.bus)
            time.sleep(0.35)  # three messages of statistics
            at_rest = [d.size() for d in self.dumps.values()] == before[0]
            return at_rest and self.statistics.bus[-1].pending == 0

        wait_until(quiet, "the end of the traffic")

    # -- 1 --

    def contention(self):
        heading(1, "A contended start: dash keeps the bus busy, and all three write meanwhile")
        for _ in range(CONTENTION_ATTEMPTS):
            writes, on_bus = self.contend()
            in_time = writes[-1].time - writes[0].time < CONTENTION_MAX_S
            if in_time:
                break
        burst_id = writes[0].identifier
        late = [w for w in writes if w.identifier != burst_id]
        seen = [f for f in on_bus if f.identifier != burst_id]
        print(f"   {len(writes) - len(late)} frames {burst_id} of dash, then")
        print("   written at     by      frame               seen at       by      frame")
        sender = {w.text: w.sender for w in late}
        for w, f in zip(late, seen):
            print(
                f"   +{1000 * (w.time - writes[0].time):6.3f} ms     {w.sender:6}  {w.text:12}"
                f"      +{1000 * (f.time - writes[0].time):6.3f} ms    {sender[f.text]:6}  {f.text}"
            )
        order = sorted((w.text for w in writes), key=arbitration_key)
        claim = "contending frames come by priority"
        if in_time:
            self.checks.check([f.text for f in on_bus] == order, claim)
        else:
            self.checks.skip(claim, "this machine writes them more slowly than the bus sends them")

    def contend(self):
        """Shows written frames and the frames on the bus."""
        ecus = "engine", "brakes", "dash"
        play(self.programs, "contention", demo_logs.contention(), ecus, "-t").wait()
        self.settle()
        dumps = {ecu: dump.take() for ecu, dump in self.dumps.items()}
        writes = []
        for ecu, text in map(log_frame, demo_logs.contention()):
            at = next(f.time for f in dumps[ecu] if f.text == text)  # vcan's own echo
            writes.append(Write(at, text, ecu))
        return writes, dumps["tap"]

    # -- 2 and 3 --

    def drive(self, name, flood):
        begin = time.time()
        before = {ecu: self.dropped(ecu) for ecu in PORTS}
        if flood:
            generator = self.programs.start(*FLOOD)
        players = [play(self.programs, ecu, demo_logs.car(), [ecu]) for ecu in ("engine", "brakes")]
        for player in players:
            self.checks.check(player.wait() == 0, f"canplayer ends well ({name})")
        self.phases.append((name, begin, time.time()))
        if flood:
            generator.send_signal(signal.SIGINT)
            generator.wait()
        self.settle()
        dumps = {ecu: dump.take() for ecu, dump in self.dumps.items()}
        counts = {ecu: Counter(f.identifier for f in frames) for ecu, frames in dumps.items()}
        dropped = {ecu: self.dropped(ecu) - before[ecu] for ecu in PORTS}
        self.print_counts(counts)
        for ecu, count in dropped.items():
            if count:
                print(f"   ({count} of {ecu} did not fit into its queue)")
        if not flood:
            print("   first frames of candump vcan2 (dash):")
            for frame in dumps["dash"][:3]:
                print(f"   ({frame.time:.6f}) vcan2 {frame.text}")
        self.check_counts(counts, name, dropped)

    def dropped(self, ecu):
        return self.statistics.nodes[ecu].dropped_queue_full

    def print_counts(self, counts):
        print("   identifier  from    " + "".join(f"{ecu:>9}" for ecu in PORTS))
        for identifier in sorted(self.sender, key=arbitration_key):
            sender = self.sender[identifier]
            if not counts[sender][identifier]:
                continue
            cells = (
                f"({counts[ecu][identifier]})" if ecu == sender else str(counts[ecu][identifier])
                for ecu in PORTS
            )
            print(f"   {identifier:10}  {sender:6}  " + "".join(f"{cell:>9}" for cell in cells))
        print("   (in brackets: written by itself)")

    def check_counts(self, counts, name, dropped):
        """All others must have arrived, unless the sender's queue was full. The flood loses frames,
        and a machine that is too slow for the bus may lose more."""
        for identifier, sender in self.sender.items():
            written = counts[sender][identifier]
            got = {counts[ecu][identifier] for ecu in PORTS if ecu != sender}
            claim = f"{identifier}: {written} written, {got} received ({name})"
            whole = len(got) == 1 and (dropped[sender] or got == {written})
            self.checks.check(whole and max(got) <= written, claim)
            self.checks.check(written or identifier == FLOOD_ID, f"{identifier} is played ({name})")
        for sender, lost in dropped.items():
            own = [i for i, ecu in self.sender.items() if ecu == sender]
            written = sum(counts[sender][i] for i in own)
            for ecu in PORTS.keys() - {sender}:
                got = sum(counts[ecu][i] for i in own)
                claim = f"{sender} wrote {written}, {lost} dropped, {ecu} got {got} ({name})"
                self.checks.check(got == written - lost, claim)

    # -- 4 --

    def fd(self):
        FdBus(self).show()

    # -- 5 --

    def real_can(self):
        why = demo_usb.why_not()
        if why:
            self.checks.skip("a real can0", why)
            print(f"   not here: {why}")
            return
        demo_usb.RealCan(ROOT, self.programs, self.checks.check, wait_until).show()

    # -- 6 and 7 --

    def loads(self):
        print("                   canbusload       canwired (LCM), same second")
        shown = 0
        for name, begin, end in self.phases:
            for at, frames, percent in self.load.seconds:
                own = self.statistics.load(at - 1, at)
                if begin > at - 1 or at > end or not own:
                    continue
                load, pace = own
                slow = f"  (bus at {100 * pace:.0f} % of real time)" if pace < 0.97 else ""
                print(f"   {name:14} {percent:3} %  {frames:5}/s   {load:5.1f} %{slow}")
                shown += 1
        self.checks.check(shown >= 1, "there is a whole second to compare loads of")

    def numbers(self):
        bus = self.statistics.bus[-1]
        print(
            "   node         sent  received  dropped  lost arb.   delay ms: mean    p99    max"
            "  state"
        )
        for ecu in PORTS:
            n = self.statistics.nodes[ecu]
            delays = (n.delay_mean_ns, n.delay_p99_ns, n.delay_max_ns)
            print(
                f"   {ecu:8} {n.tx_frames:8} {n.rx_frames:9} {n.dropped_queue_full:8}"
                f" {n.arbitration_lost:10}           "
                + " ".join(f"{ns / 1e6:6.2f}" for ns in delays)
                + f"  {n.state}"
            )
        print(
            f"   bus: {bus.frames} frames, {bus.error_frames} error frames, busy "
            f"{100 * bus.busy_bits / bus.bits:.1f} % of {bus.bus_time_ns / 1e9:.1f} s"
        )
        nodes = self.statistics.nodes.values()
        self.checks.check(bus.frames == sum(n.tx_frames for n in nodes), "sent frames add up")
        self.checks.check(bus.frames == self.statistics.nodes["tap"].rx_frames, "tap got them all")
        self.checks.check(bus.error_frames == 0, "no error frames")
        self.checks.check(not self.statistics.events, "no events of errors")

    def stop(self):
        self.daemon.send_signal(signal.SIGTERM)
        self.checks.check(self.daemon.wait(PATIENCE_S) == 0, "canwired ends well")


class FdBus:
    """The fourth part: CAN FD, and an ECU that is older."""

    def __init__(self, demo):
        self.check = demo.checks.check
        link("down", FD_PORTS["dash"])
        self.statistics = Subscriber(demo.statistics.types, "demo-fd")
        self.dump = Candump(demo.programs, FD_PORTS["brakes"])
        with (demo.folder / "stderr-fd").open("w") as errors:
            self.daemon = demo.programs.start(CANWIRED, "-c", FD_CONFIG, stderr=errors)
        wait_until(lambda: self.statistics.bus, "the first statistics of the CAN FD bus")

    def show(self):
        print("   Two ECUs, 2 Mbit/s in the data phase; engine writes 64 bytes in one frame:")
        self.arrives(FD_LONG)
        print("   dash is classical. It comes onto the bus and takes such frames for classical:")
        link("up", FD_PORTS["dash"])
        wait_until(lambda: self.is_up("dash"), "dash on the bus")
        self.clash()
        print("   dash is unplugged, and engine has restarted:")
        link("down", FD_PORTS["dash"])
        wait_until(lambda: not self.is_up("dash"), "dash off the bus")
        wait_until(lambda: self.node("engine").state == "error-active", "the restart of engine")
        self.arrives(FD_SHORT)
        self.daemon.send_signal(signal.SIGTERM)
        self.check(self.daemon.wait(PATIENCE_S) == 0, "canwired of the CAN FD bus ends well")

    def node(self, name):
        return self.statistics.nodes[name]

    def events(self, kind, node):
        every = [json.loads(e.json) for e in self.statistics.events]
        return [e for e in every if e["event"] == kind and e["node"] == node]

    def is_up(self, name):
        links = self.events("link", name)
        return bool(links) and links[-1]["state"] == "up"

    def arrives(self, frame):
        write(FD_PORTS["engine"], frame)
        wait_until(lambda: self.dump.size() > self.dump.read_bytes, f"{frame} at brakes")
        (seen,) = self.dump.take()
        as_written = seen.text.replace("##5", "##1")  # candump shows that it is CAN FD, 4
        self.check(as_written == frame, f"{frame} arrives at brakes")
        print(f"   ({seen.time:.6f}) vcan5 {seen.text[:30]}{'...' if len(seen.text) > 30 else ''}")

    def clash(self):
        """Each attempt costs the sender 8, and nobody can read the frame."""
        write(FD_PORTS["engine"], FD_SHORT)
        wait_until(lambda: self.node("engine").bus_off, "bus-off of engine")
        states = self.events("state", "engine")
        for e in states[:3]:
            print(f"   {1000 * (e['t'] - states[0]['t']):6.3f} ms  engine {e['state']:14}"
                  f" TEC {e['tec']}")
        names = [e["state"] for e in states[:3]]
        self.check(names == ["error-warning", "error-passive", "bus-off"], "engine goes bus-off")
        self.check(not self.dump.take(), f"{FD_SHORT} does not arrive while dash is there")


def log_frame(line):
    """Returns ECU and frame of a line of a log."""
    _, ecu, frame = line.split()
    return ecu, frame


def play(programs, name, lines, ecus, *options):
    log = programs.folder / f"{name}.log"
    log.write_text("".join(f"{line}\n" for line in lines))
    assignments = [f"{PORTS[ecu]}={ecu}" for ecu in ecus]
    return programs.start("canplayer", *options, "-I", log, *assignments)


def arbitration_key(frame):
    """Returns the bits of the identifier as arbitration compares them."""
    identifier = frame.partition("#")[0]
    number = int(identifier, 16)
    if len(identifier) == 8:
        return f"{number >> 18:011b}1{number & 0x3FFFF:018b}"
    return f"{number:011b}0"


def vcan(verb, config):
    subprocess.run([CANWIRE, "vcan", verb, config], check=True, stdout=subprocess.DEVNULL)


def link(verb, interface):
    subprocess.run(["ip", "link", "set", interface, verb], check=True)


def write(interface, frame):
    subprocess.run(["cansend", interface, frame], check=True)


def main():
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        for config in CONFIG, FD_CONFIG:
            vcan("up", config)
            stack.callback(vcan, "down", config)
        programs = Programs(folder)
        stack.callback(programs.close)
        print("canwire: three ECUs on one simulated CAN bus, 500 kbit/s (config/demo.yaml)")
        print("engine on vcan0, brakes on vcan1, dash on vcan2; tap on vcan3 only listens")
        demo = Demo(folder, programs)
        demo.contention()
        heading(2, "The car drives: canplayer is engine and brakes. What each candump received:")
        demo.drive("car", flood=False)
        heading(3, f"The same, while dash floods with {FLOOD_ID} (cangen, 8 frames each ms)")
        demo.drive("car and flood", flood=True)
        heading(4, "CAN FD (config/demo-fd.yaml)")
        demo.fd()
        heading(5, "A real can0: the kernel's driver on an emulated adapter (config/demo-usb.yaml)")
        demo.real_can()
        heading(6, "Bus load (canbusload rounds down, and goes by real time)")
        demo.loads()
        heading(7, "Statistics from LCM")
        demo.numbers()
        demo.stop()
    for claim in demo.checks.skipped:
        print(f"SKIPPED: {claim}")
    for claim in demo.checks.failed:
        print(f"FAILED: {claim}")
    print(f"\n{demo.checks.done - len(demo.checks.failed)} of {demo.checks.done} checks hold.")
    return 1 if demo.checks.failed else 0


if __name__ == "__main__":
    sys.exit(main())
