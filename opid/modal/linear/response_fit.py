"""Linear modes from measured frequency responses: natural frequencies, damping ratios and mass-normalised shapes.

sdypy-EMA gives the poles at many orders (LSCF, Verboven 2002). Those that stay from order to order begin a fit of

    H = sum phi phi_d (-w^2) / (w_r^2 - w^2 + 2j zeta_r w_r w) + a - b w^2

to all responses at once by maximum likelihood, with a delay of the accelerations behind the force, and of a sensor
after the others where the responses ask for it; a and b are real and stand for the modes below and above the band. The
residues are eliminated (variable projection, Golub & Pereyra 1973). Where a mode leaves more than noise, two modes of
unlike shapes are tried in its place.
Each line is weighted by its noise, which has a part that grows with the response, as the noise of the force does. The
intervals are those of the sandwich over cells of neighbouring lines of all responses, because the noise of the force is
the same for all sensors.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from opid.errors import InputError, NotDeterminedError, list_names, require
from opid.estimate import Estimate
from opid.mechanics.structure import ComplexArray, modal_assurance
from opid.modal.linear.fitted_modes import (
    RESPONSE_FIT,
    FittedModes,
    FittedResidues,
    ResponseFitSettings,
    SensorMisfit,
)
from opid.modal.linear.frequency_response import FrequencyResponse
from opid.modal.linear.mode_shapes import shape_modes
from opid.modal.linear.modes import ACCELERATION
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray, has_usual_size

DELAY_S = 1e-5
"""Unit of the delay in the vector of unknowns, s."""


def fit_modes(
    responses: Sequence[FrequencyResponse],
    *,
    band_hz: tuple[float, float],
    settings: ResponseFitSettings = RESPONSE_FIT,
) -> FittedModes:
    """Return the linear modes of measured responses to forces at one or several drive points.

    Args:
        responses: accelerance of the same sensors at the same lines for each drive point, which is one of the sensors.
        band_hz: lowest and highest frequency of the fit; it should begin and end between modes.
        settings: tuned numbers.

    Raises:
        InputError: no response, responses of other sensors or lines, a drive point without a sensor, or an empty band.
        NotDeterminedError: no mode in the band, or modes that do not explain the responses.
    """
    data = _Data.of(responses, band_hz)
    left_at_end = max(each.left_at_end for each in responses)
    if left_at_end > MODAL.most_left:
        raise InputError(
            f"a record ends with {100 * left_at_end:.0f} % of its largest motion, and at most "
            f"{100 * MODAL.most_left:g} % are accepted: record until the structure is at rest"
        )
    try:
        begun = _find_poles(data, settings)
    except np.linalg.LinAlgError as error:
        raise NotDeterminedError(
            f"no poles fit the responses ({error}): see whether force and motion were recorded as they were"
        ) from error
    if not begun.size:
        raise NotDeterminedError(
            f"no pole between {band_hz[0]:g} and {band_hz[1]:g} Hz stays the same over {settings.fewest_orders} "
            "orders: take another band, average more records, or see whether the structure was driven there"
        )
    fit = _drop_weak(_fit_poles(data, begun, np.zeros(1), settings), settings)
    late = _free_late_sensors(fit, settings)
    fit = fit if late is fit else _drop_weak(late, settings)
    fit = _split_close_modes(fit, settings)
    left = fit.unexplained(settings)
    if max(left) > settings.most_left:
        raise NotDeterminedError(
            f"{len(fit.poles)} modes leave {100 * max(left):.0f} % of the responses, and at most "
            f"{100 * settings.most_left:.0f} % are accepted: take a narrower band that begins and ends between modes, "
            "and see whether records begin at rest and have decayed at their ends"
        )
    return shape_modes(fit.describe(settings, left), settings)


def _drop_weak(fit: _Fit, settings: ResponseFitSettings) -> _Fit:
    """Return the fit without the modes that are not above their noise."""
    while (weakest := fit.find_weakest(settings)) is not None:
        if len(fit.poles) == 1:
            raise NotDeterminedError("no mode in the band is above the noise: average more records, or drive harder")
        # Two poles of one mode are both weak, and only one of them is too many.
        fit = _fit_poles(fit.data, np.delete(fit.poles, weakest, axis=0), fit.delays_s, settings)
    return fit


def _split_close_modes(fit: _Fit, settings: ResponseFitSettings) -> _Fit:
    """Return the fit with two poles in the place of one where two modes explain what one leaves beyond noise.

    A clipped record is that of no linear structure, however many modes it has. Two poles also explain one mode whose
    frequency moves with the level, but with one shape.
    """
    if any(each.has_clipped_force or each.clipped_sensors for each in fit.data.responses):
        return fit
    for mode in np.flatnonzero(fit.find_beyond_noise(settings).any(axis=0)).tolist():
        if (two := fit.find_two_poles(mode, settings)) is None:
            continue
        poles = np.concatenate([np.delete(fit.poles, mode, axis=0), two])
        tried = _fit_poles(fit.data, poles[np.argsort(poles[:, 0])], fit.delays_s, settings)
        if tried.find_weakest(settings) is None:
            return _split_close_modes(tried, settings)
    return fit


def _free_late_sensors(fit: _Fit, settings: ResponseFitSettings) -> _Fit:
    """Return the fit with a delay of its own for each sensor whose responses ask for it beyond doubt."""
    refused: set[int] = set()
    while (found := fit.find_late_sensor(settings, refused)) is not None:
        sensor, delay_s = found
        data = replace(fit.data, late=(*fit.data.late, sensor))
        tried = _fit_poles(data, fit.poles, np.append(fit.delays_s, delay_s), settings)
        own = tried.list_delays(settings)[-1]
        if abs(own.value or 0.0) > MODAL.delay_sigma * (own.std or np.inf):
            fit = tried
        else:
            refused.add(sensor)
    return fit


@dataclass(frozen=True, eq=False)
class _Data:
    """The lines of the band.

    Args:
        responses: the measured responses in the band, one for each drive point.
        omega: (n_lines,) rad/s.
        value: (n_pairs, n_lines) their values, the sensors of one drive point after the other.
        band_hz: the band.
        late: sensors that have a delay of their own beside that of all.
    """

    responses: tuple[FrequencyResponse, ...]
    omega: FloatArray
    value: ComplexArray
    band_hz: tuple[float, float]
    late: tuple[int, ...] = ()

    @classmethod
    def of(cls, responses: Sequence[FrequencyResponse], band_hz: tuple[float, float]) -> _Data:
        if not responses:
            raise InputError("there is no response: give one for each drive point")
        first = responses[0]
        for each in responses:
            if each.sensors != first.sensors or not np.array_equal(each.frequency_hz, first.frequency_hz):
                raise InputError(
                    f"the responses to {each.drive_point!r} and {first.drive_point!r} have other sensors or lines: use "
                    "records of one length and rate with the same sensors"
                )
            if each.drive_point not in each.sensors:
                raise InputError(
                    f"no sensor is called {each.drive_point!r}, where the force acts: its response gives the modal "
                    f"masses; the sensors are {list_names(map(repr, each.sensors))}"
                )
        low, high = band_hz
        if not 0.0 <= low < high < np.inf:
            raise InputError(
                f"the band is {low:g} to {high:g} Hz: give its lower end first, and two finite numbers from 0 up"
            )
        known = np.isfinite(np.stack([each.value for each in responses])).all(axis=(0, 2))
        lines = known & (first.frequency_hz >= low) & (first.frequency_hz <= high) & (first.frequency_hz > 0)
        if lines.sum() < 16:
            raise InputError(
                f"{int(lines.sum())} lines lie between {low:g} and {high:g} Hz and at least 16 are needed: take a "
                "wider band or longer records"
            )
        value = np.concatenate([each.value[lines].T for each in responses])
        silent = np.flatnonzero(~value.any(axis=1))
        if silent.size:
            name = first.sensors[int(silent[0]) % len(first.sensors)]
            raise InputError(f"the sensor {name!r} does not move in the band: leave its channel out of the logs")
        if not has_usual_size(value):
            raise InputError(
                f"the responses reach {np.abs(value).max():.3g} (m/s^2)/N, which no structure does: correct the units "
                "of force and motion"
            )
        within = tuple(
            replace(
                each,
                frequency_hz=each.frequency_hz[lines],
                value=each.value[lines],
                coherence=None if each.coherence is None else each.coherence[lines],
            )
            for each in responses
        )
        return cls(within, 2 * np.pi * first.frequency_hz[lines], value, (low, high))

    @property
    def delayed(self) -> FloatArray:
        """(n_pairs, n_delays) 1 where a delay acts on a pair: that of all sensors, then that of each late one."""
        sensors = np.arange(len(self.responses[0].sensors))
        columns = [np.ones(sensors.size), *(np.equal(sensors, own).astype(float) for own in self.late)]
        return np.tile(np.stack(columns, axis=1), (len(self.responses), 1))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of the second derivative of each sensor's reading."""
        first = self.responses[0]
        return first.units or (ACCELERATION,) * len(first.sensors)


