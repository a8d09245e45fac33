"""What limits an answer whose residual exceeds the sensors' noise: unmeasured forces, or the model itself.

A force on the body that is independent of the motion disturbs a fit, but does not bias it: the parameters are the same,
within their intervals, however the errors are weighted. An error of the model depends on the motion, and fits that
weight the errors differently compensate for it differently. The model is therefore fitted without and with process
noise, whose size and spectrum are estimated, and the difference of the two fits is the test (Hausman 1978,
Specification tests in econometrics). It also widens the intervals.

If the model is the limit, equivalents, explained fractions and predictions are those of its free motion. The answer is
then taken from the fit whose free motion has the smallest error, and not from that with the smallest one-step errors:
readings that correct the motion hide errors of the model (Ljung 1999, System identification, sec. 8.5).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.answer.intervals import std_over_white
from opid.suspensions.fitting.fit import (
    NO_FIT,
    Fit,
    fit_model,
    free_errors,
    predict_left_out,
    unexplained,
    with_mass_held,
)
from opid.suspensions.fitting.start import start_values
from opid.suspensions.model.driven_model import Model, ProcessNoise, straight_equivalent
from opid.suspensions.model.run import DrivenRun, band_indices

Limit = Literal["noise", "unmeasured forces", "model"]


@dataclass(frozen=True, eq=False)
class LeftOutSpectrum:
    """Readings of one sensor on the body in a run, and their prediction from the other runs, in third octaves.

    Args:
        edges_hz: (n_bands + 1,) edges of the bands, Hz.
        measured_m_per_s2: (n_bands,) rms of the readings in each band.
        predicted_m_per_s2: (n_bands,) rms of the free motion.
        error_m_per_s2: (n_bands,) rms of their difference.
        stated_m_per_s2: (n_bands,) rms of the errors if each line had the error that is stated to hold 95 % of them.
        inside: (n_bands,) fraction of the lines whose error is no larger than that.
    """

    edges_hz: FloatArray
    measured_m_per_s2: FloatArray
    predicted_m_per_s2: FloatArray
    error_m_per_s2: FloatArray
    stated_m_per_s2: FloatArray
    inside: FloatArray


@dataclass(frozen=True, eq=False)
class LeftOut:
    """How well the other runs predict a run that was left out, without any of its readings on the body.

    Args:
        run: index of the run.
        unexplained: rms of the error over that of the readings, in the band.
        inside: fraction of the lines whose error lies inside the stated band, which holds 95 % of them.
        spectra: the spectra of each sensor on the body.
    """

    run: int
    unexplained: float
    inside: float
    spectra: tuple[LeftOutSpectrum, ...]


@dataclass(frozen=True, eq=False)
class ModelError:
    """What limits a fit that leaves more than the noise of the sensors.

    Args:
        limit: what limits the answer.
        departure: the largest difference of stiffness, damping or mass between both fits, in standard deviations.
        spread: (n_unknowns, n_unknowns) contribution to the covariance of the vector.
        left_out: prediction of each run from the others; empty for a single run, or if a run cannot be predicted.
        of_equivalents: (n_runs, 4) relative standard deviation of stiffness, damping, frequency and damping ratio of
            the equivalent linear suspension in each run. It combines their differences between the two fits, between
            pieces of that run and all of it, and from the equation of motion; zero if the model is not the limit.
        contradicts_a_fact: whether the fit contradicts what is known of a sensor.
    """

    limit: Limit
    departure: float
    spread: FloatArray
    left_out: tuple[LeftOut, ...]
    of_equivalents: FloatArray
    contradicts_a_fact: bool = False


def measure_model_error(
    fit: Fit,
    *,
    is_wrong: bool = False,
    is_noise: bool = False,
    noise: tuple[FloatArray, FloatArray] | None = None,
) -> ModelError:
    """Return what limits an answer, for a fit that leaves more than the noise of the sensors.

    Pieces of the runs are fitted for one gear only: with several suspensions no number is reported if the model is the
    limit.

    Args:
        fit: a fitted model.
        is_wrong: whether the model is known to be wrong, whatever the difference of the two fits is.
        is_noise: whether the residual is sensor noise that is larger than stated.
        noise: noise of the sensors below and on the body, m/s^2, if that of the fit is its residual.
    """
    known, promise = fit.model.settings.process, fit.model.settings.fit.promise_in_search
    moved = np.zeros(fit.theta.size)
    departure = np.inf
    try:
        # Both fits have the same rate, so that they use the same samples.
        plain = fit_model(fit.model.coarse, fit.theta, least_promise=promise)
        indices = [index for first in fit.model.first_of_group for index in (first, first + 1)]
        indices += [fit.model.names.index("inverse_mass")] if fit.model.mass_free else []
        std = (plain.std * std_over_white(plain)[: fit.model.n_shared])[indices]
        for other in _with_process_noise(replace(plain, model=replace(plain.model, noise=noise or plain.model.noise))):
            moved = other.theta - plain.theta
            departure = float(np.max(np.abs(moved[indices]) / std))
            if departure > known.surely_other_std:
                break
    except NO_FIT:
        pass
    spread, of_equivalents = np.outer(moved, moved), np.zeros((len(fit.model.runs), 4))
    limit: Limit = "noise" if is_noise else "unmeasured forces"
    is_alone = fit.model.body.n_interfaces == 1
    if is_wrong or departure > (known.same_std if is_alone else known.same_std_of_body):
        limit = "model"
    if limit == "model" and is_alone:
        of_pieces, by_piece = _fit_pieces(fit)
        spread += of_pieces
        of_equivalents = np.hypot(by_piece, _compare_equivalents(fit, moved))
        of_equivalents = np.hypot(of_equivalents, _compare_with_equation(fit))
    return ModelError(limit, departure, spread, measure_left_out(fit), of_equivalents)


def weigh_by_process_noise(fit: Fit) -> Fit:
    """Return the likeliest fit with process noise, at a coarse rate; its errors have the size that the model predicts.

    Args:
        fit: the fit to start from.

    Raises:
        UnboundedResponseError: no process noise leads to a motion that is bounded.
    """
    promise = fit.model.settings.fit.promise_in_search
    *_, likeliest = _with_process_noise(fit_model(fit.model.coarse, fit.theta, least_promise=promise))
    return likeliest


def follow_freely(fit: Fit, error: ModelError) -> tuple[Fit, ModelError]:
    """Return the fit whose free motion leaves least, and what limits it; both are unchanged if it is no better.

    Args:
        fit: a fit that is limited by the model.
        error: its model error.
    """
    before = unexplained(fit)
    try:
        free = _fit_freely(fit)
        errors = fit.model.evaluate(free.theta)
    except NO_FIT:
        return fit, error
    found = replace(fit, theta=free.theta, errors=errors, n_evaluations=fit.n_evaluations + free.n_evaluations)
    if not np.sum(np.square(unexplained(found))) < np.sum(np.square(before)):
        return fit, error
    # The fits differ in how the errors are weighted, which does not matter for a right model.
    moved = fit.theta - found.theta
    return found, replace(
        error,
        spread=error.spread + np.outer(moved, moved),
        left_out=measure_left_out(free),
        of_equivalents=np.hypot(
            np.hypot(error.of_equivalents, _compare_equivalents(found, moved)), _compare_with_equation(found)
        ),
    )


def _fit_freely(fit: Fit) -> Fit:
    """Fit the free motion of a model to the readings at a coarse rate, each run weighted by its residual."""
    known, model, theta = fit.model.settings, fit.model.coarse.free, fit.theta
    free = Fit(model, theta, model.evaluate(theta, sensitivity=False), 1)
    n_evaluations = 1
    for _ in range(known.process.n_free_fits):
        rms = [float(np.sqrt(np.mean(np.abs(line) ** 2) / 2)) for line in free.errors.lines]
        runs = [
            replace(run, error_level=run.error_level * each) for run, each in zip(free.model.runs, rms, strict=True)
        ]
        model, most = replace(free.model, runs=tuple(runs)), known.fit.most_refit_evaluations
        free = fit_model(model, free.theta, most_evaluations=most, least_promise=known.fit.promise_in_search)
        n_evaluations += free.n_evaluations
    return replace(free, n_evaluations=n_evaluations)


def _with_process_noise(fit: Fit) -> Iterator[Fit]:
    """Yield fits with process noise, each more likely than those before; its spectrum is estimated band by band.

    Raises:
        UnboundedResponseError: no process noise leads to a motion that is bounded.
    """
    model, known = fit.model, fit.model.settings.process
    highest_hz = float(model.runs[0].omega[-1]) / (2 * np.pi)
    best: float | None = None
    theta, failed = fit.theta, None
    for fraction in known.fractions:
        for corner in known.corners:
            try:
                found = _fit_by_bands(replace(model, process=ProcessNoise(fraction, corner * highest_hz)), theta)
            except NO_FIT as error:
                failed = error
                continue
            likely = found.model.log_likelihood(found.errors, found.theta)
            theta = found.theta
            if best is None or likely > best:
                best = likely
                yield found
    if best is None:
        assert failed is not None  # no fit without an error
        raise failed


def _fit_by_bands(model: Model, theta: FloatArray) -> Fit:
    """Fit the model with the errors weighted band by band by their own rms."""
    known, promise = model.settings.process, model.settings.fit.promise_in_search
    most = model.settings.fit.most_refit_evaluations
    fit = fit_model(model, theta, most_evaluations=most, least_promise=promise)
    likely = -np.inf
    for _ in range(known.n_rounds):
        fit = fit_model(_with_own_levels(fit), fit.theta, most_evaluations=most, least_promise=promise)
        before, likely = likely, fit.model.log_likelihood(fit.errors, fit.theta)
        if likely - before < known.least_gain:
            break
    return fit


def _with_own_levels(fit: Fit) -> Model:
    """Return the model with the rms error of each sensor in each band that a fit leaves."""
    model, rows = fit.model, []
    for index, (run, line) in enumerate(zip(model.runs, fit.errors.lines, strict=True)):
        before = model.process.levels[index] if model.process.levels else np.ones((1, 1))
        own = np.abs(line.reshape(-1, run.omega.size)) * before / np.sqrt(2)
        rows.append(np.array([_compute_band_rms(each, _index_bands(model, index)) for each in own]))
    return replace(model, process=replace(model.process, levels=tuple(rows)))


def _index_bands(model: Model, index: int) -> NDArray[np.int64]:
    known = model.settings.process
    return band_indices(model.runs[index].omega, known.bands_per_octave, known.least_lines)


# a change so large says that nothing is known, and its square is still a number
_FARTHEST = 1e50


def _compute_band_rms(values: FloatArray | ComplexArray, bands: NDArray[np.int64]) -> FloatArray:
    """Return, for each line, the rms magnitude over its band."""
    return np.sqrt(np.bincount(bands, np.abs(values) ** 2) / np.bincount(bands))[bands]


def _fit_pieces(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return the mean square changes of the shared entries, and of the equivalents, in fits to pieces of the runs.

    The parameters of a wrong model depend on the motion: their changes from piece to piece may also occur in another
    run. The equivalents of a run are those of its own motion, so their changes are taken from its own pieces: one run
    may hit a stop that another never reaches. A single run has at least two pieces. If no piece can be fitted, the
    changes are unknown: the entries may change by all of their value, and the equivalents by any amount.
    """
    model, known = fit.model.coarse, fit.model.settings.process
    found, of_equivalents = np.zeros((fit.theta.size, fit.theta.size)), np.full((len(model.runs), 4), np.inf)
    held, kept = with_mass_held(fit)
    count = 0
    for index, (run, motion) in enumerate(zip(fit.model.runs, fit.errors.predictions, strict=True)):
        whole = straight_equivalent(fit.model, index, motion)(fit.theta)
        run, moved_of_run = run.coarse, []
        least = 2 if len(model.runs) == 1 else 1
        for piece in _split_run(run, max(least, min(known.most_pieces, int(run.n_samples / run.fs / known.piece_s)))):
            alone = replace(held, runs=(piece,), repeatability=0.0)
            theta = np.concatenate([fit.theta[kept], np.zeros(alone.n_own)])
            try:
                settings = model.settings.fit
                most, promise = settings.most_refit_evaluations, settings.promise_from_afar
                now = fit_model(alone, theta, most_evaluations=most, least_promise=promise)
            except NO_FIT:
                continue
            moved = np.zeros(fit.theta.size)
            # an entry that a piece does not determine may run off to any value
            moved[kept] = np.clip(now.theta[: len(kept)] - fit.theta[kept], -_FARTHEST, _FARTHEST)
            found += np.outer(moved, moved)
            equivalent = straight_equivalent(alone, 0, now.errors.predictions[0])(now.theta)
            moved_of_run.append(equivalent / whole - 1)
            count += 1
        if moved_of_run:
            of_equivalents[index] = np.sqrt(np.mean(np.square(moved_of_run), axis=0))
    if count == 0:
        unknown = unknown_error(fit)
        return unknown.spread, unknown.of_equivalents
    return found / count, of_equivalents


