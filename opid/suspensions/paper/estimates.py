"""From a joint fit to parameters, ratios and laws with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws.law import LAWS, Law
from opid.signals.recording import FloatArray
from opid.suspensions.answer.refusals import ConfoundedTerm, straight_term
from opid.suspensions.paper.added_mass import AddedMass
from opid.suspensions.paper.direct_parameters import NAMES
from opid.suspensions.paper.joint_fit import JointFit
from opid.suspensions.paper.preparation import PreparedRun
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.result import GearParameters, GearRatios


def straight_terms(law: Law, runs: tuple[PreparedRun, ...], *, straight_above: float) -> list[ConfoundedTerm]:
    """Find the terms whose scale lies far beyond the motion.

    Args:
        law: the law.
        runs: with the motion.
        straight_above: the scale over the largest rms motion from which a term is straight.
    """
    found = []
    for term in law.terms:
        for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True):
            if parameter.role != "scale":
                continue
            motions = [run.surface.velocity if parameter.unit == "m/s" else run.surface.travel for run in runs]
            rms = max(float(motion.std()) for motion in motions)
            if value > straight_above * rms:
                found.append(straight_term("", term.name, parameter.unit, value, rms))
    return found


def gain_like_fraction(joint: JointFit, settings: PaperSettings) -> float:
    """Return |K3|/K2 where a gain error is the likelier reason for it than a spring to the ground, else 0.

    One gain off by e turns the equation of a free mass into one with K3 of about -e K2, and K2 off by as much.

    Args:
        joint: the joint fit of all runs.
        settings: with `negligible_ground` and `gain_like`.
    """
    name = "ground_stiffness_per_mass"
    if name not in joint.names:
        return 0.0
    ground, std = joint[name], joint.std[joint.names.index(name)]
    fraction = abs(ground / joint["stiffness_per_mass"])
    is_seen = abs(ground) > 3 * std
    return fraction if is_seen and settings.negligible_ground < fraction < settings.gain_like else 0.0


def parameters_of(added: AddedMass, *, gain: float, equal_gains: float) -> GearParameters:
    """Return the absolute parameters with intervals.

    Args:
        added: the scaled fit.
        gain: fraction by which a gain error may have moved stiffness and damping.
        equal_gains: no two gains are more equal than this.
    """
    std, mu = added.std.copy(), added.fit["inverse_mass"]
    # the same gain error that would explain the ground spring moved stiffness and damping by as much
    std[1:3] = np.hypot(std[1:3], gain * np.abs(added.value[1:3]))
    std[3] = np.hypot(std[3], max(equal_gains, gain) * added["suspension_stiffness_n_per_m"])
    parameters = GearParameters(*map(Estimate.normal, added.value[:4], std[:4]))
    if "ground_stiffness_per_mass" not in added.fit.names:
        parameters = replace(parameters, ground_stiffness_n_per_m=Estimate(0.0))
    # the mass is 1/mu: its interval is the image of that of mu, longer upwards
    mu_std = added.fit.std[added.fit.names.index("inverse_mass")]
    if mu > 1.96 * mu_std:
        interval = (float(1 / (mu + 1.96 * mu_std)), float(1 / (mu - 1.96 * mu_std)))
        parameters = replace(parameters, sprung_mass_kg=Estimate(1 / mu, float(std[0]), interval))
    return parameters


def ratios_of(
    value: FloatArray, covariance: FloatArray, names: tuple[str, ...], *, gain: float, equal_gains: float
) -> GearRatios:
    """Return ratios to the mass, natural frequency and damping ratio on a still wheel, by the delta method.

    Args:
        value: (n,) stiffness, damping and, if it was free, ground spring per mass first.
        covariance: (n, n).
        names: of the values.
        gain: fraction by which a gain error may have moved stiffness and damping.
        equal_gains: no two gains are more equal than this.
    """
    k, c = value[0], value[1]
    has_ground = NAMES[2] in names
    total = k + (value[2] if has_ground else 0.0)
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    ratios = GearRatios(
        Estimate.normal(k, np.hypot(std[0], gain * k)),
        Estimate.normal(c, np.hypot(std[1], gain * c)),
        Estimate.normal(value[2], np.hypot(std[2], max(equal_gains, gain) * k)) if has_ground else Estimate(0.0),
    )
    if total <= 0:
        return ratios
    omega = np.sqrt(total)
    gradients = np.zeros((2, len(names)))
    gradients[:, 0] = 1 / (4 * np.pi * omega), -c / (4 * omega**3)
    gradients[1, 1] = 1 / (2 * omega)
    if has_ground:
        gradients[:, 2] = gradients[:, 0]
    own = np.sqrt(np.maximum(np.diag(gradients @ covariance @ gradients.T), 0))
    frequency, zeta = omega / (2 * np.pi), c / (2 * omega)
    return replace(
        ratios,
        natural_frequency_hz=Estimate.normal(frequency, np.hypot(own[0], gain / 2 * frequency)),
        damping_ratio=Estimate.normal(zeta, np.hypot(own[1], gain * zeta)),
    )


def law_estimates_of(law: Law, std: FloatArray) -> Mapping[str, Mapping[str, Estimate]]:
    """Return {kind: {parameter: Estimate}} of a law.

    Args:
        law: the law.
        std: (n_parameters,) standard deviations of `law.vector`.
    """
    spread = iter(std.tolist())
    return {
        term.name: {
            parameter.name: Estimate.normal(value, next(spread))
            for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True)
        }
        for term in law.terms
    }
