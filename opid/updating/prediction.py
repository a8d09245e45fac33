"""Predicted backbones with their bands, from draws of parameters and errors (Song et al. 2021, section 2.3)."""

from __future__ import annotations

import numpy as np

from opid.errors import NotDeterminedError
from opid.mechanics.backbones.family import family_evaluator
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import curves_of, named_points, without_interactions
from opid.updating.likelihood.curves import BackboneData, ModeData
from opid.updating.likelihood.noise import draw_errors
from opid.updating.measured import MeasuredBackbone
from opid.updating.result import BackboneBand, ClassPosterior

N_AMPLITUDES = 40  # points of each band


def predict(
    data: BackboneData, posterior: ClassPosterior, measured: tuple[MeasuredBackbone, ...], *, rng: np.random.Generator
) -> tuple[BackboneBand, ...]:
    """Return the 95 % band of each mode for one more point of one more curve (Song eq. 18).

    lambda = lambda(theta) + e - r_m with theta drawn from the posterior. In the paper's forms e is drawn from
    N(0, sigma_lambda^2) and r_m is the mean of the curves. In the recommended form offset and noise of a further curve
    are drawn from their posterior given the measured ones. The band is nan where the model converges for less than half
    of the draws.

    Args:
        data: the backbones, from `backbone_data`.
        posterior: of the class that predicts.
        measured: the same backbones, for the coverage.
        rng: source of chance.

    Raises:
        NotDeterminedError: no mode has a band anywhere.
    """
    theta = posterior.samples[rng.integers(len(posterior.samples), size=200)]
    bands = tuple(_band(data, mode, posterior, measured, theta, rng) for mode in data.modes)
    if not any(np.isfinite(band.frequency_hz).any() for band in bands):
        every = np.ones(N_AMPLITUDES, dtype=bool)
        where = " or ".join(f"mode {b.mode} at {named_points(b.amplitude, every, b.sensor)}" for b in bands)
        raise NotDeterminedError(
            f"most draws of {posterior.model_class.name!r} have no backbone of {where}: take fewer harmonics, or "
            "smaller amplitudes"
        )
    return bands


def _band(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    measured: tuple[MeasuredBackbone, ...],
    theta: FloatArray,
    rng: np.random.Generator,
) -> BackboneBand:
    sensor = mode.parts[0][0]
    curves = [one for one in measured if one.mode == mode.mode and sensor in one.sensors]
    seen = [np.abs(one.amplitude[:, one.sensors.index(sensor)]) for one in curves]
    amplitude = np.linspace(min(each.min() for each in seen), max(each.max() for each in seen), N_AMPLITUDES)
    solve = family_evaluator(
        without_interactions(data, mode), posterior.model_class.kinds, mode=mode.mode, sensor=sensor,
        amplitude=amplitude, harmonics=data.harmonics,
    )  # fmt: skip
    found = solve(posterior.model_class.coefficients(theta))
    errors = _errors(data, mode, posterior, theta, found.eigenvalue, rng)
    frequency = np.sqrt(np.maximum(found.eigenvalue + errors, 0.0)) / (2 * np.pi)
    there = np.isfinite(frequency)
    band = np.full((3, N_AMPLITUDES), np.nan)
    for index in np.flatnonzero(there.mean(axis=0) >= 0.5):
        band[:, index] = np.quantile(frequency[there[:, index], index], [0.025, 0.5, 0.975])
    low, middle, high = band
    hz = np.concatenate([one.frequency_hz for one in curves])
    ends = [np.interp(np.concatenate(seen), amplitude, end) for end in (low, high)]
    inside = ((hz >= ends[0]) & (hz <= ends[1]))[np.isfinite(ends[0])]
    coverage = float(inside.mean()) if inside.size else float("nan")
    return BackboneBand(mode.mode, sensor, amplitude, middle, low, high, coverage)


def _errors(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    theta: FloatArray,
    eigenvalue: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Draw errors of lambda for a further curve, (n, N_AMPLITUDES); nan without a curve of the model."""
    if mode.frequency_noise is not None:
        at_nodes, _, _, lost = curves_of(data, mode, posterior.model_class)(theta)
        growth = _without_gaps(eigenvalue, mode.linear) / mode.linear - 1
        errors = mode.linear * draw_errors(mode.frequency_noise, at_nodes[..., None] / mode.linear, growth, rng)
        return np.where(lost[:, None], np.nan, errors)
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = float(np.mean(mode.linear - mode.eigenvalue[first]))
    return data.noise.weight * mode.cov * eigenvalue * rng.standard_normal(eigenvalue.shape) - r_m


def _without_gaps(eigenvalue: FloatArray, otherwise: float) -> FloatArray:
    """Return rows with gaps interpolated, for the errors of a curve depend on all of it."""
    filled, index = eigenvalue.copy(), np.arange(eigenvalue.shape[1])
    for row in np.flatnonzero(np.isnan(eigenvalue).any(axis=1)):
        there = np.isfinite(eigenvalue[row])
        filled[row] = np.interp(index, index[there], eigenvalue[row, there]) if there.any() else otherwise
    return filled
