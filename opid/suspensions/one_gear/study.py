"""A study: runs of one structure at known mass changes, and which channels are its two sides."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from itertools import combinations
from pathlib import Path

import numpy as np

from opid.errors import nearest
from opid.signals.health_result import Finding
from opid.signals.recording import FloatArray, Recording
from opid.signals.tables import refuse
from opid.suspensions.sensor_facts import IDEAL_PAIR, SensorPair

MINIMUM_SAMPLES = 256
"""The shortest run taken: a spectrum of fewer samples does not separate a peak from its neighbours."""

LARGEST_CHANGE_KG = 1e5
"""No single gear carries more: the heaviest aircraft puts 50 t on one."""

SAME_RATE = 1e-5
"""Relative difference up to which two rates are one: clocks of crystals agree to some parts in a million."""


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded run at a known mass change.

    Args:
        name: of the run.
        recording: what was measured.
        mass_change_kg: sprung mass of this run less that of the reference, kg; negative if mass was removed.
        findings: what is to be said of the logs that it was taken from; of the recording itself that is found later.
    """

    name: str
    recording: Recording
    mass_change_kg: float
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class Study:
    """Runs of one structure, checked against each other when the study is made.

    The mass that is identified is the one at a mass change of 0, whether or not a run was made there.

    Args:
        title: of the study.
        sprung: name of the channel on the airframe, an acceleration.
        unsprung: name of the channel on the spindle, an acceleration.
        runs: one or more.
        source: the study file, None if the study was made otherwise.
        sensors: what is known of the sensors beforehand.
        date: of the runs; None if it is not known.

    Raises:
        InputError: everything that is wrong at once: a missing channel, another unit than m/s^2, different
            rates, a run too short, one name twice.

    >>> from opid.signals.recording import recording_from_arrays
    >>> samples, names = np.random.default_rng(0).standard_normal((2, 2, 512)), ["lower_z", "upper_z"]
    >>> heavy, light = (recording_from_arrays(each, names, fs=512.0) for each in samples)
    >>> runs = (Run("heavy", heavy, 0.0), Run("light", light, -220.0))
    >>> Study("taxi", sprung="upper_z", unsprung="lower_z", runs=runs).fs
    512.0
    """

    title: str
    sprung: str
    unsprung: str
    runs: tuple[Run, ...]
    source: Path | None = None
    sensors: SensorPair = IDEAL_PAIR
    date: date | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "runs", tuple(self.runs))
        refuse(list(_study_faults(self)), self.source)

    @property
    def fs(self) -> float:
        """Sampling rate of all runs, Hz."""
        return self.runs[0].recording.fs

    def accelerations(self, run: Run) -> tuple[FloatArray, FloatArray]:
        """Unsprung and sprung acceleration of a `run` of this study, each (n_samples,) m/s^2."""
        return run.recording.channel(self.unsprung), run.recording.channel(self.sprung)


def _study_faults(study: Study) -> Iterator[str]:
    leaks = [(leak.channel, leak.into) for leak in study.sensors.leaks]
    for channel, into in sorted({leak for leak in leaks if leaks.count(leak) > 1}):
        yield f"the leak of {channel!r} into the {into} sensor stands twice, give it once"
    for leak in study.sensors.leaks:
        if leak.channel == (study.sprung if leak.into == "sprung" else study.unsprung):
            yield f"the leak {leak.channel!r} is the {leak.into} channel itself, name another axis"
    if study.sprung == study.unsprung:
        yield f"sprung and unsprung are both {study.sprung!r}, name the channels of two sensors"
    if not study.runs:
        yield "there are no runs, give at least one"
    names = [run.name for run in study.runs]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"{names.count(name)} runs are called {name!r}, rename all but one"
    for run in study.runs:
        yield from (f"run {run.name!r}: {fault}" for fault in _run_faults(study, run))
    for first, second in combinations(study.runs, 2):
        one, other = first.recording, second.recording
        if first.mass_change_kg != second.mass_change_kg and np.array_equal(one.samples, other.samples):
            yield f"runs {first.name!r} and {second.name!r} hold the same samples, name two logs"
        if first is study.runs[0] and abs(other.fs / one.fs - 1) > SAME_RATE:
            yield (
                f"run {first.name!r} has {one.fs:.9g} Hz and run {second.name!r} has {other.fs:.9g} Hz, "
                "resample one to the rate of the other"
            )


def _run_faults(study: Study, run: Run) -> Iterator[str]:
    if not math.isfinite(run.mass_change_kg):
        yield f"the mass change is {run.mass_change_kg} kg, give a number"
    elif abs(run.mass_change_kg) > LARGEST_CHANGE_KG:
        yield (
            f"the mass change is {run.mass_change_kg:g} kg, more than any gear carries "
            f"({LARGEST_CHANGE_KG:g} kg): give it in kg, for this gear alone"
        )
    if run.recording.n_samples < MINIMUM_SAMPLES:
        yield (
            f"it has {run.recording.n_samples} samples ({run.recording.duration_s:.3g} s) and at least "
            f"{MINIMUM_SAMPLES} are needed, give some tens of seconds"
        )
    for name in dict.fromkeys((study.sprung, study.unsprung, *(leak.channel for leak in study.sensors.leaks))):
        if name not in run.recording.names:
            yield f"there is no channel {name!r} in its log ({nearest(name, run.recording.names)})"
        elif run.recording.unit(name) != "m/s^2":
            yield f"channel {name!r} is in {run.recording.unit(name)} where an acceleration is needed"