def _compare_with_equation(fit: Fit) -> FloatArray:
    """Return the relative differences of the equivalents of each run from those of its integrated readings.

    The readings on the body give the force over the mass and, integrated twice, the motion: the equivalent linear
    suspension follows from both without a law. The motion that a wrong law predicts is another one, for which the
    damping has to compensate. Noise biases the equation of motion by some per cent, so that it only widens the
    intervals.
    """
    model, found = fit.model, []
    straight = tuple(replace(group, law=LINEAR, ground=False) for group in model.groups)
    for index, (run, motion) in enumerate(zip(model.runs, fit.errors.predictions, strict=True)):
        expected = straight_equivalent(model, index, motion)(fit.theta)
        below, above = model.correct(fit.theta, index)
        read = replace(run, unsprung=below.value[::2], sprung=above.value, recorded_fs=run.fs, stride=1)
        start = start_values((read,), model.body, straight, mass_free=False, settings=model.settings.start)
        stiffness = float((start.stiffness_beside_ground if model.groups[0].ground else start.stiffness)[0])
        damping = float(start.damping[0])
        omega = float(np.sqrt(stiffness)) if stiffness > 0.0 else np.nan
        found.append(np.array([stiffness, damping, omega / (2 * np.pi), damping / (2 * omega)]) / expected - 1)
    # A suspension with negative stiffness has no frequency, so the difference is infinite.
    return np.nan_to_num(np.abs(found), nan=np.inf)


