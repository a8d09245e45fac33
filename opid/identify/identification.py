"""From a study to an answer, and what may be concluded from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.identify.added_mass import AddedMass
from opid.identify.classical import BAND_HZ, HIGH_PASS_HZ, Evidence, PeakPair, RunEvidence, classical_chain
from opid.identify.direct_parameters import NAMES
from opid.identify.joint_fit import chosen
from opid.identify.model_chain import model_chain
from opid.identify.result import PARAMETERS, RATIOS, Estimate, Identification, VisitedForce, visited_force
from opid.identify.study import Study
from opid.mechanics.laws import LAWS, Law
from opid.signals.recording import FloatArray

METHODS = ("classical", "model", "paper")
# the model explains the runs down to the sensors' noise up to here; above, what it lacks rules the answer
UNEXPLAINED_NOTED = 1.5
UNEXPLAINED_DOUBTED = 3.0
UNEXPLAINED_REFUSED = 20.0
FEW_AVERAGES = 4
# a ground spring below this share of K2 is what a gain error of a per cent or two looks like
GAIN_LIKE = 0.05
# what a law that is straight in velocity (its scale in m/s) or in travel (m) cannot be told from
TRADES_WITH = {
    "m/s": ("suspension_damping_n_s_per_m", "damping_per_mass", "damping_ratio"),
    "m": ("suspension_stiffness_n_per_m", "stiffness_per_mass", "natural_frequency_hz", "damping_ratio"),
}
# no two sensors have gains more equal than this, and a gain error passes for a ground spring
EQUAL_GAINS = 0.001
NEGLIGIBLE_GROUND = 0.002


def identify_study(
    study: Study,
    *,
    method: str = "classical",
    law: str | None = None,
    band_hz: tuple[float, float] = BAND_HZ,
    high_pass_hz: float = HIGH_PASS_HZ,
    ground: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Identify mass, springs, damping and law of a suspension from runs at known mass changes.

    `classical` is the chain of Iwaniec & Uhl (2007) with every step mended: sound integration, the complex equation,
    noise on both channels, all runs in one least-squares problem. `model` starts there and fits the suspension that the
    measured spindle acceleration drives: nothing is integrated, so a law of the travel keeps its slow motion. `paper`
    gives what the printed formula makes of the strongest matched peaks; it has no intervals.

    Args:
        study: the runs.
        method: "classical", "model" or "paper".
        law: a law to fit (`opid.mechanics.laws.LAWS`, sums joined by "+"); searched when left out.
        band_hz: lines used by direct parameters and added mass, Hz.
        high_pass_hz: corner of the integration that gives the motion inside the law, Hz.
        ground: whether a ground spring K3 is fitted (else it is 0).
        progress: called with the name of each step as it begins.

    Returns:
        The identification; where the data do not determine the absolute scale, `not_determined` says why and the
        ratios to the mass are given.

    Raises:
        InputError: an unknown method or law, or runs that are no runs of a suspension.
    """
    if method not in METHODS:
        raise InputError(f"there is no method {method!r}: {nearest(method, METHODS)}")
    evidence = classical_chain(
        study, law=law, band_hz=band_hz, high_pass_hz=high_pass_hz, ground=ground, progress=progress
    )
    settings = {
        "study": study.source.name if study.source else None,
        "sprung": study.sprung,
        "unsprung": study.unsprung,
        "band_hz": [evidence.joint.band_hz[0], evidence.joint.band_hz[1]],
        "high_pass_hz": high_pass_hz,
        "law": law or "searched",
        "ground": ground,
    }
    if method == "paper":
        return _conclude_paper(study, evidence, settings)
    if method == "model":
        evidence = model_chain(study, evidence, search=law is None, ground=ground, progress=progress)
    return _conclude(method, study, evidence, settings)


def _conclude(method: str, study: Study, evidence: Evidence, settings: dict[str, Any]) -> Identification:
    joint, added = evidence.joint, evidence.added_mass
    unexplained = unexplained_noise(evidence)
    reason = evidence.not_determined
    if unexplained > UNEXPLAINED_REFUSED:
        return _refuse(method, study, evidence, settings)
    # what the model lacks is no noise: the intervals grow with it
    widening = max(1.0, unexplained / UNEXPLAINED_DOUBTED)
    gain = gain_like_share(evidence)
    ratios = _ratios(joint.value, joint.covariance * widening**2, joint.names, gain)
    if added is None:
        law, law_std, parameters = joint.law, joint.std * widening, {name: Estimate() for name in PARAMETERS}
        law_std = np.array([law_std[joint.names.index(f"law[{i}]")] for i in range(law.vector.size)])
        stiffness, damping = joint["stiffness_per_mass"], joint["damping_per_mass"]
    else:
        law, law_std, parameters = added.law, added.std[4:] * widening, _parameters(added, widening, gain)
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
        diagnostics=_diagnostics(evidence, settings),
        warnings=tuple(_warnings(evidence, parameters)),
        not_determined=reason,
        evidence=evidence,
    )
    return _withheld(result)


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
        diagnostics=_diagnostics(evidence, settings),
        warnings=tuple(_warnings(evidence, parameters)),
        not_determined=reason,
        evidence=evidence,
    )


