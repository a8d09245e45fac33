"""Forces, travel and motion of an identified body along a record, with bands.

The vector of the fit is updated by the record, the likeliest motion follows from all readings of the record
(`opid.mechanics.smoothing`), and the bands from draws of the vector, of the noise and of the tolerances of the sensors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.smoothing import DrivenRecord, Smoothed, SmoothedMotion, smooth
from opid.progress import Say
from opid.signals.health.inspection import findings_in_words
from opid.signals.motion import integrate
from opid.signals.recording import FloatArray
from opid.suspensions.answer.stored_fit import KnownModel, StoredFit, restore_model, take_fits
from opid.suspensions.fitting.fit import NO_FIT, minimize
from opid.suspensions.identification import check_study, collect_arrays
from opid.suspensions.model.body import mobility, vertical
from opid.suspensions.model.driven_model import Errors, Model, ProcessNoise
from opid.suspensions.result import Identification
from opid.suspensions.sensing.result import Quantity, Rainflow, Sensing, StaticValue, VirtualSensor
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.sensor_facts import UNKNOWN_GAIN
from opid.suspensions.settings import Settings
from opid.suspensions.study import Run, Study

# lines from which the density of slow motion is taken: more would reach into the bounce of a strut
_N_SLOW = 9

Place = tuple[float, float]
"""x and y of a place on the body, m."""


def sense(
    study: Study,
    result: Identification | Sequence[StoredFit],
    run: Run | str | None = None,
    *,
    places: Mapping[str, Place] | None = None,
    unsprung_mass_kg: Estimate | Mapping[str, Estimate] | None = None,
    settings: SensingSettings | None = None,
    estimator: Settings | None = None,
    seed: int = 0,
    progress: Say | None = None,
) -> Sensing:
    """Return forces, travel and motion of an identified body along a record, each sample with its standard deviation.

    The strut force is the force on the body in the direction in which the channels count positive: with `axis = "up"`
    a compressed strut pushes with a positive force. It is measured from that at rest; `strut_load` includes the force
    at rest, where the weight is known and statics determines it. The tyre force is the strut load plus M1 (x1'' + g).
    Accelerometers do not show the slow motion of the body: its velocity is that above the lowest compared frequency.

    Args:
        study: the study that was identified.
        result: its identification by the model, or the fits of a result.json.
        run: a further record of the same sensors, or the name of a run of the study; the first one if left out.
        places: names and (x, y), m, of places on a rigid body whose motion is wanted.
        unsprung_mass_kg: M1, the mass that moves with the wheel, of each interface or by its name; the tyre force is
            given only with it.
        settings: tuned numbers.
        estimator: settings with which the study was identified, if they were not the usual ones.
        seed: seed of the draws.
        progress: called with the name of each step as it begins.

    Returns:
        One virtual sensor for each quantity and place, (n,) values and standard deviations in SI units; values at rest
        and rainflow counts.

    Raises:
        InputError: a result without numbers or of another study, a place on a gear alone, a channel that is missing, or
            a record without motion.
        NotDeterminedError: the model does not follow the record.
    """
    known = settings or SensingSettings()
    say = progress or (lambda step: None)
    fits, usual = take_fits(result, estimator)
    if not fits:
        raise InputError(
            "the result gives no number with an interval, so that it predicts no force: see its warnings, and identify "
            "runs that determine the suspensions"
        )
    sensed = _find_run(study, run)
    is_run = any(sensed is each for each in study.runs) and all(sensed.name in fit.runs for fit in fits)
    checked = check_study(replace(study, runs=(sensed,)), usual)
    arrays, _ = collect_arrays(checked)
    masses = _read_masses(study, unsprung_mass_kg)
    wanted = dict(places or {})
    if wanted and fits[0].kind != "rigid_body":
        raise InputError(
            "places are given, and the result is of gears alone, whose mass has no extent: leave them out, or identify "
            "one rigid body"
        )
    parts = []
    for fit in fits:
        say(f"motion of {', '.join(fit.interfaces)}")
        parts.append(_sense_part(restore_model(fit, checked, arrays, usual, is_run=is_run), fit, known))
    rng = np.random.default_rng(seed)
    bands = []
    for part in parts:
        say(f"band of {', '.join(part.fit.interfaces)}")
        bands.append(_draw_band(_list_wanted(part, study, wanted, masses, sensed), known, rng))
    sensors = [each for band in bands for each in band.sensors]
    n = min(each.value.size for each in sensors)
    per_mass = not all(fit.has_mass for fit in fits)
    return Sensing(
        title=study.title,
        run=sensed.name,
        fs=sensed.recording.fs,
        start_s=sensed.recording.start_s,
        per_mass=per_mass,
        sensors=tuple(replace(each, value=each.value[:n], std=each.std[:n]) for each in sensors),
        static=tuple(each for band in bands for each in band.static),
        rainflow=tuple(each for band in bands for each in band.rainflow),
        over_noise=tuple(part.over_noise for part in parts),
        widened=max(part.widened for part in parts),
        unmeasured_m_per_s2=max(part.unmeasured for part in parts),
        warnings=(*findings_in_words(sensed.name, checked.runs[0].findings), *_warn(parts, known, per_mass=per_mass)),
        files=sensed.recording.files,
        settings=known,
        seed=seed,
    )


def _find_run(study: Study, run: Run | str | None) -> Run:
    if isinstance(run, Run):
        return run
    names = [each.name for each in study.runs]
    if run is not None and run not in names:
        raise InputError(f"the study has no run {run!r}: {nearest(run, names)}")
    return study.runs[0 if run is None else names.index(run)]


def _read_masses(study: Study, given: Estimate | Mapping[str, Estimate] | None) -> dict[str, Estimate]:
    masses = dict(given) if isinstance(given, Mapping) else {} if given is None else dict.fromkeys(study.names, given)
    for name, mass in masses.items():
        if name not in study.names:
            raise InputError(f"unsprung_mass_kg has an interface {name!r}: {nearest(name, study.names)}")
        if mass.value is None or not 0.0 < mass.value < np.inf or not 0.0 <= (mass.std or 0.0) < np.inf:
            raise InputError(
                f"the unsprung mass of {name!r} is {mass.value} kg (std {mass.std}): give positive numbers"
            )
    return masses


def _list_wanted(
    part: _Part, study: Study, places: Mapping[str, Place], masses: Mapping[str, Estimate], run: Run
) -> _Wanted:
    names = part.fit.interfaces
    driven = part.model.runs[0]
    return _Wanted(
        part,
        names=("",) if study.is_one_gear else names,
        places=tuple((name, vertical(*place)) for name, place in places.items()),
        unsprung_kg=tuple(masses.get(name, Estimate()) if part.fit.has_mass else Estimate() for name in names),
        finer=max(1, round(driven.fs / run.recording.fs)),
        lowest_hz=float(driven.omega[0]) / (2 * np.pi),
    )


def _warn(parts: Sequence[_Part], settings: SensingSettings, *, per_mass: bool) -> Iterator[str]:
    for part in parts:
        if part.unmeasured:
            yield (
                f"the model of {', '.join(part.fit.interfaces)} leaves {part.over_noise:.3g} times the noise of the "
                f"sensors: the bands hold unmeasured forces that accelerate the body by {part.unmeasured:.2g} m/s^2 "
                "rms; check that the log is of this strut, its loading, and its sensors"
            )
        if part.moved_std > settings.most_moved:
            yield (
                f"the log moves the parameters of {', '.join(part.fit.interfaces)} by {part.moved_std:.2g} standard "
                "deviations: the suspension has changed, or the log has another loading than stated; the bands hold "
                "either"
            )
    if per_mass:
        yield "the result has no mass, so forces are per unit of mass: identify runs with different loadings"


# ---- one fit ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Part:
    """The motion of one fitted structure.

    Args:
        fit: the fit.
        model: its model, of this record alone.
        theta: the vector, updated by the record.
        covariance: its covariance.
        mean: the vector of the result, before the record.
        over_noise: residual of the record over the noise of the sensors.
        widened: factor on that noise.
        unmeasured: rms acceleration by unmeasured forces, m/s^2.
        moved_std: rms change of the vector by the record, in standard deviations.
        travel: (n, n_interfaces) predicted travel, from which the smoother starts, m.
    """

    fit: StoredFit
    model: Model
    theta: FloatArray
    covariance: FloatArray
    mean: FloatArray
    over_noise: float
    widened: float
    unmeasured: float
    moved_std: float
    travel: FloatArray


def _sense_part(known: KnownModel, fit: StoredFit, settings: SensingSettings) -> _Part:
    """Return the vector for a record and how well the model then follows it."""
    model, run = known.model, known.model.runs[0]
    motion, noise = float(run.transform(run.sprung.T).std()), float(np.mean(model.noise[1]))
    names = ", ".join(fit.interfaces)
    if motion < settings.least_motion * noise:
        raise InputError(
            f"the readings on the body at {names} are {motion:.2g} m/s^2 rms in the compared band, no more than noise "
            f"({noise:.2g} m/s^2): give a log with motion"
        )
    try:
        theta, covariance, errors = _update(known, fit.over_noise)
    except NO_FIT as error:
        raise NotDeterminedError(f"the model of {names} cannot follow this log: {error}") from error
    over_noise = _residual(errors)
    unmeasured = 0.0
    widened = max(over_noise, fit.over_noise, 1.0)
    if over_noise > settings.followed * max(fit.over_noise, 1.0):
        model, unmeasured = _add_unmeasured(model, theta, settings)
        errors = model.evaluate(theta, sensitivity=False)
        widened = max(1.0, _residual(errors))
    moved_std = _measure_change(known, theta)
    travel = errors.predictions[0].travel
    return _Part(fit, model, theta, covariance, known.mean, over_noise, widened, unmeasured, moved_std, travel)


def _measure_change(known: KnownModel, theta: FloatArray) -> float:
    """Return the rms change of the vector by the record, in standard deviations; initial states do not count."""
    starts = known.model.indices_of_run(0)[0]
    counted = np.delete(np.arange(theta.size), np.arange(starts.start, starts.stop))
    size = np.sqrt(np.diag(known.covariance))[counted]
    counted, size = counted[size > 0.0], size[size > 0.0]
    moved = (theta - known.mean)[counted] / size
    inverse = np.linalg.pinv(known.covariance[np.ix_(counted, counted)] / np.outer(size, size), hermitian=True)
    return float(np.sqrt(moved @ inverse @ moved / moved.size))


def _residual(errors: Errors) -> float:
    (line,) = errors.lines
    return float(np.sqrt(np.mean(np.abs(line) ** 2) / 2))


@dataclass(frozen=True, eq=False)
class _Updated:
    """Errors of a record beside what is known of the vector."""

    errors: Errors
    stacked: FloatArray
    jacobian: FloatArray


def _update(known: KnownModel, over_noise: float) -> tuple[FloatArray, FloatArray, Errors]:
    """Return the vector and its covariance, given the readings of a record, and the errors at that vector.

    A run of the fit has told the vector all it can already.
    """
    model = known.model
    if known.is_of_run:
        return known.mean, known.covariance, model.evaluate(known.mean, sensitivity=False)
    # Directions in which nothing may move keep a small spread, so that the whitening has an inverse.
    size = np.sqrt(np.diag(known.covariance))
    size = np.where(size > 0.0, size, 1e-12)
    values, vectors = np.linalg.eigh(known.covariance / np.outer(size, size))
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-10))).T / size
    weight = 1.0

    def evaluate(theta: FloatArray) -> _Updated | None:
        try:
            errors = model.evaluate(theta)
        except NO_FIT:
            return None
        n = 2 * sum(line.size for line in errors.lines)
        rows = [weight * errors.stacked[:n], whiten @ (theta - known.mean)]
        return _Updated(errors, np.concatenate(rows), np.concatenate([weight * errors.jacobian[:n], whiten]))

    known_fit, theta, found = model.settings.fit, known.mean, None
    for free in (slice(model.n_shared, None), slice(None)):
        theta, found, _ = minimize(
            model,
            evaluate,
            theta,
            free=free,
            most_evaluations=known_fit.most_refit_evaluations,
            least_promise=known_fit.least_promise,
        )
        # A record that the model does not follow must not pull the vector as if it were exact.
        weight = 1.0 / max(_residual((found or _require(evaluate(theta))).errors), over_noise, 1.0)
    found = _require(evaluate(theta))
    return theta, np.asarray(np.linalg.inv(found.jacobian.T @ found.jacobian)), found.errors


def _require(updated: _Updated | None) -> _Updated:
    if updated is None:
        raise UnboundedResponseError("the suspensions of the result cannot be simulated along the record")
    return updated


def _add_unmeasured(model: Model, theta: FloatArray, settings: SensingSettings) -> tuple[Model, float]:
    """Return the model with the likeliest unmeasured forces, and their rms as an acceleration, m/s^2.

    The prediction errors of the whole record choose among sizes and corners.
    """
    likeliest, highest = model, -np.inf
    for fraction in settings.pushes:
        for corner_hz in settings.push_corners_hz:
            trial = replace(model, process=ProcessNoise(fraction, corner_hz))
            try:
                (prediction,) = trial.evaluate(theta, sensitivity=False).predictions
            except NO_FIT:
                continue
            seen = model.compared
            likely = -float(np.sum(0.5 * prediction.innovation[seen] ** 2 + np.log(prediction.spread[seen])))
            if likely > highest:
                likeliest, highest = trial, likely
    rms, n_strut = likeliest.process.acceleration_rms(model.runs[0]), model.runs[0].n_strut
    return likeliest, float(np.sqrt(np.mean(rms[: rms.size - n_strut] ** 2)))


# ---- the band --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Wanted:
    """What is wanted of one fitted structure.

    Args:
        part: the structure.
        names: names of its interfaces, with which channels begin; empty for one gear.
        places: places on the body, name and row of the body's motion.
        unsprung_kg: unsprung mass of each interface; empty where it is not known.
        finer: number of steps of the model in a sample.
        lowest_hz: frequency above which velocities of the body are given.
    """

    part: _Part
    names: tuple[str, ...]
    places: tuple[tuple[str, FloatArray], ...]
    unsprung_kg: tuple[Estimate, ...]
    finer: int
    lowest_hz: float

    def list_channels(self, loads: FloatArray) -> list[tuple[str, Quantity, str]]:
        """Return name, quantity and place of each channel, in the order of `read`."""
        found: list[tuple[str, Quantity, str]] = []
        for name, mass, load in zip(self.names, self.unsprung_kg, loads.tolist(), strict=True):
            quantities: list[Quantity] = ["strut_force"]
            quantities += ["strut_load"] * int(np.isfinite(load))
            quantities += ["tyre_force"] * int(mass.value is not None)
            quantities += ["travel", "travel_velocity", "acceleration", "velocity"]
            found += [(f"{name}_{each}" if name else each, each, name) for each in quantities]
        for name, _ in self.places:
            found += [(f"{name}_acceleration", "acceleration", name), (f"{name}_velocity", "velocity", name)]
        return found

    def read(
        self,
        record: DrivenRecord,
        theta: FloatArray,
        motion: SmoothedMotion,
        loads: FloatArray,
        unsprung_kg: FloatArray,
    ) -> list[FloatArray]:
        """Return the value of each channel along a motion, (n,) each."""
        model, fs = self.part.model, record.fs / self.finer
        every, fall = slice(None, None, self.finer), _fall(model)
        force = -motion.force / _mass_unit(self.part, theta)
        body = -motion.whole_force @ record.accelerance.T + motion.pushed[:, : record.n_interfaces]
        below = body - motion.curvature
        found = []
        for k, (load, mass_kg) in enumerate(zip(loads.tolist(), unsprung_kg.tolist(), strict=True)):
            found.append(force[every, k])
            if np.isfinite(load):
                found.append(force[every, k] + load)
            if np.isfinite(mass_kg):
                at_rest = load - mass_kg * fall if np.isfinite(load) else 0.0
                found.append(force[every, k] + mass_kg * below[every, k] + at_rest)
            found += [motion.travel[every, k], motion.velocity[every, k]]
            found += self._add_velocity(body[every, k], fs)
        for _, row in self.places:
            by_force = _mobility_at(model, theta, row)[: record.n_interfaces]
            pushed = motion.pushed @ np.linalg.pinv(model.body.readings).T @ row
            found += self._add_velocity((pushed - motion.whole_force @ by_force)[every], fs)
        return found

    def _add_velocity(self, acceleration: FloatArray, fs: float) -> list[FloatArray]:
        return [acceleration, integrate(acceleration, fs=fs, high_pass_hz=self.lowest_hz).velocity]


@dataclass(frozen=True, eq=False)
class _Band:
    """Virtual sensors of one fitted structure, its values at rest and the cycles of its strut forces."""

    sensors: list[VirtualSensor]
    static: list[StaticValue]
    rainflow: list[Rainflow]


def _draw_band(wanted: _Wanted, settings: SensingSettings, rng: np.random.Generator) -> _Band:
    """Smooth the record, and draw the motions and parameters that the readings allow."""
    part = wanted.part
    theta = part.theta
    record = _make_record(part, theta)
    smoothed = smooth(record, part.travel[:, : record.n_interfaces])
    loads, travels = _find_static(part, theta)
    masses = np.array([np.nan if each.value is None else each.value for each in wanted.unsprung_kg])
    mass_std = np.array([each.std or 0.0 for each in wanted.unsprung_kg])
    value = wanted.read(record, theta, smoothed.motion, loads, masses)
    channels = wanted.list_channels(loads)
    forces = [k for k, (_, quantity, _) in enumerate(channels) if quantity == "strut_force"]
    edges = [_range_edges(value[k], settings.n_bins) for k in forces]

    contradicted, fraction, by_gain = _find_contradictions(wanted, record, smoothed, settings)

    size = np.sqrt(np.maximum(np.diag(part.covariance), 1e-300))
    spread, vectors = np.linalg.eigh(part.covariance / np.outer(size, size))
    root = size[:, np.newaxis] * vectors * np.sqrt(np.maximum(spread, 0.0))
    squares, rests, counts = [np.zeros_like(each) for each in value], [], []
    n_drawn = n_failed = 0
    while n_drawn < settings.n_draws:
        trial = theta + root @ rng.standard_normal(theta.size)
        try:
            drawn = _make_record(part, trial)
            at_rest = _find_static(part, trial)
        except NO_FIT as error:
            n_failed += 1
            if n_failed > settings.n_draws:
                raise NotDeterminedError(f"the parameters are too uncertain for a band: {error}") from error
            continue
        mass = masses + mass_std * rng.standard_normal(masses.size)
        found = wanted.read(drawn, trial, smoothed.draw(drawn, rng), at_rest[0], mass)
        for square, each, likeliest in zip(squares, found, value, strict=True):
            square += (each - likeliest) ** 2
        rests.append(np.concatenate(at_rest))
        if n_drawn < settings.n_counted:
            scale = 1.0 + float(np.hypot(fraction, by_gain)) * rng.standard_normal()
            counts.append([_count_cycles(scale * found[k], edge) for k, edge in zip(forces, edges, strict=True)])
        n_drawn += 1
    for square, (_, quantity, place), each in zip(squares, channels, value, strict=True):
        if quantity in ("strut_force", "strut_load", "tyre_force"):
            square += n_drawn * contradicted[:: wanted.finer, wanted.names.index(place)] ** 2
        square += n_drawn * (fraction**2 * (each**2 + np.var(each)) + by_gain**2 * (each - each.mean()) ** 2)
    std = [np.sqrt(square / n_drawn) for square in squares]
    unit = "N" if part.fit.has_mass else "m/s^2"
    sensors = [
        VirtualSensor(name, quantity, place, _UNITS.get(quantity, unit), each, deviation)
        for (name, quantity, place), each, deviation in zip(channels, value, std, strict=True)
    ]
    return _Band(
        sensors,
        list(_list_static(wanted.names, loads, travels, np.array(rests), fraction)),
        [
            Rainflow(
                place=name,
                edges_n=edge,
                cycles=_count_cycles(value[k], edge),
                std=np.std([each[number] for each in counts], axis=0),
                least_range_n=2 * settings.band_std * float(np.median(std[k])),
            )
            for number, (name, k, edge) in enumerate(zip(wanted.names, forces, edges, strict=True))
        ],
    )


def _find_contradictions(
    wanted: _Wanted, record: DrivenRecord, smoothed: Smoothed, settings: SensingSettings
) -> tuple[FloatArray, float, float]:
    """Return by how much the force may be wrong where the record contradicts the result, (n, n_interfaces) N.

    The second value is a relative error of everything, loads at rest among them, and the third one of all that moves.

    If the model leaves more than noise, the force of the law differs from what the motion of the body needs: by an
    unmeasured force if the law is right, by its own error or that of a sensor if it is not. If the record moves the
    vector by far more than its uncertainty, the suspension has changed, or the mass is another one than stated, or a
    gain is: the force may then be that of the law of the result along the motion, or that of the mass of the result
    times the motion, and any sensor may be wrong by the same fraction. No accelerometer tells which, so that the bands
    hold all of them. A gain that all sensors share changes motion and force of a linear suspension in one ratio: hardly
    anything shows it. If the vector moves, this gain may be off by as many of its standard deviations as the vector,
    and at most by `most_contradicted`.

    Raises:
        NotDeterminedError: they are a large fraction of the force.
    """
    part = wanted.part
    motion, unit = smoothed.motion, _mass_unit(part, part.theta)
    body = -motion.whole_force @ record.accelerance.T + motion.pushed[:, : record.n_interfaces]
    squares = (motion.pushed[:, : record.n_interfaces] @ np.linalg.pinv(record.accelerance).T / unit) ** 2
    moved = np.zeros_like(squares)
    facts = (*part.model.sensors.sprung, *part.model.sensors.unsprung)
    # the draws hold gains whose tolerances are stated; all share none beyond the best known of them
    stated = min((each.gain_tolerance for each in facts if 0.0 < each.gain_tolerance < UNKNOWN_GAIN), default=0.0)
    by_gain = 0.0 if stated else settings.gain_tolerance
    if part.moved_std > settings.most_moved:
        before, unit_before = _make_record(part, part.mean), _mass_unit(part, part.mean)
        by_law = smoothed.follow(before).force / unit_before - motion.force / unit
        by_mass = -body @ np.linalg.pinv(before.accelerance).T / unit_before - motion.whole_force / unit
        moved = by_law**2 + by_mass**2
        by_gain = min(part.moved_std * (stated or settings.gain_tolerance), settings.most_contradicted)
    size = float(np.mean(np.var(motion.force / unit, axis=0)))
    fraction = float(np.sqrt(np.mean(squares + moved) / size))
    if fraction > settings.most_contradicted:
        raise NotDeterminedError(
            f"the model of {', '.join(part.fit.interfaces)} leaves {part.over_noise:.3g} times the noise of the "
            f"sensors in this log ({part.fit.over_noise:.3g} times in the runs that were identified), which moves its "
            f"parameters by {part.moved_std:.2g} standard deviations; its force may be wrong by {100 * fraction:.0f} "
            "%: the log is of another strut or loading, or a sensor has a fault; check it with `opid inspect`"
        )
    return np.sqrt(squares + moved), fraction, by_gain


# noise of a drive that was not measured: far more than any wheel moves
_UNMEASURED_M_PER_S2 = 1e4

_UNITS = {"travel": "m", "travel_velocity": "m/s", "acceleration": "m/s^2", "velocity": "m/s"}


def _make_record(part: _Part, theta: FloatArray) -> DrivenRecord:
    """Return the record with the model at a vector."""
    model, run = part.model, part.model.runs[0]
    below, above = model.correct(theta, 0)
    moved, noise, n = model.mobility(theta, 0), model.noise_in(theta, run), model.body.n_interfaces
    drive, measured = below.value[::2, :n].copy(), above.value.copy()
    coupled = model.settings.runs.offset_ac_m_per_s2
    stds = []
    for facts, side in ((model.sensors.unsprung, drive), (model.sensors.sprung, measured)):
        means = [_find_mean(column, run.fs) for column in side.T]
        side -= [0.0 if each.corner_hz else mean for each, (mean, _) in zip(facts, means, strict=True)]
        stds.append(np.array([coupled if each.corner_hz else std for each, (_, std) in zip(facts, means, strict=True)]))
    if run.n_strut:
        # A sensor of a travel or a force has a zero of its own.
        stds[1][-run.n_strut :] = measured[:, -run.n_strut :].std(axis=0)
    if run.drive_step_m_per_s2:
        noise, stds[0] = replace(noise, drive=_UNMEASURED_M_PER_S2, drive_walk=0.0), np.ones(n)
    return DrivenRecord(
        interfaces=model.resting_interfaces(theta, 0)[:n],
        accelerance=moved.accelerance[:n, :n],
        reading=moved.reading[: measured.shape[1], :n],
        drive=drive,
        measured=measured,
        fs=run.fs,
        noise=replace(
            noise,
            drive=np.multiply(part.widened, noise.drive).tolist(),
            measured=(part.widened * np.asarray(noise.measured)).tolist(),
        ),
        offset_std=(stds[0], stds[1]),
        drift_m=_find_drift(model),
        of_travel=None if model.body.of_travel is None else model.body.of_travel[: measured.shape[1], :n],
    )


def _find_drift(model: Model) -> FloatArray:
    """Return the standard deviation of the height below each suspension about its mean, (n_interfaces,) m."""
    known, (_, covariance) = model.settings.runs, model.runs[0].ground_at_start
    # Of a parabola through observations of one height, the height at the first has nine times their variance.
    drift = np.sqrt(covariance[:, 0, 0]) / 3.0
    coupled = np.array([each.corner_hz > 0.0 for each in model.sensors.unsprung])
    return np.where(coupled, np.maximum(drift, known.start_displacement_m), drift)


def _find_mean(acceleration: FloatArray, fs: float) -> tuple[float, float]:
    """Return the offset of a reading whose motion stays about one velocity, and its standard deviation, m/s^2.

    The offset is the slope of the straight line through the integral. Noise of a constant density S makes that slope
    wrong by sqrt(12 S / T^3); S is that of the integral at the lowest frequencies.
    """
    n, length_s = acceleration.size, acceleration.size / fs
    velocity = np.cumsum(acceleration) / fs
    time = (np.arange(n) - 0.5 * (n - 1)) / fs
    slope = 12.0 * float(time @ velocity) / (fs * length_s**3)
    lines = np.fft.rfft(velocity - velocity.mean() - slope * time)[1:_N_SLOW]
    density = float(np.mean(np.abs(lines) ** 2)) / (n * fs)
    return slope, float(np.sqrt(12.0 * density / length_s**3))


def _mass_unit(part: _Part, theta: FloatArray) -> float:
    """Return the factor by which forces per unit of the reference mass are divided."""
    return part.model.inverse_mass(theta) if part.fit.has_mass else 1.0


def _fall(model: Model) -> float:
    return 0.0 if model.body.fall is None else float(model.body.fall[0])


def _find_static(part: _Part, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the static force of each suspension on the body, N, and its static travel, m; NaN where unknown."""
    model, body = part.model, part.model.body
    n, nothing = body.n_interfaces, np.full(body.n_interfaces, np.nan)
    rest = model.rest(theta, 0, straight=True)
    is_scaled = part.fit.is_mass_fitted or not model.runs[0].loading.any()
    travel = np.zeros(n) if rest is None else rest.travel[:n]
    travel = travel if body.fall is not None and is_scaled else nothing
    # A spring to the ground carries an unknown part of the weight.
    if body.fall is None or not part.fit.has_mass or model.ground:
        return nothing, travel
    first, mu = model.first_factor, model.inverse_mass(theta)
    weight = body.mass(theta[first : first + len(body.names)], mu, model.runs[0].loading) @ body.fall / mu
    rows = body.rows[:n]
    # Statics determines the force of each suspension only if no other set of forces balances the weight.
    if np.linalg.matrix_rank(rows) < n:
        return nothing, travel
    return np.asarray(np.linalg.lstsq(rows.T, -weight, rcond=None)[0]), travel


