# SPDX-License-Identifier: MIT
# pylint: disable=protected-access
"""The plugin of pytest: buses for tests, and what was on the wire when a test fails.

`canwire_sim(source)` makes a bus in virtual time, any number of them. `canwire_bus` is one, with
the configuration of `@pytest.mark.canwire(source)` or of the ini option `canwire_bus`.
`canwire_time` is the virtual time of `canwire_bus`: the whole test runs in it.

When a test fails, a folder gets the configuration (bus.yaml) and a scenario that repeats the test
without its program (scenario.yaml). It also gets the events (events.jsonl), a picture of the wire
(wire.svg) and its levels (wire.vcd), which the tool `canwire` draws. The report names the folder
and shows the last events. In JUnit XML the files are properties.
"""

from __future__ import annotations

import collections
import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess
from typing import Any, Callable

import pytest

from ._tool import find_tool
from .bus import Bus
from .scenario import Recording, is_text
from .virtualtime import VirtualTime

LAST_EVENTS = 12
PICTURE_NS = 1_000_000  # of the wire before the last error, and half of it behind
TOOL_S = 60

NAME_BYTES = 100  # of a folder, whose name also has a hash when it is longer

_recordings = pytest.StashKey[list]()
_names = pytest.StashKey[dict]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("canwire", "buses of canwire")
    group.addoption("--canwire-out", metavar="FOLDER", default="canwire-failures",
                    help="what was on the buses of tests that have failed; "
                         "default: canwire-failures")
    parser.addini("canwire_bus", "configuration of the bus of the fixture canwire_bus")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "canwire(source, **options): the bus of the fixture "
                            "canwire_bus, a file or its YAML; options of canwire.Bus")


def _find(request: pytest.FixtureRequest, source: Any) -> Any:
    """Files are relative to that of the test, else to the root of the tests."""
    if isinstance(source, dict) or is_text(source) or os.path.isabs(source):
        return source
    for folder in (request.path.parent, request.config.rootpath):
        if (folder / source).exists():
            return folder / source
    return source


@pytest.fixture
def canwire_sim(request: pytest.FixtureRequest) -> Any:
    """canwire_sim(source, **options) makes a canwire.Bus; of a file, of YAML or of a dict."""
    recordings = request.node.stash.setdefault(_recordings, [])

    def make(source: Any, **options: Any) -> Bus:
        source = _find(request, source)
        make_bus = Bus.from_dict if isinstance(source, dict) else Bus.from_yaml
        recordings.append(Recording(make_bus(source, **options), source,
                                    options.get("events", "all")))
        recordings[-1].bus._kept = True  # a report reads it after a test has closed it
        return recordings[-1].bus

    yield make
    for recording in recordings:
        recording.bus._kept = False
        recording.bus.close()
    recordings.clear()


@pytest.fixture
def canwire_bus(request: pytest.FixtureRequest, canwire_sim: Callable[..., Bus]) -> Bus:
    """The canwire.Bus of `@pytest.mark.canwire(source, **options)`."""
    marker = request.node.get_closest_marker("canwire")
    if marker is not None and marker.args:
        return canwire_sim(*marker.args, **marker.kwargs)
    source = request.config.getini("canwire_bus")
    if not source:
        pytest.fail("canwire_bus needs a configuration: @pytest.mark.canwire(SOURCE), or "
                    "canwire_bus = FILE in the ini file", pytrace=False)
    return canwire_sim(source)


@pytest.fixture
def canwire_time(canwire_bus: Bus) -> Any:
    """The canwire.VirtualTime of canwire_bus, in which the test runs."""
    with VirtualTime(canwire_bus) as clock:
        yield clock


# ---- when a test fails ---------------------------------------------------------------------------


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Any:
    outcome = yield
    report = outcome.get_result()
    recordings = item.stash.get(_recordings, [])
    if not report.failed or not recordings or report.when == "teardown":
        return
    top = pathlib.Path(item.config.getoption("canwire_out"))
    if not top.is_absolute():
        top = item.config.invocation_params.dir / top
    for number, recording in enumerate(recordings, 1):
        folder = top / f"{folder_name(item)}{f'-{number}' if number > 1 else ''}"
        closed, recording.bus._closed = recording.bus._closed, False
        story, bus = Story(recording, folder), recording.bus.name
        recording.bus._closed = closed
        report.sections.append((f"canwire: {bus}", story.text))
        for file in story.files:
            entry = (f"canwire.{bus}.{file.name}", str(file))
            item.user_properties.append(entry)
            report.user_properties.append(entry)


