# SPDX-License-Identifier: MIT
"""canwire run: how it finds nodes and the library, what it refuses, and the end of programs."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from compiled import compiled
from conftest import BUS
from simtool import CANWIRE, CANWIRED, ROOT, TIMEOUT_S, canwire, kill_all
from test_record import wait_until

SOCKET = "import errno, os, socket\nS = socket.socket(29, 3, 1)\n"  # PF_CAN, SOCK_RAW, CAN_RAW


def refused(folder, *words, status=1, **environment):
    done = subprocess.run([CANWIRE, "run", "--wait", "0", *map(str, words)], cwd=folder,
                          capture_output=True, text=True, check=False,
                          env={**os.environ, **environment})
    assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
    return done.stderr


@pytest.mark.parametrize("node, why", [
    ("nobody", "node 'nobody' of bus no-guests.yaml: there is no such node, and there are no "
     "guests; it has: engine, dash, idle, real"),
    ("idle", "it has no port: it needs 'port: unix:PATH' (canwire-ports(7))"),
    ("real", "its port is vcan77: it needs 'port: unix:PATH', or the program needs no canwire run"),
    ("engine", r"/engine\.sock: No such file or directory \(does canwired run\?\)"),
])
def test_nodes_that_cannot_be_used(tmp_path, node, why):
    text = BUS.format(bitrate=500000, bus="", engine="")
    (tmp_path / "no-guests.yaml").write_text(re.sub("guests:.*\n", "", text))
    said = refused(tmp_path, "--bus", "no-guests.yaml", "--as", node, "true")
    assert re.search(why if "\\" in why else re.escape(why), said), said


@pytest.mark.parametrize("words, status, why", [
    (["true"], 2, "usage: canwire run --bus BUS --as NODE"),
    (["--as", "engine", "true"], 1, "--as engine: --bus must stand before it"),
    (["--bus", "x.yaml", "--as", "a", "--interface", "can0", "--interface", "can1", "true"], 1,
     "--interface can1: this node is can0 already; --as comes first, for each node"),
    (["--bus", "b", "--interface", "can0", "true"], 1, "--interface can0: --as must stand before"),
    (["--bus", "b", "--as", "a-very-long-name", "true"], 1,
     "'a-very-long-name' cannot be the name of an interface, which has at most 15 characters"),
    (["--bus", "b", "--as", "x", "--interface", "a/b", "true"], 1, "'a/b' cannot be the name"),
    (["--bus", "b", "--as", "x", "--as", "x", "true"], 1, "two interfaces are called 'x'"),
    (["--bus", "no-such", "--as", "x", "true"], 1, "no-such: no such bus"),
    (["--bus", "b", "--as", "x"], 2, "usage: canwire run"),
])
def test_wrong_command_lines(tmp_path, words, status, why):
    assert why in refused(tmp_path, *words, status=status)


def test_a_rig_has_several_buses(tmp_path):
    rig = ROOT / "config/rig/rig.yaml"
    said = refused(tmp_path, "--bus", rig, "--as", "x", "true")
    assert said == f"canwire run: {rig} is a rig: --bus names one of its buses\n"


def test_the_library_must_be_there(bus, tmp_path):
    bus()
    words = ["--bus", "./share.sock", "--as", "engine", "true"]
    said = refused(tmp_path, *words, CANWIRE_PRELOAD="/no/such.so")
    assert "libcanwire-socketcan.so is not found: CANWIRE_PRELOAD names its path" in said
    with_blank = tmp_path / "a b.so"
    with_blank.touch()
    said = refused(tmp_path, *words, CANWIRE_PRELOAD=str(with_blank))
    assert "blanks and colons cannot be in this path" in said


def test_the_status_of_the_program_is_told(bus, tmp_path):
    r = bus()
    r.run("engine", "sh", "-c", "exit 7", status=7)
    assert "no-such: No such file" in r.run("engine", "no-such", status=127).stderr
    assert "Permission denied" in r.run("engine", tmp_path, status=126).stderr
    r.stop()


# As the Go compiler leaves it in a program, beside other notes.
GO_NOTE = r"""
__asm__(".pushsection .note.other,\"a\",@note\n.long 4, 1, 1\n.asciz \"abc\"\n.long 7\n"
        ".section .note.go.buildid,\"a\",@note\n.long 4, 2, 4\n.asciz \"Go\"\n"
        ".byte 0, 88, 89, 0, 0\n"
        ".popsection");
