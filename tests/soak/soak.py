#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Random traffic, faults, commands and mishaps for a canwired with sanitizers, for minutes or days.

Run with: scripts/guest -t 900 -- build/venv/bin/python tests/soak/soak.py --time 10m (`make soak`
does so.) The actions follow from the seed (schedule.py). All the time canwired must live, answer,
and have no frame unaccounted for. Twice the traffic stops; then each ECU must reach each other.
canwired must hold as much memory and as many files the second time as the first. In the end it is
stopped under full traffic.
"""

import argparse
import collections
import itertools
import re
import shutil
import signal
import subprocess
import sys
import time
from typing import NamedTuple

from rig import PATIENCE_S, ROOT, Rig, Trouble
from schedule import PORTS, WEIGHTS, Schedule

from canbits import CLASSIC, Frame  # of tests/kernel

HEAP_SLACK_KIB = 128
# ASan keeps some memory for good, its records of stacks, which grow more and more slowly.
MEMORY_SLACK_KIB = 32768
WARM_UP = 2 * len(WEIGHTS)  # actions before memory is measured; each kind is among them
CHECK_EACH = 4  # actions
PROGRESS_S = 5
HEALTH_FRAMES = 5  # from each ECU
LAST_ACTIONS = 30  # before it is stopped
TOLD_ACTIONS = 15  # when something is wrong
REPORTS = ("Sanitizer", "runtime error:", "unaccounted for")
UNITS_S = {"": 1, "s": 1, "m": 60, "min": 60, "h": 3600, "d": 86400}


def read_time(text):
    match = re.fullmatch(r"([0-9.]+)([a-z]*)", text)
    if not match or match[2] not in UNITS_S:
        raise argparse.ArgumentTypeError(f"{text}: expected a time such as 90s, 10m or 8h")
    return float(match[1]) * UNITS_S[match[2]]


# ---- What must always be so ----------------------------------------------------------------------


def check_node(node):
    """Checks the node's own result, and the sums that others can compute."""
    dropped, rx_dropped = (sum(node[key].values()) for key in ("dropped", "rx_dropped"))
    came = node["handed_in"] + node["made_by_rules"]
    went = node["tx_frames"] + node.get("stored", 0) + node["queue"] + node["held"] + dropped
    accepted = node["rx_accepted"] + node["rx_made_by_rules"]
    given = node["rx_frames"] + node["rx_held"] + rx_dropped
    if not node["conserved"] or came != went or accepted != given:
        raise Trouble(f"frames are unaccounted for: {node}")


def check_status(status, before):
    """Checks that every node balances, and that no counter has decreased."""
    for node in status["nodes"]:
        check_node(node)
    for key in ("time_ns", "bits", "frames", "error_frames", "skips"):
        if before and status["bus"][key] < before["bus"][key]:
            raise Trouble(f"{key} went from {before['bus'][key]} to {status['bus'][key]}")


def check_text(text):
    """Checks the messages of canwired."""
    for report in REPORTS:
        if report in text:
            raise Trouble(f"canwired reports: {report}")


class Measure(NamedTuple):
    heap_kib: int  # allocated
    memory_kib: int  # of the process
    files: collections.Counter  # open ones, by kind

    def __str__(self):
        return (f"{self.heap_kib} KiB allocated, {self.memory_kib} KiB in memory, "
                f"{sum(self.files.values())} open files")


def check_flat(first, last):
    """Checks that nothing has grown from one rest to the other."""
    if last.heap_kib > first.heap_kib + HEAP_SLACK_KIB or (
            last.memory_kib > first.memory_kib + MEMORY_SLACK_KIB):
        raise Trouble(f"memory has grown from {first} to {last}")
    if last.files != first.files:
        raise Trouble(f"open files were {dict(first.files)} and are {dict(last.files)}")


# ---- The run -------------------------------------------------------------------------------------


