# SPDX-License-Identifier: MIT
"""A journal repeats counters and checksums in data, and the faults in them, to the byte.

Nodes have traffic of their own here, so this needs no CAN in the kernel. CANWIRE and CANWIRED are
the programs.
"""

import json
import re

import pytest

from simtool import kill_all
from test_retime import Watched

BUS = """bus: { name: day, bitrate: 500000, dbitrate: 2000000 }
control: day.sock
seed: 11
nodes:
  - name: engine
    traffic:
      - { send: 0C9#0000000000000000, every: 1ms, jitter: 300us,
          counter: { at: "1.3", bits: 5, max: 20, start: 7 },
          checksum: { kind: crc8-j1850, at: 0 } }
      - { send: "18FEF1FE##100112233445566778899AABBCCDDEEFF", every: 3ms,
          checksum: { kind: e2e-p5, at: 8, data-id: 0xBEEF } }
  - name: dash
    traffic:
      - { send: 0CA#00000102, every: 2ms, checksum: { kind: e2e-p1, at: 0, data-id: 0x123 } }
      - { send: 0CB#0001, every: 2ms }
  - { name: brake }
faults:
  - { name: coin, when: { frame: 0C9, probability: 0.2 }, do: { counter: stuck } }
  - { name: jump, when: { frame: 0CA, every: 5 }, do: { counter: skip } }
  - { name: wrong, when: { frame: "18FEF1FE", probability: 0.3 }, do: { checksum: wrong } }
  - { name: broken, when: { frame: 0C9, every: 7 }, do: { checksum: wrong } }
"""


@pytest.fixture(name="run")
def fixture_run(tmp_path):
    run = Watched(tmp_path, BUS)
    yield run
    kill_all((run.bus.process, run.watch))


def counters(run):
    """Returns the counters of the frames 0C9 in the live run."""
    return [int(data, 16) >> 8 * 6 & 0x1F
            for data in re.findall(r'"event":"tx"[^\n]*"frame":"0C9#(\w{16})"',
                                   run.live.read_text())]


def test_protected_traffic_with_faults_is_repeated(run):
    run.wait_events(100)
    run.bus.canwire("inject", "./day.sock",
                    "{ name: again, when: { frame: 0C9, probability: 0.1 }, "
                    "do: { counter: repeat } }")
    run.wait_events(100)
    run.bus.canwire("clear", "./day.sock", "coin")
    run.reload(("send: 0CB#0001, every: 2ms", "send: 0CB#0001, every: 2ms, counter: { at: 0 }"))
    run.wait_events(100)
    run.reload(("send: 0CB#0001, every: 2ms, counter: { at: 0 }", "send: 0CB#0001, every: 2ms"),
               ("seed: 11", "seed: 12"))
    run.wait_events(100)
    found = counters(run)
    journal = run.end()
    assert sum("reload" in line for line in journal) == 2 and json.dumps(journal).count("again") > 0
    pairs = list(zip(found, found[1:]))
    assert any(a == b for a, b in pairs) and sum((a + 1) % 21 == b for a, b in pairs) > 20
