"""Search for the law by sparse regression: few terms of a library that explain the force on the reconstructed motion.

This is the second method beside the pursuit (`opid.suspensions.law_search.pursuit`). pysindy's optimisers (Brunton et
al. 2016; Zheng et al. 2019; Boninsegna et al. 2018; Billings 2013) work on the travel and velocity that the fitted
model predicts, and not on integrated accelerations. Stiffness and damping are always present: they are projected out of
the columns of the other terms, which are scaled to the same rms. Inner scales and the choice of terms are updated in
turn. The best proposed laws are then fitted by the driven model, as those of the pursuit are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from opid.mechanics.laws.law import LAWS, LINEAR, Law, default_law
from opid.mechanics.memory import Motion
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.fitting.least_squares import fit_separable, start_laws
from opid.suspensions.law_search.driven import DrivenLaws
from opid.suspensions.law_search.force_surface import ForcePoints, force_points
from opid.suspensions.law_search.pursuit import LawStep, is_better
from opid.suspensions.settings import RegressionSettings


def search_by_regression(
    problem: DrivenLaws,
    start: Fit,
    *,
    kinds: Sequence[str],
    method: str = "equation",
    settings: RegressionSettings | None = None,
    progress: Say | None = None,
) -> tuple[LawStep[Fit], ...]:
    """Return the ladder of laws that sparse regression proposes, fitted by the model; the last kept is the choice."""
    say, known = progress or (lambda step: None), settings or RegressionSettings()
    ladder, best = [LawStep(start, True, method)], start
    for _ in range(known.n_passes):
        say("sparse regression")
        before = best
        for name, group in zip(start.laws, start.model.groups, strict=True):
            proposed = regress(before, group.members[0], kinds, known)
            tried = {step.fit.laws[name].name for step in ladder}
            for law in [law for law in proposed[: known.n_refitted] if law.name not in tried]:
                say(law.name)
                new = problem.refit(best, {name: law})
                if new is None:
                    continue
                kept = is_better(new, best, problem.settings)
                ladder.append(LawStep(new, kept, "sparse regression"))
                best = new if kept else best
        if best is before:
            break
    return tuple(ladder)


def regress(fit: Fit, attachment: int, kinds: Sequence[str], settings: RegressionSettings) -> tuple[Law, ...]:
    """Propose laws of one suspension from the force on the motion that a fit predicts.

    They are sorted by their error on blocks that are left out, the chosen one first. Laws with memory are not functions
    of the predicted motion and are searched only by the pursuit.
    """
    static = [kind for kind in kinds if LAWS[kind].memory is None]
    return _propose_laws(_thin_points(force_points(fit, attachment), settings.n_samples), static, settings)


def _thin_points(points: ForcePoints, n_samples: int) -> ForcePoints:
    step = max(1, points.travel.size // n_samples)
    parts = (points.travel, points.velocity, points.force_per_mass, points.fitted)
    return ForcePoints(*(np.ascontiguousarray(part[::step]) for part in parts))


def _propose_laws(points: ForcePoints, names: Sequence[str], known: RegressionSettings) -> tuple[Law, ...]:
    z, v, y = points.travel, points.velocity, points.force_per_mass
    straight = np.stack([z, v, np.ones_like(z)], axis=1)
    residual, held = y, LINEAR
    found: dict[str, tuple[float, Law]] = {}
    best = LINEAR
    for _ in range(known.n_rounds):
        shapes = [_choose_scale(name, held, z, v, straight, residual) for name in names]
        columns = _remove_straight_part(straight, np.stack([shape.force(z, v) for shape in shapes], axis=1))
        target = _remove_straight_part(straight, y[:, np.newaxis])
        for support in _propose_supports(columns, target, known):
            law = Law(tuple(shapes[k].terms[0] for k in support))
            if law.name not in found:
                start = [law] if len(support) > 1 else None
                fitted = fit_separable(straight, law, Motion(z, v), y, starts=start).law if law.terms else law
                found[law.name] = (_measure_left_out(straight, fitted, z, v, y, known.n_blocks), fitted)
        best = _choose_law(found, known.block_margin)
        if best.name == held.name:
            break
        held = best
        basis = np.concatenate([straight, held.parameter_gradient(z, v)], axis=1)
        residual = _compute_residual(basis, y)
    return tuple(law for _, law in sorted(found.values(), key=lambda entry: (entry[1] is not best, entry[0])))


def _choose_law(found: dict[str, tuple[float, Law]], margin: float) -> Law:
    """Return the law with the smallest error; each further term must lower it by the margin."""
    return min(found.values(), key=lambda entry: entry[0] * (1 + margin) ** len(entry[1].terms))[1]


def _choose_scale(name: str, held: Law, z: FloatArray, v: FloatArray, straight: FloatArray, y: FloatArray) -> Law:
    """Return the kind with unit amplitude, at its fitted scale or at the scale that fits the residual best."""
    for term in held.terms:
        if term.name == name:
            return Law((term,)).scaled(1 / term.amplitude)
    law = default_law(name)
    law = law.scaled(1 / law.vector[0])
    if law.vector.size == 1:
        return law
    offered = start_laws(law, Motion(z, v))
    columns = _remove_straight_part(straight, np.stack([each.force(z, v) for each in offered], axis=1))
    return offered[int(np.argmax(np.abs(columns.T @ y)))]


def _remove_straight_part(straight: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns of unit rms with stiffness, damping and an offset projected out."""
    basis = np.linalg.qr(straight / np.sqrt(np.mean(straight**2, axis=0)))[0]
    left = columns - basis @ (basis.T @ columns)
    return left / np.maximum(np.sqrt(np.mean(left**2, axis=0)), 1e-300)


