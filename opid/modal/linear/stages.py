"""Linear modes at several stages of a campaign: which mode is which, and by how much each moved (Pacini, Fig. 11).

A shaker that is attached, joints that have slipped once, or another temperature change the structure between tests.
Each test then needs the modes of its own stage.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from opid.errors import InputError, list_names
from opid.estimate import Estimate, format_percent
from opid.json_values import plain
from opid.mechanics.structure import modal_assurance
from opid.modal.linear.fitted_modes import FittedModes
from opid.modal.linear.modes import weigh_sensors
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.mode-stages/1"


@dataclass(frozen=True)
class StageSettings:
    """How the modes of two stages are compared.

    Args:
        farthest: change of a frequency, relative, above which two modes are not the same one: the paper's structure
            moved by 7 %.
        least_mac: modal assurance criterion below which they are not.
        sigma: a change counts where it is larger than so many of its standard deviations ...
        least_change: ... and than this fraction of the frequency, which moves nothing that is fitted to tests.
    """

    farthest: float = 0.2
    least_mac: float = 0.5
    sigma: float = 3.0
    least_change: float = 5e-4


STAGES = StageSettings()
UNKNOWN = Estimate()


@dataclass(frozen=True)
class StageShift:
    """How a mode moved from the first stage to another one.

    Args:
        mode: its number at the first stage, from 1.
        number: its number at the other stage; None where no mode there is like it.
        frequency: relative change of its natural frequency.
        damping: relative change of its damping ratio.
        mac: modal assurance criterion of both shapes, at the sensors that both stages have; None without a like mode.
    """

    mode: int
    number: int | None = None
    frequency: Estimate = UNKNOWN
    damping: Estimate = UNKNOWN
    mac: float | None = None

    @property
    def has_moved(self) -> bool:
        """Whether the frequency changed by more than its errors explain."""
        change, std = self.frequency.value or 0.0, self.frequency.std or 0.0
        return abs(change) > max(STAGES.least_change, STAGES.sigma * std)


@dataclass(frozen=True, eq=False, repr=False)
class ModeStages(Result):
    """Linear modes at several stages, each from its own records.

    Args:
        stages: the names of the stages, in their order.
        each_stage: the modes of each stage.
        shifts: for each stage after the first, how each mode of the first stage moved.
        settings: the options of `opid modes` by their names; empty if another program made the result.
    """

    stages: tuple[str, ...]
    each_stage: tuple[FittedModes, ...]
    shifts: tuple[tuple[StageShift, ...], ...]
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files of all stages, each once."""
        return tuple(dict.fromkeys(file for each in self.each_stage for file in each.files))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What moved between the stages, and the warnings of each stage with its name."""
        own = (
            f"{name!r}: {text}"
            for name, each in zip(self.stages, self.each_stage, strict=True)
            for text in each.warnings
        )
        return (*self._warn_of_shifts(), *own)

    def _warn_of_shifts(self) -> Iterator[str]:
        first = self.stages[0]
        for stage, shifts in zip(self.stages[1:], self.shifts, strict=True):
            moved = [each for each in shifts if each.has_moved]
            if moved:
                most = max(moved, key=lambda each: abs(each.frequency.value or 0.0))
                change = format_percent(most.frequency.value or 0.0, 2)
                yield (
                    f"the linear structure moved between {first!r} and {stage!r}: {len(moved)} of {len(shifts)} modes, "
                    f"mode {most.mode} by {change}; give each test the modes of its own stage"
                )
            lost = [str(each.mode) for each in shifts if each.number is None]
            if lost:
                yield (
                    f"mode(s) {list_names(lost)} of {first!r} have no like mode at {stage!r} within "
                    f"{format_percent(STAGES.farthest, 2)} of the frequency: compare the shapes by eye"
                )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the relative changes of each mode, by stage."""
        return tuple(
            SummaryRow.of(f"{stage}.{name}.{each.mode}", estimate, "1")
            for stage, shifts in zip(self.stages[1:], self.shifts, strict=True)
            for each in shifts
            for name, estimate in (("frequency_change", each.frequency), ("damping_change", each.damping))
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json: the modes of each stage as in docs/schemas/modes-1.schema.json."""
        return plain(
            {
                "schema": SCHEMA,
                "stages": self.stages,
                "modes": [each.to_dict() for each in self.each_stage],
                "shifts": [[asdict(each) for each in shifts] for shifts in self.shifts],
                "warnings": self.warnings,
                "settings": self.settings,
            }
        )

    def _write_headline(self) -> str:
        return f"{len(self.each_stage[0].frequency_hz)} modes at {len(self.stages)} stages: {list_names(self.stages)}"


def compare_stages(found: Mapping[str, FittedModes]) -> ModeStages:
    """Return the modes of several stages with the changes of those of the first.

    Modes are paired so that the sum of 1 - MAC and of the changes of frequency, over `StageSettings.farthest`, is
    least.

    Args:
        found: the modes of each stage, by its name, in their order.

    Raises:
        InputError: fewer than two stages, or two that have no sensor in common.
    """
    if len(found) < 2:
        raise InputError(f"there is one stage, {next(iter(found), '')!r}: name the stage of each log, at least two")
    first, *others = found.values()
    shifts = tuple(_find_shifts(first, each, name) for name, each in zip([*found][1:], others, strict=True))
    return ModeStages(tuple(found), tuple(found.values()), shifts)


def _find_shifts(first: FittedModes, other: FittedModes, name: str) -> tuple[StageShift, ...]:
    mac = modal_assurance(*_find_common_shapes(first, other, name))
    hz, there = (np.array([each.value for each in found.frequency_hz]) for found in (first, other))
    apart = np.abs(np.log(there / hz[:, np.newaxis]))
    rows, columns = linear_sum_assignment(1.0 - mac + apart / STAGES.farthest)
    paired = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    shifts = []
    for k in range(hz.size):
        like = paired.get(k)
        if like is None or apart[k, like] > STAGES.farthest or mac[k, like] < STAGES.least_mac:
            shifts.append(StageShift(k + 1))
            continue
        shifts.append(
            StageShift(
                k + 1,
                like + 1,
                _find_change(first.frequency_hz[k], other.frequency_hz[like]),
                _find_change(first.damping_ratio[k], other.damping_ratio[like]),
                float(mac[k, like]),
            )
        )
    return tuple(shifts)


def _find_common_shapes(first: FittedModes, other: FittedModes, name: str) -> tuple[FloatArray, FloatArray]:
    """Return the weighted shapes of two stages at the sensors that both have, (n_sensors, n_modes) each."""
    weights = dict(zip(first.sensors, weigh_sensors(first.relative_modes), strict=True))
    common = [
        sensor
        for sensor in first.sensors
        if sensor in other.sensors
        and np.isfinite(first.shapes[first.sensors.index(sensor)]).all()
        and np.isfinite(other.shapes[other.sensors.index(sensor)]).all()
    ]
    if not common:
        raise InputError(
            f"stage {name!r} has no sensor with a shape in common with the first one: record the same sensors, and see "
            "the warnings of each stage alone"
        )
    weight = np.array([weights[sensor] for sensor in common])[:, np.newaxis]
    shapes, others = (
        weight * found.shapes[[found.sensors.index(sensor) for sensor in common]] for found in (first, other)
    )
    return shapes, others


def _find_change(before: Estimate, after: Estimate) -> Estimate:
    """Return the relative change, with the errors of both."""
    assert before.value is not None
    assert after.value is not None
    ratio = after.value / before.value
    first, second = ((each.std or np.nan) / (each.value or np.nan) for each in (before, after))
    return Estimate.normal(ratio - 1.0, ratio * float(np.hypot(first, second)))
