"""Which law, by sparse regression: few terms of a library that explain the force on the reconstructed motion.

pysindy's optimisers (Brunton et al. 2016; Zheng et al. 2019; Boninsegna et al. 2018; Billings 2013) work on the travel
and velocity that the fitted model reconstructs, not on accelerations integrated by themselves. Stiffness and damping
are always there, the columns of the other terms are freed of them and scaled to one size. Inner scales are alternated
with the choice of terms. The best of the laws that are proposed are then fitted by the driven model, as those of the
pursuit are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import LINEAR, Law, default_law
from opid.signals.recording import FloatArray
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.one_gear.pursuit import better, library, pursue_law
from opid.suspensions.one_gear.refit import refit
from opid.suspensions.paper.joint_fit import LadderStep, chosen
from opid.suspensions.sensor_facts import nuisance_values
from opid.suspensions.separable import START_SHARES, separable_fit, started

# samples that the regression looks at, and blocks of time that are left out by turns
N_SAMPLES, N_BLOCKS = 6000, 10
# coefficients, in shares of the force that stiffness and damping leave, below which a term is dropped
THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)
# of SR3: how closely the sparse coefficients follow the others
RELAXATION = 1.0
# a larger law must lower the error of the blocks left out by this share
BLOCK_MARGIN = 0.01
N_ROUNDS = 3
# unexplained error over the noise that was assumed, above which the second road is gone too
IN_DOUBT = 1.5
ROADS = ("pursuit", "sparse regression")
# laws that are fitted by the model in a pass, and passes at the most
N_REFITTED, N_PASSES = 3, 4


@dataclass(frozen=True, eq=False)
class SparseRoad:
    """What sparse regression proposed, and what became of it.

    Args:
        ladder: the start and each law that was fitted by the model, the chosen one last with `kept`.
        inclusion: of each kind, share of the ensemble of resampled regressions that has it.
        proposed_by: of each law that was proposed, the optimisers.
    """

    ladder: tuple[LadderStep, ...]
    inclusion: dict[str, float]
    proposed_by: dict[str, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class ForcePoints:
    """Force on the body over the motion that a fitted model reconstructs, samples of all runs.

    Args:
        travel: (n,) z, m.
        velocity: (n,) z', m/s.
        force_per_mass: (n,) of the suspension on the body, per unit of reference mass, m/s^2.
        fitted: (n,) what the fitted stiffness, damping and law make of it, m/s^2.
    """

    travel: FloatArray
    velocity: FloatArray
    force_per_mass: FloatArray
    fitted: FloatArray


def sparse_road(
    runs: Sequence[DrivenRun],
    fit: ModelFit,
    *,
    names: Sequence[str] | None = None,
    most_terms: int = 3,
    n_models: int = 20,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> SparseRoad:
    """Return the laws that sparse regression proposes, fitted by the model.

    Args:
        runs: one `DrivenRun` a run.
        fit: a fitted model: its motion is regressed on.
        names: kinds that may enter; those of `opid.suspensions.one_gear.pursuit.library` where left out.
        most_terms: terms at the most.
        n_models: resampled regressions that the inclusion rests on.
        seed: of the resampling.
        progress: called with the name of each law before it is fitted.
    """
    say = progress or (lambda step: None)
    kinds = library() if names is None else tuple(names)
    ladder = [LadderStep(fit.law.name, fit, True, road="given")]
    best, proposed_by = fit, dict[str, tuple[str, ...]]()
    inclusion: dict[str, float] = {}
    for _ in range(N_PASSES):
        say("sparse regression")
        points = _thinned(force_points(runs, best))
        laws, inclusion = _proposed(points, kinds, most_terms, n_models, seed)
        proposed_by |= {law.name: by for law, by in laws}
        before = best
        for law in [law for law, _ in laws[:N_REFITTED] if law.name not in {step.law_name for step in ladder}]:
            say(law.name)
            try:
                new = refit(runs, before, law)
            except UnboundedResponseError:
                continue
            best = new if better(new, best) else best
            ladder.append(LadderStep(law.name, new, False, road="sparse regression"))
        if best is before:
            break
        # the next pass regresses on the motion as the better model reconstructs it
        ladder.append(replace(ladder.pop([step.fit for step in ladder].index(best)), kept=True))
    return SparseRoad(tuple(ladder), inclusion, proposed_by)


def which_law(
    runs: Sequence[DrivenRun],
    start: ModelFit,
    *,
    roads: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    most_terms: int = 3,
    progress: Callable[[str], None] | None = None,
) -> tuple[LadderStep, ...]:
    """Return the ladder of fitted laws by one road or both, each starting where the other ended.

    Args:
        runs: one `DrivenRun` a run.
        start: a fitted model, usually with the law of the classical chain.
        roads: "pursuit" and "sparse regression" or one of them; where left out the pursuit, and the other where it
            leaves more than `IN_DOUBT` times the noise that was assumed.
        names: kinds that may enter.
        most_terms: terms at the most.
        progress: called with the name of each law before it is fitted.

    Raises:
        InputError: an unknown road.
    """
    unknown = [road for road in roads or () if road not in ROADS]
    if unknown:
        raise InputError(f"there is no road {unknown[0]!r}: {nearest(unknown[0], ROADS)}")
    settings: dict[str, Any] = {"names": names, "most_terms": most_terms, "progress": progress}
    ladder: tuple[LadderStep, ...] = ()
    if roads is None or "pursuit" in roads:
        ladder = pursue_law(runs, start, **settings)
        best = chosen(ladder).fit
        if roads is None and best.noise_m_per_s2 < IN_DOUBT * start.level:
            return ladder
        start = best if isinstance(best, ModelFit) else start
    if roads is None or "sparse regression" in roads:
        sparse = sparse_road(runs, start, **settings).ladder
        ladder = (*ladder, *(step for step in sparse if not ladder or step.fit is not start))
        best = chosen(ladder).fit
        if best is not start and isinstance(best, ModelFit) and (roads is None or "pursuit" in roads):
            ladder = (*ladder, *pursue_law(runs, best, **settings)[1:])
    return ladder


def force_points(runs: Sequence[DrivenRun], fit: ModelFit) -> ForcePoints:
    """Return the measured force per unit of reference mass on the reconstructed motion.

    -x2''/share, share = M2/(M2 + dM), without what the fitted ground spring and the offsets of the sensors make of it.

    Args:
        runs: one `DrivenRun` a run.
        fit: a model fitted to them.
    """
    z, v = fit.travel, fit.velocity
    fitted = fit["stiffness_per_mass"] * z + fit["damping_per_mass"] * v + fit.law.force(z, v)
    mu = fit["inverse_mass"] or fit.held_inverse_mass or 0.0
    missed = []
    for run, prediction in zip(runs, fit.predictions, strict=True):
        measured, _ = run.measured(nuisance_values(fit.names, fit.value.tolist(), run.sensors))
        # reading less prediction, of which the ground spring and the offsets are a part
        apart = measured[: run.n_samples] - prediction.acceleration[:, 0]
        missed.append((apart - apart.mean()) * (1 + mu * run.mass_change_kg))
    return ForcePoints(z, v, fitted - np.concatenate(missed), fitted)


def _thinned(points: ForcePoints) -> ForcePoints:
    step = max(1, points.travel.size // N_SAMPLES)
    parts = (points.travel, points.velocity, points.force_per_mass, points.fitted)
    return ForcePoints(*(np.ascontiguousarray(part[::step]) for part in parts))


def _proposed(
    points: ForcePoints, names: Sequence[str], most_terms: int, n_models: int, seed: int
) -> tuple[list[tuple[Law, tuple[str, ...]]], dict[str, float]]:
    """Laws in the order of their error on blocks left out, who proposed them, and the ensemble's inclusion."""
    z, v, y = points.travel, points.velocity, points.force_per_mass
    straight = np.stack([z, v, np.ones_like(z)], axis=1)
    residual, held = y, LINEAR
    found: dict[str, tuple[float, Law]] = {}
    proposed_by: dict[str, set[str]] = {}
    threshold, columns, target = THRESHOLDS[0], np.empty((z.size, 0)), y
    best = LINEAR
    for _ in range(N_ROUNDS):
        shapes = [_at_best_scale(name, held, z, v, straight, residual) for name in names]
        columns = _freed(straight, np.stack([shape.force(z, v) for shape in shapes], axis=1))
        target = _freed(straight, y[:, np.newaxis])
        for who, limit, support in _supports(columns, target, most_terms):
            law = Law(tuple(shapes[k].terms[0] for k in support))
            proposed_by.setdefault(law.name, set()).add(who)
            if law.name not in found:
                start = [law] if len(support) > 1 else None
                fitted = separable_fit(straight, law, z, v, y, starts=start).law if law.terms else law
                found[law.name] = (_left_out(straight, fitted, z, v, y), fitted)
            if found[law.name][1] is _chosen(found):
                threshold = limit
        best = _chosen(found)
        if best.name == held.name:
            break
        held = best
        basis = np.concatenate([straight, held.parameter_gradient(z, v)], axis=1)
        residual = _residual(basis, y)
    inclusion = _inclusion(columns, target, threshold, n_models, seed) if columns.size else np.empty(0)
    order = sorted(found.values(), key=lambda entry: entry[0])
    order.sort(key=lambda entry: entry[1] is not best)
    laws = [(law, tuple(sorted(proposed_by[law.name]))) for _, law in order]
    return laws, dict(zip(names, inclusion.tolist(), strict=True))


