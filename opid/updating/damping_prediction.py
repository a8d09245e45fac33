"""The effective damping of each mode by a class, and by the measured force."""

from __future__ import annotations

import numpy as np

from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ModeData
from opid.updating.likelihood.curves import make_solver
from opid.updating.likelihood.force import find_stiffness
from opid.updating.measured import MeasuredBackbone
from opid.updating.result import ClassPosterior, DampingBand

N_AMPLITUDES = 40  # points of each band
N_DRAWS = 200  # draws of the posterior


def predict_damping(
    data: BackboneData, posterior: ClassPosterior, measured: tuple[MeasuredBackbone, ...], *, rng: np.random.Generator
) -> tuple[DampingBand, ...]:
    """Return the effective damping ratio of each mode whose force is known, with its 95 % band.

    The band is that of the laws and damping ratios; the errors of the force and of the energy of the model widen it as
    far as they leave these open.

    Args:
        data: the backbones with their force.
        posterior: posterior of the class that predicts.
        measured: the same backbones.
        rng: source of chance.
    """
    theta = posterior.samples[rng.integers(len(posterior.samples), size=N_DRAWS)]
    found = []
    for mode in data.modes:
        curves = [one for one in measured if one.mode == mode.mode and one.force_n is not None]
        if curves:
            found.append(_make_band(data, mode, posterior, curves, theta))
    return tuple(found)


def _make_band(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, curves: list[MeasuredBackbone], theta: FloatArray
) -> DampingBand:
    sensor = curves[0].controlled_sensor
    own = [one for one in curves if one.controlled_sensor == sensor]
    seen = np.concatenate([one.controlled_amplitude for one in own])
    amplitude = np.linspace(seen.min(), seen.max(), N_AMPLITUDES)
    solve = make_solver(data, posterior.model_class, mode, sensor, amplitude)
    lost, energy = solve.find_loss(theta, solve(theta))
    low, middle, high = np.nanquantile(lost / (4 * np.pi * energy), [0.025, 0.5, 0.975], axis=0)
    # The kinetic energy over A^2 is smooth, so that it can be interpolated to the measured points.
    at_best = solve(posterior.best[np.newaxis])
    smooth = solve.find_loss(posterior.best[np.newaxis], at_best)[1][0] / amplitude**2
    there = np.isfinite(smooth)
    work = np.pi * np.concatenate([find_stiffness(one) for one in own])
    ratio = work / (4 * np.pi * np.interp(seen, amplitude[there], smooth[there]))
    return DampingBand(mode.mode, sensor, amplitude, middle, low, high, seen, ratio)
