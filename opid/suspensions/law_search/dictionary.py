"""Ranking of laws without a fit: the effect of each candidate term on the errors of a fit, to first order.

The errors are differentiated by the amplitudes of all candidates, at a few inner scales each. The derivatives by
everything else in the model are projected out of these columns, and the few columns that leave the smallest error are
chosen (a score test, Rao 1948, of many terms at once).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from opid.mechanics.laws.law import LAWS, Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.settings import SearchSettings


@dataclass(frozen=True)
class Proposal:
    """A law that is proposed for a fit.

    Args:
        law: the law with start values from the derivatives.
        bic: its information criterion to first order, minus that of the present fit.
        n_more: number of its terms minus that of the fitted law.
    """

    law: Law
    bic: float
    n_more: int


@dataclass(frozen=True, eq=False)
class Node:
    """A candidate at one set of its inner parameters.

    Args:
        term: the candidate with unit amplitude.
        column: (n,) derivative of the errors by its amplitude.
        slope: (n,) derivative of the column by the logarithm of its scale, or of its exponent; None for a kind without
            either or with further inner parameters.
    """

    term: Term
    column: FloatArray
    slope: FloatArray | None


def may_stand_together(names: Iterable[str]) -> bool:
    """Return whether kinds may be terms of one law that is searched.

    At most one term has memory, and if that is a friction, it is the only friction: two of them have nearly the same
    effect, and a sum of large terms that cancel has no mechanical meaning.
    """
    kinds = [LAWS[name] for name in names]
    remembering = [kind for kind in kinds if kind.memory is not None]
    rubbing = sum(kind.is_friction for kind in kinds)
    return len(remembering) < 2 and not (rubbing > 1 and any(kind.is_friction for kind in remembering))


@dataclass(frozen=True, eq=False)
class LawDictionary:
    """Derivatives of the errors by the amplitudes of many terms, with all other derivatives projected out.

    Args:
        law: the fitted law.
        n_data: number of independent real numbers that were fitted.
        terms: term of each column, with unit amplitude; the column of an inner parameter of a fitted term has that
            term.
        fitted: columns of each kind of the fitted law, with its inner parameters; they are used together.
        offered: columns of each other kind, one for each inner scale, of which one is used.
        slopes: for each such column, the column of its derivative by the logarithm of the scale.
        total: squared errors without the effect of the fitted law.
        gram: (n_columns, n_columns) products of the columns, scaled to unit norm.
        along: (n_columns,) products of columns and errors.
        size: (n_columns,) norms of the columns before they were scaled.
        settings: settings of the search.
        further: laws that are fitted without a ranking, because their columns would mislead.
    """

    law: Law
    n_data: int
    terms: tuple[Term, ...]
    fitted: dict[str, list[int]]
    offered: dict[str, list[int]]
    slopes: dict[int, int]
    total: float
    gram: FloatArray
    along: FloatArray
    size: FloatArray
    settings: SearchSettings
    further: tuple[Law, ...] = ()

    def proposals(self) -> list[Proposal]:
        """Return the laws near the fitted one, the best first: one term more or less, or one or two exchanged.

        With b the errors without the effect of the fitted law, and D the columns, the law of the terms S would leave
        min_a |b + D_S a|^2.
        """
        return sorted((self.proposal(move) for move in self._list_moves()), key=lambda proposal: proposal.bic)

    def _list_moves(self) -> Iterator[tuple[str, ...]]:
        return filter(may_stand_together, self._list_neighbours())

    def _list_neighbours(self) -> Iterator[tuple[str, ...]]:
        have, others = list(self.fitted), list(self.offered)
        if have:
            yield from combinations(have, len(have) - 1)
        for n_exchanged in range(1, min(len(have), self.settings.most_exchanged) + 1):
            for kept in combinations(have, len(have) - n_exchanged):
                for new in combinations(others, n_exchanged):
                    yield *kept, *new
        if len(have) < self.settings.most_terms:
            for name in others:
                yield *have, name

    def left(self, columns: Sequence[int]) -> tuple[float, FloatArray]:
        """Return the squared error that some columns leave, and their weights."""
        chosen = list(columns)
        weights = -self._invert_columns(chosen) @ self.along[chosen]
        return self.total + float(self.along[chosen] @ weights), weights / self.size[chosen]

    def largest_expected_gain(self) -> float:
        """Return the fraction of the squared error that the best proposal would explain."""
        return 1.0 - float(np.exp(min((each.bic for each in self.proposals()), default=0.0) / self.n_data))

    def proposal(self, names: Sequence[str]) -> Proposal:
        """Return the proposal for the law of some kinds, with its start values."""
        kept = [column for name in names for column in self.fitted.get(name, [])]
        new = [name for name in names if name in self.offered]
        picked: dict[str, int] = {}
        # The scales of several new terms depend on one another.
        for _ in range(1 if len(new) < 2 else 3):
            for name in new:
                others = [column for other, column in picked.items() if other != name]
                picked[name] = self._choose_best([*kept, *others], self.offered[name])
        cost, law = self._refine(names, kept, picked)
        now, _ = self.left([column for group in self.fitted.values() for column in group])
        # With exact data only rounding errors are left, of either sign.
        now = max(now, 1e-15 * self.total)
        n_more = sum(len(LAWS[name].parameters) for name in names) - self.law.vector.size
        bic = self.n_data * float(np.log(max(cost, 1e-9 * now) / now)) + n_more * float(np.log(self.n_data))
        return Proposal(law, bic, len(law.terms) - len(self.law.terms))

    def _refine(self, names: Sequence[str], kept: Sequence[int], picked: dict[str, int]) -> tuple[float, Law]:
        """Return the squared error and the law of the picked scales, shifted along their derivatives."""
        moved = {name: self.slopes[column] for name, column in picked.items() if column in self.slopes}
        while True:
            columns = [*kept, *picked.values(), *moved.values()]
            cost, weights = self.left(columns)
            weight = dict(zip(columns, weights.tolist(), strict=True))
            log_step = {name: weight[column] / (weight[picked[name]] or 1e-300) for name, column in moved.items()}
            far = [name for name, step in log_step.items() if abs(step) > self.settings.largest_log_step]
            if not far:
                break
            # The derivative does not hold so far away.
            moved = {name: column for name, column in moved.items() if name not in far}
        terms = []
        for name in names:
            index = self.fitted[name][0] if name in self.fitted else picked[name]
            inner = self.terms[index].inner
            if name in log_step:
                inner = (float(inner[0] * np.exp(log_step[name])), *inner[1:])
            terms.append(Term(name, (weight[index], *inner)))
        return cost, Law(tuple(terms), self.law.rest_m)

    def _invert_columns(self, columns: Sequence[int]) -> FloatArray:
        if not columns:
            return np.empty((0, 0))
        gram = self.gram[np.ix_(columns, columns)]
        return np.asarray(np.linalg.pinv(gram, rcond=self.settings.nearly_parallel, hermitian=True), dtype=np.float64)

    def _choose_best(self, base: Sequence[int], options: Sequence[int]) -> int:
        """Return the option that lowers the error most beside the base columns."""
        chosen, offered = np.array(base, dtype=np.int64), np.array(options, dtype=np.int64)
        products = self.gram[np.ix_(offered, chosen)]
        cross = products @ self._invert_columns(base)
        along = self.along[offered] - cross @ self.along[chosen]
        size, least = 1 - np.sum(cross * products, axis=1), self.settings.nearly_parallel
        gain = np.where(size > least, along**2 / np.maximum(size, least), 0.0)
        return options[int(np.argmax(gain))]


def make_dictionary(
    law: Law,
    errors: FloatArray,
    by_law: FloatArray,
    others: FloatArray,
    nodes: Mapping[str, Sequence[Node]],
    settings: SearchSettings,
    n_data: int | None = None,
) -> LawDictionary:
    """Return the dictionary of candidates beside a fitted law.

    Args:
        law: the fitted law.
        errors: (n,) errors of the fit.
        by_law: (n, n_values) derivatives of the errors by the values of the law, inner parameters in any unit.
        others: (n, n_others) derivatives by all other fitted parameters.
        nodes: nodes of each further kind.
        settings: settings of the search.
        n_data: number of independent real numbers in the errors; None for all.
    """
    columns, terms, target = list(by_law.T), list[Term](), np.array(errors)
    fitted: dict[str, list[int]] = {}
    for term in law.terms:
        fitted[term.name] = list(range(len(terms), len(terms) + len(term.values)))
        target -= term.amplitude * by_law[:, len(terms)]
        terms += [term] * len(term.values)
    offered: dict[str, list[int]] = {}
    slopes: dict[int, int] = {}
    for name, row in nodes.items():
        dense = _interpolate_nodes(row, settings.n_between)
        offered[name] = list(range(len(columns), len(columns) + len(dense)))
        columns += [node.column for node in dense]
        terms += [node.term for node in dense]
        along_scale = [node.slope for node in dense if node.slope is not None]
        if len(along_scale) == len(dense):
            slopes |= {index: index + len(dense) for index in offered[name]}
            columns += along_scale
            terms += [node.term for node in dense]
    basis = orthonormal(others)
    matrix = np.stack(columns, axis=1) if columns else np.empty((errors.size, 0))
    matrix -= basis @ (basis.T @ matrix)
    target -= basis @ (basis.T @ target)
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    matrix /= size
    gram, along = matrix.T @ matrix, matrix.T @ target
    total = float(target @ target)
    n = errors.size if n_data is None else n_data
    return LawDictionary(law, n, tuple(terms), fitted, offered, slopes, total, gram, along, size, settings)


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of columns of any norm.

    Args:
        columns: (n, n_columns).
    """
    size = np.linalg.norm(columns, axis=0)
    # A column of zeros has no direction.
    return np.linalg.qr(columns[:, size > 0] / size[size > 0])[0]


def _interpolate_nodes(nodes: Sequence[Node], n_between: int) -> list[Node]:
    """Return nodes at scales between the given ones, by cubic Hermite interpolation in the logarithm of the scale."""
    dense: list[Node] = []
    for node, after in pairwise(nodes):
        if node.slope is None or after.slope is None:
            return list(nodes)
        width = float(np.log(after.term.inner[0] / node.term.inner[0]))
        rise = after.column - node.column
        for t in np.arange(n_between) / n_between:
            between = node.column + t**2 * (3 - 2 * t) * rise
            between = between + width * (t * (1 - t) ** 2 * node.slope - t**2 * (1 - t) * after.slope)
            along = 6 * t * (1 - t) / width * rise
            along = along + (1 - t) * (1 - 3 * t) * node.slope + t * (3 * t - 2) * after.slope
            term = Term(node.term.name, (1.0, float(node.term.inner[0] * np.exp(t * width)), *node.term.inner[1:]))
            dense.append(Node(term, between, along))
    return [*dense, *nodes[-1:]]
