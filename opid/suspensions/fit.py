"""The body moved until it predicts every sensor on it from every sensor below its suspensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.signals.recording import FloatArray
from opid.suspensions.equation import Start
from opid.suspensions.law_parameters import from_free, to_free
from opid.suspensions.levenberg_marquardt import LEAST_PROMISE, least_squares
from opid.suspensions.model import BodyModel, Group
from opid.suspensions.one_gear.driven_model import Errors
from opid.suspensions.run import BodyRun
from opid.suspensions.structure import Body, ImpossibleBodyError

# residual over noise up to which a body explains the runs
EXPLAINS = 1.2
# a fit from afar need not be a good one
ON_THE_WAY = 10.0
# places and laws of several suspensions take their time
MOST_EVALUATIONS = 50
# of the tolerance of a place, on the way
HELD = 1e-3
# the step puts a motion of this rate times its length off by two parts in a thousand
FASTEST = 0.7


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A fitted body.

    Args:
        model: that was fitted.
        theta: (n_unknowns,) the vector at the fit.
        errors: at the fit.
        n_evaluations: predictions of all runs that were needed.
    """

    model: BodyModel
    theta: FloatArray
    errors: Errors
    n_evaluations: int

    @property
    def n_data(self) -> int:
        """Real numbers fitted."""
        return 2 * sum(line.size for line in self.errors.lines)

    @property
    def variance(self) -> float:
        """Variance of the whitened errors: 1 if the noise is what was assumed."""
        cost = float(np.sum(self.errors.stacked[: self.n_data] ** 2))
        return cost / max(self.n_data - self.theta.size, 1)

    @property
    def level(self) -> float:
        """Noise that would explain the errors, as white noise of one level on all sensors, m/s^2."""
        return float(np.sqrt(np.mean(np.square(self.model.noise)) * self.variance))

    @cached_property
    def covariance(self) -> FloatArray:
        """(n_unknowns, n_unknowns) of the vector, for errors that are white."""
        n = self.n_data
        # what was known before does not become better or worse known by the size of the errors
        weight = np.concatenate([np.full(n, 1 / self.variance), np.ones(self.errors.stacked.size - n)])
        jacobian = self.errors.jacobian * np.sqrt(weight)[:, np.newaxis]
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        scaled = jacobian / size
        return np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True) / np.outer(size, size)

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978): smaller is better."""
        # known to a tolerance before, a place is no free parameter
        n_free = self.model.n_shared - len(self.model.body.coordinates)
        return float(n_free * np.log(self.n_data) - 2 * self.model.log_likelihood(self.errors))

    def groups(self) -> tuple[Group, ...]:
        """The groups with the fitted laws, per unit of the reference mass."""
        return tuple(
            replace(group, law=from_free(group.law, self.theta[self.model.law_places(number)])[0])
            if group.law.terms
            else group
            for number, group in enumerate(self.model.groups)
        )


def first_vector(model: BodyModel, start: Start) -> FloatArray:
    """Return the vector that start values stand for.

    Args:
        model: with the groups of the start.
        start: of the equation of motion.
    """
    shared: list[float] = []
    springs = list(zip(start.stiffness.tolist(), start.damping.tolist(), strict=True))
    for group, (stiffness, damping) in zip(start.groups, springs, strict=False):
        shared += [stiffness, damping, *to_free(group.law).tolist()]
    for stiffness, damping in springs[len(start.groups) :]:
        shared += [stiffness, damping]
    shared += start.factors.tolist()
    if model.mass_free:
        shared.append(start.inverse_mass or 0.0)
    shared += [0.0] * len(model.body.coordinates)
    # at rest: how a run begins no integrated acceleration tells, its filter has not settled there
    return np.array([*shared, *[0.0] * (2 * model.body.n_interfaces * len(model.runs))])


def fit_body(
    model: BodyModel,
    theta: FloatArray,
    *,
    noisier: Sequence[float] = (),
    hold_places: bool = True,
    free: slice = slice(None),
    most_evaluations: int = MOST_EVALUATIONS,
    least_promise: float = LEAST_PROMISE,
) -> BodyFit:
    """Move a body until it predicts all runs.

    Args:
        model: the body, its runs and laws.
        theta: where to start.
        noisier: falling factors on the noise below the suspensions by which to come nearer from afar: the readings then
            hold the motion to the truth while the parameters are still wrong.
        hold_places: whether coordinates stay as stated on the way.
        free: the entries that may move.
        most_evaluations: predictions of all runs at the most, of each step.
        least_promise: the fit ends when the next step promises less of the squared error over its variance.

    Raises:
        UnboundedResponseError: the start values make a suspension that grows without bound.
        ImpossibleBodyError: the start values make a mass matrix that is not positive definite.
    """
    spent = 0
    for factor in (*noisier, 1.0):
        louder = replace(model, noise=(factor * model.noise[0], model.noise[1]))
        if factor != 1.0 and hold_places:
            louder = replace(louder, body=_with_places_held(model.body))
        promise = least_promise if factor == 1.0 else ON_THE_WAY
        theta, n = _settled(louder, theta, free, most_evaluations, promise)
        spent += n
    return BodyFit(model, theta, model.evaluate(theta), spent + 1)


def with_laws(model: BodyModel, theta: FloatArray, groups: Sequence[Group]) -> tuple[BodyModel, FloatArray]:
    """Return a model with other laws, and the vector at which everything else stays.

    What a dropped or added term does on average goes from or to stiffness and damping.

    Args:
        model: with the laws so far.
        theta: its vector.
        groups: the same groups with other laws.
    """
    changed = replace(model, groups=tuple(groups))
    parts = []
    for number, group in enumerate(groups):
        first = model.first_of_group[number]
        before = model.groups[number].law
        if before.terms:
            before = from_free(before, theta[model.law_places(number)])[0]
        travel, velocity = typical_motion(model, group)
        was = [float(np.mean(slope)) for slope in before.gradient(travel, velocity)]
        now = [float(np.mean(slope)) for slope in group.law.gradient(travel, velocity)]
        parts.append(np.concatenate([theta[first : first + 2] + np.subtract(was, now), to_free(group.law)]))
    first, places = model.first_of_group[-1], model.law_places(len(groups) - 1)
    return changed, np.concatenate([*parts, theta[max(first + 2, places.stop) :]])


def typical_motion(model: BodyModel, group: Group) -> tuple[FloatArray, FloatArray]:
    """Return travel and velocity, (n,) each, as large as those of the interfaces of a group, in all phases.

    Args:
        model: that knows how far they move.
        group: of interfaces.
    """
    travel_rms, velocity_rms = np.sqrt(np.mean(model.motion_rms[list(group.slots)] ** 2, axis=0))
    swing = np.sqrt(2) * np.sin(2 * np.pi * (np.arange(24) + 0.5) / 24)
    travel, velocity = np.meshgrid(travel_rms * swing, velocity_rms * swing)
    return travel.ravel(), velocity.ravel()


def fastest_rate(model: BodyModel, theta: FloatArray) -> float:
    """Return the largest rate of the linear structure, frequency or decay, rad/s or 1/s.

    Args:
        model: the body.
        theta: the vector.

    Raises:
        ImpossibleBodyError: a mass matrix that is not positive definite.
    """
    slots, _ = model.interfaces(theta)
    accelerance = model.mobility(theta, 0).accelerance
    stiffness, damping = (np.array([getattr(slot, name) for slot in slots]) for name in ("stiffness", "damping"))
    zero = np.zeros_like(accelerance)
    system = np.block([[zero, np.eye(len(slots))], [-accelerance * stiffness, -accelerance * damping]])
    return float(np.abs(np.linalg.eigvals(system)).max())


def _with_places_held(body: Body) -> Body:
    """The body with every place where it is stated to be: while all is wrong, places are not to make up for it."""
    held = tuple(replace(coordinate, std=HELD * coordinate.std) for coordinate in body.coordinates)
    return replace(body, coordinates=held)


def _settled(
    model: BodyModel, theta: FloatArray, free: slice, most_evaluations: int, least_promise: float
) -> tuple[FloatArray, int]:
    def evaluate(vector: FloatArray) -> Errors | None:
        try:
            return model.evaluate(vector)
        except (UnboundedResponseError, ImpossibleBodyError):
            return None

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
        first=model.evaluate,
    )


def body_model(
    runs: Sequence[BodyRun],
    body: Body,
    start: Start,
    *,
    mass_free: bool,
    noise_m_per_s2: tuple[float, float],
) -> BodyModel:
    """Return the model that a start stands for.

    Args:
        runs: the runs.
        body: the body.
        start: of the equation of motion.
        mass_free: whether one over the reference mass is fitted.
        noise_m_per_s2: of the sensors below and on the body, m/s^2; their ratio matters.
    """
    return BodyModel(tuple(runs), body, start.groups, mass_free, noise_m_per_s2, start.motion_rms)
