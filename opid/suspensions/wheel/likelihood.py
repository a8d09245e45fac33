"""The likelihood of the force through a tyre on a random road, and the likeliest wheel, tyre and road.

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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import Law
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.answer.stored_fit import KnownModel
from opid.suspensions.study import Run
from opid.suspensions.wheel.result import REFERENCE_CYCLES_PER_M, WheelSettings

# The first entries of the vector of unknowns; the logarithms of the roughness of each run follow.
MASS, STIFFNESS, DAMPING, SLOPE, FOOTPRINT, FIRST_ROAD = range(6)


# ---- one run ---------------------------------------------------------------------------------------


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
        wheel: (n,) acceleration of the wheel, m/s^2.
        body: (n,) acceleration of the sprung mass, m/s^2.
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
    wheel: FloatArray
    body: FloatArray
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


def cut_into_blocks(known: KnownModel, run: Run, speed: FloatArray, settings: WheelSettings) -> Blocks:
    """Return a run in blocks.

    Args:
        known: the model of the run, with the vector of the fit.
        run: the run.
        speed: (n_samples,) its speed, m/s.
        settings: tuned numbers.

    Raises:
        InputError: the run is shorter than two blocks.
    """
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
        return transform_blocks(cut(samples, window), window, fs)[:, kept]

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
        wheel=wheel,
        body=body,
        stiffness=suspension.stiffness + np.broadcast_to(by_travel, n),
        damping=suspension.damping + np.broadcast_to(by_velocity, n),
        has_memory=suspension.law.has_memory,
        has_ground=suspension.ground_stiffness != 0.0,
    )


def cut(samples: FloatArray, window: FloatArray) -> FloatArray:
    """Return blocks of samples that overlap by half, (n_blocks, n_block)."""
    every = np.lib.stride_tricks.sliding_window_view(samples, window.size)
    return np.asarray(every[:: window.size // 2])


def transform_blocks(blocks: FloatArray, window: FloatArray, fs: float) -> ComplexArray:
    """Return the lines of blocks under a window; the mean square of each is a one-sided spectral density.

    Args:
        blocks: (n_blocks, n_block) samples.
        window: (n_block,) window.
        fs: sampling rate, Hz.
    """
    return np.asarray(np.fft.rfft(window * blocks) * np.sqrt(2 / (fs * np.sum(window**2))))


# ---- likelihood ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of one run at a vector of unknowns.

    Args:
        error: (n_blocks, n_lines) rate of the force of the road through the tyre.
        ratio: (n_blocks, n_lines) its squared magnitude over the expectation.
        log_density: (n_blocks, n_lines) logarithm of the expectation.
        response: (n_lines,) or (n_blocks, n_lines) mean response R of the acceleration of the wheel to a force, per
            unit of mass.
        score: (n_unknowns, n_blocks, n_lines) derivative of minus the logarithm of the likelihood of each line.
        slopes: (n_unknowns, n_blocks, n_lines) derivative of the logarithm of the spectrum of the wheel, whose squares
            sum to the Fisher information.
    """

    error: ComplexArray
    ratio: FloatArray
    log_density: FloatArray
    response: ComplexArray
    score: FloatArray
    slopes: FloatArray


