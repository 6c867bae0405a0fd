# SPDX-License-Identifier: MIT
"""README.md: "Watch a bus"."""

from readme import Session, example
from simtool import listens
from test_record import wait_until


def test_a_bus_is_watched(tmp_path):
    text, (bus, show, watch, top) = example("seen")
    (tmp_path / "seen.yaml").write_text(text)
    with Session(tmp_path) as session:
        session.run(bus)
        wait_until(lambda: listens(tmp_path / "seen.sock"), "the bus")
        assert session.run(show).count("0x123") == 3
        assert session.run(watch).count("123#DEADBEEF") > 0
        assert {"BUS", "NODE", "seen", "engine", "dash"} <= set(session.run(top).split())
