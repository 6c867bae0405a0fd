# SPDX-License-Identifier: MIT
"""Campaigns on any concurrent.futures.Executor, or on a client of Dask.

A task is a shard: `canwire campaign run FILE --shard K/N` on the machine of a worker. Rows of
finished shards are in OUT.parts, a file for each, until all are there. Then the tool checks them
against the campaign and they become OUT, in one step. A call that has broken off leaves OUT.parts,
and the same call goes on.
"""

from __future__ import annotations

import concurrent.futures as futures
import fcntl
import hashlib
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from ._tool import find_tool
from .bus import ConfigError, Error

SHARDS = 64
RETRIES = 3

ROWS, MISSING, REFUSED, LOST = "rows", "missing", "refused", "lost"


class CampaignError(Error):
    """A campaign has not come to its end; what is finished of it is kept."""


@dataclass
class CampaignResult:
    """The rows of a campaign, as they are in the file `path`.

    Iterating reads it, a dict for each row. `counts` has the number of rows of each outcome.
    `message` is what the tool has said. Without `out` the file goes with this object.
    """

    path: pathlib.Path
    counts: dict[str, int]
    message: str
    _folder: Any = field(default=None, repr=False, compare=False)

    def __len__(self) -> int:
        return sum(self.counts.values())

    def __iter__(self) -> Iterator[dict[str, Any]]:
        with open(self.path, "rb") as lines:
            for line in lines:
                yield json.loads(line)

    @property
    def passed(self) -> bool:
        """Returns True when all rows have passed."""
        return self.counts.get("passed", 0) == len(self)


def campaign(file: str | os.PathLike[str], executor: Any = None, *, shards: int | None = None,
             jobs: int | None = None, out: str | os.PathLike[str] | None = None,
             resume: bool = True, files: Iterable[str | os.PathLike[str]] = (),
             retries: int = RETRIES) -> CampaignResult:
    """Runs the campaign of a file.

    executor: a concurrent.futures.Executor, or an object with get_executor(), such as a
    distributed.Client. None: one process of the tool, with `jobs` processes of its own.
    shards: tasks, 64 by default, or as many as the run had that goes on. jobs: processes of a task.
    out: the file of the rows. It appears when all are there. resume=False begins anew.
    files: what a worker needs beside `canwire campaign files FILE`, when it shares no file system.
    retries: of a task whose worker or tool has died.

    The rows are those of `canwire campaign run FILE`, byte for byte. Raises ConfigError for a bad
    file, and CampaignError when a task fails too often or the executor has broken.
    """
    tool = find_tool()
    if tool is None:
        raise CampaignError("there is no tool canwire: it is not in PATH, and $CANWIRE is not set")
    if shards is not None and shards < 1:
        raise ValueError(f"shards is {shards}; expected 1 or more")
    work = _Work(tool, os.fspath(file), files, jobs or 1)
    folder = None if out is not None else tempfile.TemporaryDirectory(prefix="canwire-campaign-")
    path = pathlib.Path(os.path.realpath(out if folder is None else f"{folder.name}/rows.ndjson"))
    if executor is None or (resume and path.exists()):
        result = _finish(tool, work.file, path, jobs, resume)
    else:
        with _Parts(path, resume) as parts:
            parts.begin(work.digest, shards)
            _collect(_as_executor(executor), work, parts, retries)
            result = _finish(tool, work.file, parts.join(), jobs, True)
            parts.deliver()
    result.path, result._folder = path, folder  # pylint: disable=protected-access
    return result


def _as_executor(executor: Any) -> futures.Executor:
    if not isinstance(executor, futures.Executor) and hasattr(executor, "get_executor"):
        executor = executor.get_executor(pure=False)  # a client of Dask
    if not hasattr(executor, "submit"):
        raise TypeError(f"{executor!r} is no concurrent.futures.Executor, and no client of Dask")
    return executor


# ---- The tool ------------------------------------------------------------------------------------


def _run(words: list[str], **more: Any) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, check=False, **more)


def _version(tool: str) -> str:
    return _run([tool, "--version"]).stdout.decode().strip()


def _counts(message: str) -> dict[str, int] | None:
    """Reads the line that the tool ends with, when all rows are there."""
    found = re.search(r"^canwire campaign: \d+ rows?: (.*)$", message, re.M)
    if found is None:
        return None
    words = [entry.split(" ") for entry in found[1].split(", ")]
    return {name: int(count) for count, name in words}


