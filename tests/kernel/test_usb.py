# SPDX-License-Identifier: MIT
"""A real can0: the driver peak_usb on an adapter that canwire-usb emulates.

Needs the kernel's modules for it and the initial network namespace: the QEMU guest has both.
"""

import contextlib
import os
import re
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from adapters import (CANWIRE_USB, Rig, batch, can_info, counter, details, exists,
                      fixture_quiet_kernel,  # pylint: disable=unused-import
                      ip, lines_up, node, run, serial, state, tx_packets, up, usb_of)
from busclient import Client
from canbits import ERROR, FD, Frame
from conftest import (PATIENCE_S, RECEIVE_BUFFER_BYTES, ROOT, SO_RCVBUFFORCE, listeners,
                      wait_until)
from readme import Session
from test_faults import CANWIRE

pytestmark = pytest.mark.usefixtures("quiet_kernel")

ACCEPTED = 21  # on a bus that sends nothing: ten requests, txqueuelen 10, and one on the way
RAW_ERR_FILTER, LOSTARB = 2, 0x2
SO_TIMESTAMPING = 37
PLACES = 63  # for clients of a port
RAW_HARDWARE, RX_HARDWARE = 1 << 6, 1 << 2


if os.environ.get("CANWIRE_PLACE") == "host":
    # conftest.py leaves this one test alone
    def test_usb_in_the_guest():
        files = [Path(__file__).with_name(f"test_{name}.py")
                 for name in ("usb", "stacks", "readme")]
        words = ["-t", "600", "--", sys.executable, "-m", "pytest", "-q", "-k", "usb", *files]
        subprocess.run([ROOT / "scripts/guest", *words], check=True,
                       env=dict(os.environ, CANWIRE_GUEST="qemu"))


class Can:
    """A raw socket with all error frames."""

    def __init__(self, interface, fd=False, own=False):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_CAN_RAW, RAW_ERR_FILTER, 0x1FFFFFFF)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, int(fd))
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, int(own))
        self.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
        self.socket.bind((interface,))
        self.socket.settimeout(PATIENCE_S)

    def send(self, *texts):
        for text in texts:
            self.socket.send(Frame.parse(text).pack())

    def fill(self):
        """Returns the number of frames that are taken until ENOBUFS."""
        self.socket.setblocking(False)
        for i in range(1000):
            try:
                self.socket.send(Frame(0x100 + i, 1, bytes([i])).pack())
            except (BlockingIOError, OSError) as error:
                assert error.errno == 105, error  # ENOBUFS
                self.socket.settimeout(PATIENCE_S)
                return i
        raise AssertionError("it takes everything")

    def receive(self, count=1):
        """Returns frames, without error frames."""
        frames = []
        while len(frames) < count:
            frame = Frame.unpack(self.socket.recv(16))
            if not frame.can_id & ERROR:
                frames.append(frame)
        return frames

    def errors_until(self, bits):
        """Returns error frames up to the first of one of these classes: class and data[1]."""
        seen = []
        while not seen or not seen[-1][0] & bits:
            can_id, _, data = struct.unpack("=I4x1s7s", self.socket.recv(16))[:3]
            if can_id & ERROR:
                seen.append((can_id & ~ERROR, data[0]))
        return seen

    def errors_before(self, text):
        """Returns the error frames before a frame: class and data[0]."""
        seen = []
        while (frame := Frame.unpack(self.socket.recv(16))) != Frame.parse(text):
            if frame.can_id & ERROR:
                seen.append((frame.can_id & ~ERROR, frame.data[0]))
        return seen

    def close(self):
        self.socket.close()


@contextlib.contextmanager
def stopped(*processes):
    for process in processes:
        process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGCONT)


@pytest.fixture(name="can")
def fixture_can():
    opened = []

    def make(*words, **more):
        opened.append(Can(*words, **more))
        return opened[-1]

    yield make
    for one in opened:
        one.close()


@pytest.fixture(scope="module", name="pair")
def fixture_pair(quiet_kernel):
    """Two ECUs with a controller each, for tests that leave both processes running."""
    assert quiet_kernel
    rig = Rig([node("engine", "can0"), node("gearbox", "can1")])
    rig.wait_for("can0", "can1")
    yield rig
    rig.close()


