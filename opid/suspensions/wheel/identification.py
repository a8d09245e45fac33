"""Unsprung mass, tyre and road of a gear from the same runs as its suspension, without a measured road.

The equations of wheel and sprung mass added (Iwaniec & Uhl 2007, eq. 1) hold whatever the law of the strut,

    M1 x1'' + C1 x1' + K1 x1 + M2 x2'' = K1 xb + C1 xb' = w,

with x1'' and x2'' measured and M2 known from runs of different loadings. The road xb is random. Its spectrum is that of
ISO 8608 with its roughness and slope, Gd(n) = Gd(n0) (n/n0)^-w at n = f/v cycles/m, averaged over the footprint L of
the tyre, sin(pi n L)^2/(pi n L)^2. So each line of w, in each block of a run, is a complex normal number whose
variance S is known but for a few numbers, and the likeliest of them are found (Whittle, Ark. Mat. 2 (1953) 423).

The density of the measured lines is that of the lines of w times the determinant of the map between them. Its
derivative is the trace of dD/dp R, D = M1 - K1/omega^2 + C1/(i omega), R the mean response of x1'' to a small force at
the wheel along the measured motion. For a linear strut R = 1/(D + M2 x2''/x1''). For a nonlinear one the equation
E[w* x1''] = S E[R] (Stein, Ann. Stat. 9 (1981) 1135) makes the mean derivative of the likelihood zero with this R, and
with no other: with the mean slopes of a strut with friction it was off by three standard deviations in M1 and C1. R is
computed from the tangent of the identified strut along its motion, driven by random forces.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, gammaincc

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate, format_number
from opid.mechanics.laws.law import Law
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.answer.stored_fit import KnownModel, StoredFit, restore_model, store_fits
from opid.suspensions.identification import check_study, collect_arrays
from opid.suspensions.result import Identification
from opid.suspensions.settings import Settings
from opid.suspensions.study import Run, Study
from opid.suspensions.wheel.result import (
    REFERENCE_CYCLES_PER_M,
    RunRoad,
    WheelIdentification,
    WheelParameters,
    classify_road,
)
from opid.suspensions.wheel.settings import WheelSettings

# The first entries of the vector of unknowns; the logarithms of the roughness of each run follow.
_MASS, _STIFFNESS, _DAMPING, _SLOPE, _FOOTPRINT, _FIRST_ROAD = range(6)


def identify_wheel(
    study: Study,
    result: Identification | Sequence[StoredFit],
    *,
    settings: WheelSettings | None = None,
    estimator: Settings | None = None,
    seed: int = 0,
    progress: Say | None = None,
) -> WheelIdentification:
    """Return unsprung mass, tyre and road of one gear, from the runs from which its suspension was identified.

    Each run needs its speed, `Run.speed_m_per_s`. Runs of one loading give everything per kg of the sprung mass.

    Args:
        study: the study that was identified, of one gear with vertical motion.
        result: its identification by the model, or the fits of a result.json.
        settings: tuned numbers.
        estimator: settings with which the study was identified, if they were not the usual ones.
        seed: seed of the random forces by which the mean response of the strut is computed.
        progress: called with the name of each step as it begins.

    Returns:
        Wheel, tyre and road; `not_determined` says why nothing is given, if nothing is.

    Raises:
        InputError: a body on several suspensions, a horizontal one, a result without numbers, a run without its speed,
            a speed that is no speed, or runs too slow or too short to compare lines.
    """
    known = settings or WheelSettings()
    say = progress or (lambda step: None)
    if not study.is_one_gear:
        raise InputError(
            "wheel and tyre are identified for one gear, whose sensor on the airframe shows all that its wheel carries: "
            "give the study of a gear alone, with its two channels in [channels]"
        )
    if study.interfaces[0].axis == "horizontal":
        raise InputError("the axis is 'horizontal', along which no road pushes a wheel: give runs of vertical motion")
    if isinstance(result, Identification):
        fits, usual = store_fits(result), estimator or result.settings
    else:
        fits, usual = tuple(result), estimator or Settings()
    if not fits:
        raise InputError(
            "the result gives no number with an interval for the suspension, without which wheel and tyre cannot be "
            "told from it: see its warnings, and identify runs that determine the suspension"
        )
    (fit,) = fits
    speeds = [_read_speed(run) for run in study.runs]
    checked = check_study(study, usual)
    arrays, _ = collect_arrays(checked)
    gears = []
    for run, speed, array in zip(checked.runs, speeds, arrays, strict=True):
        say(f"blocks of {run.name}")
        known_model = restore_model(fit, replace(checked, runs=(run,)), [array], usual, is_run=True)
        gears.append(_cut_into_blocks(known_model, run, speed, known))
    n_lines = sum(int(gear.is_used.sum()) for gear in gears)
    if n_lines < known.least_lines:
        raise InputError(
            f"only {n_lines} lines of all blocks belong to waves of {known.shortest_wave_m:g} m or more in the band of "
            f"{known.band_hz[0]:g} to {known.band_hz[1]:g} Hz: give longer or faster runs, and check the speed (m/s)"
        )
    why = _find_obstacle(fit, gears, known)
    if why is not None:
        return _refuse(study, gears, fit, known, seed, why)
    say("wheel and tyre")
    problem = _Problem(tuple(gears), known)
    try:
        found = _fit(problem, seed)
    except (NotDeterminedError, np.linalg.LinAlgError) as error:
        return _refuse(study, gears, fit, known, seed, f"the likelihood has no maximum: {error}")
    inverse_mass = gears[0].inverse_mass
    relative_std = 0.0
    if fit.has_mass and fit.is_mass_fitted:
        index = fit.names.index("inverse_mass")
        relative_std = float(np.sqrt(fit.covariance[index][index])) / inverse_mass
    return _build_answer(study, fit, found, 1.0 / inverse_mass if fit.has_mass else 1.0, relative_std, seed)


# ---- one run ---------------------------------------------------------------------------------------


def _read_speed(run: Run) -> FloatArray:
    """Return the speed at each sample of a run, (n_samples,) m/s."""
    stated, n = run.speed_m_per_s, run.recording.n_samples
    if stated is None:
        raise InputError(
            f"run {run.name!r} has no speed, without which waves of the road have no length: give speed_m_per_s, a "
            "number in m/s or the name of a channel"
        )
    if isinstance(stated, str):
        return np.abs(run.recording.channel(stated))
    return np.full(n, float(stated))


@dataclass(frozen=True, eq=False)
class Blocks:
    """One run, cut into blocks that overlap by half, under a Hann window.

    Masses and forces are per unit of the sprung mass of the reference. The equation is that of the rate of the force
    through the tyre: on a road whose slope is 2 its spectrum is nearly flat, so that no line leaks into another.

    Args:
        run: name of the run.
        fs: sampling rate, Hz.
        mass: sprung mass of this run over that of the reference.
        inverse_mass: one over the sprung mass of the reference, 1/kg; 0 without one.
        frequency_hz: (n_lines,) lines.
        terms: (4, n_blocks, n_lines) jerk, acceleration and velocity of the wheel, and the rate of the force of the
            sprung mass; the mean square of a line is a one-sided spectral density.
        speed: (n_blocks, n_speeds) speeds within each block, m/s.
        speed_of_samples: (n,) speed at each sample, m/s.
        ends_m_per_s: speed at the beginning, mean speed, and speed at the end.
        is_used: (n_blocks, n_lines) whether a line belongs to waves that are long enough.
        window: (n_block,) window.
        stiffness: (n,) tangent stiffness of the strut along its motion, 1/s^2.
        damping: (n,) tangent damping, 1/s.
        has_memory: whether the law of the strut has memory.
        has_ground: whether a spring carries the sprung mass to the ground.
    """

    run: str
    fs: float
    mass: float
    inverse_mass: float
    frequency_hz: FloatArray
    terms: ComplexArray
    speed: FloatArray
    speed_of_samples: FloatArray
    ends_m_per_s: tuple[float, float, float]
    is_used: NDArray[np.bool_]
    window: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    has_memory: bool
    has_ground: bool

    @property
    def omega(self) -> FloatArray:
        """(n_lines,) angular frequencies, rad/s."""
        return 2 * np.pi * self.frequency_hz

    @property
    def starts(self) -> NDArray[np.int64]:
        """(n_blocks,) first sample of each block."""
        return np.arange(self.speed.shape[0]) * (self.window.size // 2)

    @cached_property
    def weight_of_speeds(self) -> FloatArray:
        """(n_speeds,) power of the window about each speed of a block."""
        weight = np.array([part.mean() for part in np.array_split(self.window**2, self.speed.shape[1])])
        return weight / weight.sum()

    @cached_property
    def information(self) -> float:
        """Number of independent lines over the number of lines: neighbours share data through window and overlap."""
        h, n = self.window, self.window.size
        total = 0.0
        for later in (0, n // 2):
            overlap = np.abs(np.fft.fft(h[: n - later] * h[later:], n)) ** 2 / np.sum(h**2) ** 2
            total += float(overlap.sum()) * (2 if later else 1)
        return 1.0 / total


def _cut_into_blocks(known: KnownModel, run: Run, speed: FloatArray, settings: WheelSettings) -> Blocks:
    model, theta = known.model, known.mean
    driven = model.runs[0]
    below, above = model.correct(theta, 0)
    finer = max(1, round(driven.fs / run.recording.fs))
    fs = driven.fs / finer
    wheel, body = below.value[::2, 0][::finer], above.value[::finer, 0]
    (prediction,) = model.evaluate(theta, sensitivity=False).predictions
    travel, velocity = prediction.travel[::finer, 0], prediction.velocity[::finer, 0]
    n = min(wheel.size, body.size, travel.size)
    wheel, body, speed = wheel[:n] - wheel[:n].mean(), body[:n] - body[:n].mean(), speed[:n]
    n_block = 2 * round(0.5 * settings.block_s * fs)
    if n < 2 * n_block:
        raise InputError(f"run {run.name!r} lasts {n / fs:.3g} s: give at least {2 * settings.block_s:g} s")
    window = np.hanning(n_block + 1)[:n_block]
    starts = np.arange(0, n - n_block + 1, n_block // 2)
    frequency = np.asarray(np.fft.rfftfreq(n_block, 1 / fs), dtype=np.float64)
    low, high = settings.band_hz[0], min(settings.band_hz[1], settings.highest_fraction * fs)
    kept = (frequency >= low) & (frequency <= high)
    omega, dt = 2 * np.pi * frequency[kept], 1 / fs
    # The mean velocity of a wheel is none, whatever the offset of its sensor.
    moved = np.concatenate([[0.0], np.cumsum(0.5 * dt * (wheel[1:] + wheel[:-1]))])
    moved -= np.polyval(np.polyfit(np.arange(n), moved, 1), np.arange(n))
    mass = 1.0 + model.inverse_mass(theta) * float(driven.loading[0, 0])

    def transform(samples: FloatArray) -> ComplexArray:
        cut = np.stack([samples[first : first + n_block] for first in starts])
        return np.asarray(np.fft.rfft(window * cut)[:, kept] * np.sqrt(2 * dt / np.sum(window**2)))

    # Differences and the trapezoidal rule are exact derivatives and integrals of each line once their gain is removed.
    by_difference = omega * dt / np.sin(omega * dt)
    by_sum = np.tan(0.5 * omega * dt) / (0.5 * omega * dt)
    terms = np.stack(
        [
            transform(np.gradient(wheel, dt)) * by_difference,
            transform(wheel),
            transform(moved) * by_sum,
            transform(np.gradient(mass * body, dt)) * by_difference,
        ]
    )
    at = (np.arange(settings.n_speeds) + 0.5) / settings.n_speeds * n_block
    speeds = np.maximum(speed[(starts[:, np.newaxis] + at).astype(int)], 1e-3)
    # In a block that ends far slower than it begins, the road is not one random process.
    slowest = np.where(speeds.min(axis=1) >= settings.least_steady * speeds.max(axis=1), speeds.min(axis=1), 0.0)
    suspension = model.resting_interfaces(theta, 0)[0]
    assert isinstance(suspension.law, Law)  # without candidates
    by_travel, by_velocity = suspension.law.gradient(travel[:n], velocity[:n])
    return Blocks(
        run=run.name,
        fs=fs,
        mass=mass,
        inverse_mass=model.inverse_mass(theta),
        frequency_hz=frequency[kept],
        terms=terms,
        speed=speeds,
        speed_of_samples=np.maximum(speed, 1e-3),
        ends_m_per_s=(float(speed[0]), float(speed.mean()), float(speed[-1])),
        is_used=frequency[kept] * settings.shortest_wave_m <= slowest[:, np.newaxis],
        window=window,
        stiffness=suspension.stiffness + np.broadcast_to(by_travel, n),
        damping=suspension.damping + np.broadcast_to(by_velocity, n),
        has_memory=suspension.law.has_memory,
        has_ground=suspension.ground_stiffness != 0.0,
    )


def _find_obstacle(fit: StoredFit, gears: Sequence[Blocks], settings: WheelSettings) -> str | None:
    """Return why the equation of the wheel cannot be used, if it cannot."""
    if fit.over_noise > settings.most_left:
        return (
            f"the model of the suspension leaves {fit.over_noise:.3g} times the noise of the sensors: what pushes the "
            "airframe beside the strut would be taken for a force of the road"
        )
    if any(gear.has_ground for gear in gears):
        return "a spring from the airframe to the ground carries a part of the force that the tyre would carry"
    if any(gear.has_memory for gear in gears):
        return (
            "the law of the strut has memory, so that its mean response to a small force along the motion is not known"
        )
    return None


# ---- likelihood ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of one run at a vector of unknowns.

    Args:
        ratio: (n_blocks, n_lines) squared magnitude over its expectation.
        log_density: (n_blocks, n_lines) logarithm of the expectation.
        response: (n_lines,) or (n_blocks, n_lines) mean response R of the acceleration of the wheel to a force, per
            unit of mass.
        score: (n_unknowns, n_blocks, n_lines) derivative of minus the logarithm of the likelihood of each line.
        slopes: (n_unknowns, n_blocks, n_lines) derivative of the logarithm of the spectrum of the wheel, whose squares
            sum to the Fisher information.
    """

    ratio: FloatArray
    log_density: FloatArray
    response: ComplexArray
    score: FloatArray
    slopes: FloatArray


