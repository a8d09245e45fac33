"""The affine-invariant ensemble sampler of emcee, as one more sampler."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, require
from opid.signals.recording import FloatArray
from opid.updating.sampling.chains import Chain, LogDensity, Progress, as_count, evaluate, starting_densities


def require_emcee() -> None:
    """Refuse before long work what emcee could not do after it.

    Raises:
        InputError: emcee is not installed.
    """
    require("emcee", "the ensemble sampler", "emcee", "ensemble")


def ensemble(
    log_density: LogDensity,
    start: ArrayLike,
    *,
    n_samples: int,
    n_warm_up: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Chain:
    """Return the walkers of emcee's stretch move (Goodman & Weare 2010; Foreman-Mackey et al. 2013), one chain each.

    The walkers steer by each other: no covariance has to be known, and the scales of the parameters do not matter.

    Args:
        log_density: (n, n_parameters) -> (n,), of the posterior up to a constant; -inf outside the support.
        start: (n_walkers, n_parameters), all different; an even number, at least twice the parameters.
        n_samples: kept of each walker.
        n_warm_up: dropped of each walker before them.
        rng: source of chance; the same one in the same state gives the same chains to the last bit.
        progress: called with the share that is done.

    Raises:
        InputError: a start outside the support, too few walkers or all in one plane, a log density of another shape or
            not a number, counts that are not positive, or emcee is not installed.

    >>> rng = np.random.default_rng(1)
    >>> chain = ensemble(lambda t: -0.5 * np.sum(t**2, axis=1), rng.standard_normal((8, 2)), n_samples=500,
    ...                  n_warm_up=100, rng=rng)
    >>> chain.samples.shape
    (8, 500, 2)
    """
    require_emcee()
    import emcee

    kept, dropped = as_count(n_samples, "n_samples", least=1), as_count(n_warm_up, "n_warm_up", least=0)
    rows, value = starting_densities(log_density, start)
    n_walkers, n_parameters = rows.shape
    if n_walkers < 2 * n_parameters or n_walkers % 2:
        raise InputError(
            f"{n_walkers} walker(s) for {n_parameters} parameter(s): give an even number of at least {2 * n_parameters}"
        )
    scatter = rows - rows.mean(axis=0)
    size = np.abs(scatter).max(axis=0)
    if not size.all() or np.linalg.matrix_rank(scatter / size, tol=1e-6) < n_parameters:
        raise InputError("the walkers start in one plane and never leave it: scatter them in every parameter")
    counted = [n_walkers]

    def checked(theta: FloatArray) -> FloatArray:
        counted[0] += len(theta)
        return evaluate(log_density, theta)

    sampler = emcee.EnsembleSampler(n_walkers, n_parameters, checked, vectorize=True)
    chance = np.random.RandomState(np.random.MT19937(int(rng.integers(2**63))))  # the only kind emcee takes
    state = emcee.State(rows, log_prob=value, random_state=chance.get_state())
    total = dropped + kept
    for step, _ in enumerate(sampler.sample(state, iterations=total, skip_initial_state_check=True), start=1):
        if progress and (step % 50 == 0 or step == total):
            progress(step / total)
    samples = np.ascontiguousarray(sampler.get_chain(discard=dropped).transpose(1, 0, 2))
    # a proposal is never exactly where its walker was
    moved = np.any(np.diff(samples, axis=1) != 0, axis=2)
    return Chain(
        samples=samples,
        log_density=np.ascontiguousarray(sampler.get_log_prob(discard=dropped).T),
        acceptance=float(moved.mean()) if kept > 1 else float(np.mean(sampler.acceptance_fraction)),
        n_evaluations=counted[0],
        sampler="ensemble",
        n_warm_up=dropped,
    )