def _find_poles(data: _Data, settings: ResponseFitSettings) -> FloatArray:
    """Return frequency (Hz) and damping ratio of the poles that stay from order to order, (n, 2)."""
    require("sdypy", "linear modes from frequency responses", "sdypy-EMA", "ema")
    from sdypy import EMA

    lines_hz = data.omega / (2 * np.pi)
    found = EMA.Model(
        data.value,
        lines_hz,
        lower=lines_hz[0],
        upper=lines_hz[-1],
        pol_order_high=settings.highest_order,
        frf_form="accelerance",
    )
    found.get_poles(method="lscf", show_progress=False)
    chains: list[list[tuple[int, float, float]]] = []
    for order, (frequencies, ratios) in enumerate(zip(found.pole_freq, found.pole_xi, strict=True)):
        for frequency_hz, ratio in zip(np.asarray(frequencies).tolist(), np.asarray(ratios).tolist(), strict=True):
            if not (data.band_hz[0] <= frequency_hz <= data.band_hz[1] and 0.0 < ratio < settings.most_damping):
                continue
            for chain in chains:
                last, before_hz, before = chain[-1]
                same = abs(frequency_hz / before_hz - 1) < settings.same_frequency
                if last == order - 1 and same and abs(ratio / before - 1) < settings.same_damping:
                    chain.append((order, frequency_hz, ratio))
                    break
            else:
                chains.append([(order, frequency_hz, ratio)])
    stable = [chain for chain in chains if len(chain) >= settings.fewest_orders]
    stable.sort(key=len, reverse=True)
    poles: list[tuple[float, float]] = []
    for chain in stable:
        middle = np.median(np.array(chain)[:, 1:], axis=0)
        apart = max(settings.same_frequency, settings.same_mode * float(middle[1]))
        if all(abs(middle[0] / other[0] - 1) > apart for other in poles):
            poles.append((float(middle[0]), float(middle[1])))
    return np.array(sorted(poles)).reshape(-1, 2)


