# SPDX-License-Identifier: MIT
"""Calls of the C library that fail in a program (failing_calls.c): their sites, a plan in which
each of them fails, and orders for it.
"""

import concurrent.futures
import errno
import mmap
import os
import struct
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from depth import DEEP
from simtool import CANWIRE, ROOT

FULL = os.environ.get("CALLS") == "all"
with open(CANWIRE, "rb") as program_file:
    SANITIZED = b"__asan_init" in program_file.read()
# One of so many failures is tried. Most sites have two, so that these numbers are odd.
EVERY = 1 if FULL else (11 if SANITIZED else 3) if DEEP else 55 if SANITIZED else 15
WORKERS = os.cpu_count() or 1
SLOW_S = 5  # longer runs are printed

MAGIC = 0x4641494C
FILE_BYTES = 1 << 20
ORDER = struct.Struct("=IIQQIIIiIIIIII")
SITE = struct.Struct("=QQII24s8Q")
GROUPS = {name: 1 << i for i, name in enumerate(
    "memory descriptor write read look socket traffic wake thread tell close nudge".split())}
PARTLY = "partly"
# The library is the first one, before that of AddressSanitizer.
SANITIZERS = {"ASAN_OPTIONS": "detect_leaks=1:verify_asan_link_order=0",
              "LSAN_OPTIONS": f"print_suppressions=0:suppressions={ROOT}/tests/calls/lsan.supp"}

# Errors of each call. The short pass takes the first one, and then all from then on.
DISK = ("ENOSPC", "EIO", "EINTR", PARTLY)
NEW = ("EMFILE", "EACCES", "ENOMEM")
ERRORS = {
    "accept4": ("EMFILE", "ECONNABORTED", "EINTR"), "open": (*NEW, "EINTR"), "openat": NEW,
    "fopen": NEW, "bind": ("EACCES", "EADDRINUSE", "ENOMEM"), "listen": ("EADDRINUSE",),
    "connect": ("ECONNREFUSED", "EAGAIN", "EINTR"), "setsockopt": ("ENOMEM", "EPERM"),
    "getsockopt": ("ENOBUFS",), "getpeername": ("ENOTCONN",), "getsockname": ("ENOBUFS",),
    "recvmsg": ("ENOBUFS", "EINTR"), "sendmsg": ("ENOBUFS", "EINTR"),
    "sendto": ("ENOBUFS", "ECONNREFUSED", "EINTR"),
    "recvmmsg": ("ECONNRESET", "EINTR", "ENOMEM", PARTLY),
    "sendmmsg": ("EPIPE", "EAGAIN", "EINTR", PARTLY),
    "recv": ("ECONNRESET", "EINTR", PARTLY), "send": ("EPIPE", "EAGAIN", "EINTR", PARTLY),
    "read": ("EIO", "EINTR", PARTLY), "pread": ("EIO", "EINTR", PARTLY),
    "write": DISK, "pwrite": DISK, "fwrite": DISK[:2], "close": ("EIO",), "fclose": ("EIO",),
    "fread": ("EIO",), "fgets": ("EIO",), "getline": ("EIO",), "__getdelim": ("EIO",),
    "rename": ("EACCES", "EIO"), "unlink": ("EACCES",), "ftruncate": ("EIO",), "fsync": ("EIO",),
    "chown": ("EPERM",), "lchown": ("EPERM",), "fchown": ("EPERM",), "fchownat": ("EPERM",),
    "flock": ("ENOLCK", "EINTR"), "fcntl": ("ENOLCK",), "ioctl": ("ENODEV",),
    "stat": ("EACCES", "EIO"), "lstat": ("EACCES", "EIO"), "fstat": ("EIO",),
    "fstatat": ("EACCES",), "realpath": ("EACCES",), "glob": ("EIO",), "access": ("EACCES",),
    "epoll_ctl": ("ENOMEM", "ENOSPC"), "epoll_wait": ("EINTR",), "poll": ("EINTR", "ENOMEM"),
    "timerfd_settime": ("ENOMEM",), "pthread_create": ("EAGAIN",),
}
OF_GROUP = {"memory": ("ENOMEM",), "descriptor": NEW, "write": ("ENOSPC", "EIO"), "read": ("EIO",),
            "look": ("EACCES",), "socket": ("ENOBUFS",), "traffic": ("ENOBUFS",),
            "wake": ("ENOMEM",), "thread": ("EAGAIN",), "tell": ("ENOSPC",), "close": ("EIO",)}
NUDGES = {"read": ("EAGAIN", "EINTR"), "write": ()}  # a counter takes what is written
PASSING = ("EINTR", "EAGAIN", PARTLY)  # from then on they would mean that nothing ever works


@dataclass(frozen=True)
class Site:
    """A site of calls in a program, and their number."""
    site: int
    caller: int
    group: str
    count: int
    call: str
    frames: tuple = field(compare=False)

    def errors(self):
        if self.group == "nudge":
            return NUDGES.get(self.call, ())
        return ERRORS.get(self.call) or OF_GROUP[self.group]

    def text(self, program):
        """Returns the call with the functions and lines of its callers."""
        result = subprocess.run(["addr2line", "-sfe", program, *(hex(f - 1) for f in self.frames)],
                                capture_output=True, text=True, check=True).stdout.split("\n")
        return f"{self.call} by " + ", ".join(f"{result[i]} ({result[i + 1]})"
                                              for i in range(0, len(result) - 1, 2))


