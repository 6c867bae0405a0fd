# SPDX-License-Identifier: MIT
"""README.md: programs where the kernel has no CAN."""

import json

from readme import PATIENCE_S, Session, example
from simtool import canwire, listens
from test_record import wait_until


def clients(folder):
    status = json.loads(canwire("status", "./ci.sock", "--json", cwd=folder).stdout)
    return sum(len(node.get("clients", [])) for node in status["nodes"])


def test_programs_run_without_can_in_the_kernel(tmp_path):
    text, (bus, listener, sender) = example("ci")
    (tmp_path / "ci.yaml").write_text(text)
    with Session(tmp_path) as session:
        session.run(bus)
        wait_until(lambda: listens(tmp_path / "ci.sock"), "the bus")
        candump = session.run(listener)
        wait_until(lambda: clients(tmp_path) == 1, "candump")
        session.run(sender)
        assert candump.communicate(timeout=PATIENCE_S)[0].split() == [
            "can0", "123", "[4]", "DE", "AD", "BE", "EF"]