@pytest.fixture(name="ends")
def fixture_ends(pair, can):
    """Both interfaces, down at first."""
    modes = "type can one-shot off listen-only off restart-ms 0"
    batch(*(f"link set {name} {what}" for name in ("can0", "can1") for what in ("down", modes)))
    assert pair.daemon.process.poll() is None
    return can


def both_up(options="bitrate 500000"):
    batch(*lines_up("can0", options), *lines_up("can1", options))


def test_the_example_of_the_page():
    """It comes before `pair`, which has the names of its interfaces, too."""
    page = (ROOT / "daemon/man/canwire-usb.8.md").read_text(encoding="utf-8")
    text = re.search(r"```yaml\n(bus:.*?)```", page, re.S)[1]
    lines = [line[2:] for line in re.search(r"```console\n(.*?)```", page, re.S)[1].splitlines()]
    folder = Path(tempfile.mkdtemp(dir="/run"))
    folder.chmod(0o755)
    (folder / "bus.yaml").write_text(text)
    try:
        with Session(folder) as session:
            shown = [session.run(line) for line in lines][-1]
            assert "can state ERROR-ACTIVE" in shown and "bitrate 500000" in shown
    finally:
        ip("netns del gearbox")
    wait_until(lambda: not exists("can0"), "the end of can0")


def test_canwire_vcan_leaves_a_real_interface_alone(ends, tmp_path):
    """For a bus that waits for it. The others are made; for another bus none is."""
    assert ends and not details("can0")["flags"].count("UP")
    nodes = "nodes: [ { name: a, port: can0 }, { name: b, port: beside } ]\n"
    text = "bus: { name: real, bitrate: 500000 }\n" + nodes
    file = tmp_path / "real.yaml"
    file.write_text(text)
    words = [CANWIRE, "vcan", "up", file]
    refused = subprocess.run(words, capture_output=True, text=True, check=False)
    assert "can0: it exists and is no vcan or vxcan interface" in refused.stderr
    assert refused.returncode == 1 and not exists("beside")
    file.write_text(text + "missing-port: wait\n")
    try:
        assert run(*words) == "made beside\n"
        assert not details("can0")["flags"].count("UP"), "its bit rate is for others to set"
    finally:
        run(CANWIRE, "vcan", "down", file)
    assert exists("can0") and not exists("beside")


# ---- Frames --------------------------------------------------------------------------------------


def test_frames_both_ways(ends):
    both_up()
    sent = tx_packets("can0"), tx_packets("can1")
    engine, gearbox = ends("can0"), ends("can1", own=True)
    texts = ["123#DEADBEEF", "00000456#1122", "7FF#R3", "555#", "1FFFFFFF#0102030405060708"]
    engine.send(*texts)
    assert gearbox.receive(5) == [Frame.parse(t) for t in texts]
    gearbox.send(*texts)
    assert engine.receive(5) == [Frame.parse(t) for t in texts]
    assert gearbox.receive(5) == [Frame.parse(t) for t in texts], "its own, echoed"
    assert [tx_packets("can0") - sent[0], tx_packets("can1") - sent[1]] == [5, 5]
    assert state("can0") == "ERROR-ACTIVE"


def test_raw_dlc(ends):
    up("can0", "bitrate 500000 cc-len8-dlc on")
    up("can1", "bitrate 500000 cc-len8-dlc on")
    engine, gearbox = ends("can0"), ends("can1")
    frame = Frame.parse("123#1122334455667788_E")
    engine.socket.send(frame.pack())
    assert gearbox.receive() == [frame]


def test_many_frames_keep_their_order(ends):
    """The driver hands frames to the processor that it happens to run on, and two processors may
    pass them on in another order. So one gets them all."""
    both_up()
    Path("/sys/class/net/can1/queues/rx-0/rps_cpus").write_text("1", encoding="ascii")
    engine, gearbox = ends("can0"), ends("can1")
    sent = [Frame(0x100 + i % 0x400, 2, struct.pack(">H", i)) for i in range(600)]
    for frame in sent:
        while True:
            try:
                engine.socket.send(frame.pack())
                break
            except OSError as error:
                assert error.errno == 105, error
                time.sleep(0.001)
    assert gearbox.receive(600) == sent


