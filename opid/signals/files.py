"""Files are written whole or not at all, and for one that does not exist its neighbours are looked at."""

from __future__ import annotations

import os
import secrets
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import IO, Any, Literal

from opid.errors import InputError


def nearest_beside(path: Path, endings: Container[str] | None = None) -> str:
    """Return the hint for a path that does not exist: what has a like name beside it, or what to check.

    Args:
        path: what was asked for.
        endings: of the files that may be meant; of any file or directory where left out.
    """
    if not path.parent.is_dir():
        return f", nor a directory {path.parent}: check the path"
    names: list[str] = []
    with suppress(OSError):  # a directory that may not be listed
        names = [each.name for each in path.parent.iterdir() if endings is None or each.suffix.lower() in endings]
    close = get_close_matches(path.name, names, n=1)
    return f": did you mean {close[0]!r}?" if close else ": check the name and the directory"


@contextmanager
def written_whole(
    path: str | os.PathLike[str],
    mode: Literal["w", "wb"] = "w",
    *,
    encoding: str = "utf-8",
    newline: str = "\n",
) -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when the block has ended without an error.

    The text goes to a temporary name in the same directory and is moved over `path` at the end; after a
    failure the temporary file is gone and an older file at `path` is what it was.

    Args:
        path: the file to write; its directory must exist.
        mode: "w" for text, "wb" for bytes.
        encoding: of text.
        newline: the end of a line of text.

    Raises:
        InputError: the directory is missing, full or not writable, or `path` is no ordinary file.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     with written_whole(f"{directory}/note.txt") as file:
    ...         _ = file.write("done")
    ...     Path(directory, "note.txt").read_text()
    'done'
    """
    target = Path(os.path.realpath(path))  # write through a link, do not replace it
    if not target.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no directory {target.parent}: create it first")
    if target.exists() and not target.is_file():
        raise InputError(f"cannot write {path}: it is a directory or a device: give the name of a file")
    temporary = target.with_name(f".{target.name[:200]}.{secrets.token_hex(4)}.part")
    text = {"encoding": encoding, "newline": newline} if mode == "w" else {}
    try:
        # "x" makes the file with the user's usual permissions, which tempfile would not
        with open(temporary, mode.replace("w", "x"), **text) as file:  # type: ignore[call-overload]
            yield file
        os.replace(temporary, target)
    except OSError as error:
        # an error that names another file is the caller's own; a failed write (a full disk) names none
        if error.filename not in (None, str(temporary), temporary):
            raise
        raise InputError(f"cannot write {path}: {error.strerror or error}: choose another place") from error
    finally:
        with suppress(FileNotFoundError):
            os.remove(temporary)
