"""Linear modes from measured frequency responses: natural frequencies, damping ratios and mass-normalised shapes.

sdypy-EMA gives the poles at many orders (LSCF, Verboven 2002). Those that stay from order to order begin a fit of

    H = sum phi phi_d (-w^2) / (w_r^2 - w^2 + 2j zeta_r w_r w) + a - b w^2

to all responses at once by maximum likelihood, with a delay of the accelerations behind the force; a and b are real and
stand for the modes below and above the band. The residues are eliminated (variable projection, Golub & Pereyra 1973).
Each line is weighted by its noise, which has a part that grows with the response, as the noise of the force does. The
intervals are those of the sandwich over cells of neighbouring lines of all responses, because the noise of the force is
the same for all sensors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from opid.errors import InputError, NotDeterminedError, list_names, require
from opid.estimate import Estimate
from opid.mechanics.structure import ComplexArray
from opid.modal.linear.fitted_modes import FittedModes
from opid.modal.linear.frequency_response import FrequencyResponse
from opid.modal.linear.modes import ACCELERATION
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

DELAY_S = 1e-5
"""Unit of the delay in the vector of unknowns, s."""


@dataclass(frozen=True)
class ResponseFitSettings:
    """How linear modes are found in frequency responses.

    Args:
        highest_order: highest order of the poles; two thirds of them are mathematical.
        same_frequency: a pole is that of the order before if its frequency differs by less, relative ...
        same_damping: ... and its damping ratio by less, relative.
        same_mode: two poles are of one mode if they are closer than this multiple of its damping ratio, relative.
        fewest_orders: a mode stands in so many orders; of a noisy response a mathematical pole stays for three or four.
        most_damping: poles with a larger damping ratio describe no mode of a structure.
        most_steps: steps of a fit at the most; it takes three to ten.
        least_step: a fit ends where its next step is shorter than this many standard deviations of the unknowns.
        least_damped: damping of a step after one that did not help, over the diagonal of the normal equations ...
        most_damped: ... and the damping from which no step helps any more.
        n_weightings: how often the noise of the lines is estimated and the fit repeated.
        lines_per_cell: number of neighbouring lines whose noise may be correlated: a mode is some lines wide.
        least_std: a mode whose largest residue is below so many standard deviations is left out.
        least_coherence: median coherence about a resonance below which the records differ by more than noise: that of
            joints that slip was 0.984 to 0.998, that of linear modes with noise of 1 % above 0.9999.
        near: half of the width about a resonance, in damping ratios, in which it is taken.
        most_left: rms fraction of the responses that the modes may leave before nothing is reported.
        gain: relative standard deviation of a residue by the calibrations of force and acceleration, each good to 1 %.
        complexity: standard deviation of a natural frequency, over the square of its damping ratio: damping couples
            modes, whose frequencies without damping are others by about so much.
        left_at_end: relative standard deviation of a damping ratio by what a record still holds when it ends, a
            thousandth of its peak, and by a weak window of the recorder.
    """

    highest_order: int = 60
    same_frequency: float = 0.002
    same_damping: float = 0.1
    same_mode: float = 0.5
    fewest_orders: int = 8
    most_damping: float = 0.2
    most_steps: int = 60
    least_step: float = 1e-4
    least_damped: float = 1e-4
    most_damped: float = 1e6
    n_weightings: int = 3
    lines_per_cell: int = 8
    least_std: float = 6.0
    least_coherence: float = 0.999
    near: float = 2.0
    most_left: float = 0.3
    gain: float = 0.014
    complexity: float = 2.0
    left_at_end: float = 0.002


def fit_modes(
    responses: Sequence[FrequencyResponse],
    *,
    band_hz: tuple[float, float],
    settings: ResponseFitSettings = ResponseFitSettings(),
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
    begun = _find_poles(data, settings)
    if not begun.size:
        raise NotDeterminedError(
            f"no pole between {band_hz[0]:g} and {band_hz[1]:g} Hz stays the same over {settings.fewest_orders} "
            "orders: take another band, average more records, or see whether the structure was driven there"
        )
    fit = _fit_poles(data, begun, settings)
    while (weakest := fit.find_weakest(settings)) is not None:
        if len(fit.poles) == 1:
            raise NotDeterminedError("no mode in the band is above the noise: average more records, or drive harder")
        # Two poles of one mode are both weak, and only one of them is too many.
        fit = _fit_poles(data, np.delete(fit.poles, weakest, axis=0), settings)
    left = fit.unexplained()
    if max(left) > settings.most_left:
        raise NotDeterminedError(
            f"{len(fit.poles)} modes leave {100 * max(left):.0f} % of the responses, and at most "
            f"{100 * settings.most_left:.0f} % are accepted: take a narrower band that begins and ends between modes, "
            "and see whether records begin at rest and have decayed at their ends"
        )
    return fit.result(settings, left)


@dataclass(frozen=True, eq=False)
class _Data:
    responses: tuple[FrequencyResponse, ...]
    omega: FloatArray
    value: ComplexArray
    band_hz: tuple[float, float]

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
    def drives(self) -> list[int]:
        """Row of the sensor at each drive point."""
        sensors = self.responses[0].sensors
        return [d * len(sensors) + sensors.index(each.drive_point) for d, each in enumerate(self.responses)]

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


def _fit_poles(data: _Data, poles: FloatArray, settings: ResponseFitSettings) -> _Fit:
    """Return the fit of all responses that begins at some poles."""
    delay_s = 0.0
    weight = np.broadcast_to(1 / np.sqrt(np.mean(np.abs(data.value) ** 2, axis=1)), data.value.shape[::-1]).T
    for _ in range(settings.n_weightings):
        fit = _minimize(data, poles, delay_s, weight, settings)
        poles, delay_s, weight = fit.poles, fit.delay_s, fit.weigh()
    return _minimize(data, poles, delay_s, weight, settings)


def _minimize(
    data: _Data, poles: FloatArray, delay_s: float, weight: FloatArray, settings: ResponseFitSettings
) -> _Fit:
    """Return the fit of least squares, by Gauss-Newton steps that are damped where they do not help.

    A step needs the products of the derivatives with each other and with the errors only, which are summed pair by
    pair: the derivatives of all responses together have a hundred thousand rows.
    """
    begun = np.append(np.log(poles).ravel(), delay_s / DELAY_S)
    # Poles that move by more than this have left their mode.
    reach = np.append(np.tile([0.02, 2.0], len(poles)), 1e3)

    def evaluate(theta: FloatArray) -> _Fit:
        return _Fit.at(data, np.exp(theta[:-1].reshape(-1, 2)), DELAY_S * float(theta[-1]), weight)

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
        delay_s: delay of the accelerations behind the force, s.
        weight: (n_pairs, n_lines) one over the standard deviation of the noise.
        shape: (2 n_lines, n_columns) real and imaginary part of each mode for a unit residue, then of a and b.
        slopes: (2 n_lines, 2 n_modes) its derivatives by the logarithms of frequency and damping ratio of each mode.
        by_delay: (2 n_lines, n_columns) that by the delay, 1/s.
        residues: (n_pairs, n_columns).
        error: (n_pairs, 2 n_lines) weighted errors.
        inverses: (n_pairs, n_columns, n_columns) inverse of the triangular factor of the weighted columns of a pair,
            which makes them orthonormal.
    """

    data: _Data
    poles: FloatArray
    delay_s: float
    weight: FloatArray
    shape: FloatArray
    slopes: FloatArray
    by_delay: FloatArray
    residues: FloatArray
    error: FloatArray
    inverses: FloatArray

    @classmethod
    def at(cls, data: _Data, poles: FloatArray, delay_s: float, weight: FloatArray) -> _Fit:
        omega, own = data.omega[:, np.newaxis], 2 * np.pi * poles[:, 0]
        late = np.exp(-1j * omega * delay_s)
        dynamic = own**2 - omega**2 + 2j * poles[:, 1] * own * omega
        mode = -late * omega**2 / dynamic
        by_frequency = -mode / dynamic * (2 * own**2 + 2j * poles[:, 1] * own * omega)
        by_damping = -mode / dynamic * (2j * poles[:, 1] * own * omega)
        rest = late * np.stack([np.ones(omega.size), -((data.omega / data.omega[-1]) ** 2)], axis=1)
        columns = np.concatenate([mode, rest], axis=1)
        shape, by_delay = _split(columns), _split(-1j * omega * columns)
        slopes = _split(np.stack([by_frequency, by_damping], axis=2).reshape(omega.size, -1))
        read, both = _split(data.value.T).T, np.concatenate([weight, weight], axis=1)
        n_columns, weighted = shape.shape[1], both * read
        inverses, residues = np.empty((len(read), n_columns, n_columns)), np.empty((len(read), n_columns))
        for pair, (own, row) in enumerate(zip(both, weighted, strict=True)):
            # The triangle of the columns and the response together holds all that the residues need.
            stacked = np.column_stack([own[:, np.newaxis] * shape, row])
            triangle: FloatArray = np.asarray(np.linalg.qr(stacked, mode="r"))
            inverses[pair] = np.linalg.inv(triangle[:n_columns, :n_columns])
            residues[pair] = inverses[pair] @ triangle[:n_columns, n_columns]
        error = weighted - both * (residues @ shape.T)
        return cls(data, poles, delay_s, weight, shape, slopes, by_delay, residues, error, inverses)

    @property
    def cost(self) -> float:
        """Sum of the squared errors."""
        return float(np.sum(self.error**2))

    def _list_columns(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the orthonormal basis of the weighted columns of each pair, and the derivatives of its response.

        The derivatives (2 n_lines, 2 n_modes + 1) are those of the weighted response by poles and delay at fixed
        residues.
        """
        n_modes = len(self.poles)
        for weight, residues, inverse in zip(
            np.concatenate([self.weight, self.weight], axis=1), self.residues, self.inverses, strict=True
        ):
            own = weight[:, np.newaxis]
            late = self.by_delay @ residues * DELAY_S
            slopes = np.column_stack([self.slopes * np.repeat(residues[:n_modes], 2), late])
            yield (own * self.shape) @ inverse, own * slopes

    def find_normal_equations(self) -> tuple[FloatArray, FloatArray]:
        """Return the products of the derivatives of the errors with each other and with the errors (Kaufman 1975)."""
        n = 2 * len(self.poles) + 1
        curvature, slope = np.zeros((n, n)), np.zeros(n)
        for (basis, by_poles), error in zip(self._list_columns(), self.error, strict=True):
            along = basis.T @ by_poles
            curvature += by_poles.T @ by_poles - along.T @ along
            # The errors have no part along the basis.
            slope -= by_poles.T @ error
        return curvature, slope

    def weigh(self) -> FloatArray:
        """Return one over the noise of each line: a constant part of each pair, and one that grows as it responds."""
        read = np.abs(self.data.value - _join(self.shape @ self.residues.T).T) ** 2
        size = np.abs(_join(self.shape @ self.residues.T).T) ** 2
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

    def unexplained(self) -> tuple[float, ...]:
        """Return the rms fraction of the responses that is left, for each drive point; strains count like motions."""
        left = np.abs(self.data.value - _join(self.shape @ self.residues.T).T) ** 2
        n = len(self.data.responses)
        kinds = [np.equal(self.data.units, unit) for unit in dict.fromkeys(self.data.units)]
        return tuple(
            float(np.sqrt(np.mean([one[kind].sum() / (np.abs(of[kind]) ** 2).sum() for kind in kinds])))
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
        covariance = inverse @ (scores.T @ scores) @ inverse
        stds = np.empty_like(self.residues)
        for pair, by_pole in enumerate(influences):
            influence = own_scores[pair] @ self.inverses[pair].T + scores @ inverse @ by_pole.T
            stds[pair] = np.sqrt(np.sum(influence**2, axis=0))
        return covariance, stds

    def find_weakest(self, settings: ResponseFitSettings) -> int | None:
        """Return the mode that stands least above its noise, or is damped too much; None if all are clear."""
        _, stds = self.covariances(settings)
        n_modes = len(self.poles)
        size = np.max(np.abs(self.residues[:, :n_modes]) / np.maximum(stds[:, :n_modes], 1e-300), axis=0)
        size = np.where(self.poles[:, 1] > settings.most_damping, 0.0, size)
        weakest = int(np.argmin(size))
        return weakest if size[weakest] < settings.least_std else None

    def result(self, settings: ResponseFitSettings, left: tuple[float, ...]) -> FittedModes:
        """Return the modes with their intervals."""
        covariance, stds = self.covariances(settings)
        n_modes, data = len(self.poles), self.data
        n_drives, sensors = len(data.responses), data.responses[0].sensors
        drives = [sensors.index(each.drive_point) for each in data.responses]
        residues, of_residues = (each[:, :n_modes].reshape(n_drives, -1, n_modes) for each in (self.residues, stds))
        own, of_own = (
            np.stack([each[d, sensor] for d, sensor in enumerate(drives)]) for each in (residues, of_residues)
        )
        if np.max(-own / of_own) > np.max(own / of_own):
            raise InputError(
                "the acceleration at the drive point falls as the force grows, as if modal masses were negative: the "
                "force or that sensor counts in the other direction, so give one of them sign = -1"
            )
        kept: NDArray[np.int64] = np.flatnonzero(np.max(own / of_own, axis=0) >= settings.least_std)
        shapes, shape_std = np.empty((len(sensors), kept.size)), np.empty((len(sensors), kept.size))
        masses, misfits = [], []
        for column, mode in enumerate(kept):
            phi, std, misfit = _split_residues(residues[..., mode], of_residues[..., mode], drives)
            misfits.append(misfit)
            shapes[:, column], shape_std[:, column] = phi, std
            best = max(drives, key=lambda sensor: abs(phi[sensor]) / std[sensor])
            mass_kg = 1 / phi[best] ** 2
            masses.append(Estimate.normal(mass_kg, mass_kg * float(np.hypot(2 * std[best] / phi[best], settings.gain))))
        relative = np.sqrt(np.diag(covariance))[:-1].reshape(-1, 2)
        relative[:, 0] = np.hypot(relative[:, 0], settings.complexity * self.poles[:, 1] ** 2)
        left_at_end = max(settings.left_at_end, *(each.left_at_end for each in data.responses))
        relative[:, 1] = np.hypot(relative[:, 1], left_at_end)
        frequencies, ratios = (
            tuple(Estimate.normal(value, value * std) for value, std in zip(own, of.tolist(), strict=True))
            for own, of in zip(self.poles[kept].T.tolist(), relative[kept].T, strict=True)
        )
        unlike = self._find_unlike(kept, shapes, settings)
        frequencies, ratios, given = (
            tuple(each.without_interval() if low else each for each, low in zip(several, unlike.tolist(), strict=True))
            for several in (frequencies, ratios, masses)
        )
        apart = np.array(misfits) > MODAL.most_misfit
        given = tuple(each.without_interval() if off else each for each, off in zip(given, apart.tolist(), strict=True))
        values = np.split(_join(self.shape @ self.residues.T), n_drives, axis=1)
        return FittedModes(
            frequencies,
            ratios,
            given,
            shapes,
            shape_std,
            sensors,
            data.units,
            data.band_hz,
            Estimate.normal(self.delay_s, DELAY_S * float(np.sqrt(covariance[-1, -1]))),
            left,
            data.responses,
            tuple(
                FrequencyResponse(each.frequency_hz, value, sensors, each.drive_point, n_averages=0, units=data.units)
                for each, value in zip(data.responses, values, strict=True)
            ),
            tuple(_list_warnings(self, kept, unlike, apart, settings)),
        )

    def _find_unlike(
        self, kept: NDArray[np.int64], shapes: FloatArray, settings: ResponseFitSettings
    ) -> NDArray[np.bool_]:
        """Return at which modes the records differ by more than noise, at the sensor that the mode moves most."""
        found = np.zeros(kept.size, dtype=bool)
        for response in self.data.responses:
            if response.coherence is None:
                continue
            for column, (own_hz, ratio) in enumerate(self.poles[kept].tolist()):
                coherence = response.coherence[:, int(np.argmax(np.abs(shapes[:, column])))]
                near = _median_near(coherence, response.frequency_hz, own_hz, settings.near * ratio)
                found[column] |= near < settings.least_coherence
        return found


def _split_residues(
    residues: FloatArray, stds: FloatArray, drives: Sequence[int]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the shape whose products with itself at the drive points are the residues, its deviations, and the misfit.

    The misfit is that of the several drive points, an rms in standard deviations, 1 where there is one. Where it is
    larger than 1 the standard deviations grow with it.

    Args:
        residues: (n_drives, n_sensors) of one mode.
        stds: their standard deviations.
        drives: the sensor at each drive point.

    """
    over = [residues[d, sensor] / stds[d, sensor] for d, sensor in enumerate(drives)]
    best = int(np.argmax(over))
    begun = residues[best] / np.sqrt(residues[best, drives[best]])
    found = optimize.least_squares(lambda phi: ((phi[drives][:, np.newaxis] * phi - residues) / stds).ravel(), begun)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    freedom = residues.size - found.x.size
    misfit = float(np.sqrt(2.0 * found.cost / freedom)) if freedom else 1.0
    std = np.sqrt(np.diag(covariance)) * max(misfit, 1.0)
    return found.x * np.sign(found.x[np.argmax(np.abs(found.x))]), std, misfit


def _list_warnings(
    fit: _Fit,
    kept: NDArray[np.int64],
    unlike: NDArray[np.bool_],
    apart: NDArray[np.bool_],
    settings: ResponseFitSettings,
) -> Iterator[str]:
    """Yield what limits the modes, one sentence each."""
    data = fit.data
    names = list_names([repr(each.drive_point) for each in data.responses])
    lost = [f"{fit.poles[mode, 0]:.4g}" for mode in range(len(fit.poles)) if mode not in kept]
    if lost:
        yield (
            f"{len(lost)} mode(s) at {', '.join(lost)} Hz are left out, because they hardly move {names}, where the "
            "force acts, so that their modal masses are unknown: drive the structure at a further point"
        )
    if apart.any():
        where = ", ".join(f"{own_hz:.4g}" for own_hz in fit.poles[kept][apart, 0])
        yield (
            f"the responses to forces at {names} do not belong to one shape at {where} Hz, so that no interval is "
            "given for the modal masses: check which force acted where, and the gains and signs of the sensors there"
        )
    if unlike.any():
        low = ", ".join(f"{own_hz:.4g}" for own_hz in fit.poles[kept][unlike, 0])
        yield (
            f"the records differ about {low} Hz by more than the noise of a good test (the coherence is below "
            f"{settings.least_coherence:g}), so that no interval is given there: joints that slip under harder hits do "
            "that, and so do noise, and a structure that moved; hit it more softly"
        )
    measured = [response for response in data.responses if response.n_averages]
    if any(response.level_ratio < MODAL.least_level_ratio for response in measured):
        yield (
            f"the forces at a drive point have nearly one height (the factor is below {MODAL.least_level_ratio:g}), so "
            "that nothing shows whether the structure is linear, and all values are those of this level: add records "
            "of another height"
        )


def _median_near(coherence: FloatArray, frequency_hz: FloatArray, own_hz: float, width: float) -> float:
    """Return the median of the lines within a relative width of a frequency, at least of the nearest one."""
    off = np.abs(frequency_hz / own_hz - 1)
    return float(np.median(coherence[off <= max(width, float(off.min()))]))


def _split(value: ComplexArray) -> FloatArray:
    """Return the real parts of complex rows, then their imaginary parts."""
    return np.concatenate([value.real, value.imag])


def _join(value: FloatArray) -> ComplexArray:
    """Return complex rows from their real parts, then their imaginary parts."""
    real, imaginary = np.split(value, 2)
    return np.asarray(real + 1j * imaginary)
