"""The likeliest motion of a body on driven suspensions, given all readings of a record, and draws around it.

The predictor of `opid.mechanics.driven` knows only the readings before a sample; a fixed-interval smoother knows those
after it, too (Rauch, Tung & Striebel 1965). Here the whole motion is found at once, as the minimum of a sum of squares
(the iterated smoother is its Gauss-Newton method, Bell 1994):

    readings on the body      y = -R F + S z + w + r + noise
    readings below            z'' = -A F + w - (u + o) + noise
    unmeasured forces         w(t + 1/fs) = q w(t) + noise

A spring G from the body to the ground pulls with G (z + x1) beside F. The path x1 is the double integral of the drive
with a slow correction, x1'' = u + o + noise; accelerometers do not show its mean height and its slope, which stay near
zero.

The travel z is a quintic spline with a knot at each sample, so that z, z' and z'' at a sample are sums over five
coefficients, and each row needs the law at its own sample only. F = K z + C z' + f(z, z') is that of the predictor's
interfaces; a force with memory is followed along the whole motion. The normal equations are banded, but for a few
unknowns of the whole record: the offsets r and o, and what the laws remember at the first sample.

Quintic splines relate z'' to z at a quarter of the sampling rate to 1 %, and at a tenth of it to 0.01 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import interpolate, linalg, ndimage

from opid.mechanics.driven import Interface, Noise, UnboundedResponseError
from opid.mechanics.laws.law import Law
from opid.mechanics.memory import force_along, recorded_motion
from opid.signals.recording import FloatArray

# Values of a quintic B-spline and of its derivatives at its five inner knots, for knots at distance 1.
_SHAPES = (
    np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0,
    np.array([-1.0, -10.0, 0.0, 10.0, 1.0]) / 24.0,
    np.array([1.0, 2.0, -6.0, 2.0, 1.0]) / 6.0,
)
_WIDTH, _MIDDLE = 5, 2
# Gauss-Newton steps; laws with kinks need ten
_MOST_STEPS = 40
# knots of slow corrections in a record
_MOST_KNOTS = 200
# The steps end when the travel changes by less than this fraction of its rms.
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class DrivenRecord:
    """A record of a body on driven suspensions, with the model of the body.

    Args:
        interfaces: the suspensions, about their position of rest in this record.
        accelerance: (n_interfaces, n_interfaces) A, 1/kg.
        reading: (n_sensors, n_interfaces) R, 1/kg: the forces F of the interfaces make the sensors read -R F.
        drive: (n, n_interfaces) acceleration below each suspension, m/s^2.
        measured: (n, n_sensors) acceleration of the body, m/s^2; the first sensors are those of the interfaces.
        fs: sampling rate, Hz.
        noise: noise of the sensors below and on the body, and unmeasured forces, for at least as many interfaces as
            there are sensors.
        offset_std: standard deviations of the offsets of the sensors below, (n_interfaces,), and on the body,
            (n_sensors,), m/s^2.
        drift_m: (n_interfaces,) standard deviation of the height below each suspension about its mean; it counts where
            a spring to the ground acts.
        of_travel: (n_sensors, n_interfaces) S, reading of each sensor for a unit travel, 1/s^2; None if none reads it.
    """

    interfaces: Sequence[Interface]
    accelerance: FloatArray
    reading: FloatArray
    drive: FloatArray
    measured: FloatArray
    fs: float
    noise: Noise
    offset_std: tuple[FloatArray, FloatArray]
    drift_m: FloatArray
    of_travel: FloatArray | None = None

    @property
    def n_interfaces(self) -> int:
        """Number of suspensions."""
        return self.drive.shape[1]

    @property
    def n_sensors(self) -> int:
        """Number of sensors on the body."""
        return self.measured.shape[1]

    @cached_property
    def levels(self) -> tuple[FloatArray, FloatArray]:
        """Noise of the readings below and on the body, (n_interfaces,) and (n_sensors,), m/s^2."""
        table = self.noise.table(max(self.n_interfaces, self.n_sensors))
        return table[0, : self.n_interfaces], table[1, : self.n_sensors]

    @cached_property
    def pushes(self) -> tuple[FloatArray, float]:
        """Rms acceleration of each sensor by unmeasured forces, (n_sensors,) m/s^2, and what is left of it a sample on.

        The first is empty without unmeasured forces.
        """
        table = self.noise.table(max(self.n_interfaces, self.n_sensors))
        rms = table[5, : self.n_sensors]
        # A sensor that no force moves, like that of a travel, is as good as still.
        pushed = np.maximum(rms, 1e-6 * rms.max()) if rms.any() else rms[:0]
        return pushed, float(np.exp(-table[6, 0] / self.fs))


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """A motion of a record.

    Args:
        travel: (n, n_interfaces) z, m.
        velocity: (n, n_interfaces) z', m/s.
        curvature: (n, n_interfaces) z'', m/s^2.
        pushed: (n, n_sensors) acceleration of the body at its sensors by unmeasured forces, m/s^2.
        force: (n, n_interfaces) F of each suspension, N, or per unit of the reference mass.
        ground_force: (n, n_interfaces) force of the springs to the ground, in the same unit.
    """

    travel: FloatArray
    velocity: FloatArray
    curvature: FloatArray
    pushed: FloatArray
    force: FloatArray
    ground_force: FloatArray

    @property
    def whole_force(self) -> FloatArray:
        """(n, n_interfaces) force of suspension and spring to the ground."""
        return self.force + self.ground_force


@dataclass(frozen=True, eq=False)
class _Constants:
    """Unknowns of the whole record.

    Args:
        of_drive: (n, n_interfaces, n_constants) offset of the drive for a unit of each.
        of_readings: (n, n_sensors, n_constants) offset of the readings.
        of_force: (n, n_interfaces, n_constants) force of what the laws remember at the first sample.
        of_height: (n, n_interfaces, n_constants) correction of the height below each suspension.
        path: (n, n_interfaces) double integral of the drive where a spring to the ground acts, m; else zero.
        prior: (n_rows, n_constants) whitened rows of what is known of them.
    """

    of_drive: FloatArray
    of_readings: FloatArray
    of_force: FloatArray
    of_height: FloatArray
    path: FloatArray
    prior: FloatArray


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The likeliest motion of a record, and the curvature of the sum of squares about it.

    Args:
        record: the record.
        motion: the likeliest motion.
        misfit: (n, n_interfaces + n_sensors) errors of the rows below and on the body over their noise.
        unknowns: coefficients of the splines, and the constants of the record.
        normal: the normal equations there.
    """

    record: DrivenRecord
    motion: SmoothedMotion
    misfit: FloatArray
    unknowns: FloatArray
    constants: _Constants
    normal: _Normal

    def follow(self, record: DrivenRecord) -> SmoothedMotion:
        """Return the likeliest motion with the forces of another model.

        Args:
            record: the record with the other suspensions.
        """
        return _find_motion(record, self.constants, self.unknowns)

    def draw(self, record: DrivenRecord, rng: np.random.Generator) -> SmoothedMotion:
        """Return a motion drawn from those that are as likely as the readings and another model allow.

        To first order about the likeliest motion: noise drawn for every row moves the minimum by the normal equations
        (perturb and optimise, Papandreou & Yuille 2010).

        Args:
            record: the same readings with a drawn model: suspensions, accelerances and corrections of the sensors.
            rng: source of the draw.
        """
        rows, of_constants = _whiten(record, self.record, self.constants, self.unknowns)
        noise = [rng.standard_normal(each.shape) for each in (rows, of_constants)]
        step = self.normal.solve(rows + noise[0], of_constants + noise[1])
        return _find_motion(record, self.constants, self.unknowns - step)


