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
        return replace(self, **{name: _apply_deeply(getattr(self, name), change) for name in names})


_PLAIN = range(-6, 6)
"""A number whose first digit has one of these powers of ten is written plainly, any other as a multiple of one."""
RAISED = str.maketrans("-0123456789.n", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹˙ⁿ")
"""The characters of a power above the line."""


def format_number(value: float | None, digits: int = 6, *, has_sign: bool = False) -> str:
    """Return a number as every text and picture of opid writes it.

    From a millionth up to a million it is plain, its digits in no groups; beyond, it is a multiple of a power of ten.

    Args:
        value: None, or what is not finite, gives a dash.
        digits: this many count; zeros at the end of a fraction are left out.
        has_sign: whether a plus stands before what is positive.

    >>> format_number(1052.3, 3), format_number(0.25), format_number(389900.0), format_number(39259.1, has_sign=True)
    ('1050', '0.25', '389900', '+39259.1')
    >>> format_number(-1.37e8, 3), format_number(2e-7), format_number(999999.9, 4)
    ('-1.37×10⁸', '2×10⁻⁷', '1×10⁶')
    """
    if value is None or not math.isfinite(value):
        return "-"
    number = float(f"{value:.{digits - 1}e}") + 0.0  # no -0
    text = _write_decimal(number, digits - 1 - _find_power(number))
    mantissa, cross, power = text.partition("×")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{'+' if has_sign and number > 0 else ''}{mantissa}{cross}{power}"


def format_percent(fraction: float | None, digits: int = 6) -> str:
    """Return a fraction in percent, in the style of `format_number`.

    Args:
        fraction: None, or what is not finite, gives a dash.
        digits: this many count.

    >>> format_percent(0.01234, 2), format_percent(12.0), format_percent(None)
    ('1.2 %', '1200 %', '-')
    """
    return "-" if fraction is None or not math.isfinite(fraction) else f"{format_number(100 * fraction, digits)} %"


def _find_power(number: float) -> int:
    """The power of ten of the first digit of a number."""
    return math.floor(math.log10(abs(number))) if number else 0


def _write_decimal(number: float, decimals: int) -> str:
    """Write a number with so many decimals, as a multiple of a power of ten where it is very large or very small."""
    if _find_power(number) in _PLAIN:
        return f"{number:.{max(0, decimals)}f}"
    mantissa, power = f"{number:.{max(0, decimals + _find_power(number))}e}".split("e")
    return f"{mantissa}×10{str(int(power)).translate(RAISED)}"


def rounded(value: float | None, std: float | None = None) -> str:
    """Return a value with the digits that its standard deviation leaves, or four where there is none.

    It is written in the style of `format_number`, but with zeros at its end: they are digits that count.

    Args:
        value: None gives a dash.
        std: two digits of it count.

    >>> rounded(390297.5, 358.4), rounded(0.019941, 5.1e-05), rounded(1234.56), rounded(None)
    ('390300', '0.019941', '1235', '-')
    >>> rounded(-1.3712e8, 4e6)
    '-1.371×10⁸'
    """
    if value is None or not math.isfinite(value):
        return "-"
    has_std = std is not None and std > 0 and math.isfinite(std)
    decimals = 1 - _find_power(std or 0.0) if has_std else 3 - _find_power(value) if value else 0
    return _write_decimal(round(value, decimals) + 0.0, decimals)  # no -0


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


def format_change(fraction: Estimate, per: str = "") -> str:
    """Return a relative change in percent, with its sign and its 95 % interval.

    Args:
        fraction: the change as a fraction, with its interval.
        per: words behind the unit of the change, like " a year".

    >>> format_change(Estimate.normal(-0.05, 0.01)), format_change(Estimate.normal(0.02, 0.005), " a year")
    ('-5.0 % (-7.0 to -3.0 %)', '+2.0 % a year (+1.0 to +3.0 %)')
    """
    low, high = fraction.interval95 or (math.nan, math.nan)
    return f"{100 * (fraction.value or 0.0):+.1f} %{per} ({100 * low:+.1f} to {100 * high:+.1f} %)"


def _apply_deeply(value: Any, change: Callable[[Estimate], Estimate]) -> Any:
    if isinstance(value, Estimate):
        return change(value)
    if isinstance(value, Estimates):
        return value.with_estimates(change)
    if isinstance(value, tuple):
        return tuple(_apply_deeply(each, change) for each in value)
    if isinstance(value, Mapping):
        return {name: _apply_deeply(each, change) for name, each in value.items()}
    return value
