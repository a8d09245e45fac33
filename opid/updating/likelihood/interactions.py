"""Measured points where a harmonic meets another mode: how far that mode pulls them off the smooth backbone.

A mode i that harmonic h meets is moved by the harmonic F_h of the joints' forces, and moves the joints in turn:

    (l_i - h^2 l + 2j zeta h (l_i l)^1/2) q_i + psi_i^T (F_h + dF_h/dz_h psi q) = 0
    lambda = lambda of the smooth backbone + Re(dlambda/dq q)

with l the measured eigenvalue: a point is paired with the point of the curve at its own frequency, where the two sides
of a loop are told apart, though they have the same amplitude. The motion in quadrature, Im q, loses energy; what that
does to the frequency depends on the sensor that is held in quadrature, so it is left to the noise of the points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError
from opid.mechanics.backbones.continuation import continued_backbone
from opid.mechanics.backbones.harmonic_balance import (
    Balance,
    balance,
    depends_on_rate,
    joint_harmonics,
    linear_unknowns,
    residual,
    solve_at,
)
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import TermSet
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ErrorGrowth, IntArray, ModeData, find_met_modes, with_noise
from opid.updating.likelihood.curves import describe_span, make_curves, make_solver, slopes_function
from opid.updating.likelihood.error_growth import with_modal_errors
from opid.updating.model_class import ModelClass
from opid.updating.settings import UPDATING

# ---- the pull of the modes that are met -------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Pull:
    """What the modes that harmonics meet do to lambda of one mode, at some points of its smooth backbone.

    There is one column for each pair of a harmonic above the first and a mode that is met, harmonic by harmonic.
    """

    order: FloatArray  # (n_pairs,) number of the harmonic
    eigenvalue: FloatArray  # (n_pairs,) l_i of the mode that is met, 1/s^2
    # (n_pairs,) eigenvalue and square of the scale of what replaces it in the smooth structure
    far: FloatArray
    replaced: FloatArray
    push: FloatArray  # (n_points, n_pairs) psi_i^T F_h, m kg^1/2 / s^2
    stiffness: FloatArray  # (n_points, n_pairs, n_pairs) psi^T dF_h/dz_h psi, 1/s^2
    effect: FloatArray  # (n_points, n_pairs) derivative of lambda by the coordinates q_i

    @property
    def n_met(self) -> int:
        """Number of modes that are met."""
        return int((self.order == self.order[0]).sum())

    def at(self, matrix: FloatArray) -> Pull:
        """Return the pull at other points, which a matrix (n_others, n_points) interpolates."""
        stiffness = np.einsum("jk,kab->jab", matrix, self.stiffness)
        return replace(self, push=matrix @ self.push, stiffness=stiffness, effect=matrix @ self.effect)

    def find_shift(self, eigenvalue: FloatArray, damping: float, detuning: FloatArray | None = None) -> FloatArray:
        """Return the change of lambda at vibrations of a given lambda, (n_points,), 1/s^2.

        Args:
            eigenvalue: (n_points,) lambda of the vibration, 1/s^2.
            damping: damping ratio of the modes that are met.
            detuning: (n_met,) relative errors of their frequencies; none where left out.
        """
        own, at = self.eigenvalue, eigenvalue[:, np.newaxis]
        if detuning is not None:
            own = own * np.tile(1 + detuning, own.size // self.n_met) ** 2
        away = own - self.order**2 * at + 2j * damping * self.order * np.sqrt(own * at)
        receptance = 1 / away - self.replaced / (self.far - self.order**2 * at)
        matrix = self.stiffness + np.eye(self.order.size) / receptance[:, np.newaxis]
        motion = np.linalg.solve(matrix, -self.push[..., np.newaxis])[..., 0]
        return np.asarray(np.sum(self.effect * motion.real, axis=1))

    def find_patterns(self, eigenvalue: FloatArray, damping: float, detuning: FloatArray, unit: float) -> FloatArray:
        """Return what errors of each mode's frequency and of the damping do to lambda, (n_points, n_met + 1), 1/s^2.

        A frequency has the relative error `unit` beside its detuning, and the damping that of the settings. The
        arguments are those of `find_shift`.
        """
        found = []
        for own in UPDATING.detuning_step * unit * np.eye(detuning.size):
            ends = [self.find_shift(eigenvalue, damping, each) for each in (detuning - own, detuning + own)]
            found.append((ends[1] - ends[0]) / (2 * UPDATING.detuning_step))
        ratio = 1 + UPDATING.damping_error
        ends = [self.find_shift(eigenvalue, each, detuning) for each in (damping / ratio, damping * ratio)]
        return np.stack([*found, (ends[1] - ends[0]) / 2], axis=1)


def find_pull(
    data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray, sensor: str, amplitude: FloatArray
) -> Pull | None:
    """Return the pull on one mode at amplitudes of a sensor, (n,); None where nothing is met, or without a backbone.

    Args:
        data: the backbones.
        mode: the curves of the mode.
        model_class: the laws.
        theta: (n_parameters,) their parameters.
        sensor: name of the sensor.
        amplitude: (n,) its amplitudes, growing, m.
    """
    whole = find_system(data, model_class, theta)
    met = find_met_modes(data, mode)
    if not met.columns.size:
        return None
    smooth, psi = met.remove_from(whole), whole.at_joints[:, met.columns]
    laws = _find_springs(model_class, whole.joints, theta)
    equations = balance(smooth, laws, mode=mode.mode, sensor=sensor, harmonics=data.harmonics)
    higher = [k for k, h in enumerate(equations.harmonics) if h > 1]
    points = _follow(equations, amplitude)
    if points is None:
        return None
    n_joints, n_met = len(laws), met.columns.size
    moved = np.zeros((equations.size, len(higher) * n_met))
    for number, k in enumerate(higher):
        moved[k * n_joints : (k + 1) * n_joints, number * n_met : (number + 1) * n_met] = psi
    push, stiffness, effect = [], [], []
    for point, at in zip(points, amplitude, strict=True):
        extension = point[: equations.n_joint_unknowns].reshape(-1, n_joints)
        force, slopes = joint_harmonics(laws, equations.transform, extension)
        push.append((force[higher] @ psi).ravel())
        between = np.einsum("ja,jhg,jb->hagb", psi, slopes[:, higher][:, :, higher], psi)
        stiffness.append(between.reshape(push[0].size, push[0].size))
        effect.append(np.linalg.solve(residual(equations, point, at)[1], moved)[-1])
    return Pull(
        order=np.repeat([float(equations.harmonics[k]) for k in higher], n_met),
        eigenvalue=np.tile(whole.eigenvalue[met.columns], len(higher)),
        far=np.tile(smooth.eigenvalue[met.columns], len(higher)),
        replaced=np.tile(met.scale_of(whole)[met.columns] ** 2, len(higher)),
        push=np.array(push),
        stiffness=np.array(stiffness),
        effect=np.array(effect),
    )


def find_system(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> JointedModes:
    """Return the linear structure, with the factors that are among the parameters of the class."""
    if data.structure is None:
        return data.system
    return data.structure.at(theta[theta.size - len(model_class.factors) :])[0]


def _find_springs(model_class: ModelClass, joints: tuple[str, ...], theta: FloatArray) -> tuple[TermSet, ...]:
    """Return the springs of each joint: dampers move no backbone."""
    every = model_class.laws(joints, theta).values()
    return tuple(TermSet(tuple(term for term in law.terms if not depends_on_rate(term))) for law in every)


def _follow(equations: Balance, amplitude: FloatArray) -> list[FloatArray] | None:
    """Return the unknowns at growing amplitudes; None where there is no solution."""
    points = [linear_unknowns(equations, amplitude[0])]
    for before, at in zip((amplitude[0], *amplitude[:-1]), amplitude, strict=True):
        found = solve_at(equations, np.append(points[-1][:-1] * at / before, points[-1][-1]), at)
        if found is None:
            return None
        points.append(found)
    return points[1:]


# ---- measured points --------------------------------------------------------------------------------


def adapt_to_class(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> BackboneData:
    """Return the backbones as a class with theta, (n_parameters,), sees them.

    Their points are those of its smooth backbone (`with_interactions`), and they have the errors of the modal
    eigenvalues that its laws make (`with_modal_errors`).
    """
    return with_modal_errors(with_interactions(data, model_class, theta), model_class, theta)


def with_interactions(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> BackboneData:
    """Return the backbones with every point moved onto the smooth backbone by the pull of the modes that are met.

    The pull is that at theta, (n_parameters,): it is small, and changes only by about twice the relative change of a
    coefficient. The frequency of each mode that is met has the error of the linear structure, and its damping ratio one
    of its own, which make patterns of errors. Without `met_damping` the data stay as they are.
    """
    if data.met_damping is None or data.form != "recommended":
        return data
    modes = tuple(_pair(data, mode, model_class, theta, data.met_damping) for mode in data.modes)
    return replace(data, modes=modes)


def _pair(data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray, damping: float) -> ModeData:
    pull = _find_pull_on_points(data, mode, model_class, theta)
    smooth, _, _, lost = make_curves(data, mode, model_class)(theta[np.newaxis])
    if pull is None or lost[0]:
        return mode
    unit, at = data.noise.linear_error, mode.eigenvalue
    detuning = _find_detuning(mode, pull, mode.between @ smooth[0], damping, unit)
    patterns = pull.find_patterns(at, damping, detuning, unit)
    # The pull is straight in the detuning near the one that the points tell, and the error counts from none.
    shift = pull.find_shift(at, damping, detuning) - patterns[:, :-1] @ (detuning / unit)
    # Patterns that are small beside the noise of a point are a part of it.
    least = UPDATING.least_pull_error * data.noise.point_noise / unit
    own, size, _ = np.linalg.svd(patterns / (2 * unit * mode.linear), full_matrices=False)
    own = (own * size)[:, size > least * np.sqrt(at.size)]
    errors = (mode.errors or ErrorGrowth.of(data.noise)).with_patterns(own)
    errors = replace(errors, detuning=detuning / unit)
    return with_noise(replace(mode, eigenvalue=at - shift), data.noise, errors)


def _find_pull_on_points(data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray) -> Pull | None:
    """Return the pull on all measured points of a mode, interpolated between its nodes."""
    found = [find_pull(data, mode, model_class, theta, sensor, amplitude) for sensor, amplitude in mode.parts]
    every = [each for each in found if each is not None]
    if len(every) < len(found):
        return None
    joined = {name: np.concatenate([getattr(each, name) for each in every]) for name in ("push", "stiffness", "effect")}
    return replace(every[0], **joined).at(mode.between)


def _find_detuning(mode: ModeData, pull: Pull, smooth: FloatArray, damping: float, unit: float) -> FloatArray:
    """Return the most probable relative errors of the frequencies of the modes that are met, (n_met,).

    Each has a Gaussian prior of the standard deviation `unit`. The curves have offsets and slopes of their own, and
    `smooth` is lambda of the smooth backbone at their points, (n_points,).
    """
    offsets = np.eye(mode.curve[-1] + 1)[mode.curve]
    own = np.linalg.qr(np.column_stack([offsets, mode.growth]))[0]
    detuning = np.zeros(pull.n_met)

    def weigh(tried: FloatArray) -> float:
        error = mode.eigenvalue - pull.find_shift(mode.eigenvalue, damping, tried) - smooth
        left = float(np.sum((error - own @ (own.T @ error)) ** 2))
        return error.size * np.log(left) + float(np.sum((tried / unit) ** 2))

    for _ in range(UPDATING.n_sweeps if detuning.size > 1 else 1):
        for each in range(detuning.size):
            tried = np.tile(detuning, (UPDATING.n_detunings, 1))
            tried[:, each] = unit * np.linspace(-UPDATING.farthest_detuning, UPDATING.farthest_detuning, len(tried))
            detuning = tried[int(np.argmin([weigh(row) for row in tried]))]
    return detuning


def find_pulled(
    data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray, amplitude: FloatArray
) -> FloatArray:
    """Return the change of lambda along the model's own curve at amplitudes of its first controlled sensor, (n,).

    It is 0 where interactions are left out.
    """
    sensor, nothing = mode.parts[0][0], np.zeros(amplitude.size)
    if data.met_damping is None:
        return nothing
    pull = find_pull(data, mode, model_class, theta, sensor, amplitude)
    if pull is None:
        return nothing
    smooth = make_solver(data, model_class, mode, sensor, amplitude)(theta[np.newaxis]).eigenvalue[0]
    shift = nothing
    for _ in range(UPDATING.most_steps_of_pull):
        shift = (shift + pull.find_shift(smooth + shift, data.met_damping)) / 2
    return shift


def find_loop(
    data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return amplitude, m, and frequency, Hz, of the backbone without damping, through the interaction by arclength.

    None where interactions are left out, nothing is met, or the curve does not begin.

    Args:
        data: the backbones.
        mode: the curves of the mode.
        model_class: the laws.
        theta: (n_parameters,) their parameters.
        amplitude: (n,) amplitudes of the first controlled sensor, growing, m.
    """
    if data.met_damping is None or not find_met_modes(data, mode).columns.size:
        return None
    system = find_system(data, model_class, theta)
    try:
        curve = continued_backbone(
            system, _find_springs(model_class, system.joints, theta), mode=mode.mode, sensor=mode.parts[0][0],
            first_amplitude_m=float(amplitude[0]), last_amplitude_m=float(amplitude[-1]), harmonics=data.harmonics,
        )  # fmt: skip
    except InputError:
        return None
    return np.abs(curve.amplitude), curve.frequency_hz


