"""From a study to an answer, and what may be concluded from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.mechanics.laws import LAWS, Law
from opid.signals.recording import FloatArray
from opid.suspensions import band_lines
from opid.suspensions.one_gear.diagnostics import diagnostics
from opid.suspensions.one_gear.doubts import (
    doubts,
    gain_like_share,
    refused,
    straight_terms,
    unexplained_noise,
    widening,
)
from opid.suspensions.one_gear.limits import limits
from opid.suspensions.one_gear.model_chain import model_chain
from opid.suspensions.one_gear.result import PARAMETERS, RATIOS, Identification, VisitedForce, visited_force
from opid.suspensions.one_gear.study import Study
from opid.suspensions.paper.added_mass import AddedMass, absolute_parameters
from opid.suspensions.paper.classical import BAND_HZ, HIGH_PASS_HZ, Evidence, PeakPair, classical_start, evidence_of
from opid.suspensions.paper.direct_parameters import NAMES

METHODS = ("model", "classical", "paper")
# what a law that is straight in velocity (its scale in m/s) or in travel (m) cannot be told from
TRADES_WITH = {
    "m/s": ("suspension_damping_n_s_per_m", "damping_per_mass", "damping_ratio"),
    "m": ("suspension_stiffness_n_per_m", "stiffness_per_mass", "natural_frequency_hz", "damping_ratio"),
}
# no two sensors have gains more equal than this, and a gain error passes for a ground spring
EQUAL_GAINS = 0.001


def identify_study(
    study: Study,
    *,
    method: str = "model",
    law: str | None = None,
    band_hz: tuple[float, float] | None = None,
    high_pass_hz: float = HIGH_PASS_HZ,
    ground: bool = True,
    roads: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Identify mass, springs, damping and law of a suspension from runs at known mass changes.

    `model` fits the suspension that the measured spindle acceleration drives: nothing is integrated by itself, so a
    law keeps its slow motion. It starts from `classical`, the chain of Iwaniec & Uhl (2007) with every step mended:
    sound integration, the complex equation, noise on both channels, all runs in one least-squares problem. `paper`
    gives what the printed formula makes of the strongest matched peaks; it has no intervals.

    Args:
        study: the runs.
        method: "model", "classical" or "paper".
        law: a law to fit (`opid.mechanics.laws.LAWS`, sums joined by "+"); searched when left out.
        band_hz: lines that are compared, Hz; 0.3 to 40 Hz of the model, 0.5 to 12 Hz of the classical chain by default.
        high_pass_hz: corner of the integration that gives the motion inside the law, Hz.
        ground: whether a ground spring K3 is fitted (else it is 0).
        roads: how the model searches the law: "pursuit", "sparse regression" or both; the second only where the
            first is in doubt when left out.
        progress: called with the name of each step as it begins.

    Returns:
        The identification; where the data do not determine the absolute scale, `not_determined` says why and the
        ratios to the mass are given.

    Raises:
        InputError: an unknown method or law, or runs that are no runs of a suspension.
    """
    if method not in METHODS:
        raise InputError(f"there is no method {method!r}: {nearest(method, METHODS)}")
    start = classical_start(
        study,
        law=law,
        likely=method == "model",
        band_hz=(band_hz or BAND_HZ) if method != "model" else BAND_HZ,
        high_pass_hz=high_pass_hz,
        ground=ground,
        progress=progress,
    )
    settings = {
        "study": study.source.name if study.source else None,
        "sprung": study.sprung,
        "unsprung": study.unsprung,
        "high_pass_hz": high_pass_hz,
        "law": law or "searched",
        "ground": ground,
    }
    if method == "model":
        band_hz = band_hz or band_lines.BAND_HZ
        evidence = model_chain(
            start, search=law is None, ground=ground, band_hz=band_hz, roads=roads, progress=progress
        )
    else:
        evidence = evidence_of(start, start.joint, start.ladder, progress=progress)
    return (
        _conclude_paper(study, evidence, settings)
        if method == "paper"
        else _conclude(method, study, evidence, settings)
    )


