"""The report of the law of a test bench."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict

from opid.estimate import format_number, format_percent, rounded
from opid.report.document import (
    Document,
    Figure,
    Paragraph,
    Row,
    Table,
    build_columns,
    build_warnings,
    write_options,
    write_sentence,
)
from opid.report.estimates import (
    INTERVAL,
    build_estimate_row,
    list_gas_rows,
    list_law_rows,
    say_law,
    tabulate_estimates,
)
from opid.report.sketch import sketch_bench
from opid.suspensions.bench.calibration import CalibrationError
from opid.suspensions.bench.law import UNITS, BenchLaw
from opid.suspensions.bench.record import BenchTolerances

LABELS = {
    "stiffness_n_per_m": "stiffness K",
    "damping_n_s_per_m": "damping C",
    "offset_n": "offset F0",
    "moving_mass_kg": "moving mass m",
}


def build_document(result: BenchLaw) -> Document:
    """Return the report of the law of a test bench: the numbers, their quality, and the warnings."""
    memory = result.memory
    # a warning speaks of a memory that is seen, or that cannot be tested
    is_warned = memory.seen or not memory.testable
    return Document(
        result.title or "Test bench",
        _format_equation(result),
        f"The law is {result.law.name}: with the linear part it explains "
        f"{format_percent(result.r2_left_out, 4)} of the variance of the force on stretches of time that were left "
        "out.",
        result.not_determined,
        (
            tabulate_estimates(
                _list_rows(result),
                legend=INTERVAL,
            ),
            build_warnings(result.warnings),
            Paragraph(_say_quality(result)),
            *(() if is_warned else (Paragraph(write_sentence(memory.statement)),)),
            *((_tabulate_calibration(result.calibration),) if result.calibration else ()),
        ),
        lambda: _list_figures(result),
        write_command(result),
        source="record",
        sketch=sketch_bench(result),
    )


def _tabulate_calibration(calibration: Sequence[CalibrationError]) -> Table:
    """Return what was stated of gains, lag and mass, and what the record tells of them beside that."""
    rows = []
    for each in calibration:
        found = each.found
        unit = "-" if each.unit == "1" else each.unit
        is_told = (found.std or 0.0) < 0.9 * each.tolerance
        told = (rounded(found.value, found.std), rounded(found.std, found.std)) if is_told else ("-", "-")
        rows.append((each.name, format_number(each.tolerance, 2), *told, unit))
    return Table(
        build_columns("calibration", "stated std. dev.", "in this record", "std. dev.", "unit"),
        tuple(rows),
        note="The intervals hold these errors of the channels; no value is corrected for them.",
    )


def _format_equation(result: BenchLaw) -> str:
    if result.bench.is_quasi_static:
        return "F = F0 + K z + f(z)"
    mass = "" if result.bench.acceleration is None else "m z'' + "
    return f"F = F0 + {mass}K z + C z' + f(z, z')"


def _list_figures(result: BenchLaw) -> Iterable[Figure]:
    from opid import plots

    yield Figure(
        "force_against_motion",
        "Force against motion",
        "What was measured (grey) and what the law makes of the same motion (in colour). Where grey loops stand "
        "outside the colour the force depends on more than the law does.",
        lambda: plots.force_against_motion(result),
    )
    if not result.not_determined:
        yield Figure(
            "bench_curves",
            "The law",
            "Its part of the force over velocity and over travel; grey dots are the measured force less the rest of "
            "the law. Beyond them the law is an extrapolation. Of a law that remembers a loop is drawn: that of a sine "
            "as large and as fast as the record.",
            lambda: plots.bench_curves(result),
        )
    yield Figure(
        "bench_ladder",
        "Which law",
        "Fraction of the force that each law leaves unexplained, on the samples it was fitted to (hollow) and on "
        "stretches of time that were left out (full): the chosen law in colour, those on the way to it in black. "
        "No law of travel and velocity predicts better than the dashed line, but for one that remembers.",
        lambda: plots.bench_ladder(result),
    )
    yield Figure(
        "bench_residual",
        "What is left over",
        "Force minus law over time, and over velocity and travel. A pattern is a shape that the library lacks, or "
        "memory.",
        lambda: plots.bench_residual(result),
    )


def _list_rows(result: BenchLaw) -> Iterator[Row]:
    for name, estimate in result.parameters.items():
        if estimate.value is not None:
            yield build_estimate_row(LABELS[name], UNITS[name], estimate)
    if len(result.law.terms) < 2:
        yield (f"Law: {say_law(result.law)}",)
    yield from list_law_rows(result.law, result.law_estimates)
    yield from list_gas_rows(result.gas, "Gas where the travel is zero")
    yield ("Energy a cycle",)
    yield build_estimate_row("whole force", "J", result.cycle.area_j)
    if result.loop is not None:
        yield build_estimate_row("loop area", "J", result.loop.area_j)


def _say_quality(result: BenchLaw) -> str:
    bench = result.bench
    rate = "" if bench.is_quasi_static else f" at {format_number(bench.fs)} Hz"
    return (
        f"The law explains {format_percent(result.r2, 5)} of the variance of the force, "
        f"{format_percent(result.r2_left_out, 5)} on stretches of time that were left out; "
        f"{format_number(result.residual_rms, 3)} N rms are left. From {bench.samples.size} samples{rate} "
        f"({result.n_independent:.0f} independent ones in the residual); velocity: "
        f"{bench.velocity_from}.{_say_mass(result)}{_say_loop(result)}{_say_simulation(result)}"
    )


def _say_mass(result: BenchLaw) -> str:
    mass_kg, name = result.bench.mass_kg, result.bench.channels["force"]
    said = f" The force is that of {format_number(mass_kg)} kg with the acceleration {name!r}."
    return "" if mass_kg is None else said


def _say_loop(result: BenchLaw) -> str:
    cycle, friction = result.cycle, result.cycle.friction_n
    of_record = "" if cycle.frequency_hz is None else f" at {format_number(cycle.frequency_hz, 3)} Hz"
    if cycle.area_j.value is None:
        return " The record does not determine the energy of a cycle."
    size = f"{format_number(1e3 * cycle.travel_amplitude_m, 3)} mm{of_record}"
    words = f" A cycle of {size}, as large as the record in the mean, takes "
    is_friction = friction.value is not None and friction.value > 0
    words += (
        f"the energy of a dry friction of {rounded(friction.value, friction.std)} N" if is_friction else "no energy"
    )
    if result.loop is None:
        return words + "."
    return f"{words}. The loop area is what the part that remembers takes of it."


def _say_simulation(result: BenchLaw) -> str:
    simulation = result.simulation
    if simulation is None:
        return ""
    return (
        " The parameters are those with which the motion simulated from the force alone comes nearest to the recorded "
        f"one: {format_number(simulation.error_rms_m, 3)} m rms of {format_number(result.bench.travel.std(), 3)} m are "
        "left."
    )


def write_command(result: BenchLaw) -> list[str]:
    """Return the words of the command that gives a result, but for units that its log does not state."""
    bench = result.bench
    if bench.source is not None:
        return ["opid", "law", str(bench.source)]
    words = ["opid", "law", str(bench.log or result.title or "BENCH.csv")]
    words += write_options({f"{role}_channel": name for role, name in bench.channels.items() if name is not None})
    options = {
        "gain_tolerance": "gain_tolerance",
        "lag_tolerance_s": "lag_tolerance",
        "mass_tolerance_kg": "mass_tolerance",
    }
    stated, usual = asdict(bench.tolerances), asdict(BenchTolerances())
    words += write_options({option: stated[name] for name, option in options.items() if stated[name] != usual[name]})
    words += ["--moving-mass"] if bench.acceleration is not None else []
    words += [] if bench.mass_kg is None else ["--mass", f"{bench.mass_kg:.12g}"]
    words += [] if bench.piston_area_m2 is None else ["--piston-area", f"{bench.piston_area_m2:.12g}"]
    return [*words, "--quasi-static"] if bench.is_quasi_static else words
