"""The fit of the mode under test with the law that simulation gives: coefficients, frequency, damping, force curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from opid.estimate import Estimate
from opid.modal.forced.mode_fit import ForceCurve, ModeFit, warn_of_fit
from opid.modal.forced.restoring_fit import linearised
from opid.modal.forced.simulated_fit import FittedForm, differentiate
from opid.modal.forced.system import ModeTerms, OwnValues
from opid.modal.joint_estimates import ABSENT, JointEstimates
from opid.modal.power_laws import read_linear
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


def estimate_joint(terms: ModeTerms, estimates: Sequence[Estimate]) -> JointEstimates:
    """Return what was estimated of the joint of a mode, from the estimates of all its terms."""
    friction, memory = terms.split(estimates)[2:]
    return JointEstimates(friction[0] if friction else ABSENT, terms.memory, memory)


def update_mode_fit(
    fit: ModeFit, found: FittedForm, estimates: list[Estimate], *, misfit: float, mass: Estimate
) -> ModeFit:
    """Return the fit of the mode under test with the law by simulation, its misfit over noise and the mass it shows."""
    terms, values = found.form.own[fit.mode], found.values.own[fit.mode]
    explained = {mode for each in found.values.couplings for mode in each.modes}
    k, c, amplitude = terms.powers.k, terms.powers.c, fit.stiffness_curve.position
    stiffness, damping_powers = terms.split(estimates)[:2]
    omega = _find_natural(fit, terms, values)
    viscous = 4 * np.pi * fit.damping_ratio * fit.frequency_hz
    damping = viscous + linearised(c, values.damping.values(), omega * amplitude)
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = damping + np.where(amplitude > 0, values.joint.find_damping(amplitude) / omega, 0.0)
    curves = _make_curves(fit, terms, values, found.covariance[: terms.size, : terms.size])
    updated = replace(
        fit,
        stiffness_order=terms.powers.orders[0],
        damping_order=terms.powers.orders[1],
        free_linear=1 in k,
        residual_fraction=float(found.missed[0]),
        misfit=misfit,
        modal_mass=mass,
        stiffness=stiffness,
        damping=damping_powers,
        joint_estimates=estimate_joint(terms, estimates),
        stiffness_curve=curves[0],
        damping_curve=curves[1],
        frequency_at_hz=omega / (2 * np.pi),
        damping_at=damping / np.maximum(2 * omega, 1e-300),
        interactions=tuple(each for each in fit.interactions if each.other not in explained),
    )
    outdated = {*warn_of_fit(fit), *(each.sentence for each in fit.interactions if each.other in explained)}
    kept = [text for text in fit.warnings if text not in outdated]
    return replace(updated, warnings=(*kept, *warn_of_fit(updated)))


def _find_natural(fit: ModeFit, terms: ModeTerms, values: OwnValues) -> FloatArray:
    """Return the natural frequency of the mode under test at the amplitudes of its stiffness curve, rad/s."""
    amplitude = fit.stiffness_curve.position
    square = (2 * np.pi * fit.frequency_hz) ** 2 + linearised(terms.powers.k, values.stiffness.values(), amplitude)
    return np.sqrt(np.maximum(square - values.joint.find_softening(amplitude), 0.0))


def _make_curves(fit: ModeFit, terms: ModeTerms, values: OwnValues, covariance: FloatArray) -> list[ForceCurve]:
    """Return the nonlinear stiffness and damping forces, with bands by the covariance of the values of the mode."""
    amplitude = fit.stiffness_curve.position
    vector = np.array(values.flatten())
    pace = np.maximum(_find_natural(fit, terms, values), 2 * np.pi * MODAL.widest_band[0] * fit.frequency_hz)

    def stiffness_force(at: FloatArray, own: FloatArray) -> FloatArray:
        its = OwnValues.of(terms, own.tolist())
        powers = (value * at**power for power, value in its.stiffness.items() if power > 1)
        return sum(powers, -its.joint.find_slip_force(at))

    def damping_force(at: FloatArray, own: FloatArray) -> FloatArray:
        its = OwnValues.of(terms, own.tolist())
        powers = (value * at**power for power, value in its.damping.items() if power > 1)
        reached = at / np.interp(at, pace * amplitude, pace)
        return sum(powers, its.joint.find_loss_force(reached))

    curves = []
    for curve, force, corrected in (
        (fit.stiffness_curve, stiffness_force, values.stiffness.get(1, 0.0) - read_linear(fit.stiffness)),
        (fit.damping_curve, damping_force, values.damping.get(1, 0.0) - read_linear(fit.damping)),
    ):
        at = curve.position
        slopes = differentiate(lambda own, at=at, force=force: force(at, own), vector)  # type: ignore[misc]
        half = 1.96 * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
        middle = force(at, vector)
        linear = curve.linear + corrected * at
        curves.append(replace(curve, force=middle, low=middle - half, high=middle + half, linear=linear))
    return curves
