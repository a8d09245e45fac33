"""A value and how far to trust it: what every wing answers with."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Self


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
        """Return the estimate whose interval goes from value - 1.96 std to value + 1.96 std."""
        value = float(value)
        if std is None or not math.isfinite(std):
            return cls(value)
        return cls(value, float(std), (value - 1.96 * float(std), value + 1.96 * float(std)))

    def without_interval(self) -> Estimate:
        """Return the value alone."""
        return Estimate(self.value)

    def holds(self, truth: float) -> bool:
        """Whether the interval holds `truth`; False without an interval."""
        return self.interval95 is not None and self.interval95[0] <= truth <= self.interval95[1]


@dataclass(frozen=True, eq=False)
class Estimates:
    """A record with estimates in its fields, or in records, tuples and tables in its fields.

    >>> @dataclass(frozen=True)
    ... class Slopes(Estimates):
    ...     stiffness_n_per_m: Estimate = Estimate()
    ...     damping_n_s_per_m: Estimate = Estimate()
    >>> found = Slopes(Estimate.normal(4e5, 1e3))
    >>> [(name, estimate.std) for name, estimate in found.items()]
    [('stiffness_n_per_m', 1000.0), ('damping_n_s_per_m', None)]
    >>> found.with_estimates(Estimate.without_interval).stiffness_n_per_m
    Estimate(value=400000.0, std=None, interval95=None)
    """

    def items(self) -> Iterator[tuple[str, Estimate]]:
        """Yield name and estimate of each field that is one, in their order."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Estimate):
                yield field.name, value

    def with_estimates(self, change: Callable[[Estimate], Estimate], *, only: Collection[str] | None = None) -> Self:
        """Return it with every estimate changed, or those of the fields `only`."""
        names = [field.name for field in fields(self) if only is None or field.name in only]
        return replace(self, **{name: _changed(getattr(self, name), change) for name in names})


def rounded(value: float | None, std: float | None = None) -> str:
    """Return a value with the digits that its standard deviation leaves, or four where there is none.

    Args:
        value: None gives a dash.
        std: two digits of it count.

    >>> rounded(390297.5, 358.4), rounded(0.019941, 5.1e-05), rounded(1234.56), rounded(None)
    ('390300', '0.019941', '1235', '-')
    """
    if value is None or not math.isfinite(value):
        return "-"
    if std is not None and std > 0 and math.isfinite(std):
        decimals = 1 - math.floor(math.log10(std))
    elif value:
        decimals = 3 - math.floor(math.log10(abs(value)))
    else:
        decimals = 0
    number = round(value, decimals) + 0.0  # no -0
    if abs(number) >= 1e8 or 0 < abs(number) < 1e-6:
        digits = max(0, decimals + math.floor(math.log10(abs(number))))
        return f"{number:.{digits}e}"
    return f"{number:.{max(0, decimals)}f}"


def with_std(value: float | None, std: float | None) -> str:
    """Return "value ± standard deviation"; wherever opid writes ±, it is one standard deviation.

    Args:
        value: None gives a dash.
        std: standard deviation; None leaves the value alone.

    >>> with_std(1849.98, 13.71), with_std(1234.56, None)
    ('1850 ± 14', '1235')
    """
    if std is None or rounded(value) == "-" or not math.isfinite(std):
        return rounded(value)
    return f"{rounded(value, std)} ± {rounded(std, std)}"


def _changed(value: Any, change: Callable[[Estimate], Estimate]) -> Any:
    if isinstance(value, Estimate):
        return change(value)
    if isinstance(value, Estimates):
        return value.with_estimates(change)
    if isinstance(value, tuple):
        return tuple(_changed(each, change) for each in value)
    if isinstance(value, Mapping):
        return {name: _changed(each, change) for name, each in value.items()}
    return value
