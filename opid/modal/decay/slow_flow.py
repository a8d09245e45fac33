"""The slow flow of a free decay: amplitude and phase of its fundamental, by harmonic balance and averaging.

Beside the flow of one law there is that of two linear modes so close that their beat is slow: in a record that is
shorter than the beat their sum looks like one mode whose frequency and damping depend on its amplitude.

A' = -delta(A) A, phi' = omega(A), without time steps. The terms of second order in damping and in the drift of the
frequency are kept: the frequency of the fundamental is then right to about 1e-5 for a shift of 3 % and a damping ratio
of 1 %.

A joint remembers at which amplitudes it reversed, so that its force in a decay is not quite that of steady cycles. The
change is proportional to how far the amplitude falls in a radian (`find_fall`): with a damping ratio of 2 % it is up to
a tenth of the loss.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.memory import find_steady_loop
from opid.modal.joint_terms import IWAN, JointTerms, find_joint_curves, find_rest_stiffness, load_joint
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

# fall of the amplitude in a radian, at which the change is measured: with 0.005 and 0.02 it differs by 1 %
_FALL = 0.01
# Half cycles before those that are averaged, for the start is forgotten then, their number, and the angles in each
_BEFORE, _AVERAGED, _ANGLES = 4, 4, 64
_BEYOND = 1e6
"""Misfit of two modes whose sum is beyond all numbers, in the logarithm of the amplitude."""

_AMPLITUDES = np.geomspace(0.03, 30.0, 49)


@dataclass(frozen=True, eq=False)
class Flow:
    """The slow motion of the fundamental A(t) cos phi(t) of a free decay, as functions of its amplitude."""

    log_amplitude: FloatArray  # (n,) logarithm of A, rising
    omega: FloatArray  # (n,) phi'
    rate: FloatArray  # (n,) delta = -A'/A
    natural: FloatArray  # (n,) natural frequency, without the terms of second order
    damping: FloatArray  # (n,) c = 2 zeta omega
    # (n,) delta' - j omega': (A exp(j phi))'' = -((omega + j delta)^2 + drift) A exp(j phi)
    drift: NDArray[np.complex128]


def solve_slow_flow(
    k: FloatArray, c: FloatArray, low: float, high: float, joint: JointTerms | None = None
) -> Flow | None:
    """Return the slow flow of a law from amplitude exp(low) to exp(high); None if it does not vibrate or decay.

    k = (k0, k_2, ...) belongs to q|q|^(n-1), c = (c0, c_2, ...) to q'|q'|^(n-1). What the joint adds is averaged over a
    cycle of the fundamental. Dry friction has one more term of second order: between two reversals the motion is the
    undisturbed one about the offset F / k0, and the fundamental of these pieces lags by 3 F / (pi k0 A), which grows as
    the amplitude falls. The loops of a joint with memory do not close while the amplitude falls, which changes its
    force by as much as the amplitude falls in a radian (`find_fall`).

    >>> flow = solve_slow_flow(np.array([1.0]), np.array([0.02]), -1.0, 0.0)
    >>> round(float(flow.rate[0]), 6), round(float(flow.omega[0]), 6)
    (0.01, 0.99995)
    """
    log_amplitude = np.linspace(low, high, 100)
    a = np.exp(log_amplitude)[:, None]
    angle = np.pi * (np.arange(24) + 0.5) / 24  # half a cycle; the other half is its mirror image
    cosine, sine = np.cos(angle), np.sin(angle)
    third_cosine, third_sine = np.cos(3.0 * angle), np.sin(3.0 * angle)
    joint = joint or JointTerms()
    step = log_amplitude[1] - log_amplitude[0]
    damping = natural = rate = np.zeros(log_amplitude.size)
    loss, gain = joint.find_damping(a), -joint.find_softening(a)
    fall, eta = find_joint_fall(joint, a), np.zeros_like(a)
    in_phase, quadrature = np.zeros_like(a), np.zeros_like(a)
    omega, drag = np.full_like(a, np.sqrt(max(k[0], 1e-12))), np.zeros((1, 1))
    for _ in range(5):
        q = a * cosine + in_phase * third_cosine + quadrature * third_sine
        v = -omega * (a * sine + 3.0 * (in_phase * third_sine - quadrature * third_cosine))
        drag = _sum_higher_powers(c, v)
        force = _sum_higher_powers(k, q) + drag
        square = k[0] + gain + eta * fall.real + _find_harmonic(force, cosine) / a
        if (square <= 0.0).any():
            return None
        omega = np.sqrt(square)
        in_phase = _find_harmonic(force, third_cosine) / (9.0 * square - k[0])
        quadrature = _find_harmonic(force, third_sine) / (9.0 * square - k[0])
        damping = c[0] + ((loss + eta * fall.imag - _find_harmonic(drag, sine) / a) / omega)[:, 0]
        natural = omega[:, 0]
        rate = damping / (2.0 + np.gradient(np.log(natural), step, edge_order=2))
        eta = (rate / natural)[:, None]
    if (rate <= 0.0).any():
        return None
    rate_drift = -rate * np.gradient(rate, step, edge_order=2)
    by_friction = 2.0 * joint.friction / (np.pi * natural * a[:, 0])
    damped = np.sqrt(np.maximum(natural**2 + rate**2 - damping * rate - rate_drift - by_friction**2, 1e-12))
    drift = rate_drift + 1j * rate * np.gradient(damped, step, edge_order=2)
    return Flow(log_amplitude, damped, rate, natural, damping, drift)


def predict_decay(
    flow: Flow, time: FloatArray, log_start: float, derivative: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return log-amplitude and phase of the m-th derivative, (n,) each; None where the flow does not reach so far.

    The first time is 0; there the displacement has the amplitude exp(log_start) and the phase 0.
    """
    from scipy.interpolate import CubicSpline

    fall = flow.log_amplitude[::-1]
    slopes = np.stack([np.ones_like(fall), flow.omega[::-1]], axis=1) / flow.rate[::-1, None]
    since, turned = CubicSpline(-fall, slopes).antiderivative()(-fall).T
    own_time = since - np.interp(-log_start, -fall, since)
    if (np.diff(own_time) <= 0.0).any() or not own_time[0] <= time[0] <= time[-1] <= own_time[-1]:
        return None
    # Times and amplitudes map smoothly onto each other, so amplitude and phase are functions of time.
    log_amplitude, by_time = CubicSpline(own_time, np.stack([fall, turned], axis=1))(time).T
    omega, rate = (np.interp(log_amplitude, flow.log_amplitude, each) for each in (flow.omega, flow.rate))
    # Each derivative of A e^(j phi) multiplies it by -delta + j omega; for the second one these change as well.
    gain = (omega + 1j * rate) ** derivative
    if derivative == 2:
        gain = gain + np.interp(log_amplitude, flow.log_amplitude, flow.drift)
    return log_amplitude + np.log(np.abs(gain)), by_time - by_time[0] + np.angle(gain)