"""


def test_programs_out_of_reach_are_warned_of(bus, tmp_path):
    r = bus()
    main = "int main(void) { return 5; }\n"
    for name, text, option, status, why in (
            ("static", main, "-static", 5, "it is linked statically"),
            ("go", GO_NOTE + main, "-O0", 5,
             "it is written in Go, which makes system calls without the C library"),
            ("musl", main, "-Wl,--dynamic-linker=/lib/ld-musl-none.so.1", 127,
             "it is made for another C library, musl")):
        (tmp_path / f"{name}.c").write_text(text)
        subprocess.run(["cc", option, "-o", name, f"{name}.c"], cwd=tmp_path, check=True)
        said = r.run("engine", f"./{name}", status=status).stderr
        assert said.startswith(f"canwire run: ./{name} will find no interfaces: {why}; see "
                               "canwire-run(7)\n")
    assert r.run("engine", "true").stderr == r.run("engine", "/bin/true").stderr == ""
    r.stop()


def test_an_installed_canwire_finds_its_library(bus, tmp_path):
    r = bus()
    prefix = tmp_path / "usr"
    for place in ("bin/canwire", "lib/canwire/libcanwire-socketcan.so"):
        (prefix / place).parent.mkdir(parents=True)
        built = os.path.join(os.path.dirname(CANWIRE), os.path.basename(place))
        shutil.copy(built, prefix / place)
    done = subprocess.run([prefix / "bin/canwire", "run", "--bus", "./share.sock", "--as", "dash",
                           "env"], cwd=tmp_path, capture_output=True, text=True, check=True,
                          env={**os.environ, "LD_PRELOAD": ""})
    assert f"LD_PRELOAD={prefix}/bin/../lib/canwire/libcanwire-socketcan.so\n" in done.stdout
    assert f"CANWIRE_SOCKETCAN=dash\t16\tnode\tdash\t{tmp_path}/dash.sock\n" in done.stdout
    r.stop()


def test_a_bus_by_its_configuration_and_both_names(bus):
    r = bus()
    dash = r.client("dash")
    (r.folder / "deep").mkdir()
    for name in "can0", "engine":
        subprocess.run([CANWIRE, "run", "--bus", "../bus.yaml", "--as", "engine", "--interface",
                        "can0", "cansend", name, "123#11"], cwd=r.folder / "deep", check=True)
        assert dash.receive().can_id == 0x123
    r.stop()


def test_the_examples_of_the_page(bus):
    r = bus()
    page = (ROOT / "daemon/man/canwire-run.7.md").read_text()
    example = re.search(r"```sh\n(.*?)```", page, re.DOTALL)[1]
    first, listen, send = [line for line in example.splitlines() if line]
    assert first.startswith("canwired -c rig.yaml --background")
    os.symlink("bus.yaml", r.folder / "rig.yaml")
    tool = {**os.environ, "PATH": f"{os.path.dirname(CANWIRE)}:{os.environ['PATH']}"}
    r.programs.append(subprocess.Popen(["sh", "-c", f"exec {listen}"], cwd=r.folder, text=True,
                                       env=tool, stdout=subprocess.PIPE))
    r.wait_for_clients("engine", 1)
    subprocess.run(["sh", "-c", send], cwd=r.folder, env=tool, check=True)
    assert r.programs[0].stdout.readline().split() == "engine 123 [4] DE AD BE EF".split()
    r.stop()


# ---- Guests --------------------------------------------------------------------------------------


def test_a_guest_that_sends_and_ends_loses_nothing(bus):
    """A frame takes 5 ms here, and the bus has others to send."""
    r = bus(bitrate=20000)
    dash, engine = r.client("dash"), r.client("engine")
    for number in range(6):
        for _ in range(3):
            engine.send(0x001, bytes(8))
        r.run("tester", "cansend", "tester", f"{0x400 + number:03X}#1122334455667788")
    got = [dash.receive().can_id for _ in range(24)]
    assert [can_id for can_id in got if can_id != 1] == [*range(0x400, 0x406)]
    quick = SOCKET + "S.bind(('tester',)); S.send(bytes([1, 5, 0, 0]) + bytes(12))\n"
    r.run("tester", sys.executable, "-c", quick + "os._exit(0)")
    assert dash.receive().can_id == 0x501
    forks = SOCKET + "S.bind(('tester',))\nif os.fork() == 0: os._exit(0)\n"
    r.run("tester", sys.executable, "-c", forks + "os.wait(); S.send(bytes([2, 5]) + bytes(14))")
    assert dash.receive().can_id == 0x502
    wait_until(lambda: r.nodes()["guest-1"]["link"] != "up", "the end of the guest")
    r.stop()


def test_a_socket_that_threads_share_is_flushed_at_its_end(bus, threads):
    """A thread that receives may read the answer to the flush. The closing one would wait for it
    for 10 s in each of 8 rounds, longer than the program may take."""
    r = bus()
    dash = r.client("dash")
    lines = r.run("probe", threads, "probe").stdout.splitlines()
    assert lines == ["closed"] * 8
    sent = [0x100 + 0x10 * writer + i for writer in range(4) for i in range(10)]
    for _ in range(8):
        assert sorted(dash.receive().can_id for _ in sent) == sent
    r.stop()


def test_each_socket_of_a_guest_is_a_node(bus):
    r = bus()
    program = SOCKET + """
