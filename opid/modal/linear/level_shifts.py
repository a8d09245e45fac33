"""Which modes are nonlinear: natural frequency and damping of every mode at several levels (Pacini section 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate
from opid.modal.linear.coordinates import ModalTest
from opid.modal.linear.fit import LinearFit, linear_fit, require_force

SIGMAS = 3.0
"""By so many standard errors a shift must exceed its threshold: chance alone does that once in 370 times."""

LEAST_RATIO = 1.5
"""Of the highest level to the lowest: levels nearer than that say nothing of nonlinearity."""


@dataclass(frozen=True)
class LevelShift:
    """How natural frequency and damping of a mode move with the level.

    Args:
        mode: number of the mode, from 1.
        levels: names of the tests, from the smallest amplitude of this mode to the largest.
        amplitude: peak |q''| of each in the band of the mode, m/s^2 kg^1/2.
        frequency_hz: natural frequency in each, Hz; without a value where none was found.
        damping_ratio: damping ratio in each.
        frequency_shift: relative change from the lowest to the highest level that is sharp enough to compare.
        damping_shift: likewise of the damping ratio.
        nonlinear: whether a shift exceeds its threshold by more than chance does.
        determined: whether the mode was excited well enough to tell.
        reason: why, one sentence.
    """

    mode: int
    levels: tuple[str, ...]
    amplitude: tuple[float, ...]
    frequency_hz: tuple[Estimate, ...]
    damping_ratio: tuple[Estimate, ...]
    frequency_shift: Estimate
    damping_shift: Estimate
    nonlinear: bool
    determined: bool
    reason: str


def level_shifts(
    tests: Sequence[ModalTest], *, frequency_threshold: float = 0.002, damping_threshold: float = 0.15
) -> tuple[LevelShift, ...]:
    """Return how each elastic mode moves with the level, and whether that makes it nonlinear.

    At each level a mode is taken for linear (`opid.modal.linear.fit`). What shift is significant "is a subjective
    measure" (the paper): hence the thresholds. A mode is nonlinear if a shift exceeds its threshold by three standard
    errors or more. The data can tell if they would show a shift of twice the threshold; levels too weak for that are
    left out of the comparison.

    Args:
        tests: of one structure with the same modes, each with a force, at two levels or more.
        frequency_threshold: relative shift of the natural frequency from which a mode counts as nonlinear.
        damping_threshold: likewise of the damping ratio.

    Raises:
        InputError: fewer than two tests, one without a force, different numbers of modes, or thresholds that are not
            positive.

    >>> from opid.modal.linear.modes import LinearModes
    >>> from opid.signals.recording import Channel, Recording
    >>> modes = LinearModes([50.0], [0.01], [[0.5]], ("a",))
    >>> channels = (Channel("a", "m/s^2"), Channel("force", "N"))
    >>> from opid.modal.linear.coordinates import modal_test
    >>> from opid.modal.model import NonlinearModalModel, simulate
    >>> def hit(newton):
    ...     force = newton * np.exp(-((np.arange(4096) - 20) ** 2) / 8)
    ...     samples = simulate(NonlinearModalModel(modes), force, fs=1024.0, drive_point="a").samples
    ...     both = Recording(np.column_stack([samples, force]), fs=1024.0, channels=channels)
    ...     return modal_test(both, modes, name=f"{newton} N", force="force", drive_point="a")
    >>> shift = level_shifts([hit(1), hit(10)])[0]
    >>> shift.nonlinear, shift.determined, shift.levels
    (False, True, ('1 N', '10 N'))
    """
    for name, value in (("frequency_threshold", frequency_threshold), ("damping_threshold", damping_threshold)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}: give a positive share, e.g. 0.002 for 0.2 %")
    if len(tests) < 2:
        raise InputError(f"{len(tests)} test(s) show no shift: give tests at two levels or more")
    for test in tests:
        require_force(test)
        if test.modes.n_modes != tests[0].modes.n_modes:
            raise InputError(
                f"test {test.name!r} has {test.modes.n_modes} modes and {tests[0].name!r} {tests[0].modes.n_modes}: "
                "give all tests the same modes"
            )
    elastic = np.flatnonzero(np.all([test.modes.elastic for test in tests], axis=0)) + 1
    return tuple(_compared(tests, int(mode), frequency_threshold, damping_threshold) for mode in elastic)


def nonlinear_modes(shifts: Sequence[LevelShift]) -> tuple[int, ...]:
    """Return the numbers of the modes that the levels show to be nonlinear.

    Args:
        shifts: from `level_shifts`.
    """
    return tuple(shift.mode for shift in shifts if shift.nonlinear)


def _compared(
    tests: Sequence[ModalTest], mode: int, frequency_threshold: float, damping_threshold: float
) -> LevelShift:
    names, fits = _by_amplitude(tests, mode)
    thresholds = (frequency_threshold, damping_threshold)
    known = [place for place, fit in enumerate(fits) if fit.frequency_hz.value is not None]
    sharp = [place for place in known if _is_sharp(fits[place], thresholds)]
    pairs = [(each[0], each[-1]) for each in (sharp, known) if len(each) > 1] or [(0, len(fits) - 1)]
    # a strong shift shows in levels that are not sharp, too
    verdicts = [_verdict(mode, fits[low], fits[high], thresholds) for low, high in pairs]
    best = max((place for place, verdict in enumerate(verdicts) if verdict[1]), default=0)
    (low, high), (shifts, nonlinear, determined, reason) = pairs[best], verdicts[best]
    ratio = fits[high].amplitude / fits[low].amplitude if fits[low].amplitude > 0 else np.inf
    between = f"{names[low]!r} and {names[high]!r}"
    if determined and not nonlinear and ratio < LEAST_RATIO:
        determined = False
        reason = (
            f"the data cannot tell: the amplitudes of mode {mode} in {between} differ by a factor of {ratio:.2g} only, "
            "drive it harder in one"
        )
    elif determined:
        reason = f"{reason} between {between}, whose amplitudes differ by a factor of {ratio:.3g}"
    return LevelShift(
        mode=mode,
        levels=tuple(names),
        amplitude=tuple(fit.amplitude for fit in fits),
        frequency_hz=tuple(fit.frequency_hz for fit in fits),
        damping_ratio=tuple(fit.damping_ratio for fit in fits),
        frequency_shift=shifts[0],
        damping_shift=shifts[1],
        nonlinear=nonlinear,
        determined=determined,
        reason=reason,
    )


def _by_amplitude(tests: Sequence[ModalTest], mode: int) -> tuple[list[str], list[LinearFit]]:
    """Names and fits from the smallest amplitude up; clearly nonlinear ones with the mass that a linear one shows."""
    found = [(linear_fit(test, mode), test) for test in tests]
    found.sort(key=lambda pair: pair[0].amplitude)
    weighed = [fit for fit, _ in found if fit.modal_mass is not None]
    # the strongest that is linear knows it best; if none is, the weakest is nearest to linear
    known = next((fit for fit in reversed(weighed) if fit.explained), weighed[0] if weighed else None)
    mass = known.modal_mass if known else None
    fits = [fit if fit.explained or fit is known else linear_fit(test, mode, modal_mass=mass) for fit, test in found]
    return [test.name for _, test in found], fits


Shifts = tuple[Estimate, Estimate]


def _verdict(
    mode: int, low: LinearFit, high: LinearFit, thresholds: tuple[float, float]
) -> tuple[Shifts, bool, bool, str]:
    shifts = _relative(high.frequency_hz, low.frequency_hz), _relative(high.damping_ratio, low.damping_ratio)
    return shifts, *_judged(mode, shifts, thresholds)


def _is_sharp(fit: LinearFit, thresholds: tuple[float, float]) -> bool:
    pairs = zip((fit.frequency_hz, fit.damping_ratio), thresholds, strict=True)
    return all(
        each.value is not None and each.std is not None and 1.96 * each.std <= np.sqrt(0.5) * threshold * each.value
        for each, threshold in pairs
    )


def _relative(high: Estimate, low: Estimate) -> Estimate:
    if high.value is None or low.value is None:
        return Estimate()
    ratio = high.value / low.value
    if high.std is None or low.std is None:
        return Estimate(ratio - 1)
    # a ratio near 0 would hide how uncertain the lower value is
    return Estimate.normal(ratio - 1, max(1.0, ratio) * float(np.hypot(high.std / high.value, low.std / low.value)))


def _judged(mode: int, shifts: Shifts, thresholds: tuple[float, float]) -> tuple[bool, bool, str]:
    """Whether the mode is nonlinear, whether the data can tell, and why."""
    words = ("frequency", "damping")
    shifted, wide = [], []
    for word, shift, threshold in zip(words, shifts, thresholds, strict=True):
        if shift.value is None or shift.std is None:
            return False, False, f"the data cannot tell: mode {mode} hardly moves at one of the levels, drive it harder"
        if abs(shift.value) - SIGMAS * shift.std > threshold:
            shifted.append(f"{word} by {_percent(shift.value)} (threshold {100 * threshold:.3g} %)")
        if 1.96 * shift.std > threshold:
            wide.append(f"{word} shifts by {_percent(shift.value)} +- {1.96 * 100 * shift.std:.2g} %")
    if shifted:
        return True, True, f"mode {mode} shifts in {' and in '.join(shifted)}"
    if wide:
        return False, False, f"the data cannot tell: the {' and the '.join(wide)}, drive mode {mode} harder"
    both = f"{_percent(shifts[0].value)} in frequency, {_percent(shifts[1].value)} in damping"
    return False, True, f"mode {mode} shifts no further than its thresholds and chance allow ({both})"


def _percent(share: float | None) -> str:
    return f"{100 * (share or 0.0):+.3g} %"