@dataclass(frozen=True, eq=False)
class Fall:
    """What a falling amplitude changes, over `_AMPLITUDES`, of a joint of unit force and unit travel.

    Args:
        change: (n,) change of the first harmonic over the amplitude and over the fall in a radian: the real part is in
            the stiffness, the imaginary one in omega c.
    """

    change: NDArray[np.complex128]

    def at(self, amplitude: FloatArray) -> NDArray[np.complex128]:
        """Return the change at amplitudes; beyond those that were followed it falls in proportion to the amplitude."""
        inside = np.interp(np.log(amplitude), np.log(_AMPLITUDES), self.change)
        return np.asarray(inside * np.minimum(1.0, _AMPLITUDES[-1] / amplitude))


@lru_cache(maxsize=64)
def find_fall(name: str, *inner: float) -> Fall:
    """Return what a falling amplitude changes in the force of a kind of `JOINT_KINDS`.

    Args:
        name: the kind.
        inner: its parameters that follow the amplitude and the travel.
    """
    values = (1.0, 1.0, *inner)
    cycles = _FallingCycles.at(_AMPLITUDES)
    force = _follow_joint(values, name, cycles)
    softening, damping = find_joint_curves(name, values, cycles.averaged_level)
    return Fall(cycles.find_change(force, find_rest_stiffness(name, values) - softening, damping))


@lru_cache(maxsize=64)
def find_slip_fall(exponent: float) -> complex:
    """Return what a falling amplitude changes in the force of slip without an end, R = 1, at the amplitude 1."""
    cycles = _FallingCycles.at(np.ones(1))
    slip = JointTerms(slip=1.0, exponent=exponent)
    level = cycles.averaged_level
    force = _follow_sliders(lambda displacement: -slip.find_slip_force(displacement), cycles)
    return complex(cycles.find_change(force, -slip.find_softening(level), slip.find_damping(level))[0])


