# SPDX-License-Identifier: MIT
"""The shared parts of the tests of `canwire sim` and its relatives: the tool and canwired, run to
their end.

CANWIRE is the tool, by default build/release/canwire; canwired is the one beside it.
"""

import json
import os
import signal
import socket
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CANWIRE = str((ROOT / os.environ.get("CANWIRE", "build/release/canwire")).resolve())
CANWIRED = str(Path(CANWIRE).with_name("canwired"))
SCHEMAS = Path(CANWIRE).with_name("schema")  # of the same build
TIMEOUT_S = 600


def run(program, *arguments, status=0, cwd=None):
    """Runs a program that must end with that status."""
    result = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True,
                            cwd=cwd, timeout=TIMEOUT_S, check=False)
    assert result.returncode == status, f"{result.returncode}\n{result.stdout}\n{result.stderr}"
    return result


def canwire(*arguments, status=0, cwd=None):
    return run(CANWIRE, *arguments, status=status, cwd=cwd)


def answer(folder, *arguments, status=0):
    """Returns the output of the tool: that on standard error when it is to fail."""
    result = canwire(*arguments, status=status, cwd=folder)
    return result.stdout if status == 0 else result.stderr


def sim(*arguments, status=0, cwd=None):
    return canwire("sim", *arguments, status=status, cwd=cwd)


def events(*arguments):
    return [json.loads(line) for line in sim(*arguments, "--events", "-").stdout.splitlines()]


def stats(*arguments):
    return json.loads(sim(*arguments, "--stats", "-").stdout)


def raw(frame):
    """Returns the bits of `canwire bits`, with the ACK of another node."""
    bits = canwire("bits", frame, "--raw").stdout.strip()
    return bits[:-9] + "0" + bits[-8:]


def journal_text(path):
    """Returns the text of a journal, as far as it is there."""
    return subprocess.run(["zstdcat", path], capture_output=True, text=True, timeout=TIMEOUT_S,
                          check=False).stdout


def journal_lines(path):
    return [json.loads(line) for line in journal_text(path).splitlines()]


def listens(path):
    """Returns True when a program listens at a socket, whose file exists a moment before."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        return client.connect_ex(str(path)) == 0


def read_clean_log(path):
    """Returns the messages of a canwired, which must not come from sanitizers."""
    text = path.read_text()
    assert "Sanitizer" not in text and "runtime error" not in text, text
    return text


def stop_canwired(process, log):
    """Ends a canwired, which ends well; its messages."""
    process.send_signal(signal.SIGTERM)
    assert process.wait(TIMEOUT_S) == 0, log.read_text()
    return read_clean_log(log)


def kill_all(processes):
    """Kills those that still run."""
    for process in processes:
        if process.poll() is None:
            process.kill()
            process.wait()
