"""The cheapest plan: expected standard deviations of many plans of runs, from one identification."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Literal

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws.law import law_rows
from opid.progress import Say
from opid.result import SummaryRow
from opid.signals.recording import FloatArray
from opid.suspensions.answer.intervals import Parameters, std_over_white
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.model.body import vertical
from opid.suspensions.model.law_parameters import positive
from opid.suspensions.planning.information import Expectation, expect, measure_information
from opid.suspensions.planning.result import (
    Change,
    Costs,
    ExpectedNumber,
    Plan,
    PlannedRun,
    PlanResult,
    StdGrid,
    Target,
)
from opid.suspensions.result import GearParameters, Identification, estimate_rows, units_of_suspensions

_NEAR_ZERO = 1e-6
_WITHOUT_SCALE = ("natural_frequency_hz", "damping_ratio", "x_cg_m", "y_cg_m")
"""Numbers that need no mass."""

_UNITS_IN_NAMES = ("kg", "n_per_m", "n_s_per_m", "hz", "kg_m2", "m")


@dataclass(frozen=True)
class SearchSpace:
    """The plans that are tried: for each of these values, `n` runs without a mass change and `n` with it.

    Args:
        durations_s: durations of a run, s.
        mass_changes_kg: mass changes, kg, negative if mass is taken off; empty for those of `PlanSettings`. A single 0
            stands for no mass change at all.
        n_runs: numbers n of runs without and with the mass change.
        places_m: places (x, y) of the mass on a body, m; empty for the interfaces. They have no effect on one gear.

    Raises:
        InputError: no duration or number of runs, or one that cannot be.
    """

    durations_s: tuple[float, ...] = (20.0, 40.0, 80.0, 160.0, 320.0, 640.0)
    mass_changes_kg: tuple[float, ...] = ()
    n_runs: tuple[int, ...] = (1, 2, 3, 4)
    places_m: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not self.durations_s or not self.n_runs:
            raise InputError("there is no duration or no number of runs to try: give at least one of each")
        for duration_s, change_kg in product(self.durations_s, self.mass_changes_kg or (0.0,)):
            PlannedRun(duration_s, change_kg)
        if not all(1 <= each <= 50 for each in self.n_runs):
            raise InputError(f"the numbers of runs to try are {self.n_runs}: give numbers from 1 to 50")


@dataclass(frozen=True)
class PlanSettings:
    """Tuned numbers of planning.

    Args:
        change_fractions: mass changes that are tried if none are named, as fractions of the guessed mass: less than a
            twentieth shows little, more than three tenths makes another aircraft.
        n_draws: number of draws of how runs happen to differ; expected standard deviations are their medians, which
            forty draws give to about a tenth.
        n_quick_draws: number of draws for a first look at a plan: eight suffice to see that it is hopeless.
        hopeless_factor: a plan is hopeless, and is not computed with all draws, if it exceeds a target by more than
            this factor at the first look.
        seed: seed of these draws, the same for all plans, so that plans are compared under the same luck.
        correlation: two numbers are called hardly separable above this correlation: each would then be known more than
            three times as well if the other were known.
        named_component: the numbers named in a direction have at least this fraction of its largest component.
        wrong_factor: mass and stiffness may be too small or too large by this factor: a guess that is 20 % too small is
            0.8 of the truth.
        range_margin: the range for a wrong guess is wider by this factor at both ends: the motion below the suspension
            is not simulated anew for each wrong guess, and the information of a road scatters.
        road_class: factor on the motion from one ISO 8608 class to the next, whose spectral densities differ by 4.
    """

    change_fractions: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.3)
    n_draws: int = 40
    n_quick_draws: int = 8
    hopeless_factor: float = 2.0
    seed: int = 0
    correlation: float = 0.95
    named_component: float = 0.3
    wrong_factor: float = 1.25
    range_margin: float = 1.3
    road_class: float = 2.0


@dataclass(frozen=True, eq=False)
class Planner:
    """Expected standard deviations of any runs, from the parameters of one fit.

    Args:
        fit: the guessed parameters, with the noise of the planned sensors and one run or more whose motion below the
            suspensions is repeated.
        std_factors: (n_shared,) factors of the standard deviations for a coloured residual.
        repeatability: relative standard deviation of springs, damping and friction from run to run, as it is stated.
        made: (n, n) information of each run that was made already.
        settings: settings of planning.
        road_factor: factor on all motions below the suspensions.
        is_alike: whether the runs turn out to be alike, whatever was stated.
    """

    fit: Fit
    std_factors: FloatArray
    repeatability: float
    made: tuple[FloatArray, ...]
    settings: PlanSettings
    road_factor: float = 1.0
    is_alike: bool = False
    _rates: dict[tuple[float, ...], FloatArray] = field(init=False, default_factory=dict)

    @property
    def is_one_gear(self) -> bool:
        """Whether the body is one gear, on which a mass has no place."""
        return len(self.fit.model.body.dof) == 1

    def _loading(self, run: PlannedRun) -> FloatArray:
        row = np.ones(1) if self.is_one_gear else vertical(run.x_m, run.y_m)
        return run.mass_change_kg * np.outer(row, row)

    def _information(self, run: PlannedRun) -> FloatArray:
        """Return the information of a run; the motion is that of the recorded runs whose loading is nearest."""
        place = (0.0, 0.0) if self.is_one_gear or not run.mass_change_kg else (run.x_m, run.y_m)
        key = (run.mass_change_kg, *place)
        if key not in self._rates:
            loading = self._loading(run)
            apart = [float(np.linalg.norm(each.loading - loading)) for each in self.fit.model.runs]
            near = [k for k, each in enumerate(apart) if each <= min(apart) + _NEAR_ZERO]
            rates = [measure_information(self.fit, k, loading=loading, road_factor=self.road_factor) for k in near]
            self._rates[key] = np.mean(rates, axis=0)
        return run.duration_s * self._rates[key]

    def expect(self, runs: Sequence[PlannedRun]) -> Expectation:
        """Return what the runs that were made and these determine together."""
        model, shared = self.fit.model, self.fit.theta[: self.fit.model.n_shared]
        first = replace(model, runs=model.runs[:1], repeatability=0.0)
        start = self.fit.theta[model.indices_of_run(0)[0]]
        reference = Fit(first, np.concatenate([shared, start]), self.fit.errors, 0)
        return expect(
            reference,
            [*self.made, *(self._information(each) for each in runs)],
            repeatability=self.repeatability,
            actual=0.0 if self.is_alike else self.repeatability,
            std_factors=np.append(self.std_factors, np.ones(start.size)),
            n_draws=self.settings.n_draws,
            rng=np.random.default_rng(self.settings.seed),
        )

    def numbers(self, runs: Sequence[PlannedRun]) -> tuple[ExpectedNumber, ...]:
        """Return the numbers that an identification of these runs will give, with expected standard deviations."""
        cases = [list(_list_numbers(each)) for each in self.expect(runs).cases]
        found = tuple(_summarise(rows) for rows in zip(*cases, strict=True))
        (mass,) = (each for each in found if each.name == "sprung_mass_kg")
        if mass.std is not None and mass.std <= self.fit.model.settings.verdicts.loosely_known * abs(mass.value):
            return found
        # An identification that knows the mass so loosely gives no absolute value.
        return tuple(each if each.name in _WITHOUT_SCALE else replace(each, std=None, std_range=None) for each in found)

    def std_of(self, runs: Sequence[PlannedRun], targets: Sequence[Target]) -> tuple[float | None, ...]:
        """Return the expected standard deviation of each target; None where it is not determined, or cannot be."""
        try:
            found = {each.name: each.std for each in self.numbers(runs)}
        except UnboundedResponseError:
            return (None,) * len(targets)
        return tuple(found[each.name] for each in targets)

    def with_theta(self, theta: FloatArray) -> Planner:
        """Return a planner at other parameters."""
        return replace(self, fit=replace(self.fit, theta=theta))

    def with_noise(self, factor: float) -> Planner:
        """Return a planner with more or less noise of all sensors."""
        below, above = self.fit.model.noise
        return replace(
            self, fit=replace(self.fit, model=replace(self.fit.model, noise=(factor * below, factor * above)))
        )


def plan_runs(
    identification: Identification,
    targets: Sequence[str],
    *,
    runs: Sequence[PlannedRun] | None = None,
    noise_m_per_s2: float | None = None,
    repeatability: float | None = None,
    search: SearchSpace | None = None,
    costs: Costs | None = None,
    settings: PlanSettings | None = None,
    title: str = "",
    road: str = "as in the runs of the study",
    progress: Say | None = None,
) -> PlanResult:
    """Return the cheapest plan of runs by which an identification will reach the targets.

    The expected standard deviations are those that `identify` will state if the guessed parameters are right: those of
    the Fisher information of its own prediction errors, weighed over the possible values of the repeatability as it
    does (`opid.suspensions.planning.information`). A plan has as many runs without as with a mass change, all of one
    duration. The cheapest plan is the one with the smallest sum of costs among those that reach all targets.

    Args:
        identification: the guessed parameters, and the motion below the suspensions: of runs that were made, or of
            simulated ones.
        targets: "sprung_mass_kg=0.5%" for a standard deviation of half a per cent, or "x_cg_m=0.01" for one in the
            unit of the number. A unit at the end of a name may be left out.
        runs: planned runs of a guess, whose results are told beside the cheapest plan. If left out, the runs of the
            identification were really made, and the plan adds runs to them.
        noise_m_per_s2: noise of all sensors; if left out, that which the runs showed.
        repeatability: what the study of the planned runs will state; if left out, what that of the identification does.
        search: the plans that are tried.
        costs: what a plan costs.
        settings: tuned numbers.
        title: title of the plan; that of the study if left out.
        road: the assumed road, in words.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: no target, one that is no number of the identification, or one that is not positive.
        NotDeterminedError: an identification without a mass, of several separate gears, or one that noise does not
            limit, so that more runs would not help as planned.
    """
    settings, say = settings or PlanSettings(), progress or (lambda step: None)
    search, costs = search or SearchSpace(), costs or Costs()
    if not targets:
        raise InputError("there is no target: give one or more, such as 'sprung_mass=0.5%'")
    planner = _make_planner(identification, runs is None, noise_m_per_s2, repeatability, settings)
    say("planned runs")
    planned = Plan(tuple(runs or ()), costs.of(tuple(runs or ())), planner.numbers(tuple(runs or ())))
    wanted = tuple(_read_target(each, planned.numbers) for each in targets)
    space = _fill_space(search, planner, identification, planned)
    say("plans")
    cheapest, best, n_tried = _search(planner, space, costs, wanted, is_added=runs is None)
    say("what changes them")
    changes = tuple(_list_changes(planner, best, costs, wanted))
    say("duration and mass change")
    reason = None if cheapest is not None else _why_not(planner, space, wanted, best, n_tried)
    below, above = planner.fit.model.noise
    return PlanResult(
        title=title or identification.title,
        source=str(identification.study.source or ""),
        is_study=runs is None,
        targets=wanted,
        planned=planned,
        cheapest=cheapest,
        best=best,
        n_tried=n_tried,
        changes=changes,
        ranges=_find_ranges(planner, best, wanted, changes),
        inseparable=tuple(_list_inseparable(planner, best)),
        grid=_fill_grid(planner, space, best, wanted),
        costs=costs,
        repeatability=planner.repeatability,
        law=planner.fit.law_name,
        road=road,
        noise_m_per_s2=(float(below.mean()), float(above.mean())),
        not_determined=reason,
        read_files=identification.files if runs is None else (),
    )


def _make_planner(
    identification: Identification,
    is_study: bool,
    noise_m_per_s2: float | None,
    repeatability: float | None,
    settings: PlanSettings,
) -> Planner:
    if identification.not_determined:
        raise NotDeterminedError(
            f"nothing can be planned from this identification, which has no mass: {identification.not_determined}"
        )
    if len(identification.evidence) != 1:
        raise NotDeterminedError(
            f"the answer for this study is {identification.structure!r}, gears that were fitted one by one: plan the "
            "runs of one gear, with a study of its two channels"
        )
    evidence, study = identification.evidence[0], identification.study
    if identification.limited_by != "noise":
        raise NotDeterminedError(
            f"these runs leave {identification.residual_over_noise:.3g} times the sensors' noise and are limited by "
            f"{identification.limited_by}: more runs do not narrow intervals as they do for noise, so nothing is "
            "planned; find the reason first"
        )
    fit, n_shared = evidence.fit, evidence.fit.model.n_shared
    below, above = (fit.ratio * side for side in fit.model.noise)
    if noise_m_per_s2 is not None:
        below, above = np.full(below.size, noise_m_per_s2), np.full(above.size, noise_m_per_s2)
    base = replace(fit, model=replace(fit.model, noise=(below, above)))
    made = []
    for index, run in enumerate(fit.model.runs if is_study else ()):
        duration_s = run.n_samples / run.fs
        made.append(duration_s * measure_information(base, index, loading=run.loading))
    stated = study.repeatability if repeatability is None else repeatability
    return Planner(
        base,
        std_over_white(fit)[:n_shared] if is_study else np.ones(n_shared),
        fit.model.settings.repeatability.usual if stated is None else stated,
        tuple(made),
        settings,
    )


# ---- numbers ---------------------------------------------------------------------------------------


def _list_numbers(known: Parameters) -> Iterator[SummaryRow]:
    """Yield the numbers of an identification with these parameters, under the names of its summary."""
    fit, model = known.fit, known.fit.model
    scale = 1.0 / model.inverse_mass(fit.theta)
    laws = [law.scaled(scale) if law.terms else law for law in model.laws(fit.theta)]
    if len(model.body.dof) == 1:
        stiffness, damping, estimates = known.suspension(0)
        rows = estimate_rows(GearParameters(known.mass, stiffness, damping))
        yield from (row for row in rows if row.value is not None)
        yield from law_rows(laws[0], estimates, "law")
        ratios = estimate_rows(known.gear_ratios(Estimate()))
        yield from (row for row in ratios if row.name in _WITHOUT_SCALE)
        return
    body, _ = known.estimate_rigid_body()
    yield from estimate_rows(body)
    units = units_of_suspensions(per_mass=False)
    for number, (group, law) in enumerate(zip(model.groups, laws, strict=True)):
        stiffness, damping, estimates = known.suspension(number)
        yield SummaryRow.of(f"{group.name}.stiffness", stiffness, units[0])
        yield SummaryRow.of(f"{group.name}.damping", damping, units[1])
        yield from law_rows(law, estimates, f"{group.name}.law")


def _summarise(rows: Sequence[SummaryRow]) -> ExpectedNumber:
    """Return a number with the median of its standard deviations over the cases."""
    first, std = rows[0], np.array([np.inf if row.std is None else row.std for row in rows])
    middle = float(np.median(std))
    if first.value is None or not np.isfinite(middle):
        return ExpectedNumber(first.name, first.unit, first.value or 0.0, None)
    # One of several cases may leave the number undetermined.
    ends = np.quantile(np.minimum(std, 1e300), (0.1, 0.9)).tolist()
    return ExpectedNumber(first.name, first.unit, first.value, middle, tuple(ends) if len(rows) > 1 else None)


def _read_target(words: str, numbers: Sequence[ExpectedNumber]) -> Target:
    """Return a target such as "sprung_mass=0.5%"; the unit at the end of the name may be left out."""
    found = re.fullmatch(r"\s*([^=\s]+)\s*=\s*([0-9.eE+-]+)\s*(%?)\s*", words)
    if found is None:
        raise InputError(f"the target is {words!r}: give a number and its standard deviation, as 'sprung_mass=0.5%'")
    name, amount, percent = found.groups()
    known = {each.name: each for each in numbers}
    short = [each for each in known if each.startswith(f"{name}_") and each.removeprefix(f"{name}_") in _UNITS_IN_NAMES]
    meant = known.get(name) or (known[short[0]] if len(short) == 1 else None)
    if meant is None:
        raise InputError(f"the target {words!r} names no number of the identification: {nearest(name, known)}")
    try:
        size = float(amount)
    except ValueError:
        size = np.nan
    std = 0.01 * size * abs(meant.value) if percent else size
    if not 0.0 < std < np.inf:
        raise InputError(f"the target {words!r} has no positive standard deviation: give one, as '{meant.name}=0.5%'")
    return Target(meant.name, std, words.strip())


# ---- plans -----------------------------------------------------------------------------------------


def _fill_space(search: SearchSpace, planner: Planner, identification: Identification, planned: Plan) -> SearchSpace:
    """Return the space with its mass changes and places, rounded fractions of the mass and the interfaces if left out.

    Mass is taken off, or put on, as in the planned runs or in those that were made.
    """
    changes, places = search.mass_changes_kg, search.places_m
    if not changes:
        known = [each.mass_change_kg for each in planned.runs] + [
            run.mass_change_kg for run in identification.study.runs if planner.made
        ]
        sign = -1.0 if sum(known) < 0.0 or (planner.is_one_gear and not sum(known)) else 1.0
        mass_kg = next(each.value for each in planned.numbers if each.name == "sprung_mass_kg")
        changes = tuple(sign * float(f"{each * mass_kg:.2g}") for each in planner.settings.change_fractions)
    if planner.is_one_gear:
        places = ((0.0, 0.0),)
    elif not places:
        places = tuple(each.place for each in identification.study.interfaces)
    return replace(search, mass_changes_kg=changes, places_m=places)


def _make_runs(
    duration_s: float, change_kg: float, place_m: tuple[float, float], n_runs: tuple[int, int]
) -> tuple[PlannedRun, ...]:
    """Return runs without and with the mass change, alternately."""
    loaded = PlannedRun(duration_s, change_kg, *(place_m if change_kg else (0.0, 0.0)))
    bare, both = PlannedRun(duration_s), min(n_runs)
    return (bare, loaded) * both + (bare,) * (n_runs[0] - both) + (loaded,) * (n_runs[1] - both)


def _search(
    planner: Planner, space: SearchSpace, costs: Costs, targets: Sequence[Target], *, is_added: bool
) -> tuple[Plan | None, Plan, int]:
    """Return the cheapest plan that reaches the targets, or None, the nearest one, and how many were tried."""
    counts = [(n, n) for n in space.n_runs] + [(0, n) for n in space.n_runs if is_added]
    kinds = product(space.durations_s, space.mass_changes_kg, space.places_m, counts)
    plans = sorted((_make_runs(*kind) for kind in kinds), key=costs.of)
    if is_added:
        plans.insert(0, ())
    known = planner.settings
    quick = replace(planner, settings=replace(known, n_draws=known.n_quick_draws))
    near, least = plans[-1], np.inf
    for n_tried, runs in enumerate(plans, start=1):
        lack = _measure_lack(quick, runs, targets)
        if lack < least:
            near, least = runs, lack
        if lack <= known.hopeless_factor and _measure_lack(planner, runs, targets) <= 1.0:
            found = Plan(runs, costs.of(runs), planner.numbers(runs))
            return found, found, n_tried
    if not np.isfinite(least):
        # No plan determines all targets; the dearest one has most of the rest.
        near = next((runs for runs in reversed(plans) if _can_be_carried(planner, runs)), ())
    return None, Plan(near, costs.of(near), planner.numbers(near)), len(plans)


def _measure_lack(planner: Planner, runs: Sequence[PlannedRun], targets: Sequence[Target]) -> float:
    """Return the largest factor by which the runs exceed a target; infinite if one is not determined."""
    std = planner.std_of(runs, targets)
    return max(_over(each) / target.std for each, target in zip(std, targets, strict=True))


def _can_be_carried(planner: Planner, runs: Sequence[PlannedRun]) -> bool:
    """Whether the suspensions carry the mass changes of some runs."""
    try:
        planner.numbers(runs)
    except UnboundedResponseError:
        return False
    return True


def _over(std: float | None) -> float:
    return np.inf if std is None else std


def _why_not(planner: Planner, space: SearchSpace, targets: Sequence[Target], best: Plan, n_tried: int) -> str:
    """Return why no plan reaches the targets."""
    lacking = [each for each in targets if _over(best.std_of(each.name)) > each.std]
    first = lacking[0]
    std = best.std_of(first.name)
    if std is None and not any(space.mass_changes_kg) and not any(planner.made):
        return (
            f"no planned run changes the mass, so these runs give only ratios to it, and nothing of {first.name}: plan "
            "runs with a mass change"
        )
    if std is None:
        return f"none of the {n_tried} plans that were tried determines {first.name}: change the mass more"
    value = next(each.value for each in best.numbers if each.name == first.name)
    of_value = f" ({100 * std / abs(value):.2g} %)" if value else ""
    remedy = (
        "the runs may differ, and only more runs with each mass, or a smaller repeatability that is shown to hold, help"
        if planner.repeatability and _is_ruled_by_repeatability(planner, best, first.name)
        else "try longer runs, a larger mass change, or less noise"
    )
    return (
        f"none of the {n_tried} plans that were tried reaches {first.words}: the best one gives {first.name} with a "
        f"standard deviation of {std:.3g}{of_value}; {remedy}"
    )


def _is_ruled_by_repeatability(planner: Planner, plan: Plan, name: str) -> bool:
    """Whether a standard deviation would at least be halved if all runs were alike."""
    alike = replace(planner, repeatability=0.0).numbers(plan.runs)
    std = next(each.std for each in alike if each.name == name)
    return std is not None and std < 0.5 * _over(plan.std_of(name))


def _fill_grid(planner: Planner, space: SearchSpace, best: Plan, targets: Sequence[Target]) -> StdGrid:
    """Return standard deviations over duration and mass change, with as many runs and the place of the best plan."""
    loaded = [each for each in best.runs if each.mass_change_kg]
    n_runs = (len(best.runs) - len(loaded), len(loaded)) if best.runs else (1, 1)
    place = (loaded[0].x_m, loaded[0].y_m) if loaded else space.places_m[0]
    rows = []
    for change_kg in space.mass_changes_kg:
        columns = []
        for duration_s in space.durations_s:
            columns.append(planner.std_of(_make_runs(duration_s, change_kg, place, n_runs), targets))
        rows.append(columns)
    table = tuple(tuple(tuple(cell[k] for cell in row) for row in rows) for k in range(len(targets)))
    return StdGrid(space.durations_s, space.mass_changes_kg, place, n_runs, table)


# ---- what changes them -----------------------------------------------------------------------------


def _list_changes(planner: Planner, best: Plan, costs: Costs, targets: Sequence[Target]) -> Iterator[Change]:
    """Yield how the standard deviations of a plan change if one thing differs."""
    known, fit = planner.settings, planner.fit

    def change(what: str, of: Literal["guess", "plan"], planner: Planner, runs: tuple[PlannedRun, ...]) -> Change:
        return Change(what, of, planner.std_of(runs, targets))

    if not planner.made:
        for factor in (known.wrong_factor, 1 / known.wrong_factor):
            word = _say_factor(factor)
            yield change(f"{word} mass", "guess", planner.with_theta(_change_mass(fit, factor)), best.runs)
        for factor in (known.wrong_factor, 1 / known.wrong_factor):
            word = _say_factor(factor)
            yield change(f"{word} stiffness", "guess", planner.with_theta(_change_stiffness(fit, factor)), best.runs)
        for factor, word in ((2.0, "twice"), (0.5, "half")) if any(_first_entries(fit)) else ():
            stronger = planner.with_theta(_change_law(fit, factor))
            yield change(f"{word} the force of the law", "guess", stronger, best.runs)
    for factor, word in ((known.road_class, "rougher"), (1 / known.road_class, "smoother")):
        rougher = replace(planner, road_factor=factor * planner.road_factor)
        yield change(f"a road one class {word}", "guess", rougher, best.runs)
    if planner.repeatability:
        yield change("runs that turn out to be alike", "guess", replace(planner, is_alike=True), best.runs)
    for factor, word in ((2.0, "twice"), (0.5, "half")):
        yield change(f"{word} the noise", "plan", planner.with_noise(factor), best.runs)
    longer = tuple(replace(each, duration_s=2.0 * each.duration_s) for each in best.runs)
    yield change("runs twice as long", "plan", planner, longer)
    yield change("each run made twice", "plan", planner, best.runs * 2)
    more = tuple(replace(each, mass_change_kg=2.0 * each.mass_change_kg) for each in best.runs)
    yield change("twice the mass change", "plan", planner, more)
    if planner.repeatability:
        yield change(
            "runs that are known to be alike (repeatability 0)", "plan", replace(planner, repeatability=0.0), best.runs
        )


def _say_factor(factor: float) -> str:
    percent = 100 * (factor - 1)
    return f"{abs(percent):.0f} % {'more' if percent > 0 else 'less'}"


def _first_entries(fit: Fit) -> Iterator[int]:
    """Yield the entry of the amplitude of each term of each law, except for gas that carries the weight."""
    carried = {index for _, index in fit.model.carriers}
    for number, group in enumerate(fit.model.groups):
        index = fit.model.law_indices(number).start
        for term in group.law.terms:
            if index not in carried:
                yield index
            index += len(term.values)


def _change_mass(fit: Fit, factor: float) -> FloatArray:
    """Return the vector with another mass on the same suspensions."""
    theta, model = fit.theta.copy(), fit.model
    entries = [*_first_entries(fit), model.names.index("inverse_mass")]
    for first, group in zip(model.first_of_group, model.groups, strict=True):
        entries += range(first, first + 2 + group.ground)
    theta[entries] /= factor
    return theta


def _change_stiffness(fit: Fit, factor: float) -> FloatArray:
    """Return the vector with other springs beside the law."""
    theta = fit.theta.copy()
    theta[list(fit.model.first_of_group)] *= factor
    return theta


def _change_law(fit: Fit, factor: float) -> FloatArray:
    """Return the vector with a stronger or weaker law."""
    theta = fit.theta.copy()
    theta[list(_first_entries(fit))] *= factor
    return theta


def _find_ranges(
    planner: Planner, best: Plan, targets: Sequence[Target], changes: Sequence[Change]
) -> tuple[tuple[float, float] | None, ...]:
    """Return the lowest and the highest standard deviation of each target if the guess is wrong.

    Mass, stiffness and road are wrong all at once in every combination, or one of the changes stands alone.
    """
    known = planner.settings
    factors = (1.0,) if planner.made else (known.wrong_factor, 1 / known.wrong_factor)
    found = [tuple(best.std_of(each.name) for each in targets), *(each.std for each in changes if each.of == "guess")]
    for mass, stiffness, road in product(factors, factors, (known.road_class, 1 / known.road_class)):
        heavier = planner.with_theta(_change_mass(planner.fit, mass))
        stiffer = heavier.with_theta(_change_stiffness(heavier.fit, stiffness))
        found.append(replace(stiffer, road_factor=road * planner.road_factor).std_of(best.runs, targets))
    margin = known.range_margin
    return tuple(
        None if None in each else (min(map(_over, each)) / margin, max(map(_over, each)) * margin)
        for each in zip(*found, strict=True)
    )


# ---- what cannot be told apart ---------------------------------------------------------------------


def _list_inseparable(planner: Planner, plan: Plan) -> Iterator[str]:
    """Yield what the runs cannot tell apart: small eigenvalues of the information of relative changes, in words."""
    fit, model, known = planner.fit, planner.fit.model, planner.settings
    names = _name_unknowns(fit)
    theta, n_known = fit.theta[: model.n_shared], len(names)
    size = np.abs(theta[:n_known])
    for number, group in enumerate(model.groups):
        indices = model.law_indices(number)
        size[indices] = np.where(positive(group.law), 1.0, size[indices])
    size = np.where(size > _NEAR_ZERO * size.max(), size, 1.0)
    information = planner.expect(plan.runs).information[:n_known, :n_known] * np.outer(size, size)
    loose = model.settings.verdicts.loosely_known
    sizes, directions = np.linalg.eigh(information)
    lost = set()
    for value, direction in zip(sizes, directions.T, strict=True):
        if value * loose**2 >= 1.0:
            break
        chosen = np.flatnonzero(np.abs(direction) >= known.named_component * np.abs(direction).max())
        lost |= set(chosen.tolist())
        yield _describe_direction([names[k] for k in chosen], direction[chosen], value)
    kept = [k for k in range(n_known) if k not in lost]
    covariance = np.linalg.pinv(information[np.ix_(kept, kept)], rcond=1e-13, hermitian=True)
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(std, std)
    for i, k in zip(*np.triu_indices(len(kept), 1), strict=True):
        if abs(correlation[i, k]) > known.correlation:
            times = 1.0 / math.sqrt(max(1.0 - correlation[i, k] ** 2, 1e-12))
            yield (
                f"{names[kept[i]]} and {names[kept[k]]} can hardly be told apart (correlation "
                f"{correlation[i, k]:+.3f}): each would be known {times:.2g} times as well if the other were known"
            )


def _describe_direction(names: Sequence[str], direction: FloatArray, information: float) -> str:
    """Return in words that a direction of relative changes is not determined."""
    if len(names) == 1:
        return f"these runs do not determine {names[0]}: it may change by any amount that is plausible and not be seen"
    scale = 10.0 / float(np.abs(direction).max())
    moves = ", ".join(f"{name} {scale * each:+.2g} %" for name, each in zip(names, direction, strict=True))
    std = 100.0 / math.sqrt(information) if information > 0.0 else np.inf
    unseen = "have no effect that is seen" if std > 1e4 else f"are unseen up to {std / 10.0:.2g} times as much"
    return f"{' and '.join(names)} cannot be told apart: together, {moves} {unseen}"


def _name_unknowns(fit: Fit) -> list[str]:
    """Return the names of the shared unknowns that describe body and suspensions, in the order of the vector."""
    model, names = fit.model, []
    for group in model.groups:
        heads = ["stiffness over mass", "damping over mass"]
        heads += ["ground stiffness over mass"] * group.ground + ["position of rest"] * group.has_origin
        for term in group.law.terms:
            parameters = [parameter.name for parameter in term.kind.parameters]
            heads += [f"{term.name}.{parameters[0]} over mass", *(f"{term.name}.{each}" for each in parameters[1:])]
        names += [group.name_of(head) for head in heads]
    names += [name for name in model.names[len(names) : model.first_fault] if name != "inverse_mass"]
    return [*names, "sprung mass"]
