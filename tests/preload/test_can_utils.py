# SPDX-License-Identifier: MIT
"""The programs of can-utils, as Debian has them, at nodes of a bus."""

import re
import sys

from simtool import canwire
from test_record import wait_until


def lines(program, count):
    return [program.stdout.readline().rstrip("\n") for _ in range(count)]


def test_candump_shows_what_cansend_sends(bus):
    r = bus(bus=", dbitrate: 2000000")
    dump = r.begin("dash", "candump", "-t", "a", "-x", "dash")
    r.wait_for_clients("dash", 1)
    for node, frame in (("engine", "123#DEADBEEF"), ("tester", "124#R4"), ("dash", "12345678#00"),
                        ("engine", "125##1112233")):
        r.run(node, "cansend", node, frame)
    shown = [re.sub(r" +", " ", line).strip() for line in lines(dump, 4)]
    assert all(re.match(r"\(\d{10}\.\d{6}\) ", line) for line in shown)
    assert [line.split(" ", 1)[1] for line in shown] == [
        "dash RX - - 123 [4] DE AD BE EF", "dash RX - - 124 [4] remote request",
        "dash TX - - 12345678 [1] 00", "dash RX B - 125 [03] 11 22 33"]
    r.stop()


def test_candump_with_filters_error_frames_and_several_interfaces(bus):
    r = bus()
    one = r.begin("dash", "candump", "-e", "dash,120:7F0,#FFFFFFFF")
    both = r.begin("engine=can0 dash=can1", "candump", "-L", "any")
    r.wait_for_clients("dash", 2)
    r.run("engine", "cansend", "engine", "200#01")
    r.run("engine", "cansend", "engine", "12A#02")
    assert one.stdout.readline().split() == ["dash", "12A", "[1]", "02"]
    shown = sorted(line.split(maxsplit=1)[1] for line in lines(both, 4))
    assert shown == ["can0 12A#02", "can0 200#01", "can1 12A#02", "can1 200#01"]
    canwire("inject", "./share.sock", "{ name: off, do: { bus-off: dash } }", cwd=r.folder)
    shown = "".join(lines(one, 2))
    assert "ERRORFRAME" in shown and "bus-off" in shown
    r.stop()


FILTERED = """
import socket, struct
for _ in range(50):
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as one:
        one.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", 0x123, 0x7FF))
        one.bind(("dash",))
        one.settimeout(0.005)
        try:
            print(one.recv(16))
        except TimeoutError:
            pass
print("over")
"""


def test_a_socket_with_a_filter_gets_nothing_else_from_its_bind_on(bus):
    """On a bus that is full of other frames."""
    r = bus()
    canwire("inject", "./share.sock", "{ name: full, do: { babble: 100#11, as: idle } }",
            cwd=r.folder)
    done = r.run("dash", sys.executable, "-c", FILTERED)
    assert done.stdout == "over\n"
    r.stop()


def test_candump_ends_with_the_interface_unless_asked(bus):
    r = bus()
    dump = r.begin("dash", "candump", "dash")
    stays = r.begin("dash", "candump", "-D", "dash")
    r.wait_for_clients("dash", 2)
    r.stop()
    assert "interface down" in stays.stdout.readline()
    assert dump.communicate(timeout=60)[0] == "read: Network is down\n"
    r.start()
    r.wait_for_clients("dash", 1)
    r.run("engine", "cansend", "engine", "321#AB")
    assert stays.stdout.readline().split() == ["dash", "321", "[1]", "AB"]
    r.stop()


def test_cangen_and_canplayer(bus):
    r = bus(bus=", dbitrate: 2000000", engine=", order: fifo")
    dump = r.begin("dash", "candump", "-L", "-n", "60", "dash")
    r.wait_for_clients("dash", 1)
    r.run("engine", "cangen", "engine", "-n", "60", "-g", "0", "-m", "-I", "r")
    log = dump.communicate(timeout=60)[0]
    assert log.count("\n") == 60
    (r.folder / "log").write_text(log.replace(" dash ", " engine "))
    again = r.begin("dash", "candump", "-L", "-n", "60", "dash")
    r.wait_for_clients("dash", 1)
    r.run("engine", "canplayer", "-t", "-I", "log")
    repeated = again.communicate(timeout=60)[0]
    assert [line.split()[2] for line in repeated.splitlines()] == [
        line.split()[2] for line in log.splitlines()]
    r.stop()


def test_candump_writes_its_log(bus):
    r = bus()
    dump = r.begin("dash", "candump", "-l", "-n", "3", "dash")
    r.wait_for_clients("dash", 1)
    r.run("engine", "cangen", "engine", "-n", "3", "-g", "1", "-I", "77", "-L", "1", "-D", "i")
    dump.wait(60)
    log = next(r.folder.glob("candump-*.log")).read_text()
    assert [line.split()[1:] for line in log.splitlines()] == [
        ["dash", f"077#0{number}"] for number in range(3)]
    r.stop()


def test_cansequence_loses_nothing_against_a_full_queue(bus):
    """The sender waits where the kernel's vcan would not make it wait."""
    r = bus(engine=", queue: 16")
    dash = r.client("dash")
    sends = r.begin("engine", "cansequence", "engine", "-p", "--loop=600")
    numbers = [dash.receive().data[0] for _ in range(600)]
    assert numbers == [number % 256 for number in range(600)]
    assert sends.wait(60) == 0
    assert r.nodes()["engine"]["interface"]["pushed_back"] > 0
    r.stop()


def test_cansequence_receives(bus):
    r = bus()
    receives = r.begin("dash", "cansequence", "dash", "-r", "-v", "-q")
    r.wait_for_clients("dash", 1)
    r.run("engine", "cansequence", "engine", "-p", "--loop=300")
    wait_until(lambda: r.nodes()["dash"]["rx_frames"] == 300, "the frames")
    assert receives.poll() is None  # -q: it would have ended at a wrong number
    r.stop()


def test_cansniffer_shows_changes(bus):
    """It uses CAN_BCM."""
    r = bus()
    sniffer = r.begin("dash", "cansniffer", "dash", "-t", "0", "-l", "1")
    r.wait_for_clients("dash", 1)
    engine = r.client("engine")
    seen = ""
    for number in range(200):
        engine.send(0x123, bytes([0xC0, number]))
        seen += sniffer.stdout.read(40)
        if "123" in seen and "C0" in seen:
            break
    assert "123" in seen and "C0" in seen, seen
    r.stop()


def test_canbusload_measures(bus):
    r = bus()
    load = r.begin("dash", "canbusload", "dash@500000")
    r.wait_for_clients("dash", 1)
    sends = r.begin("engine", "cangen", "engine", "-g", "2", "-I", "123", "-L", "2", "-D", "i")
    counts = []
    while not any(counts):
        found = re.match(r" dash@500000 +(\d+) +(\d+) +(\d+) +(\d+)%", load.stdout.readline())
        counts += [int(found[1])] if found else []
    assert counts[-1] > 0
    sends.kill()
    r.stop()
