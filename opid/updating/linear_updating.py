"""Phase I: parameters of the linear structure from the lowest points of backbones (Song et al. 2021; 2.1.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.likelihood.linear import Cov, LinearData, ShapeStd, linear_data, log_posterior, mean_eigenvalue
from opid.updating.model_class import Prior
from opid.updating.result import LinearMode, LinearPosterior
from opid.updating.sampling.chains import LogDensity, spread_starts
from opid.updating.sampling.diagnostics import diagnose, presses_against
from opid.updating.sampling.maximum import Maximum, Support, maximum_a_posteriori
from opid.updating.sampling.metropolis import adaptive_metropolis
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import lowest_modes
from opid.updating.structure.ritz import ritz_model

LEAST_RATIO = 0.01
"""Of the upper end of a prior: where its lower end is 0, the Ritz vectors serve from there."""
FAR = 5.0
"""Standard deviations of a prior without an end to which the Ritz vectors serve."""
FEW_SETS = 4
"""With fewer curves of a mode their scatter is a poor estimate."""
PEAK = 1e-6
"""How much the log density of the best parameters may be short of its maximum: far above its rounding, 1e-9."""
MOST_STARTS = 5
"""Draws of the prior that the search for the maximum may begin at."""
UNMIXED = 1.1
"""R-hat above which the chains are not to be trusted."""
MISFIT = 3.0
"""Standard deviations by which the updated eigenvalue may miss the mean of the measured ones."""
POOR_MAC = 0.8
"""MAC of the updated shape with the measured ones below which they are hardly of one mode."""
MOVED = 1.0
"""Standard deviations of the mean by which the lowest points may lie off the linear frequency of their curves."""


def update_linear(
    structure: AffineStructure,
    backbones: Sequence[MeasuredBackbone],
    *,
    priors: Mapping[str, Prior],
    rng: np.random.Generator,
    cov: Cov = "scatter",
    weights: Mapping[int, float] | None = None,
    shape_std: ShapeStd = "paper",
    shape_factor: float | None = None,
    common_error: float = 0.0,
    n_chains: int = 4,
    n_samples: int = 1000,
    n_warm_up: int = 200,
    progress: Callable[[float], None] | None = None,
) -> LinearPosterior:
    """Return the parameters of the linear structure given the lowest point of every backbone (Song section 4.1).

    Adaptive Metropolis chains begin around the maximum a posteriori, with its curvature for their first jumps.

    Args:
        structure: the finite-element structure.
        backbones: measured; modes are counted from the lowest one of the structure, rigid ones included.
        priors: of the parameters to update, by name; a part of the stiffness that is left out stays at 1.
        rng: source of chance.
        cov: see `linear_data`.
        weights: see `linear_data`.
        shape_std: see `linear_data`.
        shape_factor: see `linear_data`.
        common_error: relative error of a linear frequency of the model, which all curves of its mode share: see
            `linear_data`. Without it (0, the paper's form) the intervals hold only what makes curves differ.
        n_chains: chains.
        n_samples: kept of each.
        n_warm_up: dropped of each before them.
        progress: called with the share that is done.

    Raises:
        InputError: see `linear_data`; a prior of an unknown parameter, or one that allows nothing above 0.
        NotDeterminedError: the data do not tell a parameter.
    """
    data = linear_data(
        structure, backbones, cov=cov, weights=weights, shape_std=shape_std, shape_factor=shape_factor,
        common_error=common_error,
    )  # fmt: skip
    modes = [each.mode for each in data]
    model = ritz_model(structure, box=_prior_box(structure, priors), modes=modes)
    density = log_posterior(data, model, priors)
    ordered = [priors[name] for name in model.names]
    support = [(max(low, 0.0), high) for low, high in (prior.support for prior in ordered)]
    draws = np.column_stack([prior.sample(200, rng) for prior in ordered])
    peak = _peak(density, draws, support)
    start = spread_starts(density, peak.theta, peak.covariance_inside, n_chains=n_chains, rng=rng)
    chain = adaptive_metropolis(
        density,
        start,
        covariance=peak.covariance_inside,
        n_samples=n_samples,
        n_warm_up=n_warm_up,
        rng=rng,
        progress=progress,
    )
    samples = chain.pooled
    diagnostics = diagnose(chain)
    table = _mode_table(structure, data, dict(zip(model.names, peak.theta.tolist(), strict=True)))
    warnings = [
        pressure.sentence.replace(f"theta_{pressure.parameter}", model.names[pressure.parameter - 1], 1)
        for pressure in presses_against(samples, ordered)
    ]
    if diagnostics.r_hat > UNMIXED:
        warnings.append(
            f"the chains of the linear parameters have not mixed (R-hat {diagnostics.r_hat:.2f}): take more samples"
        )
    return LinearPosterior(
        names=model.names,
        best=peak.theta,
        estimates={name: _estimate(column) for name, column in zip(model.names, samples.T, strict=True)},
        covariance=np.atleast_2d(np.cov(samples, rowvar=False)),
        samples=samples,
        modes=table,
        diagnostics=diagnostics,
        warnings=(*warnings, *_doubts(data, table, backbones, cov)),
        chain=chain,
    )


def _peak(density: LogDensity, draws: FloatArray, support: Support) -> Maximum:
    """The maximum a posteriori, from the best of the draws; from others where that one leads nowhere."""
    ranked = draws[np.argsort(-density(draws), kind="stable")]
    for start in ranked[: MOST_STARTS - 1]:
        try:
            return maximum_a_posteriori(density, start, support=support, tolerance=PEAK)
        except NotDeterminedError:
            continue
    return maximum_a_posteriori(density, ranked[MOST_STARTS - 1 :], support=support, tolerance=PEAK)


def _prior_box(structure: AffineStructure, priors: Mapping[str, Prior]) -> dict[str, tuple[float, float]]:
    """Where each prior allows its parameter to be, above 0."""
    box = {}
    for name, prior in priors.items():
        if name not in structure.parts:
            known = nearest(name, structure.parts) if structure.parts else "the structure has no part to update"
            raise InputError(f"there is a prior for {name!r}, which is no parameter: {known}")
        low, high = prior.support
        if prior.family == "normal":
            low, high = prior.first - FAR * prior.second, prior.first + FAR * prior.second
        if prior.family == "lognormal":
            low, high = (prior.first * np.exp(side * FAR * prior.second) for side in (-1, 1))
        if high <= 0:
            raise InputError(f"the prior of {name!r} allows nothing above 0: a factor of stiffness is positive")
        box[name] = (max(low, LEAST_RATIO * high), high)
    return box


def _estimate(column: FloatArray) -> Estimate:
    low, high = np.quantile(column, [0.025, 0.975])
    return Estimate(float(column.mean()), float(column.std(ddof=1)), (float(low), float(high)))


def _mode_table(
    structure: AffineStructure, data: Sequence[LinearData], best: Mapping[str, float]
) -> tuple[LinearMode, ...]:
    """Frequencies and MAC of the full structure before and after (Song Table 2)."""
    n_modes = max(each.mode for each in data)
    places = structure.sensor_places
    found = []
    for factors in ({}, best):
        eigenvalue, shapes = lowest_modes(structure.mass, structure.stiffness_at(factors), n_modes)
        found.append((np.sqrt(np.maximum(eigenvalue, 0.0)) / (2 * np.pi), shapes[places]))
    table = []
    for each in data:
        mode = each.mode - 1
        units = [shapes[each.rows, mode] / np.linalg.norm(shapes[each.rows, mode]) for _, shapes in found]
        before, after = (float(np.mean((each.shapes @ unit) ** 2)) for unit in units)
        identified = float(np.sqrt(each.eigenvalue).mean() / (2 * np.pi))
        initial, updated = (float(hz[mode]) for hz, _ in found)
        table.append(LinearMode(each.mode, identified, initial, updated, before, after))
    return tuple(table)


def _doubts(
    data: Sequence[LinearData],
    table: Sequence[LinearMode],
    backbones: Sequence[MeasuredBackbone],
    cov: Cov,
) -> list[str]:
    """What to doubt: a poor estimate of scatter, a mode or a shape that is missed, lowest points that are nonlinear."""
    doubts = []
    for each, row in zip(data, table, strict=True):
        mode, n_sets = f"mode {each.mode}", each.eigenvalue.size
        mean, std = mean_eigenvalue(each)
        given = cov.get(each.mode, "scatter") if isinstance(cov, Mapping) else cov
        if n_sets < FEW_SETS and given == "scatter":
            doubts.append(
                f"the scatter of {mode} is estimated from {n_sets} curves: measure more, give cov, or take the "
                "recommended form, which infers it"
            )
        missed = ((2 * np.pi * row.updated_hz) ** 2 - mean) / std
        if abs(missed) > MISFIT:
            doubts.append(
                f"the updated {mode} lies at {row.updated_hz:.4g} Hz, {abs(missed):.1f} standard deviations from the "
                f"measured {row.identified_hz:.4g} Hz: the structure has an error that its parameters cannot mend"
            )
        if row.updated_mac < POOR_MAC:
            doubts.append(
                f"the shape of the updated {mode} is not the measured one (MAC {row.updated_mac:.2f}): look whether "
                "the curves are of another mode, and at the names and signs of the sensors"
            )
        moved = float(np.mean([_nonlinear_part(c) for c in backbones if c.mode == each.mode])) / std
        if abs(moved) > MOVED:
            doubts.append(
                f"the lowest points of {mode} lie {abs(moved):.1f} standard deviations from the frequency that their "
                "curves point to at amplitude 0: measure at smaller amplitudes"
            )
    return doubts


def _nonlinear_part(curve: MeasuredBackbone) -> float:
    """Eigenvalue at the lowest point less that at amplitude 0, by a line in the square of the amplitude."""
    square = (curve.controlled_amplitude / curve.controlled_amplitude[0]) ** 2
    near = slice(0, max(3, np.count_nonzero(square <= 9)))
    return float(np.polyfit(square[near], curve.eigenvalue[near], 1)[0])
