# SPDX-License-Identifier: MIT
"""`canwire sim --pcapng`: Wireshark sees every frame and every error frame, with times and nodes.

tshark is the judge. Needs no CAN in the kernel. CANWIRE is the tool, by default
build/release/canwire.
"""

import json

from simtool import run, sim

BUS = """bus: { bitrate: 500000 }
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 5ms, count: 3 } ] }
  - name: load
    traffic:
      - { send: 12345678#R5, offset: 1ms }
      - { send: 7FF#1122334455667788_F, offset: 2ms }
      - { send: 555#, offset: 3ms }
  - { name: dash, port: vcan7 }
faults:
  - name: crc
    when: { frame: "123", count: 1 }
    do: { flip: "crc[3]", at: [dash] }
  - name: broken
    when: { time: 8ms }
    do: { stuck: recessive, on: engine.tx }
"""
FIELDS = ["frame.time_epoch", "frame.interface_name", "frame.p2p_dir", "can.id", "can.flags.xtd",
          "can.flags.rtr", "can.flags.err", "can.len", "data.data", "can.err.prot.location",
          "can.err.busoff"]


def tshark(capture, *fields):
    options = [word for field in fields for word in ("-e", field)]
    result = run("tshark", "-r", capture, "-t", "e", "-T", "fields", *options)
    return [dict(zip(fields, line.split("\t"))) for line in result.stdout.splitlines()]


def simulate(tmp_path, text=BUS):
    (tmp_path / "bus.yaml").write_text(text)
    sim("bus.yaml", "--until", "60ms", "--pcapng", "bus.pcapng", "--events", "events", "--log",
        "log", cwd=tmp_path)
    return [json.loads(line) for line in (tmp_path / "events").read_text().splitlines()]


def frame_text(packet):
    """Returns a frame as can-utils writes it, without DLC over 8, which tshark does not show."""
    number = int(packet["can.id"], 0)
    name = f"{number:08X}" if packet["can.flags.xtd"] in ("1", "True") else f"{number:03X}"
    if packet["can.flags.rtr"] in ("1", "True"):
        return f"{name}#R{packet['can.len']}"
    return f"{name}#{packet['data.data'].upper()}"


def test_frames_are_those_of_the_log_once_and_outbound(tmp_path):
    events = simulate(tmp_path)
    packets = [p for p in tshark(tmp_path / "bus.pcapng", *FIELDS)
               if p["can.flags.err"] not in ("1", "True")]
    sent = [e for e in events if e["event"] == "tx"]
    assert [(round(float(p["frame.time_epoch"]) * 1e9), p["frame.interface_name"], frame_text(p))
            for p in packets] == [
        (round(e["t"] * 1e9), e["node"], e["frame"].removesuffix("_F"))
        for e in sent]
    assert len(sent) == len((tmp_path / "log").read_text().splitlines()) >= 5
    assert {p["frame.p2p_dir"] for p in packets} == {"0"}  # sent


def test_error_frames_are_those_of_the_events_and_inbound(tmp_path):
    events = simulate(tmp_path)
    packets = [p for p in tshark(tmp_path / "bus.pcapng", *FIELDS)
               if p["can.flags.err"] in ("1", "True")]
    kinds = {"error", "state", "restart", "arbitration-lost"}
    wanted = [(round(e["t"] * 1e9), e["node"].replace("dash", "vcan7")) for e in events
              if e["event"] in kinds]
    seen = [(round(float(p["frame.time_epoch"]) * 1e9), p["frame.interface_name"]) for p in packets]
    assert set(wanted) <= set(seen)
    assert {p["frame.p2p_dir"] for p in packets} == {"1"}  # received
    crc = [p for p in packets if p["can.err.prot.location"] == "8"]
    assert [p["frame.interface_name"] for p in crc] == ["vcan7"]
    off = next(e for e in events if e.get("state") == "bus-off")
    assert [(round(float(p["frame.time_epoch"]) * 1e9), p["frame.interface_name"])
            for p in packets if p["can.err.busoff"] in ("1", "True")] == [
        (round(off["t"] * 1e9), "engine")]


def test_nothing_in_it_is_malformed(tmp_path):
    simulate(tmp_path)
    text = run("tshark", "-r", tmp_path / "bus.pcapng", "-V").stdout
    assert "Malformed" not in text
    assert "Controller Area Network" in text


def test_the_capture_can_be_replayed(tmp_path):
    events = simulate(tmp_path)
    (tmp_path / "again.yaml").write_text(
        "bus: { bitrate: 500000 }\nnodes:\n"
        "  - { name: a, traffic: [ { replay: bus.pcapng } ] }\n  - name: b\n")
    text = sim("again.yaml", "--events", "-", cwd=tmp_path).stdout
    again = [json.loads(line) for line in text.splitlines()]
    assert [e["frame"] for e in again if e["event"] == "tx"] == [
        e["frame"] for e in events if e["event"] == "tx"]