class Soak:
    def __init__(self, rig, seed, out, seconds=None, actions=None):
        self.rig, self.out = rig, out
        self.actions = enumerate(Schedule(seed), 1)
        self.seconds, self.limit = seconds, actions
        self.begin = self.told_s = time.monotonic()
        self.done, self.log, self.before = 0, [], None

    def elapsed(self):
        return time.monotonic() - self.begin

    def part(self):
        """Returns the completed part of the run, 0 to 1."""
        return self.done / self.limit if self.limit else self.elapsed() / self.seconds

    def act(self):
        self.done, action = next(self.actions)
        self.log.append(f"{self.done}: {action}")
        time.sleep(action.pause_s)  # no wait: or longer
        getattr(self.rig, action.name)(**action.arguments)
        self.rig.pump()
        if self.done % CHECK_EACH == 0:
            self.check()

    def check(self):
        self.rig.check_alive()
        status = self.rig.status()
        check_status(status, self.before)
        check_text(self.rig.text())
        self.before = status
        if time.monotonic() - self.told_s >= PROGRESS_S:
            self.tell()

    def tell(self):
        """Prints a line of progress."""
        self.told_s = time.monotonic()
        bus, nodes = self.before["bus"], self.before["nodes"]
        dropped = sum(sum(n["dropped"].values()) for n in nodes)
        minutes, seconds = divmod(int(self.elapsed()), 60)
        print(f"{minutes}:{seconds:02} {100 * min(self.part(), 1):.0f} %: {self.done} actions, "
              f"{bus['frames']} frames, {bus['error_frames']} error frames, {dropped} dropped, "
              f"{bus['faults']} hits, {bus['skips']} skips, "
              f"{self.rig.memory_kib() // 1024} MiB", file=self.out, flush=True)

    def storm(self, until, at_least=0):
        while self.part() < until or self.done < at_least:
            self.act()

    def rest(self):
        """Stops the traffic; each ECU must reach each other. Returns memory and files."""
        self.log.append("calm")
        self.rig.calm()
        self.wait_healthy()
        self.exchange()
        self.check()
        self.rig.close_all()
        measured = Measure(self.rig.heap_kib(), self.rig.memory_kib(), self.rig.files())
        print(f"at rest after {self.done} actions: {measured}", file=self.out, flush=True)
        return measured

    def wait(self, what, missing):
        """Waits until missing() is empty."""
        deadline = time.monotonic() + PATIENCE_S
        while left := missing():
            self.rig.check_alive()
            if time.monotonic() > deadline:
                raise Trouble(f"waited {PATIENCE_S} s for {what}: {left}")
            time.sleep(0.1)

    def wait_healthy(self):
        def ill():
            nodes = {n["name"]: n for n in self.rig.status()["nodes"]}
            keys = ("state", "link", "queue", "inbox", "held", "rx_held")
            return [name for name in PORTS if name not in nodes] + [
                {"node": name} | {key: n[key] for key in keys} for name, n in nodes.items()
                if n["link"] not in (None, "up") or n["state"] == "bus-off" or n["queue"] > 1
                or n["held"] or n["rx_held"] or n["inbox"]]

        self.wait("all nodes to be back", ill)

    def exchange(self):
        """Sends frames from each ECU to each other; none of them is lost."""
        ecus = {name: self.rig.open_port(port) for name, port in PORTS.items()}
        wanted = {name: {Frame(0x600 + i, 1, bytes([k])).pack() for k in range(HEALTH_FRAMES)}
                  for i, name in enumerate(ecus)}
        got = {name: set() for name in ecus}
        for name, ecu in ecus.items():
            for frame in sorted(wanted[name]):
                ecu.send(frame)

        def missing():
            for name, ecu in ecus.items():
                got[name].update(read_all(ecu))
            return [f"{b} to {a}" for a in ecus for b in ecus if a != b and not got[a] >= wanted[b]]

        try:
            self.wait("frames from each ECU at each other", missing)
        finally:
            for ecu in ecus.values():
                ecu.close()

    def end(self):
        """Stops canwired under load: it must end well, and its counts must balance."""
        for _ in range(LAST_ACTIONS):
            self.act()
        self.check()
        self.log.append("SIGTERM")
        self.rig.process.send_signal(signal.SIGTERM)
        try:
            status = self.rig.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise Trouble("canwired does not end") from None
        check_text(self.rig.text())
        if status != 0 or "stopped: " not in self.rig.text():
            raise Trouble(f"canwired ended with status {status}")
        left = [f.name for f in self.rig.folder.glob("*.sock")]
        if left:
            raise Trouble(f"canwired has left {left}")

    def run(self):
        self.rig.connect()
        self.storm(1 / 3, WARM_UP)
        first = self.rest()
        self.storm(1)
        check_flat(first, self.rest())
        self.end()


def read_all(s):
    frames = []
    try:
        while frame := s.recv(CLASSIC.size):
            frames.append(frame)
    except BlockingIOError:
        pass
    return frames


# ---- Main ----------------------------------------------------------------------------------------


def run(program, seed, seconds=None, actions=None, out=sys.stdout):
    """Returns whether all was well."""
    print(f"seed {seed}", file=out, flush=True)
    rig = Rig(program)
    soak = Soak(rig, seed, out, seconds, actions)
    try:
        soak.run()
    except Trouble as trouble:
        print(f"FAILED after {soak.done} actions of seed {seed}: {trouble}", file=out)
        print("\n".join(line[:300] for line in soak.log[-TOLD_ACTIONS:]), file=out)
        print(rig.text()[-6000:], file=out)
        return False
    finally:
        keep(rig, soak, seed)
        rig.close()
    said = ", ".join(f"{count} {what}" for what, count in sorted(rig.outcomes.items()))
    print(f"{soak.done} actions: {said}", file=out)
    return True


def keep(rig, soak, seed):
    """Keeps data for finding the reason: actions, configuration and messages of canwired."""
    folder = ROOT / f"build/soak/{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "actions").write_text("\n".join(soak.log) + "\n")
    shutil.copy(rig.errors, folder)
    if rig.config.exists():
        shutil.copy(rig.config, folder)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=time.time_ns() // 10**6 % 10**9)
    parser.add_argument("--time", type=read_time, default=read_time("10m"), metavar="TIME")
    parser.add_argument("--actions", type=int, help="so many, however long it takes")
    parser.add_argument("--show", type=int, metavar="N", help="write the first N actions, do none")
    parser.add_argument("--canwired", default=ROOT / "build/san/canwired")
    args = parser.parse_args()
    if args.show is not None:
        print(*itertools.islice(Schedule(args.seed), args.show), sep="\n")
        return 0
    good = run(args.canwired, args.seed, args.time, args.actions)
    print(f"{int(good)} passed, {int(not good)} failed")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
