# SPDX-License-Identifier: MIT
"""The examples of README.md and other pages: a configuration, and the commands below it, which are
run as they stand there."""

import getpass
import os
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ROOT / "build/release"
PATIENCE_S = 120


def example(bus, page="README.md"):
    """Returns the configuration of the bus of that name on a page, and the commands."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.search(r"```yaml\n(bus: \{ name: " + bus + r",.*?)```\n\n((?:    [^\n]+\n)+)", text,
                      re.DOTALL)
    return found[1], [line[4:] for line in found[2].splitlines()]


class Session:
    """A shell of a user in a folder. Its programs in the background end with it."""

    def __init__(self, folder):
        self.folder, self.background = folder, []
        self.environment = {**os.environ, "USER": getpass.getuser(),
                            "PATH": f"{PROGRAMS}:{os.environ['PATH']}"}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in reversed(self.background):
            process.terminate()
            process.communicate(timeout=PATIENCE_S)

    def run(self, line):
        """Runs a line, as root already; one that ends in & returns a process."""
        line = re.sub(r"\bsudo ", "", line)
        how = {"cwd": self.folder, "env": self.environment, "text": True}
        if line.endswith("&"):
            process = subprocess.Popen(["bash", "-c", "exec " + line[:-1]], **how,
                                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.background.append(process)
            return process
        return subprocess.run(["bash", "-c", line], **how, timeout=PATIENCE_S, check=True,
                              capture_output=True).stdout