@dataclass(frozen=True, eq=False)
class _Problem:
    """The likelihood of all runs as a function of the vector of unknowns.

    The unknowns are the logarithms of M1 and K1 over the sprung mass of the reference, C1 over it (1/s), the slope of
    the road, the footprint (m), and the logarithm of the roughness (m^3) of each run: two runs need not go over the
    same road, and the level of one tells nothing about the other. With `columns`, (n_blocks,) of each run, the last
    unknown is the relative change of K1 in proportion to them.
    """

    gears: tuple[Blocks, ...]
    settings: WheelSettings
    columns: tuple[FloatArray, ...] = ()

    @property
    def n_unknowns(self) -> int:
        return _FIRST_ROAD + len(self.gears) + bool(self.columns)

    @cached_property
    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Expected vector and the inverse variances of its entries, 0 where nothing is known."""
        mean, inverse = np.zeros(self.n_unknowns), np.zeros(self.n_unknowns)
        known = self.settings
        mean[_SLOPE], inverse[_SLOPE] = known.slope, known.slope_std**-2
        mean[_FOOTPRINT], inverse[_FOOTPRINT] = known.footprint_m, known.footprint_std_m**-2
        return mean, inverse

    def evaluate(self, vector: FloatArray, struts: Sequence[ComplexArray]) -> tuple[Lines, ...]:
        """Return the lines of each run.

        Args:
            vector: the unknowns.
            struts: (n_lines,) force of the strut on the wheel over the acceleration of the wheel, for each run.
        """
        return tuple(
            evaluate_lines(gear, vector, _FIRST_ROAD + k, strut, self.columns[k] if self.columns else None)
            for k, (gear, strut) in enumerate(zip(self.gears, struts, strict=True))
        )

    def cost(self, lines: Sequence[Lines], vector: FloatArray) -> float:
        """Return minus the logarithm of the likelihood."""
        mean, inverse = self.prior
        total = 0.5 * float(inverse @ (vector - mean) ** 2)
        for gear, each in zip(self.gears, lines, strict=True):
            # The map of the likelihood's lines has the determinant omega/|R|.
            terms = each.ratio + each.log_density + 2 * np.log(np.abs(each.response))
            total += gear.information * float(terms[gear.is_used].sum())
        return total

    def gradient(self, lines: Sequence[Lines], vector: FloatArray) -> FloatArray:
        """Return the derivative of the cost."""
        mean, inverse = self.prior
        total = inverse * (vector - mean)
        for gear, each in zip(self.gears, lines, strict=True):
            total = total + gear.information * each.score[:, gear.is_used].sum(axis=1)
        return np.asarray(total)

    def fisher(self, lines: Sequence[Lines]) -> FloatArray:
        """Return the Fisher information of the vector if the strut were linear, with the prior."""
        total = np.diag(self.prior[1])
        for gear, each in zip(self.gears, lines, strict=True):
            used = each.slopes[:, gear.is_used]
            total = total + gear.information * used @ used.T
        return np.asarray(total)


def evaluate_lines(
    gear: Blocks, vector: FloatArray, road: int, strut: ComplexArray, column: FloatArray | None = None
) -> Lines:
    """Return the lines of one run at a vector of unknowns.

    Args:
        gear: the run.
        vector: the unknowns.
        road: index of the roughness of this run in the vector.
        strut: (n_lines,) force of the strut on the wheel over the acceleration of the wheel.
        column: (n_blocks,) what K1 changes in proportion to, by the last unknown; None if it is one number.
    """
    m1, c1 = np.exp(vector[_MASS]), vector[_DAMPING]
    change = 0.0 if column is None else vector[-1] * column[:, np.newaxis]
    k1 = np.exp(vector[_STIFFNESS] + change)
    omega = gear.omega
    jerk, acceleration, velocity, carried = gear.terms
    error = m1 * jerk + c1 * acceleration + k1 * velocity + carried
    by = (m1 * jerk, k1 * velocity, acceleration)
    dynamic = (m1 + 0j, -k1 / omega**2, 1 / (1j * omega))
    response = 1.0 / (m1 - k1 / omega**2 + c1 / (1j * omega) + strut)
    tyre = k1**2 + (c1 * omega) ** 2
    log_road, by_slope, by_footprint = _average_road(gear, vector[_SLOPE], vector[_FOOTPRINT])
    log_density = np.log(omega**2 * tyre) + vector[road] + log_road
    ratio = np.abs(error) ** 2 * np.exp(-log_density)

    shape = (vector.size, *ratio.shape)
    of_density = np.zeros(shape)
    of_density[_STIFFNESS] = 2 * k1**2 / tyre
    of_density[_DAMPING] = 2 * c1 * omega**2 / tyre
    of_density[_SLOPE], of_density[_FOOTPRINT], of_density[road] = by_slope, by_footprint, 1.0
    score = of_density * (1.0 - ratio)
    slopes = of_density
    for k, (each, change) in enumerate(zip(by, dynamic, strict=True)):
        by_map = 2 * np.real(response * change)
        score[k] += 2 * np.real(error.conj() * each) * np.exp(-log_density) - by_map
        slopes[k] -= by_map
    if column is not None:
        score[-1], slopes[-1] = (each[_STIFFNESS] * column[:, np.newaxis] for each in (score, slopes))
    return Lines(ratio, log_density, response, score, slopes)


def _average_road(gear: Blocks, slope: float, footprint_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the logarithm of the road's spectrum per unit of roughness, and its derivatives by slope and footprint.

    Each is (n_blocks, n_lines). Within a block the spectrum is averaged over the speeds.
    """
    speed = gear.speed[:, np.newaxis, :]
    wave_number = gear.frequency_hz[:, np.newaxis] / speed
    log_ratio = np.log(wave_number / REFERENCE_CYCLES_PER_M)
    angle = np.pi * wave_number * abs(footprint_m) + 1e-9
    density = np.exp(-slope * log_ratio) / speed * (np.sin(angle) / angle) ** 2
    by_footprint = 2 * (1 / np.tan(angle) - 1 / angle) * np.pi * wave_number * np.sign(footprint_m)
    weight = gear.weight_of_speeds
    mean = density @ weight
    return np.log(mean), -(density * log_ratio) @ weight / mean, (density * by_footprint) @ weight / mean


