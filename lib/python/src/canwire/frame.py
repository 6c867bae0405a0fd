# SPDX-License-Identifier: MIT
"""Frames, and their text as can-utils write it."""

from __future__ import annotations

import operator
import re
from dataclasses import dataclass
from typing import Any

from . import _library

EFF_FLAG, RTR_FLAG, ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # of CAN FD frames, by DLC

_TEXT = re.compile(r"([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:(#)([0-9A-Fa-f]))?(.*)")


@dataclass(frozen=True)
class Frame:
    """A CAN frame.

    Received frames also have `t`, the time in seconds of bus time. `own`: the node has sent it
    itself. `error`: it is an error frame of linux/can/error.h, with its class in `id`.
    """

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    fd: bool = False
    brs: bool = False
    esi: bool = False
    dlc: int | None = None  #: of remote frames, and 9..15 of classical frames with 8 bytes
    error: bool = False
    own: bool = False
    t_ns: int = 0

    def __post_init__(self) -> None:
        number = _whole("an identifier", self.id)
        if not 0 <= number <= 0x1FFFFFFF:
            raise ValueError(f"{number:#x} is no identifier; expected 0 to 0x7FF, or to 0x1FFFFFFF "
                             "of an extended frame")
        object.__setattr__(self, "id", number)
        object.__setattr__(self, "data", _bytes(self.data))
        most = 8 if self.remote else 15
        if self.dlc is not None and not 0 <= _whole("a DLC", self.dlc) <= most:
            kind = "a remote frame" if self.remote else "a frame"
            raise ValueError(f"{self.dlc} is no DLC of {kind}; expected 0 to {most}")

    @property
    def t(self) -> float:
        """The time of the reception in seconds of bus time."""
        return self.t_ns / 1e9

    @classmethod
    def parse(cls, text: str) -> Frame:
        """Reads a frame as cansend does: 123#DEADBEEF, 12345678#, 123#R4, 123##1DEADBEEF."""
        found = _TEXT.fullmatch(text)
        if not found:
            raise ValueError(f"{text!r} is no frame; expected ID#DATA, such as 123#DEADBEEF")
        number, fd, flags, rest = found.groups()
        frame = {"id": int(number, 16), "extended": len(number) == 8}
        if frame["id"] > (0x1FFFFFFF if frame["extended"] else 0x7FF):
            raise ValueError(f"{text!r}: identifiers are at most 7FF or 1FFFFFFF")
        if fd:
            bits = int(flags, 16)
            return cls(**frame, data=_hex(text, rest, 64), fd=True, brs=bool(bits & 1),
                       esi=bool(bits & 2))
        if rest[:1] in ("R", "r"):
            if not re.fullmatch("[0-8]?", rest[1:]):
                raise ValueError(f"{text!r}: a remote frame has a DLC from 0 to 8")
            return cls(**frame, remote=True, dlc=int(rest[1:] or 0))
        data, _, raw = rest.partition("_")
        if raw and not re.fullmatch("[9A-Fa-f]", raw):
            raise ValueError(f"{text!r}: _9 to _F are raw DLCs")
        return cls(**frame, data=_hex(text, data, 8), dlc=int(raw, 16) if raw else None)

    def __str__(self) -> str:
        number = f"{self.id:08X}" if self.extended or self.error else f"{self.id:03X}"
        if self.fd:
            return f"{number}##{self.brs + 2 * self.esi:X}{self.data.hex().upper()}"
        if self.remote:
            return f"{number}#R{self.dlc or ''}"
        raw = f"_{self.dlc:X}" if self.dlc and self.dlc > 8 else ""
        return f"{number}#{self.data.hex().upper()}{raw}"

    def _to_c(self) -> _library.CFrame:
        if len(self.data) > 64:
            raise ValueError(f"{self}: at most 64 bytes")
        return _library.CFrame.from_buffer_copy(_library.FRAME.pack(
            0, self.id | self.extended * EFF_FLAG | self.remote * RTR_FLAG | self.error * ERR_FLAG,
            self.fd * _library.FRAME_FD | self.brs * _library.FRAME_BRS
            | self.esi * _library.FRAME_ESI,
            (self.dlc or 0) if self.remote else len(self.data),
            self.dlc if self.dlc and self.dlc > 8 and not self.fd else 0, self.data))

    @classmethod
    def _from_c(cls, frame: _library.CFrame) -> Frame:
        """Makes one of the library, which needs no look at its values."""
        t_ns, can_id, flags, length, raw_dlc, data = _library.FRAME.unpack_from(frame)
        remote = bool(can_id & RTR_FLAG)
        return cls._of(
            id=can_id & 0x1FFFFFFF, data=b"" if remote else data[:length],
            extended=bool(can_id & EFF_FLAG), remote=remote, fd=bool(flags & _library.FRAME_FD),
            brs=bool(flags & _library.FRAME_BRS), esi=bool(flags & _library.FRAME_ESI),
            dlc=length if remote else raw_dlc or None, error=bool(can_id & ERR_FLAG),
            own=bool(flags & _library.FRAME_OWN), t_ns=t_ns)

    @classmethod
    def _of(cls, **values: Any) -> Frame:
        """Makes one of values that need no look."""
        self = object.__new__(cls)
        self.__dict__.update(values)
        return self


def _whole(what: str, value: Any) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{value!r} is not {what}; expected a whole number") from None


def _bytes(data: Any) -> bytes:
    """Returns the data as bytes, which may be given as numbers."""
    if isinstance(data, bytes):
        return data
    try:
        if isinstance(data, int):  # bytes() would make so many zeros
            raise TypeError
        return bytes(data)
    except TypeError:
        raise TypeError(f"{data!r} are no data; expected bytes, or numbers") from None
    except ValueError:
        raise ValueError(f"{data!r} are no data; expected numbers from 0 to 255") from None


def _hex(text: str, digits: str, most: int) -> bytes:
    """Returns the bytes of digits, which may have dots between them."""
    digits = digits.replace(".", "")
    try:
        data = bytes.fromhex(digits)
    except ValueError:
        raise ValueError(f"{text!r}: the data are pairs of hexadecimal digits") from None
    if len(data) > most:
        raise ValueError(f"{text!r}: at most {most} bytes")
    return data