def _compute_residual(basis: FloatArray, y: FloatArray) -> FloatArray:
    scaled = basis / np.maximum(np.sqrt(np.mean(basis**2, axis=0)), 1e-300)
    return y - scaled @ np.linalg.lstsq(scaled, y, rcond=1e-10)[0]


def _measure_left_out(
    straight: FloatArray, law: Law, z: FloatArray, v: FloatArray, y: FloatArray, n_blocks: int
) -> float:
    """Return the rms error on blocks of time that are left out in turn, with the fitted scales."""
    shapes = [law_of.force(z, v) for law_of in (Law((term,)) for term in law.terms)]
    basis = np.stack([*straight.T, *shapes], axis=1)
    basis = basis / np.maximum(np.sqrt(np.mean(basis**2, axis=0)), 1e-300)
    block = np.arange(y.size) * n_blocks // y.size
    square = 0.0
    for k in range(n_blocks):
        inside, outside = block != k, block == k
        weights = np.linalg.lstsq(basis[inside], y[inside], rcond=1e-10)[0]
        square += float(np.sum((y[outside] - basis[outside] @ weights) ** 2))
    return float(np.sqrt(square / y.size))


def _propose_supports(columns: FloatArray, target: FloatArray, known: RegressionSettings) -> Iterator[tuple[int, ...]]:
    """Yield sets of columns that the optimisers choose."""
    # The import takes two seconds, so it is made only here.
    from pysindy.optimizers import FROLS, SR3, SSR, STLSQ

    paths = []
    for limit in known.thresholds:
        # With this weight the L0 penalty cuts at the limit.
        weight = limit**2 / (2 * known.relaxation)
        # Only the set of columns matters: the distribution of a force over nearly parallel columns converges slowly.
        sr3 = SR3(reg_weight_lam=weight, regularizer="L0", relax_coeff_nu=known.relaxation, max_iter=50_000, tol=1e-2)
        paths += [[_fit_thresholded(STLSQ, columns, target, limit)], [sr3.fit(columns, target).coef_]]
    for optimiser in (SSR(max_iter=columns.shape[1]), FROLS(max_iter=known.most_terms + 1)):
        paths.append(optimiser.fit(columns, target).history_)
    for coefficients in [each for path in paths for each in path]:
        support = np.flatnonzero(np.ravel(coefficients))
        if support.size <= known.most_terms:
            yield tuple(support.tolist())


def _fit_thresholded(optimiser: Any, columns: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """Return coefficients by STLSQ; a further column and sample are always kept: pysindy refuses empty sets."""
    n, m = columns.shape
    anchored = np.zeros((n + 1, m + 1))
    anchored[:n, :m], anchored[n, m] = columns, np.sqrt(n)
    fitted = optimiser(threshold=threshold, alpha=1e-6)
    fitted.fit(anchored, np.concatenate([target, [[np.sqrt(n)]]]))
    return np.ravel(fitted.coef_)[:m]