# ---- the mean response of the strut ----------------------------------------------------------------


def _straight_strut(gear: Blocks) -> ComplexArray:
    """Return force of the strut over acceleration of the wheel, with the mean slopes of its law."""
    spring = gear.stiffness.mean() + 1j * gear.omega * gear.damping.mean()
    return np.asarray(gear.mass * spring / (spring - gear.omega**2 * gear.mass))


def _tangent_strut(gear: Blocks, vector: FloatArray, settings: WheelSettings, seed: int) -> ComplexArray:
    """Return the same by the mean response of the gear to small random forces along its measured motion.

    The state (x1, x1', z, z') follows the tangent of the law from sample to sample; the force goes linearly between
    them. R is the mean over blocks and probes, in those blocks in which a line is compared.
    """
    m1, k1, c1 = np.exp(vector[_MASS]), np.exp(vector[_STIFFNESS]), vector[_DAMPING]
    n, dt, rng = gear.stiffness.size, 1 / gear.fs, np.random.default_rng(seed)
    stiffness = 0.5 * (gear.stiffness[1:] + gear.stiffness[:-1])
    damping = 0.5 * (gear.damping[1:] + gear.damping[:-1])
    rates = np.zeros((n - 1, 6, 6))
    rates[:, 0, 1] = rates[:, 2, 3] = 1.0
    rates[:, 1, :2] = -k1 / m1, -c1 / m1
    rates[:, 1, 2], rates[:, 1, 3], rates[:, 1, 4] = stiffness / m1, damping / m1, 1 / m1
    rates[:, 3] = -rates[:, 1]
    rates[:, 3, 2] -= stiffness / gear.mass
    rates[:, 3, 3] -= damping / gear.mass
    rates[:, 4, 5] = gear.fs
    steps = _exponentiate(rates * dt)

    frequency = np.fft.rfftfreq(n, dt)
    low, high = float(gear.frequency_hz[0]), float(gear.frequency_hz[-1])
    excited = (frequency >= low / settings.probe_margin) & (frequency <= high * settings.probe_margin)
    lines = np.zeros((frequency.size, settings.n_probes), dtype=np.complex128)
    lines[excited] = np.exp(2j * np.pi * rng.random((int(excited.sum()), settings.n_probes)))
    # A road on which the vehicle brakes pushes less and less, also within a block.
    fade = gear.speed_of_samples ** (0.5 * (vector[_SLOPE] - 1.0))
    force = fade[:, np.newaxis] * np.fft.irfft(lines, n, axis=0)
    pushed = steps[:, :4, 4, np.newaxis] * force[:-1, np.newaxis]
    pushed += steps[:, :4, 5, np.newaxis] * np.diff(force, axis=0)[:, np.newaxis]
    turn = np.ascontiguousarray(steps[:, :4, :4])
    state = np.zeros((n, 4, settings.n_probes))
    for k in range(n - 1):
        state[k + 1] = turn[k] @ state[k] + pushed[k]
    own = -k1 * state[:, 0] - c1 * state[:, 1]
    own += gear.stiffness[:, np.newaxis] * state[:, 2] + gear.damping[:, np.newaxis] * state[:, 3]

    n_block = gear.window.size
    kept = np.round(gear.frequency_hz * n_block * dt).astype(int)
    crossed, total = np.zeros(kept.size, dtype=np.complex128), np.zeros(kept.size)
    for first, used in zip(gear.starts, gear.is_used, strict=True):
        seen, by = (
            np.fft.rfft(gear.window[:, np.newaxis] * each[first : first + n_block], axis=0)[kept]
            for each in (own, force)
        )
        power = np.sum(np.abs(by) ** 2, axis=1)
        weight = used / power.mean()
        crossed += weight * np.sum(seen * by.conj(), axis=1)
        total += weight * power
    is_seen = total > 0.0
    # A force that goes linearly between samples has this much less at each frequency.
    smoothed = np.sinc(gear.frequency_hz * dt) ** 2
    response = (1.0 + crossed / np.where(is_seen, total, 1.0) / smoothed) / m1
    dynamic = m1 - k1 / gear.omega**2 + c1 / (1j * gear.omega)
    return np.where(is_seen, 1.0 / response - dynamic, _straight_strut(gear))


