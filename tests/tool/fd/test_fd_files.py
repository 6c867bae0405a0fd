# SPDX-License-Identifier: MIT
"""CAN FD frames in files: canwire writes them as other tools read them, and reads what these write.

`canwire record` gets the events here from a bus that this file plays. The judges are tshark,
python-can, and log2asc of can-utils. Needs no CAN in the kernel.
"""

import json
import shutil
import socketserver
import threading

import can
import pytest

from simtool import canwire, run, sim

FRAMES = ["123##0", "123##1DEADBEEF", "12345678##2" + "11" * 8, "7FF##3" + "22" * 12,
          "00000001##0" + "".join(f"{n:02X}" for n in range(64)), "123#DEADBEEF", "123#R4"]
FD = [frame for frame in FRAMES if "##" in frame]


class Bus(socketserver.ThreadingUnixStreamServer):
    """A bus that tells these frames as transmissions, a millisecond apart, to who watches it."""

    daemon_threads = True

    class RequestHandlerClass(socketserver.StreamRequestHandler):
        def tell(self, **line):
            self.wfile.write(json.dumps(line).encode() + b"\n")

        def handle(self):
            for line in self.rfile:
                self.tell(ok=True, epoch_ns=10**18,
                          status={"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}]})
                if json.loads(line)["request"] == "watch":
                    for n, frame in enumerate(FRAMES):
                        self.tell(t=n / 1000, node="a", event="tx", frame=frame)
                    return

    def __init__(self, path):
        super().__init__(str(path), self.RequestHandlerClass)


@pytest.fixture(name="record")
def fixture_record(tmp_path):
    def record(name):
        with Bus(tmp_path / f"{name}.sock") as bus:
            threading.Thread(target=bus.serve_forever, daemon=True).start()
            result = canwire("record", f"./{name}.sock", name, cwd=tmp_path)
            bus.shutdown()
        assert f"{len(FRAMES)} entries" in result.stderr and "lost" not in result.stderr
        return tmp_path / name

    return record


def text_of(message):
    """Returns a frame of python-can as can-utils writes it."""
    name = f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}"
    if message.is_remote_frame:
        return f"{name}#R{message.dlc}"
    flags = message.bitrate_switch + 2 * message.error_state_indicator
    return f"{name}#{f'#{flags}' if message.is_fd else ''}{message.data.hex().upper()}"


def message_of(text, n):
    name, _, data = text.partition("#")
    fd = data.startswith("#")
    remote = data.startswith("R")
    payload = b"" if remote else bytes.fromhex(data[2:] if fd else data)
    return can.Message(arbitration_id=int(name, 16), is_extended_id=len(name) == 8, is_fd=fd,
                       bitrate_switch=fd and data[1] in "13", channel=0, timestamp=100 + n / 1000,
                       error_state_indicator=fd and data[1] in "23", is_remote_frame=remote,
                       dlc=int(data[1:]) if remote else len(payload), data=payload)


def replay(path, folder):
    """Returns what canwire says about a recording and sends of it, on a classical bus."""
    (folder / "replay.yaml").write_text(
        "bus: { bitrate: 500000 }\nnodes:\n"
        f"  - {{ name: a, traffic: [ {{ replay: {path.name}, speed: max }} ] }}\n  - name: b\n")
    result = sim("replay.yaml", "--events", "-", cwd=folder)
    events = [json.loads(line) for line in result.stdout.splitlines()]
    return result.stderr, [e["frame"] for e in events if e["event"] == "tx"]


def is_left_out(path, folder, classical=("123#DEADBEEF", "123#R4")):
    said, sent = replay(path, folder)
    assert f"{path.name}: left out: {len(FD)} CAN FD frames (the first at " in said
    assert sent == list(classical)


# ---- What canwire writes -------------------------------------------------------------------------

def test_a_log_has_the_frames_as_can_utils_write_them(record, tmp_path):
    path = record("drive.log")
    assert [line.split()[2] for line in path.read_text().splitlines()] == FRAMES
    assert [text_of(m) for m in can.LogReader(path)] == FRAMES
    is_left_out(path, tmp_path)


def test_tshark_reads_the_capture(record, tmp_path):
    path = record("drive.pcapng")
    fields = ["can.id", "can.flags.xtd", "can.flags.rtr", "can.len", "canfd.flags.brs",
              "canfd.flags.esi", "data.data"]
    words = [word for field in fields for word in ("-e", field)]
    lines = run("tshark", "-r", path, "-T", "fields", *words).stdout.splitlines()
    seen = []
    for line in lines:
        packet = dict(zip(fields, line.split("\t")))
        on = {name: packet[name] in ("1", "True") for name in fields}
        text = f"{int(packet['can.id'], 0):0{8 if on['can.flags.xtd'] else 3}X}#"
        if packet["canfd.flags.brs"]:
            text += f"#{on['canfd.flags.brs'] + 2 * on['canfd.flags.esi']}"
        if on["can.flags.rtr"]:
            text += f"R{packet['can.len']}"
        seen.append(text + packet["data.data"].upper())
        if not on["can.flags.rtr"]:
            assert int(packet["can.len"]) == len(packet["data.data"]) // 2
    assert seen == FRAMES
    assert "Malformed" not in run("tshark", "-r", path, "-V").stdout
    is_left_out(path, tmp_path)


# ---- What canwire reads --------------------------------------------------------------------------

@pytest.mark.parametrize("name", ["drive.asc", "drive.log"])
def test_files_of_python_can_are_read(name, tmp_path):
    with can.Logger(tmp_path / name) as log:
        for n, text in enumerate(FRAMES):
            log(message_of(text, n))
    # it does not write the length of remote frames into logs
    is_left_out(tmp_path / name, tmp_path,
                ["123#DEADBEEF", "123#R" if name == "drive.log" else "123#R4"])


def test_asc_of_can_utils_is_read(tmp_path):
    if not shutil.which("log2asc"):
        pytest.skip("log2asc is not installed (can-utils)")
    log = tmp_path / "drive.log"
    log.write_text("".join(f"({n}.000000) can0 {text}\n" for n, text in enumerate(FRAMES, 1)))
    run("log2asc", "-I", log, "-O", tmp_path / "drive.asc", "can0")
    assert (tmp_path / "drive.asc").read_text().count("CANFD") == len(FD)
    is_left_out(tmp_path / "drive.asc", tmp_path)


def test_a_broken_frame_in_a_file_has_its_place(tmp_path):
    (tmp_path / "bad.log").write_text("(1.0) can0 123##1AABB\n(1.1) can0 123##1AAB\n")
    (tmp_path / "bus.yaml").write_text(
        "bus: { bitrate: 500000 }\nnodes: [ { name: a, traffic: [ { replay: bad.log } ] } ]\n")
    error = sim("bus.yaml", cwd=tmp_path).stderr
    assert ("bad.log: left out: 1 damaged entry of 21 bytes (line 2: '123##1AAB': data bytes have "
            "two hexadecimal digits), 1 CAN FD frame (line 1)") in error


# ---- Where frames are classical ------------------------------------------------------------------

@pytest.mark.parametrize("text", [
    "nodes: [ { name: a, traffic: [ { send: 123##1AA } ] } ]",
    "nodes: [ { name: a, traffic: [ { reply: 123##1AA, only: \"124\" } ] } ]",
    "nodes: [ { name: a } ]\nfaults: [ { name: f, when: { time: 1ms }, "
    "do: { send: 123##1AA, as: a } } ]",
    "nodes: [ { name: a } ]\nfaults: [ { name: f, when: { time: 1ms }, "
    "do: { babble: 123##1AA, as: a } } ]",
    "nodes: [ { name: a } ]\nfaults: [ { name: f, when: { frame: \"123\" }, "
    "do: { reply: 123##1AA, as: a } } ]",
])
def test_a_configuration_refuses_them(text, tmp_path):
    (tmp_path / "bus.yaml").write_text(f"bus: {{ bitrate: 500000 }}\n{text}\n")
    error = canwire("check", "bus.yaml", status=1, cwd=tmp_path).stderr
    assert "'123##1AA': a CAN FD frame (##), but the bus is classical" in error
    assert error.startswith("bus.yaml:")
