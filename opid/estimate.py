"""A value and how far to trust it: what every wing answers with."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A value with its standard deviation and 95 % interval; None where the method gives none.

    Args:
        value: in the unit that the name of the parameter carries.
        std: standard deviation, in the same unit.
        interval95: lower and upper end of the 95 % interval.

    >>> Estimate.normal(10.0, 1.0).interval95
    (8.04, 11.96)
    """

    value: float | None = None
    std: float | None = None
    interval95: tuple[float, float] | None = None

    @classmethod
    def normal(cls, value: float, std: float | None = None) -> Estimate:
        """Return the estimate whose interval is value +- 1.96 std."""
        value = float(value)
        if std is None or not math.isfinite(std):
            return cls(value)
        return cls(value, float(std), (value - 1.96 * float(std), value + 1.96 * float(std)))

    def holds(self, truth: float) -> bool:
        """Whether the interval holds `truth`; False without an interval."""
        return self.interval95 is not None and self.interval95[0] <= truth <= self.interval95[1]