def _finish(tool: str, file: str, out: pathlib.Path, jobs: int | None,
            resume: bool) -> CampaignResult:
    """Makes the rows of `out` that are missing, after a check of those that are there."""
    words = [tool, "campaign", "run", file, "--out", str(out), "--shard", "1/1"]
    done = _run(words + (["--resume"] if resume else []) + (["--jobs", str(jobs)] if jobs else []))
    message = done.stderr.decode(errors="replace").strip()
    counts = _counts(message)
    if counts is None:
        raise CampaignError(message or f"canwire campaign run ended with {done.returncode}")
    return CampaignResult(out, counts, message)


# ---- Tasks, on the machine of a worker -----------------------------------------------------------


@dataclass(frozen=True)
class _Task:
    """A shard, with all that a worker needs. Paths are relative to `folder`, or absolute."""

    file: str
    folder: str
    hashes: dict[str, str]  # of each file that is read
    version: str
    shard: str
    jobs: int
    texts: dict[str, bytes] | None = None  # of files with relative paths; None: they are there


@dataclass(frozen=True)
class _Answer:
    """The result of a task: its rows, or why there are none."""

    kind: str
    text: str = ""
    rows: bytes = b""


def _hash(path: pathlib.Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as content:
        while block := content.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _differing(task: _Task, folder: pathlib.Path) -> str | None:
    """Returns the path of a file that is not there, or is another one."""
    for path, wanted in task.hashes.items():
        try:
            if _hash(folder / path) != wanted:
                return path
        except OSError:
            return path
    return None


def _run_shard(task: _Task) -> _Answer:
    """Runs a task. A worker calls it."""
    tool, host = find_tool(), socket.gethostname()
    if tool is None:
        return _Answer(REFUSED, f"{host}: there is no tool canwire in PATH")
    version = _version(tool)
    if version != task.version:
        return _Answer(REFUSED if version else LOST,
                       f"{host}: {tool} is {version or 'killed'}, not {task.version}")
    if task.texts is None:
        return _run_in(tool, task, pathlib.Path(task.folder), MISSING)
    with tempfile.TemporaryDirectory(prefix="canwire-shard-") as top:
        # as many folders below it as paths go up
        up = max(len(re.match(r"(\.\./)*", path)[0]) // 3 for path in task.texts)
        folder = pathlib.Path(top, *["d"] * up)
        folder.mkdir(parents=True, exist_ok=True)
        for path, content in task.texts.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
        return _run_in(tool, task, folder, REFUSED)


def _run_in(tool: str, task: _Task, folder: pathlib.Path, otherwise: str) -> _Answer:
    if differing := _differing(task, folder):
        return _Answer(otherwise, f"{socket.gethostname()}: {differing} is missing there, or is "
                       "another file")
    done = _run([tool, "campaign", "run", task.file, "--shard", task.shard, "--jobs",
                 str(task.jobs)], cwd=folder)
    message = done.stderr.decode(errors="replace").strip()
    counts = _counts(message)
    if counts is not None and done.stdout.count(b"\n") == sum(counts.values()):
        return _Answer(ROWS, message, done.stdout)
    why = f"shard {task.shard}: {message or f'the tool ended with {done.returncode}'}"
    return _Answer(LOST if done.returncode < 0 or counts is not None else REFUSED, why)


# ---- Tasks, at the caller ------------------------------------------------------------------------


class _Work:
    """The parts that all tasks of a campaign share."""

    def __init__(self, tool: str, file: str, more: Iterable[Any], jobs: int):
        listed = _run([tool, "campaign", "files", file])
        if listed.returncode:
            raise ConfigError(listed.stderr.decode(errors="replace").strip())
        self.file, self.jobs, self.version = file, jobs, _version(tool)
        # the spelling counts, which is that of the file in `repeat`
        self.paths = {path: pathlib.Path(path) for path in
                      [*os.fsdecode(listed.stdout).splitlines(), *map(os.fspath, more)]}
        self.hashes = {name: _hash(path) for name, path in self.paths.items()}
        self.digest = hashlib.sha256(json.dumps(
            [file, self.version, sorted(self.hashes.items())]).encode()).hexdigest()
        self.texts: dict[str, bytes] | None = None

    def task(self, shard: str) -> _Task:
        return _Task(self.file, os.getcwd(), self.hashes, self.version, shard, self.jobs)

    def with_texts(self, task: _Task, why: str) -> _Task:
        """Returns a task that brings its files."""
        if os.path.isabs(self.file):
            raise CampaignError(f"{why}; give the campaign by a relative path to send it")
        if self.texts is None:
            self.texts = {os.path.normpath(name): path.read_bytes()
                          for name, path in self.paths.items() if not path.is_absolute()}
        return replace(task, texts=self.texts)


def _collect(executor: futures.Executor, work: _Work, parts: _Parts, retries: int) -> None:
    """Runs the shards that are missing."""
    def submit(number: int, task: _Task) -> None:
        pending[executor.submit(_run_shard, task)] = (number, task)

    pending: dict[futures.Future[_Answer], tuple[int, _Task]] = {}
    left = dict.fromkeys(parts.missing(), retries)
    try:
        for number in left:
            submit(number, work.task(f"{number}/{parts.shards}"))
        while pending:
            done, _ = futures.wait(pending, return_when=futures.FIRST_COMPLETED)
            for future in done:
                number, task = pending.pop(future)
                answer = _answer_of(future)
                if answer.kind == ROWS:
                    parts.take(number, answer.rows)
                elif answer.kind == MISSING:
                    submit(number, work.with_texts(task, answer.text))
                elif answer.kind == LOST and left[number] > 0:
                    left[number] -= 1
                    submit(number, task)
                else:
                    raise CampaignError(answer.text)
    except futures.BrokenExecutor as broken:
        raise CampaignError(f"the executor has broken: {broken}; the rows so far are in "
                            f"{parts.folder}: call again with a new one") from broken
    finally:
        for future in pending:
            future.cancel()


def _answer_of(future: futures.Future[_Answer]) -> _Answer:
    try:
        return future.result()
    except futures.BrokenExecutor:
        raise
    except Exception as problem:  # pylint: disable=broad-except # the worker has been killed
        return _Answer(LOST, f"{type(problem).__name__}: {problem}")


# ---- Files ---------------------------------------------------------------------------------------


def _sync(path: pathlib.Path) -> None:
    """Makes a file, or the names in a folder, safe."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class _Parts:
    """The folder OUT.parts: a file of rows for each finished shard, and what they are of."""

    def __init__(self, out: pathlib.Path, resume: bool):
        self.out, self.shards = out, 0
        self.folder = out.with_name(out.name + ".parts")
        self.folder.mkdir(exist_ok=True)
        self.about = self.folder / "campaign.json"
        self.lock = open(self.about, "a+", encoding="utf-8")  # pylint: disable=consider-using-with
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.lock.close()
            raise CampaignError(f"{self.folder}: another program is writing it") from None
        if not resume:
            self._clear()

    def __enter__(self) -> _Parts:
        return self

    def __exit__(self, *problem: object) -> None:
        if not self.lock.closed:
            self.lock.close()

    def _clear(self) -> None:
        for path in self.folder.iterdir():
            if path != self.about:
                path.unlink()
        self.lock.truncate(0)

    def begin(self, digest: str, shards: int | None) -> None:
        """Says what the parts are of; refuses those of another campaign."""
        self.lock.seek(0)
        text = self.lock.read()
        about = json.loads(text) if text.endswith("}\n") else {}
        self.shards = shards or about.get("shards") or SHARDS
        wanted = {"digest": digest, "shards": self.shards}
        if about and about != wanted:
            what = "of another campaign" if about["digest"] != digest else \
                f"{about['shards']} shards, not {shards}"
            raise CampaignError(f"{self.folder}: it is {what}; remove it, or call with "
                                "resume=False")
        if not about:
            self._clear()
            self.lock.write(json.dumps(wanted) + "\n")
            self.lock.flush()
            _sync(self.about)

    def _part(self, number: int) -> pathlib.Path:
        return self.folder / f"{number}.ndjson"

    def missing(self) -> list[int]:
        return [number for number in range(1, self.shards + 1) if not self._part(number).exists()]

    def take(self, number: int, rows: bytes) -> None:
        """Keeps the rows of a shard."""
        half = self.folder / f"{number}.half"
        half.write_bytes(rows)
        _sync(half)
        half.replace(self._part(number))

    def join(self) -> pathlib.Path:
        """Puts all rows one after the other, as those of a run that goes on; its file."""
        whole = self.folder / "rows.ndjson"
        whole.unlink(missing_ok=True)
        with open(self.folder / "rows.ndjson.part", "wb") as to:
            for number in range(1, self.shards + 1):
                with open(self._part(number), "rb") as part:
                    shutil.copyfileobj(part, to, 1 << 20)
        return whole

    def deliver(self) -> None:
        """Gives the whole file its name, and removes the folder."""
        (self.folder / "rows.ndjson").replace(self.out)
        _sync(self.out.parent)
        shutil.rmtree(self.folder)