@dataclass(frozen=True, eq=False)
class _Normal:
    """Jacobian and factors of the normal equations.

    Args:
        local: (n, n_rows, _WIDTH, n_local) derivatives of the rows of a sample by the coefficients about it.
        pushes: factors of the rows of the unmeasured forces, see `_whiten`.
        border: (n, n_rows, n_constants) derivatives of the rows by the constants.
        prior: (n_prior, n_constants) rows of what is known of the constants.
        factor: banded Cholesky factor of the local part.
        across: (n_unknowns, n_constants) local part of the solution for each constant.
        schur: (n_constants, n_constants) Cholesky factor of what is left for the constants.
    """

    local: FloatArray
    pushes: tuple[FloatArray, float]
    border: FloatArray
    prior: FloatArray
    factor: FloatArray
    across: FloatArray
    schur: FloatArray

    def solve(self, rows: FloatArray, of_constants: FloatArray) -> FloatArray:
        """Return the least-squares solution for whitened rows, (n, n_rows), and rows of the constants."""
        right = _transpose(self.local, rows, self.pushes).ravel()
        below = np.einsum("krc,kr->c", self.border, rows[:, : self.border.shape[1]], optimize=True)
        below += self.prior.T @ of_constants
        local = linalg.cho_solve_banded((self.factor, True), right, check_finite=False)
        coupled = below - self.across.T @ right
        constants = linalg.cho_solve((self.schur, True), coupled) if coupled.size else coupled
        return np.concatenate([local - self.across @ constants, constants])