def test_hardware_time_stamps_are_of_the_bus(pair, ends):
    both_up()
    engine, gearbox = ends("can0"), ends("can1")
    gearbox.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING, RAW_HARDWARE | RX_HARDWARE)
    stamps = []
    for _ in range(2):
        engine.send("123#1122")
        _, extra, _, _ = gearbox.socket.recvmsg(16, 200)
        times = struct.unpack("=6q", extra[0][2][:48])
        stamps.append(times[4] * 10**6 + times[5] // 1000)
    bus = pair.shell.status("usb")["bus"]
    assert 0 < stamps[0] < stamps[1] <= bus["time_ns"] // 1000, (stamps, bus["time_ns"])


def test_a_held_bus_and_its_state(ends):
    """Nobody acknowledges: the driver's queue is full, and the controller is error passive."""
    up("can0")
    engine, sent = ends("can0"), tx_packets("can0")
    assert engine.fill() == ACCEPTED
    wait_until(lambda: state("can0") == "ERROR-PASSIVE", "error passive")
    assert counter("can0")[0] >= 128 and tx_packets("can0") == sent
    assert can_info("can0")["info_xstats"]["error_passive"] >= 1
    up("can1")
    wait_until(lambda: tx_packets("can0") == sent + ACCEPTED, "all frames to be sent")


def test_poll_waits_until_the_bus_has_sent(ends):
    """With the default txqueuelen. Ten frames are with the driver, and the buffer of the socket is
    full before the queue of the interface is."""
    up("can0")
    engine, sent = ends("can0"), tx_packets("can0")
    assert details("can0")["txqlen"] == 10
    engine.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
    room, count = select.poll(), 0
    room.register(engine.socket, select.POLLOUT)
    for _ in range(2 * ACCEPTED):
        if not room.poll(0):
            break
        engine.send("123#1122")
        count += 1
    wait_until(lambda: not room.poll(0), "a full buffer")
    assert 10 < count < ACCEPTED and tx_packets("can0") == sent
    up("can1")
    assert room.poll(1000 * PATIENCE_S) == [(engine.socket.fileno(), select.POLLOUT)]
    assert tx_packets("can0") > sent
    wait_until(lambda: tx_packets("can0") == sent + count, "all frames to be sent")


# ---- States --------------------------------------------------------------------------------------


@pytest.fixture(name="stuck")
def fixture_stuck(pair):
    """The engine's transmitter does not work: each attempt is a bit error."""
    pair.shell.run("inject", "usb",
                   "{ name: stuck, when: { time: 0s }, do: { stuck: recessive, on: engine.tx } }")
    cleared = []

    def clear():
        if not cleared:
            pair.shell.run("clear", "usb", "stuck")
        cleared.append(True)

    yield clear
    clear()


def test_bus_off_and_restart(ends, stuck):
    """32 attempts to bus-off; the driver restarts the controller."""
    up("can0", "bitrate 500000 restart-ms 100")
    up("can1")
    before = can_info("can0")["info_xstats"]
    engine, gearbox = ends("can0"), ends("can1")
    engine.send("123#1122")
    seen = engine.errors_until(0x40)  # CAN_ERR_BUSOFF
    assert seen == [(0x4, 0x08), (0x4, 0x20), (0x40, 0)], "TX warning, TX passive, bus-off"
    assert engine.errors_until(0x100)[-1][0] == 0x100  # CAN_ERR_RESTARTED
    stats = can_info("can0")["info_xstats"]
    for key in ("error_warning", "error_passive", "bus_off", "restarts"):
        assert stats[key] == before[key] + 1, key
    stuck()
    gearbox.send("321#")
    assert engine.receive() == [Frame.parse("321#")]
    engine.send("124#33")
    assert gearbox.receive() == [Frame.parse("124#33")]


def test_restart_by_hand(pair, ends, stuck):
    up("can0")
    up("can1")
    engine, gearbox = ends("can0"), ends("can1")
    restarts = pair.node("engine")["restarts"]
    engine.send("123#1122")
    wait_until(lambda: state("can0") == "BUS-OFF", "bus-off")
    stuck()
    assert pair.node("engine")["state"] == "bus-off"
    lost = pair.node("engine")["dropped"]["bus-off"]
    ip("link set can0 type can restart")
    wait_until(lambda: state("can0") == "ERROR-ACTIVE", "the restart")
    engine.send("124#33")  # R12: it waits for the 128 x 11 bits, if they are not over yet
    assert gearbox.receive() == [Frame.parse("124#33")]
    assert pair.node("engine")["state"] == "error-active"
    gearbox.send("321#")
    assert engine.receive() == [Frame.parse("321#")]
    assert pair.node("engine")["restarts"] == restarts + 1
    assert pair.node("engine")["dropped"]["bus-off"] <= lost + 1  # 123 alone


def test_a_wrong_bit_rate(ends):
    up("can0", "bitrate 250000")
    up("can1")
    engine, gearbox = ends("can0"), ends("can1")
    engine.send("123#1122")
    wait_until(lambda: counter("can0")[0] > 0 and counter("can1")[1] > 0, "errors on both sides")
    up("can0")
    ends("can0").send("124#33")
    assert gearbox.receive() == [Frame.parse("124#33")], "the right bit rate"


def test_one_shot(ends):
    """Frames without acknowledgement are dropped; the queue goes on, also after ten of them."""
    up("can0", "bitrate 500000 one-shot on")
    engine, sent = ends("can0"), tx_packets("can0")
    engine.send("123#1122")
    wait_until(lambda: counter("can0")[0] == 8, "one attempt")
    assert tx_packets("can0") == sent
    for i in range(30):
        engine.socket.send(Frame(0x200 + i, 0).pack())
        time.sleep(0.002)
    up("can1")
    gearbox = ends("can1")
    engine.send("124#33")
    assert Frame.parse("124#33") in gearbox.receive()


def test_listen_only(pair, ends):
    up("can0", "bitrate 500000 listen-only on")
    up("can1", "bitrate 500000 one-shot on")
    gearbox, sent = ends("can1"), tx_packets("can1")
    gearbox.send("123#1122")
    wait_until(lambda: counter("can1")[0] == 8, "nobody to acknowledge")
    assert pair.node("engine")["settings"]["listen-only"]
    assert tx_packets("can1") == sent


def test_bus_errors_are_error_frames_when_the_node_reports_them(pair, ends):
    pair.shell.run("set", "usb", "gearbox", "berr-reporting=on")
    up("can0", "bitrate 500000 one-shot on")
    up("can1")
    gearbox = ends("can1")
    up("can0", "bitrate 250000 one-shot on")
    ends("can0").send("123#1122")
    assert gearbox.errors_until(0x80)[-1][0] & 0x88 == 0x88  # CAN_ERR_BUSERROR, CAN_ERR_PROT
    pair.shell.run("set", "usb", "gearbox", "berr-reporting=off")


def test_lost_arbitration_is_an_error_frame_when_the_node_reports_it(pair, ends):
    """Frames of both wait in a stopped canwired, so that they meet on the bus. They are sent again
    where one of the adapters was held up until then."""
    pair.shell.run("set", "usb", "gearbox", "lost-arbitration-reporting=on")
    both_up()
    engine, gearbox = ends("can0"), ends("can1")
    before, lost = pair.node("gearbox")["arbitration_lost"], 0
    for _ in range(20):
        with stopped(pair.daemon.process):
            for _ in range(10):
                engine.send("700#")
                gearbox.send("7F0#")
        assert engine.receive(10) == [Frame.parse("7F0#")] * 10
        lost = pair.node("gearbox")["arbitration_lost"] - before
        if lost > 0:
            break
    pair.shell.run("set", "usb", "gearbox", "lost-arbitration-reporting=off")
    engine.send("123#")
    # 700 and 7F0 differ first in the fourth identifier bit, number 3 as the SJA1000 counts
    assert lost > 0 and gearbox.errors_before("123#") == [(LOSTARB, 3)] * lost


# ---- Timing and settings -------------------------------------------------------------------------


def test_the_node_has_the_timing_of_the_device(pair, ends):
    assert ends
    up("can0", "tq 125 prop-seg 6 phase-seg1 7 phase-seg2 2 sjw 1")
    wait_until(lambda: pair.node("engine")["link"] == "up", "the node on the bus")
    ip("link set can0 down")
    wait_until(lambda: pair.node("engine")["link"] == "down", "the node off the bus")


def test_a_reload_keeps_what_the_device_has_set(pair, ends):
    up("can0", "bitrate 250000")
    up("can1", "bitrate 250000")
    pair.shell.run("reload", "usb")
    engine, gearbox = ends("can0"), ends("can1")
    engine.send("123#1122")
    assert gearbox.receive() == [Frame.parse("123#1122")]


# ---- Processes -----------------------------------------------------------------------------------


def takes_under(seconds, work):
    begin = time.monotonic()
    work()
    took = time.monotonic() - begin
    assert took < seconds, took


def test_a_stopped_daemon_holds_up_nobody(pair, ends):
    up("can0")
    ends("can0").send("123#1122")
    with stopped(pair.daemon.process):
        takes_under(2, lambda: ip("link set can0 down"))
        takes_under(2, lambda: up("can0"))
        takes_under(2, lambda: ip("link set can0 down"))
    both_up()
    engine, gearbox = ends("can0"), ends("can1")
    engine.send("124#33")
    assert gearbox.receive() == [Frame.parse("124#33")]


def test_a_stopped_adapter_is_unplugged(pair, ends):
    assert ends
    before = pair.servers()
    for process in before:
        os.kill(process, signal.SIGSTOP)
    takes_under(2.5, lambda: ip("link set can0 up", check=False))
    wait_until(lambda: not set(pair.servers()) & set(before), "new processes")
    pair.wait_for("can0", "can1")
    assert "does not answer" in pair.log()
    both_up()
    ends("can0").send("124#33")


def test_killed_processes(pair, ends):
    both_up()
    killed = pair.servers()
    for process in killed:
        os.kill(process, signal.SIGKILL)
    wait_until(lambda: not set(pair.servers()) & set(killed), "the old ones to go")
    wait_until(lambda: len(pair.servers()) == 2, "new ones")
    pair.wait_for("can0", "can1")
    both_up()
    engine, gearbox = ends("can0"), ends("can1")  # before the frame comes
    pair.daemon.process.kill()
    pair.daemon.wait()
    engine.send("125#44")  # waits
    pair.start_daemon()
    assert gearbox.receive() == [Frame.parse("125#44")]


def test_the_interfaces_go_with_canwire_usb(pair, ends):
    """However it ends: nobody would look after the processes that answer the kernel."""
    assert ends
    pair.adapters.kill()
    pair.adapters.wait(PATIENCE_S)
    wait_until(lambda: not exists("can0") and not exists("can1"), "the interfaces to go")
    pair.start_adapters()
    pair.wait_for("can0", "can1")
    wait_until(lambda: pair.log().count("plugged in at port") >= 4, "both to be plugged in")


def test_renamed_interface(ends):
    assert ends
    ip("link set can1 name diag")
    both = "bitrate 500000"
    up("can0", both)
    up("diag", both)
    ends("can0").send("123#1122")
    ip("link set diag down")
    ip("link set diag name can1")


def test_no_privileges_are_left(pair, ends):
    assert ends
    for process in pair.servers():
        status = Path(f"/proc/{process}/status").read_text()
        for line in (r"CapEff:\t0+", r"CapPrm:\t0+", r"Uid:\t990\t990\t990\t990",
                     r"NoNewPrivs:\t1"):
            assert re.search(f"^{line}$", status, re.M), status


# ---- Suspend -------------------------------------------------------------------------------------

PM = Path("/sys/power")


def exchange(can):
    both_up()
    engine, gearbox = can("can0"), can("can1")
    engine.send("124#33")
    assert gearbox.receive() == [Frame.parse("124#33")]


def files_of(processes):
    return [len(os.listdir(f"/proc/{process}/fd")) for process in processes]


def test_a_device_that_is_suspended_and_its_driver_bound_again(pair, ends):
    """The driver keeps its device awake. Without the driver it is suspended, and it is resumed for
    the driver, which makes an interface with the first name that is free."""
    devices = {name: usb_of(name) for name in ("can0", "can1")}
    servers = pair.servers()
    before = files_of(servers)
    both_up()
    for device in devices.values():
        (device / "power/autosuspend_delay_ms").write_text("0")
        (device / "power/control").write_text("auto")
    exchange(ends)
    driver = Path("/sys/bus/usb/drivers/peak_usb")
    for device in devices.values():
        assert (device / "power/runtime_status").read_text() == "active\n"
        (driver / "unbind").write_text(f"{device.name}:1.0")
    for name, device in devices.items():
        wait_until(lambda d=device: (d / "power/runtime_status").read_text() == "suspended\n", name)
        assert not exists(name)
    for name in "can1", "can0":
        (driver / "bind").write_text(f"{devices[name].name}:1.0")
    wait_until(lambda: pair.log().count("it has its name again") == 2, "the names")
    assert [serial(name) for name in devices] == list(devices)
    exchange(ends)
    assert pair.servers() == servers and files_of(servers) == before


def test_a_machine_that_is_suspended(pair, ends):
    """The kernel freezes all programs, canwired and the adapters among them. It then suspends
    devices, but not vhci-hcd with a port in use, so it goes on. sysfs tells the refusal as EIO or
    as EBUSY."""
    servers = pair.servers()
    both_up()
    delay = Path("/sys/module/suspend/parameters/pm_test_delay")
    delay.write_text("1")
    (PM / "pm_test").write_text("freezer")
    (PM / "state").write_text("freeze")
    (PM / "pm_test").write_text("devices")
    with pytest.raises(OSError):
        (PM / "state").write_text("freeze")
    (PM / "pm_test").write_text("none")
    assert "vhci_hcd.0: PM: failed to suspend" in run("dmesg")
    exchange(ends)
    assert pair.servers() == servers


@contextlib.contextmanager
def frozen(*processes):
    """The freezer of cgroups holds processes up."""
    group = Path("/sys/fs/cgroup/ecu")
    group.mkdir()
    for process in processes:
        (group / "cgroup.procs").write_text(str(process))
    (group / "cgroup.freeze").write_text("1")
    wait_until(lambda: "frozen 1" in (group / "cgroup.events").read_text(), "the freezer")
    try:
        yield
    finally:
        (group / "cgroup.freeze").write_text("0")
        for process in processes:
            (group.parent / "cgroup.procs").write_text(str(process))
        group.rmdir()


def test_an_ecu_that_is_frozen_loses_nothing(pair, ends):
    """Its program is, by the freezer and by SIGSTOP; the interface goes on without it."""
    both_up()
    engine, sent = ends("can0"), tx_packets("can0")
    with subprocess.Popen(["candump", "-L", "can1"], stdout=subprocess.PIPE, text=True) as candump:
        wait_until(lambda: listeners("can1"), "candump")
        for hold in frozen(candump.pid), stopped(candump):
            with hold:
                engine.send(*(f"{number:03X}#{number:04X}" for number in range(0x100, 0x110)))
                sent += 0x10
                wait_until(lambda: tx_packets("can0") == sent, "the bus")
        lines = [candump.stdout.readline().split()[2] for _ in range(0x20)]
        candump.terminate()
    assert lines == [f"{number:03X}#{number:04X}" for number in range(0x100, 0x110)] * 2
    node = pair.node("gearbox")
    assert not any(node["rx_dropped"].values()) and node["conserved"]


def test_all_of_canwire_usb_is_frozen(pair, ends):
    """Nobody unplugs then: the network's configuration waits, and goes on later."""
    servers = pair.servers()
    both_up()
    with frozen(pair.adapters.pid, *servers):
        down = subprocess.Popen(["ip", "link", "set", "can0", "down"])
        wait_until(lambda: " D " in Path(f"/proc/{down.pid}/stat").read_text(), "it waits")
    assert down.wait(PATIENCE_S) == 0
    exchange(ends)
    assert pair.servers() == servers


# ---- CAN FD, several adapters --------------------------------------------------------------------


def pack_fd(can_id, data, flags):
    return FD.pack(can_id, len(data), flags, data)


def test_can_fd(can):
    rig = Rig([node("engine", "fd0"), node("gearbox", "fd1")],
              more=", dbitrate: 2000000")
    try:
        rig.wait_for("fd0", "fd1")
        for interface in ("fd0", "fd1"):
            up(interface, "bitrate 500000 dbitrate 2000000 fd on")
        engine, gearbox = can("fd0", fd=True), can("fd1", fd=True)
        for flags in (1, 0):
            frame = pack_fd(0x123, bytes(range(64)), flags)
            engine.socket.send(frame)
            can_id, length, got, data = FD.unpack(gearbox.socket.recv(80))
            assert (can_id, length, got & 1, data) == (0x123, 64, flags, bytes(range(64)))
        gearbox.send("321#0102")
        assert engine.receive() == [Frame.parse("321#0102")]
        up("fd0", "bitrate 500000 dbitrate 1000000 fd on one-shot on")
        can("fd0", fd=True).socket.send(pack_fd(0x124, bytes(64), 1))
        wait_until(lambda: counter("fd1")[1] > 0, "errors by another data bit rate")
    finally:
        rig.close()


def test_namespaces_and_many_adapters():
    """Names that the kernel gives to others first, and a namespace of an ECU."""
    ip("netns add engine")
    names = [f"can{i}" for i in reversed(range(2, 8))]
    nodes = [node(f"n{i}", name) for i, name in enumerate(names)]
    nodes.append(node("own", "can0", port=", netns: engine"))
    rig = Rig(nodes)
    try:
        rig.wait_for(*names)
        wait_until(lambda: "can0" in ip("netns exec engine ip -o link show"), "can0 of the engine")
        assert [serial(name) for name in names] == names
        ip("netns exec engine ip link set can0 type can bitrate 500000")
        ip("netns exec engine ip link set can0 up")
        wait_until(lambda: rig.node("own")["link"] == "up", "the node on the bus")
        wait_until(lambda: ", in namespace engine" in rig.log(), "the end of its naming")
        ip("netns del engine")
        wait_until(lambda: "no network namespace engine" in rig.log(), "the end of the namespace")
        wait_until(lambda: rig.node("own")["link"] == "down", "the node off the bus")
        assert "back from namespace engine" in rig.log()
        ip("netns add engine")
        wait_until(lambda: "can0" in ip("netns exec engine ip -o link show"), "can0 again")
        assert rig.log().count("no network namespace engine") == 1
    finally:
        rig.close()
        ip("netns del engine", check=False)
    wait_until(lambda: not any(map(exists, names)), "the interfaces to go")


def test_a_socket_that_may_not_be_opened_makes_no_interface():
    """The sockets are for the group canwire."""
    rig = Rig([node("engine", "own0")], user="nobody")
    try:
        mine = rig.folder / "engine.usb"
        denied = (f"own0: user nobody may not open the socket {mine} (owner root, group canwire, "
                  "mode 0660)")
        wait_until(lambda: denied in rig.log(), "the reason")
        assert "--user" in rig.log() and not rig.servers() and not exists("own0")
        mine.chmod(0o666)
        rig.wait_for("own0")
        wait_until(lambda: rig.node("engine")["clients"], "the controller")
        mine.chmod(0o660)
        rig.daemon.process.kill()
        rig.daemon.wait()
        rig.start_daemon()
        wait_until(lambda: not exists("own0"), "the end of the interface")
        wait_until(lambda: rig.log().count("user nobody may not open") == 2, "the reason again")
    finally:
        rig.close()


def test_a_second_canwire_usb_is_told_of_the_first(pair, ends):
    both_up()
    with (pair.folder / "second.log").open("w") as log, subprocess.Popen(
            [CANWIRE_USB, pair.daemon.config], stderr=log) as second:
        text = (pair.folder / "second.log").read_text
        for name in "can0", "can1":
            wait_until(lambda n=name: f"{n}: its node has a controller already" in text(), name)
        second.terminate()
        assert second.wait(PATIENCE_S) == 0
    assert text().count("has a controller already") == 2
    exchange(ends)


def test_a_full_port_is_told():
    """Clients without orders have all places. When one goes, the adapter is plugged in."""
    rig = Rig([node("engine", "own0"), f"defaults: {{ clients: {PLACES} }}"])
    try:
        rig.wait_for("own0")
        rig.adapters.terminate()
        assert rig.adapters.wait(PATIENCE_S) == 0
        clients = [Client(rig.folder / "engine.usb", "x") for _ in range(PLACES)]
        rig.start_adapters()
        wait_until(lambda: "as many programs as it takes (clients: max)" in rig.log(), "the reason")
        wait_until(lambda: not exists("own0"), "the end of the interface")
        assert "has a controller already" not in rig.log()
        clients.pop().close()
        rig.wait_for("own0")
        wait_until(lambda: rig.node("engine")["clients"][-1]["name"] == "own0", "the controller")
    finally:
        rig.close()


def test_what_is_missing_is_said():
    file = Path(tempfile.mkdtemp(dir="/run")) / "bus.yaml"
    file.parent.chmod(0o755)
    file.write_text("bus: { bitrate: 500000 }\nnodes: [ { name: a, port: { usb: x/y } } ]\n")
    done = subprocess.run([CANWIRE_USB, file], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "bus.yaml:2:34: usb: expected the name" in done.stderr
    done = subprocess.run([CANWIRE_USB, "--user", "nobody-here", file], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 1 and "user nobody-here: no such user" in done.stderr
    assert subprocess.run([CANWIRE_USB], capture_output=True, check=False).returncode == 2
    assert CANWIRE and shutil.which("ip")
