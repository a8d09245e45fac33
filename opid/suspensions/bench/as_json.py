"""The law of a test bench as the content of result.json."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from opid.json_values import plain
from opid.suspensions.bench.law import SCHEMA, BenchLaw
from opid.suspensions.law_search.pursuit import chosen


def bench_json(result: BenchLaw) -> dict[str, Any]:
    """Return the law of a test bench as the content of result.json.

    Returns:
        What `docs/schemas/law-1.schema.json` describes.
    """
    simulation = result.simulation
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
            "simulation": None
            if simulation is None
            else {name: getattr(simulation, name) for name in ("error_rms_m", "r2", "steps_per_sample", "tried")},
            "warnings": result.warnings,
            "not_determined": result.not_determined,
            "settings": _settings(result),
        }
    )


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