def _exponentiate(matrices: FloatArray) -> FloatArray:
    """Return the exponentials of small matrices, (n, m, m), by their series and by squaring twice."""
    scaled = 0.25 * matrices
    term = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    total = term.copy()
    for order in range(1, 7):
        term = term @ scaled / order
        total += term
    squared = total @ total
    return np.asarray(squared @ squared)


# ---- fit -------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Found:
    """The likeliest vector with its covariance.

    Args:
        problem: the likelihood.
        vector: the unknowns.
        covariance: covariance of the vector.
        lines: lines of each run.
        struts: force of the strut over acceleration of the wheel.
    """

    problem: _Problem
    vector: FloatArray
    covariance: FloatArray
    lines: tuple[Lines, ...]
    struts: tuple[ComplexArray, ...]


def _fit(problem: _Problem, seed: int) -> _Found:
    """Return the likeliest vector: the mean response of the strut and the vector are computed in turn."""
    known = problem.settings
    struts = tuple(map(_straight_strut, problem.gears))
    vector = _search_start(problem, struts)
    for _ in range(known.most_rounds):
        before = vector
        vector, lines = _climb(problem, vector, struts)
        std = np.sqrt(np.diag(np.linalg.inv(problem.fisher(lines))))
        if (np.abs(vector - before) < known.settled_std * std).all():
            break
        struts = tuple(_tangent_strut(gear, vector, known, seed + number) for number, gear in enumerate(problem.gears))
    else:
        raise NotDeterminedError("the response of the strut and the parameters of the tyre do not settle")
    covariance = _find_covariance(problem, vector, lines, struts)
    return _Found(problem, vector, covariance, lines, struts)


