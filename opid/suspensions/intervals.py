"""How well the parameters of a body are known: intervals that hold for a coloured residual, and absolute values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws import LAWS
from opid.signals.recording import FloatArray
from opid.suspensions.fit import BodyFit
from opid.suspensions.law_parameters import from_free
from opid.suspensions.one_gear.whiteness import LINES_A_CELL
from opid.suspensions.result import BODY_PARAMETERS, BODY_RATIOS


def honest_covariance(fit: BodyFit) -> FloatArray:
    """Return the covariance of the shared parameters, widened where the residual is coloured.

    The sandwich over cells of neighbouring lines; no parameter becomes better known than for a white residual.

    Args:
        fit: a fitted body.

    Returns:
        (n_shared, n_shared).
    """
    n, n_shared = fit.n_data, fit.model.n_shared
    scale = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    posterior = fit.covariance / np.outer(scale, scale)
    jacobian = fit.errors.jacobian * scale
    scores, first, n_cells = [], 0, 0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        n_lines = run.omega.size
        cell = np.tile(np.arange(n_lines) // LINES_A_CELL, line.size // n_lines)
        own = np.zeros((int(cell.max()) + 1, scale.size))
        for _ in range(2):
            rows = slice(first, first + line.size)
            np.add.at(own, cell, jacobian[rows] * fit.errors.stacked[rows, np.newaxis])
            first += line.size
        scores.append(own / fit.variance)
        n_cells += len(own)
    stacked = np.concatenate(scores)
    of_prior = jacobian[n:].T @ jacobian[n:]
    small = n_cells / max(n_cells - scale.size, 1)
    sandwich = posterior @ (small * (stacked.T @ stacked) + of_prior) @ posterior
    wider = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(posterior), 1.0))
    covariance = fit.covariance * np.outer(wider, wider)
    return covariance[:n_shared, :n_shared]


def body_estimates(fit: BodyFit, covariance: FloatArray) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Return absolute parameters and ratios of a rigid body; parameters are empty without the mass.

    Args:
        fit: of a rigid body.
        covariance: (n_shared, n_shared) of the shared parameters.
    """
    names, theta = fit.model.names, fit.theta
    place = {name: names.index(name) for name in ("x_cg_m", "y_cg_m", "rxx_m2", "ryy_m2")}
    x, y, rxx, ryy = (float(theta[place[name]]) for name in place)

    def along(value: float, gradient: Mapping[str, float]) -> Estimate:
        g = np.zeros(len(names))
        for name, slope in gradient.items():
            g[names.index(name)] = slope
        return Estimate.normal(value, float(np.sqrt(max(float(g @ covariance @ g), 0.0))))

    roll, pitch = rxx - y**2, ryy - x**2
    ratios = dict.fromkeys(BODY_RATIOS, Estimate())
    if roll > 0:
        radius = float(np.sqrt(roll))
        ratios["roll_radius_m"] = along(radius, {"rxx_m2": 0.5 / radius, "y_cg_m": -y / radius})
    if pitch > 0:
        radius = float(np.sqrt(pitch))
        ratios["pitch_radius_m"] = along(radius, {"ryy_m2": 0.5 / radius, "x_cg_m": -x / radius})
    ratios |= {"x_cg_m": along(x, {"x_cg_m": 1.0}), "y_cg_m": along(y, {"y_cg_m": 1.0})}
    parameters = dict.fromkeys(BODY_PARAMETERS, Estimate())
    if fit.model.mass_free:
        mu = fit.model.inverse_mass(theta)
        parameters["sprung_mass_kg"] = mass_of(fit, covariance)
        parameters["roll_inertia_kg_m2"] = along(
            roll / mu, {"rxx_m2": 1 / mu, "y_cg_m": -2 * y / mu, "inverse_mass": -roll / mu**2}
        )
        parameters["pitch_inertia_kg_m2"] = along(
            pitch / mu, {"ryy_m2": 1 / mu, "x_cg_m": -2 * x / mu, "inverse_mass": -pitch / mu**2}
        )
        parameters |= {name: ratios[name] for name in ("x_cg_m", "y_cg_m")}
    return parameters, ratios


