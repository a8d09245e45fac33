"""What changed in the suspensions from one run to another, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from opid.mechanics.repeatability import PARTS, part_of
from opid.suspensions.candidates import Fitted

_PARTS_IN_WORDS = {"spring": "the stiffness", "damper": "the damping", "friction": "the friction"}


def run_differences(part: Fitted) -> Iterator[str]:
    """Yield what differs between runs by more than its interval, against the first run, one sentence each.

    Args:
        part: a fitted structure.
    """
    fit, alike, study = part.fit, part.repeatability, part.task.study
    if part.known.levels is None:
        return
    if alike.exceeds and not alike.is_usual:
        yield (
            f"the runs differ by about {100 * (alike.estimated or 0.0):.1g} % in stiffness, damping or friction, more "
            f"than the stated repeatability of {100 * alike.stated:.2g} %: state a larger one, or look for what changed"
        )
    for number, group in enumerate(fit.model.groups):
        where = f" at {group.name!r}" * bool(group.name)
        changes = [_Change.of(part, number, place) for place in range(1, len(part.runs))]
        for change in changes:
            yield from _of_unlike_run(part, change, where)
        is_alone = fit.model.body.n_slots == 1 and (study is None or study.is_one_gear)
        if is_alone and changes:
            yield from _of_another_mass(part, max(changes, key=lambda change: abs(change.common[0])))


@dataclass(frozen=True)
class _Change:
    """What a group of a run has changed against the first run: values with their standard deviations.

    Args:
        place: of the run.
        single: of each part that the group has.
        unlike: of one part less another.
        common: of all parts together, their mean.
    """

    place: int
    single: Mapping[str, tuple[float, float]]
    unlike: Mapping[tuple[str, str], tuple[float, float]]
    common: tuple[float, float]

    @classmethod
    def of(cls, part: Fitted, number: int, place: int) -> _Change:
        """Return the change of a group of a run."""
        model = part.fit.model
        parts = ["spring", "damper", *{part_of(term.kind) for term in model.groups[number].law.terms} - set(PARTS[:2])]

        def change(weights: Mapping[str, float]) -> tuple[float, float]:
            slopes = np.zeros(part.fit.theta.size)
            for run, sign in ((place, 1.0), (0, -1.0)):
                first = model.places_of_run(run)[1].start + number * len(PARTS)
                for name, weight in weights.items():
                    slopes[first + PARTS.index(name)] = sign * weight
            return float(slopes @ part.fit.theta), part.known.deviation(slopes)

        return cls(
            place,
            {name: change({name: 1.0}) for name in parts},
            {(a, b): change({a: 1.0, b: -1.0}) for a, b in combinations(parts, 2)},
            change({name: 1 / len(parts) for name in parts}),
        )

    @property
    def surest(self) -> tuple[str, str]:
        """The two parts that are told apart best."""
        return max(self.unlike, key=lambda pair: abs(self.unlike[pair][0]) / self.unlike[pair][1])


def _of_unlike_run(part: Fitted, change: _Change, where: str) -> Iterator[str]:
    """A part that changed by more than its interval; else two that changed by ratios that differ."""
    names, known = part.task.run_names, part.settings.warnings
    named, than = f"{where} in run {names[change.place]!r}", f"in run {names[0]!r}"
    certain = [name for name, (value, std) in change.single.items() if abs(value) > known.unlike_std * std]
    for name in certain:
        value, std = change.single[name]
        yield (
            f"{_PARTS_IN_WORDS[name]}{named} is {100 * abs(value):.2g} +- {100 * std:.1g} % "
            f"{'more' if value > 0 else 'less'} than {than}"
        )
    value, std = change.unlike[change.surest]
    if not certain and abs(value) > known.unlike_std * std:
        first, second = (_PARTS_IN_WORDS[name] for name in change.surest)
        yield (
            f"{first} and {second}{named} are not those {than}: one of them changed by {100 * abs(value):.2g} +- "
            f"{100 * std:.1g} % against the other, and which is not told; further runs with the masses in turn would "
            "tell"
        )


def _of_another_mass(part: Fitted, change: _Change) -> Iterator[str]:
    """All forces of a run changed by one ratio: that is what another mass does, and no strut."""
    (common, _), (differs, std), names = change.common, change.unlike[change.surest], part.task.run_names
    if abs(common) < part.settings.warnings.as_one * max(abs(differs), std):
        return
    model, wrong = part.fit.model, ""
    if model.mass_free:
        change_kg = float(model.runs[change.place].loading[0, 0])
        off_kg = abs(common) * (1 / model.inverse_mass(part.fit.theta) + change_kg)
        wrong = f", as if it carried {off_kg:.0f} kg {'less' if common > 0 else 'more'} than stated"
    key = "loadings" if part.task.study is None else "mass_change_kg"
    yield (
        f"stiffness, damping and friction in run {names[change.place]!r} are all {100 * abs(common):.2g} % "
        f"{'more' if common > 0 else 'less'} than in run {names[0]!r}{wrong}: check the {key} of all runs"
    )
