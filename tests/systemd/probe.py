#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tries what a contained service must not be able to do; writes to a file what it could."""

import ctypes
import mmap
import os
import socket
import sys

LIBC = ctypes.CDLL(None, use_errno=True)
CLONE_NEWUSER = 0x10000000
AF_CAN_RAW = (socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)


def call(name, *arguments):
    if getattr(LIBC, name)(*arguments) < 0:
        raise OSError(ctypes.get_errno(), name)


def write(path):
    with open(path, "w", encoding="ascii") as file:
        file.write("x")


def open_socket(*kind):
    socket.socket(*kind).close()


def set_user_id_bit():
    write("/run/canwire/suid")
    os.chmod("/run/canwire/suid", 0o4755)


def writable_code():
    mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC).close()


def send_to_network():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.sendto(b"x", ("192.0.2.1", 9))


FORBIDDEN = {
    "write /etc": lambda: write("/etc/canwire/probe"),
    "write /usr": lambda: write("/usr/local/probe"),
    "read /root": lambda: os.listdir("/root"),
    "open a device": lambda: open("/dev/vport0p1", "wb"),  # pylint: disable=consider-using-with
    "packets": lambda: open_socket(socket.AF_PACKET, socket.SOCK_RAW),
    "network": send_to_network,
    "mount": lambda: call("mount", b"none", b"/tmp", b"tmpfs", 0, None),
    "namespace": lambda: call("unshare", CLONE_NEWUSER),
    "set-user-id": set_user_id_bit,
    "writable code": writable_code,
    "real time": lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)),
    "personality": lambda: call("personality", 0x0008),
    "clock": lambda: call("clock_settime", 0, (ctypes.c_long * 2)(0, 0)),
    "chroot": lambda: os.chroot("/tmp"),
    "others' processes": lambda: os.stat("/proc/1/status"),
    "kernel settings": lambda: os.listdir("/proc/sys"),
}
ALLOWED = {
    "CAN": lambda: open_socket(*AF_CAN_RAW),
    "IPv6": lambda: open_socket(socket.AF_INET6, socket.SOCK_STREAM),
    "netlink": lambda: open_socket(socket.AF_NETLINK, socket.SOCK_RAW),
    "control sockets": lambda: write("/run/canwire/probe"),
    "records": lambda: write("/var/lib/canwire/probe"),
    "own processes": lambda: os.stat("/proc/self/status"),
}


def can(attempt):
    try:
        attempt()
    except OSError:
        return False
    return True


def main():
    with open(sys.argv[1], "w", encoding="ascii") as out:
        for name, attempt in FORBIDDEN.items():
            if can(attempt):
                print("can:", name, file=out)
        for name, attempt in ALLOWED.items():
            if not can(attempt):
                print("cannot:", name, file=out)
        print("done", file=out)


main()