def _fit_poles(data: _Data, poles: FloatArray, delays_s: FloatArray, settings: ResponseFitSettings) -> _Fit:
    """Return the fit of all responses that begins at some poles and delays."""
    weight = np.broadcast_to(1 / np.sqrt(np.mean(np.abs(data.value) ** 2, axis=1)), data.value.shape[::-1]).T
    for _ in range(settings.n_weightings):
        fit = _minimize(data, poles, delays_s, weight, settings)
        poles, delays_s, weight = fit.poles, fit.delays_s, fit.weigh()
    return _minimize(data, poles, delays_s, weight, settings)


def _minimize(
    data: _Data, poles: FloatArray, delays_s: FloatArray, weight: FloatArray, settings: ResponseFitSettings
) -> _Fit:
    """Return the fit of least squares, by Gauss-Newton steps that are damped where they do not help.

    A step needs the products of the derivatives with each other and with the errors only, which are summed pair by
    pair: the derivatives of all responses together have a hundred thousand rows.
    """
    n_poles = 2 * len(poles)
    begun = np.append(np.log(poles).ravel(), delays_s / DELAY_S)
    # Poles that move by more than this have left their mode.
    reach = np.append(np.tile([0.02, 2.0], len(poles)), np.full(delays_s.size, 1e3))

    def evaluate(theta: FloatArray) -> _Fit:
        return _Fit.at(data, np.exp(theta[:n_poles].reshape(-1, 2)), DELAY_S * theta[n_poles:], weight)

    theta, fit, damping = begun, evaluate(begun), 0.0
    for _ in range(settings.most_steps):
        curvature, slope = fit.find_normal_equations()
        scale = 1.0 / np.sqrt(np.maximum(np.diag(curvature), np.finfo(float).tiny))
        scaled = curvature * np.outer(scale, scale)
        improved = False
        while not improved and damping < settings.most_damped:
            whole = np.linalg.lstsq(scaled + damping * np.eye(theta.size), -slope * scale, rcond=1e-14)[0] * scale
            step = np.clip(theta + whole, begun - reach, begun + reach) - theta
            # What a step is worth beside the noise: its square over the covariance of the unknowns.
            size = float(step @ curvature @ step) / (fit.cost / fit.error.size)
            if size < settings.least_step**2:
                return fit
            tried = evaluate(theta + step)
            improved = tried.cost < fit.cost
            damping = 0.1 * damping if improved else max(10.0 * damping, settings.least_damped)
        if not improved:
            return fit
        theta, fit = theta + step, tried
    return fit