class Calls:
    """The calls of a program, with an order that holds until the next one."""

    def __init__(self, folder, library):
        self.file, self.library = folder / "calls", library
        with self.file.open("wb") as out:
            out.truncate(FILE_BYTES)
        with self.file.open("r+b") as both:
            self.memory = mmap.mmap(both.fileno(), FILE_BYTES)
        self.order(False)

    def environment(self, **more):
        return dict(os.environ, **SANITIZERS, LD_PRELOAD=str(self.library), FAIL=str(self.file),
                    **more)

    def order(self, on, each=None, listing=False):
        site = each.site if each else Site(0, 0, "", 0, "", ())
        how = int(each is not None and each.error == PARTLY)
        code = getattr(errno, each.error) if each and not how else 0
        self.memory[:ORDER.size] = ORDER.pack(
            MAGIC, on, site.site, site.caller, each.number if each else 0,
            bool(each and each.lasting), how, code, listing, 0, 0, 0, 0, 0)

    def list_sites(self):
        self.order(True, listing=True)

    def fail(self, each):
        self.order(True, each)

    def failed(self):
        """Returns the number of failed calls."""
        return ORDER.unpack_from(self.memory)[10]

    def sites(self):
        """Returns the listed sites."""
        *_, count, left_out = ORDER.unpack_from(self.memory)
        assert left_out == 0, "there is no room for so many sites"
        names = {bit: name for name, bit in GROUPS.items()}
        result = []
        for i in range(count):
            site, caller, group, times, call, *frames = SITE.unpack_from(
                self.memory, ORDER.size + i * SITE.size)
            result.append(Site(site, caller, names[group], times, call.rstrip(b"\0").decode(),
                               tuple(f for f in frames if f)))
        return result


def build_library():
    """Returns failing_calls.so in build/, which is made once: a compiler takes long in a guest."""
    source, library = ROOT / "tests/calls/failing_calls.c", ROOT / "build/failing_calls.so"
    if library.exists() and library.stat().st_mtime >= source.stat().st_mtime:
        return library
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        made = Path(folder) / library.name  # complete when it gets its name, whichever process
                                            # makes it
        # -O2: no frame of it is where memory is from
        subprocess.run(["cc", "-std=c17", "-O2", "-g", "-Wall", "-Wextra", "-Werror", "-shared",
                        "-fPIC", "-o", made, source, "-lgcc_s"], check=True)
        made.rename(library)
    return library


@dataclass(frozen=True)
class Try:
    """The failure of a run: a call of a site by its number, once or from then on."""
    site: Site
    error: str
    number: int = 1
    lasting: bool = False

    def text(self, program):
        after = " and all of its kind from then on" if self.lasting else ""
        return f"{self.error} at time {self.number}{after}: {self.site.text(program)}"


def plan(sites):
    """Plans the failures. Each site fails once with the first of its errors and, but for most of
    the memory, from then on. Memory also fails at the site's last call. The full plan takes all
    errors, and more calls."""
    tries = []
    for i, site in enumerate(sites):
        errors = site.errors()
        if not errors:
            continue
        lasting = [error for error in errors if error not in PASSING][:1]
        tries.append(Try(site, errors[0]))
        if FULL or site.group != "memory" or i % 4 == 0:
            tries += [Try(site, error, lasting=True) for error in lasting]
        if FULL:
            tries += [Try(site, error) for error in errors[1:]]
        later = {2, 3, site.count // 2, site.count} if FULL else {site.count}
        tries += [Try(site, errors[0], number) for number in sorted(later - {0, 1})
                  if number <= site.count and (FULL or site.group == "memory")]
    return tries[::EVERY]


def run_all(workers, program, tries, attempt):
    """Runs all tries. attempt(worker, try) returns the violation, or None, and True when the call
    was reached. All workers take tries until none is left. Returns the number of reached calls."""
    left = list(reversed(tries))
    wrong, reached = [], []

    def go_on(worker):
        while True:
            try:
                each = left.pop()
            except IndexError:
                return
            begin = time.monotonic()
            text, was_reached = attempt(worker, each)
            duration = time.monotonic() - begin
            if text:
                wrong.append(text)
                print(f"{len(left)} left, {duration:.1f} s, WRONG: {text}", flush=True)
            elif duration > SLOW_S:
                print(f"{duration:.1f} s: {each.text(program)}", flush=True)
            reached.append(was_reached)

    with concurrent.futures.ThreadPoolExecutor(len(workers)) as pool:
        for future in [pool.submit(go_on, each) for each in workers]:
            future.result()
    print(f"{len(tries)} runs at {len({each.site for each in tries})} sites, "
          f"{sum(reached)} of them reached the call")
    assert not wrong, f"{len(wrong)} of {len(tries)} runs:\n" + "\n".join(wrong)
    return sum(reached)