def _search_start(problem: _Problem, struts: Sequence[ComplexArray]) -> FloatArray:
    """Return the likeliest of a few vectors, each with the roughness that fits it."""
    known, found = problem.settings, []
    for mass in known.start_masses:
        for tyre_hz in known.start_tyre_hz:
            vector = np.zeros(problem.n_unknowns)
            vector[_MASS], vector[_STIFFNESS] = np.log(mass), 2 * np.log(2 * np.pi * tyre_hz)
            vector[_SLOPE], vector[_FOOTPRINT] = known.slope, known.footprint_m
            for k, (gear, each) in enumerate(zip(problem.gears, problem.evaluate(vector, struts), strict=True)):
                vector[_FIRST_ROAD + k] = np.log(np.mean(each.ratio[gear.is_used]))
            found.append((problem.cost(problem.evaluate(vector, struts), vector), vector))
    return min(found, key=lambda each: each[0])[1]


def _climb(
    problem: _Problem, vector: FloatArray, struts: Sequence[ComplexArray]
) -> tuple[FloatArray, tuple[Lines, ...]]:
    """Return the vector of least cost for given struts, by Fisher scoring, and its lines."""
    lines = problem.evaluate(vector, struts)
    cost = problem.cost(lines, vector)
    for _ in range(problem.settings.most_steps):
        gradient, fisher = problem.gradient(lines, vector), problem.fisher(lines)
        step = -np.linalg.solve(fisher, gradient)
        step *= min(1.0, problem.settings.largest_step / max(np.abs(step[[_MASS, _STIFFNESS]]).max(), 1e-12))
        promise = -float(gradient @ step)
        if promise < 1e-4:
            break
        fraction = 1.0
        while fraction > 1e-3:
            trial = vector + fraction * step
            tried = problem.evaluate(trial, struts)
            lower = problem.cost(tried, trial)
            if np.isfinite(lower) and lower < cost:
                break
            fraction *= 0.5
        else:
            break
        vector, lines, cost = trial, tried, lower
    return vector, lines


