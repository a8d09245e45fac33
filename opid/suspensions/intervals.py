"""How well the parameters are known: intervals that hold for a coloured residual, and absolute values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import fft

from opid.estimate import Estimate
from opid.mechanics.laws import LAWS
from opid.signals.recording import FloatArray
from opid.suspensions.faults import GROUND
from opid.suspensions.fit import Fit
from opid.suspensions.law_parameters import from_free
from opid.suspensions.result import BODY_PARAMETERS, BODY_RATIOS, GEAR_RATIOS


def honest_covariance(fit: Fit) -> FloatArray:
    """Return the covariance of the shared parameters, widened where the residual is coloured.

    The sandwich over cells of neighbouring lines; no parameter becomes better known than for a white residual.

    Returns:
        (n_shared, n_shared).
    """
    n_shared = fit.model.n_shared
    wider = std_over_white(fit)
    return (fit.covariance * np.outer(wider, wider))[:n_shared, :n_shared]


def std_over_white(fit: Fit) -> FloatArray:
    """Return how much wider a coloured residual makes the interval of each entry of the vector, at least 1.

    Args:
        fit: a fitted model.
    """
    posterior, jacobian, scale = _scaled(fit)
    n, known = fit.n_data, fit.model.settings.intervals
    scores, first, n_cells = [], 0, 0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        n_lines = run.omega.size
        cell = np.tile(np.arange(n_lines) // known.lines_per_cell, line.size // n_lines)
        own = np.zeros((int(cell.max()) + 1, scale.size))
        for _ in range(2):
            rows = slice(first, first + line.size)
            product = jacobian[rows] * fit.errors.stacked[rows, np.newaxis]
            order = np.argsort(cell, kind="stable")
            starts = np.searchsorted(cell[order], np.arange(len(own)))
            own += np.add.reduceat(product[order], starts, axis=0)
            first += line.size
        scores.append(own / fit.variance)
        n_cells += len(own)
    stacked = np.concatenate(scores)
    of_prior = jacobian[n:].T @ jacobian[n:]
    small = n_cells / max(n_cells - scale.size, 1)
    sandwich = posterior @ (small * (stacked.T @ stacked) + of_prior) @ posterior
    return np.sqrt(np.maximum(np.diag(sandwich) / np.diag(posterior), 1.0))


def bootstrap_over_white(fit: Fit, rng: np.random.Generator) -> FloatArray:
    """Return the standard deviation of each entry of the vector by resampled blocks of time, over the white one.

    Each resample draws blocks of half a second of the innovations with replacement (Kuensch 1989), so that what is
    correlated within a block stays so, and moves the parameters by -C J^T e/s^2, to first order.

    Args:
        fit: a fitted model.
        rng: source of the draws.
    """
    posterior, jacobian, scale = _scaled(fit)
    n, known, first = fit.n_data, fit.model.settings.intervals, 0
    back = posterior @ jacobian[:n].T / fit.variance
    moved = np.zeros((known.n_bootstrap, scale.size))
    n_sensors = len(fit.model.sensors.sprung)
    for run, prediction in zip(fit.model.runs, fit.errors.predictions, strict=True):
        block = max(1, round(known.bootstrap_s * run.fs))
        n_blocks = -(-run.n_samples // block)
        drawn = rng.integers(0, run.n_samples, (known.n_bootstrap, n_blocks))
        for sensor in range(n_sensors):
            parts = [back[:, first + k * n_sensors * run.omega.size + sensor * run.omega.size :] for k in (0, 1)]
            spectrum = np.zeros((scale.size, run.n_samples // 2 + 1), dtype=np.complex128)
            spectrum[:, run.lines] = parts[0][:, : run.omega.size] + 1j * parts[1][:, : run.omega.size]
            # the transpose of `DrivenRun.transform`; the band holds neither the mean nor the highest line
            influence = fft.irfft(spectrum, run.n_samples) * np.sqrt(run.n_samples / 2)
            innovation = prediction.innovation[sensor]
            for draw, starts in enumerate(drawn):
                places = (starts[:, np.newaxis] + np.arange(block)).ravel()[: run.n_samples] % run.n_samples
                moved[draw] += influence @ innovation[places]
        first += 2 * n_sensors * run.omega.size
    # what was known before the data is drawn anew as well
    by_prior = np.diag(posterior @ (jacobian[n:].T @ jacobian[n:]) @ posterior)
    return np.sqrt((moved.var(axis=0) + by_prior) / np.diag(posterior))


def _scaled(fit: Fit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariance and Jacobian with every entry in units of its standard deviation, and these."""
    scale = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    return fit.covariance / np.outer(scale, scale), fit.errors.jacobian * scale, scale