def _conclude(method: str, study: Study, evidence: Evidence, settings: dict[str, Any]) -> Identification:
    if refused(evidence):
        return _refuse(method, study, evidence, settings)
    evidence = _with_honest_covariance(evidence)
    joint, added = evidence.joint, evidence.added_mass
    gain = gain_like_share(evidence)
    # None where the user ruled a ground spring out
    ground_std = evidence.model.ground.std_per_mass if evidence.model is not None and settings["ground"] else None
    ratios = _ratios(joint.value, joint.covariance, joint.names, gain)
    if "ground_stiffness_per_mass" not in joint.names:
        ratios["ground_stiffness_per_mass"] = _kept_out(ground_std, joint["stiffness_per_mass"], 1.0)
    if added is None:
        law, law_std, parameters = joint.law, joint.std, {name: Estimate() for name in PARAMETERS}
        law_std = np.array([law_std[joint.names.index(f"law[{i}]")] for i in range(law.vector.size)])
        stiffness, damping = joint["stiffness_per_mass"], joint["damping_per_mass"]
    else:
        law, law_std, parameters = added.law, added.std[4:], _parameters(added, gain, ground_std)
        stiffness, damping = (added[name] for name in PARAMETERS[1:3])
    result = Identification(
        method=method,
        title=study.title,
        parameters=parameters,
        ratios=ratios,
        law=law,
        law_estimates=_law_estimates(law, law_std.tolist()),
        restoring_force=visited_force(
            [run.surface for run in evidence.runs],
            law,
            stiffness=stiffness,
            damping=damping,
            per_mass=added is None,
        ),
        diagnostics=diagnostics(evidence, settings | {"band_hz": list(evidence.joint.band_hz)}),
        warnings=tuple(doubts(evidence, parameters)),
        not_determined=evidence.not_determined,
        evidence=evidence,
        date=study.date,
    )
    return _withheld(result)


def _with_honest_covariance(evidence: Evidence) -> Evidence:
    """Widen the covariance by the colour of the residual and by what the model lacks, and carry it to the mass."""
    joint, wider = evidence.joint, np.full(len(evidence.joint.names), widening(evidence))
    if evidence.model is not None and not evidence.model.whiteness.white:
        wider = wider * evidence.model.coloured_std / np.maximum(joint.std, 1e-300)
    joint = replace(joint, covariance=joint.covariance * np.outer(wider, wider))
    if evidence.model is not None:
        runs = evidence.runs
        fit = replace(evidence.model.fit, covariance=joint.covariance)
        what = limits(fit, [run.mass_change_kg for run in runs], sum(run.time_s.size / run.fs for run in runs))
        evidence = replace(evidence, model=replace(evidence.model, limits=tuple(what)))
    if evidence.added_mass is None:
        return replace(evidence, joint=joint)
    try:
        added = absolute_parameters(joint, [run.mass_change_kg for run in evidence.runs])
    except NotDeterminedError as error:
        return replace(evidence, joint=joint, added_mass=None, not_determined=str(error))
    return replace(evidence, joint=joint, added_mass=added)


