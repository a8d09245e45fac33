"""Which tests tell about a mode, in which band, and whether they can: decayed, with energy, with enough lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import fft

from opid.modal.forced.equation import ModeLines, modal_motion
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.study import StudyTest
from opid.signals.recording import FloatArray

WIDEST = (0.6, 1.5)
"""The band of a mode at the widest, in natural frequencies."""

TO_NEIGHBOUR = 0.8
"""Of the way to a neighbour, where the band ends at the latest: the modal filter leaves little of it, and the frequency
of a nonlinear mode goes there."""

ENERGY_LEVEL = 0.01
"""Of the largest line of the modal acceleration: what is below it holds nothing of the mode."""

HALF_WIDTHS = 4.0
"""Half-power bandwidths on either side of the natural frequency that the band holds at least."""

MOST_LEFT, WARNED_LEFT = 0.05, 0.01
"""Of the largest motion: what may be left at the ends of a record that is to begin and end at rest."""

THIRD = 3.1
"""Natural frequencies that a record holds at least, for the third harmonic with some of its width."""

LEAST_SIGNAL = 3.0
"""Force in the band over its noise, rms: with less there is no energy in it."""

SHARE_OF_LARGEST = 0.1
"""A mode without tests of its own is fitted to those that reach this share of its largest amplitude."""


def tests_of_mode(tests: Sequence[StudyTest], mode: int, nonlinear: Sequence[int]) -> tuple[ModalTest, ...]:
    """Return the tests of a mode: those that name it, and those that move it more than the other nonlinear modes.

    Args:
        tests: those to fit.
        mode: number of the mode, from 1.
        nonlinear: numbers of all nonlinear modes.
    """
    named = [each.test for each in tests if each.mode == mode]
    free = [each.test for each in tests if each.mode is None]
    return tuple(named + [test for test in free if largest_mode(test, nonlinear) == mode])


def tests_beside(tests: Sequence[StudyTest], mode: int) -> tuple[ModalTest, ...]:
    """Return the tests of other modes that move a mode that has none of its own, the strongest and those near it.

    Args:
        tests: those to fit.
        mode: number of the mode, from 1.
    """
    free = [each.test for each in tests if each.mode is None]
    energies = [_energy(test, mode) for test in free]
    least = SHARE_OF_LARGEST**2 * max(energies, default=0.0)
    return tuple(test for test, energy in zip(free, energies, strict=True) if energy >= least > 0)


def largest_mode(test: ModalTest, modes: Sequence[int]) -> int:
    """Return the mode that a test moves most, by kinetic energy.

    Args:
        test: the test.
        modes: numbers to choose from.
    """
    return modes[int(np.argmax([_energy(test, mode) for mode in modes]))]


def band_of_mode(tests: Sequence[ModalTest], mode: int) -> tuple[float, float]:
    """Return the band in which some test moves a mode, Hz: no further than most of the way to the neighbours.

    Args:
        tests: those that tell about it.
        mode: number of the mode, from 1.
    """
    lows, highs = [], []
    for test in tests:
        place = test.modes.index(mode)
        natural, damping = test.modes.frequency_hz[place], test.modes.damping_ratio[place]
        least, most = _limits(test.modes, mode)
        frequency, spectrum = _spectrum(test, mode)
        inside = (frequency >= least) & (frequency <= most)
        with_energy = frequency[inside][spectrum[inside] >= ENERGY_LEVEL * spectrum[inside].max(initial=0.0)]
        width = 2 * HALF_WIDTHS * damping * natural
        lows.append(max(least, min(natural - width, with_energy.min(initial=natural))))
        highs.append(min(most, max(natural + width, with_energy.max(initial=natural))))
    return float(min(lows)), float(max(highs))


def faults_of_test(
    test: ModalTest, lines: ModeLines, mode: int, band_hz: tuple[float, float], taper_s: float = 0.0
) -> Iterator[str]:
    """Yield why a test cannot be used for a mode, one clause each.

    Args:
        test: the test.
        lines: its equation in the band.
        mode: number of the mode, from 1.
        band_hz: the band, Hz.
        taper_s: time over which its ends are faded out, s.
    """
    if _rms(lines.force) < LEAST_SIGNAL * lines.noise_force:
        yield (
            f"test {test.name!r} puts no energy into {band_hz[0]:.4g} to {band_hz[1]:.4g} Hz, the band of mode {mode}: "
            "excite the mode, or leave the test to another one"
        )
    elif _rms(lines.inertia) < LEAST_SIGNAL * lines.noise_inertia:
        yield f"mode {mode} hardly moves in test {test.name!r}: drive it where its shape is larger, or leave it out"
    left, word = _left_over(test, lines, mode, band_hz)
    if left > MOST_LEFT and not taper_s:
        yield (
            f"test {test.name!r} {word} with {100 * left:.2g} % of its largest motion in mode {mode}: record "
            "from rest until the mode has decayed, or fade the ends out in Python (taper_s of fit_mode)"
        )


def doubts_of_test(
    test: ModalTest, lines: ModeLines, mode: int, band_hz: tuple[float, float], taper_s: float = 0.0
) -> Iterator[str]:
    """Yield what to doubt about a test that is used, one clause each.

    Args:
        test: the test.
        lines: its equation in the band.
        mode: number of the mode, from 1.
        band_hz: the band, Hz.
        taper_s: time over which its ends are faded out, s.
    """
    left, word = _left_over(test, lines, mode, band_hz)
    if WARNED_LEFT < left <= MOST_LEFT and not taper_s:
        yield f"test {test.name!r} {word} with {100 * left:.2g} % of its largest motion in mode {mode}: record longer"


def doubts_of_rates(tests: Sequence[ModalTest], mode: int) -> Iterator[str]:
    """Yield that tests are sampled too slowly for the third harmonic of a mode, all in one clause.

    Args:
        tests: those of the mode.
        mode: number of the mode, from 1.
    """
    slow = [test for test in tests if test.fs / 2 < THIRD * test.modes.frequency_hz[test.modes.index(mode)]]
    if slow:
        needed = 2 * THIRD * slow[0].modes.frequency_hz[slow[0].modes.index(mode)]
        yield (
            f"{len(slow)} test(s) of mode {mode} at {slow[0].fs:g} Hz do not hold its third harmonic: the powers miss "
            f"some thousandths; record at {needed:.0f} Hz or more"
        )


def _energy(test: ModalTest, mode: int) -> float:
    """Mean square of the modal velocity that one mode has in its band: shares of the kinetic energy."""
    _, velocity = modal_motion(test, mode, _limits(test.modes, mode))
    return float(np.mean(velocity**2))


def _limits(modes: LinearModes, mode: int) -> tuple[float, float]:
    """Most of the way to the neighbours, but never so near that the mode's own resonance is cut."""
    place = modes.index(mode)
    natural = modes.frequency_hz[place]
    others = np.delete(modes.frequency_hz, place)
    below, above = others[(others > 0) & (others <= natural)], others[others > natural]
    own = HALF_WIDTHS * 2 * modes.damping_ratio[place] * natural
    low, high = WIDEST[0] * natural, WIDEST[1] * natural
    if below.size:
        low = max(low, natural - TO_NEIGHBOUR * (natural - below.max()))
    if above.size:
        high = min(high, natural + TO_NEIGHBOUR * (above.min() - natural))
    low, high = min(low, natural - own), max(high, natural + own)
    return float(max(low, 0.1 * natural)), float(min(high, 3 * natural))