def gear_ratios(fit: Fit, covariance: FloatArray, ground: Estimate) -> dict[str, Estimate]:
    """Return ratios to the mass, and frequency and damping ratio on a still wheel, of one gear by the delta method."""
    names, group = list(fit.model.names), fit.model.groups[0]
    k, c = (fit.value(group.called(what)) for what in ("stiffness_per_mass", "damping_per_mass"))
    ratios = dict.fromkeys(GEAR_RATIOS, Estimate())
    for place, name in ((0, "stiffness_per_mass"), (1, "damping_per_mass")):
        ratios[name] = per_force(fit, covariance, place, per_mass=True)
    ratios["ground_stiffness_per_mass"] = ground
    total = k + fit.value(group.called(GROUND))
    if total <= 0:
        return ratios
    omega = float(np.sqrt(total))
    gradients = np.zeros((2, len(names)))
    gradients[:, 0] = 1 / (4 * np.pi * omega), -c / (4 * omega**3)
    gradients[1, 1] = 1 / (2 * omega)
    if group.ground:
        gradients[:, 2] = gradients[:, 0]
    std = np.sqrt(np.maximum(np.diag(gradients @ covariance @ gradients.T), 0))
    ratios["natural_frequency_hz"] = Estimate.normal(omega / (2 * np.pi), std[0])
    ratios["damping_ratio"] = Estimate.normal(c / (2 * omega), std[1])
    return ratios


def ground_estimate(
    fit: Fit, covariance: FloatArray, number: int, std_per_mass: float | None, *, per_mass: bool
) -> Estimate:
    """Return the spring from the body to the ground at a group of interfaces, N/m, or per kg.

    A gear that the runs give none has zero, as well as that would be known: `std_per_mass`, 1/s^2, None where the user
    ruled such springs out. None is known better than gains are equal.
    """
    group, equal = fit.model.groups[number], fit.model.settings.intervals.equal_gains
    stiffness = per_force(fit, covariance, fit.model.first_of_group[number], per_mass=per_mass).value or 0.0
    if not group.ground:
        if std_per_mass is None:
            return Estimate(0.0)
        mu = 1.0 if per_mass or not fit.model.mass_free else fit.model.inverse_mass(fit.theta)
        return Estimate.normal(0.0, float(np.hypot(std_per_mass / mu, equal * stiffness)))
    found = per_force(fit, covariance, fit.model.first_of_group[number] + 2, per_mass=per_mass)
    if found.std is None or any(fault.kind == "gain" for fault in fit.model.faults):
        return found
    return Estimate.normal(found.value or 0.0, float(np.hypot(found.std, equal * stiffness)))


def body_estimates(fit: Fit, covariance: FloatArray) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Return absolute parameters and ratios of a rigid body; parameters are empty without the mass."""
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


def mass_of(fit: Fit, covariance: FloatArray) -> Estimate:
    """Return the reference mass; its interval is the image of that of its inverse, longer upwards."""
    mu, std = inverse_mass_of(fit, covariance)
    if mu <= 1.96 * std:
        return Estimate(1 / mu if mu > 0 else None)
    return Estimate(1 / mu, std / mu**2, (1 / (mu + 1.96 * std), 1 / (mu - 1.96 * std)))


def inverse_mass_of(fit: Fit, covariance: FloatArray) -> tuple[float, float]:
    """Return one over the reference mass and its standard deviation, 1/kg."""
    place = fit.model.names.index("inverse_mass")
    return fit.model.inverse_mass(fit.theta), float(np.sqrt(max(covariance[place, place], 0.0)))


def negative_mass(fit: Fit, covariance: FloatArray) -> bool:
    """Return whether the reference mass is below nothing by more than its interval."""
    if not fit.model.mass_free:
        return False
    mu, std = inverse_mass_of(fit, covariance)
    return mu < -1.96 * std


def suspension_estimates(
    fit: Fit, covariance: FloatArray, number: int, *, per_mass: bool = False
) -> tuple[Estimate, Estimate, dict[str, dict[str, Estimate]]]:
    """Return stiffness, damping and law of a group: in N, or per kg of the body where the mass is not fitted."""
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


def per_force(fit: Fit, covariance: FloatArray, place: int, *, per_mass: bool = False) -> Estimate:
    """Return an entry of the vector that multiplies a force or a mass, times the mass where that is fitted."""
    model, value = fit.model, float(fit.theta[place])
    gradient = np.zeros(len(model.names))
    absolute = model.mass_free and not per_mass
    mu = model.inverse_mass(fit.theta) if absolute else 1.0
    gradient[place] = 1 / mu
    if absolute:
        gradient[model.names.index("inverse_mass")] = -value / mu**2
    return Estimate.normal(value / mu, float(np.sqrt(max(float(gradient @ covariance @ gradient), 0.0))))