def _refuse(method: str, study: Study, evidence: Evidence, settings: dict[str, Any]) -> Identification:
    """Withhold what a model that does not explain the runs would say; keep what each run says by itself."""
    unexplained = unexplained_noise(evidence)
    changes = {run.mass_change_kg for run in evidence.runs}
    ratios = {name: Estimate() for name in RATIOS}
    if len(changes) == 1 and len(evidence.runs) > 1:
        frequencies = [run.spectral_fit.natural_frequency_hz for run in evidence.runs]
        reason = (
            "all runs are said to have the same sprung mass, so only ratios to it could be determined, and they do not "
            f"even behave alike (natural frequencies {min(frequencies):.3f} to {max(frequencies):.3f} Hz): check "
            "mass_change_kg; the ratios given are those of the first run alone"
        )
        alone = evidence.runs[0].spectral_fit
        ratios = _ratios(alone.value, alone.covariance, NAMES, 0.0)
    else:
        reason = (
            f"the fitted model leaves {unexplained:.0f} times the sensor noise unexplained, so every number of it "
            "would be a guess: check the channels (swapped, upside down, in another unit) and the mass changes, "
            "let the law be searched, or take another band"
        )
    parameters = {name: Estimate() for name in PARAMETERS}
    nothing = np.empty(0)
    return Identification(
        method=method,
        title=study.title,
        parameters=parameters,
        ratios=ratios,
        law=evidence.joint.law,
        law_estimates={},
        restoring_force=VisitedForce(nothing, nothing, nothing, nothing, per_mass=True),
        diagnostics=diagnostics(evidence, settings | {"band_hz": list(evidence.joint.band_hz)}),
        warnings=tuple(doubts(evidence, parameters)),
        not_determined=reason,
        evidence=evidence,
        date=study.date,
    )


def _parameters(added: AddedMass, gain: float, ground_std: float | None) -> dict[str, Estimate]:
    """Absolute parameters with intervals, with what a gain error can do to them."""
    std, mu = added.std.copy(), added.fit["inverse_mass"]
    # the same gain error that would explain the ground spring moved stiffness and damping by as much
    std[1:3] = np.hypot(std[1:3], gain * np.abs(added.value[1:3]))
    if "gain_sprung" not in added.fit.names:
        std[3] = np.hypot(std[3], max(EQUAL_GAINS, gain) * added["suspension_stiffness_n_per_m"])
    parameters = {name: Estimate.normal(added[name], std[i]) for i, name in enumerate(PARAMETERS)}
    if "ground_stiffness_per_mass" not in added.fit.names:
        parameters["ground_stiffness_n_per_m"] = _kept_out(ground_std, added["suspension_stiffness_n_per_m"], 1 / mu)
    # the mass is 1/mu: its interval is the image of that of mu, longer upwards
    mu_std = added.fit.std[added.fit.names.index("inverse_mass")]
    if mu > 1.96 * mu_std:
        interval = (float(1 / (mu + 1.96 * mu_std)), float(1 / (mu - 1.96 * mu_std)))
        parameters["sprung_mass_kg"] = Estimate(1 / mu, float(std[0]), interval)
    return parameters


def _kept_out(std_per_mass: float | None, stiffness: float, mass: float) -> Estimate:
    """A ground spring that the runs do not demand: zero, as well as it would be known, and no better than gains are."""
    if std_per_mass is None:
        return Estimate(0.0)
    return Estimate.normal(0.0, np.hypot(mass * std_per_mass, EQUAL_GAINS * abs(stiffness)))


def _conclude_paper(study: Study, evidence: Evidence, settings: dict[str, Any]) -> Identification:
    """Report the printed formula on the strongest pair of peaks; the paper gives no damping and no intervals."""
    pair = strongest_pair(evidence.pairs)
    parameters = {name: Estimate() for name in PARAMETERS}
    ratios = {name: Estimate() for name in RATIOS}
    reason = evidence.not_determined if len({run.mass_change_kg for run in study.runs}) < 2 else None
    law = evidence.joint.law
    if pair is None or pair.as_printed is None:
        reason = reason or "the runs have no peak of |T| in common, and the printed formula needs one pair"
    else:
        mass = pair.as_printed
        ratios["stiffness_per_mass"] = Estimate(mass.stiffness_n_per_m / mass.sprung_mass_kg)
        ratios["ground_stiffness_per_mass"] = Estimate(mass.ground_stiffness_n_per_m / mass.sprung_mass_kg)
        if mass.sprung_mass_kg > 0:
            values = (mass.sprung_mass_kg, mass.stiffness_n_per_m, None, mass.ground_stiffness_n_per_m)
            parameters = {name: Estimate(value) for name, value in zip(PARAMETERS, values, strict=True)}
            law = law.scaled(mass.sprung_mass_kg)
        else:
            reason = f"the printed formula gives a sprung mass of {mass.sprung_mass_kg:.0f} kg: {pair.match.reason}"
    absolute = parameters["sprung_mass_kg"].value is not None
    stiffness = parameters["suspension_stiffness_n_per_m"].value or ratios["stiffness_per_mass"].value or 0.0
    warnings = [
        "the printed formula ignores damping and the sign of T above resonance: it is shown for comparison, and it "
        "has no intervals; use --method classical for an answer"
    ]
    if pair is not None and not pair.match.credible:
        warnings.append(pair.match.reason)
    return Identification(
        method="paper",
        title=study.title,
        parameters=parameters,
        ratios=ratios,
        law=law,
        law_estimates={},
        restoring_force=visited_force(
            [run.surface for run in evidence.runs],
            law,
            stiffness=stiffness,
            damping=0.0,
            per_mass=not absolute,
        ),
        diagnostics=diagnostics(evidence, settings | {"band_hz": list(evidence.joint.band_hz)}),
        warnings=tuple(warnings),
        not_determined=reason,
        evidence=evidence,
        date=study.date,
    )