def _chosen(found: dict[str, tuple[float, Law]]) -> Law:
    """The smallest law whose error is within the margin, for each term more, of the least."""
    return min(found.values(), key=lambda entry: entry[0] * (1 + BLOCK_MARGIN) ** len(entry[1].terms))[1]


def _at_best_scale(name: str, held: Law, z: FloatArray, v: FloatArray, straight: FloatArray, y: FloatArray) -> Law:
    """The kind with unit amplitude: at its fitted scale, or at that which goes best with what is left."""
    for term in held.terms:
        if term.name == name:
            return Law((term,)).scaled(1 / term.amplitude)
    law = default_law(name)
    law = law.scaled(1 / law.vector[0])
    if law.vector.size == 1:
        return law
    offered = [started(law, z, v, share) for share in START_SHARES]
    columns = _freed(straight, np.stack([each.force(z, v) for each in offered], axis=1))
    return offered[int(np.argmax(np.abs(columns.T @ y)))]


def _freed(straight: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns without what stiffness, damping and an offset make of them, of unit rms."""
    basis = np.linalg.qr(straight / np.sqrt(np.mean(straight**2, axis=0)))[0]
    left = columns - basis @ (basis.T @ columns)
    return left / np.maximum(np.sqrt(np.mean(left**2, axis=0)), 1e-300)


def _residual(basis: FloatArray, y: FloatArray) -> FloatArray:
    scaled = basis / np.maximum(np.sqrt(np.mean(basis**2, axis=0)), 1e-300)
    return y - scaled @ np.linalg.lstsq(scaled, y, rcond=1e-10)[0]


def _left_out(straight: FloatArray, law: Law, z: FloatArray, v: FloatArray, y: FloatArray) -> float:
    """Rms error on blocks of time that are left out by turns, scales as fitted."""
    shapes = [law_of.force(z, v) for law_of in (Law((term,)) for term in law.terms)]
    basis = np.stack([*straight.T, *shapes], axis=1)
    basis = basis / np.maximum(np.sqrt(np.mean(basis**2, axis=0)), 1e-300)
    block = np.arange(y.size) * N_BLOCKS // y.size
    square = 0.0
    for k in range(N_BLOCKS):
        inside, outside = block != k, block == k
        weights = np.linalg.lstsq(basis[inside], y[inside], rcond=1e-10)[0]
        square += float(np.sum((y[outside] - basis[outside] @ weights) ** 2))
    return float(np.sqrt(square / y.size))


def _supports(columns: FloatArray, target: FloatArray, most_terms: int) -> Iterator[tuple[str, float, tuple[int, ...]]]:
    """Sets of columns that the optimisers choose, with their names and, where they have one, the threshold."""
    # two seconds to import, so only here
    from pysindy.optimizers import FROLS, SR3, SSR, STLSQ

    optimisers: list[tuple[str, float, Any]] = []
    for limit in THRESHOLDS:
        # the weight of the L0 penalty that cuts at the limit
        weight = limit**2 / (2 * RELAXATION)
        sr3 = SR3(reg_weight_lam=weight, regularizer="L0", relax_coeff_nu=RELAXATION, max_iter=5000, tol=1e-4)
        optimisers.append(("SR3", limit, sr3))
        support = np.flatnonzero(_thresholded(STLSQ, columns, target, limit))
        if support.size <= most_terms:
            yield "STLSQ", limit, tuple(support.tolist())
    optimisers.append(("SSR", THRESHOLDS[0], SSR(max_iter=columns.shape[1])))
    optimisers.append(("FROLS", THRESHOLDS[0], FROLS(max_iter=most_terms + 1)))
    for who, limit, optimiser in optimisers:
        optimiser.fit(columns, target)
        path = optimiser.history_ if who in ("SSR", "FROLS") else [optimiser.coef_]
        for coefficients in path:
            support = np.flatnonzero(np.ravel(coefficients))
            if support.size <= most_terms:
                yield who, limit, tuple(support.tolist())


def _inclusion(columns: FloatArray, target: FloatArray, threshold: float, n_models: int, seed: int) -> FloatArray:
    """Share of regressions on blocks drawn with replacement that keep each column."""
    from pysindy.optimizers import STLSQ

    rng = np.random.default_rng(seed)
    blocks = np.array_split(np.arange(target.size), 4 * N_BLOCKS)
    kept = np.zeros(columns.shape[1])
    for _ in range(n_models):
        drawn = np.concatenate([blocks[k] for k in rng.integers(len(blocks), size=len(blocks))])
        kept += _thresholded(STLSQ, columns[drawn], target[drawn], threshold) != 0
    return kept / max(n_models, 1)


def _thresholded(optimiser: Any, columns: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """Coefficients by STLSQ. A column of its own for a sample of its own stays in, for an empty choice is no error."""
    n, m = columns.shape
    anchored = np.zeros((n + 1, m + 1))
    anchored[:n, :m], anchored[n, m] = columns, np.sqrt(n)
    fitted = optimiser(threshold=threshold, alpha=1e-6)
    fitted.fit(anchored, np.concatenate([target, [[np.sqrt(n)]]]))
    return np.ravel(fitted.coef_)[:m]
