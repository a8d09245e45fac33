"""What an answer rests on, as plain numbers for a file."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from opid.suspensions.one_gear.doubts import unexplained_noise
from opid.suspensions.one_gear.model_evidence import ModelEvidence
from opid.suspensions.one_gear.pursuit import library
from opid.suspensions.paper.classical import Evidence, PeakPair, RunEvidence
from opid.suspensions.paper.joint_fit import alternatives, chosen


def diagnostics(evidence: Evidence, settings: dict[str, Any]) -> dict[str, Any]:
    """Return what an answer rests on, ready for JSON.

    Args:
        evidence: of a chain.
        settings: of the identification.
    """
    step = chosen(evidence.ladder)
    return {
        "settings": settings,
        "unexplained_noise_m_per_s2": evidence.joint.noise_m_per_s2,
        "sensor_noise_floor_m_per_s2": evidence.noise_floor,
        "unexplained_over_floor": unexplained_noise(evidence),
        "n_lines": [int(frequency.size) for frequency in evidence.joint.frequency_hz],
        "static_transmissibility_read_from_lines": evidence.mean_static_transmissibility,
        "law_candidates": sorted(
            library()
            if evidence.model is not None
            else {term for rung in evidence.ladder for term in rung.law_name.split("+") if term != "linear"}
        ),
        "law_ladder": [
            {
                "law": rung.law_name,
                "bic": rung.fit.bic,
                "unexplained_noise_m_per_s2": rung.fit.noise_m_per_s2,
                "left_out_m_per_s2": rung.left_out_m_per_s2,
                "road": rung.road,
                "kept": rung.kept,
                "chosen": rung is step,
            }
            for rung in evidence.ladder
        ],
        "law_alternatives": list(alternatives(evidence.ladder)),
        "peak_pairs": [_pair_diagnostics(pair) for pair in evidence.pairs],
        "runs": [_run_diagnostics(run) for run in evidence.runs],
        "model": None if evidence.model is None else _model_diagnostics(evidence.model),
    }


def _model_diagnostics(model: ModelEvidence) -> dict[str, Any]:
    fit, found = model.fit, model.whiteness
    nominal = {nuisance.name: nuisance for nuisance in fit.sensors.nuisances}
    names = [name for name in fit.names if name not in nominal]
    std, boot = dict(zip(fit.names, fit.std, strict=True)), dict(zip(fit.names, model.bootstrap_std, strict=True))
    coloured = dict(zip(fit.names, model.coloured_std, strict=True))
    level = float(np.sqrt(fit.variance))
    return {
        "noise_m_per_s2": {"unsprung": fit.noise[0] * level, "sprung": fit.noise[1] * level},
        "whiteness": asdict(found) | {"band_hz": list(found.band_hz)},
        "std_over_white": {name: float(coloured[name] / std[name]) for name in names},
        "bootstrap_std_over_white": {name: float(boot[name] / std[name]) for name in names},
        "sensors": {
            name: {
                "value": fit[name],
                "std": float(std[name]),
                "known_before": [nuisance.nominal, nuisance.std],
            }
            for name, nuisance in nominal.items()
        },
        "demanded": [asdict(demand) | {"alike": list(demand.alike)} for demand in model.demands],
        "imitates_ground_spring": list(model.ground.sentences),
        "mended_spikes": {"unsprung": model.mended_spikes[0], "sprung": model.mended_spikes[1]},
        "surface": {
            "largest_departure_in_standard_errors": model.surface.largest_standard_errors,
            "expected_by_chance": model.surface.expected_standard_errors,
            "largest_departure_percent": model.surface.largest_percent,
        },
        "n_starts": model.n_starts,
        "limits": list(model.limits),
    }


def _pair_diagnostics(pair: PeakPair) -> dict[str, Any]:
    return {
        "run": pair.run_name,
        "reference_hz": pair.match.reference.frequency_hz,
        "reference_magnitude": pair.match.reference.magnitude,
        "changed_hz": pair.match.changed.frequency_hz,
        "changed_magnitude": pair.match.changed.magnitude,
        "credible": pair.match.credible,
        "reason": pair.match.reason,
        "as_printed": asdict(pair.as_printed) if pair.as_printed else None,
        "sign_restored": asdict(pair.sign_restored) if pair.sign_restored else None,
    }


def _run_diagnostics(run: RunEvidence) -> dict[str, Any]:
    def direct(fit: Any) -> dict[str, Any]:
        return {
            "stiffness_per_mass": [float(fit.value[0]), float(fit.std[0])],
            "damping_per_mass": [float(fit.value[1]), float(fit.std[1])],
            "ground_stiffness_per_mass": [float(fit.value[2]), float(fit.std[2])],
            "natural_frequency_hz": fit.natural_frequency_hz,
            "damping_ratio": fit.damping_ratio,
        }

    return {
        "name": run.name,
        "mass_change_kg": run.mass_change_kg,
        "duration_s": run.time_s.size / run.fs,
        "fs": run.fs,
        "n_averages": run.T.spectra.n_averages,
        "n_blocks": run.T.spectra.n_blocks,
        "noise_floor_m_per_s2": {"unsprung": run.noise_floor[0], "sprung": run.noise_floor[1]},
        "travel_rms_m": float(run.surface.travel.std()),
        "velocity_rms_m_per_s": float(run.surface.velocity.std()),
        "surface_coverage": run.binned.coverage,
        "terms": [
            {"term": verdict.name, "departure": verdict.departure, "statement": verdict.statement}
            for verdict in run.surface_fit.verdicts
        ],
        "complex_least_squares": direct(run.complex_fit),
        "errors_in_variables": direct(run.spectral_fit),
        "peaks_hz": [peak.frequency_hz for peak in run.peaks],
        "findings": [asdict(finding) for finding in run.findings],
    }
