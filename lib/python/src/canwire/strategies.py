# SPDX-License-Identifier: MIT
"""Strategies of hypothesis: frames, traffic, faults and whole scenarios.

    @given(scenario=scenarios(nodes=["engine", "dash"]))
    def test_every_frame_arrives(scenario):
        ...

A failing example becomes the smallest scenario that fails, and is printed as YAML.
"""

from __future__ import annotations

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


def traffic(nodes: Sequence[str], most: int = 8, within_us: int = 10_000,
            **options: Any) -> st.SearchStrategy[list[tuple[str, Frame, int]]]:
    """Returns lists of (node, frame, microseconds): what nodes send, and when; at most so many
    frames. options: those of frames()."""
    return st.lists(st.tuples(st.sampled_from(list(nodes)), frames(**options),
                              st.integers(0, within_us)), max_size=most)


def _positions() -> st.SearchStrategy[str]:
    def indexed(name: str) -> st.SearchStrategy[str]:
        last = FIELDS[name]
        return st.integers(0, last).map(lambda n: f"{name}[{n}]") if last else st.just(name)

    bits = st.tuples(st.integers(0, 7), st.integers(0, 7)).map(lambda b: f"data[{b[0]}.{b[1]}]")
    return st.one_of(st.sampled_from(sorted(FIELDS)).flatmap(indexed), bits)


def actions(nodes: Sequence[str]) -> st.SearchStrategy[dict[str, Any]]:
    """Returns what a rule does: bits of the wire or of nodes, levels, controllers, frames."""
    node = st.sampled_from(list(nodes))
    some = st.lists(node, min_size=1, max_size=len(nodes), unique=True)
    level = st.sampled_from(["dominant", "recessive"])
    return st.one_of(
        st.fixed_dictionaries({"flip": _positions()}, optional={"at": some}),
        st.fixed_dictionaries({"force": level, "from": _positions(), "bits": st.integers(1, 12)},
                              optional={"at": some}),
        st.fixed_dictionaries({"no-ack": some}),
        st.fixed_dictionaries({"wrong-crc": some}),
        st.fixed_dictionaries({"error-flag": some}),
        st.fixed_dictionaries({"bus-off": some}),
        st.fixed_dictionaries({"stuck": level, "for": st.integers(1, 200).map("{}bit".format),
                               "on": node.map("{}.tx".format)}),
        st.fixed_dictionaries({"disconnect": some,
                               "for": st.integers(1, 2000).map("{}bit".format)}),
        st.fixed_dictionaries({"delay": st.integers(1, 5000).map("{}us".format)}),
        st.fixed_dictionaries({"drop": st.sampled_from(["rx", "tx"])}))


def faults(nodes: Sequence[str], most: int = 3,
           what: st.SearchStrategy[dict[str, Any]] | None = None
           ) -> st.SearchStrategy[list[dict[str, Any]]]:
    """Returns lists of rules for frames, which act once or a few times. what: actions."""
    when = st.fixed_dictionaries({"count": st.integers(1, 20)}, optional={
        "from": st.sampled_from(list(nodes)), "skip": st.integers(0, 5)})
    what = actions(nodes) if what is None else what
    pairs = st.lists(st.tuples(when, what), max_size=most)
    return pairs.map(lambda rules: [_rule(number, *rule) for number, rule in enumerate(rules, 1)])


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
