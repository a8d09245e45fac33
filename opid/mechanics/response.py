"""The time response of a structure to forces, at once or block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError
from opid.mechanics.kernels import law_arrays, structure_steps
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.structure import Structure

# largest decay of a memory in a step, as its rate times the step; from 2.8 on the steps would grow without bound. The
# truth is simulated with half of the decay that the predictor allows.
_MOST_DECAY = 1.0


@dataclass(frozen=True, eq=False)
class Response:
    """Motion of a structure at a uniform rate.

    Attributes:
        time_s: (n,) time, s.
        displacement: (n, n_dof) displacement, m.
        velocity: (n, n_dof) velocity, m/s.
        acceleration: (n, n_dof) acceleration, m/s^2.
        fs: sampling rate, Hz.
    """

    time_s: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    fs: float


@dataclass(frozen=True, eq=False)
class State:
    """The state of a structure at one time: its further motion only depends on the state and on the force.

    Attributes:
        displacement: (n_dof,) displacement, m.
        velocity: (n_dof,) velocity, m/s.
        slider_positions: (n_sliders,) positions of the sliders of all joints, in their order, m.
        memory: (n_memories,) memories of the laws of all joints, in their order.
    """

    displacement: FloatArray
    velocity: FloatArray
    slider_positions: FloatArray
    memory: FloatArray


@dataclass(frozen=True, eq=False)
class Assembled:
    """A structure in the form that the compiled time step takes, with all matrices multiplied by M^-1.

    Attributes:
        n_dof: number of degrees of freedom.
        n_inputs: number of forces.
        n_sliders: number of sliders of all joints.
        n_memories: number of terms with memory in the laws of all joints.
        matrices: stiffness and damping without the joints, first and last nonzero of each row, and M^-1 loads.
        joints: directions of the joints, ranges of their entries, linear stiffness and damping, loads, laws, and
            stiffness and reach of the sliders.
    """

    n_dof: int
    n_inputs: int
    n_sliders: int
    n_memories: int
    matrices: tuple[Any, ...]
    joints: tuple[Any, ...]


def time_response(
    structure: Structure,
    force: Callable[[FloatArray], ArrayLike] | ArrayLike,
    *,
    fs: float,
    duration_s: float,
    initial_displacement: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
    loads: ArrayLike | None = None,
    steps_per_sample: int = 1,
) -> Response:
    """Return the motion of a structure under a force, by the classical Runge-Kutta method of order 4.

    The step h = 1 / (fs steps_per_sample) is explicit. Its relative error of the frequency of a mode of omega rad/s is
    (omega h)^4 / 120: take omega h < 0.2 for the highest mode of interest, where the error is 1e-5. Every mode, excited
    or not, needs omega h < 2.8, beyond which it grows without bound. Sliders are dragged along at the end of each step,
    so with a joint that slips the error falls with the square of the step.

    Args:
        structure: the structure with its nonlinear joints.
        force: function of time (m,) s that gives forces (m, n_inputs) N; or these forces at half steps,
            t = k h / 2 for k = 0 ... 2 (n - 1) steps_per_sample.
        fs: sampling rate, Hz.
        duration_s: length of the response, s: it has n = round(fs duration_s) samples, the first at time 0.
        initial_displacement: (n_dof,) displacement at the start, m; zero where left out. Sliders come to it from zero.
        initial_velocity: (n_dof,) velocity at the start, m/s; zero where left out.
        loads: (n_dof, n_inputs) generalised force of each input of 1 N; one input for each degree of freedom where left
            out.
        steps_per_sample: steps from one sample to the next.

    Raises:
        InputError: a force of the wrong shape or not finite, a response that grows without bound, or a law with
            memory that reverses within a step.

    >>> swing = Structure([[1.0]], [[0.0]], [[(2.0 * np.pi) ** 2]])
    >>> motion = time_response(swing, lambda t: np.zeros((t.size, 1)), fs=1000.0, duration_s=1.0,
    ...                        initial_displacement=[1.0])
    >>> motion.displacement[500].round(6)
    array([-1.])
    """
    if not (fs > 0.0 and np.isfinite(fs) and np.isfinite(duration_s)):
        raise InputError(f"fs is {fs} Hz and the duration {duration_s} s: give positive numbers")
    n_samples = round(fs * duration_s)
    if n_samples < 2:
        raise InputError(f"{duration_s} s at {fs} Hz make {n_samples} sample(s): at least two are needed")
    require_steps(steps_per_sample)
    ready = assemble(structure, loads)
    n_half_steps = 2 * (n_samples - 1) * steps_per_sample + 1
    forces = _sample_force(force, n_half_steps, ready.n_inputs, fs * steps_per_sample)
    start = state_at(ready, initial_displacement, initial_velocity)
    return advance(ready, start, forces, fs=fs, steps_per_sample=steps_per_sample)[0]


def assemble(structure: Structure, loads: ArrayLike | None = None) -> Assembled:
    """Return a structure that is ready for `advance`; `loads` are those of `time_response`.

    Raises:
        InputError: loads of the wrong shape or not finite.
    """
    n_dof = structure.n_dof
    inputs = np.eye(n_dof) if loads is None else np.array(loads, dtype=np.float64)
    if inputs.ndim != 2 or inputs.shape[0] != n_dof or inputs.shape[1] == 0 or not np.isfinite(inputs).all():
        raise InputError(
            f"the loads have shape {inputs.shape}: give ({n_dof}, n_inputs) finite numbers, one column for each input"
        )
    inverse = np.linalg.inv(structure.mass)
    stiffness, damping = inverse @ structure.stiffness, inverse @ structure.damping
    inputs = inverse @ inputs
    matrices = (
        stiffness,
        damping,
        np.hstack([_find_spans((stiffness != 0) | (damping != 0)), _find_spans(inputs != 0)]),
        inputs,
    )

    joints = structure.joints
    directions = np.array([joint.direction for joint in joints]).reshape(len(joints), n_dof)
    loads_of_joints = directions @ inverse
    linear = np.array([(joint.stiffness_n_per_m, joint.damping_n_s_per_m) for joint in joints]).reshape(-1, 2)
    sliders = [
        (each.stiffness_n_per_m, each.slip_force_n / each.stiffness_n_per_m) if each else np.empty((2, 0))
        for each in (joint.sliders for joint in joints)
    ]
    slider_firsts = np.cumsum([0, *(len(each[0]) for each in sliders)], dtype=np.int64)
    laws = law_arrays(*(joint.law for joint in joints))
    ranges = [slider_firsts[:-1], slider_firsts[1:], laws.firsts[:-1], laws.firsts[1:]]
    spans = np.column_stack([_find_spans(directions != 0), _find_spans(loads_of_joints != 0), *ranges])
    table = np.hstack([np.empty((2, 0)), *sliders])
    return Assembled(
        n_dof=n_dof,
        n_inputs=inputs.shape[1],
        n_sliders=table.shape[1],
        n_memories=len(laws.elements),
        matrices=matrices,
        joints=(directions, spans, linear, loads_of_joints, laws[1:5], table),
    )


def state_at(ready: Assembled, displacement: ArrayLike | None = None, velocity: ArrayLike | None = None) -> State:
    """Return the state of a structure, `ready`, that came from rest at zero to a displacement, m, and a velocity, m/s.

    Raises:
        InputError: a wrong number of values, or values that are not finite.
    """
    return State(
        initial_values("initial_displacement", displacement, ready.n_dof),
        initial_values("initial_velocity", velocity, ready.n_dof),
        np.zeros(ready.n_sliders),
        np.zeros(ready.n_memories),
    )


def advance(
    ready: Assembled, state: State, forces: FloatArray, *, fs: float, steps_per_sample: int = 1
) -> tuple[Response, State]:
    """Return the motion that begins at a state, and the state at its last sample, at which another call can begin.

    The time of the response counts from the given state. Its last sample is the first one of the next call.

    Args:
        ready: the structure, see `assemble`.
        state: the state at which the motion begins.
        forces: (2 n steps_per_sample + 1, n_inputs) forces at half steps, t = k / (2 fs steps_per_sample), N; n + 1
            samples are returned.
        fs: sampling rate, Hz.
        steps_per_sample: steps from one sample to the next.

    Raises:
        InputError: forces of another shape or not finite, a response that grows without bound, or a law with memory
            that reverses within a step.

    >>> swing = assemble(Structure([[1.0]], [[0.0]], [[(2.0 * np.pi) ** 2]]))
    >>> state = state_at(swing, [1.0])
    >>> for _ in range(2):
    ...     motion, state = advance(swing, state, np.zeros((501, 1)), fs=1000.0)
    >>> state.displacement.round(6)
    array([-1.])
    """
    n_steps, odd = divmod(len(forces), 2)
    if forces.ndim != 2 or forces.shape[1] != ready.n_inputs or odd != 1 or n_steps % steps_per_sample:
        raise InputError(
            f"the forces have shape {forces.shape}: give (2 n {steps_per_sample} + 1, {ready.n_inputs}), "
            "one row for each half step of n samples and one column for each input"
        )
    if not np.isfinite(forces).all():
        raise InputError("the force has values that are not finite: correct it before it drives a structure")
    displacement, velocity, acceleration, positions, memory, quickest = structure_steps(
        ready.matrices,
        ready.joints,
        np.ascontiguousarray(forces),
        1.0 / (fs * steps_per_sample),
        steps_per_sample,
        state.displacement,
        state.velocity,
        state.slider_positions,
        state.memory,
    )
    if not np.isfinite(acceleration).all():
        _refuse_unbounded(acceleration, fs, steps_per_sample, has_memory=ready.n_memories > 0)
    needed = int(np.ceil(quickest / (_MOST_DECAY * fs)))
    if needed > steps_per_sample:
        raise InputError(
            f"a law with memory reverses within {1e3 / quickest:.2g} ms where the structure moves fastest, and a step "
            f"is {1e3 / (fs * steps_per_sample):.2g} ms: take {needed} steps per sample, or a longer presliding travel"
        )
    time_s = np.arange(acceleration.shape[0]) / fs
    motion = Response(time_s, displacement, velocity, acceleration, float(fs))
    return motion, State(displacement[-1].copy(), velocity[-1].copy(), positions, memory)


def _find_spans(nonzero: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the first true index of each row and the one after the last, (n, 2); both 0 where none is true."""
    n_columns = nonzero.shape[1]
    some = nonzero.any(axis=1)
    first, last = nonzero.argmax(axis=1), n_columns - nonzero[:, ::-1].argmax(axis=1)
    return np.column_stack([np.where(some, first, 0), np.where(some, last, 0)]).astype(np.int64)


