"""Unsprung mass, tyre and road of a gear from the same runs as its suspension, without a measured road."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import gammainc, gammaincc

from opid.errors import InputError, NotDeterminedError, list_names
from opid.estimate import Estimate, format_number
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.suspensions.answer.stored_fit import StoredFit, restore_model, take_fits
from opid.suspensions.identification import check_study, collect_arrays
from opid.suspensions.result import Identification
from opid.suspensions.settings import Settings
from opid.suspensions.study import Run, Study
from opid.suspensions.wheel.likelihood import (
    DAMPING,
    FIRST_ROAD,
    FOOTPRINT,
    MASS,
    SLOPE,
    STIFFNESS,
    Blocks,
    Lines,
    WheelFit,
    WheelProblem,
    cut,
    cut_into_blocks,
    find_covariance,
    find_curvature,
    fit_wheel,
    straighten_strut,
    transform_blocks,
)
from opid.suspensions.wheel.result import (
    RunRoad,
    WheelIdentification,
    WheelParameters,
    WheelSettings,
    classify_road,
)


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
            "wheel and tyre are identified for one gear, whose sensor on the airframe shows all that the wheel bears: "
            "give the study of a gear alone, with its two channels in [channels]"
        )
    if not study.is_driven:
        raise InputError(
            "wheel and tyre need the acceleration below the suspension as a sensor reads it, and here it was derived "
            "from the travel: give runs with a sensor there"
        )
    if study.interfaces[0].axis == "horizontal":
        raise InputError("the axis is 'horizontal', along which no road pushes a wheel: give runs of vertical motion")
    fits, usual = take_fits(result, estimator)
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
        gears.append(cut_into_blocks(known_model, run, speed, known))
    each_lines = [int(gear.is_used.sum()) for gear in gears]
    n_lines = sum(each_lines)
    if n_lines < known.least_lines or not all(each_lines):
        without = [run.name for run, own in zip(study.runs, each_lines, strict=True) if not own]
        of_run = f", and none of {list_names(map(repr, without))}," if without and n_lines else ""
        raise InputError(
            f"only {n_lines} lines of all blocks{of_run} belong to waves of {known.shortest_wave_m:g} m or more in the "
            f"band of {known.band_hz[0]:g} to {known.band_hz[1]:g} Hz: give longer or faster runs, and check the speed "
            "(m/s)"
        )
    why = _find_obstacle(fit, gears, known)
    if why is not None:
        return _refuse(study, gears, fit, known, seed, why)
    say("wheel and tyre")
    problem = WheelProblem(tuple(gears), known)
    try:
        found = fit_wheel(problem, seed)
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


# ---- checks ----------------------------------------------------------------------------------------


def _find_unusual(found: WheelFit) -> tuple[float, str]:
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


def _measure_change(found: WheelFit, columns: Sequence[FloatArray]) -> Estimate:
    """Return the relative change of the tyre stiffness in proportion to a quantity of each block, with one step.

    Args:
        found: the fit without a change.
        columns: (n_blocks,) the quantity in each block of each run.
    """
    problem = replace(found.problem, columns=tuple(columns))
    vector = np.append(found.vector, 0.0)
    lines = problem.evaluate(vector, found.struts)
    step = -np.linalg.solve(find_curvature(problem, vector, found.struts), problem.gradient(lines, vector))
    try:
        covariance = find_covariance(problem, vector, lines, found.struts)
    except NotDeterminedError:
        return Estimate()
    return Estimate.normal(float(step[-1]), float(np.sqrt(covariance[-1, -1])))


def _measure_cubic(found: WheelFit) -> Estimate:
    """Return the relative change of the tangent stiffness of the tyre at its rms force, from its mean stiffness.

    A tyre of force K1 d + k d^3 adds e F^3 to the equation of motion, F its force M1 x1'' + M2 x2'' and e = k/K1^3. Of
    that, F^3 - 3 s^2 F is what no linear tyre can replace: s is the rms of F, and for a Gaussian force it has neither a
    linear part nor a mean response. Its coherence with the force of the road is zero under a linear tyre.
    """
    slope, information, spread, square, n_blocks = 0.0, 0.0, 0.0, 0.0, 0.0
    for gear, each in zip(found.problem.gears, found.lines, strict=True):
        force = cut(np.exp(found.vector[MASS]) * gear.wheel + gear.mass * gear.body, gear.window)
        size = np.sqrt((force**2) @ gear.window**2 / np.sum(gear.window**2))[:, np.newaxis]
        lines = transform_blocks(force**3 - 3 * size**2 * force, gear.window, gear.fs)
        first = round(gear.frequency_hz[0] * gear.window.size / gear.fs)
        by = -1j * gear.omega * lines[:, first : first + gear.omega.size]
        weight = np.where(gear.is_used, gear.information * np.exp(-each.log_density), 0.0)
        scores = np.sum(2 * np.real(each.error.conj() * by) * weight, axis=1)
        slope += float(scores.sum())
        spread += float(np.sum(scores**2))
        information += float(np.sum(2 * np.abs(by) ** 2 * weight))
        square += float(size[:, 0] @ size[:, 0])
        n_blocks += size.size
    at_rms = 3 * square / n_blocks / information
    return Estimate.normal(-slope * at_rms, float(np.sqrt(spread)) * at_rms)


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
        stiffer_by_load=Estimate(),
        stiffer_by_force=Estimate(),
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
    study: Study, fit: StoredFit, found: WheelFit, unit_kg: float, unit_std: float, seed: int
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
        _describe_road(gear, lines, vector[FIRST_ROAD + k], std[FIRST_ROAD + k], unit_kg)
        for k, (gear, lines) in enumerate(zip(gears, found.lines, strict=True))
    )
    by_load, by_force = _measure_load_change(found), _measure_cubic(found)
    return WheelIdentification(
        title=study.title,
        per_mass=not fit.has_mass,
        parameters=parameters,
        roads=roads,
        stiffer_by_load=by_load,
        stiffer_by_force=by_force,
        bounds=_find_bounds(found),
        unusual=unusual,
        n_lines=sum(int(gear.is_used.sum()) for gear in gears),
        not_determined=None,
        warnings=tuple(_warn(parameters, (by_load, by_force), known, per_mass=not fit.has_mass)),
        settings=known,
        seed=seed,
        files=study.files,
    )


def _estimate_parameters(found: WheelFit, unit_kg: float, unit_std: float) -> WheelParameters:
    vector, covariance = found.vector, found.covariance
    std = np.sqrt(np.diag(covariance))

    def estimate_log(index: int) -> Estimate:
        value, relative = unit_kg * float(np.exp(vector[index])), float(np.hypot(std[index], unit_std))
        ends = (value * float(np.exp(-1.96 * relative)), value * float(np.exp(1.96 * relative)))
        return Estimate(value, value * relative, ends)

    damping, damping_std = float(vector[DAMPING]), float(std[DAMPING])
    hop = _find_hop(found.problem.gears[0], vector)
    gradient = np.zeros((2, vector.size))
    for k in (MASS, STIFFNESS, DAMPING):
        moved = vector.copy()
        moved[k] += 1e-3 * std[k]
        gradient[:, k] = (_find_hop(found.problem.gears[0], moved) - hop) / (1e-3 * std[k])
    hop_std = np.sqrt(np.einsum("ij,jk,ik->i", gradient, covariance, gradient))
    return WheelParameters(
        unsprung_mass_kg=estimate_log(MASS),
        tyre_stiffness_n_per_m=estimate_log(STIFFNESS),
        tyre_damping_n_s_per_m=_give_positive(unit_kg * damping, unit_kg * damping_std),
        hop_frequency_hz=_give_positive(float(hop[0]), float(hop_std[0])),
        hop_damping_ratio=_give_positive(float(hop[1]), float(hop_std[1])),
        footprint_m=_give_positive(abs(float(vector[FOOTPRINT])), float(std[FOOTPRINT])),
        road_slope=Estimate.normal(float(vector[SLOPE]), float(std[SLOPE])),
    )


def _give_positive(value: float, std: float) -> Estimate:
    """Return an estimate of what cannot be negative."""
    low, middle, high = (max(0.0, value + k * 1.96 * std) for k in (-1, 0, 1))
    return Estimate(middle, std, (low, high))


def _find_hop(gear: Blocks, vector: FloatArray) -> FloatArray:
    """Return natural frequency (Hz) and damping ratio of the faster motion of wheel and sprung mass."""
    m1, k1, c1 = np.exp(vector[MASS]), np.exp(vector[STIFFNESS]), vector[DAMPING]
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


def _find_bounds(found: WheelFit) -> tuple[float, float, float] | None:
    """Return the relative standard deviations of M1, K1 and C1 by Fisher information; None for no damping."""
    problem, vector = found.problem, found.vector
    if vector[DAMPING] <= 0.0:
        return None
    lines = problem.evaluate(vector, tuple(map(straighten_strut, problem.gears)))
    std = np.sqrt(np.diag(np.linalg.inv(problem.fisher(lines))))
    return float(std[MASS]), float(std[STIFFNESS]), float(std[DAMPING] / vector[DAMPING])


def _measure_load_change(found: WheelFit) -> Estimate:
    """Return the relative change of the tyre stiffness by the loading most unlike that of the first run."""
    gears = found.problem.gears
    changes = np.array([gear.mass - gears[0].mass for gear in gears])
    most = float(changes[np.argmax(np.abs(changes))])
    if abs(most) < 1e-3:
        return Estimate()
    columns = [np.full(gear.speed.shape[0], change / most) for gear, change in zip(gears, changes, strict=True)]
    return _measure_change(found, columns)


def _warn(
    parameters: WheelParameters,
    changes: Sequence[Estimate],
    settings: WheelSettings,
    *,
    per_mass: bool,
) -> Iterator[str]:
    loose = [
        words
        for words, each in (
            ("the unsprung mass", parameters.unsprung_mass_kg),
            ("the tyre stiffness", parameters.tyre_stiffness_n_per_m),
            ("the tyre damping", parameters.tyre_damping_n_s_per_m),
        )
        if (each.std or 0.0) > settings.loosely_known * (each.value or 0.0)
    ]
    if loose:
        yield (
            f"these runs tell {' and '.join(loose)} no better than to {100 * settings.loosely_known:g} %: use the "
            "interval, which becomes narrower with the root of the total length of the runs"
        )
    words_of_changes = ("with the load", "at the rms of its force")
    for change, words in zip(changes, words_of_changes, strict=True):
        if change.value is not None and change.std and abs(change.value) > settings.unequal_std * change.std:
            percent = format_number(100 * change.value, 2)
            yield (
                f"the tyre stiffness changes {words} by {percent} %: the tyre is not linear, and its stiffness here is "
                "that of a mean motion"
            )
    if per_mass:
        yield "the result has no sprung mass, so all is per kg of it: identify runs with different loadings"
