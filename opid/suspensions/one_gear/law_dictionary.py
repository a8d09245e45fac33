"""What each term that a law might have would do to the prediction errors, to first order: laws ranked without a fit.

The model is simulated with all candidates in its law, too weak to move anything, once for each of a few inner scales.
The derivatives of the prediction errors by the amplitudes, orthogonal to what everything else in the model can do, are
the columns of a regression: which few of them leave least of the errors (a score test, Rao 1948, of many terms at
once).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from opid.mechanics.laws import LAWS, Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.one_gear.refit import in_place_of

# inner scales at which candidates are simulated, over the rms motion, and how many there are in all from one to the
# next by interpolation
SCALES = (0.1, 0.3, 0.9, 2.7)
N_BETWEEN = 4
# force of a candidate in the simulation, over the noise
FAINT = 1e-5
# a scale is moved along its derivative by so much at the most: twice the way to the next one
LARGEST_LOG_STEP = 0.5
# a direction that others make up to this share of its square adds nothing
NEARLY_PARALLEL = 1e-7


@dataclass(frozen=True)
class Proposal:
    """A law that is worth a fit.

    Args:
        law: with the values that the derivatives suggest, per unit of sprung mass.
        bic: the criterion that it would reach to first order.
    """

    law: Law
    bic: float


@dataclass(frozen=True, eq=False)
class LawDictionary:
    """Derivatives of the prediction errors by the amplitudes of many terms, as far as nothing else does the same.

    Args:
        fit: the model that they were taken at.
        terms: of each column, with unit amplitude; an inner parameter of a fitted term has that term.
        fitted: columns of each kind of the fitted law, its inner parameters beside it: taken together.
        offered: columns of each other kind, one for each inner scale: one of them is taken.
        slopes: of such a column, the one of the derivative by the logarithm of its scale.
        total: squared errors, less what the fitted law does to them.
        gram: (n_columns, n_columns) products of the columns, scaled to unit size.
        along: (n_columns,) products of columns and errors.
        size: (n_columns,) of the columns before they were scaled.
    """

    fit: ModelFit
    terms: tuple[Term, ...]
    fitted: dict[str, list[int]]
    offered: dict[str, list[int]]
    slopes: dict[int, int]
    total: float
    gram: FloatArray
    along: FloatArray
    size: FloatArray

    def left(self, columns: Sequence[int]) -> tuple[float, FloatArray]:
        """Return the squared error that some columns leave, and their weights.

        Args:
            columns: their places.
        """
        inverse = self._inverse(columns)
        weights = -inverse @ self.along[list(columns)]
        return self.total + float(self.along[list(columns)] @ weights), weights / self.size[list(columns)]

    def proposal(self, names: Sequence[str]) -> Proposal:
        """Return what the law of some kinds would reach, and its start values.

        Args:
            names: kinds of the dictionary.
        """
        kept = [column for name in names for column in self.fitted.get(name, [])]
        new = [name for name in names if name in self.offered]
        picked: dict[str, int] = {}
        # the scales of several new terms depend on one another
        for _ in range(1 if len(new) < 2 else 3):
            for name in new:
                others = [column for other, column in picked.items() if other != name]
                picked[name] = self._best([*kept, *others], self.offered[name])
        cost, law = self._refined(names, kept, picked)
        now, _ = self.left([column for group in self.fitted.values() for column in group])
        n_more = sum(len(LAWS[name].parameters) for name in names) - self.fit.law.vector.size
        bic = self.fit.bic + self.fit.n_data * np.log(max(cost, 1e-9 * now) / now) + n_more * np.log(self.fit.n_data)
        return Proposal(law, bic)

    def _refined(self, names: Sequence[str], kept: Sequence[int], picked: dict[str, int]) -> tuple[float, Law]:
        """The law of the picked scales and what it leaves, the scales moved along their derivatives."""
        moved = {name: self.slopes[column] for name, column in picked.items() if column in self.slopes}
        while True:
            columns = [*kept, *picked.values(), *moved.values()]
            cost, weights = self.left(columns)
            weight = dict(zip(columns, weights.tolist(), strict=True))
            log_step = {name: weight[column] / (weight[picked[name]] or 1e-300) for name, column in moved.items()}
            far = [name for name, step in log_step.items() if abs(step) > LARGEST_LOG_STEP]
            if not far:
                break
            # not the neighbourhood in which a derivative tells anything
            moved = {name: column for name, column in moved.items() if name not in far}
        terms = []
        for name in names:
            place = self.fitted[name][0] if name in self.fitted else picked[name]
            inner = self.terms[place].inner
            if name in log_step:
                inner = (float(inner[0] * np.exp(log_step[name])),)
            terms.append(Term(name, (weight[place], *inner)))
        return cost, Law(tuple(terms))

    def _inverse(self, columns: Sequence[int]) -> FloatArray:
        chosen = np.array(columns, dtype=np.int64)
        if not chosen.size:
            return np.empty((0, 0))
        inverse = np.linalg.pinv(self.gram[np.ix_(chosen, chosen)], rcond=NEARLY_PARALLEL, hermitian=True)
        return np.asarray(inverse, dtype=np.float64)

    def _best(self, base: Sequence[int], options: Sequence[int]) -> int:
        """Which of the options lowers the error most beside the base."""
        chosen, offered = np.array(base, dtype=np.int64), np.array(options, dtype=np.int64)
        products = self.gram[np.ix_(offered, chosen)]
        cross = products @ self._inverse(base)
        along = self.along[offered] - cross @ self.along[chosen]
        size = 1 - np.sum(cross * products, axis=1)
        gain = np.where(size > NEARLY_PARALLEL, along**2 / np.maximum(size, NEARLY_PARALLEL), 0.0)
        return options[int(np.argmax(gain))]


def dictionary_of(runs: Sequence[DrivenRun], fit: ModelFit, names: Sequence[str]) -> LawDictionary:
    """Return the dictionary of some kinds at a fit.

    Args:
        runs: one `DrivenRun` a run.
        fit: the model to depart from.
        names: kinds in `opid.mechanics.laws.LAWS`; those of the fitted law are there in any case.
    """
    new = [name for name in names if name not in fit.law.parameters]
    simulated = _simulated(runs, fit, new)
    columns, terms = list(simulated.columns), list(simulated.terms)
    fitted = {term.name: [k for k, each in enumerate(terms) if each.name == term.name] for term in fit.law.terms}
    offered: dict[str, list[int]] = {}
    slopes: dict[int, int] = {}
    for name, nodes in simulated.nodes.items():
        scaled = [p.role for p in LAWS[name].parameters[1:]] == ["scale"]
        dense = _between(nodes) if scaled else nodes
        offered[name] = list(range(len(columns), len(columns) + len(dense)))
        columns += [value for _, value, _ in dense]
        terms += [term for term, _, _ in dense]
        if scaled:
            slopes |= {place: place + len(dense) for place in offered[name]}
            columns += [slope for _, _, slope in dense]
            terms += [term for term, _, _ in dense]
    matrix = np.stack(columns, axis=1)
    matrix -= simulated.basis @ (simulated.basis.T @ matrix)
    target = simulated.target - simulated.basis @ (simulated.basis.T @ simulated.target)
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    matrix /= size
    gram, along = matrix.T @ matrix, matrix.T @ target
    return LawDictionary(fit, tuple(terms), fitted, offered, slopes, float(target @ target), gram, along, size)


# a term, its column, and the derivative of that by the logarithm of its scale
_Node = tuple[Term, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _Simulated:
    """Columns of the fitted law, those of other kinds at a few scales, and what everything else can do."""

    columns: list[FloatArray]
    terms: list[Term]
    nodes: dict[str, list[_Node]]
    basis: FloatArray
    target: FloatArray


def _simulated(runs: Sequence[DrivenRun], fit: ModelFit, new: Sequence[str]) -> _Simulated:
    columns: list[FloatArray] = []
    terms: list[Term] = []
    nodes: dict[str, list[_Node]] = {name: [] for name in new}
    basis = target = np.empty(0)
    for turn, share in enumerate(SCALES):
        faint = [_faint(name, share, fit) for name in new if turn == 0 or len(LAWS[name].parameters) > 1]
        law = fit.law + Law(tuple(faint))
        model, vector = in_place_of(runs, fit, law)
        errors = model.evaluate(vector)
        first = model.n_head
        if turn == 0:
            others = np.delete(errors.jacobian, np.arange(first, first + law.vector.size), axis=1)
            basis = np.linalg.qr(others / np.maximum(np.linalg.norm(others, axis=0), 1e-300))[0]
            target = errors.stacked.copy()
        for term in law.terms:
            block = errors.jacobian[:, first : first + len(term.values)]
            first += len(term.values)
            if term.name in nodes:
                slope = block[:, 1] / term.amplitude if term.inner else block[:, 0]
                nodes[term.name].append((term, block[:, 0], slope))
            elif turn == 0:
                columns += list(block.T)
                terms += [term] * len(term.values)
                target = target - term.amplitude * block[:, 0]
    return _Simulated(columns, terms, nodes, basis, target)


def _between(nodes: list[_Node]) -> list[_Node]:
    """Terms, columns and slopes at scales between the simulated ones: cubic Hermite in the logarithm of the scale."""
    dense = []
    for (term, value, slope), (after, value_after, slope_after) in pairwise(nodes):
        width = np.log(after.inner[0] / term.inner[0])
        rise = value_after - value
        for t in np.arange(N_BETWEEN) / N_BETWEEN:
            between = value + t**2 * (3 - 2 * t) * rise
            between = between + width * (t * (1 - t) ** 2 * slope - t**2 * (1 - t) * slope_after)
            along = 6 * t * (1 - t) / width * rise + (1 - t) * (1 - 3 * t) * slope + t * (3 * t - 2) * slope_after
            dense.append((Term(term.name, (1.0, float(term.inner[0] * np.exp(t * width)))), between, along))
    return [*dense, nodes[-1]]


def _faint(name: str, share: float, fit: ModelFit) -> Term:
    """Return a term too weak to move anything, its inner scale a share of the rms motion."""
    inner = [
        share * float((fit.velocity if parameter.unit == "m/s" else fit.travel).std())
        if parameter.role == "scale"
        else parameter.default
        for parameter in LAWS[name].parameters[1:]
    ]
    force = Law((Term(name, (1.0, *inner)),)).force(fit.travel, fit.velocity)
    return Term(name, (FAINT * fit.level / max(float(np.sqrt(np.mean(force**2))), 1e-300), *inner))
