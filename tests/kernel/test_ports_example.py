# SPDX-License-Identifier: MIT
"""canwire-ports(7): an ECU and a tester on other machines."""

import itertools
import sys

from cannelloni import Datagrams, pack
from conftest import ask_status, wait_until
from readme import Session, example


def written_to_tester(folder):
    status = ask_status(folder / "far.sock")
    return sum(client["written"] for node in status["nodes"] for client in node.get("clients", []))


def test_an_ecu_and_a_tester_on_other_machines(tmp_path):
    """A tester that has connected gets frames when it has chosen its mode."""
    text, (bus, logger) = example("far", "daemon/man/canwire-ports.7.md")
    (tmp_path / "far.yaml").write_text(text.replace("192.168.1.2", "127.0.0.2"))
    with Session(tmp_path) as session:
        session.run("ip link set lo up")
        session.run(bus)
        tester = session.run(logger.replace("192.168.1.1", "127.0.0.1").replace(
            "python3", sys.executable) + " &")
        engine = Datagrams("127.0.0.2").to(20000)
        numbers = itertools.cycle(range(256))

        def heard():
            engine.send(next(numbers), pack(0x123, b"\xde\xad\xbe\xef"))
            return written_to_tester(tmp_path)

        wait_until(heard, "the tester")
        line = tester.stdout.readline()
        while "123" not in line:
            line = tester.stdout.readline()
        assert "de ad be ef" in line
