"""The report of a plan: the cheapest plan, what it will determine, what changes that, and what cannot be told apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from opid.estimate import format_number, rounded
from opid.report.document import (
    Document,
    Figure,
    Paragraph,
    Remarks,
    Row,
    Table,
    build_columns,
    build_warnings,
    end_sentence,
    format_count,
)
from opid.suspensions.planning.result import ExpectedNumber, Plan, PlannedRun, PlanResult


def build_document(result: PlanResult) -> Document:
    """Return the report of a plan."""
    words = ["opid", "plan", result.source or "GUESS.toml"]
    for target in result.targets:
        words += ["--target", target.words]
    return Document(
        result.title,
        "Plan of runs",
        _say_answer(result),
        result.not_determined,
        (
            _tabulate_numbers(result),
            _tabulate_changes(result),
            *(() if result.is_study else (Paragraph(_say_ranges(result)),)),
            Remarks("Note", tuple(end_sentence(each) for each in result.inseparable)),
            Paragraph(_say_basis(result)),
            build_warnings(result.warnings),
        ),
        lambda: _list_figures(result),
        words,
        source="study" if result.is_study else "guess",
    )


def _say_answer(result: PlanResult) -> str:
    what = " and ".join(f"{each.name} to {_with_unit(result, each.name, each.std)}" for each in result.targets)
    if not result.best.runs:
        return f"The runs that were made already give {what}: no further run is needed."
    return f"The cheapest plan that gives {what} is {_say_runs(result.best.runs)}: {_say_cost(result)}."


def _say_runs(runs: Sequence[PlannedRun]) -> str:
    """Say how many runs of each kind there are."""
    parts = []
    for run, count in Counter(runs).items():
        at = f" at ({format_number(run.x_m)}, {format_number(run.y_m)}) m" if run.x_m or run.y_m else ""
        mass = f"with {run.mass_change_kg:+g} kg{at}" if run.mass_change_kg else "without a mass change"
        parts.append(f"{format_count(count, 'run')} of {format_number(run.duration_s)} s {mass}")
    return " and ".join(parts)


def _say_cost(result: PlanResult) -> str:
    costs = result.costs
    return (
        f"{format_number(result.best.cost, 4)} {costs.unit} ({format_number(costs.per_run, 3)} {costs.unit} for each "
        f"run, {format_number(costs.per_s, 3)} for each second, {format_number(costs.per_kg, 3)} for each kilogram)"
    )


def _with_unit(result: PlanResult, name: str, std: float | None) -> str:
    unit = next(each.unit for each in result.best.numbers if each.name == name)
    return rounded(std, std) + (f" {unit}" if unit != "1" and std is not None else "")


def _tabulate_numbers(result: PlanResult) -> Table:
    """Tabulate the expected standard deviations of the planned runs beside those of the best plan."""
    first = "runs made" if result.is_study else "planned runs"
    second = "cheapest plan" if result.cheapest is not None else "nearest plan"
    heads = build_columns("", "guess" if not result.is_study else "found", first, second, "unit", left=(0, 4))
    pairs = zip(result.planned.numbers, result.best.numbers, strict=True)
    rows = tuple(
        (each.name, rounded(each.value), rounded(each.std, each.std), _cell(other), each.unit) for each, other in pairs
    )
    said = [] if result.is_study else [f"Planned: {_say_runs(result.planned.runs)}."]
    said.append(f"{second[:1].upper()}{second[1:]}: {_say_runs(result.best.runs) or 'no further run'}.")
    if not result.is_study and not result.planned.runs:
        said = said[1:]
    note = " ".join(said) + " A dash: not determined."
    return Table(heads, rows, "Expected standard deviations", note=note)


def _cell(number: ExpectedNumber) -> str:
    if number.std is None or number.std_range is None:
        return rounded(number.std, number.std)
    low, high = (rounded(each, each) for each in number.std_range)
    return f"{rounded(number.std, number.std)} ({low} .. {high})"


def _tabulate_changes(result: PlanResult) -> Table:
    heads = build_columns("", *(each.name for each in result.targets))
    rows: list[Row] = [("as planned", *(_std_cell(result.best, each.name) for each in result.targets))]
    for of, heading in (("guess", _head_guess(result)), ("plan", "If the plan is changed")):
        chosen = [each for each in result.changes if each.of == of]
        rows += [(heading,), *((each.what, *(rounded(std, std) for std in each.std)) for each in chosen)] * bool(chosen)
    return Table(heads, tuple(rows), "What changes the standard deviations")


def _head_guess(result: PlanResult) -> str:
    return "If further runs differ" if result.is_study else "If the guess is wrong"


def _std_cell(plan: Plan, name: str) -> str:
    std = plan.std_of(name)
    return rounded(std, std)


def _say_ranges(result: PlanResult) -> str:
    said = []
    for target, ends in zip(result.targets, result.ranges, strict=True):
        if ends is None:
            said.append(f"{target.name} may then not be determined at all.")
        else:
            low, high = (_with_unit(result, target.name, each) for each in ends)
            said.append(f"The standard deviation of {target.name} then lies between {low} and {high}.")
    return "Mass, stiffness and road may be wrong at once. " + " ".join(said)


def _say_basis(result: PlanResult) -> str:
    below, above = result.noise_m_per_s2
    noise = format_number(below, 3)
    if abs(below / above - 1) > 0.01:
        noise += f" and {format_number(above, 3)}"
    differ = (
        "all runs are alike"
        if not result.repeatability
        else f"springs, damping and friction differ by {format_number(100 * result.repeatability, 2)} % from run to run"
    )
    spread = (
        " In brackets stand the values that one identification in ten is below, and that one in ten is above."
        if result.repeatability
        else ""
    )
    return (
        f"Law {result.law}, road {result.road}, {noise} m/s^2 of noise below and above; {differ}. The standard "
        f"deviations are those that `opid identify` will state, from the Fisher information of its prediction errors."
        f"{spread} {format_count(result.n_tried, 'plan')} tried; the cheapest plan is the one with the smallest sum of "
        "the costs of its runs, seconds and kilograms."
    )


def _list_figures(result: PlanResult) -> Iterator[Figure]:
    from opid import plots

    n_bare, n_loaded = result.grid.n_runs
    runs = f"{format_count(n_bare, 'run')} without and {n_loaded} with the mass change"
    yield Figure(
        "expected_std",
        "Duration and mass change",
        f"Expected standard deviation of each target with {runs}, over the duration of each run, one line for each "
        "mass change. Where lines are flat, differences between the runs limit what is known, and longer runs do not "
        "help.",
        lambda: plots.expected_std(result),
    )