def _sample_force(
    force: Callable[[FloatArray], ArrayLike] | ArrayLike, n_half_steps: int, n_inputs: int, step_rate_hz: float
) -> FloatArray:
    given = force(np.arange(n_half_steps) / (2.0 * step_rate_hz)) if callable(force) else force
    forces = np.asarray(given, dtype=np.float64)
    if forces.shape != (n_half_steps, n_inputs):
        raise InputError(
            f"the force has shape {forces.shape}: give {(n_half_steps, n_inputs)}, "
            "one row for each half step and one column for each degree of freedom or, with loads, each input"
        )
    return forces


def initial_values(name: str, given: ArrayLike | None, n_dof: int) -> FloatArray:
    """Return displacements or velocities at the start, (n_dof,); zero where none are given."""
    state = np.zeros(n_dof) if given is None else np.array(given, dtype=np.float64)
    if state.shape != (n_dof,) or not np.isfinite(state).all():
        raise InputError(f"{name} is {given!r}: give {n_dof} finite number(s), one for each degree of freedom")
    return state


def require_steps(steps_per_sample: int) -> None:
    """Refuse a number of steps that is not whole and positive."""
    if steps_per_sample != int(steps_per_sample) or steps_per_sample < 1:
        raise InputError(f"steps_per_sample is {steps_per_sample}: give a whole number, 1 or more")


def _refuse_unbounded(acceleration: FloatArray, fs: float, steps_per_sample: int, *, has_memory: bool) -> None:
    unbounded = ~np.isfinite(acceleration).all(axis=1)
    rate = f"fs above {fs:g} Hz" if steps_per_sample == 1 else f"steps_per_sample above {steps_per_sample}"
    raise InputError(
        f"the response grows without bound and overflows at {np.argmax(unbounded) / fs:g} s: "
        f"take {rate}{' (a law with memory reverses fast)' if has_memory else ''}, or look for negative stiffness or "
        "damping"
    )
