# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""A row of a campaign whose program is the bus by itself: `bus: own` in canwire-campaign(7).

    with canwire.row() as bus:
        threading.Thread(target=engine).start()  # python-can, can-isotp, asyncio

The program runs in the virtual time of the scenario of its row. At the end the scenario is written
with all that the program has handed in. `canwire campaign` makes the row of it.
"""

from __future__ import annotations

import json
import os
import pathlib
import threading
from typing import Any

from .bus import Bus, Error, Time
from .scenario import Recording, Scenario, from_yaml
from .virtualtime import Over, VirtualTime

REASON_BYTES = 200


def row(scenario: str | os.PathLike[str] | None = None, until: Time | None = None) -> Row:
    """Returns a context: the bus of the row for which a campaign has started this program.

    scenario, a file or its YAML, and until are for a program that is run by hand. Then nothing is
    written.
    """
    result = os.environ.get("CANWIRE_RESULT")
    if result:
        return Row(os.environ["CANWIRE_SCENARIO"], os.environ.get("CANWIRE_UNTIL"), result)
    if scenario is None:
        raise Error("canwire.row(): no campaign has started this program with `bus: own`; "
                    "give scenario= and until= to run it by hand")
    return Row(scenario, until, None)


def _told(problem: BaseException | None) -> str:
    """Returns an error as one line."""
    if problem is None:
        return ""
    return f"{type(problem).__name__}: {problem}".partition("\n")[0].removesuffix(": ")


def _cut(text: str) -> str:
    return text.encode(errors="replace")[:REASON_BYTES].decode(errors="ignore")


class Row:
    """The run of a program in the virtual time of a scenario, up to a time or to its end."""

    def __init__(self, source: Any, until: Time | None, result: str | None):
        self._source, self._until, self._result = source, until, result
        self._failed = ""
        self._bus: Any = None
        self._clock: Any = None
        self._recording: Any = None
        self._hook: Any = None

    def __enter__(self) -> Bus:
        self._bus = Bus.from_yaml(self._source)
        self._recording = Recording(self._bus, self._source)
        end_ns = None if self._until is None else self._bus._time_ns(self._until)
        self._clock = VirtualTime(self._bus, epoch=0)
        self._clock._end_threads(end_ns)
        self._clock.__enter__()
        self._hook, threading.excepthook = threading.excepthook, self._note_failure
        return self._bus

    def _note_failure(self, told: Any) -> None:
        """Is called when a thread ends with an error."""
        if not self._failed and not issubclass(told.exc_type, SystemExit):
            name = told.thread.name if told.thread else "a thread"
            self._failed = f"{name}: {_told(told.exc_value)}"
        self._hook(told)

    def __exit__(self, _kind: Any, problem: BaseException | None, _trace: Any) -> bool:
        ends = problem is None or isinstance(problem, SystemExit) and not problem.code
        try:
            if ends and self._until is not None:
                self._bus.run(self._until)
        except Over:
            pass
        finally:
            end_ns = self._clock.now_ns
            self._bus._observer = None  # threads that end do nothing in the row
            self._clock.__exit__()
            threading.excepthook = self._hook
        if not ends and not isinstance(problem, Over):
            self._failed = self._failed or _told(problem)
        broken = self._write(end_ns)
        self._bus.close()
        if ends or isinstance(problem, Over):
            if self._failed or broken:
                raise Error(self._failed or broken)
        return isinstance(problem, Over)

    def _write(self, end_ns: int) -> str:
        """Writes the result. Returns why there is no scenario in it, or ""."""
        if self._result is None:
            return ""
        text = broken = ""
        try:
            made, missing = self._recording.scenario()
            expected = from_yaml(self._source).get("expect")
            if missing:
                broken = "no scenario can say: " + ", ".join(missing)
            elif not self._recording.same_events(made):
                broken = "the scenario of the program has other events than its run"
            if expected:
                made = Scenario({**made.config, "expect": expected})
            text = made.yaml
        except Exception as problem:  # pylint: disable=broad-except
            broken = _told(problem)
        head = json.dumps({"until_ns": end_ns, "failed": _cut(self._failed),
                           "broken": _cut(broken)})
        part = pathlib.Path(self._result + ".part")
        part.write_text(f"# {head}\n{text}", encoding="utf-8")
        part.replace(self._result)
        return broken