@dataclass(frozen=True, eq=False)
class _Fit:
    """The best residues for some poles.

    Args:
        poles: (n_modes, 2) frequency (Hz) and damping ratio.
        delays_s: (n_delays,) delay of the accelerations behind the force, s, and of each late sensor after the others.
        aligned: (n_pairs, n_lines) the responses without their delays.
        weight: (n_pairs, n_lines) one over the standard deviation of the noise.
        shape: (2 n_lines, n_columns) real and imaginary part of each mode for a unit residue, then of a and b.
        slopes: (2 n_lines, 2 n_modes) its derivatives by the logarithms of frequency and damping ratio of each mode.
        by_delay: (2 n_lines, n_columns) its derivative by a delay, 1/s.
        residues: (n_pairs, n_columns).
        error: (n_pairs, 2 n_lines) weighted errors.
        inverses: (n_pairs, n_columns, n_columns) inverse of the triangular factor of the weighted columns of a pair,
            which makes them orthonormal.
    """

    data: _Data
    poles: FloatArray
    delays_s: FloatArray
    aligned: ComplexArray
    weight: FloatArray
    shape: FloatArray
    slopes: FloatArray
    by_delay: FloatArray
    residues: FloatArray
    error: FloatArray
    inverses: FloatArray

    @classmethod
    def at(cls, data: _Data, poles: FloatArray, delays_s: FloatArray, weight: FloatArray) -> _Fit:
        omega, own = data.omega[:, np.newaxis], 2 * np.pi * poles[:, 0]
        # The responses are put forward, so that all pairs have the same columns.
        aligned = data.value * np.exp(1j * (data.delayed @ delays_s)[:, np.newaxis] * data.omega)
        dynamic = own**2 - omega**2 + 2j * poles[:, 1] * own * omega
        mode = -(omega**2) / dynamic
        by_frequency = -mode / dynamic * (2 * own**2 + 2j * poles[:, 1] * own * omega)
        by_damping = -mode / dynamic * (2j * poles[:, 1] * own * omega)
        rest = np.stack([np.ones(omega.size), -((data.omega / data.omega[-1]) ** 2)], axis=1)
        columns = np.concatenate([mode, rest], axis=1)
        shape, by_delay = _split(columns), _split(-1j * omega * columns)
        slopes = _split(np.stack([by_frequency, by_damping], axis=2).reshape(omega.size, -1))
        read, both = _split(aligned.T).T, np.concatenate([weight, weight], axis=1)
        n_columns, weighted = shape.shape[1], both * read
        inverses, residues = np.empty((len(read), n_columns, n_columns)), np.empty((len(read), n_columns))
        for pair, (own, row) in enumerate(zip(both, weighted, strict=True)):
            # The triangle of the columns and the response together holds all that the residues need.
            stacked = np.column_stack([own[:, np.newaxis] * shape, row])
            triangle: FloatArray = np.asarray(np.linalg.qr(stacked, mode="r"))
            inverses[pair] = np.linalg.inv(triangle[:n_columns, :n_columns])
            residues[pair] = inverses[pair] @ triangle[:n_columns, n_columns]
        error = weighted - both * (residues @ shape.T)
        return cls(data, poles, delays_s, aligned, weight, shape, slopes, by_delay, residues, error, inverses)

    @property
    def cost(self) -> float:
        """Sum of the squared errors."""
        return float(np.sum(self.error**2))

    def make_responses(self) -> ComplexArray:
        """Return the responses of the modes without delays, (n_pairs, n_lines)."""
        return _join(self.shape @ self.residues.T).T

    def _list_columns(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the orthonormal basis of the weighted columns of each pair, and the derivatives of its response.

        The derivatives (2 n_lines, 2 n_modes + n_delays) are those of the weighted response by poles and delays at
        fixed residues.
        """
        n_modes, weights = len(self.poles), np.concatenate([self.weight, self.weight], axis=1)
        for weight, residues, inverse, delayed in zip(
            weights, self.residues, self.inverses, self.data.delayed, strict=True
        ):
            own = weight[:, np.newaxis]
            late = np.outer(self.by_delay @ residues * DELAY_S, delayed)
            slopes = np.column_stack([self.slopes * np.repeat(residues[:n_modes], 2), late])
            yield (own * self.shape) @ inverse, own * slopes

    def find_normal_equations(self) -> tuple[FloatArray, FloatArray]:
        """Return the products of the derivatives of the errors with each other and with the errors (Kaufman 1975)."""
        n = 2 * len(self.poles) + self.delays_s.size
        curvature, slope = np.zeros((n, n)), np.zeros(n)
        for (basis, by_poles), error in zip(self._list_columns(), self.error, strict=True):
            along = basis.T @ by_poles
            curvature += by_poles.T @ by_poles - along.T @ along
            # The errors have no part along the basis.
            slope -= by_poles.T @ error
        return curvature, slope

    def weigh(self) -> FloatArray:
        """Return one over the noise of each line: a constant part of each pair, and one that grows as it responds."""
        made = self.make_responses()
        read, size = np.abs(self.aligned - made) ** 2, np.abs(made) ** 2
        variance = np.empty_like(read)
        for pair, (left, of) in enumerate(zip(read, size, strict=True)):
            # Squared errors scatter as much as they are large, so each is divided by what is expected of it.
            expected = np.full(left.size, left.mean())
            for _ in range(3):
                columns = np.stack([np.ones(left.size), of], axis=1) / expected[:, np.newaxis]
                parts, _ = optimize.nnls(columns, left / expected)
                expected = np.maximum(parts[0] + parts[1] * of, 1e-6 * left.mean())
            variance[pair] = expected
        return np.asarray(1 / np.sqrt(np.maximum(variance / 2, 1e-300)))

    def unexplained(self, settings: ResponseFitSettings) -> tuple[float, ...]:
        """Return the rms fraction of the responses that is left, for each drive point; strains count like motions.

        Sensors whose shapes are withheld do not count, as long as they are fewer than half.
        """
        left = np.abs(self.aligned - self.make_responses()) ** 2
        n = len(self.data.responses)
        counts = np.array([each.excess <= settings.most_left for each in self._find_misfits()])
        counts |= 2 * counts.sum() <= counts.size
        kinds = [np.equal(self.data.units, unit) & counts for unit in dict.fromkeys(self.data.units)]
        return tuple(
            float(np.sqrt(np.mean([one[kind].sum() / (np.abs(of[kind]) ** 2).sum() for kind in kinds if kind.any()])))
            for one, of in zip(np.split(left, n), np.split(self.data.value, n), strict=True)
        )

    def covariances(self, settings: ResponseFitSettings) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of the logarithms of the poles, and the standard deviations of the residues."""
        n_lines = self.data.omega.size
        cells = np.tile(np.arange(n_lines) // settings.lines_per_cell, 2)
        n_cells = int(cells.max()) + 1
        inverse = np.linalg.inv(self.find_normal_equations()[0])
        scores = np.zeros((n_cells, inverse.shape[0]))
        own_scores, influences = np.zeros((len(self.error), n_cells, self.shape.shape[1])), []
        for pair, (basis, by_poles) in enumerate(self._list_columns()):
            error = self.error[pair][:, np.newaxis]
            along = basis.T @ by_poles
            np.add.at(scores, cells, (basis @ along - by_poles) * error)
            np.add.at(own_scores[pair], cells, basis * error)
            influences.append(self.inverses[pair] @ along)
        moved = scores @ inverse
        stds = np.empty_like(self.residues)
        for pair, by_pole in enumerate(influences):
            influence = own_scores[pair] @ self.inverses[pair].T + moved @ by_pole.T
            # the lines about a narrow mode are few, and what they scatter may be less than their noise
            by_noise = np.sum(self.inverses[pair] ** 2, axis=1)
            stds[pair] = np.sqrt(np.maximum(np.sum(influence**2, axis=0), by_noise))
        return moved.T @ moved, stds

    def find_weakest(self, settings: ResponseFitSettings) -> int | None:
        """Return the mode that stands least above its noise, or is damped too much; None if all are clear."""
        _, stds = self.covariances(settings)
        n_modes = len(self.poles)
        size = np.max(np.abs(self.residues[:, :n_modes]) / np.maximum(stds[:, :n_modes], 1e-300), axis=0)
        size = np.where(self.poles[:, 1] > settings.most_damping, 0.0, size)
        weakest = int(np.argmin(size))
        return weakest if size[weakest] < settings.least_std else None

    def find_late_sensor(self, settings: ResponseFitSettings, known: Collection[int]) -> tuple[int, float] | None:
        """Return the sensor that a delay of its own would help most, beyond noise, and that delay, s; None without one.

        Poles, weights and the delay of all sensors stay. A delay must explain more of what the modes leave of the
        sensor than remains beyond noise, or something else is wrong with it.

        Args:
            settings: tuned numbers.
            known: sensors that are not asked.
        """
        n_sensors = len(self.data.responses[0].sensors)
        if n_sensors - len(self.data.late) < 2:
            return None  # The delay of all sensors is that of the only one that is left.
        bases = [_join(basis) for basis, _ in self._list_columns()]
        misfits = self._find_misfits()
        best, most = None, MODAL.delay_sigma**2
        for sensor in set(range(n_sensors)) - {*known, *self.data.late}:
            search = _DelaySearch(
                self.data.omega,
                [(bases[pair], self.weight[pair], self.aligned[pair]) for pair in range(sensor, len(bases), n_sensors)],
            )
            delay_s = search.find(settings, 2 * np.pi * float(self.poles[:, 0].max()))
            gain = search.explain(delay_s) - search.explain(0.0)
            before, after = (search.find_left(each) for each in (0.0, delay_s))
            if gain > most and before - after > max(after - misfits[sensor].noise ** 2, 0.0):
                best, most = (sensor, delay_s), gain
        return best

    def list_delays(self, settings: ResponseFitSettings) -> list[Estimate]:
        """Return the delay of all sensors behind the force, and that of each late sensor after the others, s.

        The interval of the latter also holds a turn of the phase that modes beyond the band and damping that couples
        modes make.
        """
        std = DELAY_S * np.sqrt(np.diag(self.covariances(settings)[0])[2 * len(self.poles) :])
        middle = 2 * np.pi * float(np.sqrt(self.poles[:, 0].min() * self.poles[:, 0].max()))
        std[1:] = np.hypot(std[1:], MODAL.delay_phase_std / middle)
        return [Estimate.normal(value, own) for value, own in zip(self.delays_s.tolist(), std.tolist(), strict=True)]

    def _split_left(self) -> tuple[FloatArray, FloatArray]:
        """Return the squares of what the modes leave at each line, and of what noise leaves, (n_pairs, n_lines) each.

        Where records were averaged, their coherence shows the noise. Otherwise it is what differs from line to line, in
        the second differences of what is left: what the modes do not explain is smooth.
        """
        left = self.aligned - self.make_responses()
        noise = np.pad(np.abs(np.diff(left, 2, axis=1)) ** 2 / 6, ((0, 0), (1, 1)), mode="edge")
        for response, own, read in zip(
            self.data.responses,
            *(np.split(each, len(self.data.responses)) for each in (noise, self.aligned)),
            strict=True,
        ):
            if response.coherence is not None:
                known = np.maximum(response.coherence.T, np.finfo(float).eps)
                own[:] = np.abs(read) ** 2 * (1 / known - 1) / max(response.n_averages - 1, 0.5)
        return np.abs(left) ** 2, noise

    def _find_misfits(self) -> tuple[SensorMisfit, ...]:
        """Return what the modes leave of the response of each sensor, and what noise leaves."""
        shape = (len(self.data.responses), -1, self.data.omega.size)
        squares = (*self._split_left(), np.abs(self.aligned) ** 2)
        left, noise, whole = (each.reshape(shape).sum(axis=(0, 2)) for each in squares)
        of_whole = np.sqrt(np.stack([left, noise]) / np.maximum(whole, 1e-300))
        return tuple(SensorMisfit(*each) for each in of_whole.T.tolist())

    def _find_near(self, settings: ResponseFitSettings) -> NDArray[np.bool_]:
        """Return the lines about each mode, (n_modes, n_lines)."""
        off = np.abs(self.data.omega / (2 * np.pi * self.poles[:, :1]) - 1)
        return off <= np.maximum(settings.near * self.poles[:, 1:], off.min(axis=1, keepdims=True))

    def find_beyond_noise(self, settings: ResponseFitSettings) -> FloatArray:
        """Return the power that noise does not explain about each mode, (n_pairs, n_modes)."""
        near = self._find_near(settings).T.astype(float)
        of_left, of_noise = (each @ near for each in self._split_left())
        return np.where(of_left > MODAL.most_misfit**2 * of_noise, of_left - of_noise, 0.0)

    def find_two_poles(self, mode: int, settings: ResponseFitSettings) -> FloatArray | None:
        """Return two poles (2, 2) of unlike shapes and like size that leave far less about a mode than its own does.

        There are none, None, if no such poles do. They are fitted to the lines about it alone, and what the other modes
        do there stays.

        Args:
            mode: index of the mode.
            settings: tuned numbers.
        """
        own_hz, ratio = self.poles[mode]
        off = np.abs(self.data.omega / (2 * np.pi * own_hz) - 1)
        lines, near = off <= settings.split_width * ratio, self._find_near(settings)[mode]
        apart = settings.split_distance * ratio * np.array([-1.0, 1.0])
        two = np.stack([own_hz * (1 + apart), np.full(2, ratio)], axis=1)
        if lines.sum() < settings.fewest_lines:
            return None
        others = np.delete(np.arange(self.residues.shape[1]), mode)
        alone = self.aligned - _join(self.shape[:, others] @ self.residues[:, others].T).T
        data = replace(self.data, omega=self.data.omega[lines], value=alone[:, lines], late=())
        found = _minimize(data, two, np.zeros(1), self.weight[:, lines], settings)
        squares, noise = self._split_left()
        left = np.zeros_like(squares)
        left[:, lines] = np.abs(found.aligned - found.make_responses()) ** 2
        size = np.mean(np.abs(self.aligned) ** 2, axis=1, keepdims=True)  # strains count like motions
        before, after = (float(((each - noise) / size)[:, near].sum()) for each in (squares, left))
        shapes = found.residues[:, :2] / np.sqrt(size)
        lesser, greater = sorted(np.linalg.norm(shapes, axis=0).tolist())
        is_pair = lesser > settings.split_part * greater and modal_assurance(shapes)[0, 1] < settings.split_alike
        return found.poles if is_pair and after < settings.split_left * before else None

    def _find_residue_errors(self, settings: ResponseFitSettings) -> FloatArray:
        """Return the errors of residues by what noise does not explain about each mode, (n_pairs, n_modes)."""
        modes = np.abs(_join(self.shape)[:, : len(self.poles)]) ** 2
        of_power = self.find_beyond_noise(settings) / np.sum(modes.T * self._find_near(settings), axis=1)
        return np.asarray(settings.hidden_part * np.sqrt(of_power))

    def describe(self, settings: ResponseFitSettings, left: tuple[float, ...]) -> FittedResidues:
        """Return what was found, with the standard deviations of all of it."""
        covariance, stds = self.covariances(settings)
        n_modes, data = len(self.poles), self.data
        n_drives, sensors = len(data.responses), data.responses[0].sensors
        residues, of_residues = (each[:, :n_modes].reshape(n_drives, -1, n_modes) for each in (self.residues, stds))
        delay, *own = self.list_delays(settings)
        of_late = dict(zip(data.late, own, strict=True))
        late = np.exp(-1j * (data.delayed @ self.delays_s)[:, np.newaxis] * data.omega)
        values = np.split((self.make_responses() * late).T, n_drives, axis=1)
        return FittedResidues(
            self.poles,
            np.sqrt(np.diag(covariance))[: 2 * n_modes].reshape(-1, 2),
            residues,
            of_residues,
            self._find_residue_errors(settings).reshape(residues.shape),
            self._find_misfits(),
            data.responses,
            tuple(
                FrequencyResponse(each.frequency_hz, value, sensors, each.drive_point, n_averages=0, units=data.units)
                for each, value in zip(data.responses, values, strict=True)
            ),
            data.units,
            data.band_hz,
            delay,
            tuple(of_late.get(sensor, Estimate()) for sensor in range(len(sensors))),
            left,
        )


@dataclass(frozen=True, eq=False)
class _DelaySearch:
    """The search for the delay of one sensor, while the poles and the delay of all sensors stay.

    Args:
        omega: (n_lines,) rad/s.
        pairs: for each drive point the orthonormal columns (n_lines, n_columns), the weights, and the response.
    """

    omega: FloatArray
    pairs: Sequence[tuple[ComplexArray, FloatArray, ComplexArray]]

    def find(self, settings: ResponseFitSettings, highest: float) -> float:
        """Return the delay with which the modes explain most, s; `highest` is the frequency of the last mode, rad/s."""
        reach = settings.farthest_turn / highest
        grid = np.linspace(-reach, reach, 2 * round(settings.farthest_turn * settings.turns) + 1)
        turns, step = np.exp(1j * grid[:, np.newaxis] * self.omega), grid[1] - grid[0]
        along = [np.sum(self._project(turns, pair) ** 2, axis=1) for pair in self.pairs]
        near = grid[int(np.argmax(np.sum(along, axis=0)))]
        found = optimize.minimize_scalar(
            lambda delay_s: -self.explain(delay_s), bounds=(near - step, near + step), method="bounded"
        )
        return float(found.x)

    def explain(self, delay_s: float) -> float:
        """Return the part of the squared weighted responses that the modes explain with a delay."""
        turn = np.exp(1j * self.omega * delay_s)
        return sum(float(np.sum(self._project(turn, pair) ** 2)) for pair in self.pairs)

    def find_left(self, delay_s: float) -> float:
        """Return the fraction of the squared responses, without weights, that is left with a delay."""
        turn, left, whole = np.exp(1j * self.omega * delay_s), 0.0, 0.0
        for columns, weight, response in self.pairs:
            made = columns @ self._project(turn, (columns, weight, response)) / weight
            left += float(np.sum(np.abs(turn * response - made) ** 2))
            whole += float(np.sum(np.abs(response) ** 2))
        return left / max(whole, 1e-300)

    @staticmethod
    def _project(turns: ComplexArray, pair: tuple[ComplexArray, FloatArray, ComplexArray]) -> FloatArray:
        """Return the part of a turned response along each column."""
        columns, weight, response = pair
        return (turns @ (columns.conj() * (weight * response)[:, np.newaxis])).real


def _split(value: ComplexArray) -> FloatArray:
    """Return the real parts of complex rows, then their imaginary parts."""
    return np.concatenate([value.real, value.imag])


def _join(value: FloatArray) -> ComplexArray:
    """Return complex rows from their real parts, then their imaginary parts."""
    real, imaginary = np.split(value, 2)
    return np.asarray(real + 1j * imaginary)
