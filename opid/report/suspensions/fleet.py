"""The report of a fleet: the struts that changed, all struts at a glance, and what all have in common."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from opid.estimate import Estimate, format_number, rounded
from opid.report.document import (
    Block,
    Document,
    Figure,
    Paragraph,
    Remarks,
    Row,
    Table,
    build_columns,
    build_warnings,
    format_count,
    write_sentence,
)
from opid.suspensions.flights.fleet import Fleet, FleetSeries, Strut
from opid.suspensions.flights.result_file import find_page

_MOST_SAID = 20
"""Changes that are said in sentences; the table of struts has all of them."""

_MOST_DRAWN = 12
"""Struts that get a figure of their own, those that changed last."""


def build_document(result: Fleet) -> Document:
    """Return the report of a fleet: its changes, the scatter and the trends of all struts, and the warnings."""
    changes = tuple(write_sentence(change.statement) for change in result.changes)
    more = [f"and {len(changes) - _MOST_SAID} more, in the table of struts."] if len(changes) > _MOST_SAID else []
    n_aircraft = len({strut.tail for series in result.series for strut in series.struts})
    return Document(
        "Health of a fleet",
        f"{format_count(result.n_flights, 'flight')} of {n_aircraft} aircraft over {result.years:.1f} years",
        write_sentence(result.verdict),
        None,
        (
            Remarks("Change", (*changes[:_MOST_SAID], *more), is_warning=True),
            Remarks("Drift", tuple(write_sentence(each.statement) for each in result.drifts), is_warning=True),
            _tabulate_common(result),
            Paragraph(_say_basis(result)),
            build_warnings(result.warnings),
        ),
        lambda: _list_details(result),
        ["opid", "compare", result.source],
        source="dataset",
        data_file="fleet.json",
    )


def _tabulate_common(result: Fleet) -> Table:
    heads = build_columns(
        "", "struts", "scatter, %", "struts differ by, %", "trend, % a year", "std. dev.", "limit, std", optional=(6,)
    )
    rows = []
    for series in result.series:
        trend = series.trend_per_year
        rows.append(
            (
                _write_name(series),
                str(len(series.struts)),
                f"{100 * series.scatter:.2f}",
                f"{100 * series.level:.1f}",
                _format_percent(trend),
                _format_percent(Estimate(trend.std, trend.std)),
                f"{series.threshold:.1f}",
            )
        )
    return Table(heads, tuple(rows), "What the struts have in common")


def _say_basis(result: Fleet) -> str:
    n_tests = sum(series.n_tests for series in result.series)
    return (
        "Each flight of a strut, and the mean of up to "
        f"{max(result.settings.windows)} flights in a row, is compared with what its flights before say, and the other "
        f"struts where it has few: {n_tests} comparisons. What the covariates and the common trend explain is no "
        f"change. If nothing changed, {format_number(result.alarms_per_year)} false alarms a year are expected at most "
        "in the whole fleet. After a change a strut is compared with its new level. Scatter is from flight to flight, "
        "beyond the intervals of the results."
    )


def _list_details(result: Fleet) -> Iterator[Block]:
    from opid.plots.fleet import draw_fleet_map, draw_strut, find_column_days

    for number, series in enumerate(result.series, start=1):
        days = max(1, round(find_column_days(series)))
        yield Figure(
            f"fleet_{number}",
            f"All struts: {_write_name(series)}",
            "Percent from the first level of each strut, without what covariates and the common trend explain. A cell "
            f"stands for about {format_count(days, 'day')}; it is empty where the strut did not fly.",
            partial(draw_fleet_map, series),
        )
    drifting = {(id(series), drift.tail) for series in result.series for drift in series.drifts}
    changed = [
        (series, strut)
        for series in result.series
        for strut in series.struts
        if strut.changes or (id(series), strut.tail) in drifting
    ]
    changed.sort(key=lambda each: (each[1].changes or each[1].flights)[-1].date, reverse=True)
    for number, (series, strut) in enumerate(changed[:_MOST_DRAWN], start=1):
        yield Figure(
            f"strut_{number}",
            f"{strut.tail or 'aircraft'}: {_write_name(series)}",
            "",
            partial(draw_strut, series, strut),
        )
    effects = tuple(
        (_write_name(series), name, _format_percent(each), _format_percent(Estimate(each.std, each.std)))
        for series in result.series
        for name, each in series.covariates.items()
    )
    if effects:
        heads = build_columns("", "covariate", "effect, %", "std. dev.", left=(0, 1))
        yield Table(heads, effects, "Covariates", note="The effect is that of one standard deviation of the covariate.")
    heads = build_columns(
        "tail",
        "quantity",
        "changes, %",
        "trend, % a year",
        "std. dev.",
        "flights",
        "last flight",
        "latest",
        "expected",
        left=(0, 1, 2),
        elastic=(1, 2),
    )
    pairs = [(series, strut) for series in result.series for strut in series.struts]
    pairs.sort(key=lambda each: not each[1].changes)
    yield Table(
        heads,
        tuple(_build_row(*each) for each in pairs),
        "Struts",
        is_filtered=True,
        links=tuple(find_page(strut.flights[-1].result) for _, strut in pairs),
        note="A tail number leads to its last flight. Latest and expected are in the unit of the figures.",
    )


def _build_row(series: FleetSeries, strut: Strut) -> Row:
    last, trend = strut.flights[-1], strut.trend_per_year
    std = last.estimate.std
    return (
        strut.tail or "-",
        _write_name(series),
        ", ".join(f"{100 * (each.fraction.value or 0.0):+.1f} since {each.date}" for each in strut.changes) or "-",
        _format_percent(trend),
        _format_percent(Estimate(trend.std, trend.std)),
        str(len(strut.flights)),
        str(last.date),
        rounded(last.estimate.value, std),
        rounded(last.expected.value, std),
    )


def _write_name(series: FleetSeries) -> str:
    quantity = series.quantity
    return " ".join(filter(None, (quantity.gear, quantity.label.split(" (")[0])))


def _format_percent(estimate: Estimate) -> str:
    """A fraction in percent, rounded as its standard deviation says."""
    if estimate.value is None:
        return "-"
    return rounded(100 * estimate.value, None if estimate.std is None else 100 * estimate.std)