import sys, time
T = socket.socket(29, 3, 1)
S.bind(('tester',)); T.bind(('tester',))
S.send(bytes([1, 5, 0, 0]) + bytes(12))
print(T.recv(16)[0], flush=True)
sys.stdin.read()
"""
    running = subprocess.Popen(r.words("tester", sys.executable, "-c", program), cwd=r.folder,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    r.programs.append(running)
    assert running.stdout.readline() == "1\n"
    nodes = r.nodes()
    assert nodes["tester"]["link"] == nodes["tester-2"]["link"] == "up"
    running.communicate("")
    wait_until(lambda: r.nodes()["guest-1"]["link"] != "up", "the end of the guest")
    r.stop()


# ---- The bus goes --------------------------------------------------------------------------------


def next_but(program, *passed):
    """Returns the next line of a program that is none of those: two interfaces repeat some, and
    one sees what the other one sends."""
    line = program.stdout.readline()
    while line in passed:
        line = program.stdout.readline()
    return line


@pytest.mark.parametrize("nodes, name, wait", [
    ("engine", "'engine',", "select.select([S], [], [])"),
    ("engine dash", "'',", "select.select([S], [], [])"),
    ("engine", "'engine',", "E.poll()"),
], ids=["one", "all", "epoll"])
def test_a_bus_that_goes_and_comes_again(bus, nodes, name, wait):
    r = bus()
    program = SOCKET + f"""
import select
E = select.epoll()
E.register(S, select.EPOLLIN)  # before it is bound, as libraries do
S.bind(({name}))
print('bound', flush=True)
while True:
    {wait}
    try:
        print(S.recv(16)[0], flush=True)
    except OSError as error:
        print(errno.errorcode[error.errno], flush=True)
    try:
        S.sendto(bytes(16), ('engine',))
    except OSError as error:
        print('sending', errno.errorcode[error.errno], flush=True)
"""
    running = r.begin(nodes, sys.executable, "-c", program)
    assert running.stdout.readline() == "bound\n"
    r.client("dash").send(0x11)
    assert running.stdout.readline() == "17\n"
    r.stop()
    assert next_but(running, "17\n", "0\n", "sending ENETDOWN\n") == "ENETDOWN\n"
    assert next_but(running, "17\n", "ENETDOWN\n") == "sending ENETDOWN\n"
    r.start()
    r.wait_for_clients("engine", 1)
    r.client("dash").send(0x12)
    assert next_but(running, "0\n", "17\n", "ENETDOWN\n",
                    "sending ENETDOWN\n") == "18\n"
    r.stop()


def test_a_bus_that_is_not_there(bus):
    r = bus()
    environment = r.run("engine", "env").stdout
    r.stop()
    value = re.search("CANWIRE_SOCKETCAN=(.*)\n", environment)[1]
    library = re.search("LD_PRELOAD=(.*)\n", environment)[1]
    done = subprocess.run([sys.executable, "-c", SOCKET + "S.bind(('engine',))"],
                          capture_output=True, text=True, check=False,
                          env={**os.environ, "LD_PRELOAD": library, "CANWIRE_SOCKETCAN": value})
    assert "Network is down" in done.stderr


def test_a_port_with_too_many_clients(bus):
    r = bus(engine=", clients: 1")
    first = r.client("engine")
    said = r.run("engine", "cansend", "engine", "001#", status=1).stderr
    assert "libcanwire-socketcan: engine: the port has as many clients as it takes" in said
    first.close()
    r.stop()


def test_a_program_that_reads_too_slowly_is_told_what_it_lost(bus):
    """SO_RXQ_OVFL counts the frames that had no room."""
    r = bus(bitrate=1000000)
    program = SOCKET + """
