"""Structures tried on the same data: each gear alone, symmetric pairs, one rigid body.

A gear alone, or the mean of a pair, is a body with heave alone and one interface: the same predictor, search and noise
level as for the whole body, so that what they leave can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import NotDeterminedError
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray
from opid.suspensions.equation import Start, start_values
from opid.suspensions.fit import EXPLAINS, ON_THE_WAY, BodyFit, body_model, first_vector, fit_body
from opid.suspensions.laws import ENOUGH, LawStep, is_hopeless
from opid.suspensions.model import Group
from opid.suspensions.one_gear.pursuit import library
from opid.suspensions.run import BodyRun, body_run
from opid.suspensions.structure import Body, ImpossibleBodyError, rigid_body, vertical
from opid.suspensions.study import BodyStudy, PointMass
from opid.suspensions.ways import way_to_fit

# what rests on a gear of less than this share of a loading is nothing
LEAST_SHARE = 1e-3
# loadings that differ by less than this share of the largest are one
SAME_LOADING = 1e-6
# gears are on one line if they leave it by less than this share of its length
ONE_LINE = 0.01


@dataclass(frozen=True, eq=False)
class Fitted:
    """One structure fitted to the runs.

    Args:
        kind: "single", "pair" or "rigid_body".
        interfaces: places in the study of those that it is about.
        fit: the fit; None where there is none.
        steps: laws that were tried.
        noise: level known beforehand of what was fitted, m/s^2.
        left_out: level of the errors of runs that the others predict, m/s^2; None for a single run, or where the others
            cannot be fitted.
        reason: why there is no fit; "" if there is one.
    """

    kind: str
    interfaces: tuple[int, ...]
    fit: BodyFit | None
    steps: tuple[LawStep, ...]
    noise: float
    left_out: float | None
    reason: str = ""

    @property
    def residual_over_noise(self) -> float:
        """Noise that would explain the errors over the noise known beforehand."""
        return self.fit.level / self.noise if self.fit is not None else float("inf")

    @property
    def left_out_over_noise(self) -> float | None:
        """Likewise of runs that the others predict; None where there is no such level."""
        return None if self.left_out is None else self.left_out / self.noise

    @property
    def lack(self) -> float:
        """The larger of both."""
        return max(self.residual_over_noise, self.left_out_over_noise or 0.0)

    @property
    def found(self) -> BodyFit:
        """The fit; NotDeterminedError where there is none."""
        if self.fit is None:
            raise NotDeterminedError(self.reason)
        return self.fit

    @property
    def explains(self) -> bool:
        """Whether what is left is noise, also of runs that the others predict."""
        return self.lack <= EXPLAINS


def shares(study: BodyStudy, loading: PointMass) -> FloatArray:
    """Return how much of a mass rests on each interface, (n,) kg: together all of it, wherever the origin is.

    By statics where there are three, as even as statics allows where there are more. On one line the lever rule holds,
    about the foot of the perpendicular from the mass.

    Args:
        study: the study.
        loading: the mass.
    """
    places = np.array([interface.place for interface in study.interfaces])
    middle = places.mean(axis=0)
    lever = np.array([loading.x_m, loading.y_m]) - middle
    uneven = np.linalg.pinv((places - middle).T, rcond=ONE_LINE) @ lever
    return np.asarray(loading.mass_kg * (1 / len(places) + uneven))


def fitted_alone(
    study: BodyStudy,
    arrays: Sequence[tuple[FloatArray, FloatArray]],
    noises: FloatArray,
    interfaces: tuple[int, ...],
    *,
    law: Law | None,
    band_hz: tuple[float, float],
    progress: Callable[[str], None] | None = None,
) -> Fitted:
    """Fit the mean of some interfaces as one gear under its share of the mass.

    Args:
        study: the study.
        arrays: (n, n_interfaces) below and (n, n_sensors) on the body of each run, m/s^2.
        noises: (2,) noise of a sensor below and on the body, m/s^2.
        interfaces: their places in the study.
        law: to fit, per unit amplitudes as start; searched where left out.
        band_hz: lines that count, Hz.
        progress: called with the name of each step as it begins.
    """
    picked = list(interfaces)
    runs = []
    for run, (below, above) in zip(study.runs, arrays, strict=True):
        change = sum(float(shares(study, each)[picked].mean()) for each in run.loading)
        if abs(change) < LEAST_SHARE * sum(abs(each.mass_kg) for each in run.loading):
            change = 0.0
        runs.append(
            body_run(
                below[:, picked].mean(axis=1, keepdims=True),
                above[:, picked].mean(axis=1, keepdims=True),
                fs=study.fs,
                loading=np.array([[change]]),
                band_hz=band_hz,
            )
        )
    one, none = np.ones((1, 1)), np.zeros((0, 1, 1))
    body = Body(("heave",), one, (), none, np.zeros((1, 1)), one, one)
    noise = noises / np.sqrt(len(picked))
    name = ", ".join(study.names[k] for k in picked)
    kind = "single" if len(picked) == 1 else "pair"
    return fitted(kind, interfaces, runs, body, (Group(name, (0,)),), noise, law=law, progress=progress)


def fitted_rigid(
    study: BodyStudy,
    arrays: Sequence[tuple[FloatArray, FloatArray]],
    noises: FloatArray,
    *,
    law: Law | None,
    band_hz: tuple[float, float],
    progress: Callable[[str], None] | None = None,
) -> Fitted:
    """Fit one rigid body on all interfaces.

    Args:
        study: the study.
        arrays: (n, n_interfaces) below and (n, n_sensors) on the body of each run, m/s^2.
        noises: (2,) noise of a sensor below and on the body, m/s^2.
        law: to fit at every interface; searched where left out.
        band_hz: lines that count, Hz.
        progress: called with the name of each step as it begins.
    """
    body = rigid_body(
        [interface.place for interface in study.interfaces],
        [
            *(interface.sensor_place for interface in study.interfaces),
            *((sensor.x_m, sensor.y_m) for sensor in study.sensors),
        ],
        names=study.names,
        tolerance_m=study.structure.position_tolerance_m,
    )
    runs = [
        body_run(below, above, fs=study.fs, loading=loading_matrix(study, place), band_hz=band_hz)
        for place, (below, above) in enumerate(arrays)
    ]
    every = tuple(range(len(study.interfaces)))
    return fitted("rigid_body", every, runs, body, groups_of(study), noises, law=law, progress=progress)


def loading_matrix(study: BodyStudy, place: int) -> FloatArray:
    """Return the mass matrix of a loading about the origin, (3, 3) kg, kg m, kg m^2.

    Args:
        study: the study.
        place: of the run.
    """
    total = np.zeros((3, 3))
    for each in study.runs[place].loading:
        row = vertical(each.x_m, each.y_m)
        total += each.mass_kg * np.outer(row, row)
    return total


def groups_of(study: BodyStudy) -> tuple[Group, ...]:
    """Return which interfaces share what, in the order of the first of each group.

    Args:
        study: the study.
    """
    together = {name: group for group in study.structure.shared for name in group}
    found: dict[str, Group] = {}
    for name in study.names:
        members = together.get(name, (name,))
        slots = tuple(k for k, each in enumerate(study.names) if each in members)
        label = ", ".join(study.names[k] for k in slots)
        found.setdefault(label, Group(label, slots))
    return tuple(found.values())


def fitted(
    kind: str,
    interfaces: tuple[int, ...],
    runs: Sequence[BodyRun],
    body: Body,
    groups: tuple[Group, ...],
    noises: FloatArray,
    *,
    law: Law | None,
    start: Start | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fitted:
    """Fit a body: start values from its equation of motion, the model, the laws, and the runs that are left out.

    Args:
        kind: of structure.
        interfaces: places in the study.
        runs: the runs.
        body: the body.
        groups: which interfaces share what.
        noises: (2,) noise of a sensor below and on the body, m/s^2.
        law: kinds to fit at every interface; searched where left out.
        start: where to begin; from the equation of motion where left out.
        progress: called with the name of each step as it begins.
    """
    mass_free = mass_is_told(runs, body)
    noise = float(np.sqrt(np.mean(np.square(noises))))
    if law is not None:
        groups = tuple(replace(group, law=law) for group in groups)
    try:
        if start is None:
            kinds = library() if law is None else ()
            start = start_values(runs, body, groups, mass_free=mass_free, kinds=kinds)
        model = body_model(runs, body, start, mass_free=mass_free, noise_m_per_s2=(float(noises[0]), float(noises[1])))
        several = len(interfaces) > 1 and body.n_interfaces > 1
        fit, steps = way_to_fit(
            model, first_vector(model, start), several=several, searched=law is None, progress=progress
        )
    except (UnboundedResponseError, ImpossibleBodyError, NotDeterminedError) as error:
        return Fitted(kind, interfaces, None, (), noise, None, str(error))
    try:
        left_out = left_out_level(fit)
    except (UnboundedResponseError, ImpossibleBodyError):
        left_out = None
    return Fitted(kind, interfaces, fit, steps, noise, left_out)


def mass_is_told(runs: Sequence[BodyRun], body: Body) -> bool:
    """Return whether one over the reference mass is fitted: something is known in kg or N, or the loading changes.

    Args:
        runs: the runs.
        body: the body.
    """
    springs = any(spring.stiffness_n_per_m or spring.damping_n_s_per_m for spring in body.inside)
    return not body.absolute and (loading_changes(runs) or springs or bool(body.known.any()))


def loading_changes(runs: Sequence[BodyRun]) -> bool:
    """Return whether the loading of a run is another than that of the first.

    Args:
        runs: the runs.
    """
    largest = max(float(np.abs(run.loading).max()) for run in runs)
    return any(bool((np.abs(run.loading - runs[0].loading) > SAME_LOADING * largest).any()) for run in runs[1:])


def left_out_level(fit: BodyFit) -> float | None:
    """Return how well each run is predicted by a fit of the others, m/s^2; None for a single run.

    Of the run left out only its start is fitted. The mass stays that of all runs, the one left out among them, where
    the others have one loading.

    Args:
        fit: of all runs.

    Raises:
        UnboundedResponseError: the other runs make a suspension that grows without bound.
        ImpossibleBodyError: the other runs make no mass matrix for the loading of the one left out.
    """
    model = fit.model
    if len(model.runs) < 2:
        return None
    cost, n_data, n_own = 0.0, 0, 2 * model.body.n_interfaces
    promise = ON_THE_WAY if is_hopeless(fit) else ENOUGH
    for place, run in enumerate(model.runs):
        others = tuple(each for k, each in enumerate(model.runs) if k != place)
        changed = model.mass_free and loading_changes(others)
        shared = fit.theta[: model.n_shared]
        held = model.inverse_mass(fit.theta)
        if model.mass_free and not changed:
            shared = np.delete(shared, model.names.index("inverse_mass"))
        own = fit.theta[model.n_shared :].reshape(len(model.runs), n_own)
        rest = replace(model, runs=others, mass_free=changed, held_inverse_mass=held)
        without = fit_body(rest, np.concatenate([shared, np.delete(own, place, axis=0).ravel()]), least_promise=promise)
        alone = replace(rest, runs=(run,))
        begun = np.concatenate([without.theta[: rest.n_shared], own[place]])
        predicted = fit_body(alone, begun, free=slice(rest.n_shared, None), least_promise=promise)
        cost += float(np.sum(predicted.errors.stacked[: predicted.n_data] ** 2))
        n_data += predicted.n_data
    return float(np.sqrt(np.mean(np.square(model.noise)) * cost / n_data))