def _spectrum(test: ModalTest, mode: int) -> tuple[FloatArray, FloatArray]:
    acceleration = test.acceleration[:, test.modes.index(mode)]
    return fft.rfftfreq(acceleration.size, 1 / test.fs), np.abs(fft.rfft(acceleration))


def _rms(lines: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.abs(lines) ** 2)))


def _left_over(test: ModalTest, lines: ModeLines, mode: int, band_hz: tuple[float, float]) -> tuple[float, str]:
    """Motion at the ends of a record over the largest one, without what is noise, and a word for the worse end."""
    _, velocity = modal_motion(test, mode, band_hz)
    period = test.fs / test.modes.frequency_hz[test.modes.index(mode)]
    n = max(round(5 * period), velocity.size // 100, 8)
    first = max(round(period), 8)  # an impact may come early
    # what the noise of the band's lines makes of any sample
    noise = 2 * np.sum((lines.noise_inertia / (2 * np.pi * lines.frequency_hz)) ** 2) / velocity.size**2
    begin, end = (float(np.sqrt(2 * max(np.mean(part**2) - noise, 0.0))) for part in (velocity[:first], velocity[-n:]))
    largest = float(np.abs(velocity).max()) or 1.0
    if end >= begin:
        return end / largest, "ends"
    return begin / largest, "begins"