def smooth(record: DrivenRecord, travel: FloatArray) -> Smoothed:
    """Return the likeliest motion of a record.

    Args:
        record: readings and model.
        travel: (n, n_interfaces) travel to start from, m, as `opid.mechanics.driven.predict` gives it.

    Raises:
        UnboundedResponseError: the suspensions hold the body nowhere, so that the motion is not determined.
    """
    n, n_local = len(travel), record.n_interfaces + record.pushes[0].size
    local = np.zeros((n + _WIDTH - 1, n_local))
    for k in range(record.n_interfaces):
        inner = ndimage.spline_filter1d(travel[:, k], 5, mode="mirror")
        local[:, k] = np.pad(inner, _MIDDLE, mode="reflect")
    constants = _find_constants(record, travel)
    unknowns = np.concatenate([local.ravel(), np.zeros(constants.prior.shape[1])])
    cost, size = _cost(record, constants, unknowns), max(float(np.std(travel)), 1e-12)
    for _ in range(_MOST_STEPS):
        normal = _find_normal(record, constants, unknowns)
        step = normal.solve(*_whiten(record, record, constants, unknowns))
        factor, moved = 1.0, np.inf
        while factor > 1e-3:
            trial = unknowns - factor * step
            now = _cost(record, constants, trial)
            if now <= cost:
                moved = factor * float(np.abs(step[: local.size].reshape(local.shape)[:, : record.n_interfaces]).max())
                unknowns, cost = trial, now
                break
            factor *= 0.5
        if factor <= 1e-3 or moved < _NEGLIGIBLE * size:
            break
    normal = _find_normal(record, constants, unknowns)
    rows = _whiten(record, record, constants, unknowns)[0][:, : record.n_interfaces + record.n_sensors]
    return Smoothed(record, _find_motion(record, constants, unknowns), rows, unknowns, constants, normal)


def _cost(record: DrivenRecord, constants: _Constants, unknowns: FloatArray) -> float:
    rows, of_constants = _whiten(record, record, constants, unknowns)
    cost = float(np.sum(rows**2) + np.sum(of_constants**2))
    return cost if np.isfinite(cost) else np.inf


def _find_motion(record: DrivenRecord, constants: _Constants, unknowns: FloatArray) -> SmoothedMotion:
    local, of_record = _split(record, constants, unknowns)
    n = len(record.drive)
    windows = np.stack([local[j : j + n] for j in range(_WIDTH)])
    spline = windows[:, :, : record.n_interfaces]
    travel, velocity, curvature = (
        np.tensordot(shape, spline, axes=1) * record.fs**order for order, shape in enumerate(_SHAPES)
    )
    pushed = windows[_MIDDLE, :, record.n_interfaces :]
    grounds = np.array([interface.ground_stiffness for interface in record.interfaces])
    ground_force = grounds * (travel + constants.path + constants.of_height @ of_record)
    force = constants.of_force @ of_record
    for k, interface in enumerate(record.interfaces):
        z, v = travel[:, k], velocity[:, k]
        force[:, k] += interface.stiffness * z + interface.damping * v + force_along(interface.law, z, v, record.fs)
    pushed = pushed if pushed.size else np.zeros((n, record.n_sensors))
    return SmoothedMotion(travel, velocity, curvature, pushed, force, ground_force)


