"""The report of virtual sensors along a record."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from opid.estimate import format_number, rounded, with_std
from opid.report.document import (
    Document,
    Figure,
    Paragraph,
    Row,
    Table,
    build_columns,
    build_warnings,
    format_count,
)
from opid.suspensions.sensing.result import Sensing

_LEGEND = (
    "The strut force is the force on the body in the direction in which the channels count, measured from that at "
    "rest; the strut load is with that at rest, and the tyre force is the load on the ground. The velocity of the body "
    "is that above the lowest compared frequency."
)


def build_document(result: Sensing) -> Document:
    """Return the report of virtual sensors: their size, the values at rest, the cycles, and the warnings."""
    forces = [each for each in result.sensors if each.quantity == "strut_force"]
    largest = max(forces, key=lambda each: abs(each.largest.value or 0.0))
    where = f" of {largest.place}" if largest.place else ""
    unit = largest.unit
    return Document(
        result.title or "Virtual sensors",
        f"forces and motion along {result.run}",
        f"The strut force{where} reaches {with_std(largest.largest.value, largest.largest.std)} {unit} about that at "
        "rest.",
        None,
        (
            Table(
                build_columns("channel", "rms", "farthest from zero", "std of a sample", "unit", left=(0, 4)),
                tuple(_list_rows(result)),
                note="± is one standard deviation; the bands of the figures are 95 %.",
                legend=_LEGEND,
            ),
            build_warnings(result.warnings),
            Paragraph(_say_quality(result)),
        ),
        lambda: _list_figures(result),
        numbers="The time histories stand in the log, the numbers and the cycles in result.json.",
        source="study",
    )


def _list_rows(result: Sensing) -> Iterator[Row]:
    force = "m/s^2" if result.per_mass else "N"
    for each in result.sensors:
        largest = with_std(each.largest.value, each.largest.std)
        yield each.name, rounded(each.rms.value, each.rms.std), largest, rounded(each.rms.std, each.rms.std), each.unit
    for rest in result.static:
        name = f"{rest.place}, at rest" if rest.place else "at rest"
        for what, estimate, unit in (("load", rest.load_n, force), ("travel", rest.travel_m, "m")):
            if estimate.value is not None:
                yield f"{name}: {what}", "-", with_std(estimate.value, estimate.std), "-", unit


def _say_quality(result: Sensing) -> str:
    left = ", ".join(f"{each:.2f}" for each in result.over_noise)
    total = sum(float(each.cycles.sum()) for each in result.rainflow)
    small = " and ".join(format_number(each.least_range_n, 3) for each in result.rainflow)
    unit = "m/s^2" if result.per_mass else "N"
    return (
        f"The model leaves {left} times the noise of the sensors in this record. The band of each sample holds that "
        "noise, the uncertainty of the parameters and the tolerances of the sensors. "
        f"{format_count(round(total), 'cycle')} of the strut force are counted by rainflow (ASTM E1049); those of less "
        f"than {small} {unit} may be cycles of the noise."
    )


def _list_figures(result: Sensing) -> Iterable[Figure]:
    from opid import plots

    for place in dict.fromkeys(each.place for each in result.sensors):
        name = place or "strut"
        yield Figure(
            f"sensed_{name}",
            f"Forces and motion: {name}",
            "Virtual sensors about the largest force of the record, with 95 % bands. A band that cannot be seen is "
            "narrower than the line.",
            partial(plots.sensed_histories, result, place),
        )
    yield Figure(
        "rainflow",
        "Cycles of the strut force",
        "How many cycles exceed a range; bars are 95 % intervals. Left of the dashed line, cycles are as small as the "
        "band and may be those of noise.",
        lambda: plots.rainflow_cycles(result),
    )


def write_command(
    study: Path,
    result: Path,
    log: Path | None,
    options: Mapping[str, object],
    unsprung: Sequence[tuple[str, float, float]],
    places: Sequence[tuple[str, float, float]],
) -> list[str]:
    """Return the words of the command that gives virtual sensors.

    Args:
        study: the study.
        result: its result.
        log: a further log; None for a run of the study.
        options: options with their values; those that are None are left out.
        unsprung: name of the interface, mass and standard deviation.
        places: name, x and y.
    """
    words = ["opid", "sense", str(study), str(result), *([] if log is None else [str(log)])]
    words += [word for name, value in options.items() if value is not None for word in (f"--{name}", str(value))]
    for name, mass_kg, std_kg in unsprung:
        words += ["--unsprung-mass", f"{name}{'=' * bool(name)}{mass_kg:g}+-{std_kg:g}"]
    for name, x_m, y_m in places:
        words += ["--place", f"{name}={x_m:g},{y_m:g}"]
    return words