def folder_name(item: pytest.Item) -> str:
    """Returns the name of a test's folder, which no other test of the session has. All processes of
    pytest-xdist find the same."""
    if _names not in item.session.stash:
        plain = {one.nodeid: _plain(one.nodeid) for one in item.session.items}
        count = collections.Counter(plain.values())
        item.session.stash[_names] = {
            nodeid: name if count[name] == 1 and len(name.encode()) <= NAME_BYTES
            else _hashed(name, nodeid) for nodeid, name in plain.items()}
    names = item.session.stash[_names]
    return names.get(item.nodeid) or _hashed(_plain(item.nodeid), item.nodeid)


def _plain(nodeid: str) -> str:
    return re.sub(r"[^\w.-]+", "_", nodeid).strip("_")


def _hashed(name: str, nodeid: str) -> str:
    short = name.encode()[:NAME_BYTES].decode(errors="ignore")
    return f"{short}-{hashlib.sha256(nodeid.encode()).hexdigest()[:8]}"


class Story:
    """The run of a bus, as files and as a text."""

    def __init__(self, recording: Recording, folder: pathlib.Path):
        self.bus, self.folder = recording.bus, folder
        self.files: list[pathlib.Path] = []
        self.lines: list[str] = []
        events = [json.dumps(event, separators=(",", ":")) for event in self.bus.events()]
        self.lines.append(f"{self.bus.now:.9f} s of bus time, {len(events)} events" +
                          (", the last ones:" if events else ""))
        self.lines += [f"  {event}" for event in events[-LAST_EVENTS:]]
        try:
            self._write_files(recording, events)
        except OSError as problem:  # the report of the test matters more
            self.lines.append(f"files are missing: {problem}")

    def _write_files(self, recording: Recording, events: list[str]) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)  # of an earlier run
        self.folder.mkdir(parents=True)
        self._write("events.jsonl", "".join(f"{event}\n" for event in events))
        source = recording.source
        if isinstance(source, dict):
            self._write("bus.yaml", json.dumps(source, indent=1) + "\n")
        else:
            self._write("bus.yaml", source if is_text(source)
                        else pathlib.Path(source).read_text(encoding="utf-8"))
        try:
            self._repeat(recording)
        except ImportError:
            self.lines.append("no scenario.yaml: PyYAML is not installed")
        except Exception as problem:  # pylint: disable=broad-except
            self.lines.append(f"no scenario.yaml: {problem}")
        self.lines.append(f"files: {self.folder}: {', '.join(file.name for file in self.files)}")

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def _write(self, name: str, text: str) -> pathlib.Path:
        self.files.append(self.folder / name)
        self.files[-1].write_text(text, encoding="utf-8")
        return self.files[-1]

    def _repeat(self, recording: Recording) -> None:
        made, missing = recording.scenario()
        until = f"{self.bus.now_ns}ns"
        head = f"# canwire sim scenario.yaml --until {until} --events -\n"
        head += "".join(f"# not in it: {line}\n" for line in missing)
        file = self._write("scenario.yaml", head + made.yaml)
        if missing or not recording.same_events(made):
            self.lines.append("scenario.yaml has not all that the test did" +
                              "".join(f"\n  {line}" for line in missing))
        self._draw(file, until, recording.errors(made))

    def _draw(self, scenario: pathlib.Path, until: str, errors: list[int]) -> None:
        tool = find_tool()
        if tool is None:
            self.lines.append("no wire.svg, wire.vcd: there is no tool canwire in PATH")
            return
        begin, end = self._window(errors)
        words = [tool, "sim", "scenario.yaml", "--until", until, "--from", f"{begin}ns",
                 "--to", f"{end}ns", "--svg", "wire.svg", "--vcd", "wire.vcd"]
        done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True,
                              timeout=TOOL_S, check=False)
        if done.returncode:
            self.lines.append(f"no wire.svg, wire.vcd: {done.stderr.strip()}")
            return
        self.files += [scenario.with_name("wire.svg"), scenario.with_name("wire.vcd")]

    def _window(self, errors: list[int]) -> tuple[int, int]:
        """Returns the part of the wire that is drawn: the last error and its frame, or the end."""
        bit_ns = 1_000_000_000 / self.bus.buses[0].bitrate
        width = round(min(PICTURE_NS * 500_000 / self.bus.buses[0].bitrate, 1900 * bit_ns))
        centre = errors[-1] if errors else self.bus.now_ns - width // 2
        begin = max(centre - width // 2, 0)
        return begin, begin + width