import sys
S.setsockopt(socket.SOL_SOCKET, 40, 1)
S.bind(('dash',))
print('bound', flush=True)
sys.stdin.readline()
lost = 0
while not lost:
    data, beside, flags, address = S.recvmsg(16, 100)
    lost = int.from_bytes(beside[0][2], 'little') if beside else 0
print(beside[0][:2], lost > 0)
"""
    slow = subprocess.Popen(r.words("dash", sys.executable, "-c", program), cwd=r.folder,
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    r.programs.append(slow)
    assert slow.stdout.readline() == "bound\n"
    sends = r.begin("engine", "cangen", "engine", "-g", "0", "-I", "1", "-L", "0", "-p", "10")
    wait_until(lambda: r.nodes()["dash"]["clients"][0]["lost"] > 0, "its losses")
    slow.stdin.write("read\n")
    slow.stdin.flush()
    assert slow.stdout.readline() == "(1, 40) True\n"
    sends.kill()
    r.stop()


# ---- Other programs ------------------------------------------------------------------------------


def test_other_descriptors_are_left_alone(bus):
    """A shell with pipes, files and sockets, with CAN sockets open beside."""
    r = bus()
    program = SOCKET + """
import subprocess
S.bind(('engine',))
fresh = os.open('/dev/null', os.O_RDONLY)
os.closerange(fresh, 4096)
a, b = socket.socketpair()
a.send(b'x' * 100)
assert b.recv(1000) == b'x' * 100
assert subprocess.run(['sh', '-c', 'echo out | cat; ls /proc/self/fd >/dev/null'],
                      capture_output=True).stdout == b'out\\n'
assert os.popen('echo again').read() == 'again\\n'
S.send(bytes(16))
for protocol, kind in (6, 2), (7, 2):  # CAN_ISOTP, CAN_J1939
    try:
        socket.socket(29, kind, protocol)
    except OSError as error:
        print(errno.errorcode[error.errno])
assert socket.if_nametoindex('lo') == 1 and socket.if_indextoname(1) == 'lo'
print({name for _, name in socket.if_nameindex()} >= {'lo', 'engine'})
"""
    said = r.run("engine", sys.executable, "-c", program).stdout
    assert said == "EPROTONOSUPPORT\n" * 2 + "True\n"
    r.stop()


def test_without_interfaces_it_does_nothing():
    library = os.path.join(os.path.dirname(CANWIRE), "libcanwire-socketcan.so")
    done = subprocess.run([sys.executable, "-c", SOCKET], capture_output=True, text=True,
                          check=False, env={**os.environ, "LD_PRELOAD": library})
    plain = subprocess.run([sys.executable, "-c", SOCKET], capture_output=True, text=True,
                           check=False)
    assert (done.returncode, done.stderr) == (plain.returncode, plain.stderr)


def test_it_exports_calls_of_the_c_library_alone():
    library = os.path.join(os.path.dirname(CANWIRE), "libcanwire-socketcan.so")
    listed = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True,
                            text=True, check=True).stdout
    names = {line.split()[-1].split("@")[0] for line in listed.splitlines()}
    source = (ROOT / "daemon/preload/hooks/real.h").read_text()
    assert names == set(re.findall(r"X\([^,]+, (\w+),", source)), names
    needs = subprocess.run(["readelf", "-d", library], capture_output=True, text=True,
                           check=True).stdout
    assert set(re.findall(r"NEEDED.*\[(.*?)\]", needs)) <= {"libc.so.6", "libdl.so.2",
                                                             "libpthread.so.0"}


def test_a_port_has_its_path_before_it_listens(tmp_path, monkeypatch):
    text = BUS.format(bitrate=500000, bus="", engine="").replace(', port: vcan77', "")
    (tmp_path / "bus.yaml").write_text(text)
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setenv("LD_PRELOAD", str(compiled("late_listen.so")))
    monkeypatch.setenv("LATE_LISTEN", str(tmp_path / "pipe"))
    program = subprocess.Popen([CANWIRE, "run", "--wait", "2min", "--bus", "bus.yaml", "--as",
                                "engine", sys.executable, "-c",
                                SOCKET + "S.bind(('engine',)); print('bound')"], cwd=tmp_path,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    daemon = subprocess.Popen([CANWIRED, "-c", "bus.yaml"], cwd=tmp_path)
    try:
        assert program.communicate(timeout=TIMEOUT_S)[0] == "bound\n"
    finally:
        kill_all([program, daemon])


def test_help_says_how(tmp_path):
    assert "canwire-run(7)" in canwire("run", "--help", cwd=tmp_path).stdout
