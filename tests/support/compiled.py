# SPDX-License-Identifier: MIT
"""Programs and libraries that tests compile, kept in build/. A compiler takes long in the guest, so
scripts/test calls it on the host before."""

import os
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIBRARY = ("-shared", "-fPIC")
HEADERS = (f"-I{ROOT}/daemon", f"-I{ROOT}/lib")
SOURCES = {  # and its options
    "frozen_clock.so": ("tests/kernel/frozen_clock.c", *LIBRARY),
    "suspended_clock.so": ("tests/kernel/suspended_clock.c", *LIBRARY),
    "late_end.so": ("tests/preload/late_end.c", *LIBRARY),
    "late_listen.so": ("tests/preload/late_listen.c", *LIBRARY),
    "heap.so": ("tests/soak/heap.c", *LIBRARY),
    "signal_at_wait.so": ("tests/preload/signal_at_wait.c", *LIBRARY, *HEADERS),
    "small-ecu": ("tests/tool/small_ecu.c",),
    "sudo": ("tests/support/sudo.c",),
    "socketcan-calls": ("tests/preload/calls.c", "-pthread"),
}


def compiled(name):
    """Returns the file, made anew if its source has changed."""
    source, *options = SOURCES[name]
    source, made = ROOT / source, ROOT / "build" / name
    if made.exists() and made.stat().st_mtime >= source.stat().st_mtime:
        return made
    with tempfile.TemporaryDirectory(dir=made.parent) as folder:
        whole = Path(folder) / name  # complete when it gets its name, whichever process makes it
        subprocess.run([os.environ.get("CC", "cc"), "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra",
                        *options, "-o", whole, source, "-ldl"], check=True)
        whole.rename(made)
    return made


def main():
    for name in SOURCES:
        compiled(name)
