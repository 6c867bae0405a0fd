# SPDX-License-Identifier: MIT
"""The tool `canwire`, which this package calls."""

from __future__ import annotations

import os
import pathlib
import shutil
from collections.abc import Iterator
from typing import Any

from . import _library


def _places() -> Iterator[Any]:
    yield os.environ.get("CANWIRE")
    yield shutil.which("canwire")
    try:
        beside = pathlib.Path(_library.library().path).resolve().parent
    except ImportError:  # the tool does not need the library
        return
    yield beside / "canwire"
    yield beside.parent.parent / "bin/canwire"


def find_tool() -> str | None:
    """Returns the path of the tool: $CANWIRE, else that of PATH or beside the library."""
    for place in _places():
        if place and os.access(place, os.X_OK):
            return str(pathlib.Path(place).resolve())
    return None