def _parameters(added: AddedMass, widening: float, gain: float) -> dict[str, Estimate]:
    """Absolute parameters with intervals: widened, and with what a gain error can do to them."""
    std = added.std * widening
    # the same gain error that would explain the ground spring moved stiffness and damping by as much
    std[1:3] = np.hypot(std[1:3], gain * np.abs(added.value[1:3]))
    std[3] = np.hypot(std[3], max(EQUAL_GAINS, gain) * added["suspension_stiffness_n_per_m"])
    parameters = {name: Estimate.normal(added[name], std[i]) for i, name in enumerate(PARAMETERS)}
    if "ground_stiffness_per_mass" not in added.fit.names:
        parameters["ground_stiffness_n_per_m"] = Estimate(0.0)
    # the mass is 1/mu: its interval is the image of that of mu, longer upwards
    mu, mu_std = added.fit["inverse_mass"], added.fit.std[added.fit.names.index("inverse_mass")] * widening
    if mu > 1.96 * mu_std:
        interval = (float(1 / (mu + 1.96 * mu_std)), float(1 / (mu - 1.96 * mu_std)))
        parameters["sprung_mass_kg"] = Estimate(1 / mu, float(std[0]), interval)
    return parameters


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
        diagnostics=_diagnostics(evidence, settings),
        warnings=tuple(warnings),
        not_determined=reason,
        evidence=evidence,
    )


def unexplained_noise(evidence: Evidence) -> float:
    """Return the noise that would explain the residual of the joint fit over the sensors' own noise floor.

    Args:
        evidence: of `classical_chain`.
    """
    return evidence.joint.noise_m_per_s2 / max(evidence.noise_floor, 1e-12)


def gain_like_share(evidence: Evidence) -> float:
    """Return |K3|/K2 where a gain error is the likelier reason for it than a spring to the ground, else 0.

    One gain off by e turns the equation of a free mass into one with K3 of about -e K2, and K2 off by as much.

    Args:
        evidence: of `classical_chain`.
    """
    joint = evidence.joint
    if "ground_stiffness_per_mass" not in joint.names:
        return 0.0
    ground, std = joint["ground_stiffness_per_mass"], joint.std[joint.names.index("ground_stiffness_per_mass")]
    share = abs(ground / joint["stiffness_per_mass"])
    return share if abs(ground) > 3 * std and NEGLIGIBLE_GROUND < share < GAIN_LIKE else 0.0


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


def _diagnostics(evidence: Evidence, settings: dict[str, Any]) -> dict[str, Any]:
    step = chosen(evidence.ladder)
    return {
        "settings": settings,
        "unexplained_noise_m_per_s2": evidence.joint.noise_m_per_s2,
        "sensor_noise_floor_m_per_s2": evidence.noise_floor,
        "unexplained_over_floor": unexplained_noise(evidence),
        "n_lines": [int(frequency.size) for frequency in evidence.joint.frequency_hz],
        "static_transmissibility_read_from_lines": evidence.mean_static_transmissibility,
        "law_candidates": sorted(
            {term for rung in evidence.ladder for term in rung.law_name.split("+") if term != "linear"}
        ),
        "law_ladder": [
            {
                "law": rung.law_name,
                "bic": rung.fit.bic,
                "unexplained_noise_m_per_s2": rung.fit.noise_m_per_s2,
                "kept": rung.kept,
                "chosen": rung is step,
            }
            for rung in evidence.ladder
        ],
        "peak_pairs": [_pair_diagnostics(pair) for pair in evidence.pairs],
        "runs": [_run_diagnostics(run) for run in evidence.runs],
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
        "findings": [f"{finding.channel}: {finding.message}" for finding in run.findings],
    }


