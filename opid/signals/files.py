"""Write files whole or not at all, into directories that are made when needed, and read the text of small tables."""

from __future__ import annotations

import os
import secrets
from collections.abc import Container, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import IO, Any, Literal

from opid.errors import InputError


def nearest_beside(path: Path, endings: Container[str] | None = None) -> str:
    """Return a hint for a path that does not exist: a similar name in its directory, or what to check.

    Args:
        path: path of the file that does not exist.
        endings: endings of the files that may be suggested; by default any file or directory may be.
    """
    if not path.parent.is_dir():
        return f", nor a directory {path.parent}: check the path"
    names: list[str] = []
    with suppress(OSError):  # a directory that may not be listed
        names = [each.name for each in path.parent.iterdir() if endings is None or each.suffix.lower() in endings]
    close = get_close_matches(path.name, names, n=1)
    return f": did you mean {close[0]!r}?" if close else ": check the name and the directory"


def read_table_text(path: Path, header: str) -> tuple[str, str]:
    """Return the text of a small table and its delimiter, which is that of its first line that is no comment.

    Args:
        path: path of the file.
        header: a header that such a file may have, which the error names.

    Raises:
        InputError: the file is not UTF-8 text, or its first line has no tab, semicolon or comma.
        OSError: the file cannot be read.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("it is not UTF-8 text: save it as CSV in UTF-8") from None
    lines = (line for line in text.splitlines() if line.strip())
    first = next((line for line in lines if not line.lstrip().startswith("#")), "")
    delimiter = next((mark for mark in "\t;," if mark in first), None)
    if delimiter is None:
        raise InputError(f"its first line has one column: give a header like {header}")
    return text, delimiter


@contextmanager
def write_whole(path: str | os.PathLike[str], mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when the block has ended without an error.

    The content is written under a temporary name in the same directory and moved to `path` at the end. After a failure
    the temporary file is deleted, and an older file at `path` is unchanged.

    Args:
        path: the file to write; its directory must exist.
        mode: "w" for text in UTF-8 with "\\n" at the end of lines, "wb" for bytes.

    Raises:
        InputError: the directory is missing, full or not writable, or `path` is no ordinary file.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     with write_whole(f"{directory}/note.txt") as file:
    ...         _ = file.write("done")
    ...     Path(directory, "note.txt").read_text()
    'done'
    """
    target = Path(os.path.realpath(path))  # a link is written through, not replaced
    if not target.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no directory {target.parent}: create it first")
    if target.exists() and not target.is_file():
        raise InputError(f"cannot write {path}: it is a directory or a device: give the name of a file")
    temporary = target.with_name(f".{target.name[:200]}.{secrets.token_hex(4)}.part")
    text = {"encoding": "utf-8", "newline": "\n"} if mode == "w" else {}
    try:
        # "x" makes the file with the user's usual permissions, which tempfile would not
        with open(temporary, mode.replace("w", "x"), **text) as file:  # type: ignore[call-overload]
            yield file
        os.replace(temporary, target)
    except OSError as error:
        # an error that names another file comes from the caller; a failed write (a full disk) names no file
        if error.filename not in (None, str(temporary), temporary):
            raise
        raise InputError(f"cannot write {path}: {error.strerror or error}: choose another place") from error
    finally:
        with suppress(FileNotFoundError):
            os.remove(temporary)


def require_directory(path: str | os.PathLike[str]) -> Path:
    """Return the path of a directory that exists or can be made, without making it.

    It is called before long work, so that a mistyped path does not waste that work.

    Raises:
        InputError: a file has this path, or the directory is not writable.

    >>> require_directory(".")
    PosixPath('.')
    """
    target = Path(path)
    there = next(part for part in (target, *target.absolute().parents) if os.path.lexists(part))
    if not there.is_dir():
        raise InputError(f"cannot write into {path}: {there} is no directory: choose another place")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"cannot write into {path}: {there} is not writable: choose another place")
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
        raise InputError(f"cannot make the directory {path}: {error.strerror}: choose another place") from error
    return target


def write_together(directory: str | os.PathLike[str], contents: Mapping[str, bytes]) -> None:
    """Write several files so that either all of them appear or none; other files in the directory stay.

    Args:
        directory: path of the directory; it is made if it does not exist, and then deleted again after a failure.
        contents: {name of the file: bytes}.

    Raises:
        InputError: the directory cannot be written to.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     write_together(f"{parent}/new", {"a": b"1", "b": b"2"})
    ...     sorted(os.listdir(f"{parent}/new"))
    ['a', 'b']
    """
    target = Path(directory)
    made = [part for part in (target, *target.parents) if not part.exists()]
    make_directory(target)
    try:
        with ExitStack() as stack:
            files = {name: stack.enter_context(write_whole(target / name, "wb")) for name in contents}
            for name, content in contents.items():
                files[name].write(content)
                # a full disk must show before the first file is moved to its name
                files[name].flush()
    except BaseException:
        for part in made:
            with suppress(OSError):
                part.rmdir()
        raise
