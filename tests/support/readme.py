# SPDX-License-Identifier: MIT
"""The examples of README.md and other pages: a configuration, and the commands below it, which are
run as they stand there.

`Reader` pastes blocks as a reader does: a line at once after the other, as a user without rights,
with what is installed. `Session` runs the lines of a page one by one, as they are for root."""

import getpass
import os
import pwd
import re
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from compiled import compiled

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ROOT / "build/release"
PATIENCE_S = 120
SYSTEM = "/usr/local/bin:/usr/bin:/bin"
NOBODY = "nobody"


def wait_until(condition, what):
    """Returns the first true value of condition(). It looks less often as time goes by: a look may
    be a start of systemctl."""
    deadline, pause_s = time.monotonic() + PATIENCE_S, 0.05
    while not (value := condition()):
        assert time.monotonic() < deadline, f"waited {PATIENCE_S} s for {what}"
        time.sleep(pause_s)  # no wait: it looks again
        pause_s = min(pause_s * 1.5, 0.4)
    return value


def blocks_of(text):
    """Returns the blocks of commands or output in Markdown."""
    found = re.findall(r"(?:^    [^\n]+\n)+", text, re.MULTILINE)
    return [re.sub("^    ", "", block, flags=re.MULTILINE) for block in found]


def first_block(page, number=0):
    """Returns the first block of a page, or one of the next."""
    return blocks_of((ROOT / page).read_text(encoding="utf-8"))[number]


def example(bus, page="README.md"):
    """Returns the configuration of the bus of that name on a page, and the commands."""
    text, (block, *_) = blocks(bus, page)
    return text, block.splitlines()


def blocks(bus, page="README.md"):
    """Returns the configuration, which has `control`, and the blocks of commands up to the next one
    or a heading."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.search(r"^```yaml\n(bus: \{ name: " + bus +
                      r",[^`]*?^control:.*?)```\n(.*?)(?=^```|^#|\Z)", text,
                      re.DOTALL | re.MULTILINE)
    return found[1], blocks_of(found[2])


def build_sudo(folder):
    """Makes `sudo` for a user without rights; the folder allows that (no nosuid)."""
    Path(shutil.copy(compiled("sudo"), folder)).chmod(0o4755)


def is_over(process):
    """Returns True for a process that has ended; process 1 may look at it later."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def end(process):
    """Ends a process of --background, which may be over."""
    if not is_over(process):
        os.kill(process, signal.SIGTERM)
    wait_until(lambda: is_over(process), "the end of canwired")


class Reader:
    """A shell, in an empty folder, in which somebody pastes blocks. Its programs end with it."""

    def __init__(self, path=SYSTEM):
        assert str(PROGRAMS) not in path
        as_nobody = os.geteuid() == 0
        user = pwd.getpwnam(NOBODY) if as_nobody else pwd.getpwuid(os.geteuid())
        self.made = tempfile.TemporaryDirectory()
        self.folder = Path(self.made.name)
        os.chown(self.folder, user.pw_uid, user.pw_gid)
        words = [f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
        paste, self.clipboard = os.pipe()
        self.done, done = os.pipe()
        script = f'while read -r b <&{paste}; do . "$b"; echo "$? $b" >&{done}; done'
        with (self.folder / "said").open("w") as said:
            self.shell = subprocess.Popen(
                [*(["setpriv", *words] if as_nobody else []), "bash", "-c", script],
                cwd=self.folder, stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                pass_fds=(paste, done), start_new_session=True,
                env={"PATH": path, "USER": user.pw_name, "HOME": str(self.folder), "LANG": "C"})
        os.close(paste)
        os.close(done)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.close(self.clipboard)
        os.close(self.done)
        for process in re.findall(r"^(\d+)$", self.said(), re.MULTILINE):
            end(int(process))  # --background has printed its number
        os.killpg(self.shell.pid, signal.SIGTERM)
        self.shell.wait(PATIENCE_S)
        self.made.cleanup()

    def save(self, name, text):
        (self.folder / name).write_text(text)

    def said(self):
        """Returns what is on the screen."""
        return (self.folder / "said").read_text(errors="replace")

    def paste(self, block):
        """Runs a block up to its last line, whose status must be 0."""
        with tempfile.NamedTemporaryFile("w", dir=self.folder, delete=False) as file:
            file.write(block)
        os.chmod(file.name, 0o644)
        os.write(self.clipboard, f"{file.name}\n".encode())
        answer = b""
        while not answer.endswith(b"\n"):
            more = os.read(self.done, 100)
            assert more, self.said()
            answer += more
        assert answer.split()[0] == b"0", self.said()

    def wait(self, pattern, times=1):
        """Waits until that can be read on the screen, so many times."""
        try:
            wait_until(lambda: len(re.findall(pattern, self.said(), re.MULTILINE)) >= times,
                       pattern)
        except AssertionError as late:
            raise AssertionError(f"{late}: {self.said()}") from None


class Session:
    """A shell of root in a folder. Its programs in the background end with it."""

    def __init__(self, folder):
        self.folder, self.background, self.buses = folder, [], []
        self.environment = {**os.environ, "USER": getpass.getuser(),
                            "PATH": f"{PROGRAMS}:{os.environ['PATH']}"}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in reversed(self.background):
            process.terminate()
            process.communicate(timeout=PATIENCE_S)
        for process in self.buses:
            end(process)

    def run(self, line):
        """Runs a line, as root already; one that ends in & returns a process."""
        line = re.sub(r"\bsudo ", "", line)
        how = {"cwd": self.folder, "env": self.environment, "text": True}
        if line.endswith("&"):
            process = subprocess.Popen(["bash", "-c", "exec " + line[:-1]], **how,
                                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.background.append(process)
            return process
        if "--background" in line:
            with (self.folder / "canwired.log").open("w") as log:
                out = subprocess.run(["bash", "-c", line], **how, timeout=PATIENCE_S, check=True,
                                     stdout=subprocess.PIPE, stderr=log).stdout
            self.buses.append(int(out))
            return out
        return subprocess.run(["bash", "-c", line], **how, timeout=PATIENCE_S, check=True,
                              capture_output=True).stdout