def _split(record: DrivenRecord, constants: _Constants, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    n_constants = constants.prior.shape[1]
    last = unknowns.size - n_constants
    return unknowns[:last].reshape(len(record.drive) + _WIDTH - 1, -1), unknowns[last:]


def _whiten(
    record: DrivenRecord, noise_of: DrivenRecord, constants: _Constants, unknowns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the errors of all rows over their noise: below, on the body, [unmeasured forces]; and of the constants."""
    motion, (_, of_record) = _find_motion(record, constants, unknowns), _split(record, constants, unknowns)
    below, above = noise_of.levels
    n = record.n_interfaces
    body = -motion.whole_force @ record.accelerance.T + motion.pushed[:, :n]
    read = -motion.whole_force @ record.reading.T + motion.pushed + constants.of_readings @ of_record
    if record.of_travel is not None:
        read += motion.travel @ record.of_travel.T
    kinematic = (motion.curvature - body + record.drive + constants.of_drive @ of_record) / below
    rows = [kinematic, (read - record.measured) / above]
    rms, left = noise_of.pushes
    if rms.size:
        before = np.concatenate([np.zeros((1, rms.size)), left * motion.pushed[:-1]])
        rows.append((motion.pushed - before) / _push_steps(rms, left, len(before)))
    return np.concatenate(rows, axis=1), constants.prior @ of_record


def _push_steps(rms: FloatArray, left: float, n: int) -> FloatArray:
    """Return the rms change of unmeasured forces at each sample, (n, n_sensors); the first is their rms."""
    steps = np.tile(rms * np.sqrt(1.0 - left**2), (n, 1))
    steps[0] = rms
    return steps


def _transpose(local: FloatArray, rows: FloatArray, pushes: tuple[FloatArray, float]) -> FloatArray:
    """Return the transposed local Jacobian times whitened rows, (n + _WIDTH - 1, n_local)."""
    n, n_rows, _, n_local = local.shape
    found = np.zeros((n + _WIDTH - 1, n_local))
    products = np.einsum("krji,kr->jki", local, rows[:, :n_rows], optimize=True)
    for j in range(_WIDTH):
        found[j : j + n] += products[j]
    rms, left = pushes
    if rms.size:
        scaled = rows[:, n_rows:] / _push_steps(rms, left, n)
        found[_MIDDLE : _MIDDLE + n, n_local - rms.size :] += scaled
        found[_MIDDLE : _MIDDLE + n - 1, n_local - rms.size :] -= left * scaled[1:]
    return found


def _find_normal(record: DrivenRecord, constants: _Constants, unknowns: FloatArray) -> _Normal:
    """Return the normal equations of all rows about a motion."""
    motion, (below, above) = _find_motion(record, constants, unknowns), record.levels
    n, n_interfaces, n_sensors = len(record.drive), record.n_interfaces, record.n_sensors
    by_z, by_v = _find_slopes(record, motion)
    rms, left = record.pushes
    shapes = [shape * record.fs**order for order, shape in enumerate(_SHAPES)]
    by_coefficient = (
        by_z[:, np.newaxis, :] * shapes[0][:, np.newaxis] + by_v[:, np.newaxis, :] * shapes[1][:, np.newaxis]
    )
    by_force = np.concatenate([record.accelerance / below[:, np.newaxis], record.reading / above[:, np.newaxis]])
    by_force[n_interfaces:] *= -1.0
    local = np.zeros((n, n_interfaces + n_sensors, _WIDTH, n_interfaces + rms.size))
    local[..., :n_interfaces] = by_force[:, np.newaxis, :] * by_coefficient[:, np.newaxis]
    if record.of_travel is not None:
        direct = (record.of_travel / above[:, np.newaxis])[:, np.newaxis, :] * shapes[0][:, np.newaxis]
        local[:, n_interfaces:, :, :n_interfaces] += direct
    for k in range(n_interfaces):
        local[:, k, :, k] += shapes[2] / below[k]
    for k in range(rms.size):
        if k < n_interfaces:
            local[:, k, _MIDDLE, n_interfaces + k] = -1.0 / below[k]
        local[:, n_interfaces + k, _MIDDLE, n_interfaces + k] = 1.0 / above[k]
    grounds = np.array([interface.ground_stiffness for interface in record.interfaces])
    by_constants = constants.of_force + grounds[:, np.newaxis] * constants.of_height
    border = np.einsum("ri,kic->krc", by_force, by_constants, optimize=True)
    border[:, :n_interfaces] += constants.of_drive / below[:, np.newaxis]
    border[:, n_interfaces:] += constants.of_readings / above[:, np.newaxis]

    n_local = local.shape[-1]
    band = np.zeros((_WIDTH * n_local, (n + _WIDTH - 1) * n_local))
    for j in range(_WIDTH):
        for other in range(j + 1):
            block = np.einsum("kri,krl->kil", local[:, :, j], local[:, :, other], optimize=True)
            for i in range(n_local):
                for k in range(n_local):
                    below_diagonal = (j - other) * n_local + i - k
                    if below_diagonal >= 0:
                        first = other * n_local + k
                        band[below_diagonal, first : first + n * n_local : n_local] += block[:, i, k]
    for k, level in enumerate(rms):
        inverse = 1.0 / _push_steps(np.array([level]), left, n)[:, 0] ** 2
        column = n_interfaces + k
        diagonal = band[0, column::n_local]
        diagonal[_MIDDLE : _MIDDLE + n] += inverse
        diagonal[_MIDDLE : _MIDDLE + n - 1] += left**2 * inverse[1:]
        band[n_local, column::n_local][_MIDDLE : _MIDDLE + n - 1] -= left * inverse[1:]
        # Nothing depends on the coefficients beyond the record.
        diagonal[:_MIDDLE] = diagonal[-_MIDDLE:] = 1.0
    try:
        factor = linalg.cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=False)
        n_constants = constants.prior.shape[1]
        coupling = np.stack(
            [_transpose(local, border[:, :, c], (rms[:0], left)).ravel() for c in range(n_constants)], axis=1
        ).reshape(-1, n_constants)
        across = linalg.cho_solve_banded((factor, True), coupling, check_finite=False)
        schur = np.einsum("krc,krd->cd", border, border, optimize=True) + constants.prior.T @ constants.prior
        schur = linalg.cholesky(schur - coupling.T @ across, lower=True)
    except linalg.LinAlgError as error:
        raise UnboundedResponseError(
            "the suspensions hold the body nowhere, so that its motion is not determined: check stiffness and law"
        ) from error
    return _Normal(local, record.pushes, border, constants.prior, factor, across, schur)


def _find_slopes(record: DrivenRecord, motion: SmoothedMotion) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the forces by travel and velocity at each sample, (n, n_interfaces) each.

    A force with memory changes with the travel as it does along the motion; only the steps to the minimum depend on
    this approximation, and the spread about it, not the minimum itself.
    """
    by_z, by_v = np.empty_like(motion.travel), np.empty_like(motion.travel)
    for k, interface in enumerate(record.interfaces):
        z, v = motion.travel[:, k], motion.velocity[:, k]
        law_by_z, law_by_v = interface.law.gradient(z, v)
        assert isinstance(interface.law, Law)  # without candidates
        remembering = interface.law.remembering
        if remembering.terms:
            static = Law(tuple(term for term in interface.law.terms if term.kind.memory is None))
            law_by_z, law_by_v = static.resting_at(interface.law.rest_m).gradient(z, v)
            force = force_along(remembering, z, v, record.fs)
            rate, least = np.gradient(force) * record.fs, 1e-3 * float(np.mean(v**2))
            law_by_z = law_by_z + np.maximum(rate * v / (v**2 + least), 0.0)
        by_z[:, k], by_v[:, k] = (
            interface.stiffness + interface.ground_stiffness + law_by_z,
            (interface.damping + law_by_v),
        )
    return by_z, by_v


def _find_constants(record: DrivenRecord, travel: FloatArray) -> _Constants:
    """Return the unknowns of the whole record: offsets, memories at the first sample, slow corrections of heights.

    The offset of a sensor whose AC coupling was undone walks randomly: it is a straight line between knots a second
    apart, or further where there would be too many.
    """
    n, table = len(travel), record.noise.table(max(record.n_interfaces, record.n_sensors))
    n_slow = int(np.clip(n / record.fs, 4, _MOST_KNOTS))
    columns: list[tuple[int, int, FloatArray]] = []
    priors: list[FloatArray] = []
    for side, (stds, walks) in enumerate(zip(record.offset_std, table[2:4], strict=True)):
        for channel, (std, walk) in enumerate(zip(stds.tolist(), walks.tolist(), strict=False)):
            n_knots = 1 if walk == 0.0 else n_slow
            columns += [(side, channel, each) for each in _interpolate(n, n_knots, 1)]
            known = np.eye(n_knots) / std
            if n_knots > 1:
                known[1:] = np.diff(np.eye(n_knots), axis=0) / (walk * np.sqrt((n - 1) / (n_knots - 1)))
            priors.append(known)
    for k, interface in enumerate(record.interfaces):
        velocity = np.gradient(travel[:, k]) * record.fs
        assert isinstance(interface.law, Law)  # without candidates
        for term in interface.law.remembering.terms:
            alone = Law((term,))
            column = recorded_motion(travel[:, k], velocity, record.fs).start_columns(alone)[:, 0]
            largest = float(np.abs(column).max())
            if largest > 0.0:
                # A memory at the start is about as large as along the motion.
                force = float(np.std(force_along(alone, travel[:, k], velocity, record.fs)))
                columns.append((2, k, column * force / largest))
                priors.append(np.eye(1))
    path = np.zeros_like(travel)
    for k, interface in enumerate(record.interfaces):
        if interface.ground_stiffness:
            path[:, k] = _integrate_twice(record.drive[:, k], record.fs)
            columns += [(3, k, each) for each in _interpolate(n, n_slow, 3)]
            spacing_s = (n - 1) / (n_slow - 1) / record.fs
            bends = np.diff(np.eye(n_slow), 2, axis=0) / spacing_s**2
            level = record.levels[0][k] / np.sqrt(record.fs * spacing_s)
            # All knots together tell as much of the height as three observations, for height, slope and offset.
            priors.append(np.concatenate([bends / level, np.eye(n_slow) / (record.drift_m[k] * np.sqrt(n_slow / 3))]))
    widths = (record.n_interfaces, record.n_sensors, record.n_interfaces, record.n_interfaces)
    found = [np.zeros((n, width, len(columns))) for width in widths]
    for number, (side, channel, column) in enumerate(columns):
        found[side][:, channel, number] = column
    return _Constants(found[0], found[1], found[2], found[3], path, linalg.block_diag(*priors))


def _interpolate(n: int, n_knots: int, degree: int) -> FloatArray:
    """Return the splines of n samples that are one at a knot and zero at the others, (n_knots, n)."""
    if n_knots == 1:
        return np.ones((1, n))
    knots = np.linspace(0, n - 1, n_knots)
    return np.asarray(interpolate.make_interp_spline(knots, np.eye(n_knots), k=degree)(np.arange(n)).T)


def _integrate_twice(acceleration: FloatArray, fs: float) -> FloatArray:
    """Return the path of an acceleration, m, without the parabola that its offset and its start make of it."""
    seconds = np.arange(acceleration.size) / fs
    path = interpolate.make_interp_spline(seconds, acceleration, k=5).antiderivative(2)(seconds)
    time = np.linspace(-1.0, 1.0, path.size)
    return np.asarray(path - np.polynomial.polynomial.polyval(time, np.polynomial.polynomial.polyfit(time, path, 2)))
