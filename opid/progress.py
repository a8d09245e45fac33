"""What is said of the work while it goes on: the names of its steps, and how far a step is."""

from __future__ import annotations

from collections.abc import Callable

Say = Callable[[str], None]
"""Called with the name of each step as it begins; a step that knows how far it is comes again and again as a `Step`."""


class Step(str):
    """The name of a step with the fraction of it that is done; as a text it has the fraction behind the name.

    Args:
        name: of the step.
        fraction: from 0 to 1.

    >>> step = Step("class 1", 0.25)
    >>> print(step)
    class 1 25%
    >>> step.name, step.fraction
    ('class 1', 0.25)
    """

    name: str
    fraction: float

    def __new__(cls, name: str, fraction: float) -> Step:
        """Return the text with its two parts."""
        step = super().__new__(cls, f"{name} {fraction:.0%}")
        step.name, step.fraction = name, fraction
        return step
