"""Files that a library parses are read in a process of their own, whose memory and computing time are bounded.

A file that is cut off or damaged can make such a library compute for ever, take all memory or end the program. A check
of each format before its library reads it would be another parser, and never complete. The bounds grow with the size of
the file, and the system enforces them: Linux both, macOS only the time, Windows none.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import IO, Any

from opid.errors import InputError
from opid.signals.log import Block, Log, LogSettings, Rows, Track


@dataclass(frozen=True)
class ReadingBounds:
    """How much time and memory a library may use to open a file, and again for each block of it."""

    seconds: float = 20.0  # of the processor for a file of any size: some libraries need seconds to load
    bytes_per_s: float = 5e5  # bytes of the file for a further second; the slowest library parses ten times as many
    memory_bytes: int = 2 << 30  # in addition to what the process uses before it opens the file, for a file of any size
    # further memory for each byte of the file: a file that is read whole is held several times
    memory_per_byte: int = 8


BOUNDS = ReadingBounds()

_MOST_IDLE = 2  # processes that wait for the next file


class ReadingEndedError(Exception):
    """The process that reads a file has ended without an answer."""


def open_apart(opener: str, path: Path, settings: LogSettings) -> Log:
    """Open a log in a process of its own, which also reads its blocks; of any other error it raises RuntimeError."""
    process = _take_process()
    try:
        log = process.ask("open", os.getcwd(), opener, path, settings, BOUNDS)
    except Exception:
        _take_back(process)
        raise
    own = _Owner(process)
    weakref.finalize(own, _take_back, process)
    tracks = (
        replace(track, rows=_make_rows(own, number), locate=partial(_locate, own, number))
        for number, track in enumerate(log.tracks)
    )
    return replace(log, tracks=tuple(tracks))


def read_apart(reader: str, path: Path) -> Any:
    """Return what a function makes of a whole file in a process of its own.

    Args:
        reader: "module:function"; the function takes the path, and what it returns is pickled.
        path: the file.

    Raises:
        InputError, MemoryError, ModuleNotFoundError, OSError: as the function raises them.
        ReadingEndedError: the process has broken down, or took too long.
        RuntimeError: the function raised anything else.
    """
    process = _take_process()
    try:
        return process.ask("read", os.getcwd(), reader, path, BOUNDS)
    finally:
        _take_back(process)


class _Process:
    """A Python process that answers requests one by one; requests and answers are pickles in its pipes."""

    def __init__(self) -> None:
        found = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        self._python = subprocess.Popen(
            [sys.executable, "-c", f"from {__name__} import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pipesize=1 << 20,
            env={**os.environ, "PYTHONPATH": found},
        )
        self._lock = threading.Lock()
        _every.add(self)

    @property
    def has_ended(self) -> bool:
        return self._python.poll() is not None

    def ask(self, what: str, *given: Any) -> Any:
        """Return the answer to a request, or raise the exception that is the answer."""
        requests, replies = self._python.stdin, self._python.stdout
        assert requests is not None
        assert replies is not None
        with self._lock:
            try:
                _send(requests, (what, given))
                answer = pickle.load(replies)
            except (EOFError, OSError, pickle.UnpicklingError):
                raise ReadingEndedError(self._describe_end()) from None
            except BaseException:  # the answer that is still to come would be mistaken for the next one
                self.end()
                raise
        if isinstance(answer, Exception):
            raise answer
        return answer

    def end(self) -> None:
        _every.discard(self)
        self._python.kill()
        self._python.wait()
        for pipe in (self._python.stdin, self._python.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]

    def _describe_end(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._python.wait(10)
        timed_out = self._python.returncode == -getattr(signal, "SIGXCPU", 0)
        self.end()
        return "reading it takes far too long" if timed_out else "the library that reads it broke down"


def _send(pipe: IO[bytes], value: Any) -> None:
    pickle.dump(value, pipe, 5)
    pipe.flush()


@dataclass(eq=False)
class _Owner:
    """Keeps a process for as long as a log exists."""

    process: _Process


_idle: list[_Process] = []
_every: set[_Process] = set()


def _take_process() -> _Process:
    return _idle.pop() if _idle else _Process()


def _take_back(process: _Process) -> None:
    with suppress(ReadingEndedError):
        if not process.has_ended:
            process.ask("forget")
            if len(_idle) < _MOST_IDLE:
                _idle.append(process)
                return
    process.end()


@atexit.register
def end_processes() -> None:
    """End all processes that read files."""
    for process in [*_every]:
        process.end()


if hasattr(os, "register_at_fork"):  # they only answer the process that started them
    os.register_at_fork(after_in_child=_idle.clear)
    os.register_at_fork(after_in_child=_every.clear)


def _make_rows(own: _Owner, track: int) -> Rows:
    def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
        number = next(_numbers)
        try:
            while (block := own.process.ask("next", number, track, list(columns), start, stop)) is not None:
                yield block
        except GeneratorExit:
            own.process.ask("stop", number)
            raise

    return rows


_numbers = count()


def _locate(own: _Owner, track: int, row: int) -> str:
    return own.process.ask("locate", track, row)


# ---- in that process -------------------------------------------------------------------------------


def serve() -> None:
    """Answer requests until there are no more; whatever libraries print is discarded."""
    requests, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for own in (0, 1, 2):
        os.dup2(nowhere, own)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt ends the asking process, which ends this one
    reading = _Reading()
    with suppress(EOFError):
        while True:
            what, given = pickle.load(requests)
            try:
                answer = getattr(reading, what)(*given)
            except (InputError, MemoryError, ModuleNotFoundError) as error:
                answer = error
            except Exception as error:  # its class may exist in the library only
                errno = error.errno if isinstance(error, OSError) else None
                answer = RuntimeError(str(error).strip() or type(error).__name__) if errno is None else error
            _send(replies, answer)
            reading.read_ahead()


class _Reading:
    """Answers requests about one file at a time; each method is a request."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self.forget()

    def forget(self) -> None:
        self._tracks: tuple[Track, ...] = ()
        self._blocks: dict[int, Iterator[Block]] = {}
        self._ahead: dict[int, Block | Exception | None] = {}
        self._read_last: int | None = None

    def read(self, directory: str, reader: str, path: Path, bounds: ReadingBounds, *settings: Any) -> Any:
        os.chdir(directory)
        size = path.stat().st_size
        self._seconds = bounds.seconds + size / bounds.bytes_per_s
        _bound_memory(bounds.memory_bytes + bounds.memory_per_byte * size)
        _bound_time(self._seconds)
        module, _, name = reader.partition(":")
        return getattr(import_module(module), name)(path, *settings)

    def open(self, directory: str, opener: str, path: Path, settings: LogSettings, bounds: ReadingBounds) -> Log:
        log = self.read(directory, opener, path, bounds, settings)
        self._tracks = log.tracks
        return replace(
            log, tracks=tuple(replace(track, rows=_refuse_call, locate=_refuse_call) for track in log.tracks)
        )

    def next(self, number: int, track: int, columns: Sequence[int], start: int, stop: int | None) -> Block | None:
        _bound_time(self._seconds)
        if number not in self._blocks:
            self._blocks[number] = self._tracks[track].blocks(columns, start, stop)
        block = self._ahead.pop(number) if number in self._ahead else next(self._blocks[number], None)
        if isinstance(block, Exception):
            raise block
        self._read_last = None if block is None else number
        return block

    def read_ahead(self) -> None:
        """Read the next block while the asking process works on the last one."""
        number, self._read_last = self._read_last, None
        if number is not None:
            try:
                self._ahead[number] = next(self._blocks[number], None)
            except Exception as error:
                self._ahead[number] = error

    def stop(self, number: int) -> None:
        self._blocks.pop(number, None)
        self._ahead.pop(number, None)

    def locate(self, track: int, row: int) -> str:
        return self._tracks[track].locate(row)


def _refuse_call(*_: object) -> Any:
    raise AssertionError


def _bound_memory(n_bytes: int) -> None:
    with suppress(OSError):  # macOS has no such file
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _set_bound("RLIMIT_AS", pages * os.sysconf("SC_PAGE_SIZE") + n_bytes)


def _bound_time(seconds: float) -> None:
    _set_bound("RLIMIT_CPU", int(time.process_time() + seconds) + 1)


def _set_bound(name: str, bound: int) -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        kind = getattr(resource, name)
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))
