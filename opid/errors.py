"""The two ways in which a call can fail for a reason that belongs to the user."""

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """The input is not usable: the message says what was given, what was needed and what to do."""


class NotDeterminedError(RuntimeError):
    """The input is sound but the data do not determine the answer.

    `partial` carries what could be determined (or None), so that nothing is lost.
    """

    def __init__(self, message: str, partial: object = None) -> None:
        super().__init__(message)
        self.partial = partial


MOST_LISTED = 24
"""Words that are listed: of more, as the degrees of freedom of a structure, only the first and the last."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a clause that names the known word nearest to `name`, or lists the known words.

    >>> nearest("tittle", ["title", "runs"])
    "did you mean 'title'?"
    >>> nearest("mass", ["title", "runs"])
    "known are 'title', 'runs'"
    """
    words = list(known)
    close = difflib.get_close_matches(name, words, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    if len(words) > MOST_LISTED:
        return f"there are {len(words)}, {words[0]!r} to {words[-1]!r}"
    return "known are " + ", ".join(repr(word) for word in words)
