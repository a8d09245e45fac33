"""The effective damping of each mode by a class, and by the measured force."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ModeData
from opid.updating.likelihood.curves import make_solver
from opid.updating.likelihood.force import find_stiffness
from opid.updating.measured import MeasuredBackbone
from opid.updating.prediction import N_AMPLITUDES, find_band
from opid.updating.result import ClassPosterior, DampingBand
from opid.updating.settings import UPDATING


def predict_damping(
    data: BackboneData, posterior: ClassPosterior, measured: tuple[MeasuredBackbone, ...], *, rng: np.random.Generator
) -> Iterator[DampingBand]:
    """Yield the effective damping ratio of each mode whose force is known, with its 95 % band.

    The band is that of the laws and damping ratios; the errors of the force and of the energy of the model widen it as
    far as they leave these open. It is nan where the model converges for less than half of the draws, and a mode in
    which it converges nowhere has none.

    Args:
        data: the backbones with their force.
        posterior: posterior of the class that predicts.
        measured: the same backbones.
        rng: source of chance.
    """
    theta = posterior.samples[rng.integers(len(posterior.samples), size=UPDATING.n_predicted)]
    for mode in data.modes:
        driven = [one for one in measured if one.mode == mode.mode and one.force_n is not None]
        band = _make_band(data, mode, posterior, driven, theta) if driven else None
        if band is not None:
            yield band


def _make_band(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, driven: list[MeasuredBackbone], theta: FloatArray
) -> DampingBand | None:
    sensor = driven[0].controlled_sensor
    seen = np.concatenate([np.abs(one.amplitude[:, one.sensors.index(sensor)]) for one in driven])
    amplitude = np.linspace(seen.min(), seen.max(), N_AMPLITUDES)
    solve = make_solver(data, posterior.model_class, mode, sensor, amplitude)
    lost, energy = solve.find_loss(theta, solve(theta))
    band = find_band(lost / (4 * np.pi * energy))
    # The kinetic energy over A^2 is smooth, so that it can be interpolated to the measured points.
    smooth = find_band(energy)[1] / amplitude**2
    there = np.isfinite(smooth)
    if not there.any():
        return None
    work = np.pi * np.concatenate([find_stiffness(one, sensor) for one in driven])
    ratio = work / (4 * np.pi * np.interp(seen, amplitude[there], smooth[there]))
    return DampingBand(mode.mode, sensor, amplitude, band[1], band[0], band[2], seen, ratio)
