"""A fleet as it was compared: the struts of many aircraft over their flights, and what changed or drifts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any

from opid.estimate import Estimate, format_change
from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.suspensions.flights.fleet_model import FleetSettings
from opid.suspensions.flights.result_file import Quantity

SCHEMA = "opid.fleet/1"


@dataclass(frozen=True)
class StrutFlight:
    """One quantity of one strut at one flight.

    Args:
        flight: name of the flight.
        date: of the flight.
        estimate: the value of its result.
        expected: what the flights before it say, at the covariates of this flight; None for the first flight.
        departure: (value - expected) in standard deviations of the difference; None where it is not judged.
        level: index of its level: 0 up to the first change, then 1, ...
        result: path of its result.
    """

    flight: str
    date: date
    estimate: Estimate
    expected: Estimate
    departure: float | None
    level: int
    result: Path


@dataclass(frozen=True)
class StrutChange:
    """A change of one quantity of one strut.

    Args:
        quantity: the quantity that changed.
        tail: tail number of the aircraft.
        first: index of the flight with which it begins, in `Strut.flights`.
        flight: the name of that flight.
        date: of that flight.
        fraction: relative change, of all flights until the next change against what the flights before say.
        departure: the departure that flagged it, in standard deviations.
        n_needed: flights whose mean departed by so much.
        n_flights: flights from this change to the next.
    """

    quantity: Quantity
    tail: str
    first: int
    flight: str
    date: date
    fraction: Estimate
    departure: float
    n_needed: int
    n_flights: int

    @property
    def subject(self) -> str:
        """What changed, and by how much."""
        return f"{self.quantity.full_label} of {self.tail or 'the aircraft'}: {format_change(self.fraction)}"

    @property
    def statement(self) -> str:
        """The change in a sentence."""
        return (
            f"{self.subject} since {self.flight!r} ({self.date}), flagged at "
            f"{abs(self.departure):.1f} standard deviations after {_count_flights(self.n_needed)}; "
            f"{_count_flights(self.n_flights)} at the new level"
        )


@dataclass(frozen=True)
class StrutDrift:
    """A strut that changes slowly, and unlike the others.

    Args:
        quantity: the quantity that drifts.
        tail: tail number of the aircraft.
        per_year: its relative change in a year.
        usual_per_year: that of the others, in the middle; 0 where there are too few others.
        departure: of its trend from that of the others, in standard deviations.
    """

    quantity: Quantity
    tail: str
    per_year: Estimate
    usual_per_year: float
    departure: float

    @property
    def statement(self) -> str:
        """The drift in a sentence."""
        return (
            f"{self.quantity.full_label} of {self.tail or 'the aircraft'} drifts by "
            f"{format_change(self.per_year, ' a year')}, where {100 * self.usual_per_year:+.1f} % is usual: "
            f"{abs(self.departure):.1f} standard deviations"
        )


@dataclass(frozen=True)
class Strut:
    """One quantity of one strut.

    Args:
        tail: tail number of the aircraft.
        flights: in the order of their dates.
        trend_per_year: relative change in a year, of the flights since the last change.
        changes: the flagged changes, the earliest first.
        lone: flights that stand alone: they were flagged, and the values after them are as before.
    """

    tail: str
    flights: tuple[StrutFlight, ...]
    trend_per_year: Estimate
    changes: tuple[StrutChange, ...]
    lone: tuple[StrutChange, ...] = ()


@dataclass(frozen=True)
class FleetSeries:
    """One quantity of the struts at one place of all aircraft.

    Args:
        quantity: the quantity, with the place.
        struts: one for each aircraft.
        scatter: standard deviation from flight to flight beyond the intervals, as a fraction.
        level: standard deviation of the struts about their common level, as a fraction.
        trend_per_year: the trend that all have in common, as a fraction a year.
        covariates: {name: relative change for one standard deviation of the covariate}.
        threshold: departure above which a flight is flagged, in standard deviations.
        n_tests: comparisons that were made.
        common_steps: days on which all struts changed at once, each with the change as a fraction.
        drifts: struts whose trend is unlike that of the others.
    """

    quantity: Quantity
    struts: tuple[Strut, ...]
    scatter: float
    level: float
    trend_per_year: Estimate
    covariates: Mapping[str, Estimate]
    threshold: float
    n_tests: int
    common_steps: tuple[tuple[date, Estimate], ...] = ()
    drifts: tuple[StrutDrift, ...] = ()


@dataclass(frozen=True, repr=False)
class Fleet(Result):
    """The struts of a fleet, each compared with its own past and with the others.

    Args:
        source: path of the dataset.
        series: one for each quantity of each place.
        n_flights: flights in the dataset.
        years: from the first to the last.
        alarms_per_year: expected number of false alarms in a year, all quantities together.
        warnings: the warnings, one sentence each.
        settings: the tuned numbers.
        read: the files of the dataset.
    """

    source: str
    series: tuple[FleetSeries, ...]
    n_flights: int
    years: float
    alarms_per_year: float
    warnings: tuple[str, ...]
    settings: FleetSettings
    read: tuple[ReadFile, ...] = ()

    @property
    def changes(self) -> tuple[StrutChange, ...]:
        """The flagged changes of all struts, the latest first."""
        found = (change for series in self.series for strut in series.struts for change in strut.changes)
        return tuple(sorted(found, key=lambda each: each.date, reverse=True))

    @property
    def drifts(self) -> tuple[StrutDrift, ...]:
        """The struts that drift, the fastest first."""
        found = (drift for series in self.series for drift in series.drifts)
        return tuple(sorted(found, key=lambda each: abs(each.departure), reverse=True))

    @property
    def has_flags(self) -> bool:
        """Whether a strut changed or drifts."""
        return bool(self.changes or self.drifts)

    @property
    def verdict(self) -> str:
        """What was found, in a few words."""
        said = [
            f"{len(found)} {word}{'s' * (len(found) != 1)}"
            for found, word in ((self.changes, "change"), (self.drifts, "drift"))
            if found
        ]
        return f"{' and '.join(said)} flagged" if said else "no change exceeds its uncertainty"

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files of the dataset, as they were when they were read."""
        return self.read

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return each change as a fraction, the latest first, and then the common trends."""
        changes = (
            SummaryRow.of(".".join(filter(None, (each.tail, each.quantity.key))), each.fraction, "1")
            for each in self.changes
        )
        trends = (SummaryRow.of(f"{each.quantity.key}.trend", each.trend_per_year, "1/year") for each in self.series)
        return (*changes, *trends)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of fleet.json, as `docs/schemas/fleet-1.schema.json` describes it."""
        return plain(
            {
                "schema": SCHEMA,
                "flagged": self.has_flags,
                "source": self.source,
                "n_flights": self.n_flights,
                "years": self.years,
                "alarms_per_year": self.alarms_per_year,
                "settings": asdict(self.settings),
                "series": [
                    {
                        **series.quantity.to_dict(),
                        "unit": series.quantity.unit,
                        "scatter": series.scatter,
                        "level": series.level,
                        "trend_per_year": asdict(series.trend_per_year),
                        "covariates": {name: asdict(each) for name, each in series.covariates.items()},
                        "threshold": series.threshold,
                        "n_tests": series.n_tests,
                        "common_steps": [
                            {"date": day.isoformat(), "fraction": asdict(each)} for day, each in series.common_steps
                        ],
                        "drifts": [
                            {
                                "tail": each.tail,
                                "per_year": asdict(each.per_year),
                                "usual_per_year": each.usual_per_year,
                                "departure": each.departure,
                                "statement": each.statement,
                            }
                            for each in series.drifts
                        ],
                        "struts": [
                            {
                                "tail": strut.tail,
                                "n_flights": len(strut.flights),
                                "trend_per_year": asdict(strut.trend_per_year),
                                "latest": _describe_flight(strut.flights[-1]),
                            }
                            for strut in series.struts
                        ],
                    }
                    for series in self.series
                ],
                "changes": [
                    {
                        **each.quantity.to_dict(),
                        "unit": each.quantity.unit,
                        "tail": each.tail,
                        "flight": each.flight,
                        "date": each.date.isoformat(),
                        "fraction": asdict(each.fraction),
                        "departure": each.departure,
                        "n_needed": each.n_needed,
                        "n_flights": each.n_flights,
                        "statement": each.statement,
                    }
                    for each in self.changes
                ],
                "warnings": self.warnings,
            }
        )

    def _write_headline(self) -> str:
        tails = {strut.tail for series in self.series for strut in series.struts}
        return f"{_count_flights(self.n_flights)} of {len(tails)} aircraft, {self.verdict}"


def _count_flights(number: int) -> str:
    return f"{number} flight{'s' * (number != 1)}"


def _describe_flight(flight: StrutFlight) -> dict[str, Any]:
    return {
        "flight": flight.flight,
        "date": flight.date.isoformat(),
        **asdict(flight.estimate),
        "expected": flight.expected.value,
        "departure": flight.departure,
    }
