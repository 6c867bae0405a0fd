# SPDX-License-Identifier: MIT
"""The events of a bus as columns of numbers, for many of them: Bus.take_columns()."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from . import _library
from .frame import RTR_FLAG


def _words() -> list[str]:
    """Returns the words that numbers in columns mean."""
    library, words = _library.library(), []
    while (word := library.word(len(words))) is not None:
        words.append(word.decode())
    return words


class Columns(Mapping[str, memoryview]):
    """Events as columns: a memoryview of numbers for each name, with a row for each line that
    `canwire sim --events` writes. columns.t and columns["t"] are the same. numpy.asarray() takes
    one without a copy. canwire-python(7) says what they mean.
    """

    #: Bits of `marks`, of errors. The node was the transmitter. It was a stuff bit. It was found at
    #: the data rate. An active or a passive error flag follows.
    TX, STUFF, DATA_RATE = _library.MARK_TX, _library.MARK_STUFF, _library.MARK_DATA
    ACTIVE, PASSIVE = _library.MARK_ACTIVE, _library.MARK_PASSIVE
    #: In the column can_id of an event without a frame, and in error_id.
    NO_FRAME = _library.NO_FRAME

    def __init__(self, arrays: dict[str, memoryview], words: Sequence[str], rules: Sequence[str],
                 nodes: Sequence[str], buses: Sequence[str]):
        self._arrays = arrays
        self.words = list(words)  #: by the numbers in `event`, `detail` and `field`
        self.rules = list(rules)  #: ... in `rule`
        self.nodes = list(nodes)  #: ... in `node`
        self.buses = list(buses)  #: ... in `bus`

    def __getitem__(self, name: str) -> memoryview:
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __getattr__(self, name: str) -> memoryview:
        if name in self.__dict__.get("_arrays", {}):
            return self._arrays[name]
        raise AttributeError(f"there is no column {name!r}")

    def __repr__(self) -> str:
        return f"<canwire.Columns of {self.rows} events: {', '.join(self._arrays)}>"

    @property
    def rows(self) -> int:
        """The number of events, each node counted."""
        return len(next(iter(self._arrays.values()), b""))

    def frame(self) -> Any:
        """Returns a pandas.DataFrame of them. It has names in place of their numbers, `t` in
        seconds and the data of frames as bytes. An event without such a name has none there."""
        # pylint: disable=import-outside-toplevel
        import numpy
        import pandas

        arrays = {name: numpy.asarray(column) for name, column in self._arrays.items()}
        names = {"event": self.words, "detail": self.words, "field": self.words,
                 "node": self.nodes, "bus": self.buses, "rule": self.rules}
        table = dict(arrays)
        if "rule" in table and "event" in table:  # others have 0 there
            hit = table["event"] == self.words.index("fault")
            table["rule"] = numpy.where(hit, table["rule"].astype(int), -1)
        for name in names.keys() & table.keys():
            categories = [*dict.fromkeys(filter(None, names[name]))]  # "" is nothing
            codes = numpy.array([categories.index(one) if one else -1
                                 for one in names[name]] + [-1])  # the last one: of -1
            table[name] = pandas.Categorical.from_codes(codes[table[name]], categories)
        if "t" in table:
            table["t"] = arrays["t"] / 1e9
        for name in {"can_id", "error_id"} & table.keys():
            none = arrays[name] == _library.NO_FRAME
            table[name] = pandas.arrays.IntegerArray(arrays[name].copy(), none)
        if "data" in table:
            table["data"] = _data(arrays)
        return pandas.DataFrame(table)


def _data(arrays: Mapping[str, Any]) -> list[bytes]:
    """Returns the data of frames. Remote frames have none."""
    rows, width = arrays["data"].shape
    data, lengths = arrays["data"].tobytes(), [width] * rows
    if "length" in arrays:
        lengths = arrays["length"]
        if "can_id" in arrays:
            lengths = lengths * (arrays["can_id"] & RTR_FLAG == 0)
        lengths = lengths.tolist()
    return [data[at:at + length] for at, length in
            zip(range(0, len(data), width), lengths)]


def take(library: Any, sim: int, wanted: Sequence[str], width: int, nodes: Sequence[str],
         buses: Sequence[str]) -> tuple[int, Columns]:
    """Takes the events of a bus. Returns what the library has returned, too."""
    rows = library.count_events(sim)
    places, room, names = _library.CColumns(data_size=width), {}, ctypes.c_void_p()
    for name in wanted:
        size = width if name == "data" else struct.calcsize("=" + _library.COLUMNS[name])
        room[name] = bytearray(max(rows, 1) * size)
        setattr(places, name, ctypes.addressof(ctypes.c_char.from_buffer(room[name])))
    taken = library.take_columns(sim, places, rows, ctypes.byref(names))
    arrays = {}
    for name, memory in room.items():
        shape = (max(rows, 1), width) if name == "data" else (max(rows, 1),)
        view = memoryview(memory).cast("B").cast(_library.COLUMNS[name], shape)
        arrays[name] = view[:max(taken, 0)]
    return taken, Columns(arrays, _words(), library.told(names).splitlines(), nodes, buses)
