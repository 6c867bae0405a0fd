# SPDX-License-Identifier: MIT
"""The functions of libcanwire-sim, with the types of canwire-sim.h.

The header is the reference for units, ownership and errors. A test compiles it and compares its
layout with the structures here.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import pathlib
import struct
from collections.abc import Callable
from ctypes import (POINTER, Structure, c_char_p, c_int, c_int32, c_int64, c_size_t, c_uint8,
                    c_uint16, c_uint32, c_uint64, c_void_p)
from threading import RLock  # the one of real time
from typing import Any

ABI = 1
NEVER = 2**63 - 1
NO_NODE, ANY_NODE = -1, -2
NO_FRAME = 0x20000000  # in the place of an identifier
TAKES_NONE = 4096  # the room of a node that drops all its frames

OK, INVALID, REFUSED, NO_MEMORY, FAILED = 0, -1, -2, -3, -4
AT_TIME, AT_FRAME, AT_EVENT, AT_END = 0, 1, 2, 3

FRAME_FD, FRAME_BRS, FRAME_ESI, FRAME_OWN = 0x1, 0x2, 0x4, 0x8
LISTEN_RX, LISTEN_OWN, LISTEN_ERRORS = 0x1, 0x2, 0x4
MARK_TX, MARK_STUFF, MARK_DATA, MARK_ACTIVE, MARK_PASSIVE = 0x1, 0x2, 0x4, 0x8, 0x10


class CBus(Structure):
    """canwire_sim_bus"""

    _fields_ = [("seed", c_uint64), ("bitrate", c_uint32), ("dbitrate", c_uint32),
                ("nodes", c_int32), ("first_node", c_int32), ("fd", c_int32), ("rules", c_int32)]


class CFrame(Structure):
    """canwire_sim_frame"""

    _fields_ = [("t", c_int64), ("can_id", c_uint32), ("flags", c_uint8), ("length", c_uint8),
                ("raw_dlc", c_uint8), ("reserved", c_uint8), ("data", c_uint8 * 64)]


class CWaited(Structure):
    """canwire_sim_waited"""

    _fields_ = [("now", c_int64), ("next", c_int64), ("frame", CFrame)]


# The same, to read and write all members at once: time, identifier, flags, length, raw DLC, data.
FRAME = struct.Struct("=qIBBBx64s")
WAITED = struct.Struct("=qqqIBBBx64s")


class CNode(Structure):
    """canwire_sim_node"""

    _fields_ = [*[(name, c_uint64) for name in (
        "tx_frames", "rx_frames", "dropped", "rx_dropped", "arbitration_lost", "retransmissions",
        "bit_errors", "stuff_errors", "form_errors", "crc_errors", "ack_errors", "overloads")],
                *[(name, c_uint32) for name in ("bus_off", "restarts", "queue", "inbox")],
                ("tec", c_uint16), ("rec", c_uint16), ("state", c_uint8), ("attached", c_uint8),
                ("fd", c_uint8), ("listen_only", c_uint8)]


#: The columns of events with the format of their members, see struct.
COLUMNS = {"t": "q", "bus": "h", "node": "h", "event": "B", "detail": "B", "field": "B",
           "marks": "B", "number": "I", "rule": "H", "tec": "H", "rec": "H", "can_id": "I",
           "flags": "B", "length": "B", "raw_dlc": "B", "error_id": "I", "data": "B"}


class CColumns(Structure):
    """canwire_sim_columns"""

    _fields_ = [*[(name, c_void_p) for name in COLUMNS], ("data_size", c_int32)]


STRUCTURES = {"canwire_sim_columns": CColumns, "canwire_sim_bus": CBus,
              "canwire_sim_frame": CFrame, "canwire_sim_node": CNode, "canwire_sim_waited": CWaited}

# Texts that the caller owns have a pointer as their type, since ctypes would lose it otherwise.
_OWNED = c_void_p
_MESSAGES = POINTER(c_void_p)
FUNCTIONS = {
    "abi": (c_int,),
    "version": (c_char_p,),
    "load": (c_void_p, c_char_p, _MESSAGES),
    "load_text": (c_void_p, c_char_p, c_size_t, c_char_p, _MESSAGES),
    "free": (None, c_void_p),
    "free_text": (None, c_void_p),
    "reset": (c_int, c_void_p, POINTER(c_uint64)),
    "message": (c_char_p, c_void_p),
    "bus_count": (c_int, c_void_p),
    "node_count": (c_int, c_void_p),
    "bus_name": (c_char_p, c_void_p, c_int),
    "node_name": (c_char_p, c_void_p, c_int),
    "bus_of_node": (c_int, c_void_p, c_int),
    "get_bus": (c_int, c_void_p, c_int, POINTER(CBus)),
    "time": (c_int64, c_void_p, c_int, c_char_p),
    "now": (c_int64, c_void_p),
    "run": (c_int, c_void_p, c_int64, c_char_p, c_int),
    "next": (c_int64, c_void_p),
    "next_event": (c_int, c_void_p, c_char_p, c_int64, POINTER(c_int64)),
    "send": (c_int, c_void_p, c_int, POINTER(CFrame), c_int64),
    "offer": (c_int, c_void_p, c_int, POINTER(CFrame), c_int64),
    "wait": (c_int, c_void_p, c_int, c_int64, c_int64, POINTER(CWaited)),
    "listen": (c_int, c_void_p, c_int, c_int),
    "receive": (c_int, c_void_p, c_int, POINTER(CFrame)),
    "room": (c_int, c_void_p, c_int),
    "inject": (c_int, c_void_p, c_int, c_char_p, c_size_t, c_char_p, _MESSAGES),
    "clear": (c_int, c_void_p, c_int, c_char_p),
    "fire": (c_int, c_void_p, c_int, c_char_p),
    "rule_name": (c_char_p, c_void_p, c_int, c_int),
    "restart": (c_int, c_void_p, c_int),
    "set": (c_int, c_void_p, c_int, c_char_p),
    "attach": (c_int, c_void_p, c_int, c_int),
    "keep_events": (c_int, c_void_p, c_char_p),
    "take_events": (_OWNED, c_void_p, POINTER(c_size_t)),
    "count_events": (c_int64, c_void_p),
    "take_columns": (c_int64, c_void_p, POINTER(CColumns), c_int64, _MESSAGES),
    "word": (c_char_p, c_int),
    "get_node": (c_int, c_void_p, c_int, POINTER(CNode)),
    "stats": (_OWNED, c_void_p, c_int),
    "expect": (c_int, c_void_p, c_int, c_char_p, c_size_t, c_char_p, _MESSAGES),
    "expectations": (_OWNED, c_void_p),
    "lost": (_OWNED, c_void_p),
}

NAME = "libcanwire-sim.so"


def places():
    """Yields where the library may be: a path in CANWIRE_SIM_LIBRARY alone, else that of the wheel,
    those of installations, and what the dynamic linker finds."""
    wanted = os.environ.get("CANWIRE_SIM_LIBRARY")
    if wanted:
        yield wanted
        return
    here = pathlib.Path(__file__).resolve().parent
    for folder in (here, *(parent / "lib/canwire" for parent in here.parents),
                   pathlib.Path("/usr/local/lib/canwire"), pathlib.Path("/usr/lib/canwire")):
        if (folder / NAME).exists():
            yield str(folder / NAME)
    yield NAME


class Library:
    """The functions as attributes, without their prefix."""

    def __init__(self, path: str):
        self._library = ctypes.CDLL(path)
        self.path = path
        for name, (result, *arguments) in FUNCTIONS.items():
            function = getattr(self._library, f"canwire_sim_{name}", None)
            if function is None:
                raise ImportError(f"{path} has no canwire_sim_{name}(); this package needs a newer "
                                  "canwire")
            function.restype = result
            function.argtypes = arguments
            setattr(self, name, function)
        if self.abi() != ABI:
            raise ImportError(f"{path} has version {self.abi()} of its interface; this package "
                              f"needs {ABI}")

    def text(self, pointer: int | None) -> str:
        """Takes a text that the library has given away."""
        if not pointer:
            raise MemoryError("libcanwire-sim has no memory")
        try:
            return ctypes.string_at(pointer).decode("utf-8", "replace")
        finally:
            self.free_text(pointer)

    def told(self, messages: c_void_p) -> str:
        """Takes messages; without any they are empty."""
        return self.text(messages.value).rstrip("\n") if messages.value else ""


MOVES = {"run", "wait", "offer", "reset"}  # functions that let time go on


class Guarded:
    """The functions for one bus: one thread at a time, and none when it is closed."""

    def __init__(self, library: Library, refuse: Callable[[], Exception]):
        self._library, self._refuse = library, refuse
        self.moves = 0  # calls that may have let time go on
        self._lock = RLock()  # ctypes lets other threads run meanwhile
        self.text, self.told = library.text, library.told
        self._freed = False

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function = getattr(self._library, name)
        moves = name in MOVES

        def call(*arguments: Any) -> Any:
            with self._lock:
                if self._freed:
                    raise self._refuse()
                result = function(*arguments)
                if moves:
                    self.moves += 1
                return result

        setattr(self, name, call)
        return call

    def release(self, sim: int) -> None:
        """Frees the bus when no thread is in a function of it."""
        with self._lock:
            if not self._freed:
                self._freed = True
                self._library.free(sim)


_loaded: Library | None = None


def library() -> Library:
    """Loads the library once."""
    global _loaded  # pylint: disable=global-statement
    if _loaded is None:
        problems = []
        for path in places():
            try:
                _loaded = Library(path)
                return _loaded
            except OSError as problem:
                problems.append(str(problem))
        raise ImportError(f"libcanwire-sim.so cannot be loaded: {'; '.join(problems)}. Install "
                          "this package by pip, or canwire, or set CANWIRE_SIM_LIBRARY to its "
                          "path.")
    return _loaded
