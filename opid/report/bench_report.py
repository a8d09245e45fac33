"""The law of a test bench as text and as a page with its figures."""

from __future__ import annotations

from collections.abc import Iterator

from opid.report.as_text import Row, columns, estimate_row, labelled, laid_out, refusal, table_lines, wrapped
from opid.report.estimates import formula, parameter_label
from opid.report.page import Page, Picture
from opid.suspensions.bench.law import UNITS, BenchLaw

LABELS = {
    "stiffness_n_per_m": "stiffness K",
    "damping_n_s_per_m": "damping C",
    "offset_n": "offset F0",
    "moving_mass_kg": "moving mass m",
}


def text_of(result: BenchLaw) -> str:
    """Return the law of a test bench as text: the numbers, how good it is, and what to doubt.

    Args:
        result: from `law_of_bench`.
    """
    return laid_out(
        [f"{result.title or 'Test bench'}: {equation(result)}"],
        refusal(result.not_determined),
        table_lines(bench_rows(result), columns(None)),
        wrapped(quality(result)),
        wrapped(_sentence(result.memory.statement)),
        labelled("Warning: ", _doubts(result)),
    )


def equation(result: BenchLaw) -> str:
    """Return the law as an equation, with what stands beside f.

    Args:
        result: from `law_of_bench`.
    """
    if result.bench.is_quasi_static:
        return "F = F0 + K z + f(z)"
    mass = "" if result.bench.acceleration is None else "m z'' + "
    return f"F = F0 + {mass}K z + C z' + f(z, z')"


def page_of(result: BenchLaw) -> Page:
    """Return what the page of a test bench shows.

    Args:
        result: from `law_of_bench`.
    """
    return Page(
        "bench.html.jinja",
        result.title or "Test bench",
        bench_pictures(result),
        {
            "columns": columns(None),
            "rows": bench_rows(result),
            "quality": quality(result),
            "equation": equation(result).replace("'", "′"),
            "memory": _sentence(result.memory.statement),
        },
        _doubts(result),
        result.not_determined,
        _command(result),
    )


def bench_pictures(result: BenchLaw) -> tuple[Picture, ...]:
    """Return the figures of the report of a test bench; a law that is not determined has no curves.

    Args:
        result: from `law_of_bench`.
    """
    from opid import plots

    every = (
        Picture(
            "force_against_motion",
            "Force against motion",
            "What was measured (grey) and what the law makes of the same motion (in colour). Where grey loops stand "
            "outside the colour the force depends on more than the law does.",
            lambda result, truth: plots.force_against_motion(result),
        ),
        Picture(
            "bench_curves",
            "The law",
            "Its share of the force over velocity and over travel; grey dots are the measured force less the rest of "
            "the law. Beyond them the law is an extrapolation. Of a law that remembers a loop is drawn: that of a sine "
            "as large and as fast as the record.",
            lambda result, truth: plots.bench_curves(result),
        ),
        Picture(
            "bench_ladder",
            "Which law",
            "Share of the force that each law leaves unexplained, on the samples it was fitted to (hollow) and on "
            "stretches of time that were left out (full): the chosen law in colour, those on the way to it in black. "
            "No law of travel and velocity predicts better than the dashed line, but for one that remembers.",
            lambda result, truth: plots.bench_ladder(result),
        ),
        Picture(
            "bench_residual",
            "What is left over",
            "Force minus law over time, and over velocity and travel. A pattern is a shape that the library lacks, or "
            "memory.",
            lambda result, truth: plots.bench_residual(result),
        ),
    )
    return tuple(each for each in every if not (result.not_determined and each.name == "bench_curves"))


def bench_rows(result: BenchLaw) -> list[Row]:
    """Return the table of numbers: stiffness, damping, offset, and the parameters of the law.

    Args:
        result: from `law_of_bench`.
    """
    parameters = result.parameters.items()
    table = [
        estimate_row(LABELS[name], UNITS[name], estimate) for name, estimate in parameters if estimate.value is not None
    ]
    return [*table, *_law_rows(result), Row("Whole force"), estimate_row("energy a cycle", "J", result.cycle.area_j)]


def quality(result: BenchLaw) -> str:
    """Return the sentences that say how good the law is and what it rests on.

    Args:
        result: from `law_of_bench`.
    """
    bench = result.bench
    rate = "" if bench.is_quasi_static else f" at {bench.fs:.6g} Hz"
    return (
        f"The law explains {100 * result.r2:.4g} % of the variance of the force, {100 * result.r2_left_out:.4g} % on "
        f"stretches of time that were left out; {result.residual_rms:.3g} N rms are left. From {bench.samples.size} "
        f"samples{rate} ({result.n_independent:.0f} independent ones in the residual); velocity: "
        f"{bench.velocity_from}.{_mass_words(result)}{_loop_words(result)}{_simulation_words(result)}"
    )


def _mass_words(result: BenchLaw) -> str:
    mass_kg, name = result.bench.mass_kg, result.bench.channels["force"]
    return "" if mass_kg is None else f" The force is that of {mass_kg:.6g} kg with the acceleration {name!r}."


def _loop_words(result: BenchLaw) -> str:
    cycle, friction = result.cycle, result.cycle.friction_n
    of_record = "" if cycle.frequency_hz is None else f" at {cycle.frequency_hz:.3g} Hz"
    if cycle.area_j.value is None:
        return " The record does not tell what energy a cycle takes."
    words = (
        f" A cycle of {1e3 * cycle.travel_amplitude_m:.3g} mm{of_record}, as large as the record in the mean, takes "
    )
    is_friction = friction.value is not None and friction.value > 0
    words += f"the energy of a dry friction of {friction.value:.3g} N" if is_friction else "no energy"
    if result.loop is None:
        return words + "."
    return f"{words}. The loop area is what the part that remembers takes of it."


def _simulation_words(result: BenchLaw) -> str:
    simulation = result.simulation
    if simulation is None:
        return ""
    return (
        " The parameters are those with which the motion simulated from the force alone comes nearest to the recorded "
        f"one: {simulation.error_rms_m:.3g} m rms of {result.bench.travel.std():.3g} m are left."
    )


def _law_rows(result: BenchLaw) -> Iterator[Row]:
    if not result.law.terms:
        yield Row("Law: linear, f = 0")
    for term in result.law.terms:
        head = "Law" if len(result.law.terms) == 1 else "Term"
        yield Row(f"{head}: {term.name}, {formula(term.kind.latex)}")
        for parameter in term.kind.parameters:
            found = result.law_estimates[term.name][parameter.name]
            yield estimate_row(parameter_label(parameter), parameter.unit, found)
        if term.kind.memory is not None and result.loop is not None:
            yield estimate_row("loop area", "J", result.loop.area_j)


def _doubts(result: BenchLaw) -> list[str]:
    """Return the warnings; what the paragraph on memory says already is not said again."""
    statement = result.memory.statement
    shortened = (warning.removeprefix(statement).lstrip(". ") for warning in result.warnings)
    return [warning for warning in shortened if warning]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _command(result: BenchLaw) -> list[str]:
    bench = result.bench
    if bench.source is not None:
        return ["opid", "law", str(bench.source)]
    words = ["opid", "law", str(bench.log or result.title or "BENCH.csv")]
    words += [word for role, name in bench.channels.items() if name is not None for word in (f"--{role}", name)]
    words += ["--moving-mass"] if bench.acceleration is not None else []
    words += [] if bench.mass_kg is None else ["--mass", f"{bench.mass_kg:.12g}"]
    return [*words, "--quasi-static"] if bench.is_quasi_static else words
