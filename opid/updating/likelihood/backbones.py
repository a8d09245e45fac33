"""The likelihood of measured backbones given the coefficients of a law, in the paper's forms and a recommended one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import NotDeterminedError
from opid.signals.recording import FloatArray
from opid.updating.data.curve_noise import log_marginal
from opid.updating.data.curves import FORMS, BackboneData, Form, ModeData, backbone_data, coefficient_of_variation
from opid.updating.data.noise_settings import NoiseSettings
from opid.updating.likelihood.model_curves import curves_of
from opid.updating.model_class import ModelClass

__all__ = [
    "FORMS",
    "BackboneData",
    "Form",
    "ModeData",
    "NoiseSettings",
    "backbone_data",
    "coefficient_of_variation",
    "curves_of",
    "likelihood_function",
    "log_likelihood",
    "residuals",
]

Likelihood = Callable[[ArrayLike], tuple[FloatArray, int]]
"""theta (n, d) -> log p(D | theta) (n,), and how many points of the model did not converge."""


def likelihood_function(data: BackboneData, model_class: ModelClass) -> Likelihood:
    """Return theta (n, d) -> logarithm of p(D | theta), (n,), and how many points of the model did not converge.

    Every form carries its normalising constant (Song eq. 17; eq. 7 misprints it). Points of the model that did not
    converge are bridged from the others; a theta for which too many are missing (see `curves_of`) has the logarithm
    -inf.

    Args:
        data: from `backbone_data`, which names the form.
        model_class: the law.
    """
    models = [(mode, curves_of(data, mode, model_class)) for mode in data.modes]

    def likelihood(theta: ArrayLike) -> tuple[FloatArray, int]:
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        total, impossible, failed = np.zeros(len(rows)), np.zeros(len(rows), dtype=bool), 0
        for mode, curves in models:
            eigenvalue, shapes, missing, lost = curves(rows)
            if data.form == "recommended":
                total += _recommended(mode, eigenvalue, shapes)
            else:
                total += _papers(data, mode, eigenvalue, shapes)
            impossible |= lost
            failed += int(missing.sum())
        return np.where(impossible, -np.inf, total), failed

    return likelihood


def log_likelihood(data: BackboneData, model_class: ModelClass, theta: ArrayLike) -> FloatArray:
    """Return the logarithm of p(D | theta), (n,); see `likelihood_function`, which is quicker when called often.

    Args:
        data: from `backbone_data`.
        model_class: the law.
        theta: (n, n_parameters).
    """
    return likelihood_function(data, model_class)(theta)[0]


def _recommended(mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    if mode.frequency_noise is None:
        raise NotDeterminedError("the backbones were not prepared for the recommended form: call backbone_data with it")
    total = log_marginal(mode.frequency_noise, eigenvalue[..., None] / mode.linear)
    if mode.shape_noise is not None:
        total = total + log_marginal(mode.shape_noise, shapes[..., mode.free])
    return total


def residuals(mode: ModeData, eigenvalue: FloatArray) -> FloatArray:
    """Return e_lambda of every point with r_m of its curve, (n, n_points) (Song eq. 10).

    Args:
        mode: its data.
        eigenvalue: (n, n_nodes) of the model.
    """
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = (mode.linear - mode.eigenvalue[first])[mode.curve]
    return mode.eigenvalue - eigenvalue @ mode.between.T + r_m


def _papers(data: BackboneData, mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    """Eqs. (12) and (17) of one mode, with one of the three ways to add points up."""
    noise, n_sensors = data.noise, mode.rows.size
    sigma = noise.weight * mode.cov * mode.eigenvalue
    factor = noise.shape_factor if noise.shape_factor is not None else np.sqrt(n_sensors)
    sigma_phi = factor * noise.weight * mode.cov
    score = residuals(mode, eigenvalue) / sigma
    of_curve = np.eye(mode.curve[-1] + 1)[mode.curve]
    share = of_curve / (1.0 if data.form == "independent" else of_curve.sum(axis=0))
    misfit = ((score @ share) ** 2 if data.form == "literal" else score**2 @ share).sum(axis=1)
    n_errors, log_sigmas = sigma.size, np.log(sigma).sum()
    if noise.shapes and n_sensors > 1:
        misfit = misfit + (_one_less_mac(mode, shapes) @ share).sum(axis=1) / sigma_phi**2
        # a shape of unit length has one entry less to choose than sensors
        n_free = len(mode.shapes) * (n_sensors - 1)
        n_errors, log_sigmas = n_errors + n_free, log_sigmas + n_free * np.log(sigma_phi)
    return -0.5 * n_errors * np.log(2 * np.pi) - log_sigmas - 0.5 * misfit


def _one_less_mac(mode: ModeData, shapes: FloatArray) -> FloatArray:
    """e_phi^T e_phi of every point, which is 1 - MAC exactly (Song eq. 11)."""
    model = np.einsum("jk,nks->njs", mode.between, shapes, optimize=True)
    return 1 - np.einsum("njs,js->nj", model, mode.shapes) ** 2 / np.einsum("njs,njs->nj", model, model)
