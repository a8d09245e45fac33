"""Third-party readers that print and log: what they say does not reach the user, who gets one clear error."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout


@contextmanager
def quiet(*loggers: str) -> Iterator[None]:
    """Keep from the user what is printed, and what some loggers say, while the context lasts.

    Never yield inside of it from a generator: it would last while the caller works.

    Args:
        loggers: their names.

    >>> with quiet("noisy"):
    ...     print("nobody hears this")
    """
    noisy = [logging.getLogger(name) for name in loggers]
    were = [logger.disabled for logger in noisy]
    try:
        for logger in noisy:
            logger.disabled = True
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        for logger, was in zip(noisy, were, strict=True):
            logger.disabled = was
