# SPDX-License-Identifier: MIT
"""Strategies of hypothesis: frames, traffic, faults and whole scenarios.

    @given(scenario=scenarios(nodes=["engine", "dash"]))
    def test_every_frame_arrives(scenario):
        ...

A failing example becomes the smallest scenario that fails, and is printed as YAML.
"""

from __future__ import annotations

import itertools
from typing import Any, Sequence

from hypothesis import strategies as st

from .frame import LENGTHS, Frame
from .scenario import Scenario

FIELDS = {"sof": 0, "dlc[0]": 0, "crc": 14, "crc-delimiter": 0, "ack-slot": 0,
          "ack-delimiter": 0, "eof": 6, "id": 10}


def frames(fd: bool = False, extended: bool | None = None, remote: bool = False,
           ids: st.SearchStrategy[int] | None = None) -> st.SearchStrategy[Frame]:
    """Returns frames. fd: of CAN FD, too; extended: True and False are for one kind only;
    remote: remote frames, too."""
    @st.composite
    def draw_frame(draw: Any) -> Frame:
        long = draw(st.booleans()) if extended is None else extended
        number = draw(ids if ids is not None else st.integers(0, 0x1FFFFFFF if long else 0x7FF))
        if remote and draw(st.booleans()):
            return Frame(number, extended=long, remote=True, dlc=draw(st.integers(0, 8)))
        if fd and draw(st.booleans()):
            length = draw(st.sampled_from(LENGTHS))
            return Frame(number, draw(st.binary(min_size=length, max_size=length)), long, fd=True,
                         brs=draw(st.booleans()))
        return Frame(number, draw(st.binary(max_size=8)), long)

    return draw_frame()


def _some(slots: int, element: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Any]]:
    """Returns lists of up to so many elements, each of which is left out by one choice alone. In
    st.lists() it takes all the choices of an element, and hypothesis often leaves some in."""
    kept = st.tuples(*[st.booleans()] * slots)
    return st.tuples(kept, st.tuples(*[element] * slots)).map(
        lambda drawn: [one for keep, one in zip(*drawn) if keep])


def traffic(nodes: Sequence[str], most: int = 8, within_us: int = 10_000,
            **options: Any) -> st.SearchStrategy[list[tuple[str, Frame, int]]]:
    """Returns lists of (node, frame, microseconds): what nodes send, and when; at most so many
    frames. options: those of frames()."""
    return _some(most, st.tuples(st.sampled_from(list(nodes)), frames(**options),
                                 st.integers(0, within_us)))


def _positions() -> st.SearchStrategy[str]:
    fields = [f"{name}[{n}]" if last else name for name, last in sorted(FIELDS.items())
              for n in range(last + 1)]
    bits = [f"data[{byte}.{bit}]" for byte in range(8) for bit in range(8)]
    return st.sampled_from(fields + bits)


def _groups(nodes: Sequence[str]) -> list[list[str]]:
    """Returns the groups of nodes, small ones first; of many nodes those of 1, 2 and all."""
    sizes = range(1, len(nodes) + 1) if len(nodes) < 7 else (1, 2, len(nodes))
    return [list(group) for size in sizes for group in itertools.combinations(nodes, size)]


def _dict(**values: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Returns dicts; a value that is None is left out, which takes no other choices."""
    return st.fixed_dictionaries({key.replace("_", "-").strip("-"): value
                                  for key, value in values.items()}).map(
        lambda drawn: {key: value for key, value in drawn.items() if value is not None})


def actions(nodes: Sequence[str]) -> st.SearchStrategy[dict[str, Any]]:
    """Returns what a rule does: bits of the wire or of nodes, levels, controllers, frames."""
    node = st.sampled_from(list(nodes))
    groups = _groups(nodes)
    some, place = st.sampled_from(groups), st.sampled_from([None, *groups])
    level = st.sampled_from(["dominant", "recessive"])
    return st.one_of(
        _dict(flip=_positions(), at=place),
        _dict(force=level, from_=_positions(), bits=st.integers(1, 12), at=place),
        _dict(no_ack=some),
        _dict(wrong_crc=some),
        _dict(error_flag=some),
        _dict(bus_off=some),
        _dict(stuck=level, for_=st.integers(1, 200).map("{}bit".format),
              on=node.map("{}.tx".format)),
        _dict(disconnect=some, for_=st.integers(1, 2000).map("{}bit".format)),
        _dict(delay=st.integers(1, 5000).map("{}us".format)),
        _dict(drop=st.sampled_from(["rx", "tx"])))


def faults(nodes: Sequence[str], most: int = 3,
           what: st.SearchStrategy[dict[str, Any]] | None = None
           ) -> st.SearchStrategy[list[dict[str, Any]]]:
    """Returns lists of rules for frames, which act once or a few times. what: actions."""
    when = _dict(count=st.integers(1, 20), from_=st.sampled_from([None, *nodes]),
                 skip=st.integers(0, 5).map(lambda skip: skip or None))
    what = actions(nodes) if what is None else what
    return _some(most, st.tuples(when, what)).map(
        lambda rules: [_rule(number, *rule) for number, rule in enumerate(rules, 1)])


def _rule(number: int, condition: dict[str, Any], action: dict[str, Any]) -> dict[str, Any]:
    when = {"frame": "0:0", **condition}
    if "wrong-crc" in action:  # it names the senders itself
        when.pop("from", None)
    return {"name": f"rule-{number}", "when": when, "do": action}


def scenarios(nodes: Sequence[str] = ("a", "b", "c"), bitrate: int = 500_000,
              base: dict[str, Any] | None = None, rules: Any = None, sent: Any = None,
              ) -> st.SearchStrategy[Scenario]:
    """Returns scenarios: a bus with these nodes, or the configuration `base`, to which traffic
    and rules are added. rules and sent: strategies in place of faults() and traffic()."""
    start = base or {"bus": {"name": "drawn", "bitrate": bitrate},
                     "nodes": [{"name": name} for name in nodes]}
    names = [node["name"] if isinstance(node, dict) else node for node in start["nodes"]]

    rules = faults(names) if rules is None else rules
    sent = traffic(names) if sent is None else sent

    @st.composite  # its examples are shown as they are, not as calls
    def draw_scenario(draw: Any) -> Scenario:
        made = Scenario(start)
        for rule in draw(rules):
            made.add_rule(rule)
        for node, frame, microseconds in draw(sent):
            made.send(node, frame, microseconds * 1000)
        return made

    return draw_scenario()
