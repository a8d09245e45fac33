"""Integrate the model, not the data: fit the body that the measured spindle accelerations drive.

z'' = -x1'' - (K2 z + C2 z' + f(z, z') + K3 x2)/M2 is a damped system driven by what was measured. It is simulated,
the airframe acceleration is predicted, and mass, stiffness, damping and law of all runs are moved until
the prediction errors are white. No acceleration is integrated by itself, so no slow motion is lost.

The spindle's noise drives the model too. Every reading of the airframe therefore corrects the simulated motion by as
much as both noise levels make right (`opid.mechanics.prediction`): the errors that are left are white whatever the
law, and their least squares is maximum likelihood. The lines of a band of them are compared, so that what the sensors
do below and above does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import LINEAR, Law
from opid.mechanics.prediction import Prediction
from opid.signals.recording import FloatArray
from opid.suspensions.law_parameters import from_free, to_free
from opid.suspensions.one_gear.driven_model import N_OWN, Errors, Model
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.paper.joint_fit import JointFit
from opid.suspensions.sensor_facts import SensorPair, nuisance_values

# factors on the spindle's noise by which a fit comes nearer from afar, and from farther
FROM_AFAR, FROM_FARTHER = (30.0, 5.0), (100.0, 20.0, 4.0)


@dataclass(frozen=True, eq=False)
class ModelFit(JointFit):
    """The fitted model, per unit of the reference sprung mass; beside what every joint fit has:

    Args:
        predictions: of each run, without derivatives.
        start: (n_runs, 2) travel (m) and velocity (m/s) at the start of each run.
        noise: (2,) levels that were taken for the spindle's and the airframe's sensor, m/s^2; their ratio matters.
        motion_rms: rms travel (m) and velocity (m/s) that bound scales and starts.
        held_inverse_mass: 1/M2 where it was not fitted, 1/kg; None if it was.
        sensors: what was known of the sensors.
        jacobian: (n_data, n_parameters) derivatives of the stacked errors by the shared parameters, what the starts
            can imitate taken out.
    """

    predictions: tuple[Prediction, ...]
    start: FloatArray
    noise: tuple[float, float]
    motion_rms: tuple[float, float]
    held_inverse_mass: float | None
    sensors: SensorPair
    jacobian: FloatArray

    @property
    def ground(self) -> bool:
        """Whether the ground spring was free."""
        return "ground_stiffness_per_mass" in self.names

    def model(self, runs: Sequence[DrivenRun]) -> Model:
        """Return the model that was fitted, with the sensors' faults that were free in it.

        Args:
            runs: to which it was.
        """
        runs = [run if run.sensors == self.sensors else replace(run, sensors=self.sensors) for run in runs]
        return Model(tuple(runs), self.law, self.ground, self.held_inverse_mass, self.noise, self.motion_rms)

    @property
    def level(self) -> float:
        """Noise that was assumed, as white noise of equal level on both channels, m/s^2."""
        return float(np.sqrt(np.mean(np.square(self.noise))))

    @property
    def variance(self) -> float:
        """Variance of the whitened errors: 1 if the noise is what was assumed."""
        return (self.noise_m_per_s2 / self.level) ** 2

    @property
    def errors(self) -> FloatArray:
        """(n_data,) whitened errors in the order of `jacobian`."""
        lines = [np.sqrt(2) / self.level * line for line in self.residual]
        return np.concatenate([part for line in lines for part in (line.real, line.imag)])

    @property
    def vector(self) -> FloatArray:
        """The vector of the model at the fit."""
        value = self.value.copy()
        first = 2 + self.ground
        value[first : first + self.law.vector.size] = to_free(self.law)
        return np.concatenate([value, self.start.ravel()])

    @property
    def travel(self) -> FloatArray:
        """(n,) travel of all runs, one after the other, m."""
        return np.concatenate([prediction.travel[:, 0] for prediction in self.predictions])

    @property
    def velocity(self) -> FloatArray:
        """(n,) velocity of all runs, m/s."""
        return np.concatenate([prediction.velocity[:, 0] for prediction in self.predictions])


def fit_model(
    runs: Sequence[DrivenRun],
    law: Law,
    *,
    stiffness_per_mass: float,
    damping_per_mass: float,
    ground_stiffness_per_mass: float | None = None,
    inverse_mass: float | None = None,
    hold_mass: bool = False,
    noise_m_per_s2: tuple[float, float] = (5e-3, 5e-3),
    motion_rms: tuple[float, float] = (3e-3, 0.05),
    start: FloatArray | None = None,
    nuisance: dict[str, float] | None = None,
    noisier: Sequence[float] = (),
) -> ModelFit:
    """Move the model until it predicts the airframe accelerations of all runs.

    Args:
        runs: one `DrivenRun` a run, all with the same sensors.
        law: the nonlinear law per unit of sprung mass to start from; `Law()` for a linear suspension.
        stiffness_per_mass: start value of K2/M2, 1/s^2.
        damping_per_mass: start value of C2/M2, 1/s.
        ground_stiffness_per_mass: start value of K3/M2, 1/s^2; None for no ground spring.
        inverse_mass: start value of 1/M2, 1/kg, or None to fit ratios only.
        hold_mass: keep 1/M2 as it is given.
        noise_m_per_s2: noise of the spindle's and of the airframe's sensor, m/s^2; their ratio matters.
        motion_rms: rms travel (m) and velocity (m/s), which bound the scales of the law.
        start: (n_runs, 2) travel and velocity to begin with; looked for where left out.
        nuisance: start values of the sensors' faults by name; nominal where left out.
        noisier: falling factors on the spindle's noise of fits by which to come nearer from afar: the readings then
            hold the motion to the truth while the parameters are still wrong, and minima beside the right one vanish.

    Raises:
        InputError: no run, or a free mass although all mass changes are equal.
        UnboundedResponseError: the start values make a suspension that grows without bound.
    """
    from scipy import optimize

    if not runs:
        raise InputError("no run was given: give at least one")
    mass_free = inverse_mass is not None and not hold_mass
    if mass_free and len({run.mass_change_kg for run in runs}) < 2:
        raise InputError("all runs have the same mass change: only ratios to the mass can be fitted")
    if noisier:
        return _from_afar(
            runs,
            law,
            (*noisier, 1.0),
            stiffness_per_mass=stiffness_per_mass,
            damping_per_mass=damping_per_mass,
            ground_stiffness_per_mass=ground_stiffness_per_mass,
            inverse_mass=inverse_mass,
            hold_mass=hold_mass,
            noise_m_per_s2=noise_m_per_s2,
            motion_rms=motion_rms,
            start=start,
            nuisance=nuisance,
        )
    ground = ground_stiffness_per_mass is not None
    held = (inverse_mass or 0.0) if not mass_free else None
    model = Model(tuple(runs), law, ground, held, noise_m_per_s2, motion_rms)
    head = [stiffness_per_mass, damping_per_mass]
    head += [ground_stiffness_per_mass] if ground_stiffness_per_mass is not None else []
    shared = [*head, *to_free(law), *([inverse_mass] if mass_free else [])]
    shared += [(nuisance or {}).get(each.name, each.nominal) for each in model.nuisances]
    own = model.looked_for_start(np.array(shared)) if start is None else np.asarray(start)
    theta = np.concatenate([shared, own.ravel()])
    lower, upper = model.bounds(damping_per_mass)
    inside = np.minimum(1e-6, 1e-3 * (upper - lower))
    cache = _Remembered(model)
    solution = optimize.least_squares(
        cache.residual,
        np.clip(theta, lower + inside, upper - inside),
        jac=cache.jacobian,
        x_scale="jac",
        bounds=(lower, upper),
        max_nfev=40,
        xtol=1e-8,
        ftol=1e-6,
    )
    return fit_at(model, solution.x, int(solution.nfev), errors=cache.errors(solution.x))


def _from_afar(
    runs: Sequence[DrivenRun],
    law: Law,
    factors: Sequence[float],
    *,
    noise_m_per_s2: tuple[float, float],
    **values: Any,
) -> ModelFit:
    """Fit in steps of falling noise of the spindle, each from where the last one ended."""
    for factor in factors:
        fit = fit_model(runs, law, noise_m_per_s2=(factor * noise_m_per_s2[0], noise_m_per_s2[1]), **values)
        law = fit.law
        values |= {
            "stiffness_per_mass": fit["stiffness_per_mass"],
            "damping_per_mass": fit["damping_per_mass"],
            "ground_stiffness_per_mass": fit["ground_stiffness_per_mass"] if fit.ground else None,
            "inverse_mass": fit["inverse_mass"] if "inverse_mass" in fit.names else values["inverse_mass"],
            "start": fit.start,
            "nuisance": nuisance_values(fit.names, fit.value, fit.sensors),
        }
    return fit


def fit_at(model: Model, theta: FloatArray, n_evaluations: int, *, errors: Errors | None = None) -> ModelFit:
    """Return the fit that a vector stands for.

    Args:
        model: the model.
        theta: the vector.
        n_evaluations: how many were needed to find it.
        errors: those at the vector, where they are known already.
    """
    errors = errors or model.evaluate(theta)
    n_shared, n_law = len(model.names), model.law.vector.size
    n_data = 2 * sum(line.size for line in errors.lines)
    cost = float(np.sum(errors.stacked[:n_data] ** 2))
    variance = cost / max(n_data - theta.size, 1)
    # what was known before does not become better or worse known by the size of the errors
    weight = np.concatenate([np.full(n_data, 1 / variance), np.ones(errors.stacked.size - n_data)])
    covariance = _inverse(errors.jacobian, weight)[:n_shared, :n_shared]
    value, slope = theta[:n_shared].copy(), np.ones(n_shared)
    of_law = slice(model.n_head, model.n_head + n_law)
    law, slope[of_law] = from_free(model.law, theta[of_law]) if n_law else (LINEAR, 1.0)
    value[of_law] = law.vector
    frequency_hz = tuple(run.omega / (2 * np.pi) for run in model.runs)
    # as white noise of equal level on both channels
    level = float(np.sqrt(np.mean(np.square(model.noise))))
    basis = orthonormal(errors.jacobian[:n_data, n_shared:])
    shared = errors.jacobian[:n_data, :n_shared]
    return ModelFit(
        names=model.names,
        value=value,
        covariance=covariance * np.outer(slope, slope),
        law=law,
        frequency_hz=frequency_hz,
        residual=tuple(level * line / np.sqrt(2) for line in errors.lines),
        noise_m_per_s2=level * float(np.sqrt(variance)),
        log_likelihood=model.log_likelihood(errors, theta),
        n_data=n_data,
        n_evaluations=n_evaluations,
        band_hz=(float(frequency_hz[0][0]), float(frequency_hz[0][-1])),
        predictions=errors.predictions,
        start=theta[n_shared:].reshape(-1, N_OWN).copy(),
        noise=model.noise,
        motion_rms=model.motion_rms,
        held_inverse_mass=model.held_inverse_mass,
        sensors=model.runs[0].sensors,
        jacobian=(shared - basis @ (basis.T @ shared)) / slope,
    )


def scores_of_parameters(
    runs: Sequence[DrivenRun],
    fit: ModelFit,
    groups: Sequence[Sequence[str]],
    *,
    sensors: SensorPair,
    ground: bool = False,
) -> list[float]:
    """Return how far more free parameters would lower the squared whitened error, to first order, in one simulation.

    Args:
        runs: one `DrivenRun` a run.
        fit: the model with those parameters at their nominal values.
        groups: names that would be free together, "ground_stiffness_per_mass" or faults of the sensors.
        sensors: those with which all these faults are free.
        ground: whether a ground spring is among them.

    Returns:
        The gain of each group: of the one among its names that gains most, the others of the group being adapted.
    """
    changed = tuple(replace(run, sensors=sensors) for run in runs)
    model = replace(fit.model(runs), runs=changed, ground=fit.ground or ground)
    known = {nuisance.name: nuisance.nominal for nuisance in model.nuisances} | {"ground_stiffness_per_mass": 0.0}
    known |= dict(zip(fit.names, fit.value, strict=True)) | {f"law[{i}]": v for i, v in enumerate(to_free(fit.law))}
    errors = model.evaluate(np.array([*(known[name] for name in model.names), *fit.start.ravel()]))
    n_data = 2 * sum(line.size for line in errors.lines)
    # what was known before is left out
    jacobian, stacked = errors.jacobian[:n_data], errors.stacked[:n_data]
    place = {name: k for k, name in enumerate(model.names)}
    new = [place[name] for group in groups for name in group]
    fitted = np.delete(jacobian, new, axis=1)
    return [
        max(
            _gain(
                np.column_stack([fitted, jacobian[:, [place[each] for each in group if each != name]]]), column, stacked
            )
            for name in group
            for column in [jacobian[:, place[name]]]
        )
        for group in groups
    ]


def _gain(others: FloatArray, column: FloatArray, stacked: FloatArray) -> float:
    """What a step along one column gains once all others are adapted."""
    basis = orthonormal(others)
    direction = column - basis @ (basis.T @ column)
    size = float(direction @ direction)
    return float(direction @ stacked) ** 2 / size if size > 1e-20 * float(column @ column) else 0.0


class _Remembered:
    """The optimiser asks for errors and Jacobian at one place in two calls: simulate once."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._theta: FloatArray | None = None
        self._errors: Errors | None = None

    def errors(self, theta: FloatArray) -> Errors:
        if self._theta is None or self._errors is None or not np.array_equal(theta, self._theta):
            try:
                self._errors = self._model.evaluate(theta)
            except UnboundedResponseError:
                if self._errors is None:
                    raise
                # a step too far: worse than anything, so that the optimiser shortens it
                self._errors = replace(self._errors, stacked=np.full_like(self._errors.stacked, 1e6))
            self._theta = theta.copy()
        return self._errors

    def residual(self, theta: FloatArray) -> FloatArray:
        return self.errors(theta).stacked

    def jacobian(self, theta: FloatArray) -> FloatArray:
        return self.errors(theta).jacobian


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of columns of any size.

    Args:
        columns: (n, n_columns).
    """
    return np.linalg.qr(columns / np.maximum(np.sqrt(np.sum(columns**2, axis=0)), 1e-300))[0]


def _inverse(jacobian: FloatArray, weight: FloatArray) -> FloatArray:
    """(J^T W J)^-1 with the columns scaled to one size."""
    weighted = jacobian * np.sqrt(weight)[:, np.newaxis]
    scale = np.maximum(np.sqrt(np.sum(weighted**2, axis=0)), 1e-300)
    normal = (weighted / scale).T @ (weighted / scale)
    return np.linalg.pinv(normal, rcond=1e-13, hermitian=True) / np.outer(scale, scale)
