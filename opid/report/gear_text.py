"""One gear as text and as tables: parameters, law, ratios to the mass, and what the answer rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from opid.mechanics.laws.law import law_from_parameters
from opid.mechanics.laws.rows import unit_of_parameter
from opid.report.as_text import Row, columns, estimate_row, labelled, laid_out, refusal, table_lines, wrapped
from opid.report.estimates import formula, parameter_label
from opid.report.rest_rows import rest_rows
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.result import UNITS, Evidence, Identification

Truth = Mapping[str, Any]

LABELS = {
    "sprung_mass_kg": "sprung mass M2",
    "suspension_stiffness_n_per_m": "stiffness K2",
    "suspension_damping_n_s_per_m": "damping C2",
    "ground_stiffness_n_per_m": "ground K3",
    "stiffness_per_mass": "K2/M2",
    "damping_per_mass": "C2/M2",
    "ground_stiffness_per_mass": "K3/M2",
    "natural_frequency_hz": "natural freq.",
    "damping_ratio": "damping ratio",
}
# kinds of law that are named one by one
_MOST_NAMED = 6


def gear_text(result: AnyIdentification, truth: Truth | None = None) -> str:
    """Return the identification of one gear as text: the numbers, what limits them, and what to doubt.

    Args:
        result: the identification.
        truth: of a simulated run, as in truth.json: shown beside each estimate.
    """
    sensors = sensors_in_words(result.evidence[0]) if isinstance(result, Identification) else ""
    return laid_out(
        [f"{result.title or 'Identification'} ({result.method})"],
        refusal(result.not_determined),
        table_lines(gear_rows(result, truth), columns(truth)),
        wrapped(gear_limits(result)),
        wrapped(sensors, "Sensors: "),
        *(wrapped(f"{sentence}.", "Law: ") for sentence in result.alternative_laws),
        labelled("Warning: ", result.warnings),
    )


def gear_rows(result: AnyIdentification, truth: Truth | None = None) -> list[Row]:
    """Return the table of numbers: parameters, law, ratios to the mass.

    Args:
        result: the identification.
        truth: as in truth.json, or None.
    """
    true = truth["parameters"] if truth else {}
    table = [
        estimate_row(LABELS[name], UNITS[name], estimate, true.get(name), truth is not None)
        for name, estimate in result.parameters.items()
    ]
    table += _law_rows(result, truth)
    if isinstance(result, Identification):
        table += rest_rows(result.interfaces[0], result.units, has_truth=truth is not None)
    table.append(Row("Ratios to the mass of the reference run"))
    slope = _true_slope(truth) if truth and isinstance(result, Identification) else 0.0
    for name, estimate in result.ratios.items():
        if name == "natural_frequency_hz":
            table += _row_of_frequency(result)
        table.append(
            estimate_row(LABELS[name], UNITS[name], estimate, _true_ratio(name, true, slope), truth is not None)
        )
    return [*table, *_equivalent_rows(result, truth is not None)]


def _row_of_frequency(result: AnyIdentification) -> Iterator[Row]:
    """What natural frequency and damping ratio belong to, where that is not K2 with C2 alone."""
    if isinstance(result, Identification) and dict(result.ratios.items())["natural_frequency_hz"].value is not None:
        said = {
            "linear part": None,
            "tangent at rest": "On the tangent stiffness at rest in the reference run, with the damping C2",
            "all but what the law remembers": "Without what the law remembers: stiffer in small or quick motion",
        }[result.frequency_of]
        if said is not None:
            yield Row(said)


def _equivalent_rows(result: AnyIdentification, has_truth: bool) -> Iterator[Row]:
    """What a linear analysis would find in each run, where no number of the law is believed, or the law remembers."""
    if not isinstance(result, Identification) or not (result.limited_by == "model" or result.law.has_memory):
        return
    for each in result.equivalents:
        yield Row(f"Straight suspension that comes nearest to it over the motion of run {each.run!r}")
        for name in ("natural_frequency_hz", "damping_ratio"):
            yield estimate_row(LABELS[name], UNITS[name], getattr(each, name), None, has_truth)


def gear_limits(result: AnyIdentification) -> str:
    """Return the sentences that say what the answer rests on.

    Args:
        result: the identification.
    """
    return _limits_of_model(result) if isinstance(result, Identification) else _limits_of_chain(result)


def sensors_in_words(evidence: Evidence) -> str:
    """Return what was found out about the sensors beside what was known of them before; empty where nothing was.

    Args:
        evidence: of a fit.
    """
    fit = evidence.fit
    sentences = [
        f"{fault.name} {fit.value(fault.name):.5g} +- {fit.std[fit.model.names.index(fault.name)]:.1g} "
        f"(before: {fault.nominal:.3g} +- {fault.std:.1g})"
        for fault in fit.model.faults
    ]
    return "; ".join(sentences) + "." if sentences else ""


def _limits_of_model(result: Identification) -> str:
    evidence, lines = result.evidence[0], result.runs[0].frequency_hz
    white = evidence.whiteness.white
    predicted = (
        f"{_from_runs(len(result.runs), (lines[0], lines[-1]))}the model predicts the airframe acceleration to "
        f"{_mm_per_s2(evidence.fit.noise_m_per_s2)} rms, and the sensors' noise is at most "
        f"{_mm_per_s2(evidence.noise)}; the prediction errors are {'white, as noise is' if white else 'not white'}."
    )
    if not any(estimate.interval95 for _, estimate in (*result.parameters.items(), *result.ratios.items())):
        return predicted
    checked = evidence.bootstrap_over_white.get("inverse_mass")
    check = f" (resampling blocks of time gives {checked:.2f} times that of the mass)" if checked and white else ""
    unlike = " and for suspensions that differ from run to run" * (evidence.repeatability.estimated is not None)
    sentences = [
        f"{predicted} The intervals allow for {'such noise' if white else 'errors so coloured'}{check}{unlike}.",
        *_of_runs_left_out(result, evidence),
        *(f"{sentence[0].upper()}{sentence[1:]}." for sentence in evidence.limits),
    ]
    return " ".join(sentences) + _chosen_among(result.options.law, result.options.kinds)


def _of_runs_left_out(result: Identification, evidence: Evidence) -> Iterator[str]:
    """How well the runs predict each other, where more than noise is left."""
    for each in evidence.error.left_out if evidence.error else ():
        yield (
            f"The other runs predict {result.runs[each.run].name!r} to {100 * each.unexplained:.2g} % of its rms "
            f"acceleration, with {100 * each.inside:.0f} % of its lines inside the band that is to hold 95 %."
        )


def _limits_of_chain(result: PaperIdentification) -> str:
    averages = min(run.T.spectra.n_averages for run in result.chain.runs)
    return (
        f"{_from_runs(len(result.chain.runs), result.chain.band_hz)}the fitted equation leaves "
        f"{_mm_per_s2(result.joint.noise_m_per_s2)} rms unexplained, the noise floor of the airframe sensor is at most "
        f"{_mm_per_s2(result.chain.noise_floor_m_per_s2)}. Each transmissibility rests on {averages:.1f} independent "
        f"averages (the parameters do not come from it).{_the_same_strut(result)}"
        f"{_chosen_among(result.settings.law, result.tried_kinds)}"
    )


def _the_same_strut(result: PaperIdentification) -> str:
    if len(result.chain.runs) < 2:
        return ""
    return " Stiffness, damping and friction are taken to be the same in all runs; the driven model lets them differ."


def _from_runs(n_runs: int, band_hz: tuple[float, float]) -> str:
    return f"From {n_runs} run{'s' * (n_runs > 1)}, {band_hz[0]:.3g} to {band_hz[1]:.3g} Hz: "


def _chosen_among(law: str | None, kinds: tuple[str, ...]) -> str:
    if law is not None:
        return ""
    named = ", ".join(sorted(kinds)) if len(kinds) <= _MOST_NAMED else f"the {len(kinds)} kinds of the library"
    return (
        f" Stiffness and damping are the linear part of the force and the law is the rest of it, chosen among {named} "
        "and their sums; beside another law they would be others."
    )


def _law_rows(result: AnyIdentification, truth: Truth | None) -> Iterator[Row]:
    per_mass = result.per_mass
    terms = result.law.terms
    shown = f", {'f/M2' if per_mass else 'f'} = {formula(result.law.latex)}" if len(terms) == 1 else ""
    true_law = f"; truth: {truth['law']['name']}" if truth and truth["law"]["name"] != result.law.name else ""
    yield Row(f"Law: {result.law.name}{shown}{true_law}")
    for term in terms:
        if len(terms) > 1:
            yield Row(f"Term {term.name}: {formula(term.kind.latex)}")
        for parameter in term.kind.parameters if term.name in result.law_estimates else ():
            amplitude = parameter.role == "amplitude"
            true = truth["law"]["parameters"].get(term.name, {}).get(parameter.name) if truth else None
            if truth and true is not None and amplitude and per_mass:
                true /= truth["parameters"]["sprung_mass_kg"]
            yield estimate_row(
                parameter_label(parameter),
                unit_of_parameter(parameter, per_mass=per_mass),
                result.law_estimates[term.name][parameter.name],
                true,
                truth is not None,
            )


def _true_slope(truth: Truth) -> float:
    """What the true law adds to the tangent stiffness at rest, N/m."""
    law = law_from_parameters(truth["law"]["name"], truth["law"]["parameters"])
    return float(law.gradient(0.0, 0.0)[0])


def _true_ratio(name: str, true: Mapping[str, float], slope: float) -> float | None:
    if not true:
        return None
    mass = true["sprung_mass_kg"]
    stiffness, damping = true["suspension_stiffness_n_per_m"], true["suspension_damping_n_s_per_m"]
    ground = true["ground_stiffness_n_per_m"]
    omega = math.sqrt((stiffness + ground + slope) / mass)
    return {
        "stiffness_per_mass": stiffness / mass,
        "damping_per_mass": damping / mass,
        "ground_stiffness_per_mass": ground / mass,
        "natural_frequency_hz": omega / (2 * math.pi),
        "damping_ratio": damping / (2 * mass * omega),
    }.get(name)


def _mm_per_s2(value: float) -> str:
    """An acceleration with two digits."""
    return f"{float(f'{1e3 * value:.2g}'):g} mm/s^2"
