"""Worlds in which an assumption of a method fails, and how the answer of a command in such a world is judged.

A world is a measurement with known truth. Its answer is *right* if every interval that is given holds the truth, wide
ones among them, *silent* if the command refuses or gives no interval, and *wrong* if an interval leaves out the truth
by more than chance does. A sentence beside a wrong interval does not make it right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate

FARTHEST = 3.0
"""Standard deviations up to which an interval counts as right: chance leaves one in 370 farther away."""


@dataclass(frozen=True)
class Answer:
    """What a command said in a world: estimates, each with its name and its truth, and all its warnings."""

    pairs: tuple[tuple[str, Estimate, float], ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class World:
    """A world: the command, the assumption that fails in it, and what makes the measurement and asks the command.

    Args:
        command: the command of opid that is asked.
        fails: the assumption that fails, in words; "none" for the sound world beside which the others stand.
        ask: makes the measurement by a seed and returns the answer; refusals are raised as the library raises them.
        must_say: words that a warning or a refusal holds, where the data can tell the cause; "" where they cannot.
        unseen: why no data tell that the assumption fails, with a number, so that the answer is wrong without a word;
            "" for the worlds that the answer must survive.
        is_slow: whether the answer takes more than about ten seconds, so that the benchmark alone asks for it.
    """

    command: str
    fails: str
    ask: Callable[[int], Answer]
    must_say: str = ""
    unseen: str = ""
    is_slow: bool = False

    @property
    def name(self) -> str:
        """The name of the world in tests and tables."""
        return f"{self.command}: {self.fails}"

    @property
    def must_answer(self) -> bool:
        """Whether no assumption fails, so that silence would be a fault; flights that do not differ have no change."""
        return self.fails.partition(",")[0] == "none" and self.name != "compare: none"


@dataclass(frozen=True)
class Verdict:
    """How an answer is judged.

    Args:
        outcome: "right", "silent" or "wrong".
        worst: name of the estimate that is farthest from its truth, "" without an interval.
        deviations: its distance over its standard deviation.
        width: standard deviation of this estimate over its truth.
        said: the refusal, or the first warning that holds the words that the world asks for, else the first one.
    """

    outcome: Literal["right", "silent", "wrong"]
    worst: str
    deviations: float
    width: float
    said: str


def judge(world: World, seed: int) -> Verdict:
    """Ask the command in a world and judge its answer."""
    try:
        answer = world.ask(seed)
    except (InputError, NotDeterminedError) as error:
        return Verdict("silent", "", 0.0, 0.0, str(error))
    said = next((each for each in answer.warnings if world.must_say in each), next(iter(answer.warnings), ""))
    given = [(name, each, true) for name, each, true in answer.pairs if each.value is not None and each.std]
    if not given:
        return Verdict("silent", "", 0.0, 0.0, said)
    name, estimate, true = max(given, key=lambda each: _measure(each[1], each[2]))
    deviations = _measure(estimate, true)
    outcome: Literal["right", "wrong"] = "right" if deviations <= FARTHEST else "wrong"
    return Verdict(outcome, name, deviations, float(estimate.std or 0.0) / abs(true or 1.0), said)


def _measure(estimate: Estimate, true: float) -> float:
    return abs(float(estimate.value or 0.0) - true) / float(estimate.std or 1.0)


def list_names(worlds: Iterable[World]) -> list[str]:
    """Return the names of worlds, for the parameters of a test."""
    return [world.name for world in worlds]
