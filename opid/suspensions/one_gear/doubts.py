"""What to doubt about an answer, and how strongly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws import LAWS
from opid.suspensions.one_gear.model_evidence import ModelEvidence
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.paper.classical import LEAST_NOISE, Evidence

# the model explains the runs down to the sensors' noise up to here; above, what it lacks rules the answer
UNEXPLAINED_NOTED = 1.5
UNEXPLAINED_DOUBTED = 3.0
UNEXPLAINED_REFUSED = 20.0
# the driven model is refused where it leaves more than this share of the airframe's motion
SHARE_REFUSED = 0.25
FEW_AVERAGES = 4
LOOSELY_KNOWN = 0.2
# runs of one mass whose natural frequencies differ by more than this share have not one mass
UNLIKE = 0.01
# a ground spring below this share of K2 is what a gain error of a per cent or two looks like
GAIN_LIKE = 0.05
NEGLIGIBLE_GROUND = 0.002


def unexplained_noise(evidence: Evidence) -> float:
    """Return the noise that would explain the residual of the joint fit over the sensors' own noise floor.

    Args:
        evidence: of a chain.
    """
    if evidence.model is None:
        return evidence.joint.noise_m_per_s2 / max(evidence.noise_floor, 1e-12)
    fit: ModelFit = evidence.model.fit
    ratios = []
    for side, facts, level in zip((0, 1), (fit.sensors.unsprung, fit.sensors.sprung), fit.noise, strict=True):
        signals = [(run.unsprung, run.sprung)[side] for run in evidence.runs]
        floors = [
            max(run.noise_floor[side], LEAST_NOISE * float(signal.std()))
            for run, signal in zip(evidence.runs, signals, strict=True)
        ]
        known = facts.noise_m_per_s2 or float(np.sqrt(np.mean(np.square(floors))))
        ratios.append(level * float(np.sqrt(fit.variance)) / known)
    return max(ratios)


def unexplained_share(evidence: Evidence) -> float:
    """Return the noise that would explain the residual over the rms of the airframe acceleration.

    Args:
        evidence: of a chain.
    """
    signal = float(np.sqrt(np.mean([np.mean(run.sprung**2) for run in evidence.runs])))
    return evidence.joint.noise_m_per_s2 / max(signal, 1e-12)


def refused(evidence: Evidence) -> bool:
    """Return whether the model is too wrong for any number of it to be given.

    Args:
        evidence: of a chain.
    """
    if evidence.model is None:
        return unexplained_noise(evidence) > UNEXPLAINED_REFUSED
    if unlike_runs(evidence) or unexplained_noise(evidence) > UNEXPLAINED_REFUSED:
        return True
    return unexplained_noise(evidence) > UNEXPLAINED_DOUBTED and unexplained_share(evidence) > SHARE_REFUSED


def unlike_runs(evidence: Evidence) -> bool:
    """Return whether runs that are said to have one mass do not behave like that.

    Args:
        evidence: of a chain.
    """
    if len(evidence.runs) < 2 or len({run.mass_change_kg for run in evidence.runs}) > 1:
        return False
    frequencies = [run.spectral_fit.natural_frequency_hz for run in evidence.runs]
    return unexplained_noise(evidence) > UNEXPLAINED_DOUBTED and max(frequencies) > (1 + UNLIKE) * min(frequencies)


def widening(evidence: Evidence) -> float:
    """Return how much wider than the residual makes them the intervals have to be: what a model lacks is no noise.

    Args:
        evidence: of a chain.
    """
    return max(1.0, unexplained_noise(evidence) / UNEXPLAINED_DOUBTED)


def gain_like_share(evidence: Evidence) -> float:
    """Return |K3|/K2 where a gain error is the likelier reason for it than a spring to the ground, else 0.

    One gain off by e turns the equation of a free mass into one with K3 of about -e K2, and K2 off by as much.

    Args:
        evidence: of `classical_chain`.
    """
    joint = evidence.joint
    # the driven model weighs a gain error against the spring by itself
    if evidence.model is not None or "ground_stiffness_per_mass" not in joint.names:
        return 0.0
    ground, std = joint["ground_stiffness_per_mass"], joint.std[joint.names.index("ground_stiffness_per_mass")]
    share = abs(ground / joint["stiffness_per_mass"])
    return share if abs(ground) > 3 * std and NEGLIGIBLE_GROUND < share < GAIN_LIKE else 0.0


def doubts(evidence: Evidence, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield what to doubt about an answer, one sentence each.

    Args:
        evidence: what the answer rests on.
        parameters: the absolute parameters that were concluded.
    """
    for run in evidence.runs:
        for finding in run.findings:
            if finding.severity != "note":
                channel = f", {finding.channel!r}" if finding.channel else ""
                yield f"run {run.name!r}{channel}: {finding.message}"
    if evidence.model is None:
        yield from _classical_residual(evidence)
        averages = min(run.T.spectra.n_averages for run in evidence.runs)
        if averages < FEW_AVERAGES:
            yield (
                f"each transmissibility rests on {averages:.1f} independent averages: its coherence is near 1 by "
                "construction and its peaks are chance (the parameters do not come from it)"
            )
    else:
        yield from _model_residual(evidence)
        if not refused(evidence):
            yield from _demand_warnings(evidence.model)
    yield from _ground_warning(evidence, parameters)
    yield from _mass_change_warning(evidence, parameters["sprung_mass_kg"])
    yield from _straight_warnings(evidence)


