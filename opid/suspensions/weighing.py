"""Masses that were weighed, beside those that were identified (Iwaniec & Uhl 2007, eq. 11).

A weighed mass without a tolerance is never fitted to: it is the judge of the answer. With a tolerance it is prior
knowledge of the driven model. The structure and the law are found without it; the last fit has it, if it
agrees with what the runs alone say of the mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from opid.estimate import Estimate, Estimates, with_std
from opid.suspensions.settings import WeighingSettings
from opid.suspensions.study import Study


@dataclass(frozen=True)
class PriorMass:
    """Prior knowledge of the reference mass.

    Args:
        kg: the mass.
        tolerance_kg: its standard deviation.
    """

    kg: float
    tolerance_kg: float


@dataclass(frozen=True)
class InverseMass:
    """One over the reference mass by the runs, which is normal, and may be negative where they say little of it.

    Args:
        value: 1/kg.
        std: its standard deviation, 1/kg.
    """

    value: float
    std: float

    @property
    def mass(self) -> Estimate:
        """The mass, kg; empty if it is negative."""
        return Estimate.normal(1 / self.value, self.std / self.value**2) if self.value > 0.0 else Estimate()

    def compare(self, weighed: PriorMass) -> float:
        """Return how many standard deviations the weighed mass is above that of the runs.

        >>> round(InverseMass(1 / 1850, 1e-3 / 1850).compare(PriorMass(1859.0, 3.0)), 1)
        2.6
        """
        std = math.hypot(self.std, weighed.tolerance_kg / weighed.kg**2)
        return (self.value - 1 / weighed.kg) / std


@dataclass(frozen=True)
class WeighedMass(Estimates):
    """The mass of one run by a scale, beside the identified one.

    Args:
        run: name of the run.
        weighed_kg: sprung mass of this run by the scale, M_m.
        tolerance_kg: its standard deviation; the usual one of a scale if none is stated.
        identified_kg: sprung mass of this run by the answer, M_e: that of the reference and the mass change.
        error_percent: (M_m - M_e)/M_m 100 (eq. 11); None if no mass is identified.
        by_runs_kg: sprung mass of this run by the runs alone: the identified one unless weighed masses are prior
            knowledge of the answer; empty if the runs do not determine it.
        deviations: weighed mass minus that of the runs alone, in standard deviations of their difference; None if the
            runs have none with a standard deviation.
        is_prior: whether it is prior knowledge of the answer.
    """

    run: str
    weighed_kg: float
    tolerance_kg: float
    identified_kg: Estimate
    error_percent: float | None
    by_runs_kg: Estimate
    deviations: float | None
    is_prior: bool


def find_prior_mass(study: Study) -> PriorMass | None:
    """Return what the runs that were weighed with a tolerance say of the reference mass; None if there are none.

    Weighings of one study share the error of the scale, so that their mean is known no better than the best of them.

    Args:
        study: the study.
    """
    known = [
        (run.weighed_mass_kg - run.mass_change_kg, run.weighed_tolerance_kg)
        for run in study.runs
        if run.weighed_mass_kg is not None and run.weighed_tolerance_kg is not None
    ]
    if not known:
        return None
    weights = [tolerance**-2 for _, tolerance in known]
    mean = sum(weight * mass for weight, (mass, _) in zip(weights, known, strict=True)) / sum(weights)
    return PriorMass(mean, min(tolerance for _, tolerance in known))


def find_weighed_reference(study: Study) -> float | None:
    """Return the weighed mass of the reference, kg: of the first run that was weighed, less its mass change.

    Args:
        study: the study.

    Returns:
        The mass; None if no run was weighed.
    """
    known = (run.weighed_mass_kg - run.mass_change_kg for run in study.runs if run.weighed_mass_kg is not None)
    return next(known, None)


def relative_error_percent(weighed_kg: float, identified_kg: float) -> float:
    """Return (M_m - M_e)/M_m 100 (eq. 11), positive if the identified mass is too small.

    Args:
        weighed_kg: M_m.
        identified_kg: M_e.

    >>> relative_error_percent(2000.0, 1900.0)
    5.0
    """
    return 100 * (weighed_kg - identified_kg) / weighed_kg


def compare_with_weighed(
    study: Study,
    mass: Estimate,
    *,
    settings: WeighingSettings,
    by_runs: InverseMass | None = None,
    has_prior: bool = False,
) -> tuple[WeighedMass, ...]:
    """Compare the identified mass with the weighed one of each run that has one.

    Args:
        study: the study.
        mass: the identified mass of the reference; empty if it is not determined.
        settings: the usual tolerance of a scale.
        by_runs: what the runs alone say of the reference mass; None if it is the identified mass.
        has_prior: whether weighed masses with a tolerance took part in the identified one.
    """
    if by_runs is None and not has_prior and mass.value is not None and mass.std is not None:
        by_runs = InverseMass(1 / mass.value, mass.std / mass.value**2)
    found = []
    for run in study.runs:
        weighed, change = run.weighed_mass_kg, run.mass_change_kg
        if weighed is None:
            continue
        tolerance = run.weighed_tolerance_kg or settings.usual_fraction * weighed
        here, error = _add(mass, change), None
        if here.value is not None:
            error = relative_error_percent(weighed, here.value)
        is_prior = has_prior and run.weighed_tolerance_kg is not None
        own = Estimate() if by_runs is None else _add(by_runs.mass, change)
        deviations = None if by_runs is None else by_runs.compare(PriorMass(weighed - change, tolerance))
        found.append(WeighedMass(run.name, weighed, tolerance, here, error, own, deviations, is_prior))
    return tuple(found)


def _add(mass: Estimate, change_kg: float) -> Estimate:
    if mass.value is None:
        return Estimate()
    interval = None if mass.interval95 is None else (mass.interval95[0] + change_kg, mass.interval95[1] + change_kg)
    return Estimate(mass.value + change_kg, mass.std, interval)


def warn_of_weighed(study: Study, weighed: Sequence[WeighedMass], settings: WeighingSettings) -> Iterator[str]:
    """Yield the weighed masses that contradict the runs, or each other.

    Args:
        study: the study.
        weighed: its weighed masses.
        settings: from how many standard deviations on there is a contradiction.
    """
    blamed = "mass_change_kg, and the gains of the sensors"
    if study.forces:
        changes_mass = any(run.masses for run in study.runs)
        blamed = f"{'mass_change_kg, ' * changes_mass}and the gains of the forces and of the other sensors"
    for each in weighed:
        if each.deviations is not None and abs(each.deviations) > settings.contradicts_std:
            apart, own = abs(each.deviations), each.by_runs_kg
            theirs = "no positive mass" if own.value is None else f"{with_std(own.value, own.std)} kg"
            yield (
                f"the weighed mass of run {each.run!r}, {with_std(each.weighed_kg, each.tolerance_kg)} kg, contradicts "
                f"the runs, which give {theirs}: {apart:.1f} standard deviations; check what "
                f"was weighed (all that the suspension carries, without wheels), {blamed}; the answer is that of the "
                "runs alone"
            )
    changes = {run.name: run.mass_change_kg for run in study.runs}
    for one, other in combinations(weighed, 2):
        stated, read = changes[other.run] - changes[one.run], other.weighed_kg - one.weighed_kg
        apart = abs(read - stated) / math.hypot(one.tolerance_kg, other.tolerance_kg)
        if apart > settings.contradicts_std:
            yield (
                f"runs {one.run!r} and {other.run!r} differ by {read:.4g} kg on the scale and by {stated:g} kg in "
                f"mass_change_kg, {apart:.1f} standard deviations apart: the identified mass is proportional to "
                "mass_change_kg, so correct it or the weighed masses"
            )
