"""Select the tests that can identify a mode, find its band, and check the tests.

A test must have decayed, with energy and enough motion in the band. The shapes must explain the motion of the sensors,
which reveals a swapped row, a wrong sign or a missing mode, even without a force. Modes that respond at multiples of
the frequency under test are named, for a mode by itself does not explain them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from opid.errors import require_fraction
from opid.estimate import format_percent
from opid.mechanics.structure import ComplexArray
from opid.modal.couplings import Product
from opid.modal.forced.equation import ModeLines, find_noise_power, find_quiet_lines, integrate_mode
from opid.modal.linear.frequency_response import accelerance
from opid.modal.linear.modes import LinearModes, ModalTest, weigh_sensors, weighted_shapes, with_sensors
from opid.modal.settings import MODAL
from opid.modal.study import StudyTest
from opid.signals.recording import FloatArray

Checks = tuple[list[str], list[str]]
"""Reasons why a test cannot be used, and warnings where it can; one clause each."""


def select_tests(tests: Sequence[StudyTest], mode: int, nonlinear: Sequence[int]) -> tuple[ModalTest, ...]:
    """Return the tests of a mode: those that name it, and those that move it more than the other nonlinear modes."""
    named = [each.test for each in tests if each.mode == mode]
    free = [each.test for each in tests if each.mode is None]
    return tuple(named + [test for test in free if find_largest_mode(test, nonlinear) == mode])


def select_tests_beside(tests: Sequence[StudyTest], mode: int) -> tuple[ModalTest, ...]:
    """Return tests of other modes for a mode without its own: those that reach a tenth of its largest amplitude."""
    energies = [(each.test, _find_energy(each.test, mode)) for each in tests if each.mode is None]
    least = MODAL.part_of_largest**2 * max((energy for _, energy in energies), default=0.0)
    return tuple(test for test, energy in energies if energy >= least > 0)


def find_largest_mode(test: ModalTest, modes: Sequence[int]) -> int:
    """Return which of some modes a test moves most, by kinetic energy."""
    return modes[int(np.argmax([_find_energy(test, mode) for mode in modes]))]


def find_band(tests: Sequence[ModalTest], mode: int) -> tuple[float, float]:
    """Return the band in which some test moves a mode, Hz; it ends before the neighbouring modes.

    Lines below a hundredth of the largest one hold nothing of the mode.
    """
    lows, highs = [], []
    for test in tests:
        index, acceleration = test.modes.index(mode), test.modal_acceleration(mode)
        natural, damping = test.modes.frequency_hz[index], test.modes.damping_ratio[index]
        least, most = _find_limits(test.modes, mode)
        frequency, spectrum = fft.rfftfreq(acceleration.size, 1 / test.fs), np.abs(fft.rfft(acceleration))
        inside = (frequency >= least) & (frequency <= most)
        with_energy = frequency[inside][spectrum[inside] >= MODAL.least_line * spectrum[inside].max(initial=0.0)]
        width = 2 * MODAL.half_widths * damping * natural
        lows.append(max(least, min(natural - width, with_energy.min(initial=natural))))
        highs.append(min(most, max(natural + width, with_energy.max(initial=natural))))
    return float(min(lows)), float(max(highs))


def check_test(test: ModalTest, lines: ModeLines, mode: int, band_hz: tuple[float, float], taper_s: float) -> Checks:
    """Check a test of a mode by its equation in a band, with its ends faded out over `taper_s`."""
    faults, warnings = [], []
    if _compute_rms(lines.force) < MODAL.least_signal * lines.noise_force:
        faults.append(
            f"test {test.name!r} puts no energy into {band_hz[0]:.4g} to {band_hz[1]:.4g} Hz, the band of mode {mode}: "
            "excite the mode, or use the test for another mode"
        )
    elif _compute_rms(lines.inertia) < MODAL.least_signal * lines.noise_inertia:
        faults.append(
            f"mode {mode} hardly moves in test {test.name!r}: drive it where its shape is larger, or leave it out"
        )
    left, word = (0.0, "") if taper_s else _measure_ends(test, lines, mode, band_hz)
    clause = f"test {test.name!r} {word} with {100 * left:.2g} % of its largest motion in mode {mode}: record"
    if left > MODAL.most_left:
        faults.append(
            f"{clause} from rest until the mode has decayed, or fade the ends out in Python (taper_s of fit_mode)"
        )
    elif left > MODAL.warned_left:
        warnings.append(f"{clause} longer")
    return faults, warnings


@dataclass(frozen=True)
class ShapeCheck:
    """How well the shapes explain the motion of a test about a mode, and how well its amplitude is known.

    Args:
        outside: rms fraction of the motion that no sum of the shapes can make, without the part of the noise.
        cause: a clause on its most likely cause, "" where none stands out.
        gain_std: standard deviation of the gain of the modal coordinate, as a fraction, by the calibration of the
            sensors and by the gain of a single sensor that would put this fraction outside the shapes.
        faults: why the test cannot be used; one clause each.
        warnings: what to doubt where it can be used, likewise.
    """

    outside: float
    cause: str
    gain_std: float
    faults: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def is_gain_doubtful(self) -> bool:
        """Whether the gain of the modal coordinate is worse known than the calibration of sensors makes it."""
        return self.gain_std > MODAL.doubtful_gain


def check_shapes(
    test: ModalTest, mode: int, band_hz: tuple[float, float], *, gain_tolerance: float = MODAL.gain_tolerance
) -> ShapeCheck:
    """Check whether a sum of the shapes can make the motion of a test in the band of a mode.

    Args:
        test: the test.
        mode: number of the mode, from 1.
        band_hz: ends of the band, Hz.
        gain_tolerance: standard deviation of the gain of its sensors by their calibration, as a fraction.

    Raises:
        InputError: a tolerance that is no fraction.
    """
    require_fraction("gain_tolerance", gain_tolerance)
    seen = _OutsideShapes.of(test, band_hz)
    outside, blamed = seen.fraction, seen.find_cause()
    cause = blamed.clause if blamed else ""
    hint = cause or "check the order, signs, gains and units of the sensors, and whether a mode is missing"
    motion = f"{format_percent(outside, 2)} of the motion of test {test.name!r} around mode {mode}"
    is_told = outside > MODAL.warned_outside or blamed is not None
    clause = (f"{motion} is no sum of the mode shapes: {hint}",) if is_told else ()
    is_refused = outside > MODAL.most_outside
    return ShapeCheck(
        outside=outside,
        cause=cause,
        gain_std=seen.find_gain_std(test.modes.index(mode), blamed, gain_tolerance),
        faults=clause if is_refused else (),
        warnings=() if is_refused else clause,
    )


@dataclass(frozen=True)
class _Cause:
    """A clause on what puts motion outside the shapes, and the fraction that is still outside without it.

    Where it is the gain of one sensor, its index and its gain are given.
    """

    clause: str
    left: float
    index: int | None = None
    gain: float = 1.0


@dataclass(frozen=True, eq=False)
class _OutsideShapes:
    """The motion of a test in a band and the shapes at its sensors, both weighted as in the modal filter.

    The fraction outside is |x - Phi pinv(Phi) x| / |x| over the lines of the band, without the part of the noise.
    """

    sensors: tuple[str, ...]
    lines: ComplexArray  # (n_lines, n_sensors)
    shapes: FloatArray  # (n_sensors, n_modes)
    noise: float  # mean square of the noise of a line

    @classmethod
    def of(cls, test: ModalTest, band_hz: tuple[float, float]) -> _OutsideShapes:
        """Return those of a test; strains count as much as motions."""
        modes = with_sensors(test.modes, test.sensors)
        spectrum = fft.rfft(test.at_sensors * weigh_sensors(modes), axis=0)
        frequency = fft.rfftfreq(len(test.acceleration), 1 / test.fs)
        quiet = find_quiet_lines(test.modes, frequency)
        # Derivatives raise the noise above the band.
        slope = np.sqrt(band_hz[0] * band_hz[1]) / frequency[quiet, None]
        noise = float(np.mean(find_noise_power(spectrum[quiet] * slope ** np.array(test.times_differentiated))))
        inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
        return cls(test.sensors, spectrum[inside], weighted_shapes(modes), noise)

    @property
    def is_seen(self) -> bool:
        """Whether there are more sensors than modes, without which every motion is a sum of the shapes."""
        return self.shapes.shape[0] > self.shapes.shape[1]

    @property
    def fraction(self) -> float:
        """The fraction of the motion outside the shapes; 0 where it cannot be seen."""
        return self.find_fraction(self.shapes) if self.is_seen else 0.0

    def find_fraction(self, shapes: FloatArray) -> float:
        """Return the fraction of the motion outside some shapes."""
        n_sensors, n_modes = shapes.shape
        remainder = self.lines - self.lines @ np.linalg.pinv(shapes).T @ shapes.T
        excess = float(np.sum(np.abs(remainder) ** 2)) - self.noise * (n_sensors - n_modes) * len(self.lines)
        return float(np.sqrt(max(excess, 0.0) / max(float(np.sum(np.abs(self.lines) ** 2)), 1e-300)))

    def find_cause(self) -> _Cause | None:
        """Return the sensor of a wrong sign, the two that are exchanged, or the one of a wrong gain; None without."""
        found = self.fraction
        if found > MODAL.warned_outside:
            cause = self._find_wrong_sign(found) or self._find_exchange(found)
            if cause:
                return cause
        # What calibrations and chance put outside has no single cause.
        chance = self.noise * np.sqrt(self.lines.size) / max(float(np.sum(np.abs(self.lines) ** 2)), 1e-300)
        least = MODAL.shift_sigma * float(np.hypot(MODAL.outside_by_gains, np.sqrt(chance)))
        return self._find_wrong_gain(found, least) if found > least else None

    def _find_wrong_sign(self, found: float) -> _Cause | None:
        signs = np.where(np.eye(len(self.sensors), dtype=bool), -1.0, 1.0)
        turned = [self.find_fraction(self.shapes * sign[:, None]) for sign in signs]
        best = int(np.argmin(turned))
        if turned[best] > MODAL.left_by_cause * found:
            return None
        would_be = format_percent(round(turned[best], 3), 2)
        return _Cause(
            f"with the opposite sign of {self.sensors[best]!r} it would be {would_be}", turned[best], best, -1.0
        )

    def _find_exchange(self, found: float) -> _Cause | None:
        swaps = {}
        for one in range(len(self.sensors)):
            for other in range(one):
                order = np.arange(len(self.sensors))
                order[[one, other]] = other, one
                swaps[other, one] = self.find_fraction(self.shapes[order])
        pair = min(swaps, key=lambda pair: swaps[pair])
        if swaps[pair] > MODAL.left_by_cause * found:
            return None
        names = " and ".join(repr(self.sensors[index]) for index in pair)
        return _Cause(f"with {names} exchanged it would be {format_percent(round(swaps[pair], 3), 2)}", swaps[pair])

    def _find_wrong_gain(self, found: float, least: float) -> _Cause | None:
        """Return the only sensor whose gain explains what lies outside, if it is no matter of calibration.

        It is to blame if the gain of any other sensor leaves clearly more outside, and more than `least`.
        """
        gains = self._fit_gains()
        left = np.array(
            [
                self.find_fraction(self.shapes * np.where(np.arange(gains.size) == at, gain, 1.0)[:, None])
                for at, gain in enumerate(gains)
            ]
        )
        best, second = np.argsort(left)[:2]
        gain = float(gains[best])
        is_decisive = left[best] < MODAL.left_by_cause * found and left[second] > max(
            MODAL.shift_sigma * left[best], least
        )
        if not is_decisive or abs(gain - 1.0) < MODAL.least_wrong_gain:
            return None
        would_be = format_percent(round(left[best], 3), 2)
        return _Cause(
            f"with a gain of {gain:.2f} of {self.sensors[best]!r} it would be {would_be}; "
            f"check the sensitivity of this sensor, or the unit and scale of its channel",
            float(left[best]),
            int(best),
            gain,
        )

    def _fit_gains(self) -> FloatArray:
        """Return the gain of each sensor, (n_sensors,), that leaves least outside; 1 where nothing shows it.

        A reading x_s / g_s instead of x_s changes what lies outside by (1/g_s - 1) (I - Phi pinv(Phi)) e_s x_s.
        """
        n_lines, n_sensors = self.lines.shape
        across = np.eye(n_sensors) - self.shapes @ np.linalg.pinv(self.shapes)
        left = self.lines @ across.T
        noise = self.noise * n_lines * np.diag(across)
        power = np.sum(np.abs(self.lines) ** 2, axis=0)
        bent = np.sum((self.lines.conj() * left).real, axis=0) - noise
        own = power * np.diag(across) - noise
        inverse = 1.0 - bent / np.where(own > 0.5 * power * np.diag(across), own, np.inf)
        return np.where(np.abs(inverse) > 0.01, 1.0 / np.where(inverse == 0.0, 1.0, inverse), 1.0)

    def find_gain_std(self, index: int, cause: _Cause | None, gain_tolerance: float) -> float:
        """Return the standard deviation of the gain of a mode's coordinate, as a fraction.

        The modal filter F makes the gain 1 + sum_s F_s phi_s (g_s - 1) of the gains of the sensors. Each is known by
        its calibration, whose error may be common to all, for one calibrator served them, or their own: the worse of
        the two counts. Beside that, one sensor has a gain that puts the observed fraction outside the shapes, the one
        that matters most, or that which is to blame. Where the shapes cannot be checked, the calibration alone counts.
        """
        weights = np.linalg.pinv(self.shapes)[index] * self.shapes[:, index]
        fraction, blamed = self.fraction, 0.0
        if cause is not None and cause.index is not None:
            fraction, blamed = cause.left, float(weights[cause.index] * (cause.gain - 1.0))
        calibrated = gain_tolerance * max(1.0, float(np.linalg.norm(weights)))
        return float(np.linalg.norm([calibrated, blamed, _find_gain_error(self.shapes, index, fraction)]))


def _find_gain_error(shapes: FloatArray, index: int, outside: float) -> float:
    """Return the error of the gain of a mode's coordinate by a wrong gain of the sensor that matters most, a fraction.

    This gain explains what lies `outside` the shapes, (n_sensors, n_modes), as an rms fraction.
    """
    if shapes.shape[0] <= shapes.shape[1]:
        return 0.0
    own, filters = shapes[:, index], np.linalg.pinv(shapes)
    across = 1.0 - np.einsum("sm,ms->s", shapes, filters)
    moved = np.abs(own) / max(float(np.linalg.norm(own)), 1e-300) * np.sqrt(np.maximum(across, 0.0))
    # A sensor is dead or reads twice as much, but not more, if its gain is wrong.
    needed = np.minimum(outside / np.maximum(moved, 1e-12), 1.0)
    return float(np.max(np.abs(filters[index] * own) * needed))


def warn_of_rates(tests: Sequence[ModalTest], mode: int) -> Iterator[str]:
    """Yield one clause if some tests are sampled too slowly for the third harmonic of a mode with some of its width."""
    needed = {test: 2 * MODAL.third_harmonic * float(test.modes.frequency_hz[test.modes.index(mode)]) for test in tests}
    slow = [test for test in tests if test.fs < needed[test]]
    if slow:
        yield (
            f"{len(slow)} test(s) of mode {mode} at {slow[0].fs:g} Hz are sampled too slowly for its third harmonic: "
            f"the powers are wrong by some thousandths; record at {needed[slow[0]]:.0f} Hz or more"
        )


@dataclass(frozen=True)
class Interaction:
    """A mode that moves at a multiple of the frequency of the mode under test, more than the force explains.

    Args:
        mode: number of the mode under test.
        other: number of the mode that moves.
        multiple: 2 or 3.
        band_hz: that multiple of the band under test, Hz, in which the other mode moves.
        test: name of the test.
        fraction: its motion over that of the mode under test, rms of modal accelerations.
        by_force: the part of that motion which the force explains.
    """

    mode: int
    other: int
    multiple: int
    band_hz: tuple[float, float]
    test: str
    fraction: float
    by_force: float

    @property
    def product(self) -> Product:
        """The lowest product of the potential that drives the other mode in this way, q_i^2 q_j or q_i^3 q_j."""
        return Product((self.mode,) * self.multiple + (self.other,))

    @property
    def sentence(self) -> str:
        """The warning that a model without coupling is wrong."""
        return (
            f"mode {self.other} moves at {self.multiple} times the frequency of mode {self.mode} in test "
            f"{self.test!r}, {self.fraction:.2f} times as much, and the force explains {100 * self.by_force:.0f} % of "
            f"that: the modes interact, so this model is wrong where mode {self.other} moves; force appropriation "
            "would show it"
        )


def find_interactions(test: ModalTest, mode: int, band_hz: tuple[float, float]) -> Iterator[Interaction]:
    """Yield the modes that move at twice or three times the band of a mode, more than the force can have moved them.

    Pacini, section 4.2.2, proves such a coupling by force appropriation (`opid.modal.modal_interaction`). A mode is
    named if it moves at least 0.3 times as much as the mode under test, and the force explains less than 0.3 of that,
    for a shaker has harmonics, too.
    """
    index = test.modes.index(mode)
    frequency = fft.rfftfreq(len(test.acceleration), 1 / test.fs)
    spectra = fft.rfft(test.acceleration, axis=0)
    # The force alone would move linear modes in this way.
    forces = [test.modal_force(number + 1) for number in range(test.modes.n_modes)]
    driven = accelerance(test.modes, frequency) * fft.rfft(np.stack(forces, axis=1), axis=0)

    def find_rms(spectra: ComplexArray, multiple: int) -> FloatArray:
        inside = (frequency >= multiple * band_hz[0]) & (frequency <= multiple * band_hz[1])
        return np.sqrt(np.sum(np.abs(spectra[inside]) ** 2, axis=0))

    target = find_rms(spectra, 1)[index]
    for multiple in (2, 3):
        seen, own = find_rms(spectra, multiple), find_rms(driven, multiple)
        coupled = (seen > MODAL.least_answer * target) & (own < MODAL.most_driven * seen) & test.modes.elastic
        coupled[index] = False
        if coupled.any():
            other = int(np.argmax(np.where(coupled, seen, 0.0)))
            band = (multiple * band_hz[0], multiple * band_hz[1])
            yield Interaction(
                mode, other + 1, multiple, band, test.name, float(seen[other] / target), float(own[other] / seen[other])
            )


def _find_energy(test: ModalTest, mode: int) -> float:
    """Return the mean square of the velocity of a mode in its band, a measure of its kinetic energy."""
    _, velocity = integrate_mode(test, mode, _find_limits(test.modes, mode))
    return float(np.mean(velocity**2))


def _find_limits(modes: LinearModes, mode: int) -> tuple[float, float]:
    """Return the outermost ends of the band of a mode, Hz.

    It covers 0.8 of the distance to the neighbours, for the frequency of a nonlinear mode moves and the modal filter
    leaves little of the neighbours. It always holds the mode's own resonance.
    """
    index = modes.index(mode)
    natural = float(modes.frequency_hz[index])
    own = MODAL.half_widths * 2 * float(modes.damping_ratio[index]) * natural
    low, high = (natural + MODAL.to_neighbour * (neighbour - natural) for neighbour in modes.neighbours_hz(mode))
    low, high = max(low, MODAL.widest_band[0] * natural), min(high, MODAL.widest_band[1] * natural)
    return max(min(low, natural - own), 0.1 * natural), min(max(high, natural + own), 3 * natural)


def _compute_rms(lines: ComplexArray) -> float:
    return float(np.sqrt(np.mean(np.abs(lines) ** 2)))


def _measure_ends(test: ModalTest, lines: ModeLines, mode: int, band_hz: tuple[float, float]) -> tuple[float, str]:
    """Return the motion at an end of a record over the largest motion, without noise, and a verb for the worse end."""
    _, velocity = integrate_mode(test, mode, band_hz)
    period = test.fs / test.modes.frequency_hz[test.modes.index(mode)]
    n = max(round(5 * period), velocity.size // 100, 8)
    first = max(round(period), 8)  # an impact may come early
    # This is the variance of a sample by the noise of the band's lines.
    noise = 2 * np.sum((lines.noise_inertia / (2 * np.pi * lines.frequency_hz)) ** 2) / velocity.size**2
    begin, end = (float(np.sqrt(2 * max(np.mean(part**2) - noise, 0.0))) for part in (velocity[:first], velocity[-n:]))
    largest = float(np.abs(velocity).max()) or 1.0
    return (end / largest, "ends") if end >= begin else (begin / largest, "begins")
