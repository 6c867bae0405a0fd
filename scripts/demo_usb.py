# SPDX-License-Identifier: MIT
"""The part of scripts/demo.py with a real can0: canwire-usb plugs an adapter into the kernel."""

import json
import os
import signal
import subprocess
from pathlib import Path

MODULES = ("vhci-hcd", "peak_usb")
INTERFACE = "can0"
GOOD, BAD = "123#DEADBEEF", "0BD#11"
PLACE = Path("/sys/class/net") / INTERFACE


def why_not():
    """Returns why this machine cannot show it, or None."""
    if os.geteuid() != 0:
        return "only root may plug in an adapter"
    if Path("/proc/self/ns/net").readlink() != Path("/proc/1/ns/net").readlink():
        return "an adapter comes into the initial network namespace"
    if PLACE.exists():
        return f"{INTERFACE} is in use"
    made = subprocess.run(["modprobe", "-a", *MODULES], capture_output=True, text=True, check=False)
    return made.stderr.strip() if made.returncode else None


def ip(*words):
    return subprocess.run(["ip", *words], check=True, capture_output=True, text=True).stdout


def info():
    return json.loads(ip("-json", "-details", "-statistics", "link", "show", INTERFACE))[0]


class RealCan:
    """The bus of config/demo-usb.yaml, and what programs see of it."""

    def __init__(self, root, programs, check, wait_until):
        self.programs, self.check, self.wait_until = programs, check, wait_until
        build = root / "build/release"
        config = programs.folder / "demo-usb.yaml"
        config.write_text((root / "config/demo-usb.yaml").read_text().replace(
            "usb: can0 }", "usb: can0, socket: can0.usb }"))  # not in /run/canwire
        with (programs.folder / "stderr-usb").open("w") as errors:
            self.daemon = programs.start(build / "canwired", "-c", config, stderr=errors)
            self.adapters = programs.start(build / "canwire-usb", "--user", "root", config,
                                           stderr=errors)

    def show(self):
        self.wait_until(PLACE.exists, INTERFACE)
        up = ["link", "set", INTERFACE, "up", "type", "can", "bitrate", "500000",
              "restart-ms", "100"]
        print("   ip " + " ".join(up))
        ip(*up)
        seen = subprocess.run(["candump", "-n", "1", INTERFACE], check=True, capture_output=True,
                              text=True).stdout
        self.check("C0 FF EE" in seen, "the frame of gearbox arrives at can0")
        subprocess.run(["cansend", INTERFACE, GOOD], check=True)
        self.wait_until(lambda: info()["stats64"]["tx"]["packets"] == 1, f"{GOOD} to be sent")
        self.print_state()
        print(f"   The bus breaks each frame of cansend {INTERFACE} {BAD}:")
        subprocess.run(["cansend", INTERFACE, BAD], check=True)
        self.wait_until(lambda: info()["linkinfo"]["info_xstats"]["bus_off"] >= 1, "bus-off")
        self.wait_until(lambda: info()["linkinfo"]["info_xstats"]["restarts"] >= 1, "the restart")
        self.print_state()
        counts = info()["linkinfo"]["info_xstats"]
        print("   " + ", ".join(f"{name} {counts[name]}" for name in
                                ("error_warning", "error_passive", "bus_off", "restarts")))
        self.check(counts["error_passive"] >= 1, "the kernel counts error-passive before bus-off")
        self.stop()

    @staticmethod
    def print_state():
        shown = ip("-details", "link", "show", INTERFACE).splitlines()
        for line in shown:
            if "can state" in line or "bitrate" in line:
                print("   " + line.strip())

    def stop(self):
        for process, name in ((self.adapters, "canwire-usb"), (self.daemon, "its canwired")):
            process.send_signal(signal.SIGTERM)
            self.check(process.wait() == 0, f"{name} ends well")
        self.wait_until(lambda: not PLACE.exists(), f"the end of {INTERFACE}")