def _split_run(run: DrivenRun, count: int) -> tuple[DrivenRun, ...]:
    """Return pieces of a run; none if they would be too short for the band."""
    try:
        return run.split(count)
    except InputError:
        return ()


def _compare_equivalents(fit: Fit, moved: FloatArray) -> FloatArray:
    """Return the relative changes of the equivalents of each run due to a change of the vector."""
    found = []
    for index, motion in enumerate(fit.errors.predictions):
        equivalent = straight_equivalent(fit.model, index, motion)
        before, after = equivalent(fit.theta), equivalent(fit.theta + moved)
        found.append(after / before - 1)
    return np.abs(found)


def unknown_error(fit: Fit) -> ModelError:
    """Return the error of a model that is entirely wrong: its entries may have errors as large as their values.

    Args:
        fit: a fitted model.
    """
    return ModelError("model", np.inf, np.diag(fit.theta**2), (), np.full((len(fit.model.runs), 4), np.inf))


def measure_left_out(fit: Fit) -> tuple[LeftOut, ...]:
    """Return how well each run is predicted by the others; nothing for one run, or if a prediction fails.

    The stated error in each band of lines is relative to the prediction. It holds 95 % of the errors of the free motion
    in the worst of the other runs, because a few runs show little of how they differ.
    """
    fits = predict_left_out(replace(fit, model=fit.model.coarse))
    if fits is None:
        return ()
    try:
        own = [free_errors(each)[0] for each in fits]
    except NO_FIT:
        return ()
    bands = [_index_bands(each.model, 0) for each in fits]
    lines = [each.model.runs[0].omega for each in fits]
    # The strength of the motion is that of the prediction itself.
    sizes = [
        np.array([_compute_band_rms(each, band) for each in read - error])
        for (error, read), band in zip(own, bands, strict=True)
    ]
    found = []
    for index, (error, read) in enumerate(own):
        others = [
            (lines[k], np.abs(each) / np.maximum(sizes[k], 1e-300)) for k, (each, _) in enumerate(own) if k != index
        ]
        stated = _compute_widths(others, lines[index], bands[index]) * sizes[index]
        run = fits[index].model.runs[0]
        spectra = tuple(
            _compute_spectrum(run, bands[index], *sensor) for sensor in zip(error, read, stated, strict=True)
        )
        inside = float(np.mean(np.abs(error) <= stated))
        found.append(LeftOut(index, float(np.linalg.norm(error) / np.linalg.norm(read)), inside, spectra))
    return tuple(found)


