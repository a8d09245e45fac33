"""Fit of the model, which predicts every sensor on the body from every sensor below its suspensions."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws.law import LAWS, Law, Term
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.fitting.least_squares import AnyResidual, least_squares
from opid.suspensions.fitting.start import Start
from opid.suspensions.model.body import ImpossibleBodyError
from opid.suspensions.model.driven_model import Errors, Model
from opid.suspensions.model.law_parameters import to_free
from opid.suspensions.model.unknowns import Group

logger = logging.getLogger(__name__)

NO_FIT = (UnboundedResponseError, ImpossibleBodyError)
"""Errors of a fit whose start values give a model that cannot be simulated."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Args:
        model: the model.
        theta: (n_unknowns,) the fitted vector.
        errors: prediction errors at that vector.
        n_evaluations: number of predictions of all runs that the fit needed.
    """

    model: Model
    theta: FloatArray
    errors: Errors
    n_evaluations: int

    @property
    def n_data(self) -> int:
        """Number of fitted real numbers."""
        return 2 * sum(line.size for line in self.errors.lines)

    @cached_property
    def variance(self) -> float:
        """Variance of the whitened errors: 1 if the noise is what was assumed."""
        cost = float(np.sum(self.errors.stacked[: self.n_data] ** 2))
        return cost / max(self.n_data - self.theta.size, 1)

    @property
    def weight(self) -> float:
        """Weight of a squared error beside what was known before; samples that are not compared have none."""
        return self.model.compared_fraction / self.variance

    @property
    def ratio(self) -> float:
        """Residual over the assumed noise."""
        return float(np.sqrt(self.variance))

    @property
    def noise_m_per_s2(self) -> float:
        """Noise that would explain the errors, as white noise of one level on all sensors, m/s^2."""
        return self.model.level * self.ratio

    @property
    def error_rms(self) -> float:
        """The same, under the name that the search for laws uses."""
        return self.noise_m_per_s2

    @cached_property
    def covariance(self) -> FloatArray:
        """(n_unknowns, n_unknowns) of the vector, for errors that are white."""
        n = self.n_data
        # The size of the errors does not change how well something was known before.
        weight = np.concatenate([np.full(n, self.weight), np.ones(self.errors.stacked.size - n)])
        jacobian = self.errors.jacobian * np.sqrt(weight)[:, np.newaxis]
        size = np.linalg.norm(jacobian, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        scaled = jacobian / size
        return np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True) / np.outer(size, size)

    @cached_property
    def std(self) -> FloatArray:
        """(n_shared,) standard deviations of the shared parameters, for errors that are white."""
        n = self.model.n_shared
        return np.sqrt(np.maximum(np.diag(self.covariance)[:n], 0.0))

    @cached_property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978): smaller is better."""
        # A coordinate with a known tolerance is no free parameter. Moving it, a sensor or the suspension of one run far
        # from what was known is penalised instead.
        n_free = self.model.n_shared - len(self.model.body.coordinates) - self.model.n_known_of_laws
        moved = self.errors.stacked[self.n_data :][self.model.is_weighed]
        likelihood = self.model.log_likelihood(self.errors, self.theta)
        return float(n_free * np.log(self.n_data) - 2 * likelihood + moved @ moved)

    @cached_property
    def laws(self) -> dict[str, Law]:
        """The fitted law of each group by its name, per unit of the reference mass."""
        laws = self.model.laws(self.theta)
        return {group.name: law for group, law in zip(self.model.groups, laws, strict=True)}

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups with the fitted laws."""
        return tuple(replace(group, law=self.laws[group.name]) for group in self.model.groups)

    @property
    def law_key(self) -> tuple[tuple[str, bool], ...]:
        """Key of the laws of all groups: their kinds, and whether they have an origin of their own."""
        return law_key(self.laws)

    @property
    def law_name(self) -> str:
        """The law in words; one for each group if the groups differ."""
        names = {
            group.name: law.name + (" about its own origin" if law.terms and law.rest_m else "")
            for group, law in zip(self.groups, self.laws.values(), strict=True)
        }
        if len(set(names.values())) == 1:
            return next(iter(names.values()))
        return "; ".join(f"{group}: {law}" for group, law in names.items())

    def value(self, name: str) -> float:
        """Return a shared parameter; 0 if it was not fitted.

        Args:
            name: name of the parameter.
        """
        return float(self.theta[self.model.names.index(name)]) if name in self.model.names else 0.0

    def motion(self, attachment: int) -> tuple[FloatArray, FloatArray]:
        """Return travel (m) and velocity (m/s) of an attachment, (n,) each, of all runs one after the other.

        Args:
            attachment: index of an interface, or of a spring inside the body.
        """
        parts = self.errors.predictions
        return np.concatenate([p.travel[:, attachment] for p in parts]), np.concatenate(
            [p.velocity[:, attachment] for p in parts]
        )


def first_vector(model: Model, start: Start) -> FloatArray:
    """Return the vector of the start values.

    Args:
        model: a model with the groups of the start values.
        start: start values from the equation of motion.
    """
    shared: list[float] = []
    springs = list(zip(start.stiffness.tolist(), start.damping.tolist(), strict=True))
    if start.has_ground:
        # A ground spring carries a part of the stiffness.
        for number, beside in enumerate(start.stiffness_beside_ground.tolist()):
            springs[number] = (beside, springs[number][1])
    for group, (stiffness, damping), ground in zip(start.groups, springs, start.ground_stiffness, strict=False):
        shared += [stiffness, damping, *([ground] if group.ground else []), *to_free(group.law).tolist()]
    for stiffness, damping in springs[len(start.groups) :]:
        shared += [stiffness, damping]
    shared += start.factors.tolist()
    if model.mass_free:
        shared.append(start.inverse_mass or 0.0)
    shared += [start.lags.get(fault.name, fault.nominal) for fault in model.faults]
    shared += [0.0] * len(model.body.coordinates)
    for number, index in model.carriers:
        first, term = model.first_of_group[number], model.carrier(number)
        tangent = shared[first] + shared[index] * float(term.evaluate(np.array(0.0), np.array(0.0))[1])
        if tangent > 0.0:
            column = make_carrying_column(term.name, model.weight, tangent)
            shared[first], shared[index : index + len(column.values)] = 0.0, to_free(Law((column,))).tolist()
    # Each run begins at rest here: integrated accelerations do not give the initial state, because the filter has not
    # settled there.
    return np.array([*shared, *[0.0] * (model.n_own * len(model.runs))])


def make_carrying_column(kind: str, weight: float, stiffness: float) -> Term:
    """Return a column of gas that carries a weight and is as stiff as a spring.

    Args:
        kind: kind of the term, with a force at rest, a length and an exponent.
        weight: the carried weight, m/s^2, or N.
        stiffness: stiffness of the spring, 1/s^2, or N/m.

    >>> make_carrying_column("gas_column", 18e3, 225e3).values
    (18000.0, 0.098, 1.225)
    """
    exponent = LAWS[kind].parameters[2].default
    return Term(kind, (weight, round(exponent * weight / stiffness, 9), exponent))


def law_key(laws: Mapping[str, Law]) -> tuple[tuple[str, bool], ...]:
    """Return a key of laws that does not depend on their values: kinds, and whether they have their own origin.

    Args:
        laws: the law of each group by its name.
    """
    return tuple((law.name, bool(law.terms and law.rest_m)) for law in laws.values())


def fit_model(
    model: Model,
    theta: FloatArray,
    *,
    noisier: Sequence[float] = (),
    hold_coordinates: bool = True,
    free: slice | NDArray[np.int64] = slice(None),
    most_evaluations: int | None = None,
    least_promise: float | None = None,
) -> Fit:
    """Fit the vector by nonlinear least squares of the prediction errors of all runs.

    Args:
        model: the body, its runs, laws and sensors.
        theta: the start vector.
        noisier: decreasing factors on the noise below the suspensions (continuation, see `FitSettings`).
        hold_coordinates: whether coordinates stay as stated during continuation.
        free: the entries that may move.
        most_evaluations: most predictions of all runs, for each factor.
        least_promise: the fit ends when the next step is expected to lower the squared error over its variance by less.

    Raises:
        UnboundedResponseError: the start values make a suspension that grows without bound.
        ImpossibleBodyError: the start values make a mass matrix that is not positive definite.
    """
    known, spent, promise = model.settings.fit, 0, 0.0
    errors: Errors | None = None
    for factor in (*noisier, 1.0):
        louder = replace(model, louder=factor, is_held=bool(model.carriers))
        if factor != 1.0 and hold_coordinates:
            louder = _with_coordinates_held(louder)
        promise = known.promise_from_afar if factor != 1.0 else least_promise or known.least_promise
        theta, errors, n = _minimize(louder, theta, free, most_evaluations or known.most_evaluations, promise)
        spent += n
    logger.debug("a fit of %d runs took %d evaluations", len(model.runs), spent)
    if not model.carriers and errors is not None:
        return Fit(model, theta, errors, spent)
    fit = Fit(model, theta, model.evaluate(theta), spent + 1)
    if not model.carriers or fit.ratio > model.settings.verdicts.refused:
        return fit
    # The fit is now near enough to its minimum: if the runs show that another spring carries a part of the weight, they
    # are believed.
    begun, most = _share_out_load(model, theta), most_evaluations or known.most_evaluations
    theta, errors, n = _minimize(model, begun, free, most, promise)
    spent = fit.n_evaluations + n
    return Fit(model, theta, errors or model.evaluate(theta), spent + (errors is None))


def _share_out_load(model: Model, theta: FloatArray) -> FloatArray:
    """Return the vector with a spring beside gas whose exponent is not that of gas.

    The first three derivatives of the force at rest do not change.
    """
    theta = theta.copy()
    for number, index in model.carriers:
        first, known = model.first_of_group[number], model.carrier(number).kind.parameters[2].known
        assert known is not None  # the exponent of a column of gas is known beforehand
        mean, std = known
        carried, length, exponent = (
            float(theta[index]),
            float(np.exp(theta[index + 1])),
            float(np.exp(theta[index + 2])),
        )
        if abs(exponent - mean) <= 2 * std:
            continue
        now = length * (mean + 2) / (exponent + 2)
        held = carried * exponent * (exponent + 1) / (mean * (mean + 1)) * (now / length) ** 2
        theta[first] += exponent * carried / length - mean * held / now
        theta[index : index + 3] = held, np.log(now), np.log(mean)
    return theta


def refit(fit: Fit, laws: dict[str, Law], *, least_promise: float | None = None) -> Fit | None:
    """Fit other laws, beginning at a fit; None if the model cannot be simulated with them.

    Args:
        fit: the fit to start from.
        laws: start values of the laws by the name of the group; groups that are not named keep theirs.
        least_promise: as in `fit_model`.
    """
    most = fit.model.settings.fit.most_refit_evaluations
    try:
        return fit_model(*with_laws(fit, laws), most_evaluations=most, least_promise=least_promise)
    except NO_FIT:
        return None


def with_laws(fit: Fit, laws: dict[str, Law]) -> tuple[Model, FloatArray]:
    """Return the model of a fit with other laws, and the vector that keeps everything else.

    The mean slopes of a term that is dropped or added go to or come from stiffness and damping. If a law does not rest
    at its origin, its rest position becomes one more unknown.

    Args:
        fit: the fit with the laws so far.
        laws: the new laws by the name of the group; groups that are not named keep theirs.
    """
    model, groups = fit.model, []
    parts: list[FloatArray] = []
    for number, (group, before) in enumerate(zip(model.groups, fit.laws.values(), strict=True)):
        law = laws.get(group.name, before)
        first, indices = model.first_of_group[number], model.law_indices(number)
        head = fit.theta[first : indices.start - group.has_origin].copy()
        if law != before:
            travel, velocity = (np.concatenate(part) for part in zip(*map(fit.motion, group.members), strict=True))
            for entry, (was, now) in enumerate(
                zip(before.gradient(travel, velocity), law.gradient(travel, velocity), strict=True)
            ):
                head[entry] += float(np.mean(was)) - float(np.mean(now))
        group = replace(group, origin_m=(group.origin_m or abs(law.rest_m)) if law.rest_m else None)
        if group.has_origin:
            head = np.append(head, law.rest_m)
        parts += [head, to_free(law)]
        groups.append(replace(group, law=law))
    return replace(model, groups=tuple(groups)), np.concatenate([*parts, fit.theta[indices.stop :]])


def carry_over(fit: Fit, model: Model, start: dict[str, float] | None = None) -> FloatArray:
    """Return the vector of another model that takes the fitted values of all common parameters.

    Args:
        fit: a fit of a model with the same runs and interfaces.
        model: the other model.
        start: start values by name, which replace fitted values. Without one, a fault begins at its nominal value and
            any other parameter at zero.
    """
    known = {fault.name: fault.nominal for fault in model.faults}
    known |= dict(zip(fit.model.names, fit.theta.tolist(), strict=False))
    known |= start or {}
    return np.array([*(known.get(name, 0.0) for name in model.names), *fit.theta[fit.model.n_shared :]])


def balance_runs(fit: Fit) -> Fit:
    """Fit once more with the errors of each run weighted by their size: a wrong model leaves more of a rough run.

    The rms of the errors over all runs does not change.

    Args:
        fit: a fitted model.
    """
    rms = [float(np.sqrt(np.mean(np.abs(line) ** 2) / 2)) for line in fit.errors.lines]
    runs = tuple(
        replace(run, error_level=run.error_level * each / fit.ratio)
        for run, each in zip(fit.model.runs, rms, strict=True)
    )
    most = fit.model.settings.fit.most_refit_evaluations
    return fit_model(replace(fit.model, runs=runs), fit.theta, most_evaluations=most)


def rows_with_departures(fit: Fit, model: Model) -> NDArray[np.int64]:
    """Return the rows of a model's errors that belong to data, and to departures of the suspensions between runs.

    Args:
        fit: a fit of the same runs.
        model: the fitted model, or one with more free parameters.
    """
    n_known = len(model.faults) + len(model.body.coordinates)
    departs = np.flatnonzero(model.is_weighed[n_known:]) + n_known
    return np.concatenate([np.arange(fit.n_data), fit.n_data + departs])


def fastest_rate(model: Model, theta: FloatArray) -> float:
    """Return the largest rate of the linear structure, frequency or decay, rad/s or 1/s.

    Args:
        model: the body.
        theta: the vector.

    Raises:
        ImpossibleBodyError: a mass matrix that is not positive definite.
    """
    suspensions, _ = model.interfaces(theta)
    accelerance = model.mobility(theta, 0).accelerance
    stiffness, damping = (
        np.array([getattr(suspension, name) for suspension in suspensions]) for name in ("stiffness", "damping")
    )
    zero = np.zeros_like(accelerance)
    system = np.block([[zero, np.eye(len(suspensions))], [-accelerance * stiffness, -accelerance * damping]])
    return float(np.abs(np.linalg.eigvals(system)).max())


def is_same_minimum(fit: Fit, other: Fit) -> bool:
    """Return whether two fits have the same runs, sensors and laws, and ended at the same shared parameters.

    Args:
        fit: a fitted model.
        other: another one.
    """
    mine, theirs = fit.model, other.model
    same_runs = len(mine.runs) == len(theirs.runs) and all(a is b for a, b in zip(mine.runs, theirs.runs, strict=True))
    same_data = same_runs and mine.forgets == theirs.forgets
    if not same_data or mine.names != theirs.names or mine.sensors != theirs.sensors or fit.law_key != other.law_key:
        return False
    moved = np.abs(fit.theta[: fit.model.n_shared] - other.theta[: other.model.n_shared])
    return bool((moved <= fit.model.settings.fit.same_std * np.maximum(fit.std, other.std)).all())


def turnover_rate(fit: Fit) -> float:
    """Return the largest decay rate of a velocity at rest due to the laws of a fit, 1/s: friction is steep there.

    Args:
        fit: a fitted model.
    """
    model = fit.model
    slopes = np.array([float(suspension.law.gradient(0.0, 0.0)[1]) for suspension in model.interfaces(fit.theta)[0]])
    return float(np.abs(np.linalg.eigvals(model.mobility(fit.theta, 0).accelerance * slopes)).max())


def left_out_ratio(fit: Fit) -> float | None:
    """Return the residual over the noise when each run is predicted by a fit of the others; None without such fits."""
    fits = predict_left_out(fit)
    if fits is None:
        return None
    cost = sum(float(np.sum(each.errors.stacked[: each.n_data] ** 2)) for each in fits)
    return float(np.sqrt(cost / sum(each.n_data for each in fits)))


def predict_left_out(fit: Fit) -> list[Fit] | None:
    """Return the prediction of each run by a fit of the others; None if there are no others, or if a fit fails.

    The initial state of the run that is left out is fitted, and so are its departures from the other runs and the
    clocks of its recorders, with what is known of them. If the other runs have only one loading, the mass stays that
    of the fit of all runs.
    """
    model = fit.model
    if len(model.runs) < 2:
        return None
    promise = model.settings.fit.promise_in_search
    found: list[Fit] = []
    own = fit.theta[model.n_shared :].reshape(len(model.runs), model.n_own)
    try:
        for index, run in enumerate(model.runs):
            others = tuple(each for k, each in enumerate(model.runs) if k != index)
            changed = model.mass_free and loading_changes([each.loading for each in others])
            held, kept = (model, list(range(model.n_shared))) if changed else with_mass_held(fit)
            shared, rest = fit.theta[kept], replace(held, runs=others)
            begun = np.concatenate([shared, np.delete(own, index, axis=0).ravel()])
            without = fit_model(rest, begun, least_promise=promise)
            alone = np.concatenate([without.theta[: rest.n_shared], own[index]])
            clocks = [k for k, each in enumerate(rest.faults, start=rest.first_fault) if each.run == run.number]
            alone[clocks] = shared[clocks]
            free = np.array([*clocks, *range(rest.n_shared, alone.size)])
            found.append(fit_model(replace(rest, runs=(run,)), alone, free=free, least_promise=promise))
    except NO_FIT:
        return None
    return found


def with_mass_held(fit: Fit) -> tuple[Model, list[int]]:
    """Return the model with the mass held at its fitted value, and the indices of the other shared entries."""
    model = fit.model
    held = replace(model, mass_free=False, held_inverse_mass=model.inverse_mass(fit.theta))
    return held, [index for index, name in enumerate(model.names) if name != "inverse_mass"]


def fit_each_run(fit: Fit) -> list[Fit]:
    """Fit the same model to each run alone at a coarse rate; runs that cannot be fitted are left out."""
    found, own = [], fit.theta[fit.model.n_shared :].reshape(len(fit.model.runs), -1)
    held, kept = with_mass_held(fit)
    shared = fit.theta[kept]
    for run, begun in zip(fit.model.runs, own, strict=True):
        alone = replace(held, runs=(run,)).coarse
        try:
            theta = np.concatenate([shared, begun])
            found.append(fit_model(alone, theta, least_promise=held.settings.fit.promise_from_afar))
        except NO_FIT:
            continue
    return found


def runs_contradict_each_other(fit: Fit) -> bool:
    """Return whether runs of one loading are each explained much better alone, which no law and no sensor explains.

    Args:
        fit: the fit of all runs.
    """
    model, known = fit.model, fit.model.settings.faults
    if model.mass_free or len(model.runs) < 2 or fit.ratio <= model.settings.verdicts.doubtful:
        return False
    ratios = [each.ratio for each in fit_each_run(fit)]
    return len(ratios) == len(model.runs) and max(ratios) < known.alone_fraction * fit.ratio


def loading_changes(loadings: Sequence[FloatArray]) -> bool:
    """Return whether any run has another loading than the first.

    Args:
        loadings: mass matrices of what each run carries more than the reference, kg.
    """
    largest = max(float(np.abs(loading).max()) for loading in loadings)
    return any(bool((np.abs(loading - loadings[0]) > 1e-6 * largest).any()) for loading in loadings[1:])


def _with_coordinates_held(model: Model) -> Model:
    """Return the model with coordinates held as stated, so that they cannot compensate for other errors."""
    fraction = model.settings.fit.held_fraction
    held = tuple(replace(each, std=fraction * each.std) for each in model.body.coordinates)
    return replace(model, body=replace(model.body, coordinates=held)) if held else model


def _minimize(
    model: Model,
    theta: FloatArray,
    free: slice | NDArray[np.int64],
    most_evaluations: int,
    least_promise: float,
) -> tuple[FloatArray, Errors | None, int]:
    def evaluate(vector: FloatArray) -> Errors | None:
        try:
            return model.evaluate(vector)
        except NO_FIT:
            return None

    return minimize(
        model,
        evaluate,
        theta,
        free=free,
        most_evaluations=most_evaluations,
        least_promise=least_promise,
        first=model.evaluate,
    )


def minimize(
    model: Model,
    evaluate: Callable[[FloatArray], AnyResidual | None],
    theta: FloatArray,
    *,
    free: slice | NDArray[np.int64],
    most_evaluations: int,
    least_promise: float,
    first: Callable[[FloatArray], AnyResidual] | None = None,
) -> tuple[FloatArray, AnyResidual | None, int]:
    """Return the vector of least squared error of a model, with its bounds, steps and settings.

    Args:
        model: the model.
        evaluate: errors at a vector, and their derivatives; None if there are none.
        theta: the start vector.
        free: the entries that may move.
        most_evaluations: most evaluations.
        least_promise: as in `fit_model`.
        first: replaces `evaluate` at the start, and may raise an error.
    """
    settings = model.settings.fit
    lower, upper = model.bounds()
    return least_squares(
        evaluate,
        theta,
        lower,
        upper,
        model.largest_steps(),
        free=free,
        most_evaluations=most_evaluations,
        least_promise=least_promise,
        negligible_promise=settings.negligible_promise,
        first_damping=settings.first_damping,
        least_damping=settings.least_damping,
        first=first,
    )


def unexplained(fit: Fit) -> tuple[float, ...]:
    """Return, for each run, the rms error of the model's free motion over the rms of the readings, in the band.

    It is infinite if the free motion grows without bound.
    """
    try:
        errors = free_errors(fit)
    except NO_FIT:
        return (np.inf,) * len(fit.model.runs)
    with np.errstate(over="ignore"):  # a free motion may grow beyond any number
        return tuple(float(np.linalg.norm(error) / np.linalg.norm(reading)) for error, reading in errors)


def explains_nothing(fit: Fit) -> bool:
    """Return whether the free motion of a fit leaves so much that none of its numbers can be reported.

    Args:
        fit: a fitted model.
    """
    return float(np.sqrt(np.mean(np.square(unexplained(fit))))) > fit.model.settings.verdicts.refused_fraction


def follows_readings(fit: Fit) -> bool:
    """Return whether the prediction errors of a fit are noise, and small beside the readings.

    Args:
        fit: a fitted model.
    """
    verdicts, model = fit.model.settings.verdicts, fit.model
    read = [model.correct(fit.theta, index)[1].value for index in range(len(model.runs))]
    rms = float(np.sqrt(np.mean([np.var(each, axis=0).mean() for each in read])))
    return fit.ratio <= verdicts.explained and fit.noise_m_per_s2 < verdicts.followed_fraction * rms


def free_errors(fit: Fit) -> list[tuple[ComplexArray, ComplexArray]]:
    """Return, for each run, the lines of the error of the free motion and of the readings, (n_sensors, n_lines).

    Args:
        fit: a fitted model.

    Raises:
        UnboundedResponseError: the free motion grows without bound.
    """
    model, found = fit.model, []
    for index, (run, motion) in enumerate(zip(model.runs, model.simulate(fit.theta), strict=True)):
        read = run.transform(model.correct(fit.theta, index)[1].value.T)
        found.append((read - run.transform(motion.acceleration[:, : len(read)].T), read))
    return found
