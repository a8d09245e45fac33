"""The law of a test bench as text, JSON and a page with its figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.json_values import json_text, plain
from opid.report.as_text import Row, columns, estimate_row, formula, parameter_label, table_lines, wrapped
from opid.report.page import Picture, drawn, rendered
from opid.signals.directory import write_together
from opid.suspensions.bench.law import SCHEMA, BenchLaw
from opid.suspensions.bench.simulation import Simulation
from opid.suspensions.law_search.pursuit import chosen

LABELS = {
    "stiffness_n_per_m": ("stiffness K", "N/m"),
    "damping_n_s_per_m": ("damping C", "N s/m"),
    "offset_n": ("offset F0", "N"),
    "moving_mass_kg": ("moving mass m", "kg"),
}


def bench_text(result: BenchLaw) -> str:
    """Return the law of a test bench as text: the numbers, how good it is, and what to doubt.

    Args:
        result: from `law_of_bench`.
    """
    parts = [f"{result.title or 'Test bench'}: {equation(result)}", ""]
    if result.not_determined:
        parts += [*wrapped("Not determined: " + result.not_determined), ""]
    parts += [*table_lines(bench_rows(result), columns(None)), "", *wrapped(quality(result))]
    parts += ["", *wrapped(_sentence(result.memory.statement))]
    doubts = _doubts(result)
    if doubts:
        parts += ["", *(line for doubt in doubts for line in wrapped(doubt, "Warning: "))]
    return "\n".join(parts) + "\n"


def equation(result: BenchLaw) -> str:
    """Return the law as an equation, with what stands beside f.

    Args:
        result: from `law_of_bench`.
    """
    if result.bench.is_quasi_static:
        return "F = F0 + K z + f(z)"
    mass = "" if result.bench.acceleration is None else "m z'' + "
    return f"F = F0 + {mass}K z + C z' + f(z, z')"


def bench_json(result: BenchLaw) -> dict[str, Any]:
    """Return the law of a test bench as the content of result.json.

    Args:
        result: from `law_of_bench`.

    Returns:
        `schema`, `title`, `parameters` {name: {value, std, interval95} or None}, `law` {name, latex, parameters {kind:
        {parameter: {value, std, interval95}}}}, `r2`, `r2_left_out`, `residual_rms_n`, `n_independent`, `ladder` [{law,
        r2, r2_left_out, bic, kept, chosen}], `memory`, `loop` {travel_amplitude_m, frequency_hz, area_j {value, std,
        interval95}} or None, `cycle` (the same of the whole force), `simulation` {error_rms_m, r2, steps_per_sample,
        tried {law: error_rms_m}} or None, `warnings`, `not_determined`, `settings`.
    """
    return plain(
        {
            "schema": SCHEMA,
            "title": result.title,
            "parameters": asdict(result.parameters),
            "law": {
                "name": result.law.name,
                "latex": result.law.latex,
                "parameters": {
                    kind: {name: asdict(estimate) for name, estimate in estimates.items()}
                    for kind, estimates in result.law_estimates.items()
                },
            },
            "r2": result.r2,
            "r2_left_out": result.r2_left_out,
            "residual_rms_n": result.residual_rms,
            "n_independent": result.n_independent,
            "ladder": [
                {
                    "law": step.law_name,
                    "r2": step.fit.r2,
                    "r2_left_out": None if step.left_out is None else step.fit.r2_of(step.left_out),
                    "bic": step.fit.bic,
                    "kept": step.kept,
                    "chosen": step is chosen(result.ladder),
                }
                for step in result.ladder
            ],
            "memory": asdict(result.memory) | {"seen": result.memory.seen},
            "loop": None if result.loop is None else asdict(result.loop),
            "cycle": asdict(result.cycle),
            "simulation": None if result.simulation is None else _simulation_json(result.simulation),
            "warnings": result.warnings,
            "not_determined": result.not_determined,
            "settings": _settings(result),
        }
    )


def _simulation_json(simulation: Simulation) -> dict[str, Any]:
    return {
        "error_rms_m": simulation.error_rms_m,
        "r2": simulation.r2,
        "steps_per_sample": simulation.steps_per_sample,
        "tried": simulation.tried,
    }


def _settings(result: BenchLaw) -> dict[str, Any]:
    """What the answer was made with: the record, what could be chosen, and every number that was tuned."""
    bench, tuned = result.bench, asdict(result.settings)
    search = result.settings.search
    return {
        "columns": bench.channels,
        "n_samples": bench.force.size,
        "fs_hz": bench.fs,
        "velocity_from": bench.velocity_from,
        "quasi_static": bench.is_quasi_static,
        "moving_mass": bench.acceleration is not None,
        "mass_kg": bench.mass_kg,
        "velocity_band_hz": bench.velocity_band_hz,
        "travel_zero_m": bench.travel_zero_m,
        "candidates": result.candidates,
        "most_terms": search.most_terms,
        "n_search_samples": result.n_search_samples,
        "n_left_out_stretches": result.settings.n_stretches,
        "bic_margin": search.bic_margin,
        "rms_margin": search.error_margin,
        "interval_cell_s": result.interval_cell_s,
        **tuned,
    }


def write_bench_report(
    result: BenchLaw, directory: str | os.PathLike[str], *, progress: Callable[[str], None] | None = None
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Args:
        result: from `law_of_bench`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    images = drawn(bench_pictures(), result, None, progress=progress)
    page = rendered(
        "bench.html.jinja",
        images,
        title=result.title or "Test bench",
        result=result,
        columns=columns(None),
        rows=bench_rows(result),
        quality=quality(result),
        equation=equation(result).replace("'", "′"),
        memory=_sentence(result.memory.statement),
        warnings=_doubts(result),
        pictures=bench_pictures(),
        command=_command(result),
    )
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = page.encode()
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(bench_json(result)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


def bench_pictures() -> tuple[Picture, ...]:
    """Return the figures of the report of a test bench."""
    from opid import plots

    return (
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


def bench_rows(result: BenchLaw) -> list[Row]:
    """Return the table of numbers: stiffness, damping, offset, and the parameters of the law.

    Args:
        result: from `law_of_bench`.
    """
    parameters = result.parameters.items()
    table = [estimate_row(*LABELS[name], estimate) for name, estimate in parameters if estimate.value is not None]
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


def _command(result: BenchLaw) -> str:
    names = {role: name for role, name in result.bench.channels.items() if name is not None}
    options = " ".join(f"--{role} {shlex.quote(name)}" for role, name in names.items())
    flags = " --moving-mass" if result.bench.acceleration is not None else ""
    flags += "" if result.bench.mass_kg is None else f" --mass {result.bench.mass_kg:.12g}"
    flags += " --quasi-static" if result.bench.is_quasi_static else ""
    return f"opid law {shlex.quote(result.title or 'BENCH.csv')} {options}{flags}"