def mass_of(fit: BodyFit, covariance: FloatArray) -> Estimate:
    """Return the reference mass; its interval is the image of that of its inverse, longer upwards.

    Args:
        fit: with a free mass.
        covariance: (n_shared, n_shared) of the shared parameters.
    """
    mu, std = inverse_mass_of(fit, covariance)
    if mu <= 1.96 * std:
        return Estimate(1 / mu if mu > 0 else None)
    return Estimate(1 / mu, std / mu**2, (1 / (mu + 1.96 * std), 1 / (mu - 1.96 * std)))


def inverse_mass_of(fit: BodyFit, covariance: FloatArray) -> tuple[float, float]:
    """Return one over the reference mass and its standard deviation, 1/kg.

    Args:
        fit: with a free mass.
        covariance: (n_shared, n_shared) of the shared parameters.
    """
    place = fit.model.names.index("inverse_mass")
    return fit.model.inverse_mass(fit.theta), float(np.sqrt(max(covariance[place, place], 0.0)))


def negative_mass(fit: BodyFit, covariance: FloatArray) -> bool:
    """Return whether the reference mass is below nothing by more than its interval.

    Args:
        fit: a fitted body.
        covariance: (n_shared, n_shared) of the shared parameters.
    """
    if not fit.model.mass_free:
        return False
    mu, std = inverse_mass_of(fit, covariance)
    return mu < -1.96 * std


def suspension_estimates(
    fit: BodyFit, covariance: FloatArray, number: int, *, per_mass: bool = False
) -> tuple[Estimate, Estimate, dict[str, dict[str, Estimate]]]:
    """Return stiffness, damping and law of a group: in N, or per kg of the body where the mass is not fitted.

    Args:
        fit: a fitted body.
        covariance: (n_shared, n_shared) of the shared parameters.
        number: of the group.
        per_mass: whether they are wanted per kg though the mass is fitted.
    """
    first, places = fit.model.first_of_group[number], fit.model.law_places(number)
    law = fit.model.groups[number].law
    estimates: dict[str, dict[str, Estimate]] = {}
    if law.terms:
        law, slopes = from_free(law, fit.theta[places])
        place = places.start
        for term in law.terms:
            estimates[term.name] = {}
            for k, (parameter, value) in enumerate(zip(LAWS[term.name].parameters, term.values, strict=True)):
                slope = float(slopes[place - places.start])
                if k == 0:
                    estimates[term.name][parameter.name] = per_force(fit, covariance, place, per_mass=per_mass)
                else:
                    std = slope * float(np.sqrt(max(covariance[place, place], 0.0)))
                    estimates[term.name][parameter.name] = Estimate.normal(value, std)
                place += 1
    stiffness, damping = (per_force(fit, covariance, entry, per_mass=per_mass) for entry in (first, first + 1))
    return stiffness, damping, estimates


def per_force(fit: BodyFit, covariance: FloatArray, place: int, *, per_mass: bool = False) -> Estimate:
    """Return an entry of the vector that multiplies a force or a mass, times the reference mass where that is fitted.

    Args:
        fit: a fitted body.
        covariance: (n_shared, n_shared) of the shared parameters.
        place: of the entry.
        per_mass: whether the entry itself is wanted though the mass is fitted.
    """
    model, value = fit.model, float(fit.theta[place])
    gradient = np.zeros(len(model.names))
    absolute = model.mass_free and not per_mass
    mu = model.inverse_mass(fit.theta) if absolute else 1.0
    gradient[place] = 1 / mu
    if absolute:
        gradient[model.names.index("inverse_mass")] = -value / mu**2
    return Estimate.normal(value / mu, float(np.sqrt(max(float(gradient @ covariance @ gradient), 0.0))))
