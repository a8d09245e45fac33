"""Results as values of JSON: plain dicts and lists, SI units, and null instead of numbers that are not finite.

`result.json` has one schema for one gear and for bodies. Values that only one of them has are null or empty for the
other, so that the keys are always there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.json_values import plain
from opid.signals.recording import FloatArray
from opid.signals.spectra import Transmissibility
from opid.suspensions.answer.stored_fit import store_fits
from opid.suspensions.fitting.faults import Demand
from opid.suspensions.law_search.force_surface import VisitedForce
from opid.suspensions.law_search.pursuit import LawStep, chosen
from opid.suspensions.own_structure import SCHEMA as STRUCTURE_SCHEMA, StructureIdentification
from opid.suspensions.paper.chain import PaperChain, PeakPair, RunEvidence
from opid.suspensions.paper.printed import PrintedRun
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.paper.transmissibility import DirectParameters
from opid.suspensions.result import (
    SCHEMA,
    Evidence,
    GearParameters,
    GearRatios,
    Identification,
    InterfaceEstimate,
    SpringEstimate,
    units_of_suspensions,
)
from opid.suspensions.study import Run, Study

Json = dict[str, Any]


def result_json(result: Identification | PaperIdentification) -> Json:
    """Return an identification as the content of result.json.

    Args:
        result: the identification.

    Returns:
        The content that `docs/schemas/identification-1.schema.json` describes.
    """
    if isinstance(result, PaperIdentification):
        return plain(
            _build_head(result)
            | _describe_gear(result)
            | {"diagnostics": _build_paper_diagnostics(result)}
            | _build_tail(result)
        )
    if result.study.is_one_gear:
        return plain(
            _build_head(result)
            | _describe_gear(result)
            | _build_structures(result)
            | {"natural_frequency_of": result.frequency_of}
            | {"diagnostics": _build_gear_diagnostics(result)}
            | _build_tail(result)
        )
    return plain(
        _build_head(result)
        | _describe_body(result)
        | _build_structures(result)
        | {"diagnostics": _build_body_diagnostics(result)}
        | _build_tail(result)
    )


def structure_json(result: StructureIdentification) -> Json:
    """Return the identification of a user's own structure as the content of result.json.

    Args:
        result: the result of `identify_structure`.

    Returns:
        The content that `docs/schemas/structure-1.schema.json` describes.
    """
    reported = ("noise_m_per_s2", "residual_over_noise", "residual_of", "left_out_over_noise")
    return plain(
        {
            "schema": STRUCTURE_SCHEMA,
            "per_mass": result.per_mass,
            "masses": _build_estimates(result.masses),
            "interfaces": {name: _build_spring(each, result.per_mass) for name, each in result.interfaces.items()},
            "joints": {name: _build_spring(each, result.per_mass) for name, each in result.joints.items()},
            **{name: getattr(result, name) for name in reported},
            "repeatability": asdict(result.repeatability),
            "limits": result.limits,
            "warnings": result.warnings,
            "not_determined": result.not_determined,
            "settings": asdict(result.settings),
        }
    )


def chain_of(result: AnyIdentification) -> PaperChain | None:
    """Return the steps of the paper on the runs of one gear; None if they cannot be computed.

    Args:
        result: the identification.
    """
    try:
        return result.paper_chain
    except (InputError, NotDeterminedError):
        return None


# ---- the answer ------------------------------------------------------------------------------------


def _build_head(result: Identification | PaperIdentification) -> Json:
    return {
        "schema": SCHEMA,
        "method": result.method,
        "title": result.title,
        "date": None if result.date is None else result.date.isoformat(),
    }


def _build_tail(result: Identification | PaperIdentification) -> Json:
    weighed = [asdict(each) for each in result.weighed]
    return {"weighed": weighed, "warnings": result.warnings, "not_determined": result.not_determined}


def _describe_gear(result: AnyIdentification) -> Json:
    return {
        "parameters": asdict(result.parameters),
        "ratios": asdict(result.ratios),
        "law": {
            "name": result.law.name,
            "latex": result.law.latex,
            "per_mass": result.per_mass,
            "parameters": {kind: _build_estimates(values) for kind, values in result.law_estimates.items()},
        },
        "restoring_force": _build_force(result.restoring_force),
    }


def _describe_body(result: Identification) -> Json:
    """Return the values of a body, with empty keys of one gear; a common law is given if all suspensions are alike."""
    nothing, parameters = np.empty(0), asdict(result.parameters)
    laws = {interface.law.name: interface.law.latex for interface in result.interfaces}
    name, latex = next(iter(laws.items())) if len(laws) == 1 else (None, None)
    return {
        "parameters": parameters | asdict(GearParameters()) | parameters,
        "ratios": asdict(result.ratios) | asdict(GearRatios()),
        "law": {"name": name, "latex": latex, "per_mass": result.per_mass, "parameters": {}},
        "restoring_force": _build_force(VisitedForce(nothing, nothing, nothing, nothing, per_mass=result.per_mass)),
    }


def _build_structures(result: Identification) -> Json:
    best = result.recommended
    positions = {
        name: dict(zip(("x_m", "y_m", "sensor_x_m", "sensor_y_m"), position, strict=True))
        for name, position in result.places.items()
    }
    return {
        "structure": {
            "kind": result.structure,
            "is_one_gear": result.study.is_one_gear,
            "recommended": None if best is None else best.kind,
            "why": result.reason or None,
            "limited_by": result.limited_by,
            "residual_over_noise": result.residual_over_noise,
            "noise_m_per_s2": result.noise_m_per_s2,
            "places": positions,
            "place_corrections": _build_estimates(result.place_corrections),
        },
        "interfaces": [_build_interface(result, interface) for interface in result.interfaces],
        "candidates": [asdict(candidate) for candidate in result.candidates],
        "runs": [_run_of_body(result, index) for index in range(len(result.runs))],
        "equivalents": [asdict(each) for each in result.equivalents],
        "fits": [asdict(each) for each in store_fits(result)],
    }


def _run_of_body(result: Identification, index: int) -> Json:
    """Return a run, and the residual of its free motion in the fit of all runs and in that of the others."""
    run = result.runs[index]
    left_out = next((each for each in result.left_out if each.run == index), None)
    return {
        "name": run.name,
        "mass_change_kg": run.mass_change_kg,
        "loading": run.loading,
        "unexplained": run.unexplained,
        "unexplained_left_out": None if left_out is None else left_out.unexplained,
        "inside_left_out": None if left_out is None else left_out.inside,
        "spectra_left_out": [] if left_out is None else [asdict(each) for each in left_out.spectra],
    }


def _build_interface(result: Identification, interface: InterfaceEstimate) -> Json:
    stiffness, _ = result.units
    x_m, y_m = result.places[interface.name][:2]
    spring = _build_spring(interface, result.per_mass)
    return {
        "name": interface.name,
        "shared_with": interface.shared_with,
        "x_m": x_m,
        "y_m": y_m,
        "stiffness": spring.pop("stiffness"),
        "damping": spring.pop("damping"),
        "ground_stiffness": asdict(interface.ground_stiffness) | {"unit": stiffness},
        "law": spring.pop("law"),
        "law_name": spring.pop("law_name"),
        "latex": spring.pop("latex"),
        "per_mass": result.per_mass,
        "residual_over_noise": interface.residual_over_noise,
        **spring,
        "gas": None if interface.gas is None else asdict(interface.gas),
    }


def _build_spring(spring: SpringEstimate, per_mass: bool) -> Json:
    stiffness, damping = units_of_suspensions(per_mass=per_mass)
    return {
        "stiffness": asdict(spring.stiffness) | {"unit": stiffness},
        "damping": asdict(spring.damping) | {"unit": damping},
        "law": {kind: _build_estimates(values) for kind, values in spring.law_estimates.items()},
        "law_name": spring.law.name,
        "latex": spring.law.latex,
        "rest_m": asdict(spring.rest_m),
        "at_rest": [asdict(each) for each in spring.at_rest],
    }


def _build_estimates(estimates: Mapping[str, Estimate]) -> Json:
    return {name: asdict(estimate) for name, estimate in estimates.items()}


def _build_force(force: VisitedForce) -> Json:
    unit = "m/s^2" if force.per_mass else "N"
    return {
        "travel": force.travel,
        "velocity": force.velocity,
        "force": force.force,
        "nonlinear_force": force.nonlinear_force,
        "per_mass": force.per_mass,
        "units": {"travel": "m", "velocity": "m/s", "force": unit, "nonlinear_force": unit},
    }


# ---- what it rests on ------------------------------------------------------------------------------


def _build_gear_diagnostics(result: Identification) -> Json:
    evidence, chain = result.evidence[0], chain_of(result)
    return {
        "settings": _list_channels(result.study)
        | _list_options(result)
        | {
            "high_pass_hz": None if chain is None else chain.high_pass_hz,
        },
        "unexplained_noise_m_per_s2": evidence.fit.noise_m_per_s2,
        "sensor_noise_floor_m_per_s2": evidence.noise,
        "unexplained_over_floor": result.residual_over_noise,
        "n_lines": [run.frequency_hz.size for run in result.runs],
        "law_candidates": sorted(result.options.kinds),
        "law_ladder": _build_ladder(evidence.ladder),
        "law_alternatives": result.alternative_laws,
        "runs": _build_runs_of_gear(result.study.runs, chain),
        **_build_chain_parts(chain),
        "model": _build_evidence(evidence)
        | {"mended_spikes": dict(zip(("unsprung", "sprung"), result.mended_spikes, strict=True))},
    }


def _build_paper_diagnostics(result: PaperIdentification) -> Json:
    chain, settings = result.chain, asdict(result.settings)
    return {
        "settings": _list_channels(result.study)
        | {
            "law": settings.pop("law") or "searched",
            "ground": settings.pop("ground"),
            "band_hz": settings.pop("band_hz"),
            "high_pass_hz": settings.pop("high_pass_hz"),
            "estimator": settings,
        },
        "unexplained_noise_m_per_s2": result.joint.noise_m_per_s2,
        "sensor_noise_floor_m_per_s2": chain.noise_floor_m_per_s2,
        "unexplained_over_floor": result.residual_over_noise,
        "n_lines": [frequency.size for frequency in result.joint.frequency_hz],
        "law_candidates": result.tried_kinds,
        "law_ladder": _build_ladder(result.ladder),
        "law_alternatives": result.alternative_laws,
        "runs": _build_runs_of_gear(result.study.runs, chain),
        **_build_chain_parts(chain),
        "model": None,
    }


def _build_body_diagnostics(result: Identification) -> Json:
    study, parts = result.study, result.evidence
    asked = _list_options(result)
    return {
        "study": _name_source(study),
        "law": asked["law"],
        "band_hz": asked["band_hz"],
        "settings": asked,
        "body_sensors": {sensor.channel: [sensor.x_m, sensor.y_m] for sensor in study.sensors},
        "why": result.why,
        "kind_asked_for": study.structure.kind,
        "position_tolerance_m": study.structure.position_tolerance_m,
        "noise_stated": study.structure.noise_m_per_s2 is not None,
        "runs": [
            {
                "name": run.name,
                "mass_change_kg": run.mass_change_kg,
                "findings": [asdict(finding) for finding in run.findings],
            }
            for run in study.runs
        ],
        "n_data": sum(part.fit.n_data for part in parts),
        "white": [part.whiteness.white for part in parts],
        "laws_tried": [
            {"law": step.law_name, "bic": step.fit.bic, "kept": step.kept, "fs_hz": step.fit.model.runs[0].fs}
            for part in parts
            for step in part.ladder
        ],
        "law_alternatives": result.alternative_laws,
        "models": [_build_evidence(part) for part in parts],
        "mended_spikes": dict(zip(("unsprung", "sprung"), result.mended_spikes, strict=True)),
    }


def _name_source(study: Study) -> str | None:
    return None if study.source is None else str(study.source)


def _list_channels(study: Study) -> Json:
    return {"study": _name_source(study), "sprung": study.sprung, "unsprung": study.unsprung}


def _list_options(result: Identification) -> Json:
    """Return the options of the call, and every tuned number."""
    options = result.options
    return {
        "law": options.law or "searched",
        "ground": options.ground,
        "band_hz": result.settings.runs.band_hz,
        "method_of_law": options.method_of_law,
        "seed": options.seed,
        "estimator": asdict(result.settings),
    }


def _build_ladder(ladder: Sequence[LawStep[Any]]) -> list[Json]:
    choice = chosen(ladder)
    return [
        {
            "law": step.law_name,
            "bic": step.fit.bic,
            "unexplained_noise_m_per_s2": step.fit.noise_m_per_s2,
            "left_out_m_per_s2": step.left_out,
            "road": step.method,
            "kept": step.kept,
            "chosen": step is choice,
        }
        for step in ladder
    ]


def _build_evidence(evidence: Evidence) -> Json:
    """Return the evidence of a fit of the driven model."""
    fit = evidence.fit
    faults = {fault.name: fault for fault in fit.model.faults}
    surfaces = {
        group: {
            "largest_departure_in_standard_errors": surface.largest_standard_errors,
            "expected_by_chance": surface.expected_standard_errors,
            "largest_departure_percent": surface.largest_percent,
        }
        for group, surface in evidence.surfaces.items()
    }
    return {
        "noise_m_per_s2": {
            side: fit.ratio * _compute_rms(level)
            for side, level in zip(("unsprung", "sprung"), fit.model.noise, strict=True)
        },
        "whiteness": asdict(evidence.whiteness),
        "std_over_white": {name: each for name, each in evidence.std_over_white.items() if name not in faults},
        "bootstrap_std_over_white": {
            name: each for name, each in evidence.bootstrap_over_white.items() if name not in faults
        },
        "sensors": {
            name: {
                "value": fit.value(name),
                "std": fit.std[fit.model.names.index(name)],
                "known_before": [fault.nominal, fault.std],
            }
            for name, fault in faults.items()
        },
        **({"gains_of_forces": _build_estimates(evidence.gains_of_forces)} if evidence.gains_of_forces else {}),
        "demanded": [_build_demand(demand) for demand in evidence.demands],
        "implausible": [_build_demand(demand) for demand in evidence.implausible],
        "imitates_ground_spring": evidence.ground.sentences,
        "surface": next(iter(surfaces.values()), None),
        "surfaces": surfaces,
        "n_starts": evidence.n_starts,
        "n_evaluations": fit.n_evaluations,
        "limits": evidence.limits,
        "repeatability": asdict(evidence.repeatability),
    }


def _compute_rms(levels: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(levels))))


def _build_demand(demand: Demand) -> Json:
    return {
        "name": demand.name,
        "words": demand.words,
        "value": demand.value,
        "std": demand.std,
        "error_before": demand.error_before,
        "error_after": demand.error_after,
        "alike": demand.alike,
    }


# ---- the steps of the paper ------------------------------------------------------------------------


def _build_chain_parts(chain: PaperChain | None) -> Json:
    return {
        "static_transmissibility_read_from_lines": None if chain is None else chain.static_transmissibility,
        "peak_pairs": [] if chain is None else [_build_pair(pair) for pair in chain.pairs],
        "table_3": [] if chain is None else [_build_pair(pair) for pair in chain.table_3],
    }


def _describe_spectra(T: Transmissibility) -> Json:
    """Return how a transmissibility was estimated."""
    return {
        "window": T.spectra.window,
        "overlap": T.spectra.noverlap / T.spectra.nperseg,
        "estimator": T.estimator,
        "block_s": T.spectra.nperseg / T.spectra.fs,
        "n_averages": T.spectra.n_averages,
        "n_blocks": T.spectra.n_blocks,
    }


def _build_pair(pair: PeakPair) -> Json:
    return {
        "run": pair.run_name,
        "reference_hz": pair.match.reference.frequency_hz,
        "reference_magnitude": pair.match.reference.magnitude,
        "changed_hz": pair.match.changed.frequency_hz,
        "changed_magnitude": pair.match.changed.magnitude,
        "credible": pair.match.credible,
        "reason": pair.match.reason,
        "as_printed": asdict(pair.as_printed),
        "sign_restored": asdict(pair.sign_restored),
    }


def _build_runs_of_gear(runs: Sequence[Run], chain: PaperChain | None) -> list[Json]:
    """Return the runs of one gear; without the paper's chain only what the study states of them."""
    steps: Sequence[RunEvidence | None] = [None] * len(runs) if chain is None else chain.runs
    return [_run_of_gear(run, step) for run, step in zip(runs, steps, strict=True)]