@dataclass(frozen=True, eq=False)
class _FallingCycles:
    """Half cycles of a falling amplitude, of which the last ones are averaged.

    Args:
        amplitudes: (n,) amplitudes in the middle of those that are averaged.
        angle: (m, k) angles of the displacement in m half cycles, of which the first one falls.
        level: (n, m, k) amplitudes at these angles.
        ends: (n, m + 1) displacements at the reversals, without their signs.
    """

    amplitudes: FloatArray
    angle: FloatArray
    level: FloatArray
    ends: FloatArray

    @classmethod
    def at(cls, amplitudes: FloatArray) -> _FallingCycles:
        """Return the cycles about some amplitudes."""
        turns = np.pi * np.arange(_BEFORE + _AVERAGED + 1) - np.arctan(_FALL)
        angle = turns[:-1, None] + np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
        middle = np.pi * (_BEFORE + 0.5 * _AVERAGED)
        level = amplitudes[:, None, None] * np.exp(-_FALL * (angle - middle))
        ends = amplitudes[:, None] * np.exp(-_FALL * (turns - middle)) * np.abs(np.cos(turns))
        return cls(amplitudes, angle, level, ends)

    @property
    def displacement(self) -> FloatArray:
        """The displacements, (n, m, k)."""
        return np.asarray(self.level * np.cos(self.angle))

    @property
    def averaged_level(self) -> FloatArray:
        """The amplitudes at the angles of the half cycles that are averaged, (n, their number)."""
        return self.level[:, _BEFORE:].reshape(self.amplitudes.size, -1)

    def find_change(self, force: FloatArray, stiffness: FloatArray, damping: FloatArray) -> NDArray[np.complex128]:
        """Return what a force in these cycles (n, m, k) has beyond that of steady ones, as `Fall` holds it, (n,).

        The secant stiffness of steady cycles, and omega times their damping, belong to `averaged_level`.
        """
        angle, force = self.angle[_BEFORE:].ravel(), force[:, _BEFORE:].reshape(self.amplitudes.size, -1)
        steady = self.averaged_level * (stiffness * np.cos(angle) - damping * np.sin(angle))
        window = 1.0 - np.cos(2.0 * np.pi * (np.arange(angle.size) + 0.5) / angle.size)
        change = (force - steady) @ (window * np.exp(-1j * angle)) / window.sum()
        return np.asarray(2.0 * change / self.amplitudes / _FALL)


def _follow_joint(values: tuple[float, ...], name: str, cycles: _FallingCycles) -> FloatArray:
    """Return the force (n, m, k) of a joint of unit force and travel, of the parameters `values` and a kind."""
    if name == IWAN:
        return _follow_sliders(partial(load_joint, name, values), cycles)
    q, ends = cycles.displacement, cycles.ends
    force = np.empty_like(q)
    loop = find_steady_loop(name, *values[2:])
    top = loop.find_top(ends[:, 0])
    for m, sign in enumerate((-1.0) ** np.arange(q.shape[1])):
        place = loop.find_place(-top)
        force[:, m] = -sign * loop.find_force(ends[:, m, None] - sign * q[:, m] + place[:, None])
        top = loop.find_force(ends[:, m] + ends[:, m + 1] + place)
    return force


def _follow_sliders(load: Callable[[FloatArray], FloatArray], cycles: _FallingCycles) -> FloatArray:
    """Return the force (n, m, k) of sliders side by side, by their force on first loading."""
    q, ends = cycles.displacement, cycles.ends
    force = np.empty_like(q)
    # The rule of Masing holds for sliders side by side, and no loop closes in a larger one.
    top = load(ends[:, 0])
    for m, sign in enumerate((-1.0) ** np.arange(q.shape[1])):
        force[:, m] = sign * (top[:, None] - 2.0 * load(0.5 * (ends[:, m, None] - sign * q[:, m])))
        top = 2.0 * load(0.5 * (ends[:, m] + ends[:, m + 1])) - top
    return force


def find_joint_fall(joint: JointTerms, amplitude: FloatArray) -> NDArray[np.complex128]:
    """Return what a falling amplitude changes in a joint with memory, over -A'/(omega A), in the unit of stiffness.

    The real part is in the secant stiffness, the imaginary one in omega c(A).
    """
    change = np.zeros(amplitude.shape, dtype=np.complex128)
    if joint.slip != 0.0:
        # Slip without an end has no travel, so that all its curves are a power of the amplitude.
        change = change + joint.slip * amplitude ** (1.0 + joint.exponent) * find_slip_fall(joint.exponent)
    if not joint.kind:
        return change
    force, travel, *inner = joint.values
    return change + force / travel * find_fall(joint.kind, *inner).at(amplitude / travel)