def _model_residual(evidence: Evidence) -> Iterator[str]:
    model: ModelEvidence = evidence.model
    unexplained, found = unexplained_noise(evidence), model.whiteness
    if sum(model.mended_spikes):
        yield (
            f"{sum(model.mended_spikes)} spike(s) of one sample were mended ({model.mended_spikes[0]} on the unsprung, "
            f"{model.mended_spikes[1]} on the sprung channel)"
        )
    if found.white and unexplained < UNEXPLAINED_NOTED:
        return
    stands_out = (
        f"it stands out most from {found.band_hz[0]:.2g} to {found.band_hz[1]:.2g} Hz ({found.excess:.1f} times its "
        f"mean level): {_reason(evidence)}"
    )
    if unexplained > UNEXPLAINED_NOTED:
        wider = widening(evidence) > 1 and not refused(evidence)
        grown = f"; the intervals are widened by {widening(evidence):.1f}" if wider else ""
        yield f"the residual is {unexplained:.1f} times the noise of the sensors; {stands_out}{grown}"
    else:
        size = "as small as" if unexplained < 1.2 else f"{unexplained:.1f} times"
        yield f"the residual is {size} the noise of the sensors and not white; {stands_out}; the intervals allow for it"


def _reason(evidence: Evidence) -> str:
    """What usually leaves a residual in such a band."""
    joint, band = evidence.joint, evidence.model.whiteness.band_hz
    resonance_hz = float(np.sqrt(max(joint["stiffness_per_mass"] + joint["ground_stiffness_per_mass"], 0.0))) / (
        2 * np.pi
    )
    if band[1] < 0.6 * resonance_hz:
        return "AC coupling, a drifting sensor or a law of the travel outside the library make such slow motion"
    if band[0] > 2.5 * resonance_hz:
        return "a second resonance (a roll, pitch or bending mode, a loose bracket) or a lag between the channels"
    return (
        "a gear on a body that rolls or pitches is no gear alone, a law outside the library, memory in the strut or "
        "motion across the axis leave such a residual"
    )


def _demand_warnings(model: ModelEvidence) -> Iterator[str]:
    told: set[str] = set()
    for demand in model.demands:
        if demand.words in told:
            continue
        told.add(demand.words)
        values = ", ".join(
            f"{other.name} = {other.value:.4g} +- {other.std:.1g}"
            for other in model.demands
            if other.words == demand.words
        )
        also = f"; {' and '.join(demand.alike)} would explain the runs as well" if demand.alike else ""
        yield (
            f"the runs demand {demand.words}, which nobody stated ({values}): without it the error is "
            f"{1e3 * demand.error_before:.3g} instead of {1e3 * demand.error_after:.3g} mm/s^2{also}"
        )


def _classical_residual(evidence: Evidence) -> Iterator[str]:
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
            f"the ground spring K3 = {ground.value:.3g} N/m differs from zero, yet a free aircraft has none: "
            f"{_instead(evidence)}"
        )


def _instead(evidence: Evidence) -> str:
    """What else could be behind a ground spring."""
    if evidence.model is None:
        return (
            "sensors whose AC-coupling corners differ, a gain error, or friction outside the law imitate it; the "
            "intervals hold for equal gains, and 1 % of gain difference moves stiffness and damping by about 1 %"
        )
    imitations = (
        "; ".join(evidence.model.ground.sentences) or "none of the usual faults of the sensors looks much like it"
    )
    return f"faults of the sensors were tried beside it and explain the runs less well; for comparison, {imitations}"


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
class StraightTerm:
    """A term of the law that the motion did not bend: it trades with a linear one.

    Args:
        name: kind of the term.
        unit: of its scale, "m/s" or "m".
        scale: its inner scale.
        motion_rms: largest rms of that motion among the runs, in the same unit.
    """

    name: str
    unit: str
    scale: float
    motion_rms: float


def straight_terms(evidence: Evidence) -> list[StraightTerm]:
    """Find the terms whose scale lies beyond twice the rms motion: stiffness or damping by another name.

    Args:
        evidence: of a chain.
    """
    found = []
    for term in evidence.joint.law.terms:
        for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True):
            if parameter.role != "scale":
                continue
            motions = [r.surface.velocity if parameter.unit == "m/s" else r.surface.travel for r in evidence.runs]
            rms = max(float(motion.std()) for motion in motions)
            if value > 2 * rms and _loosely_known(evidence, term.name):
                found.append(StraightTerm(term.name, parameter.unit, value, rms))
    return found


def _loosely_known(evidence: Evidence, name: str) -> bool:
    """Whether the amplitude of a term is not known to a fifth, so that its interval is no straight line's either."""
    joint, place = evidence.joint, 0
    for term in joint.law.terms:
        if term.name == name:
            std = float(joint.std[joint.names.index(f"law[{place}]")])
            return evidence.model is None or std > LOOSELY_KNOWN * abs(term.amplitude)
        place += len(term.values)
    return False


def _straight_warnings(evidence: Evidence) -> Iterator[str]:
    for term in straight_terms(evidence):
        partner = "damping" if term.unit == "m/s" else "stiffness"
        yield (
            f"{term.name} is nearly straight over the visited range (scale {term.scale:.3g} {term.unit}, motion "
            f"{term.motion_rms:.3g} {term.unit} rms) and cannot be told from {partner}: only amplitude over scale is "
            f"determined, and the intervals of both are withheld"
        )
