# SPDX-License-Identifier: MIT
"""The gates: each value that must not grow, the best of it so far, and the table in
tests/README.md. scripts/gates runs them."""

import os
import re
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import instructions

ROOT = Path(__file__).resolve().parents[2]
LIMITS = ROOT / "tests/bench/limits.txt"
README = ROOT / "tests/README.md"
SLACK = 0.01
NOISE = 0.0005  # of the values of processes, whose addresses differ
# 64 nodes need many frames until all queues and identifiers have been in use.
MANY = 20000

# Name, what it is, and units of a work of the program bench.
WORKS = [
    ("clean-2", "clean frame, hand-in to events, 2 nodes", 2000),
    ("clean-64", "clean frame, 64 nodes", MANY),
    ("clean-fresh-4", "clean frame, 4 nodes, no frame as another one", 2000),
    ("rules-100", "clean frame, 4 nodes, 100 rules with exact identifiers", 2000),
    ("faulted-100", "frame when 1 % of attempts are faulted, 4 nodes", 4000),
    ("faulted-10", "frame when 10 % of attempts are faulted, 4 nodes", 2000),
    ("fd-8-2", "clean FD frame of 8 bytes, 2 nodes", 2000),
    ("fd-64-2", "clean FD frame of 64 bytes, 2 nodes", 2000),
    ("every-node-4", "bit with `--step`, 4 nodes", 5000),
    ("timed-clean-4", "clean frame, clocks within 100 ppm, 4 nodes", 1000),
    ("timed-100-4", "bit, clocks within 100 ppm, saturated, 4 nodes", 5000),
]
# The same of the program bench_sim.
EMBEDDED = [
    ("virtual", "frame in a program in virtual time, one of 4 nodes sends it, 3 wait for it", 2000),
    ("real", "... in real time", 2000),
    ("events", "event of a bus in a program, taken as columns", 4000),
]
OUTPUTS = [
    ("stats", "frame of a car in `canwire sim --stats`"),
    ("events", "frame of a car in `canwire sim --events`"),
]


def count_all(build):
    """Returns the values by name, from the programs in this folder."""
    tool, bench = build / "canwire", build / "bench"
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        counts = {name: pool.submit(instructions.of_work, bench, name, units)
                  for name, _, units in WORKS}
        counts |= {f"embed-{name}": pool.submit(instructions.of_work, build / "bench_sim", name,
                                                units) for name, _, units in EMBEDDED}
        counts |= {f"sim-{output}": pool.submit(instructions.of_sim, tool, output)
                   for output, _ in OUTPUTS}
        counts["campaign-row"] = pool.submit(instructions.of_campaign, tool, Path(folder), "seed")
        values = {name: round(value.result(), 1) for name, value in counts.items()}
    memory = instructions.output_of([bench, "--memory"])
    return values | {"node-bytes": float(memory)}


def texts():
    """Returns what each value is, in the order of the table."""
    return {name: text for name, text, _ in WORKS} | \
        {f"embed-{name}": text for name, text, _ in EMBEDDED} | \
        {f"sim-{output}": text for output, text in OUTPUTS} | \
        {"campaign-row": "row of a campaign: 0.1 s of bus time, 3 nodes, 17 frames",
         "node-bytes": "bytes of a node besides its queue and statistics"}


# ---- Limits --------------------------------------------------------------------------------------

class Limits:
    """The best values so far, and the commit at which the last of them became what it is."""

    HEAD = """# The best values so far, which may grow by 1 %. `make gates WRITE=yes` writes this
# file and the table in tests/README.md. What has to become dearer loses its line here before.
"""

    def __init__(self, values, commit):
        self.values, self.commit = values, commit

    @classmethod
    def read(cls, file=LIMITS):
        rows = dict(line.split(maxsplit=1) for line in file.read_text().splitlines()
                    if line and not line.startswith("#"))
        commit = rows.pop("commit")
        return cls({name: float(value) for name, value in rows.items()}, commit)

    def write(self, file=LIMITS):
        rows = [f"{name} {self.values[name]:.1f}\n" for name in texts()]
        file.write_text(f"{self.HEAD}commit {self.commit}\n{''.join(rows)}")

    def better(self, values, commit):
        """Returns the limits with what is better in these values."""
        best = dict(self.values)
        for name, value in values.items():
            if value < best.get(name, float("inf")) * (1 - NOISE):
                best[name] = value
        return self if best == self.values else Limits(best, commit)

    def complaints(self, values):
        """Yields a name and what is wrong with its value."""
        for name in texts():
            if name not in self.values:
                yield name, "has no limit: make gates WRITE=yes"
            elif values[name] > self.values[name] * (1 + SLACK):
                yield name, f"is {values[name] / self.values[name] - 1:.1%} above the best so far"
            elif values[name] < self.values[name] * (1 - SLACK):
                yield name, f"is {1 - values[name] / self.values[name]:.1%} below the best so " \
                            "far: keep that with make gates WRITE=yes"


# ---- The table in tests/README.md ----------------------------------------------------------------

TABLE = re.compile(r"(<!-- scripts/gates --write -->\n).*?(<!-- end -->\n)", re.S)


def table(limits):
    rows = "".join(f"| {text} | {limits.values[name]:.0f} |\n" for name, text in texts().items())
    return f"\n| at commit {limits.commit} | instructions |\n|---|---|\n{rows}\n"


def written_table(readme=README):
    """Returns the table as the document has it."""
    found = TABLE.search(readme.read_text(encoding="utf-8"))
    return found[0][len(found[1]):-len(found[2])] if found else None


def write_table(limits, readme=README):
    text = readme.read_text(encoding="utf-8")
    readme.write_text(TABLE.sub(lambda part: part[1] + table(limits) + part[2], text))