def _find_covariance(
    problem: _Problem, vector: FloatArray, lines: Sequence[Lines], struts: Sequence[ComplexArray]
) -> FloatArray:
    """Return the covariance of the vector, never less than what the scores of the blocks show.

    The curvature of the likelihood gives that of a Gaussian road. A road that is rough here and smooth there makes the
    scores of blocks vary more; each standard deviation then is that of the sandwich formula (Huber 1967; White,
    Econometrica 50 (1982) 1), corrected for the few blocks of short runs.

    Raises:
        NotDeterminedError: the likelihood has no curvature in some direction.
    """
    inverse = np.linalg.inv(_find_curvature(problem, vector, struts))
    if not (np.diag(inverse) > 0.0).all():
        raise NotDeterminedError("it is flat in some direction")
    spread, n_blocks = np.diag(problem.prior[1]), 0.0
    for gear, each in zip(problem.gears, lines, strict=True):
        scores = gear.information * np.where(gear.is_used, each.score, 0.0).sum(axis=2)
        scores = scores - scores.mean(axis=1, keepdims=True)
        neighbours = scores[:, 1:] @ scores[:, :-1].T
        spread = spread + scores @ scores.T + 0.5 * (neighbours + neighbours.T)
        n_blocks += 0.5 * float(gear.is_used.any(axis=1).sum())
    few = n_blocks / max(n_blocks - problem.n_unknowns, 1.0)
    sandwich = few * np.diag(inverse @ spread @ inverse)
    wider = np.sqrt(np.maximum(1.0, sandwich / np.diag(inverse)))
    return np.asarray(wider[:, np.newaxis] * inverse * wider)


def _find_curvature(problem: _Problem, vector: FloatArray, struts: Sequence[ComplexArray]) -> FloatArray:
    """Return the second derivatives of the cost for given struts.

    A nonlinear strut adds power to the motion of the wheel, which the Fisher information of a linear one leaves out.
    """
    found = np.zeros((vector.size, vector.size))
    for k in range(vector.size):
        ends = []
        for sign in (-1.0, 1.0):
            moved = vector.copy()
            moved[k] += sign * 1e-4
            ends.append(problem.gradient(problem.evaluate(moved, struts), moved))
        found[k] = (ends[1] - ends[0]) / 2e-4
    return 0.5 * (found + found.T)


# ---- checks ----------------------------------------------------------------------------------------


def _find_unusual(found: _Found) -> tuple[float, str]:
    """Return the probability of the most unusual part of the normalised periodogram, times the number of parts.

    A part is a block, a band or a line of one run; the mean ratio over it has the distribution of a chi-square
    variable with two degrees of freedom for each independent line.
    """
    parts = [part for gear, each in zip(found.problem.gears, found.lines, strict=True)
             for part in _list_parts(gear, each.ratio, found.problem.settings)]  # fmt: skip
    probabilities = []
    for n_independent, mean, words in parts:
        tail = gammaincc if mean > 1.0 else gammainc
        probabilities.append((2.0 * float(tail(n_independent, n_independent * mean)), words))
    least, words = min(probabilities)
    return min(1.0, least * len(parts)), words