def strongest_pair(pairs: tuple[PeakPair, ...]) -> PeakPair | None:
    """Return the credible pair with the largest |T|, or the largest at all, or None.

    Args:
        pairs: of `Evidence.pairs`.
    """
    return max(pairs, key=lambda pair: (pair.match.credible, pair.match.reference.magnitude), default=None)


def _ratios(value: FloatArray, covariance: FloatArray, names: tuple[str, ...], gain: float) -> dict[str, Estimate]:
    """Ratios to the mass, natural frequency and damping ratio on a still wheel, by the delta method.

    `gain` is the share by which a gain error may have moved stiffness and damping.
    """
    k, c = value[0], value[1]
    ground = NAMES[2] in names
    total = k + (value[2] if ground else 0.0)
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    ratios = {name: Estimate() for name in RATIOS}
    ratios["stiffness_per_mass"] = Estimate.normal(k, np.hypot(std[0], gain * k))
    ratios["damping_per_mass"] = Estimate.normal(c, np.hypot(std[1], gain * c))
    ratios["ground_stiffness_per_mass"] = (
        Estimate.normal(value[2], np.hypot(std[2], max(EQUAL_GAINS, gain) * k)) if ground else Estimate(0.0)
    )
    if total <= 0:
        return ratios
    omega = np.sqrt(total)
    gradients = np.zeros((2, len(names)))
    gradients[:, 0] = 1 / (4 * np.pi * omega), -c / (4 * omega**3)
    gradients[1, 1] = 1 / (2 * omega)
    if ground:
        gradients[:, 2] = gradients[:, 0]
    own = np.sqrt(np.maximum(np.diag(gradients @ covariance @ gradients.T), 0))
    frequency, zeta = omega / (2 * np.pi), c / (2 * omega)
    ratios["natural_frequency_hz"] = Estimate.normal(frequency, np.hypot(own[0], gain / 2 * frequency))
    ratios["damping_ratio"] = Estimate.normal(zeta, np.hypot(own[1], gain * zeta))
    return ratios


def _law_estimates(law: Law, std: list[float]) -> Mapping[str, Mapping[str, Estimate]]:
    spread = iter(std)
    return {
        term.name: {
            parameter.name: Estimate.normal(value, next(spread))
            for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True)
        }
        for term in law.terms
    }


def _withheld(result: Identification) -> Identification:
    """Take away the intervals of what trades with a straight term, and keep the values."""
    parameters, ratios, law = dict(result.parameters), dict(result.ratios), dict(result.law_estimates)
    for term in straight_terms(result.evidence):
        for name in TRADES_WITH[term.unit]:
            table = parameters if name in parameters else ratios
            table[name] = Estimate(table[name].value)
        law[term.name] = {name: Estimate(each.value) for name, each in law.get(term.name, {}).items()}
    return replace(result, parameters=parameters, ratios=ratios, law_estimates=law)
