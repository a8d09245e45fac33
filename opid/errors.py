"""The two ways in which a call can fail for a reason that belongs to the user, and how that is said."""

import difflib
import math
import re
import shlex
import sys
from collections import Counter
from collections.abc import Hashable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

Key = TypeVar("Key", bound=Hashable)


class InputError(ValueError):
    """The input is not usable: the message says what was given, what was needed and what to do."""

    def reword(self, message: str) -> "InputError":
        """Return an error with another message, which names its file if this one does."""
        return FileError(message) if isinstance(self, FileError) else InputError(message)


class FileError(InputError):
    """A file or a folder is not usable: the message names it, so that whoever passes it on need not."""


class NotDeterminedError(RuntimeError):
    """The input is sound but the data do not determine the answer.

    `partial` carries what could be determined (or None), so that nothing is lost.
    """

    def __init__(self, message: str, partial: object = None) -> None:
        super().__init__(message)
        self.partial = partial


def missing_library(what: str, library: str, extra: str) -> InputError:
    """Return the refusal of what needs a library that is not installed.

    Args:
        what: needs it.
        library: its name for pip.
        extra: of opid that installs it.
    """
    return InputError(
        f"{what} needs {library}, which is not installed: run `{pip_install(f'.[{extra}]')}` in a clone of opid, "
        f"or `{pip_install(library)}`"
    )


def pip_install(what: str) -> str:
    """Return the command that installs something for the Python that runs, whatever else is called pip.

    Args:
        what: the name of a library, or a folder with its extras.
    """
    return shlex.join([sys.executable, "-m", "pip", "install", what])


def require(module: str, what: str, library: str, extra: str) -> None:
    """Refuse before long work what could not be done after it.

    Args:
        module: that will be imported.
        what: needs it, as `missing_library` has the rest.
        library: its name for pip.
        extra: of opid that installs it.

    Raises:
        InputError: the module is not there.
    """
    if find_spec(module) is None:
        raise missing_library(what, library, extra)


def require_positive(what: str, value: float) -> float:
    """Return a number as a float, or refuse it.

    Args:
        what: the name of the number in the sentence.
        value: must be finite and above zero.

    Raises:
        InputError: it is not.
    """
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what} is {value}: give a positive number")
    return float(value)


def require_fraction(what: str, value: float) -> float:
    """Return a value, and refuse one that is no fraction below 1, NaN included.

    Args:
        what: how the sentence calls it.
        value: the value.

    Raises:
        InputError: it is below 0, 1 or more, or no number.

    >>> require_fraction("gain_tolerance", 0.01)
    0.01
    """
    if not 0.0 <= value < 1.0:
        raise InputError(f"{what} is {value}: give a fraction from 0 to below 1, 0.01 for 1 %")
    return value


def refuse(faults: list[str], source: Path | None) -> None:
    """Say everything that is wrong at once.

    Args:
        faults: one clause each, said once however often it stands there; none of them, no error.
        source: the study file, if there is one.

    Raises:
        InputError: there is a fault.
    """
    each_once = list(dict.fromkeys(faults))
    if not each_once:
        return
    listed = "; ".join(f"({number}) {fault}" for number, fault in enumerate(each_once, start=1))
    message = each_once[0] if len(each_once) == 1 else f"{len(each_once)} faults: {listed}"
    if source:
        raise FileError(f"{source}: {message}")
    raise InputError(message)


LEAST_BEGUN, MOST_BEGUN = 3, 4
"""Letters of a word that is taken for the beginning of others, and how many of them are named."""

MOST_LISTED = 24
"""Words that are listed: of more, as the degrees of freedom of a structure, only the first and the last."""