def _warnings(evidence: Evidence, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    for run in evidence.runs:
        for finding in run.findings:
            yield f"run {run.name!r}, {finding.channel!r}: {finding.message}"
    unexplained = unexplained_noise(evidence)
    if unexplained > UNEXPLAINED_DOUBTED:
        yield (
            f"the model explains the runs only to {unexplained:.1f} times the sensor noise: the law lacks a term, the "
            "slow motion below the high-pass matters, or a sensor is at fault; the intervals are widened by "
            f"{unexplained / UNEXPLAINED_DOUBTED:.1f}"
        )
    elif unexplained > UNEXPLAINED_NOTED:
        yield (
            f"the residual is {unexplained:.1f} times the sensor noise: most of it is the slow motion that the "
            "integration cannot give to the law"
        )
    averages = min(run.T.spectra.n_averages for run in evidence.runs)
    if averages < FEW_AVERAGES:
        yield (
            f"each transmissibility rests on {averages:.1f} independent averages: its coherence is near 1 by "
            "construction and its peaks are chance (the parameters do not come from it)"
        )
    yield from _ground_warning(evidence, parameters)
    yield from _mass_change_warning(evidence, parameters["sprung_mass_kg"])
    yield from _straight_warnings(evidence)


def _ground_warning(evidence: Evidence, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    ground, stiffness = (parameters[name] for name in ("ground_stiffness_n_per_m", "suspension_stiffness_n_per_m"))
    share = gain_like_share(evidence)
    if share:
        sign = np.sign(evidence.joint["ground_stiffness_per_mass"])
        yield (
            f"the ground spring is {100 * sign * share:.1f} % of the suspension: a gain error of about "
            f"{100 * share:.1f} % between the two sensors does that (AC coupling with different corners too), so the "
            "intervals of stiffness and damping hold it"
        )
    elif (
        ground.value is not None
        and stiffness.value is not None
        and abs(ground.value) > NEGLIGIBLE_GROUND * abs(stiffness.value)
        and not ground.holds(0.0)
    ):
        yield (
            f"the ground spring K3 = {ground.value:.3g} N/m differs from zero, yet a free aircraft has none: sensors "
            "whose AC-coupling corners differ, a gain error, or friction outside the law imitate it; the intervals "
            "hold for equal gains, and 1 % of gain difference moves stiffness and damping by about 1 %"
        )


def _mass_change_warning(evidence: Evidence, mass: Estimate) -> Iterator[str]:
    if mass.value is None or mass.std is None:
        return
    changes = [run.mass_change_kg for run in evidence.runs]
    share = (max(changes) - min(changes)) / mass.value
    if mass.std / mass.value > 0.02:
        yield (
            f"the mass change is {100 * share:.0f} % of the mass, which multiplies every relative error by about "
            f"{1 / share:.0f}: doubling it would halve the interval of the mass"
        )


@dataclass(frozen=True)
class _StraightTerm:
    """A term of the law that the motion did not bend: it trades with a linear one."""

    name: str
    unit: str
    scale: float
    motion_rms: float


def _straight_terms(evidence: Evidence) -> list[_StraightTerm]:
    """Find the terms whose scale lies beyond twice the rms motion: stiffness or damping by another name."""
    found = []
    for term in evidence.joint.law.terms:
        for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True):
            if parameter.role != "scale":
                continue
            motions = [r.surface.velocity if parameter.unit == "m/s" else r.surface.travel for r in evidence.runs]
            rms = max(float(motion.std()) for motion in motions)
            if value > 2 * rms:
                found.append(_StraightTerm(term.name, parameter.unit, value, rms))
    return found


def _straight_warnings(evidence: Evidence) -> Iterator[str]:
    for term in _straight_terms(evidence):
        partner = "damping" if term.unit == "m/s" else "stiffness"
        yield (
            f"{term.name} is nearly straight over the visited range (scale {term.scale:.3g} {term.unit}, motion "
            f"{term.motion_rms:.3g} {term.unit} rms) and cannot be told from {partner}: only amplitude over scale is "
            f"determined, and the intervals of both are withheld"
        )


def _withheld(result: Identification) -> Identification:
    """Take away the intervals of what trades with a straight term, and keep the values."""
    parameters, ratios, law = dict(result.parameters), dict(result.ratios), dict(result.law_estimates)
    for term in _straight_terms(result.evidence):
        for name in TRADES_WITH[term.unit]:
            table = parameters if name in parameters else ratios
            table[name] = Estimate(table[name].value)
        law[term.name] = {name: Estimate(each.value) for name, each in law.get(term.name, {}).items()}
    return replace(result, parameters=parameters, ratios=ratios, law_estimates=law)