def _list_parts(gear: Blocks, ratio: FloatArray, settings: WheelSettings) -> Iterator[tuple[float, float, str]]:
    """Yield number of independent lines, mean ratio and name of each part of a run."""
    used, where = gear.is_used, f"of run {gear.run!r}"
    octave = np.floor(settings.bands_per_octave * np.log2(gear.frequency_hz / gear.frequency_hz[0]) + 1e-9)
    # Neighbouring lines of one block share data, and so do neighbouring blocks of one line, but less of it.
    along_time = 1.0 / (1.0 + 2.0 * _overlap(gear.window, gear.window.size // 2))
    for k, first in enumerate(gear.starts):
        if used[k].any():
            n = used[k].sum() * gear.information / along_time
            begin_s = first / gear.fs
            words = f"{begin_s:.3g} to {begin_s + gear.window.size / gear.fs:.3g} s {where}"
            yield float(n), float(ratio[k, used[k]].mean()), words
    for number in np.unique(octave):
        part = used & (octave == number)
        if part.any():
            inside = gear.frequency_hz[octave == number]
            words = f"{inside[0]:.3g} to {inside[-1]:.3g} Hz {where}"
            yield float(part.sum() * gear.information), float(ratio[part].mean()), words
    for k, frequency in enumerate(gear.frequency_hz):
        if used[:, k].any():
            mean = float(ratio[used[:, k], k].mean())
            yield float(used[:, k].sum() * along_time), mean, f"{frequency:.3g} Hz {where}"


def _overlap(window: FloatArray, later: int) -> float:
    """Return the squared correlation of a line in two blocks, one of which begins some samples later."""
    return float(np.sum(window[later:] * window[: window.size - later]) / np.sum(window**2)) ** 2


def _measure_change(found: _Found, columns: Sequence[FloatArray]) -> Estimate:
    """Return the relative change of the tyre stiffness in proportion to a quantity of each block, with one step.

    Args:
        found: the fit without a change.
        columns: (n_blocks,) the quantity in each block of each run.
    """
    problem = replace(found.problem, columns=tuple(columns))
    vector = np.append(found.vector, 0.0)
    lines = problem.evaluate(vector, found.struts)
    step = -np.linalg.solve(_find_curvature(problem, vector, found.struts), problem.gradient(lines, vector))
    try:
        covariance = _find_covariance(problem, vector, lines, found.struts)
    except NotDeterminedError:
        return Estimate()
    return Estimate.normal(float(step[-1]), float(np.sqrt(covariance[-1, -1])))


# ---- answer ----------------------------------------------------------------------------------------


def _refuse(
    study: Study, gears: Sequence[Blocks], fit: StoredFit, settings: WheelSettings, seed: int, why: str
) -> WheelIdentification:
    nothing = np.empty(0)
    return WheelIdentification(
        title=study.title,
        per_mass=not fit.has_mass,
        parameters=WheelParameters(),
        roads=tuple(
            RunRoad(gear.run, gear.ends_m_per_s, Estimate(), "", nothing, nothing, nothing, nothing) for gear in gears
        ),
        stiffening=Estimate(),
        stiffer_by_load=Estimate(),
        bounds=None,
        unusual=float("nan"),
        n_lines=sum(int(gear.is_used.sum()) for gear in gears),
        not_determined=why,
        warnings=(),
        settings=settings,
        seed=seed,
        files=study.files,
    )


def _build_answer(
    study: Study, fit: StoredFit, found: _Found, unit_kg: float, unit_std: float, seed: int
) -> WheelIdentification:
    known, gears = found.problem.settings, found.problem.gears
    unusual, where = _find_unusual(found)
    if unusual < known.rejected_p:
        return _refuse(
            study, gears, fit, known, seed,
            f"the spectrum of the force through the tyre is not that of a rough road under a linear tyre: at {where} "
            f"it differs by more than chance allows (probability {unusual:.1g}); look for a bump, slabs, a wrong speed "
            "or another force there, and leave that stretch out",
        )  # fmt: skip
    vector, std = found.vector, np.sqrt(np.diag(found.covariance))
    parameters = _estimate_parameters(found, unit_kg, unit_std)
    roads = tuple(
        _describe_road(gear, lines, vector[_FIRST_ROAD + k], std[_FIRST_ROAD + k], unit_kg)
        for k, (gear, lines) in enumerate(zip(gears, found.lines, strict=True))
    )
    by_speed, by_load = _measure_speed_change(found), _measure_load_change(found)
    return WheelIdentification(
        title=study.title,
        per_mass=not fit.has_mass,
        parameters=parameters,
        roads=roads,
        stiffening=by_speed,
        stiffer_by_load=by_load,
        bounds=_find_bounds(found),
        unusual=unusual,
        n_lines=sum(int(gear.is_used.sum()) for gear in gears),
        not_determined=None,
        warnings=tuple(_warn(parameters, by_speed, by_load, known, per_mass=not fit.has_mass)),
        settings=known,
        seed=seed,
        files=study.files,
    )


def _estimate_parameters(found: _Found, unit_kg: float, unit_std: float) -> WheelParameters:
    vector, covariance, known = found.vector, found.covariance, found.problem.settings
    std = np.sqrt(np.diag(covariance))

    def estimate_log(index: int) -> Estimate:
        value, relative = unit_kg * float(np.exp(vector[index])), float(np.hypot(std[index], unit_std))
        ends = (value * float(np.exp(-1.96 * relative)), value * float(np.exp(1.96 * relative)))
        return Estimate(value if relative <= known.loosely_known else None, value * relative, ends)

    damping, damping_std = float(vector[_DAMPING]), float(std[_DAMPING])
    hop = _find_hop(found.problem.gears[0], vector)
    gradient = np.zeros((2, vector.size))
    for k in (_MASS, _STIFFNESS, _DAMPING):
        moved = vector.copy()
        moved[k] += 1e-3 * std[k]
        gradient[:, k] = (_find_hop(found.problem.gears[0], moved) - hop) / (1e-3 * std[k])
    hop_std = np.sqrt(np.einsum("ij,jk,ik->i", gradient, covariance, gradient))
    return WheelParameters(
        unsprung_mass_kg=estimate_log(_MASS),
        tyre_stiffness_n_per_m=estimate_log(_STIFFNESS),
        tyre_damping_n_s_per_m=_give_positive(unit_kg * damping, unit_kg * damping_std, known),
        hop_frequency_hz=_give_positive(float(hop[0]), float(hop_std[0]), known),
        hop_damping_ratio=_give_positive(float(hop[1]), float(hop_std[1]), known),
        footprint_m=_give_positive(abs(float(vector[_FOOTPRINT])), float(std[_FOOTPRINT]), known),
        road_slope=Estimate.normal(float(vector[_SLOPE]), float(std[_SLOPE])),
    )


def _give_positive(value: float, std: float, settings: WheelSettings) -> Estimate:
    """Return an estimate of what cannot be negative; where it is loosely known, its interval alone."""
    whole = Estimate.normal(value, std)
    if std <= settings.loosely_known * value:
        return whole
    return Estimate(None, std, (max(0.0, value - 1.96 * std), max(0.0, value + 1.96 * std)))


def _find_hop(gear: Blocks, vector: FloatArray) -> FloatArray:
    """Return natural frequency (Hz) and damping ratio of the faster motion of wheel and sprung mass."""
    m1, k1, c1 = np.exp(vector[_MASS]), np.exp(vector[_STIFFNESS]), vector[_DAMPING]
    k2, c2 = gear.stiffness.mean(), gear.damping.mean()
    mass = np.array([m1, gear.mass])
    stiffness, damping = np.array([[k1 + k2, -k2], [-k2, k2]]), np.array([[c1 + c2, -c2], [-c2, c2]])
    upper = np.hstack([np.zeros((2, 2)), np.eye(2)])
    lower = np.hstack([-stiffness / mass[:, np.newaxis], -damping / mass[:, np.newaxis]])
    pole = max(np.linalg.eigvals(np.vstack([upper, lower])), key=abs)
    return np.array([abs(pole) / (2 * np.pi), -pole.real / abs(pole)])


def _describe_road(gear: Blocks, lines: Lines, log_level: float, std: float, unit_kg: float) -> RunRoad:
    level = float(np.exp(log_level))
    ends = (level * float(np.exp(-1.96 * std)), level * float(np.exp(1.96 * std)))
    n_blocks = gear.is_used.sum(axis=0)
    seen = n_blocks > 0
    density = np.exp(lines.log_density) * unit_kg**2

    def average(values: FloatArray) -> FloatArray:
        return np.asarray(np.where(gear.is_used, values, 0.0).sum(axis=0)[seen] / n_blocks[seen])

    return RunRoad(
        run=gear.run,
        speed_m_per_s=gear.ends_m_per_s,
        roughness_m3=Estimate(level, level * float(std), ends),
        road_class=classify_road(ends),
        frequency_hz=gear.frequency_hz[seen],
        measured=average(lines.ratio * density),
        fitted=average(density),
        n_blocks=n_blocks[seen].astype(float),
    )


def _find_bounds(found: _Found) -> tuple[float, float, float] | None:
    """Return the relative standard deviations of M1, K1 and C1 by Fisher information; None for no damping."""
    problem, vector = found.problem, found.vector
    if vector[_DAMPING] <= 0.0:
        return None
    lines = problem.evaluate(vector, tuple(map(_straight_strut, problem.gears)))
    std = np.sqrt(np.diag(np.linalg.inv(problem.fisher(lines))))
    return float(std[_MASS]), float(std[_STIFFNESS]), float(std[_DAMPING] / vector[_DAMPING])


def _measure_speed_change(found: _Found) -> Estimate:
    """Return the relative change of the tyre stiffness for a doubled speed; empty at a steady speed."""
    columns = [np.log2(gear.speed.mean(axis=1)) for gear in found.problem.gears]
    used = np.concatenate(
        [column[gear.is_used.any(axis=1)] for column, gear in zip(columns, found.problem.gears, strict=True)]
    )
    if np.ptp(used) < 1.0:
        return Estimate()
    return _measure_change(found, [column - used.mean() for column in columns])


def _measure_load_change(found: _Found) -> Estimate:
    """Return the relative change of the tyre stiffness by the loading most unlike that of the first run."""
    gears = found.problem.gears
    changes = np.array([gear.mass - gears[0].mass for gear in gears])
    most = float(changes[np.argmax(np.abs(changes))])
    if abs(most) < 1e-3:
        return Estimate()
    columns = [np.full(gear.speed.shape[0], change / most) for gear, change in zip(gears, changes, strict=True)]
    return _measure_change(found, columns)


def _warn(
    parameters: WheelParameters, by_speed: Estimate, by_load: Estimate, settings: WheelSettings, *, per_mass: bool
) -> Iterator[str]:
    names = {
        "unsprung_mass_kg": "the unsprung mass",
        "tyre_stiffness_n_per_m": "the tyre stiffness",
        "tyre_damping_n_s_per_m": "the tyre damping",
    }
    loose = [names[name] for name, each in parameters.items() if each.value is None and name in names]
    if loose:
        yield (
            f"these runs give only an interval of {' and '.join(loose)}: the standard deviation falls with the root of "
            "the total length of the runs, at a speed at which the wheel hops"
        )
    for change, words in ((by_speed, "with the speed"), (by_load, "with the load")):
        if change.value is not None and change.std and abs(change.value) > settings.unequal_std * change.std:
            percent = format_number(100 * change.value, 2)
            yield (
                f"the tyre stiffness changes {words} by {percent} %: the tyre is not linear, and its stiffness here is "
                "that of a mean motion"
            )
    if per_mass:
        yield "the result has no sprung mass, so all is per kg of it: identify runs with different loadings"
