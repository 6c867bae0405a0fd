# SPDX-License-Identifier: MIT
"""Scenarios: a configuration with the frames and the faults that a program has put in.

Their text is a file for `canwire sim`, so a run of a program can be repeated without it.
"""

from __future__ import annotations

import copy
import json
import pathlib
import re
from typing import Any, Callable

from .bus import Bus, Error

_PLAIN = re.compile(r"[A-Za-z_][\w.:/-]*|\d+(\.\d+)?[a-z]*")
_NUMBER = re.compile(r"0\d+|[\d.]+e\d*|\d+\.\d*")  # other tools read these as numbers
_WORDS = {"yes", "no", "on", "off", "true", "false", "null", "y", "n"}


def _flow(value: Any) -> str:
    """Returns a value in one line, with quotes only where they are needed."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_flow(k)}: {_flow(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = str(value)
    if isinstance(value, str) and (not _PLAIN.fullmatch(text) or text.lower() in _WORDS
                                   or _NUMBER.fullmatch(text)):
        return json.dumps(text)
    return text


def to_yaml(config: dict[str, Any]) -> str:
    """Returns the YAML of a configuration: a line for each node, rule and expectation."""
    lines = []
    for key, value in config.items():
        if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
            lines += [f"{key}:", *(f"  - {_flow(entry)}" for entry in value)]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def is_text(source: Any) -> bool:
    """Returns True for YAML, False for the name of a file; as Bus.from_yaml() does."""
    return isinstance(source, str) and ("\n" in source or "{" in source)


def from_yaml(source: Any) -> dict[str, Any]:
    """Reads a configuration, all values as texts, with absolute paths. It needs PyYAML."""
    import yaml  # pylint: disable=import-outside-toplevel
    folder = pathlib.Path.cwd() if is_text(source) else pathlib.Path(source).resolve().parent
    try:
        text = source if is_text(source) else pathlib.Path(source).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise Error(f"there is no file {str(source)!r}; a text has a line end or a '{{'") from None
    config = yaml.load(text, Loader=yaml.BaseLoader)
    if not isinstance(config, dict):
        raise Error(f"{config!r} is no configuration")
    for entry in [traffic for node in config.get("nodes") or [] if isinstance(node, dict)
                  for traffic in node.get("traffic") or []] + (config.get("profiles") or []):
        for key in ("replay", "file"):
            if key in entry:
                entry[key] = str(folder / entry[key])
    return config


def _name(node: Any) -> str:
    return node["name"] if isinstance(node, dict) else str(node)


class Scenario:
    """A configuration as a dict, with the keys of canwire.yaml(5).

    It can be shown: its repr() is Scenario with its YAML.
    """

    def __init__(self, config: dict[str, Any] | str):
        self.config = from_yaml(config) if isinstance(config, str) else copy.deepcopy(config)
        if not isinstance(self.config, dict):
            raise Error(f"{config!r} is no configuration; expected a dict, or YAML of one")

    @property
    def yaml(self) -> str:
        return to_yaml(self.config)

    def __repr__(self) -> str:
        return f'Scenario("""\n{self.yaml}""")'

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and self.config == other.config

    def bus(self, **options: Any) -> Bus:
        """Makes the bus, at time 0; options as for Bus."""
        return Bus.from_yaml(self.yaml, **options)

    def run(self, until: Any = None, **options: Any) -> Bus:
        """Makes the bus and runs it: up to a time, or to the end of its traffic."""
        bus = self.bus(**options)
        bus.run(until)
        return bus

    def send(self, node: str, frame: Any, ns: int = 0) -> None:
        """Adds a frame to the traffic of a node."""
        for number, entry in enumerate(self.config["nodes"]):
            if _name(entry) == node:
                entry = dict(entry) if isinstance(entry, dict) else {"name": node}
                port = entry.pop("port", None)  # in a simulation nodes have a port or traffic
                if isinstance(port, dict) and "usb" in port:
                    entry.setdefault("order", "fifo")
                entry["traffic"] = [*entry.get("traffic", []),
                                    {"send": str(frame), "offset": _time(ns)}]
                self.config["nodes"][number] = entry
                return
        raise KeyError(node)

    def add_rule(self, rule: dict[str, Any]) -> None:
        self.config["faults"] = [*self.config.get("faults", []), rule]


def _time(ns: int) -> str:
    return f"{ns}ns" if ns else "0"


def _rules(text: str) -> list[dict[str, Any]]:
    """Returns the rules of a text for `inject`."""
    try:
        found = json.loads(text)
    except ValueError:
        import yaml  # pylint: disable=import-outside-toplevel
        found = yaml.load(text, Loader=yaml.BaseLoader)
    if isinstance(found, dict):
        found = found["faults"] if "faults" in found else [found]
    return found


class Recording:
    """The inputs of a bus by a program, to make a scenario of them. events: those that the bus
    keeps."""

    def __init__(self, bus: Bus, source: Any, events: str = "all"):
        self.bus, self.source = bus, source
        self.inputs: list[tuple[int, str, tuple[Any, ...]]] = []
        self.kept = [(0, events)]
        bus._observer = self._note

    def _note(self, what: str, *arguments: Any) -> None:
        if what == "reset":
            self.inputs.clear()
            self.kept = [(0, self.kept[-1][1])]
        elif what == "keep_events":
            self.kept.append((self.bus.now_ns, *arguments))
        else:
            self.inputs.append((self.bus.now_ns, what, arguments))

    def scenario(self) -> tuple[Scenario, list[str]]:
        """Returns the scenario, and the inputs that are not in it, as texts."""
        if len(self.bus.buses) > 1:
            raise ValueError("a rig is several files")
        made = Scenario(self.source if isinstance(self.source, dict) else from_yaml(self.source))
        made.config.pop("expect", None)  # the test has its own
        made.config["seed"] = str(self.bus.buses[0].seed)
        return made, _Repetition(made, self.bus._time_ns).repeat(self.inputs)

    def same_events(self, made: Scenario) -> bool:
        """Returns True when a scenario alone has the events of the bus up to now."""
        with made.bus(listen=False) as again:
            for ns, kinds in self.kept:
                if ns:
                    again.run(ns / 1e9)
                again.keep_events(kinds)
            again.run(self.bus.now)
            return again.events() == self.bus.events()

    def errors(self, made: Scenario) -> list[int]:
        """Returns the times of errors, in ns; of a scenario alone where the bus does not keep
        them."""
        events = self.bus.events("error")
        if not events and self.kept != [(0, "all")]:
            with made.bus(listen=False, events="error") as again:
                again.run(self.bus.now)
                events = again.events()
        return [round(event["t"] * 1e9) for event in events]


class _Repetition:
    """Puts inputs into a scenario. time_ns: reads a time."""

    def __init__(self, made: Scenario, time_ns: Callable[[str], int]):
        self.made, self.time_ns = made, time_ns
        self.missing: list[str] = []
        self.injected: dict[str, dict[str, Any]] = {}

    def repeat(self, inputs: list[tuple[int, str, tuple[Any, ...]]]) -> list[str]:
        for ns, what, arguments in inputs:
            known = getattr(self, f"_{what}", None)
            if known is not None:
                known(ns, *arguments)
            else:
                self._miss(ns, what, *arguments)
        return self.missing

    def _miss(self, ns: int, *words: Any) -> None:
        self.missing.append(f"{' '.join(map(str, words))} at {ns / 1e9:.9f} s")

    def _send(self, ns: int, node: str, frame: Any, at: int) -> None:
        self.made.send(node, frame, max(ns, at))

    def _inject(self, ns: int, text: str) -> None:
        for rule in _rules(text):
            rule = copy.deepcopy(rule)
            if self._in_file(rule["name"]):  # of a rule that is gone
                self._miss(ns, "the rule", rule["name"])
                continue
            when = dict(rule.get("when") or {})
            if ns and {"time", "after", "manual"} & set(when):
                self._miss(ns, "the rule", rule["name"])  # it may have acted before
            elif ns:
                when["time"] = f"{ns}ns.."
            if when:
                rule["when"] = when
            self.injected[rule["name"]] = rule
            self.made.add_rule(rule)

    def _in_file(self, name: str) -> dict[str, Any] | None:
        """Returns the rule of that name; those of profiles are not in the file."""
        return next((rule for rule in self.made.config.get("faults") or []
                     if isinstance(rule, dict) and rule.get("name") == name), None)

    def _clear(self, ns: int, name: str | None) -> None:
        """Ends rules that were injected, or the one of that name."""
        for one in [*self.injected] if name is None else [name]:
            self.injected.pop(one, None)
            rule = self._in_file(one)
            if rule is None:
                self._miss(ns, "clear", one)
                continue
            self._end(rule, ns)

    def _end(self, rule: dict[str, Any], ns: int) -> None:
        """Ends a rule of the file at a time."""
        when = dict(rule.get("when") or {})
        begin, dots, end = str(when.get("time", "0s..")).partition("..")
        if not dots or end:  # a moment, or an end that may come before
            self._miss(ns, "clear", rule["name"])
        elif self.time_ns(begin) >= ns:
            self.made.config["faults"].remove(rule)
        else:
            rule["when"] = {**when, "time": f"{begin}..{ns}ns"}

    def _restart(self, ns: int, node: str) -> None:
        self._act(ns, {"restart": node})

    def _set(self, ns: int, node: str, settings: dict[str, Any]) -> None:
        self._act(ns, {"set": node, **settings})

    def _act(self, ns: int, action: dict[str, Any]) -> None:
        name = f"by-hand-{len(self.made.config.get('faults', [])) + 1}"
        self.made.add_rule({"name": name, "when": {"time": _time(ns) if ns else "0s"},
                            "do": action})