def meant_by(name: str, known: Iterable[str]) -> list[str]:
    """Return the known words that `name` may be meant for: the nearest one, and those that begin so.

    >>> meant_by("tittle", ["title", "runs"]), meant_by("mass", ["title", "runs"])
    (['title'], [])
    """
    words = list(known)
    close = difflib.get_close_matches(name, words, n=1)
    begun = [word for word in words if len(name) >= LEAST_BEGUN and word.startswith(name)]
    return list(dict.fromkeys((*close, *begun))) if 0 < len(begun) <= MOST_BEGUN else close


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a clause that names the known word nearest to `name` and those that begin so, or lists the known words.

    >>> nearest("tittle", ["title", "runs"])
    "did you mean 'title'?"
    >>> nearest("cubic", ["cubic_damping", "title", "cubic_stiffness"])
    "did you mean 'cubic_damping', 'cubic_stiffness'?"
    >>> nearest("mass", ["title", "runs"])
    "known are 'title', 'runs'"
    """
    words = list(known)
    close = meant_by(name, words)
    if close:
        return f"did you mean {', '.join(map(repr, close))}?"
    if len(words) > MOST_LISTED:
        return f"there are {len(words)}, {words[0]!r} to {words[-1]!r}"
    return "known are " + ", ".join(repr(word) for word in words)


def list_names(names: Iterable[object], most: int = 6) -> str:
    """Return names in a sentence; if there are more than `most`, the first of them and the number of the others.

    >>> list_names("abcdefgh"), list_names("ab")
    ('a, b, c, d, e, f and 2 more', 'a, b')
    """
    words = [str(name) for name in names]
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


def count_repeats(names: Iterable[Key]) -> dict[Key, int]:
    """Return the names that stand more than once, and how often each does, in time that grows with their number.

    >>> count_repeats(["a", "b", "a"])
    {'a': 2}
    """
    return {name: n for name, n in Counter(names).items() if n > 1}


def shorten_middle(text: str, most: int, mark: str = "…") -> str:
    """Return a text whose middle is left out where it is longer: the end tells apart what begins alike.

    Args:
        text: of one line.
        most: letters that it has at most, the mark among them.
        mark: in the place of what is left out.

    >>> shorten_middle("f1/heavy_run.csv", 12), shorten_middle("f1.csv", 12)
    ('f1/heav….csv', 'f1.csv')
    """
    n_last = most // 3
    return text if len(text) <= most else f"{text[: most - n_last - len(mark)]}{mark}{text[len(text) - n_last :]}"


INVISIBLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u0890\u0891\u08e2\u180e\u200b\u200e\u200f\u2028-\u202e"
    "\u2060-\u2064\u2066-\u206f\ud800-\uf8ff\ufeff\ufff9-\ufffb\U000110bd\U000110cd\U00013430-\U0001343f"
    "\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e007f\U000f0000-\U000ffffd\U00100000-\U0010fffd]"
)
"""A character that steers a terminal, ends a line, turns the order of others, or is none: it shows nothing itself.

These are the categories Cc, Cf, Cs, Co, Zl and Zp of Unicode but the two joiners, which scripts and emoji need. They
stand here as ranges, because looking each up takes half a second; a test compares them.
"""


def escape_invisible(text: str) -> str:
    r"""Return a text as any terminal or page may show it: what is invisible stands there as Python writes it.

    A name must not colour a terminal, move its cursor, or show its letters in another order than they have. Ends of
    lines and tabs stay.

    >>> print(escape_invisible("a\x1b[31mb \u202ec"))
    a\x1b[31mb \u202ec
    """
    return INVISIBLE.sub(_escape_one, text)


def escape_in_line(text: str) -> str:
    r"""Return a text of one line: what is invisible stands there as Python writes it, ends of lines and tabs, too.

    >>> escape_in_line("a\nb\tc\x1b")
    'a\\nb\\tc\\x1b'
    """
    return escape_invisible(re.sub(r"[\n\r\t]", lambda found: repr(found[0])[1:-1], text))


def _escape_one(found: re.Match[str]) -> str:
    return found[0] if found[0] in "\n\t" else found[0].encode("unicode_escape").decode("ascii")