def _list_static(
    names: Sequence[str], loads: FloatArray, travels: FloatArray, drawn: FloatArray, fraction: float
) -> Iterator[StaticValue]:
    value = np.concatenate([loads, travels])
    std = np.sqrt(np.mean((drawn - value) ** 2, axis=0) + (fraction * value) ** 2)
    for k, name in enumerate(names):
        load, travel = (
            Estimate.normal(float(each[k]), float(std[k + first])) if np.isfinite(each[k]) else Estimate()
            for each, first in ((loads, 0), (travels, len(names)))
        )
        yield StaticValue(name, load, travel)


def _mobility_at(model: Model, theta: FloatArray, row: FloatArray) -> FloatArray:
    """Return the acceleration of a place for a unit force of each attachment, (n_attachments,), 1/kg."""
    body = model.body
    shifts = theta[model.first_coordinate : model.n_shared]
    kept = [k for k, each in enumerate(body.coordinates) if not each.of_sensor]
    seen = replace(body, readings=row[np.newaxis], coordinates=tuple(body.coordinates[k] for k in kept))
    first = model.first_factor
    factors = theta[first : first + len(body.names)]
    moved = mobility(seen, factors, model.inverse_mass(theta), shifts[kept], model.runs[0].loading)
    return moved.reading[0]


def _range_edges(force: FloatArray, n_bins: int) -> FloatArray:
    """Return the edges of ranges of cycles, from zero to a little beyond the largest range of a force."""
    return np.linspace(0.0, 1.02 * float(np.ptp(force)), n_bins + 1)


def _count_cycles(force: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the number of cycles in each range, by ASTM E1049; a range beyond the edges counts in the last one."""
    import rainflow

    cycles = np.array([(size, count) for size, _, count, _, _ in rainflow.extract_cycles(force)]).reshape(-1, 2)
    size = np.clip(cycles[:, 0], edges[0], edges[-1])
    return np.histogram(size, edges, weights=cycles[:, 1])[0]
