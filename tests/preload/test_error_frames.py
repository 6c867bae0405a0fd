# SPDX-License-Identifier: MIT
"""Error frames that a program writes reach the other programs of its node, as on a vcan.

The output of a real vcan is in `calls.expected`.
"""

import json
import sys

from simtool import canwire

WRITES = """
import socket, struct, sys
FRAME = struct.Struct("=IB3x8s")
name, = sys.argv[1:]
with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as one:
    one.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 1)
    one.setsockopt(socket.SOL_CAN_RAW, 2, 0x1FFFFFFF)
    one.bind((name,))
    for can_id, data in ((0x111, b"before"), (0x20000204, b"\\0\\x10\\0\\0\\0\\0\\x05\\x80"),
                         (0x20000040, bytes(8)), (0x222, b"after")):
        one.send(FRAME.pack(can_id, len(data), data))
        frame, _, flags, _ = one.recvmsg(16)
        own = bool(flags & socket.MSG_CONFIRM) and bool(flags & socket.MSG_DONTROUTE)
        print(f"{struct.unpack_from('=I', frame)[0]:X}", own)
"""

SHOWN = ["111#6265666F7265", "20000204#0010000000000580", "20000040#0000000000000000",
         "222#6166746572"]
OWN = ["111 True", "20000204 True", "20000040 True", "222 True"]


def test_other_programs_of_the_node_get_them_in_order(bus):
    r = bus()
    beside = r.begin("dash", "candump", "-L", "dash,0:0,#FFFFFFFF")
    some = r.begin("dash", "candump", "-L", "dash,0~0,#40")
    elsewhere = r.begin("engine", "candump", "-L", "engine,0:0,#FFFFFFFF")
    r.wait_for_clients("dash", 2)
    r.wait_for_clients("engine", 1)
    assert r.run("dash", sys.executable, "-c", WRITES, "dash").stdout.splitlines() == OWN
    assert [beside.stdout.readline().split()[2] for _ in SHOWN] == SHOWN
    assert some.stdout.readline().split()[2] == SHOWN[2]
    assert [elsewhere.stdout.readline().split()[2] for _ in range(2)] == [SHOWN[0], SHOWN[3]]
    status = json.loads(canwire("status", "./share.sock", "--json", cwd=r.folder).stdout)
    dash = next(node for node in status["nodes"] if node["name"] == "dash")
    assert dash["interface"]["errors_ignored"] == 2
    r.stop()
