# SPDX-License-Identifier: MIT
"""A server that is no canwired, and answers with texts that a terminal obeys: no command shows them
as they are."""

import contextlib
import json
import os
import re
import socket
import subprocess
import threading

import pytest

from busrig import BusRig
from simtool import CANWIRE

PATIENCE_S = 60
EVIL = "\x1b[31m\x9b1m\u202egnp.\u2066\u200b\ufeff"  # colours, turned round, hidden
HIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f"
                    "\ufeff]")


class Real(BusRig):
    CONTROL = "real.sock"
    TEXT = """bus: {{ name: real, bitrate: 500000 }}
control: real.sock
nodes:
  - {{ name: a, port: "unix:a.sock" }}
  - {{ name: b }}
faults: [ {{ name: off, when: {{ manual: yes }}, do: {{ bus-off: a }} }} ]
"""


def evil(value):
    """Adds the text to all texts and keys of a value."""
    if isinstance(value, str):
        return value + EVIL
    if isinstance(value, list):
        return [evil(one) for one in value]
    if isinstance(value, dict):
        both = {key: evil(one) for key, one in value.items()}
        return {**both, **({"more" + EVIL: "more"} if both else {})}
    return value


EVENTS = [{"t": 1.0, "node": "a", "event": "state", "state": "bus-off"},
          {"t": 1.5, "node": "a", "event": "tx", "frame": "123#"},
          {"t": 2.0, "event": "fault", "rule": "off", "hit": 1}]
REFUSALS = {
    "errors": [{"ok": False, "errors": [EVIL, 5, None, "f:1:2: " + EVIL]}],
    "error": [{"ok": False, "error": EVIL}],
    "no reason": [{"ok": False, EVIL: EVIL}],
    "no object": [EVIL],
    "no JSON": [None],
}


class Server:
    """Answers each request of each client with the same lines, and ends the connection."""

    def __init__(self, path, answer):
        self.answer = answer
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.bind(str(path))
        self.socket.listen()
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            try:
                client, _ = self.socket.accept()
            except OSError:
                return
            threading.Thread(target=self.serve, args=(client,), daemon=True).start()

    def serve(self, client):
        with contextlib.suppress(OSError), client, client.makefile("rwb") as lines:
            for line in lines:
                lines.write(self.answer(json.loads(line)))
                lines.flush()
                if b"watch" in line:
                    break

    def close(self):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()


def encoded(answers, raw):
    """Writes lines: characters as they are, or in the notation of JSON."""
    return b"".join((json.dumps(one, ensure_ascii=not raw) if one is not None else
                     '{ "' + EVIL).encode() + b"\n" for one in answers)


COMMANDS = [["set", "BUS", "a", "queue=5"], ["restart", "BUS", "a"], ["clear", "BUS"],
            ["clear", "BUS", "off"], ["fire", "BUS", "off"], ["reload", "BUS"],
            ["inject", "BUS", "{ name: x, do: { bus-off: a } }"], ["status", "BUS"],
            ["status", "BUS", "--json"], ["faults", "BUS"], ["faults", "BUS", "--json"],
            ["watch", "BUS", "--text"], ["watch", "BUS", "--json"], ["top", "BUS", "--once"],
            ["record", "BUS", "--format", "candump", "-"],
            ["run", "--bus", "BUS", "--as", "a", "--", "true"],
            ["run", "--bus", "BUS", "--as", "none", "--", "true"]]


def assert_plain(folder, words):
    done = subprocess.run([CANWIRE, *(word.replace("BUS", "./evil.sock") for word in words)],
                          cwd=folder, capture_output=True, timeout=PATIENCE_S, check=False,
                          stdin=subprocess.DEVNULL)
    assert done.returncode >= 0, (words, done.stderr)
    for text in (done.stdout, done.stderr):
        assert not HIDDEN.search(text.decode()), (words, text)
    return done.stdout + done.stderr


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("kind", REFUSALS)
def test_refusals_are_shown_plain(tmp_path, kind, raw):
    server = Server(tmp_path / "evil.sock", lambda _: encoded(REFUSALS[kind], raw))
    for words in COMMANDS:
        assert_plain(tmp_path, words)
    server.close()


@pytest.mark.parametrize("raw", [False, True])
def test_answers_are_shown_plain(tmp_path, raw):
    rig = Real(tmp_path)
    true = {request: json.loads(rig.run(request, "./real.sock", "--json").stdout)
            for request in ("status", "faults")}
    rig.stop()

    def answer(request):
        kind = request["request"]
        reply = {"ok": True, "warnings": [EVIL], "rules": [EVIL], "cleared": 1}
        if kind in true:
            reply[kind] = evil(true[kind])
        return encoded([reply, *([evil(e) for e in EVENTS] if kind == "watch" else [])], raw)

    server = Server(tmp_path / "evil.sock", answer)
    shown = b"".join(assert_plain(tmp_path, words) for words in COMMANDS)
    server.close()
    assert shown.count(b"gnp.") > 50  # the rest of the text is left
    assert not os.path.exists(tmp_path / "evil.sock.lock")