# ---- what is told -----------------------------------------------------------------------------------


def find_omitted_pull(
    data: BackboneData, model_class: ModelClass, theta: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Return how far theta would move if the points that a harmonic pulls off were paired, (n_parameters,).

    The posterior is about Gaussian near its maximum `theta`. With C its `covariance` and g the slopes of the likelihood
    there, the maximum moves by C times the change of g. It is 0 where points are paired, where none is described by
    `describe_interactions`, and in other forms than the recommended one; nan where the likelihood has no slopes.
    """
    still = np.zeros(theta.size)
    if data.form != "recommended" or not describe_interactions(data, model_class, theta):
        return still
    modes = []
    for mode in data.modes:
        pull = _find_pull_on_points(data, mode, model_class, theta)
        shift = 0.0 if pull is None else pull.find_shift(mode.eigenvalue, UPDATING.omitted_damping)
        errors = mode.errors or ErrorGrowth.of(data.noise)
        modes.append(with_noise(replace(mode, eigenvalue=mode.eigenvalue - shift), data.noise, errors))
    values, slopes = [], []
    for each in (data, replace(data, modes=tuple(modes))):
        value, slope = slopes_function(each, model_class)(theta[np.newaxis])
        values.append(value[0])
        slopes.append(slope[0])
    return covariance @ (slopes[1] - slopes[0]) if np.isfinite(values).all() else np.full(theta.size, np.nan)


def describe_interactions(data: BackboneData, model_class: ModelClass, theta: ArrayLike) -> list[str]:
    """Return one clause for each mode and controlled sensor, on the measured points where a harmonic meets a mode.

    Such points may lie off the model's smooth curve. They are those where the model with the interaction has no
    solution for theta, (n_parameters,), or one that differs by more than the expected noise of a point (`point_noise`).
    There is none where such points are paired.
    """
    one = np.asarray(theta, dtype=np.float64)[np.newaxis]
    clauses = []
    for mode in data.modes if data.met_damping is None else ():
        met = find_met_modes(data, mode).columns
        if not met.size:
            continue
        for sensor, _ in mode.parts:
            amplitude = np.unique(mode.amplitude[mode.sensor == sensor])
            whole, smooth = (
                make_solver(data, model_class, mode, sensor, amplitude, is_whole=is_whole)(one).frequency_hz[0]
                for is_whole in (True, False)
            )
            off = np.isfinite(smooth) & ~(np.abs(whole / smooth - 1) <= data.noise.point_noise)
            if off.any():
                clauses.append(
                    f"mode {mode.mode} at {describe_span(amplitude[off])} mm of sensor {sensor!r} ({off.sum()} of "
                    f"{amplitude.size} measured amplitudes) {_describe_meeting(data, met, smooth[off])}"
                )
    return clauses


def _describe_meeting(data: BackboneData, met: IntArray, frequency_hz: FloatArray) -> str:
    orders = np.array([h for h in data.harmonics if h > 1])
    own = data.system.frequency_hz[met]
    apart = np.abs(orders[:, None, None] * frequency_hz / own[:, None] - 1).min(axis=2)
    order, nearest = np.unravel_index(np.argmin(apart), apart.shape)
    return f"harmonic {orders[order]} meets mode {met[nearest] + 1} at {own[nearest]:.4g} Hz"


def warn_of_pairs(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> Iterator[str]:
    """Yield warnings about points that are kept in an interaction.

    `data` are those of `adapt_to_class`, and theta, (n_parameters,), is the best.
    """
    for clause in describe_unpaired(data, model_class, theta):
        yield (
            f"in {clause}: these points lie off every point of the model's curve that the stated damping leaves, as on "
            "a tongue, where one force moves another mode, or where the interaction is not where the structure has it: "
            "leave those points out, or correct met_damping or the structure"
        )
    for clause in describe_lossy(data):
        yield (
            f"in {clause} lie within the resonance of a mode that a harmonic meets, whose losses move the frequency of "
            "quadrature in a way that the model does not have: its intervals may be too narrow, leave those points out"
        )
    for clause in describe_misplaced(data):
        yield (
            f"{clause}, farther than linear_error allows: the interaction lies elsewhere than in the structure, so no "
            "interval of it holds; correct the structure, or leave out the points near the interaction"
        )


def describe_unpaired(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> list[str]:
    """Return one clause for each mode and sensor with points near an interaction that lie off the curve of the model.

    They are farther from most points of their curve than the noise and the error of the pull allow: a loop that the
    stated damping does not leave, or an interaction that the linear structure has elsewhere. `data` are those of
    `adapt_to_class`, and theta, (n_parameters,), is the best.
    """
    clauses = []
    for mode in data.modes if data.met_damping is not None else ():
        met = find_met_modes(data, mode).columns
        eigenvalue, _, _, lost = make_curves(data, mode, model_class)(theta[np.newaxis])
        if not met.size or lost[0] or mode.errors is None:
            continue
        error = (mode.eigenvalue - mode.between @ eigenvalue[0]) / mode.linear
        error = _remove_slopes(error, mode, 2 * data.noise.point_noise)
        noise = max(float(np.median(np.abs(error))) / 0.6745, 2 * data.noise.point_noise)
        patterns = np.zeros((error.size, 1)) if mode.errors.patterns is None else mode.errors.patterns
        allowed = np.hypot(noise, 2 * data.noise.linear_error * np.linalg.norm(patterns, axis=1))
        near = _is_near(data, mode, met, UPDATING.interaction_reach)
        off = near & (np.abs(error) > UPDATING.unpaired_sigma * allowed)
        for sensor, _ in mode.parts:
            mine = off & (mode.sensor == sensor)
            if mine.any():
                hz = np.sqrt(mode.eigenvalue[mine]) / (2 * np.pi)
                clauses.append(
                    f"mode {mode.mode} at {describe_span(mode.amplitude[mine])} mm of sensor {sensor!r} ({mine.sum()} "
                    f"of {(mode.sensor == sensor).sum()} measured points) {_describe_meeting(data, met, hz)}"
                )
    return clauses


def _remove_slopes(error: FloatArray, mode: ModeData, noise: float) -> FloatArray:
    """Return errors of lambda, (n_points,), without the offset and the slope that most points of each curve have.

    The sum of the absolute values of what is left is smallest, except for values below the noise.
    """
    left = error.copy()
    for curve in range(int(mode.curve[-1]) + 1):
        mine = mode.curve == curve
        columns = np.column_stack([np.ones(int(mine.sum())), mode.growth[mine]])
        for _ in range(UPDATING.n_weighings):
            weight = 1 / np.sqrt(np.maximum(np.abs(left[mine]), noise))
            own = np.linalg.lstsq(columns * weight[:, np.newaxis], error[mine] * weight, rcond=None)[0]
            left[mine] = error[mine] - columns @ own
    return left


def _is_near(data: BackboneData, mode: ModeData, met: IntArray, reach: float) -> NDArray[np.bool_]:
    """Return whether a harmonic of each point is nearer to a mode that is met than a fraction of it, (n_points,)."""
    orders = np.array([h for h in data.harmonics if h > 1], dtype=np.float64)
    apart = np.sqrt(mode.eigenvalue)[:, None, None] * orders[:, None] / np.sqrt(data.system.eigenvalue[met]) - 1
    return np.asarray((np.abs(apart) <= reach).any(axis=(1, 2)))


def describe_misplaced(data: BackboneData) -> list[str]:
    """Return one clause for each mode whose points tell that a mode that is met lies elsewhere than in the structure.

    `data` are those of `adapt_to_class`.
    """
    clauses = []
    for mode in data.modes if data.met_damping is not None else ():
        detuning = None if mode.errors is None else mode.errors.detuning
        if detuning is None or np.abs(detuning).max() < UPDATING.most_detuned:
            continue
        worst = int(np.argmax(np.abs(detuning)))
        own = find_met_modes(data, mode).columns[worst]
        percent = 100 * data.noise.linear_error * abs(detuning[worst])
        clauses.append(
            f"the points of mode {mode.mode} have mode {own + 1} at {percent:.1f} % or more from "
            f"{data.system.frequency_hz[own]:.4g} Hz"
        )
    return clauses


def describe_lossy(data: BackboneData) -> list[str]:
    """Return one clause for each mode of which many points lie within the resonance of a mode that is met.

    What that mode loses there moves the frequency at which a sensor is in quadrature, which is no part of the model.
    """
    clauses = []
    for mode in data.modes if data.met_damping is not None else ():
        met = find_met_modes(data, mode).columns
        within = _is_near(data, mode, met, 2 * data.met_damping) if met.size and data.met_damping else np.zeros(1)
        if within.mean() > UPDATING.most_within:
            clauses.append(f"mode {mode.mode} {100 * within.mean():.0f} % of the measured points")
    return clauses