@dataclass(frozen=True, eq=False)
class WheelProblem:
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
        """Number of entries of the vector."""
        return FIRST_ROAD + len(self.gears) + bool(self.columns)

    @cached_property
    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Expected vector and the inverse variances of its entries, 0 where nothing is known."""
        mean, inverse = np.zeros(self.n_unknowns), np.zeros(self.n_unknowns)
        known = self.settings
        mean[SLOPE], inverse[SLOPE] = known.slope, known.slope_std**-2
        mean[FOOTPRINT], inverse[FOOTPRINT] = known.footprint_m, known.footprint_std_m**-2
        return mean, inverse

    def evaluate(self, vector: FloatArray, struts: Sequence[ComplexArray]) -> tuple[Lines, ...]:
        """Return the lines of each run.

        Args:
            vector: the unknowns.
            struts: (n_lines,) force of the strut on the wheel over the acceleration of the wheel, for each run.
        """
        return tuple(
            evaluate_lines(gear, vector, FIRST_ROAD + k, strut, self.columns[k] if self.columns else None)
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
    m1, c1 = np.exp(vector[MASS]), vector[DAMPING]
    change = 0.0 if column is None else vector[-1] * column[:, np.newaxis]
    k1 = np.exp(vector[STIFFNESS] + change)
    omega = gear.omega
    jerk, acceleration, velocity, carried = gear.terms
    error = m1 * jerk + c1 * acceleration + k1 * velocity + carried
    by = (m1 * jerk, k1 * velocity, acceleration)
    dynamic = (m1 + 0j, -k1 / omega**2, 1 / (1j * omega))
    response = 1.0 / (m1 - k1 / omega**2 + c1 / (1j * omega) + strut)
    tyre = k1**2 + (c1 * omega) ** 2
    log_road, by_slope, by_footprint = _average_road(gear, vector[SLOPE], vector[FOOTPRINT])
    log_density = np.log(omega**2 * tyre) + vector[road] + log_road
    ratio = np.abs(error) ** 2 * np.exp(-log_density)

    shape = (vector.size, *ratio.shape)
    of_density = np.zeros(shape)
    of_density[STIFFNESS] = 2 * k1**2 / tyre
    of_density[DAMPING] = 2 * c1 * omega**2 / tyre
    of_density[SLOPE], of_density[FOOTPRINT], of_density[road] = by_slope, by_footprint, 1.0
    score = of_density * (1.0 - ratio)
    slopes = of_density
    for k, (each, change) in enumerate(zip(by, dynamic, strict=True)):
        by_map = 2 * np.real(response * change)
        score[k] += 2 * np.real(error.conj() * each) * np.exp(-log_density) - by_map
        slopes[k] -= by_map
    if column is not None:
        score[-1], slopes[-1] = (each[STIFFNESS] * column[:, np.newaxis] for each in (score, slopes))
    return Lines(error, ratio, log_density, response, score, slopes)


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


def straighten_strut(gear: Blocks) -> ComplexArray:
    """Return force of the strut over acceleration of the wheel, with the mean slopes of its law."""
    spring = gear.stiffness.mean() + 1j * gear.omega * gear.damping.mean()
    return np.asarray(gear.mass * spring / (spring - gear.omega**2 * gear.mass))


def average_strut(gear: Blocks, vector: FloatArray, settings: WheelSettings, seed: int) -> ComplexArray:
    """Return the same by the mean response of the gear to small random forces along its measured motion.

    The state (x1, x1', z, z') follows the tangent of the law from sample to sample; the force goes linearly between
    them. R is the mean over blocks and probes, in those blocks in which a line is compared.
    """
    m1, k1, c1 = np.exp(vector[MASS]), np.exp(vector[STIFFNESS]), vector[DAMPING]
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
    fade = gear.speed_of_samples ** (0.5 * (vector[SLOPE] - 1.0))
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
    return np.where(is_seen, 1.0 / response - dynamic, straighten_strut(gear))


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
class WheelFit:
    """The likeliest vector with its covariance.

    Args:
        problem: the likelihood.
        vector: the unknowns.
        covariance: covariance of the vector.
        lines: lines of each run.
        struts: force of the strut over acceleration of the wheel.
    """

    problem: WheelProblem
    vector: FloatArray
    covariance: FloatArray
    lines: tuple[Lines, ...]
    struts: tuple[ComplexArray, ...]


def fit_wheel(problem: WheelProblem, seed: int) -> WheelFit:
    """Return the likeliest vector: the mean response of the strut and the vector are computed in turn."""
    known = problem.settings
    struts = tuple(map(straighten_strut, problem.gears))
    vector = _search_start(problem, struts)
    for _ in range(known.most_rounds):
        before = vector
        vector, lines = _climb(problem, vector, struts)
        std = np.sqrt(np.diag(np.linalg.inv(problem.fisher(lines))))
        if (np.abs(vector - before) < known.settled_std * std).all():
            break
        struts = tuple(average_strut(gear, vector, known, seed + number) for number, gear in enumerate(problem.gears))
    else:
        raise NotDeterminedError("the response of the strut and the parameters of the tyre do not settle")
    covariance = find_covariance(problem, vector, lines, struts)
    return WheelFit(problem, vector, covariance, lines, struts)


def _search_start(problem: WheelProblem, struts: Sequence[ComplexArray]) -> FloatArray:
    """Return the likeliest of a few vectors, each with the roughness that fits it."""
    known, found = problem.settings, []
    for mass in known.start_masses:
        for tyre_hz in known.start_tyre_hz:
            vector = np.zeros(problem.n_unknowns)
            vector[MASS], vector[STIFFNESS] = np.log(mass), 2 * np.log(2 * np.pi * tyre_hz)
            vector[SLOPE], vector[FOOTPRINT] = known.slope, known.footprint_m
            for k, (gear, each) in enumerate(zip(problem.gears, problem.evaluate(vector, struts), strict=True)):
                vector[FIRST_ROAD + k] = np.log(np.mean(each.ratio[gear.is_used]))
            found.append((problem.cost(problem.evaluate(vector, struts), vector), vector))
    return min(found, key=lambda each: each[0])[1]


def _climb(
    problem: WheelProblem, vector: FloatArray, struts: Sequence[ComplexArray]
) -> tuple[FloatArray, tuple[Lines, ...]]:
    """Return the vector of least cost for given struts, by Fisher scoring, and its lines."""
    lines = problem.evaluate(vector, struts)
    cost = problem.cost(lines, vector)
    for _ in range(problem.settings.most_steps):
        gradient, fisher = problem.gradient(lines, vector), problem.fisher(lines)
        step = -np.linalg.solve(fisher, gradient)
        step *= min(1.0, problem.settings.largest_step / max(np.abs(step[[MASS, STIFFNESS]]).max(), 1e-12))
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


def find_covariance(
    problem: WheelProblem, vector: FloatArray, lines: Sequence[Lines], struts: Sequence[ComplexArray]
) -> FloatArray:
    """Return the covariance of the vector, never less than what the scores of the blocks show.

    The curvature of the likelihood gives that of a Gaussian road. A road that is rough here and smooth there makes the
    scores of blocks vary more; each standard deviation then is that of the sandwich formula (Huber 1967; White,
    Econometrica 50 (1982) 1), corrected for the few blocks of short runs.

    Raises:
        NotDeterminedError: the likelihood has no curvature in some direction.
    """
    inverse = np.linalg.inv(find_curvature(problem, vector, struts))
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


def find_curvature(problem: WheelProblem, vector: FloatArray, struts: Sequence[ComplexArray]) -> FloatArray:
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
