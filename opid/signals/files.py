"""Write files whole or not at all, alone or together as a directory, and read the text of small tables.

What is written stands under a hidden name that ends in ".part" until it is complete. The process that writes it holds a
lock of the system on it, which ends with the process, however it dies: the next one that gets the lock removes what was
left. On a system or a network disk without such locks each process takes a hidden name of its own, and waits for
nobody; what a dead one has left there stays.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import os
import secrets
import shutil
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import IO, Any, Literal

from opid.errors import FileError, InputError
from opid.provenance import read_content

PATIENCE_S = 10.0
"""How long one that has done its work waits for another that writes to the same place, which takes milliseconds."""

_POLL_S, _LONGEST_NAME, _LONGEST_LINE = 0.01, 200, 1_000_000
_DEEPEST, _MOST_TRIES = 200, 100
_HIDDEN, _NEW, _OLD, _NAMES, _LOCK = ".opid.part", "new", "old", "names", "lock"


def nearest_beside(path: Path, endings: Container[str] | None = None) -> str:
    """Return a hint for a path that does not exist: a similar name in its directory, or what to check.

    Args:
        path: path of the file that does not exist.
        endings: endings of the files that may be suggested; by default any file or directory may be.
    """
    if os.path.lexists(path):
        return ", but a directory, a pipe, a device or a link that leads nowhere: give the name of a file"
    if not path.parent.is_dir():
        return f", nor a directory {path.parent}: check the path"
    names: list[str] = []
    with suppress(OSError):  # a directory that may not be listed
        names = [each.name for each in path.parent.iterdir() if endings is None or each.suffix.lower() in endings]
    close = get_close_matches(path.name, names, n=1)
    return f": did you mean {close[0]!r}?" if close else ": check the name and the directory"


def read_text(path: Path) -> str:
    """Return the text of a small table.

    Args:
        path: path of the file.

    Raises:
        InputError: the file is not UTF-8 text, or has a line that no table has; the path is not in the words.
        OSError: the file cannot be read.
    """
    try:
        text = read_content(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("it is not UTF-8 text: save it as CSV in UTF-8") from None
    longest = max(map(len, text.splitlines()), default=0)
    if longest > _LONGEST_LINE:
        raise InputError(
            f"it has a line of {longest} characters, and a table has at most {_LONGEST_LINE}: save it again"
        )
    return text


def read_table_text(path: Path, header: str) -> tuple[str, str]:
    """Return the text of a small table and its delimiter, which is that of its first line that is no comment.

    Args:
        path: path of the file.
        header: a header that such a file may have, which the error names.

    Raises:
        InputError: as of `read_text`, or its first line has no tab, semicolon or comma.
        OSError: the file cannot be read.
    """
    text = read_text(path)
    lines = (line for line in text.splitlines() if line.strip())
    first = next((line for line in lines if not line.lstrip().startswith("#")), "")
    delimiter = next((mark for mark in "\t;," if mark in first), None)
    if delimiter is None:
        raise InputError(f"its first line has one column: give a header like {header}")
    return text, delimiter


def read_table(path: Path, delimiters: str = ";,") -> tuple[list[list[str]], str]:
    """Return the rows of a small table, blank ones among them, without blanks around their cells; and its delimiter.

    Args:
        path: path of the file.
        delimiters: the first of these that its first line with content has is its delimiter; the last where it has
            none.

    Raises:
        InputError: as of `read_text` and `split_rows`.
        OSError: the file cannot be read.
    """
    text = read_text(path)
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((mark for mark in delimiters if mark in first), delimiters[-1])
    return split_rows(text, delimiter), delimiter


def split_rows(text: str, delimiter: str) -> list[list[str]]:
    """Return the cells of a text in CSV, row by row, without blanks around them.

    Args:
        text: of the table.
        delimiter: between two cells of a row.

    Raises:
        InputError: a quotation mark that is not closed, or a cell that is longer than any; no path is in the words.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        return [[cell.strip() for cell in row] for row in reader]
    except csv.Error as error:
        raise InputError(f"line {reader.line_num} is no row of a table ({error}): mend this line") from error


