# SPDX-License-Identifier: MIT
"""The logs that the demo plays, in candump's format.

The interface column names the ECU. So canplayer can play each ECU's part on a port of its own:
canplayer -I car.log vcan0=engine
"""

LENGTH_MS = 3000

# ECU, identifier, period and offset in ms, and the payload at a time in ms.
MESSAGES = [
    ("brakes", "0A8", 10, 2, lambda t: words(*(speed(t) + wheel for wheel in (0, 3, 1, 2)))),
    ("brakes", "0B0", 20, 5, lambda t: words(pressure(t)) + bytes([pressure(t) > 0])),
    ("brakes", "153", 20, 13, lambda t: bytes([0, speed(t) >> 8 & 255, speed(t) & 255, 0xFF])),
    ("brakes", "310", 100, 50, lambda t: bytes([t // 100 & 255, 0x55])),
    ("engine", "0C0", 10, 0, lambda t: words(rpm(t), throttle(t)) + bytes([0, 0, 0, t // 10 & 15])),
    ("engine", "0D0", 10, 4, lambda t: words(throttle(t) * 3, 0x7FFF, rpm(t) // 8)),
    ("engine", "1A0", 20, 9, lambda t: bytes([gear(t), rpm(t) // 50, 0, 0x80])),
    ("engine", "280", 100, 30, lambda t: bytes([90 + t // 1000, 84, 0, 0, 12, 142, 0, 0])),
    ("engine", "18FEEE00", 100, 70, lambda t: bytes([130 + t // 1000] + [0xFF] * 7)),
]


def words(*values):
    return b"".join(v.to_bytes(2, "big") for v in values)


def rpm(t):
    """Accelerates in three gears."""
    return 1500 + t % 1000 * 2


def gear(t):
    return 1 + t // 1000


def throttle(t):
    return 800 if t < 2500 else 0


def speed(t):
    """Hundredths of a km/h."""
    return 1000 + min(t, 2500)


def pressure(t):
    """The driver brakes in the last half second."""
    return max(0, t - 2500) * 4


def car():
    """Returns the lines of three seconds of the periodic traffic of a small car."""
    lines = []
    for ecu, identifier, period, offset, payload in MESSAGES:
        for t in range(offset, LENGTH_MS, period):
            data = payload(t).hex().upper()
            lines.append((t, identifier, f"({t / 1000:.6f}) {ecu} {identifier}#{data}"))
    return [line for _, _, line in sorted(lines)]


def contention():
    """Returns the lines of frames that are written at once. A hundred urgent ones of dash keep the
    bus busy for 25 ms; meanwhile all three ECUs write, the least urgent first."""
    urgent = [("dash", f"001#{n:02X}00000000000000") for n in range(100)]
    late = [("engine", "18FEEE00#E3"), ("dash", "500#D2"), ("brakes", "310#B3"),
            ("dash", "300#D1"), ("engine", "1A0#E2"), ("brakes", "153#B2"), ("engine", "0C0#E1"),
            ("brakes", "0A8#B1")]
    return [f"(0.000000) {ecu} {frame}" for ecu, frame in urgent + late]
