"""Test for memory: the part of a force that no function of travel and velocity explains, and the past.

The fraction that a law without memory explains is compared with that of the law that was found. The residual of a law
is predicted on stretches of time that were left out. This is done first by the mean of its nearest neighbours in the
plane of travel and velocity, which stands for any smooth static function, then by signals of the past, with two
methods: the part of the force that travel and velocity do not predict is regressed on the part of the signals that they
do not predict (Robinson, Econometrica 56, 1988, partially linear regression), and one signal is used as a third axis of
the plane. The signals are
  hysteresis   stop operators z - P_r[z], P_r the play (backlash) of half-width r: the elements of Prandtl, Ishlinskii,
               Jenkins and Iwan, whose sums approximate every rate-independent hysteresis, also that of Bouc-Wen;
  relaxation   the velocity behind first-order lags, the elements of Maxwell, and of a lag between two channels;
  inertia      the acceleration: moving parts between the specimen and the force cell. A mass is the same in slow and in
               quick motion; another dependence on the acceleration is called vibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from opid.mechanics.laws.law import Law
from opid.signals.recording import FloatArray
from opid.suspensions.bench.problem import Points
from opid.suspensions.bench.record import Bench, rate_of
from opid.suspensions.bench.settings import BenchSettings, MemorySettings
from opid.suspensions.fitting.least_squares import independent_samples

Past = Literal["hysteresis", "relaxation", "inertia"]
Cause = Literal["hysteresis", "relaxation", "inertia", "vibration"]


@dataclass(frozen=True)
class Memory:
    """How much of a force a law of travel and velocity can explain, and how much the past explains.

    All fractions are of the variance of the force, on stretches of time that were left out.

    Args:
        r2_at_most: fraction that the best law without memory with any smooth static correction explains.
        r2_with_law: fraction that the law that was found, with its memory and any smooth static correction, explains:
            `r2_at_most` if it has no memory.
        r2_with_past: fraction that is explained if the past is known, too.
        r2_with_time: fraction that is explained if stiffness and damping change with time instead; `r2_with_law` where
            chance or the past explains as much.
        cause: the kind of past that explains most of the residual of the law that was found; None if the past is not
            significant there.
        moving_mass_kg: coefficient of the acceleration if the cause is inertia; otherwise None.
        by_pace_kg: coefficients of parts of the acceleration from slow to quick if it explains most; otherwise empty.
        testable: whether the motion distinguishes memory and law at all.
        foretold: median fraction of the stop operators that travel and velocity predict.
        statement: the same in words.
    """

    r2_at_most: float
    r2_with_law: float
    r2_with_past: float
    r2_with_time: float
    cause: Cause | None
    moving_mass_kg: float | None
    by_pace_kg: tuple[float, ...]
    testable: bool
    foretold: float
    statement: str

    @property
    def seen(self) -> bool:
        """Whether the past is significant in the residual of the law."""
        return self.cause is not None


def measure_memory(
    bench: Bench,
    points: Points,
    rest: FloatArray,
    *,
    static_rest: FloatArray,
    law: Law,
    is_noise: bool,
    settings: BenchSettings,
) -> Memory:
    """Measure how much of the residual of a law is static, and how much of it depends on the past.

    `rest` is (m,) force minus the best `law`, N, each point predicted by a fit without its stretches; `static_rest` is
    the same for the best law without memory; `is_noise` says that the law itself explains almost nothing.
    """
    known, sample, fold = settings.memory, points.sample, points.fold
    plane = np.stack([each / max(float(each.std()), 1e-300) for each in (bench.travel, bench.velocity)], axis=1)[sample]
    signals_of = past_signals(bench, settings)
    # A test without a time scale has only hysteresis.
    causes: tuple[Past, ...] = ("hysteresis",) if bench.is_quasi_static else tuple(signals_of)
    groups = {cause: signals_of[cause][sample] for cause in causes}
    neighbours = [_find_neighbours(plane, fold, count) for count in known.neighbours]
    statics = _correct(rest, neighbours)
    few = neighbours[0]
    news = {cause: signals - signals[few].mean(axis=1) for cause, signals in groups.items()}
    predictable = 1 - news["hysteresis"].var(axis=0) / np.maximum(groups["hysteresis"].var(axis=0), 1e-300)
    foretold = float(np.median(predictable))
    knowing: list[tuple[FloatArray, Past]] = [
        (_regress(signals, static, fold, known.ridge), cause) for cause, signals in news.items() for static in statics
    ]
    for cause, signals in groups.items():
        for column in signals.T / np.maximum(signals.std(axis=0), 1e-300)[:, np.newaxis]:
            beside = _find_neighbours(np.column_stack([plane, column]), fold, known.neighbours_with_past)
            knowing.append((rest - rest[beside].mean(axis=1), cause))
    left, best = min(knowing, key=lambda pair: float(pair[0] @ pair[0]))
    total = points.y.size * points.force_rms**2
    static = _choose_least(statics)
    testable = foretold < known.foretold
    seen: Cause | None = best if testable and _is_seen(static, left, total, known) else None
    r2_law = 1 - float(static @ static) / total
    r2_past = 1 - float(left @ left) / total if seen else r2_law
    without = _choose_least(_correct(static_rest, neighbours))
    r2_static = 1 - float(without @ without) / total
    by_law = points.motion.parameter_gradient(law)
    mass, by_pace = None, tuple[float, ...]()
    if seen == "inertia":
        others = np.column_stack([plane, by_law])
        mass = _fit_moving_mass(groups["inertia"], others, rest)
        by_pace = _fit_masses_by_pace(bench, points, others, rest, settings)
        if max(by_pace) - min(by_pace) > known.mass_agreement * abs(mass):
            seen, mass = "vibration", None
    remembering = "+".join(term.name for term in law.terms if term.kind.memory is not None)
    r2_time = r2_law
    if seen is None:
        changed = _follow_time(bench, points, static, known)
        if _is_seen(static, changed, total, replace(known, fraction_of_rest=known.changed_of_rest)):
            r2_time = 1 - float(changed @ changed) / total
    measured = Memory(r2_static, r2_law, r2_past, r2_time, seen, mass, by_pace, testable, foretold, "")
    return replace(measured, statement=_write_statement(measured, remembering, is_noise))


def past_signals(bench: Bench, settings: BenchSettings) -> dict[Past, FloatArray]:
    """Return the signals of the past by their kind, each (n, n_signals)."""
    from scipy import signal

    z, v = bench.travel, bench.velocity
    low, high = np.quantile(z, (0.005, 0.995))
    stops = z[:, np.newaxis] - play(z, np.array(settings.memory.plays) * (high - low) / 2)
    turn_s = float(z.std() / max(float(v.std()), 1e-300))  # a motion that never turns has one velocity
    lagged = []
    for lag in settings.memory.lags:
        pole = np.exp(-1 / (lag * turn_s * bench.fs))
        lagged.append(signal.lfilter([1 - pole], [1, -pole], v, zi=[pole * v[0]])[0])
    acceleration, _ = rate_of(v, fs=bench.fs, settings=settings.record)
    return {"hysteresis": stops, "relaxation": np.stack(lagged, axis=1), "inertia": acceleration[:, np.newaxis]}


def play(z: FloatArray, half_widths: FloatArray) -> FloatArray:
    """Return the play operators P_n = min(z_n + r, max(z_n - r, P_(n-1))) of a signal, begun at its first value.

    Args:
        z: (n,) the signal.
        half_widths: (n_plays,) r, in the unit of the signal.

    Returns:
        (n, n_plays).

    >>> play(np.array([0.0, 1.0, 3.0, 2.0, -1.0]), np.array([1.0])).ravel().tolist()
    [0.0, 0.0, 2.0, 2.0, 0.0]
    """
    lowest, highest = z[:, np.newaxis] - half_widths, z[:, np.newaxis] + half_widths
    played = np.empty_like(lowest)
    state = np.full(half_widths.size, z[0])
    for step in range(z.size):
        state = played[step] = np.minimum(highest[step], np.maximum(lowest[step], state))
    return played


def _correct(rest: FloatArray, neighbours: Sequence[np.ndarray]) -> list[FloatArray]:
    """Return the residual of a law, and the residual minus the mean of its neighbours for each number of them."""
    return [rest, *(rest - rest[each].mean(axis=1) for each in neighbours)]


def _choose_least(rests: Sequence[FloatArray]) -> FloatArray:
    return min(rests, key=lambda each: float(each @ each))


def _find_neighbours(plane: FloatArray, fold: np.ndarray, count: int) -> np.ndarray:
    """Return the indices (m, count) of the nearest points of the plane that lie in other stretches of time."""
    from scipy.spatial import cKDTree

    found = np.empty((fold.size, count), dtype=np.int64)
    for each in np.unique(fold):
        inside, outside = np.flatnonzero(fold == each), np.flatnonzero(fold != each)
        _, nearest = cKDTree(plane[outside]).query(plane[inside], k=count)
        found[inside] = outside[nearest]
    return found


def _regress(signals: FloatArray, y: FloatArray, fold: np.ndarray, ridge: float) -> FloatArray:
    """Return the residual of a ridge regression of `y`; each stretch is predicted from the others."""
    scaled = signals / np.maximum(signals.std(axis=0), 1e-300)
    left = np.empty_like(y)
    for each in np.unique(fold):
        here = fold == each
        x = scaled[~here]
        gram = x.T @ x + ridge * x.shape[0] * np.eye(x.shape[1])
        left[here] = y[here] - scaled[here] @ np.linalg.solve(gram, x.T @ y[~here])
    return left


def _follow_time(bench: Bench, points: Points, static: FloatArray, known: MemorySettings) -> FloatArray:
    """Return the residual beside stiffness and damping that change with time, as large as with unspent columns."""
    phase = np.pi * (points.sample - points.sample[0]) / max(1, points.sample[-1] - points.sample[0])
    shapes = np.cos(phase[:, np.newaxis] * np.arange(1, known.n_changes + 1))
    motion = np.stack([bench.travel - bench.travel.mean(), bench.velocity], axis=1)[points.sample]
    columns = (motion[:, :, np.newaxis] * shapes[:, np.newaxis]).reshape(static.size, -1)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left = static - columns @ np.linalg.lstsq(columns, static, rcond=1e-9)[0]
    worth = independent_samples(static)
    return np.asarray(left * np.sqrt(worth / max(worth - columns.shape[1], 1.0)))


def _is_seen(static: FloatArray, left: FloatArray, total: float, known: MemorySettings) -> bool:
    """Whether the past explains more than chance and errors of the static function can."""
    before, after = float(static @ static), float(left @ left)
    if before - after <= max(known.fraction_of_rest * before, known.fraction_of_force * total):
        return False
    return independent_samples(left) * np.log(before / max(after, 1e-300)) > known.evidence


def _fit_moving_mass(acceleration: FloatArray, others: FloatArray, rest: FloatArray) -> float:
    """Return the coefficient of the acceleration beside stiffness, damping, offset and changes of the law, kg."""
    basis = np.column_stack([acceleration, others, np.ones(rest.size)])
    scale = np.maximum(np.sqrt(np.mean(basis**2, axis=0)), 1e-300)
    return float(np.linalg.lstsq(basis / scale, rest, rcond=None)[0][0] / scale[0])


def _fit_masses_by_pace(
    bench: Bench, points: Points, others: FloatArray, rest: FloatArray, settings: BenchSettings
) -> tuple[float, ...]:
    """Return the coefficients of parts of the acceleration that have equal power, from slow to quick, kg."""
    from scipy import fft

    acceleration, _ = rate_of(bench.velocity, fs=bench.fs, settings=settings.record)
    spectrum = fft.rfft(acceleration)
    power = np.cumsum(np.abs(spectrum) ** 2)
    n_parts = settings.memory.n_paces
    owner = np.minimum((n_parts * power / power[-1]).astype(np.int64), n_parts - 1)
    parts = [fft.irfft(np.where(owner == k, spectrum, 0.0), acceleration.size)[points.sample] for k in range(n_parts)]
    columns = np.column_stack(parts)
    return tuple(
        _fit_moving_mass(columns[:, k : k + 1], np.column_stack([np.delete(columns, k, axis=1), others]), rest)
        for k in range(n_parts)
    )


def _write_statement(memory: Memory, remembering: str, is_noise: bool) -> str:
    """Return what was measured in words."""
    if not memory.testable:
        return (
            "the motion repeats one cycle, on which memory (hysteresis, backlash) and a law of travel and velocity "
            "cannot be distinguished: record several amplitudes or a random motion"
        )
    of_laws = f"a law of travel and velocity explains at most {_format_percent(memory.r2_at_most)} of this force"
    if remembering:
        of_laws += f", with the memory of {remembering} {_format_percent(memory.r2_with_law)}"
    if memory.cause is not None:
        what = {
            "hysteresis": "remembers the past (hysteresis or backlash)",
            "relaxation": "lags behind the motion (relaxation, or a delay between the channels)",
            "inertia": (
                f"follows the acceleration (moving parts of {memory.moving_mass_kg or 0.0:.3g} kg between specimen and "
                "force cell)"
            ),
            "vibration": (
                "follows the acceleration, but not as a mass does "
                f"({' kg, '.join(f'{mass:.3g}' for mass in memory.by_pace_kg)} kg from slow to quick motion: the bench "
                "or the specimen vibrates)"
            ),
        }[memory.cause]
        return (
            f"{of_laws}; {_format_percent(memory.r2_with_past - memory.r2_with_law)} {what}, which no law that was "
            f"tried explains; {_format_percent(1 - memory.r2_with_past)} is neither (noise, or a cause that was not "
            "recorded)"
        )
    if is_noise:
        return f"{of_laws}; the past does not explain the remainder either"
    if remembering:
        return f"{of_laws}; no other memory is seen"
    return f"no memory is seen: {of_laws}, and the past explains none of the remainder"


def _format_percent(fraction: float) -> str:
    """Return a fraction in per cent, with more digits near 0 and near 100 %.

    >>> _format_percent(0.93), _format_percent(0.99973), _format_percent(0.0002), _format_percent(1.0)
    ('93 %', '99.97 %', '0.02 %', '100 %')
    """
    percent = 100 * max(0.0, fraction)
    edge = min(percent, 100 - percent)
    decimals = 0 if edge >= 10 or edge < 1e-9 else 1 if edge >= 1 else min(6, -int(np.floor(np.log10(edge))))
    return f"{percent:.{decimals}f} %".replace(".0 %", " %")
