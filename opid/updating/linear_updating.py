"""Phase I: parameters of the linear structure from the lowest points of backbones (Song et al. 2021; 2.1.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Unpack

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import format_percent
from opid.mechanics.structure import modal_assurance
from opid.signals.recording import FloatArray
from opid.updating.likelihood.linear import LinearData, LinearErrors, linear_data, log_posterior, mean_eigenvalue
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import Prior
from opid.updating.result import LinearMode, LinearPosterior
from opid.updating.sampling.chains import Chain, LogDensity, diagnose, estimates_of, find_pressures, spread_starts
from opid.updating.sampling.evidence import (
    Evidence,
    Maximum,
    Support,
    importance,
    maximum_a_posteriori,
    quadrature,
)
from opid.updating.sampling.samplers import metropolis
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import lowest_modes, ritz_model

_WIDEST_LOGNORMAL = 20.0  # standard deviation of the logarithm of a factor of stiffness


def update_linear(
    structure: AffineStructure,
    backbones: Sequence[MeasuredBackbone],
    *,
    priors: Mapping[str, Prior],
    rng: np.random.Generator,
    n_chains: int = 4,
    n_samples: int = 1000,
    n_warm_up: int = 200,
    name: str = "",
    progress: Callable[[float], None] | None = None,
    **errors: Unpack[LinearErrors],
) -> LinearPosterior:
    """Return the parameters of the linear structure given the lowest point of every backbone (Song section 4.1).

    Adaptive Metropolis chains begin around the maximum a posteriori, with its curvature for their first jumps.

    Args:
        structure: the finite-element structure.
        backbones: measured backbones; modes are counted from the lowest one of the structure, rigid ones included.
        priors: priors of the parameters to update, by name; a part of the stiffness that is left out stays at 1.
        rng: source of chance.
        n_chains: number of chains.
        n_samples: number of samples that are kept of each chain.
        n_warm_up: number of samples that are dropped of each chain before them.
        name: name of the class of parameters, where several are compared.
        progress: a function that is called with the fraction that is done.
        errors: errors of the points, as far as they are known, see `LinearErrors`: `cov`, `weight`, `shape_std`,
            `shape_factor`, `common_error`.

    Raises:
        InputError: no backbone, sensors that do not fit, errors that are not known or not positive; a prior of an
            unknown parameter, or one that allows nothing above 0.
        NotDeterminedError: the data do not determine a parameter.
    """
    data = linear_data(structure, backbones, **errors)
    modes = [each.mode for each in data]
    model = ritz_model(structure, box=_make_prior_box(structure, priors), modes=modes)
    density = log_posterior(data, model, priors)
    ordered = [priors[name] for name in model.names]
    support = [(max(low, 0.0), high) for low, high in (prior.support for prior in ordered)]
    draws = np.column_stack([prior.sample(200, rng) for prior in ordered])
    peak = _find_peak(density, draws, support)
    start = spread_starts(density, peak.theta, peak.covariance_inside, n_chains=n_chains, rng=rng)
    chain = metropolis(
        density,
        start,
        covariance=peak.covariance_inside,
        n_samples=n_samples,
        n_warm_up=n_warm_up,
        rng=rng,
        progress=progress,
    )
    diagnostics = diagnose(chain)
    table = _make_mode_table(structure, data, dict(zip(model.names, peak.theta.tolist(), strict=True)))
    warnings = [
        f"{model.names[pressure.parameter - 1]} {pressure.sentence}"
        for pressure in find_pressures(chain.pooled, ordered)
    ]
    if diagnostics.r_hat > UPDATING.unmixed_r_hat:
        warnings.append(
            f"the chains of the linear parameters have not mixed (R-hat {diagnostics.r_hat:.2f}): take more samples"
        )
    return LinearPosterior(
        names=model.names,
        best=peak.theta,
        estimates=estimates_of(chain, model.names),
        covariance=chain.covariance,
        samples=chain.pooled,
        modes=table,
        diagnostics=diagnostics,
        warnings=(*warnings, *_list_warnings(data, table, errors)),
        chain=chain,
        name=name,
        evidence=_find_evidence(density, chain, support, rng),
    )


def _find_evidence(density: LogDensity, chain: Chain, support: Support, rng: np.random.Generator) -> Evidence | None:
    """Return the evidence of the parameters, by quadrature where they are few enough; None where no method has one."""
    try:
        if chain.n_parameters > UPDATING.most_by_quadrature:
            return importance(density, chain, rng=rng)
        most = UPDATING.most_nodes if chain.n_parameters < 3 else UPDATING.most_nodes_of_three
        return quadrature(
            density, chain.pooled.mean(axis=0), chain.covariance, support=support, tolerance=1e-3, max_evaluations=most
        )
    except NotDeterminedError:
        return None


def _find_peak(density: LogDensity, draws: FloatArray, support: Support) -> Maximum:
    """Return the maximum a posteriori, searched from the best of the draws, then from others if that one fails."""
    ranked = draws[np.argsort(-density(draws), kind="stable")]
    for start in ranked[: UPDATING.most_starts - 1]:
        try:
            return maximum_a_posteriori(density, start, support=support, tolerance=UPDATING.peak_tolerance)
        except NotDeterminedError:
            continue
    return maximum_a_posteriori(
        density, ranked[UPDATING.most_starts - 1 :], support=support, tolerance=UPDATING.peak_tolerance
    )


def _make_prior_box(structure: AffineStructure, priors: Mapping[str, Prior]) -> dict[str, tuple[float, float]]:
    box, far = {}, UPDATING.prior_reach
    for name, prior in priors.items():
        if name not in structure.parts:
            known = nearest(name, structure.parts) if structure.parts else "the structure has no part to update"
            raise InputError(f"there is a prior for {name!r}, which is not a parameter: {known}")
        low, high = prior.support
        if prior.family == "normal":
            low, high = prior.first - far * prior.second, prior.first + far * prior.second
        if prior.family == "lognormal":
            if prior.second > _WIDEST_LOGNORMAL:
                raise InputError(
                    f"the prior of {name!r} has a standard deviation of {prior.second:g} of the logarithm: give at "
                    f"most {_WIDEST_LOGNORMAL:g}, with which it reaches over tens of decades"
                )
            low, high = (prior.first * np.exp(side * far * prior.second) for side in (-1, 1))
        if high <= 0:
            raise InputError(f"the prior of {name!r} allows nothing above 0: a factor of stiffness is positive")
        box[name] = (max(low, UPDATING.least_ratio * high), high)
    return box


def _make_mode_table(
    structure: AffineStructure, data: Sequence[LinearData], best: Mapping[str, float]
) -> tuple[LinearMode, ...]:
    """Return frequencies and MAC of the full structure before and after the updating (Song Table 2)."""
    n_modes = max(each.mode for each in data)
    found = []
    for factors in ({}, best):
        eigenvalue, shapes = lowest_modes(structure.mass, structure.stiffness_at(factors), n_modes)
        found.append((np.sqrt(np.maximum(eigenvalue, 0.0)) / (2 * np.pi), shapes[structure.sensor_indices]))
    table = []
    for each in data:
        mode = each.mode - 1
        before, after = (_find_assurance(each, shapes[each.rows, mode]) for _, shapes in found)
        identified = float(np.sqrt(each.eigenvalue).mean() / (2 * np.pi))
        initial, updated = (float(hz[mode]) for hz, _ in found)
        shape = found[0][1][each.rows, mode]
        table.append(LinearMode(each.mode, identified, initial, updated, before, after, shape))
    return tuple(table)


def _find_assurance(data: LinearData, shape: FloatArray) -> float:
    """Return the mean MAC of the measured shapes of a mode with one of the structure, over the sensors of each."""
    each = [modal_assurance(own[seen], shape[seen]) for own, seen in zip(data.shapes, data.seen, strict=True)]
    return float(np.mean(each))


def _list_warnings(data: Sequence[LinearData], table: Sequence[LinearMode], errors: LinearErrors) -> list[str]:
    warnings, cov = [], errors.get("cov", "scatter")
    for each, row in zip(data, table, strict=True):
        mode, n_sets = f"mode {each.mode}", each.eigenvalue.size
        mean, std = mean_eigenvalue(each)
        given = cov.get(each.mode, "scatter") if isinstance(cov, Mapping) else cov
        if n_sets < UPDATING.few_sets and given == "scatter":
            warnings.append(
                f"the scatter of {mode} is estimated from only {n_sets} curves: measure more, give cov, or take the "
                "recommended form, which infers it"
            )
        missed = ((2 * np.pi * row.updated_hz) ** 2 - mean) / std
        if abs(missed) > UPDATING.missed_sigma:
            warnings.append(
                f"the updated {mode} lies at {row.updated_hz:.4g} Hz, {abs(missed):.1f} standard deviations from the "
                f"measured {row.identified_hz:.4g} Hz: the structure has an error that its parameters cannot correct; "
                "update other parts of its stiffness, or check its mass"
            )
        if row.updated_mac < UPDATING.poor_mac:
            warnings.append(
                f"the shape of the updated {mode} is not the measured one (MAC {row.updated_mac:.2f}): check whether "
                "the curves are of another mode, and check the names and signs of the sensors"
            )
        # This part is in the deviation where the model has an error.
        others = float(np.sqrt(max(std**2 - (each.common_std > 0) * each.nonlinear_part**2, 0.0)))
        if abs(each.nonlinear_part) > UPDATING.moved_sigma * others:
            fraction = format_percent(abs(each.nonlinear_part) / mean / 2, 2)
            warnings.append(
                f"the lowest points of {mode} lie {fraction} from the frequency to which their curves extrapolate at "
                "amplitude 0, which is more than their other errors: measure at smaller amplitudes, or update the "
                "structure together with the laws (joint = true)"
            )
    return warnings