@contextmanager
def write_whole(path: str | os.PathLike[str], mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when the block has ended without an error.

    The content is written under a temporary name in the same directory and moved to `path` at the end. After a failure
    the temporary file is deleted, and an older file at `path` is unchanged.

    Args:
        path: the file to write; its directory must exist.
        mode: "w" for text in UTF-8 with "\\n" at the end of lines, "wb" for bytes.

    Raises:
        InputError: the directory is missing, full or not writable, `path` is no ordinary file, or another process
            writes it.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     with write_whole(f"{directory}/note.txt") as file:
    ...         _ = file.write("done")
    ...     Path(directory, "note.txt").read_text()
    'done'
    """
    target = Path(os.path.realpath(path))  # a link is written through, not replaced
    if not target.parent.is_dir():
        raise FileError(f"cannot write {path}: there is no directory {target.parent}: create it first")
    if target.exists() and not target.is_file():
        raise FileError(f"cannot write {path}: it is a directory or a device: give the name of a file")
    temporary = target.with_name(f".{shorten_name(target.name)}.part")
    text = {"encoding": "utf-8", "newline": "\n"} if mode == "w" else {}
    try:
        temporary, alone = _open_alone(temporary, PATIENCE_S, f"write {path}")
        with open(temporary, mode, opener=lambda *_: alone.descriptor, **text) as file:  # type: ignore[call-overload]
            try:
                yield file
                file.flush()
                if not alone.is_locked:
                    file.close()
                # while it is locked nobody else takes it for left over
                os.replace(temporary, target)
            except BaseException:
                with suppress(OSError):
                    if not alone.is_locked:
                        file.close()
                    os.remove(temporary)
                raise
    except OSError as error:
        # an error that names another file comes from the caller; a failed write (a full disk) names no file
        if error.filename not in (None, str(temporary), temporary):
            raise
        raise FileError(f"cannot write {path}: {error.strerror or error}: choose another place") from error


def shorten_name(name: str) -> str:
    """Return the name of a file, or a digest of one that has no room for a further ending."""
    encoded = os.fsencode(name)
    return name if len(encoded) <= _LONGEST_NAME else hashlib.sha256(encoded).hexdigest()


@dataclass(frozen=True)
class _Alone:
    """An open file that no other process has, or, where the system has no locks, one of a name of its own."""

    descriptor: int
    is_locked: bool


def _open_alone(path: Path, wait_s: float, what: str) -> tuple[Path, _Alone]:
    """Open a file for writing that no other process has opened by this function, empty, and return its path.

    Raises:
        InputError: another process still has it after `wait_s`.
        OSError: it cannot be opened.
    """
    until = time.monotonic() + wait_s
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            is_locked = _lock(descriptor)
            with suppress(FileNotFoundError):
                # the one who had it before may have moved or removed it
                if is_locked and os.path.samestat(found := os.fstat(descriptor), os.stat(path)):
                    if found.st_size:
                        os.truncate(descriptor, 0)
                    return path, _Alone(descriptor, True)
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        if is_locked is None:
            with suppress(OSError):
                os.remove(path)
            path = path.with_name(f"{path.name.removesuffix('.part')}.{secrets.token_hex(4)}.part")
            return path, _Alone(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666), False)
        if time.monotonic() >= until and not is_locked:
            raise FileError(
                f"cannot {what}: another process of opid is writing there: wait until it has ended, or choose another "
                "place"
            )
        time.sleep(_POLL_S)


def _lock(descriptor: int) -> bool | None:
    """Lock an open file until it is closed; return False if another process has it, None if there are no locks."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


# ---- several files together ------------------------------------------------------------------------


def require_directory(path: str | os.PathLike[str]) -> Path:
    """Return the path of a directory that exists or can be made, without making it.

    It is called before long work, so that a mistyped path does not waste that work.

    Raises:
        InputError: a file has this path, or the directory is not writable.

    >>> require_directory(".")
    PosixPath('.')
    """
    target = Path(path)
    if len(target.parts) > _DEEPEST:
        raise FileError(
            f"cannot write into {path}: it lies {len(target.parts)} directories deep, and at most {_DEEPEST} are made: "
            "choose another place"
        )
    there = next(part for part in (target, *target.absolute().parents) if os.path.lexists(part))
    if not there.is_dir():
        raise FileError(f"cannot write into {path}: {there} is no directory: choose another place")
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileError(f"cannot write into {path}: {there} is not writable: choose another place")
    return target


def make_directory(path: str | os.PathLike[str]) -> Path:
    """Make the directory `path`, and those above it, unless it exists.

    Raises:
        InputError: a file has this path, or the directory is not writable.
    """
    target = require_directory(path)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the directory {path}: {error.strerror}: choose another place") from error
    return target


@dataclass
class ReservedDirectory(os.PathLike[str]):
    """A directory into which nobody else writes, from `reserve_directory`.

    Args:
        path: as it was given; the directory need not exist.
        hidden: the folder of what is not complete.
    """

    path: Path
    hidden: Path
    _last: str = field(default="", init=False)
    _stale: set[str] = field(default_factory=set, init=False)
    _is_open: bool = field(default=False, init=False)

    def __fspath__(self) -> str:
        return str(self.path)

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    @contextmanager
    def replace_files(self, *, last: str = "", stale: Iterable[str] = ()) -> Iterator[Path]:
        """Give an empty folder, whose files stand in the directory when the block has ended without an error.

        A directory that does not exist appears with all of them at once: the folder gets its name. In one that exists
        older files of the same names are moved away first, then the new ones are moved in, within microseconds, and
        all is moved back if one cannot be; any other file stays. The file `last` says that a result is there: it is
        the first that goes and the last that comes. So a process that is killed between leaves the whole older
        result, the whole new one, or a part of one of them without that file, never of both; who reserves the
        directory next restores the older one.

        A block within the block of the same reserved directory writes into the same folder, and replaces nothing yet.

        Args:
            last: name of the file without which nobody takes the others for a result.
            stale: names of files of an older result that go with it.

        Raises:
            InputError: the directory is full or not writable, or a directory has the name of a file.
        """
        new = self.hidden / _NEW
        self._last, self._stale = last or self._last, self._stale | {*stale}
        if self._is_open:
            yield new
            return
        self._is_open = True
        try:
            new.mkdir()
            yield new
            _exchange(self, new)
        except (OSError, InputError) as error:
            cause = error if isinstance(error, OSError) else error.__cause__
            if not isinstance(cause, OSError) or (cause.filename and not self._is_of(cause.filename)):
                raise
            raise FileError(
                f"cannot write into {self.path}: {cause.strerror or cause}: choose another place"
            ) from cause
        finally:
            _clear(self.hidden)
            self._last, self._stale, self._is_open = "", set(), False

    def _is_of(self, name: Any) -> bool:
        """Whether a file is one of the directory or of its hidden folder: an error of another comes from the caller."""
        file = Path(os.fsdecode(name))
        return file.is_relative_to(self.hidden) or file.is_relative_to(os.path.realpath(self.path))


@contextmanager
def reserve_directory(path: str | os.PathLike[str], *, wait_s: float = 0.0) -> Iterator[ReservedDirectory]:
    """Keep all other processes from writing into a directory until the block ends, and prepare to write into it.

    It is called before long work. What a process that was killed has left is removed, and an older result restored
    that it was about to replace.

    Args:
        path: of a directory that exists or can be made; one that is reserved is taken as it is.
        wait_s: how long to wait for another process that has it.

    Raises:
        InputError: another process has it, a file has this path, or the directory is full or not writable.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     with reserve_directory(f"{parent}/new") as reserved, reserved.replace_files() as folder:
    ...         _ = (folder / "a.txt").write_text("1")
    ...     os.listdir(parent), os.listdir(f"{parent}/new")
    (['new'], ['a.txt'])
    """
    if isinstance(path, ReservedDirectory):
        yield path
        return
    target = require_directory(path)
    try:
        hidden, alone = _take_hidden(target, wait_s)
    except OSError as error:
        at = f"{error.filename}: " if error.filename else ""
        raise FileError(f"cannot write into {path}: {at}{error.strerror or error}: choose another place") from error
    try:
        yield ReservedDirectory(target, hidden)
    finally:
        _release(hidden, alone)


def _release(hidden: Path, alone: _Alone) -> None:
    """Remove a hidden folder and give its lock back."""

    def remove_contents() -> None:
        _clear(hidden)
        with suppress(OSError):
            os.remove(hidden / _LOCK)

    def remove_folder() -> None:
        with suppress(OSError):  # the next process has it already
            hidden.rmdir()

    try:
        _insist(remove_contents)
    finally:
        os.close(alone.descriptor)
        _insist(remove_folder)


def _insist(remove: Callable[[], None]) -> None:
    """Remove something even if a signal comes just now."""
    try:
        remove()
    except BaseException:
        remove()
        raise


def _take_hidden(target: Path, wait_s: float) -> tuple[Path, _Alone]:
    """Make the hidden folder of a directory and lock it, and clear it of what a dead process has left."""
    for tries_left in reversed(range(_MOST_TRIES)):
        hidden, *elsewhere = _list_hidden(target)
        try:
            try:
                hidden.mkdir(exist_ok=True)
                lock, alone = _open_alone(hidden / _LOCK, wait_s, f"write into {target}")
            except BaseException:
                _remove_dead(hidden)
                raise
            if not alone.is_locked:
                lock.unlink()
                os.close(alone.descriptor)
                with suppress(OSError):
                    hidden.rmdir()
                hidden = hidden.with_name(f"{hidden.name.removesuffix('.part')}.{secrets.token_hex(4)}.part")
                hidden.mkdir()
                return hidden, _Alone(os.open(hidden / _LOCK, os.O_RDWR | os.O_CREAT, 0o666), False)
            try:
                _undo_exchange(hidden, target)
                _clear(hidden)
                for each in filter(Path.is_dir, elsewhere):
                    with suppress(PermissionError):  # somebody else has left it
                        _, left = _open_alone(each / _LOCK, wait_s, f"write into {target}")
                        _undo_exchange(each, target)
                        _release(each, left)
                if hidden == _list_hidden(target)[0]:
                    return hidden, alone
            except BaseException:
                _release(hidden, alone)
                raise
            # the directory has appeared meanwhile
            _release(hidden, alone)
        except FileNotFoundError:
            # another process has just removed it, unless this goes on
            if not tries_left:
                raise
    raise OSError(errno.EBUSY, "other processes make and remove it all the time")


def _remove_dead(hidden: Path) -> None:
    """Remove a hidden folder that no process has locked."""
    with suppress(OSError, InputError):
        _release(hidden, _open_alone(hidden / _LOCK, 0.0, "remove")[1])


def _list_hidden(target: Path) -> list[Path]:
    """Return where the hidden folder of a directory is: in it, or in the nearest one above that exists.

    Those in the others follow, which one has used who came when fewer directories were there.
    """
    whole = Path(os.path.realpath(target))
    above = [part for part in whole.parents if part.is_dir()]
    named = [part / f".{shorten_name('.'.join(whole.relative_to(part).parts))}.part" for part in above]
    return [whole / _HIDDEN, *named] if whole.is_dir() else named


def _clear(hidden: Path) -> None:
    """Remove what is in a hidden folder but its lock, unless it has what could not be restored."""
    with suppress(OSError):
        if os.listdir(hidden / _OLD) and os.listdir(hidden / _NEW):
            return
    for name in (_NEW, _OLD):
        shutil.rmtree(hidden / name, ignore_errors=True)
    with suppress(OSError):
        (hidden / _NAMES).unlink()


def _exchange(reserved: ReservedDirectory, new: Path) -> None:
    """Move all files from the folder `new` into the directory, in the place of those of an older result."""
    target, last = Path(os.path.realpath(reserved.path)), reserved._last
    if not target.is_dir():
        made = [part for part in target.parents if not part.exists()]
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            new.rename(target)
        except BaseException:
            for part in made:
                with suppress(OSError):
                    part.rmdir()
            raise
        return
    names = sorted(os.listdir(new), key=lambda name: (name == last, name))
    older = [name for name in {last: 0} | dict.fromkeys((*names, *sorted(reserved._stale))) if name]
    older = [name for name in older if os.path.lexists(target / name)]
    for name in older:
        if (target / name).is_dir():
            raise FileError(f"cannot write {reserved / name}: it is a directory: choose another place")
    (new.parent / _NAMES).write_bytes(b"\0".join(map(os.fsencode, names)))
    (new.parent / _OLD).mkdir()
    try:
        for name in older:
            (target / name).rename(new.parent / _OLD / name)
        for name in names:
            (new / name).rename(target / name)
    except BaseException:
        _undo_exchange(new.parent, target)
        raise


def _undo_exchange(hidden: Path, target: Path) -> None:
    """Restore the older files of an exchange that has begun and is not complete; it may itself be interrupted."""
    new, old, target = hidden / _NEW, hidden / _OLD, Path(os.path.realpath(target))
    if not old.is_dir() or not new.is_dir() or not os.listdir(new):
        return
    for name in map(os.fsdecode, (hidden / _NAMES).read_bytes().split(b"\0")):
        if name != os.path.basename(name) or name in ("", ".", ".."):
            continue  # opid did not write it
        if not (new / name).exists() and (target / name).exists():
            (target / name).rename(new / name)
    for name in os.listdir(old):
        (old / name).replace(target / name)


def write_together(
    directory: str | os.PathLike[str], contents: Mapping[str, bytes], *, stale: Iterable[str] = ()
) -> None:
    """Write several files so that either all of them appear or none; other files in the directory stay.

    Args:
        directory: path of the directory; it is made if it does not exist.
        contents: {name of the file: bytes}; the last one is that of `replace_files`.
        stale: names of older files that go when these appear.

    Raises:
        InputError: the directory cannot be written to.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     write_together(f"{parent}/new", {"a": b"1", "b": b"2"})
    ...     sorted(os.listdir(f"{parent}/new"))
    ['a', 'b']
    """
    with (
        reserve_directory(directory, wait_s=PATIENCE_S) as reserved,
        reserved.replace_files(last=[*contents][-1] if contents else "", stale=stale) as folder,
    ):
        for name, content in contents.items():
            with open(folder / name, "xb") as file:
                file.write(content)