def _compute_spectrum(
    run: DrivenRun, bands: NDArray[np.int64], error: ComplexArray, read: ComplexArray, stated: FloatArray
) -> LeftOutSpectrum:
    """Return the spectra of one sensor; `stated` holds 95 % of the magnitudes of the lines of `error`."""

    def rms(lines: ComplexArray | FloatArray) -> FloatArray:
        return np.sqrt(np.bincount(bands, np.abs(lines) ** 2) / run.n_samples)

    # A line stands for half of the distance to its neighbours.
    half_hz = run.fs / run.n_samples / 2
    edges_hz = np.r_[
        run.omega[0] / (2 * np.pi) - half_hz, run.omega[np.diff(bands, append=-1) != 0] / (2 * np.pi) + half_hz
    ]
    inside = np.bincount(bands, np.abs(error) <= stated) / np.bincount(bands)
    return LeftOutSpectrum(edges_hz, rms(read), rms(read - error), rms(error), rms(stated), inside)


def _compute_widths(
    others: Sequence[tuple[FloatArray, FloatArray]], omega: FloatArray, bands: NDArray[np.int64]
) -> FloatArray:
    """Return, for each line, the largest 95 % quantile of the relative errors of the other runs in its band.

    Args:
        others: for each run its lines, and its errors over the predictions, (n_sensors, n_lines).
        omega: lines of the run that is predicted.
        bands: number of the band of each line.
    """
    edges = omega[np.flatnonzero(np.diff(bands))] + 1e-9 * omega[-1]
    widest = np.zeros(edges.size + 1)
    for lines, relative in others:
        band_of = np.searchsorted(edges, lines)
        for band in np.unique(band_of):
            widest[band] = max(widest[band], np.quantile(relative[:, band_of == band], 0.95))
    return np.asarray(widest[bands])
