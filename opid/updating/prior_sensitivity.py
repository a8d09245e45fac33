"""How the evidence of a class changes with its priors twice as wide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from opid.errors import NotDeterminedError
from opid.signals.recording import FloatArray
from opid.updating.model_class import ModelClass, Prior
from opid.updating.sampling.chains import LogDensity
from opid.updating.sampling.diagnostics import presses_against
from opid.updating.sampling.evidence import laplace
from opid.updating.sampling.maximum import maximum_a_posteriori


def prior_sensitivity(
    likelihood: LogDensity, model_class: ModelClass, samples: FloatArray, best: FloatArray
) -> dict[str, float]:
    """Return the change of the log evidence with each prior twice as wide, by parameter: "theta_1", "theta_2", ...

    Args:
        likelihood: theta (n, n_parameters) -> (n,), logarithm of p(D | theta).
        model_class: the class.
        samples: (n_samples, n_parameters) of its posterior.
        best: (n_parameters,) maximum a posteriori.
    """
    pressed = {each.parameter for each in presses_against(samples, model_class.priors)}
    found = {}
    for k, prior in enumerate(model_class.priors):
        wide = wider(prior)
        if k + 1 not in pressed or prior.family != "uniform":
            # what the wide prior adds outside the narrow one is nothing here: a mean over the samples
            ratio = wide.log_density(samples[:, k]) - prior.log_density(samples[:, k])
            change = float(np.logaddexp.reduce(ratio) - np.log(len(ratio)))
        else:
            change = _change_beyond(likelihood, model_class, k, wide, best)
        found[f"theta_{k + 1}"] = change
    return found


def _change_beyond(likelihood: LogDensity, model_class: ModelClass, k: int, wide: Prior, best: FloatArray) -> float:
    """The same by two Laplace approximations, where the posterior goes on beyond the narrow prior; nan if it fails."""
    priors = (*model_class.priors[:k], wide, *model_class.priors[k + 1 :])
    both = (model_class, replace(model_class, priors=priors))
    values = []
    for each in both:

        def posterior(theta: FloatArray, each: ModelClass = each) -> FloatArray:
            value = each.log_prior(theta)
            inside = np.isfinite(value)
            if inside.any():
                value[inside] += likelihood(theta[inside])
            return value

        support = [prior.support for prior in each.priors]
        try:
            values.append(laplace(maximum_a_posteriori(posterior, best, support=support), support=support).log_evidence)
        except NotDeterminedError:
            return float("nan")
    return values[1] - values[0]


def wider(prior: Prior) -> Prior:
    """Return the prior twice as wide about the same centre.

    Args:
        prior: any family.

    >>> wider(Prior("uniform", 0.0, 10.0))
    Prior(family='uniform', first=-5.0, second=15.0)
    """
    if prior.family == "uniform":
        half = (prior.second - prior.first) / 2
        return Prior("uniform", prior.first - half, prior.second + half)
    return Prior(prior.family, prior.first, 2 * prior.second)
