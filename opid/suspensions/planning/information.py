"""Fisher information of planned runs: how well the estimator will know its unknowns, before anything is recorded.

A run adds J^T J to the information, where J holds the derivatives of the whitened prediction errors by the unknowns
(Ljung 1999, section 7.4). At the guessed parameters the readings are those that the model predicts from the motion
below the suspensions. A simulated or recorded motion is therefore enough, and the run may have any loading. Information
adds over runs, and grows in proportion to time:

    I(T) = T/T0 (J_s^T J_s - J_s^T J_0 (J_0^T J_0 + P_0)^-1 J_0^T J_s)

J_0 and P_0 are the derivatives by the state at the first sample and the information of its prior, J_s the derivatives
by all other unknowns, and T0 is the duration of the given motion. In 20 s the unknown state takes away less than 1 % of
the information, unless the spring is so hard that the motion depends on the state forever; then it takes away the same
fraction of a run of any length. The other unknowns are those that all runs share, and those of the run: the faults of
sensors that differ from run to run (gains of forces, clocks), and the departures of springs, damping and friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

from opid.signals.recording import FloatArray
from opid.suspensions.answer.intervals import Parameters
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.fitting.repeatability import Levels, weigh_levels
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.unknowns import compare_with_prior
from opid.suspensions.sensor_facts import Fault, Side

# A direction about which the runs tell nothing has this information, over that of each entry alone: its standard
# deviation is then beyond all that is reported.
_NOTHING = 1e-11


def measure_information(fit: Fit, motion: int, *, loading: FloatArray, road_factor: float = 1.0) -> FloatArray:
    """Return the information that a run gains in each second if it repeats the motion below the suspensions of another.

    Args:
        fit: model, noise and parameters.
        motion: index of the run of the fit whose motion below the suspensions is repeated.
        loading: (n_dof, n_dof) mass matrix of what the run carries more than the reference, kg.
        road_factor: factor on that motion.

    Returns:
        (n, n) for the shared unknowns, then the faults of `faults_of_a_run`, then the departures of the run. The shared
        unknowns keep rows of zeros for the faults that differ from run to run.

    Raises:
        UnboundedResponseError: springs that cannot carry the loading, or a motion that grows without bound.
    """
    model, recorded = fit.model, fit.model.runs[motion]
    run = replace(
        recorded,
        unsprung=road_factor * recorded.unsprung,
        drive_step_m_per_s2=road_factor * recorded.drive_step_m_per_s2,
        loading=loading,
        error_level=1.0,
    )
    planned = replace(
        model,
        runs=(run,),
        repeatability=model.settings.repeatability.usual,
        motion_rms=road_factor * model.motion_rms,
        forgets=model.slips,
    )
    theta = np.concatenate([fit.theta[: model.n_shared], np.zeros(planned.n_own)])
    for index, fault in enumerate(model.faults, start=model.first_fault):
        theta[index] = fault.nominal
    start, departures = planned.indices_of_run(0)
    theta[start] = road_factor * fit.theta[model.indices_of_run(motion)[0]]
    planned = replace(planned, runs=(replace(run, sprung=_predict_readings(planned, theta)),))
    errors = planned.evaluate(theta)
    n_data = 2 * sum(line.size for line in errors.lines)
    jacobian = np.sqrt(planned.compared_fraction) * errors.jacobian[:n_data]
    shared, kinds = jacobian[:, : model.n_shared].copy(), list(faults_of_a_run(model))
    own = np.zeros((n_data, len(kinds)))
    for index, fault in enumerate(model.faults, start=model.first_fault):
        if fault.run is not None:
            shared[:, index] = 0.0
        if fault.run == run.number:
            own[:, kinds.index(_kind_of(fault))] = jacobian[:, index]
    others = np.concatenate([shared, own, jacobian[:, departures]], axis=1)
    at_start, duration_s = jacobian[:, start], run.n_samples / run.fs
    prior = compare_with_prior(planned, theta, is_held=False)[1][:, start]
    both = at_start.T @ others
    lost = both.T @ linalg.solve(at_start.T @ at_start + prior.T @ prior, both, assume_a="pos")
    return np.asarray((others.T @ others - lost) / duration_s)


def faults_of_a_run(model: Model) -> dict[tuple[str, Side, int], Fault]:
    """Return the faults of sensors that differ from run to run by kind, side and channel: any run has one of each."""
    return {_kind_of(fault): fault for fault in model.faults if fault.run is not None}


def _kind_of(fault: Fault) -> tuple[str, Side, int]:
    return fault.kind, fault.side, fault.channel


def _predict_readings(model: Model, theta: FloatArray) -> FloatArray:
    """Return the readings on the body that the model predicts for its only run, as AC-coupled sensors record them."""
    run, (prediction,) = model.runs[0], model.simulate(theta)
    readings = prediction.acceleration[:, : len(model.sensors.sprung)].copy()
    for channel, facts in enumerate(model.sensors.sprung):
        if facts.corner_hz:
            coupling = signal.butter(1, facts.corner_hz, "highpass", fs=run.fs)
            readings[:, channel] = signal.lfilter(*coupling, readings[:, channel])
    return readings


def known_beforehand(fit: Fit) -> FloatArray:
    """Return the information of the priors of the shared unknowns, (n_shared, n_shared)."""
    by_prior = compare_with_prior(fit.model, fit.theta, is_held=False)[1][:, : fit.model.n_shared]
    return np.asarray(by_prior.T @ by_prior)


@dataclass(frozen=True, eq=False)
class Expectation:
    """What an identification of planned runs will know of the shared unknowns.

    Args:
        information: (n_shared, n_shared) information of runs and priors, the unknowns of each run eliminated under
            their prior.
        cases: the parameters with the covariance that an identification will state: one for each draw of how the runs
            happen to differ, a single one for runs that are alike.
    """

    information: FloatArray
    cases: tuple[Parameters, ...]


def expect(
    reference: Fit,
    runs: Sequence[FloatArray],
    *,
    repeatability: float,
    actual: float,
    std_factors: FloatArray,
    n_draws: int,
    rng: np.random.Generator,
) -> Expectation:
    """Return what an identification of planned runs will know.

    If several runs may differ, each case draws the departures of their suspensions and the noise, and weighs the
    possible values of the repeatability as an identification does (`opid.suspensions.fitting.repeatability`).

    Args:
        reference: a fit of one run, whose parameters are the guessed ones.
        runs: (n, n) information of each run, that of `measure_information` times its duration.
        repeatability: relative standard deviation of springs, damping and friction from run to run, which the study
            will state.
        actual: relative standard deviation by which they really differ.
        std_factors: (n_unknowns of the reference,) factors of the standard deviations for a coloured residual.
        n_draws: number of cases if several runs may differ.
        rng: source of the draws.
    """
    model, n_shared = reference.model, reference.model.n_shared
    n_own = len(runs[0]) - n_shared
    n = n_shared + n_own * len(runs)
    gram, free, stds, gains = np.zeros((n, n)), np.arange(n) >= n_shared, np.zeros(n), dict[int, float]()
    gram[:n_shared, :n_shared] = known_beforehand(reference)
    for index, run in enumerate(runs):
        first = n_shared + index * n_own
        rows = np.r_[:n_shared, first : first + n_own]
        gram[np.ix_(rows, rows)] += run
        for row, fault in enumerate(faults_of_a_run(model).values(), start=first):
            free[row], stds[row] = False, fault.std
            if fault.kind == "gain":
                gains[row] = fault.std
            else:
                gram[row, row] += fault.std**-2.0
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    scaled = gram / np.outer(size, size) + _NOTHING * np.eye(n)
    of_gains = np.zeros(n)
    of_gains[list(gains)] = [std**-2.0 for std in gains.values()]
    if not repeatability or len(runs) == 1:
        held = np.flatnonzero(~free)
        inside = (scaled + np.diag(of_gains / size**2))[np.ix_(held, held)]
        covariance = (np.linalg.inv(inside) / np.outer(size[held], size[held]))[:n_shared, :n_shared]
        widened = _fill(covariance, reference.theta.size) * np.outer(std_factors, std_factors)
        return Expectation(_eliminate(gram + np.diag(of_gains), held, n_shared), (Parameters(reference, widened),))
    departures = np.zeros((n, n_draws))
    departures[n_shared:] = rng.standard_normal((n - n_shared, n_draws))
    departures *= np.where(free, actual, stds)[:, np.newaxis]
    # The gradient of the squared errors has the information as its covariance.
    sizes, directions = np.linalg.eigh(scaled)
    noise = (directions * np.sqrt(np.maximum(sizes, 0.0))) @ rng.standard_normal((n, n_draws))
    along = scaled @ (departures * size[:, np.newaxis]) + noise
    cases = []
    settings = model.settings.repeatability
    for found in weigh_levels(scaled, along, np.zeros(n), size, free, repeatability, settings, gains):
        # The fit is at the best vector for the median of the repeatability.
        best = found.moved[found.at_median]
        shared = Levels(
            found.repeatability,
            found.gains_differ,
            found.weight,
            _fill((found.moved - best)[:, :n_shared], reference.theta.size),
            _fill(found.covariance[:, :n_shared, :n_shared], reference.theta.size),
        ).widen(std_factors)
        cases.append(Parameters(reference, shared.second_moments(), shared))
    inside = gram + np.diag(np.where(free, repeatability**-2.0, of_gains))
    return Expectation(_eliminate(inside, np.arange(n), n_shared), tuple(cases))


def _eliminate(information: FloatArray, held: NDArray[np.int64], n_shared: int) -> FloatArray:
    """Return the information of the shared unknowns, of some unknowns that begin with them."""
    inside, own = information[np.ix_(held, held)], slice(n_shared, held.size)
    both = inside[own, :n_shared]
    return np.asarray(inside[:n_shared, :n_shared] - both.T @ linalg.solve(inside[own, own], both, assume_a="pos"))


def _fill(shared: FloatArray, n_unknowns: int) -> FloatArray:
    """Return an array over the shared unknowns as one over all, with zeros, along its last axis or its last two."""
    n_more, is_matrix = n_unknowns - shared.shape[-1], shared.shape[-1] == shared.shape[-2]
    before = [(0, 0)] * (shared.ndim - 1 - is_matrix)
    return np.pad(shared, [*before, *([(0, n_more)] * (1 + is_matrix))])
