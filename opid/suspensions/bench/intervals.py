"""Intervals of a bench law: of its parameters, or why they have none, and of the energy that it takes in a cycle.

The energy of a cycle is known better than the parameters that it follows from.

The intervals hold the noise and the calibration (`calibration`). Parts of a law that the record does not separate
have none: a column of gas, an arctangent or an arm has a stiffness of its own, as the spring beside it has, and if the
motion shows only their sum, a fit may make one huge and the other cancel it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from opid.estimate import Estimate, format_number
from opid.mechanics.laws.law import LAWS, FloatArray, Law, Term, default_law
from opid.mechanics.memory import Loop, gradient_along, sine_like, taken_per_cycle
from opid.mechanics.weight import depends_on_travel
from opid.signals.health.channel import find_quantisation_step
from opid.signals.health.inspection import inspect
from opid.signals.recording import recording_from_arrays
from opid.suspensions.answer.numbers import amounts_of_gas, as_gas_column, index_of_gas
from opid.suspensions.bench.calibration import CalibrationError, find_calibration
from opid.suspensions.bench.problem import all_points, residual_worth
from opid.suspensions.bench.record import Bench, rate_of
from opid.suspensions.bench.settings import BenchSettings, RecordSettings
from opid.suspensions.bench.simulation import SimulatedFit
from opid.suspensions.fitting.least_squares import SeparableFit, clustered_covariance, independent_samples
from opid.suspensions.result import GasColumn


@dataclass(frozen=True, eq=False)
class Spread:
    """The covariance of the parameters.

    Args:
        covariance: covariance of stiffness, damping, offset, mass if parts move, the values of the law, and the initial
            values of memories; NaN if no parameter has an interval.
        student: half width of a 95 % interval over the standard deviation.
        cell_s: length of the cells over which scores were added up, s.
        reasons: why no parameter has an interval, one sentence each.
        calibration: what is known of gains, lag and mass, whose part the covariance holds.
        imitated_lag_s: the lag of the force with which a law that does not lag explains as much; 0 if none does.
    """

    covariance: FloatArray
    student: float
    cell_s: float
    reasons: tuple[str, ...]
    calibration: tuple[CalibrationError, ...] = ()
    imitated_lag_s: float = 0.0


def find_spread(
    bench: Bench,
    fit: SeparableFit,
    refined: SimulatedFit | None,
    settings: BenchSettings,
    *,
    without_lag: SeparableFit | None = None,
) -> Spread:
    """Return the covariance from scores added up over cells longer than the correlation.

    Args:
        bench: the record.
        fit: the law that was fitted to it.
        refined: the same law by simulation, whose intervals count; None where there is none.
        settings: the tuned numbers.
        without_lag: where a term of the law lags behind the motion, the fit of the best law without such a term: if it
            explains the force as well once the force is shifted, the shift is believed possible.
    """
    from scipy import special

    known: list[tuple[int, float]] = []
    if refined is None:
        slopes, residual = all_points(bench).slopes(fit.law), fit.residual
        listed = enumerate(fit.law.parameter_list, start=fit.weights.size)
        known = [(index, parameter.known[1]) for index, parameter in listed if parameter.known]
    else:
        slopes, residual = refined.slopes, refined.residual
    n, n_values = slopes.shape
    n_independent = independent_samples(residual)
    least, most = settings.cells
    length = int(np.clip(settings.cells_per_correlation * n / n_independent, n / most, n / least))
    cells = np.arange(n) // length
    # With few cells the interval is Student's instead of the normal one.
    student = float(special.stdtrit(max(int(cells[-1]) + 1 - n_values, 1), 0.975))
    columns, worth = slopes, residual_worth(residual, n_independent)
    for index, std in known:
        # Prior knowledge counts as one more cell.
        columns = np.vstack([columns, worth / std * np.eye(1, n_values, index)])
        residual, cells = np.append(residual, worth), np.append(cells, cells[-1] + 1)
    covariance = clustered_covariance(columns, residual, cells)
    reasons = [
        *_explain_driving(bench, settings),
        *_explain_steps(bench, settings),
        *_explain_faults(bench, settings),
    ]
    if n_independent <= 2 * n_values:
        reasons.append(
            f"the residual of the law changes so slowly that it has only {n_independent:.0f} independent samples: no "
            "parameter has an interval; record longer, or a motion that turns more often"
        )
    if refined is None:
        reasons += [
            *_explain_no_memory(bench, fit, covariance, settings),
            *_explain_no_mass(bench, fit, slopes, covariance),
        ]
    data = columns, residual, cells
    calibration = find_calibration(bench, fit, refined, data, settings, without_lag=without_lag)
    errors = calibration.errors
    if reasons:
        covariance = np.full_like(covariance, np.nan)
        errors = tuple(replace(each, found=each.found.without_interval()) for each in errors)
    else:
        covariance = covariance + calibration.covariance
    return Spread(covariance, student, length / bench.fs, tuple(reasons), errors, calibration.imitated_lag_s)


def fades_linearly(term: Term) -> bool:
    """Return whether the initial value of a memory fades in proportion to itself, as with Dahl, LuGre and Maxwell."""
    kind = term.kind
    if kind.memory is None or np.isfinite(kind.limit):
        return False
    inner = (*term.inner, 0.0, 0.0, 0.0)[:3]
    slopes = [kind.memory(h, 1.0, *inner, kind.elements[0])[1] for h in (-0.8, -0.2, 0.2, 0.8)]
    return bool(np.allclose(slopes, slopes[0]))


def _explain_driving(bench: Bench, settings: BenchSettings) -> Iterator[str]:
    """Yield why no parameter has an interval where the force drives the motion: a sign is reversed."""
    if bench.is_quasi_static:
        return
    force, velocity = bench.force[bench.samples], bench.velocity[bench.samples]
    power = float(np.mean((force - force.mean()) * velocity))
    if power < -settings.record.driving_correlation * force.std() * velocity.std():
        yield (
            f"the force feeds energy into the motion on average ({power:.3g} W), as no passive part does: no parameter "
            "has an interval; reverse the sign of force or travel"
        )


def _explain_steps(bench: Bench, settings: BenchSettings) -> Iterator[str]:
    """Yield why no parameter has an interval where a channel has few distinct values."""
    for role, values in (("force", bench.force), ("travel", bench.travel)):
        used = values[bench.samples]
        levels = np.unique(used)
        step = find_quantisation_step(levels) or 0.0
        if step**2 / 12 > settings.record.coarsest * float(np.var(used)):
            yield (
                f"the {role} has only {levels.size} distinct values, in steps of {step:.2g} "
                f"{'N' if role == 'force' else 'm'}: no parameter has an interval; record it with more bits or a "
                "smaller range"
            )


def _explain_faults(bench: Bench, settings: BenchSettings) -> Iterator[str]:
    """Yield why no parameter has an interval where a channel is clipped or the travel jumps."""
    if bench.is_quasi_static:
        return
    roles = {"force": bench.force, "travel": bench.travel}
    record = recording_from_arrays([*roles.values()], [*roles], fs=bench.fs, unit=["N", "m"])
    for channel in inspect(record, thorough=False).channels:
        if channel.clipped_fraction > 0:
            yield (
                f"{100 * channel.clipped_fraction:.2g} % of the samples of the {channel.name} are clipped: no "
                "parameter has an interval; record it with a larger range, or a smaller motion"
            )
    n_jumps = _count_jumps(bench.travel, settings.record)
    if n_jumps:
        yield (
            f"the travel jumps {n_jumps} times from one sample to the next, as no mass moves: no parameter has an "
            "interval; leave out spikes and samples that were lost, or record at a higher rate"
        )


def _count_jumps(travel: FloatArray, known: RecordSettings) -> int:
    """Return how often a travel jumps."""
    from scipy.ndimage import median_filter

    steps = np.abs(np.diff(travel))
    usual = median_filter(steps, 2 * known.jump_reach + 1)
    return int(np.sum(steps > np.maximum(known.jump_of_range * np.ptp(travel), known.jump_of_usual * usual)))


def _explain_no_memory(
    bench: Bench, fit: SeparableFit, covariance: FloatArray, settings: BenchSettings
) -> Iterator[str]:
    """Yield the first reason why a memory has no interval."""
    for term in fit.law.terms:
        if len(term.kind.elements) > 1 and term.inner[0] > settings.slips * np.ptp(bench.travel):
            yield (
                f"the last slider of {term.name} hardly slips in this motion, and is a spring as K until it does: no "
                "parameter has an interval; record larger strokes"
            )
            return
    remembers = [term for term in fit.law.terms if term.kind.memory is not None]
    deviations = np.sqrt(np.maximum(np.diag(covariance)[covariance.shape[0] - len(remembers) :], 0.0))
    for term, weight, std in zip(remembers, fit.start_weights, deviations, strict=True):
        if not fades_linearly(term) and np.all(bench.samples[:1] == 0) and abs(weight) > 3 * std:
            yield (
                f"the unknown initial force of {term.name} affects more than half of the record: no parameter has an "
                "interval; record longer, or from rest"
            )
            return


def _explain_no_mass(bench: Bench, fit: SeparableFit, slopes: FloatArray, covariance: FloatArray) -> Iterator[str]:
    """Yield why a mass has no interval: noise of the acceleration biases it by more than its standard deviation.

    Noise of variance n in a regressor of variance s makes its coefficient smaller by the fraction n / (s + n).
    """
    if bench.acceleration is None:
        return
    mass, acceleration = float(fit.weights[3]), slopes[:, 3]
    others = np.delete(slopes, 3, axis=1)
    others = others / np.maximum(np.sqrt(np.mean(others**2, axis=0)), 1e-300)
    own = acceleration - others @ np.linalg.lstsq(others, acceleration, rcond=1e-12)[0]
    noise = float(fit.residual @ fit.residual) / max(mass**2 * float(own @ own), 1e-300)
    if noise * abs(mass) > np.sqrt(max(float(covariance[3, 3]), 0.0)):
        yield (
            "the moving mass is estimated from a differentiated motion, whose noise biases it and the other "
            "parameters, and the simulation from the force explains less: no parameter has an interval; record the "
            "travel with less noise, or a stronger motion"
        )


INSTEAD = "use the energy that the whole force takes in a cycle"
"""What is determined where the parts are not."""


@dataclass(frozen=True)
class Inseparable:
    """What the record does not separate.

    Args:
        of_travel: whether stiffness, offset, mass and the terms that depend on the travel have no interval.
        of_velocity: whether the damping and the terms that depend on the velocity have none.
        of_cycle: whether the energy of a cycle has none.
        reasons: why, one sentence each.
    """

    of_travel: bool = False
    of_velocity: bool = False
    of_cycle: bool = False
    reasons: tuple[str, ...] = ()

    def holds(self, term: Term) -> bool:
        """Return whether a term has no interval."""
        return (self.of_travel and not is_of_velocity(term)) or (self.of_velocity and not is_of_travel(term.name))


def find_inseparable(
    bench: Bench, stiffness: float, damping: float, law: Law, *, memory_is_testable: bool, settings: BenchSettings
) -> Inseparable:
    """Return what the record does not separate: parts that cancel, and a memory that may be none.

    Args:
        bench: the record.
        stiffness: that beside the law, N/m.
        damping: that beside the law, N s/m.
        law: the law that was fitted.
        memory_is_testable: whether the motion distinguishes memory from a law of travel and velocity.
        settings: how far parts may cancel.
    """
    remembering = [term.name for term in law.terms if term.kind.memory is not None]
    is_untestable, is_sine = bool(remembering) and not memory_is_testable, _is_sine(bench, settings)
    reasons, sizes, cancelling = list[str](), list[str](), dict[str, Term]()
    if is_untestable:
        instead = INSTEAD if is_sine else "neither has the energy of a cycle, which would be that of a sine"
        reasons.append(
            f"the memory of {' and '.join(remembering)} may stand for a law without memory: no parameter has an "
            f"interval; {instead}"
        )
    samples, symbols = bench.samples, list[str]()
    straight = {"K": (stiffness * bench.travel)[samples], "C": (damping * bench.velocity)[samples]}
    forces = {term: bench.motion.force(Law((term,), law.rest_m))[samples] for term in law.terms}
    whole = float(np.std(straight["K"] + straight["C"] + sum(forces.values())))
    for symbol, part in straight.items():
        times = float(np.std(part)) / max(whole, 1e-300)
        if times <= settings.most_cancelled:
            continue
        against = [term for term, force in forces.items() if _contained(force, part) < -1.0 / settings.most_cancelled]
        if against:
            symbols.append(symbol)
            sizes.append(format_number(times, 2))
            cancelling |= {term.name: term for term in against}
    if cancelling:
        reasons.append(
            f"{' and '.join(symbols)} alone would make {' and '.join(sizes)} times the force of the whole law, which "
            f"{' and '.join(cancelling)} cancel{'s' * (len(cancelling) == 1)}: the motion shows their sum and not the "
            f"parts, which have no interval; {INSTEAD}, or record larger strokes"
        )
    return Inseparable(
        is_untestable or any(not is_of_velocity(term) for term in cancelling.values()),
        is_untestable or any(not is_of_travel(name) for name in cancelling),
        is_untestable and not is_sine,
        tuple(reasons),
    )


def _is_sine(bench: Bench, settings: BenchSettings) -> bool:
    """Return whether a motion has one frequency."""
    if bench.is_quasi_static:
        return True  # its energy does not depend on the shape of the cycle
    acceleration, _ = rate_of(bench.velocity, fs=bench.fs, settings=settings.record)
    travel, velocity, rate = (each[bench.samples].std() for each in (bench.travel, bench.velocity, acceleration))
    return bool(travel * rate < settings.widest_sine * velocity**2)


def _contained(force: FloatArray, onto: FloatArray) -> float:
    """Return the multiple of a part that a force contains on average."""
    centred = onto - onto.mean()
    return float(force @ centred / (centred @ centred))


def is_of_travel(kind: str) -> bool:
    """Return whether the force of a kind depends on present and past travel, and not on the velocity."""
    if LAWS[kind].memory is not None:
        return all(parameter.unit in ("N", "m", "1") for parameter in LAWS[kind].parameters)
    _, by_velocity = default_law(kind).gradient(np.linspace(-0.01, 0.01, 21), np.linspace(-0.3, 0.3, 21))
    return not np.any(by_velocity)


def is_of_velocity(term: Term) -> bool:
    """Return whether the force of a term depends on the velocity alone."""
    return term.kind.memory is None and not depends_on_travel(Law((term,)))


def estimate_parameters(fit: SeparableFit, spread: Spread) -> tuple[list[Estimate], dict[str, dict[str, Estimate]]]:
    """Return values and intervals of the linear parameters, and of every parameter of the law."""
    values, wide = np.concatenate([fit.weights, fit.law.vector]), spread.student
    std = np.sqrt(np.clip(np.diag(spread.covariance)[: values.size], 0, None))
    bound = (*(False,) * fit.weights.size, *fit.at_bound)
    estimates = [
        Estimate(float(value))
        if at_bound or not np.isfinite(error)
        else Estimate(float(value), float(error), (float(value - wide * error), float(value + wide * error)))
        for value, error, at_bound in zip(values, std, bound, strict=True)
    ]
    of_law, rest = {}, estimates[fit.weights.size :]
    for term in fit.law.terms:
        own, rest = rest[: len(term.values)], rest[len(term.values) :]
        own[:2] = _scale_long(own[:2]) if has_long_scale(term) else own[:2]
        of_law[term.name] = {p.name: each for p, each in zip(term.kind.parameters, own, strict=True)}
    return estimates[: fit.weights.size], of_law


def has_long_scale(term: Term) -> bool:
    """Return whether the scale of a term is longer than the motion, as a column of gas is."""
    return any(p.role == "scale" and p.over_rms[0] > 1 for p in term.kind.parameters)


def _scale_long(estimates: list[Estimate]) -> list[Estimate]:
    """Return amplitude A and scale h of a force that is a parabola, A z^2 / h^2, unless the motion comes near h.

    The motion shows the parabola and, by 1/h, its skewness: the error of 1/h is nearly normal, that of h is not. The
    intervals are therefore symmetric in 1/h and in A^(-1/2). If the interval of 1/h includes zero, any longer h with a
    larger A fits as well, and neither has an interval.
    """
    found = [_transform_interval(estimate, power) for estimate, power in zip(estimates, (2, 1), strict=True)]
    if any(each.interval95 is None for each in found):
        return [Estimate(each.value) for each in estimates]
    return found


def _transform_interval(estimate: Estimate, power: int) -> Estimate:
    """Return an estimate x whose interval is symmetric in x^(-1/power); without one if that interval includes zero."""
    value, ends = estimate.value, estimate.interval95
    if value is None or ends is None or not (part := (ends[1] - ends[0]) / (2 * power * abs(value))) < 1:
        return Estimate(value)
    low, high = sorted((value / (1 + part) ** power, value / (1 - part) ** power))
    return Estimate(value, estimate.std, (low, high))


def gas_of_bench(
    fit: SeparableFit, of_law: dict[str, dict[str, Estimate]], spread: Spread, piston_area_m2: float | None
) -> GasColumn | None:
    """Return the gas of a strut where its travel is zero; None if there is none, or if it has no intervals.

    With the parabola A/h^2 that the motion shows, A h goes with the third power of h.
    """
    index = index_of_gas(fit.law)
    if index is None:
        return None
    term = fit.law.terms[index]
    force, length = list(of_law[term.name].values())[:2]
    if force.interval95 is None or length.interval95 is None:
        return None
    first = fit.weights.size + sum(len(each.values) for each in fit.law.terms[:index])
    slopes = np.array([term.inner[0], term.amplitude])
    std = float(np.sqrt(slopes @ spread.covariance[first : first + 2, first : first + 2] @ slopes))
    values = amounts_of_gas(term.amplitude, term.inner[0], piston_area_m2)
    ends = [amounts_of_gas(*both, piston_area_m2) for both in zip(force.interval95, length.interval95, strict=True)]
    content, wide, area = float(values[0]), spread.student * std, piston_area_m2 or 1.0
    stds = (std, (force.std or 0.0) / area, (length.std or 0.0) * area)
    amounts = [
        Estimate(float(value), own, (float(low), float(high)))
        for value, own, low, high in zip(values, stds, *ends, strict=True)
    ]
    amounts[0] = _transform_interval(Estimate(content, std, (content - wide, content + wide)), 3)
    return as_gas_column(amounts, piston_area_m2)


def loop_of(law: Law, covariance: FloatArray, bench: Bench, student: float) -> Loop | None:
    """Return the loop of the terms of a law with memory; None without memory.

    `covariance` is that of the law's vector, `student` the half width of a 95 % interval over the standard deviation.
    """
    remembers = np.array([term.kind.memory is not None for term in law.terms for _ in term.values], dtype=bool)
    if not remembers.any():
        return None
    return cycle_of(
        law.remembering, 0.0, np.pad(covariance[np.ix_(remembers, remembers)], (1, 0)), bench, student=student
    )


def cycle_of(law: Law, damping: float, covariance: FloatArray, bench: Bench, *, student: float) -> Loop:
    """Return the loop of a law beside a damping, N s/m, by the covariance of the damping and the vector of the law."""
    z, v, fs = sine_of(bench)
    slopes = taken_per_cycle(np.column_stack([v, gradient_along(law, z, v, fs)]), v, fs)
    # Every term is proportional to its amplitude, so these columns alone add up to the force.
    linear = np.array([True, *(parameter.role == "amplitude" for parameter in law.parameter_list)])
    area = float(slopes[linear] @ np.append(damping, law.vector)[linear])
    std = float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))
    wide = student * std
    estimate = Estimate(area) if np.isnan(std) else Estimate(area, std, (area - wide, area + wide))
    pace = float(bench.velocity.std() / bench.travel.std()) / (2 * np.pi)
    loop = Loop(float(z.max()), None if bench.is_quasi_static else pace, estimate)
    return loop.within(float(bench.force[bench.samples].std()))


def sine_of(bench: Bench) -> tuple[FloatArray, FloatArray, float]:
    """Return travel (m), velocity (m/s) and rate (Hz) of four cycles of a sine of the size and pace of a record.

    A quasi-static test passes along its path at 1 m/s.

    >>> t = np.arange(5000) / 500.0
    >>> travel, velocity = 0.01 * np.sin(np.pi * t), 0.01 * np.pi * np.cos(np.pi * t)
    >>> bench = Bench(travel, velocity, t, 500.0, 0.0, "recorded", None, {}, ())
    >>> z, v, fs = sine_of(bench)
    >>> [round(float(value), 4) for value in (z.max(), v.max(), fs / (z.size / 4))]
    [0.01, 0.0314, 0.5]
    """
    z, v, fs = sine_like(float(bench.travel.std()), float(bench.velocity.std()))
    if not bench.is_quasi_static:
        return z, v, fs
    n, amplitude = z.size // 4, float(z.max())
    quarter = (np.arange(z.size) + 0.25) * 4 / n % 4
    saw = np.where(quarter < 1, quarter, np.where(quarter < 3, 2 - quarter, quarter - 4))
    rising = np.where((quarter < 1) | (quarter > 3), 1.0, -1.0)
    return amplitude * saw, rising, n / (4 * amplitude)