def _run_of_gear(run: Run, step: RunEvidence | None) -> Json:
    findings = run.findings if step is None else tuple(dict.fromkeys(step.findings))
    known = {
        "name": run.name,
        "mass_change_kg": run.mass_change_kg,
        "weighed_mass_kg": run.weighed_mass_kg,
        "duration_s": run.recording.duration_s,
        "fs": run.recording.fs,
        "n_samples": run.recording.n_samples,
        "findings": [asdict(finding) for finding in findings],
    }
    if step is None:
        return known
    return known | {
        "n_averages": step.T.spectra.n_averages,
        "n_blocks": step.T.spectra.n_blocks,
        "transmissibility": _describe_spectra(step.T),
        "printed": _build_printed(step.printed),
        "noise_floor_m_per_s2": dict(zip(("unsprung", "sprung"), step.noise_floor, strict=True)),
        "travel_rms_m": step.surface.travel.std(),
        "velocity_rms_m_per_s": step.surface.velocity.std(),
        "surface_coverage": step.binned.coverage,
        "terms": [
            {"term": verdict.name, "departure": verdict.departure, "statement": verdict.statement}
            for verdict in step.surface_fit.verdicts
        ],
        "complex_least_squares": _build_direct_fit(step.complex_fit),
        "errors_in_variables": _build_direct_fit(step.spectral_fit),
        "peaks_hz": [peak.frequency_hz for peak in step.peaks],
    }


def _build_printed(step: PrintedRun) -> Json:
    """Return the steps of a run as printed: eq. (3) on both curves, per unit of its mass, and the spectra."""
    names = {"travel": "stiffness_curve", "velocity": "damping_curve"}
    curves = {
        names[curve.along]: {
            "straight": fit.straight,
            "amplitude_m_per_s2": fit.law.vector[0],
            "scale": fit.law.vector[1],
            "residual_rms_m_per_s2": fit.residual_rms,
        }
        for curve, fit in zip(step.slices, step.slice_fits, strict=True)
    }
    return curves | {
        "transmissibility": _describe_spectra(step.T),
        "peaks_hz": [peak.frequency_hz for peak in step.peaks],
    }


def _build_direct_fit(fit: DirectParameters) -> Json:
    names = ("stiffness_per_mass", "damping_per_mass", "ground_stiffness_per_mass")
    return {
        **{name: [value, std] for name, value, std in zip(names, fit.value, fit.std, strict=True)},
        "natural_frequency_hz": fit.natural_frequency_hz,
        "damping_ratio": fit.damping_ratio,
    }
