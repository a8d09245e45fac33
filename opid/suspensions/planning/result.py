"""Result of planning: what runs will determine, what they cannot tell apart, and the cheapest plan for the targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from opid.errors import InputError
from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow

SCHEMA = "opid.plan/1"


@dataclass(frozen=True)
class PlannedRun:
    """A run that is planned, or that was made already.

    Args:
        duration_s: duration of the recording, s.
        mass_change_kg: mass that it carries more than the reference, kg; negative if mass is taken off.
        x_m: place of that mass on a body, forward, m; it has no effect on one gear.
        y_m: place of that mass on a body, to the left, m; it has no effect on one gear.

    Raises:
        InputError: a duration that is not positive, or a value that is not finite.
    """

    duration_s: float
    mass_change_kg: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0

    def __post_init__(self) -> None:
        if not 10.0 <= self.duration_s <= 1e6:
            raise InputError(f"a planned run lasts {self.duration_s:g} s: give 10 s or more, at most 1e6 s")
        if not max(map(abs, (self.mass_change_kg, self.x_m, self.y_m))) < 1e6:
            raise InputError(
                f"a planned run carries {self.mass_change_kg} kg at ({self.x_m}, {self.y_m}) m: give finite numbers"
            )


@dataclass(frozen=True)
class Costs:
    """What a plan costs. The cheapest plan is the one with the smallest sum over its runs.

    The usual values are minutes of the crew: a run takes ten minutes of taxiing back and of starting the recorders
    besides its recording, and ten minutes go by while 100 kg are put on and fastened, or taken off.

    Args:
        per_run: cost of each run.
        per_s: cost of each second of recording.
        per_kg: cost of each kilogram of mass change, in each run that has it.
        unit: unit of these costs.

    Raises:
        InputError: a negative cost, or no cost at all.
    """

    per_run: float = 10.0
    per_s: float = 1 / 60
    per_kg: float = 0.1
    unit: str = "min"

    def __post_init__(self) -> None:
        each = (self.per_run, self.per_s, self.per_kg)
        if not (min(each) >= 0.0 and 0.0 < sum(each) < 1e100):
            raise InputError(f"the costs are {each}: give numbers that are not negative, and one that is positive")

    def of(self, runs: tuple[PlannedRun, ...]) -> float:
        """Return the cost of some runs."""
        return sum(
            self.per_run + self.per_s * each.duration_s + self.per_kg * abs(each.mass_change_kg) for each in runs
        )


@dataclass(frozen=True)
class Target:
    """A standard deviation that a plan is to reach.

    Args:
        name: of the number, as in the summary of an identification.
        std: the standard deviation, in the unit of the number.
        words: the target as it was given.
    """

    name: str
    std: float
    words: str


@dataclass(frozen=True)
class ExpectedNumber:
    """A number that an identification of the planned runs will give, with its expected standard deviation.

    Args:
        name: of the number.
        unit: its unit.
        value: the guessed value.
        std: expected standard deviation; None if the runs do not determine the number.
        std_range: standard deviations that one of ten identifications is below, and one of ten above, because of how
            the runs happen to differ; None if the runs are alike, or if the number is not determined.
    """

    name: str
    unit: str
    value: float
    std: float | None
    std_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Plan:
    """Some runs, with what they cost and what they will determine.

    Args:
        runs: the runs that are still to be made.
        cost: their cost.
        numbers: what an identification of them, with the runs that were made before, will give.
    """

    runs: tuple[PlannedRun, ...]
    cost: float
    numbers: tuple[ExpectedNumber, ...]

    def std_of(self, name: str) -> float | None:
        """Return the expected standard deviation of a number; None if it is not determined."""
        return next(each.std for each in self.numbers if each.name == name)


@dataclass(frozen=True)
class Change:
    """How the expected standard deviations change if one thing differs from what was assumed.

    Args:
        what: the difference, in words.
        of: "guess" for something that may have been guessed wrong, "plan" for something that can be chosen.
        std: expected standard deviation of each target; None where it is not determined.
    """

    what: str
    of: Literal["guess", "plan"]
    std: tuple[float | None, ...]


@dataclass(frozen=True)
class StdGrid:
    """Expected standard deviations over the duration of a run and the mass change.

    Args:
        durations_s: durations, s.
        mass_changes_kg: mass changes, kg.
        place_m: place of the mass on a body, m.
        n_runs: number of runs without and with the mass change.
        std: for each target, each mass change and each duration; None where the number is not determined.
    """

    durations_s: tuple[float, ...]
    mass_changes_kg: tuple[float, ...]
    place_m: tuple[float, float]
    n_runs: tuple[int, int]
    std: tuple[tuple[tuple[float | None, ...], ...], ...]


@dataclass(frozen=True, eq=False, repr=False)
class PlanResult(Result):
    """What runs will determine, what they cannot tell apart, and the cheapest plan that reaches the targets.

    Standard deviations are those that an identification will state if the guess is right.

    Args:
        title: of the guess or of the study.
        source: the guess or study file; empty if there is none.
        is_study: whether the plan rests on runs that were made, and adds runs to them.
        targets: the standard deviations to be reached.
        planned: what the runs of the guess, or those of the study as they were made, determine.
        cheapest: the cheapest plan of those that were tried which reaches all targets; None if there is none.
        best: the cheapest plan, or the one that comes nearest to the targets if none reaches them.
        n_tried: number of plans that were tried.
        changes: how the standard deviations of the best plan change if one thing differs from what was assumed.
        ranges: for each target the standard deviations of the best plan if the guess is wrong in all that is listed
            there, lowest and highest; None if a wrong guess leaves the number undetermined.
        inseparable: what the best plan cannot tell apart, or hardly, one sentence each.
        grid: standard deviations over duration and mass change, with as many runs as the best plan.
        costs: what a plan costs.
        repeatability: relative standard deviation of springs, damping and friction from run to run.
        law: name of the law.
        road: the assumed road, in words.
        noise_m_per_s2: assumed rms noise of the sensors below and on the body, m/s^2.
        warnings: reasons for doubt, one sentence each.
        not_determined: why no plan reaches the targets; None if one does.
        read_files: the files that the plan was made from.
    """

    title: str
    source: str
    is_study: bool
    targets: tuple[Target, ...]
    planned: Plan
    cheapest: Plan | None
    best: Plan
    n_tried: int
    changes: tuple[Change, ...]
    ranges: tuple[tuple[float, float] | None, ...]
    inseparable: tuple[str, ...]
    grid: StdGrid
    costs: Costs
    repeatability: float
    law: str
    road: str
    noise_m_per_s2: tuple[float, float]
    warnings: tuple[str, ...] = ()
    not_determined: str | None = None
    read_files: tuple[ReadFile, ...] = ()

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files that the plan was made from, as they were when they were read."""
        return self.read_files

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the guessed numbers with the standard deviations that the best plan will give."""
        return tuple(_rows(self.best))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, as `docs/schemas/plan-1.schema.json` describes it."""
        own = asdict(self)
        del own["read_files"]
        return plain({"schema": SCHEMA} | own)

    def _write_headline(self) -> str:
        what = ", ".join(each.words for each in self.targets)
        return f"{self.title}: {what} " + (
            "is reached by no plan" if self.cheapest is None else f"for {self.cheapest.cost:.4g} {self.costs.unit}"
        )


def _rows(plan: Plan) -> Iterator[SummaryRow]:
    for each in plan.numbers:
        yield SummaryRow(each.name, each.value, each.std, None, each.unit)
