"""What to doubt about a nonlinear modal model, one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from opid.errors import InputError
from opid.modal.decay.fit import DecayLaw
from opid.modal.forced.equation import mode_lines
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.linear.modes import LARGEST_CONDITION, LinearModes, condition_number, with_sensors
from opid.modal.linear.modes_file import looks_in_percent, looks_unit_normalised
from opid.modal.result import ModeFit, TruthTest
from opid.modal.study import ModalStudy
from opid.signals.health.inspection import inspect

MOST_MISSED = 0.3
"""Of the motion of a sensor, rms, that the model may miss in a truth test before it is said."""

BEYOND = 1.1
"""Times the largest amplitude fitted: a truth test that goes further asks the polynomials to extrapolate."""


def doubts_of_modes(modes: LinearModes) -> Iterator[str]:
    """Yield what to doubt about linear modes.

    Args:
        modes: the modes.
    """
    condition = condition_number(modes)
    if condition > LARGEST_CONDITION:
        yield (
            f"the shapes have the condition number {condition:.0f} (9 is good): noise and errors of the shapes grow by "
            "as much in the modal filter; add sensors or leave out modes"
        )
    looks = looks_unit_normalised(modes)
    if looks:
        yield f"the shapes do not look mass-normalised: {looks}"


def doubts_of_truth_tests(
    study: ModalStudy, fits: Sequence[ModeFit], of_decays: Mapping[int, DecayLaw], done: Sequence[TruthTest]
) -> Iterator[str]:
    """Yield the truth tests that go beyond the amplitudes that were fitted, and those that the model fails.

    Args:
        study: with its tests.
        fits: of its nonlinear modes.
        of_decays: laws of free decays, by the number of the mode.
        done: the truth tests with their figures.
    """
    reached = {fit.mode: (fit.stiffness_curve.position[-1], fit.band_hz) for fit in fits}
    for mode in of_decays.keys() - reached.keys():
        natural = float(study.modes.frequency_hz[mode - 1])
        reached[mode] = (float(of_decays[mode].amplitude.max()), (0.8 * natural, 1.2 * natural))
    for each, (mode, (largest, band)) in product(study.of_use("truth"), reached.items()):
        try:
            times = mode_lines(each.test, mode, band).largest_q / largest
        except InputError as error:
            yield f"how far truth test {each.test.name!r} moves mode {mode} cannot be told: {error}"
            continue
        if times > BEYOND:
            yield (
                f"truth test {each.test.name!r} moves mode {mode} {times:.2g} times as far as the tests it was "
                "fitted to: there its force is an extrapolation"
            )
    for test in done:
        missed = {name: figures.nrmse_nonlinear for name, figures in test.sensors.items()}
        worst = max(missed, key=lambda name: missed[name])
        median = float(np.median(list(missed.values())))
        if missed[worst] > MOST_MISSED:
            yield (
                f"truth test {test.name!r}: the nonlinear model misses {100 * missed[worst]:.0f} % of the motion of "
                f"{worst!r} (median of all sensors {100 * median:.0f} %): do not use it there before you know why"
            )


def nothing_nonlinear(shifts: Sequence[LevelShift]) -> str:
    """Return why no mode is taken for nonlinear.

    Args:
        shifts: of the modes with the level; none without level tests.
    """
    if not shifts:
        return 'no mode is named as nonlinear: name some (nonlinear = [7, 11]), or give two tests with use = "level"'
    return (
        f"none of {len(shifts)} modes shifts with the level beyond its thresholds: the structure is linear at these "
        "levels; excite it harder, or name the modes to fit (nonlinear = [7, 11])"
    )


def doubts_of_records(study: ModalStudy) -> Iterator[str]:
    """Yield what is wrong with the records: sensors that are missing, channels that are clipped.

    Args:
        study: with its tests.
    """
    for each in study.tests:
        test = each.test
        missing = [sensor for sensor in test.modes.sensors if sensor not in test.recording.names]
        if missing:
            used = with_sensors(test.modes, [sensor for sensor in test.modes.sensors if sensor not in missing])
            yield (
                f"test {test.name!r} lacks {len(missing)} of {len(test.modes.sensors)} sensors "
                f"({', '.join(repr(name) for name in missing[:6])}): its modes are filtered with the condition number "
                f"{condition_number(used):.1f}"
            )
        channels = inspect(test.recording, thorough=False).channels
        clipped = {channel.name: channel.clipped_fraction for channel in channels if channel.clipped_fraction > 0}
        if clipped:
            worst = max(clipped, key=lambda name: clipped[name])
            others = f" and {len(clipped) - 1} more channel(s)" if len(clipped) > 1 else ""
            yield (
                f"{100 * clipped[worst]:.2g} % of the samples of {worst!r}{others} in test {test.name!r} are clipped: "
                "measure again with a larger range"
            )
    if len(study.of_use("level")) == 1:
        yield 'there is one test with use = "level": levels are compared from two on'


def require_modes(modes: LinearModes) -> None:
    """Refuse linear modes whose damping is in percent.

    Args:
        modes: the modes.

    Raises:
        InputError: they look so.
    """
    percent = looks_in_percent(modes)
    if percent:
        raise InputError(f"{percent}: give shares of critical damping, 0.004 for 0.4 %")


def doubts_of_other_shifts(shifts: Sequence[LevelShift], nonlinear: Sequence[int]) -> Iterator[str]:
    """Yield the modes that shift with the level and are modelled as linear.

    Args:
        shifts: of the modes with the level; none without level tests.
        nonlinear: numbers of the modes that are not.
    """
    for shift in shifts:
        if shift.nonlinear and shift.mode not in nonlinear:
            yield (
                f"mode {shift.mode} shifts with the level and is modelled as linear: name it in nonlinear, or judge "
                "the model by tests that hardly move it"
            )
