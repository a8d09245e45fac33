"""Series that grow without end kept at a bounded length: neighbours are joined by powers of two."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

Items = dict[str, np.ndarray]


class Thinning:
    """Items in order of time, at most `most` of them: when there are more, each two neighbours become one.

    Args:
        joins: how two neighbours become one, by the name of what an item holds: `np.add`, `np.fmin`, `np.fmax`.
        most: items kept.

    >>> series = Thinning({"highest": np.fmax}, most=2)
    >>> for value in (1.0, 3.0, 2.0, 0.0, 5.0):
    ...     series.add({"highest": np.array([value])})
    >>> series.items()["highest"].tolist(), series.n_halvings
    ([3.0, 5.0], 2)
    """

    def __init__(self, joins: Mapping[str, np.ufunc], most: int) -> None:
        self._joins, self._most = dict(joins), max(2, most)
        self._kept: list[Items] = []
        self._n = 0
        self._waiting: list[Items | None] = []

    @property
    def n_halvings(self) -> int:
        """How often neighbours were joined: an item stands for two to this power of those that were added."""
        return len(self._waiting)

    def add(self, items: Items, *, n_halvings: int = 0) -> None:
        """Append items."""
        for i in range(n_halvings, self.n_halvings):
            items = self._pair(i, items)
        if _length(items):
            self._kept.append(items)
            self._n += _length(items)
        while self._n >= self._most:  # one that is left over makes it full
            self._waiting.append(None)
            halved = self._pair(self.n_halvings - 1, self._concatenate())
            self._kept, self._n = [halved], _length(halved)

    def items(self) -> Items:
        """Return what is kept; the last item may stand for fewer than the others. Nothing can be added after it."""
        last: Items | None = None
        for waiting in self._waiting:
            if waiting is not None:
                last = waiting if last is None else self._join(waiting, last)
        if last is not None:
            self._kept.append(last)
        self._waiting = [None] * self.n_halvings
        return self._concatenate()

    def _concatenate(self) -> Items:
        if len(self._kept) != 1:
            self._kept = [{name: np.concatenate([each[name] for each in self._kept]) for name in self._joins}]
        return self._kept[0]

    def _pair(self, i: int, items: Items) -> Items:
        """Join each two neighbours, the one that waits there first; one that is left over waits."""
        waiting = self._waiting[i]
        if waiting is not None:
            items = {name: np.concatenate([waiting[name], items[name]]) for name in self._joins}
        even = _length(items) // 2 * 2
        self._waiting[i] = {name: items[name][even:].copy() for name in self._joins} if even < _length(items) else None
        return self._join(_every(items, 0, even), _every(items, 1, even))

    def _join(self, one: Items, other: Items) -> Items:
        return {name: join(one[name], other[name]) for name, join in self._joins.items()}


def _every(items: Items, first: int, stop: int) -> Items:
    return {name: array[first:stop:2] for name, array in items.items()}


def _length(items: Items) -> int:
    return next(iter(items.values())).shape[0]


class RowStretches:
    """Stretches of rows in order, at most `most` of them: when there are more, those close together become one.

    Args:
        near: stretches no further apart become one, rows.
        most: stretches kept.
        coarse: `near` when there are too many, and its double when there still are, rows.
    """

    def __init__(self, *, near: int = 0, most: int = 20000, coarse: int = 1) -> None:
        self._near, self._most, self._coarse = near, most, max(coarse, 1)
        self._parts: list[np.ndarray] = []
        self._n = 0

    def add(self, starts: np.ndarray, stops: np.ndarray) -> None:
        """Append stretches that begin after those that are there."""
        if not starts.size:
            return
        self._parts.append(_merge(np.stack([starts, stops], axis=1).astype(np.int64), self._near))
        self._n += self._parts[-1].shape[0]
        while self._n > self._most:
            self._near = max(2 * self._near, self._coarse)
            self._parts = [self.rows()]
            self._n = self._parts[0].shape[0]

    def rows(self) -> np.ndarray:
        """Return (n, 2): first row, and the row after the last one, of each stretch."""
        if not self._parts:
            return np.empty((0, 2), dtype=np.int64)
        return _merge(np.concatenate(self._parts), self._near)


def _merge(stretches: np.ndarray, near: int) -> np.ndarray:
    """Join what is at most `near` rows apart."""
    if stretches.shape[0] < 2:
        return stretches
    begins = np.concatenate([[True], stretches[1:, 0] - stretches[:-1, 1] > near])
    first = np.flatnonzero(begins)
    return np.stack([stretches[first, 0], np.maximum.reduceat(stretches[:, 1], first)], axis=1)