@dataclass(frozen=True)
class CloseModes:
    """Two linear modes whose sum is a decay, the stronger one first.

    Args:
        poles: their poles -delta + j omega.
        ratio: amplitude of the weaker at the first time over that of the stronger.
        squares: sum of the squared errors of amplitude and phase over their variance.
        misfit: rms error over its standard deviation; noise alone gives 1.
    """

    poles: tuple[complex, complex]
    ratio: float
    squares: float
    misfit: float

    SIZE: ClassVar[int] = 6  # two poles and the ratio of two amplitudes

    @property
    def is_plausible(self) -> bool:
        """Whether both explain the decay, are seen, and have damping of a like size, as modes of one structure have."""
        first, second = (-pole.real for pole in self.poles)
        low, high = min(first, second), max(first, second)
        is_alike = low > 0.0 and high < MODAL.alike_damping * low
        return is_alike and self.ratio > MODAL.unresolved and self.misfit < MODAL.most_misfit

    @property
    def frequency_hz(self) -> tuple[float, float]:
        """Their frequencies, the lower one first, Hz."""
        low, high = sorted(pole.imag / (2.0 * np.pi) for pole in self.poles)
        return low, high

    def scaled(self, rate: float) -> CloseModes:
        """Return them with poles in another unit of time, multiplied by a rate."""
        return replace(self, poles=(rate * self.poles[0], rate * self.poles[1]))

    def measure_distance(self, omega: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far angular frequencies and rates of decay lie from those of the farther mode, (n,) each."""
        return (
            np.max([np.abs(omega - pole.imag) for pole in self.poles], axis=0),
            np.max([np.abs(rate + pole.real) for pole in self.poles], axis=0),
        )


def fit_close_modes(time: FloatArray, log_amplitude: FloatArray, phase: FloatArray, root: FloatArray) -> CloseModes:
    """Return the two linear modes that explain a decay best.

    Args:
        time: (n,) times, from 0.
        log_amplitude: (n,) logarithm of the amplitude.
        phase: (n,) phase, rad.
        root: (2n, 2n) lower root of the covariance of both.

    >>> time = np.arange(60.0)
    >>> z = np.exp((-0.02 + 1j) * time) + 0.5 * np.exp((-0.03 + 1.06j) * time)
    >>> found = fit_close_modes(time, np.log(np.abs(z)), np.unwrap(np.angle(z)), 1e-4 * np.eye(120))
    >>> np.round(found.poles, 4).tolist(), round(found.ratio, 3)
    ([(-0.02+1j), (-0.03+1.06j)], 0.5)
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import least_squares

    std = np.linalg.norm(root, axis=1).reshape(2, -1).mean(axis=0)
    decay, turn = (np.polyfit(time, each, 1, w=1.0 / std) for each in (log_amplitude, phase))
    mean = complex(decay[0], turn[0])
    logs = log_amplitude + 1j * phase - mean * time - complex(decay[1], turn[1])
    slow = np.exp(logs)

    def errors(x: FloatArray) -> FloatArray:
        first, second, one, other = x.view(np.complex128)
        with np.errstate(over="ignore", invalid="ignore"):
            both = np.exp(one + first * time) + np.exp(other + second * time)
            off = np.log(np.where(both == 0.0, 1e-300, both) / slow)
        off = np.where(np.isfinite(off), off, _BEYOND)
        return solve_triangular(root, np.concatenate([off.real, off.imag]), lower=True)

    starts: list[tuple[float, FloatArray]] = []
    for beats, rate in product(MODAL.first_beats, (-0.5, 0.0, 0.5)):
        away = -rate * decay[0] + 2j * np.pi * beats / time[-1]
        for first, second in ((0.0j, away), (-0.5 * away, 0.5 * away)):
            columns = np.exp(np.outer(time, [first, second])) / (slow * std)[:, None]
            heights = np.linalg.lstsq(columns, 1.0 / std.astype(np.complex128), rcond=1e-9)[0]
            x = np.array([first, second, *np.log(heights + 1e-9)]).view(np.float64)
            starts.append((float(np.sum(errors(x) ** 2)), x))
    starts.sort(key=lambda each: each[0])
    found = min(
        (least_squares(errors, x, x_scale="jac", max_nfev=200) for _, x in starts[: MODAL.tried_beats]),
        key=lambda each: float(each.cost),
    )
    poles, heights = found.x.view(np.complex128).reshape(2, 2)
    strong = int(np.argmax(heights.real))
    return CloseModes(
        (complex(mean + poles[strong]), complex(mean + poles[1 - strong])),
        float(np.exp(-abs(heights[0].real - heights[1].real))),
        float(2.0 * found.cost),
        float(np.sqrt(2.0 * found.cost / max(2 * time.size - found.x.size, 1))),
    )


def _sum_higher_powers(values: FloatArray, x: FloatArray) -> FloatArray:
    """Return sum_n values_n x |x|^(n-1) from n = 2 on."""
    size, total = np.abs(x), np.zeros_like(x)
    for value in values[:0:-1]:
        total = (total + value) * size
    return total * x


def _find_harmonic(force: FloatArray, shape: FloatArray) -> FloatArray:
    return 2.0 * (force @ shape / shape.size)[:, None]
