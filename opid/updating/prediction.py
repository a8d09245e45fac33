"""Predicted backbones with their bands: parameters and errors drawn together (Song et al. 2021, section 2.3)."""

from __future__ import annotations

import numpy as np

from opid.errors import NotDeterminedError
from opid.mechanics.backbones import family_evaluator
from opid.signals.recording import FloatArray
from opid.updating.curve_noise import draw_errors
from opid.updating.likelihood import BackboneData, ModeData, curves_of
from opid.updating.measured import MeasuredBackbone
from opid.updating.result import BackboneBand, ClassPosterior


def predict(
    data: BackboneData,
    posterior: ClassPosterior,
    measured: tuple[MeasuredBackbone, ...],
    *,
    rng: np.random.Generator,
    n_draws: int = 200,
    n_amplitudes: int = 40,
) -> tuple[BackboneBand, ...]:
    """Return the 95 % band of each mode for one more point of one more curve (Song eq. 18).

    lambda = lambda(theta) + e - r_m with theta drawn from the posterior. In the paper's forms e is drawn from
    N(0, sigma_lambda^2) and r_m is the mean of the curves; in the recommended one offset and noise of a further curve
    are drawn from what the measured ones tell.

    Args:
        data: the backbones, from `backbone_data`.
        posterior: of the class that predicts.
        measured: the same backbones, for the coverage.
        rng: source of chance.
        n_draws: curves that are drawn.
        n_amplitudes: points of each band, between the smallest and the largest measured amplitude.

    Raises:
        NotDeterminedError: no draw has a backbone.
    """
    drawn = posterior.samples[rng.integers(len(posterior.samples), size=n_draws)]
    return tuple(_band(data, mode, posterior, measured, drawn, n_amplitudes, rng) for mode in data.modes)


def _band(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    measured: tuple[MeasuredBackbone, ...],
    drawn: FloatArray,
    n_amplitudes: int,
    rng: np.random.Generator,
) -> BackboneBand:
    sensor = mode.parts[0][0]
    curves = [one for one in measured if one.mode == mode.mode and sensor in one.sensors]
    seen = [np.abs(one.amplitude[:, one.sensors.index(sensor)]) for one in curves]
    amplitude = np.linspace(min(each.min() for each in seen), max(each.max() for each in seen), n_amplitudes)
    solve = family_evaluator(
        data.system, posterior.model_class.kinds, mode=mode.mode, sensor=sensor, amplitude=amplitude,
        harmonics=data.harmonics,
    )  # fmt: skip
    found = solve(posterior.model_class.coefficients(drawn))
    ok = found.converged.all(axis=1)
    if not ok.any():
        raise NotDeterminedError(
            f"no draw of {posterior.model_class.name!r} has a backbone of mode {mode.mode} up to {amplitude[-1]:.3g} m"
        )
    eigenvalue = found.eigenvalue[ok] + _errors(data, mode, posterior, drawn[ok], found.eigenvalue[ok], rng)
    frequency = np.sqrt(np.maximum(eigenvalue, 0.0)) / (2 * np.pi)
    low, middle, high = np.quantile(frequency, [0.025, 0.5, 0.975], axis=0)
    inside = [
        (one.frequency_hz >= np.interp(a, amplitude, low)) & (one.frequency_hz <= np.interp(a, amplitude, high))
        for one, a in zip(curves, seen, strict=True)
    ]
    return BackboneBand(mode.mode, sensor, amplitude, middle, low, high, float(np.concatenate(inside).mean()))


def _errors(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    drawn: FloatArray,
    eigenvalue: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """(n, n_amplitudes) of lambda: what the measured curves show beside the model, drawn anew."""
    if mode.frequency_noise is not None:
        at_nodes, _, _ = curves_of(data, mode, posterior.model_class)(drawn)
        growth = eigenvalue / mode.linear - 1
        return mode.linear * draw_errors(mode.frequency_noise, at_nodes[..., None] / mode.linear, growth, rng)
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = float(np.mean(mode.linear - mode.eigenvalue[first]))
    return data.noise.weight * mode.cov * eigenvalue * rng.standard_normal(eigenvalue.shape) - r_m
