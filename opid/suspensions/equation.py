"""Where a fit begins: the equations of motion of the body on the integrated measurements, by linear least squares.

With all sensors on the body q'' is known, and so is the motion of every suspension, but for what is slow. Then

    sum_k theta_k part_k q'' + mu (known + loading) q'' + sum_s j_s (k_s z_s + c_s z_s' + f_s(z_s, z_s')) = - unit q''

is linear in everything but the inner parameters of the laws, which are tried on a grid. The noise on both sides biases
the answer by some per cent: it is a start, no estimate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError
from opid.mechanics.kinds import Parameter
from opid.mechanics.laws import LAWS, LINEAR, Law, Term
from opid.signals.motion import filter_like, integrate
from opid.signals.recording import FloatArray
from opid.suspensions.model import Group
from opid.suspensions.run import BodyRun
from opid.suspensions.structure import Body

BAND_HZ = (0.5, 12.0)
HIGH_PASS_HZ = 0.3
# inner scales that are tried, over the rms motion
SCALES = (0.05, 0.15, 0.4, 1.0, 2.5)
# a term must take at least this share of what is left
LEAST_SHARE = 0.08
MOST_TERMS = 2


@dataclass(frozen=True, eq=False)
class Start:
    """Start values of a fit.

    Args:
        groups: which interfaces share what, with the laws found.
        stiffness: of each group and of each spring inside that is to be found, per unit of the reference mass, 1/s^2.
        damping: likewise, 1/s.
        factors: (n_parts,) of the mass matrix.
        inverse_mass: one over the reference mass, 1/kg; None where the runs do not tell it.
        motion_rms: (n_interfaces, 2) rms travel (m) and velocity (m/s).
        explained: share of the inertia forces that the equation explains.
    """

    groups: tuple[Group, ...]
    stiffness: FloatArray
    damping: FloatArray
    factors: FloatArray
    inverse_mass: float | None
    motion_rms: FloatArray
    explained: float


@dataclass(frozen=True, eq=False)
class _Motion:
    """What one run says of the motion: travel and velocity (n_slots, n) and acceleration (n_dof, n)."""

    travel: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    inside: slice


def start_values(
    runs: Sequence[BodyRun],
    body: Body,
    groups: Sequence[Group],
    *,
    mass_free: bool,
    kinds: Sequence[str] = (),
    band_hz: tuple[float, float] = BAND_HZ,
) -> Start:
    """Return start values for the fit of a body.

    Args:
        runs: the runs.
        body: the body.
        groups: which interfaces share what; a law that they have is kept, with its inner values.
        mass_free: whether one over the reference mass is to be found.
        kinds: of law to try, one after the other, where a group has none.
        band_hz: of the equation, Hz.

    Raises:
        InputError: sensors that do not see all degrees of freedom of the body.
    """
    rank = np.linalg.matrix_rank(body.readings)
    if rank < len(body.dof):
        raise InputError(
            f"the sensors on the body see {rank} of its {len(body.dof)} degrees of freedom ({', '.join(body.dof)}): "
            "measure at more places, or take a body with fewer"
        )
    equation = _Equation(tuple(_motion(run, body) for run in runs), tuple(runs), body, mass_free, band_hz)
    found = tuple(groups)
    if kinds:
        found = _with_laws(equation, found, kinds)
    value, left = equation.solve(found)
    return _start(equation, found, value, 1 - left)


def _motion(run: BodyRun, body: Body) -> _Motion:
    """Motion of the slots, all through the same high-pass."""
    n, fs = run.n_samples, run.fs
    accelerations = np.linalg.lstsq(body.readings, run.sprung.T, rcond=None)[0]
    relative = body.rows @ accelerations
    relative[: body.n_interfaces] -= run.unsprung.T
    motions = [integrate(each, fs=fs, high_pass_hz=HIGH_PASS_HZ) for each in relative]
    return _Motion(
        np.array([motion.displacement for motion in motions]),
        np.array([motion.velocity for motion in motions]),
        np.array([filter_like(each, motions[0]) for each in accelerations]),
        motions[0].settled if motions[0].settled.stop - motions[0].settled.start > n // 2 else slice(0, n),
    )


@dataclass(frozen=True, eq=False)
class _Equation:
    """Columns and target of the least squares."""

    motions: tuple[_Motion, ...]
    runs: tuple[BodyRun, ...]
    body: Body
    mass_free: bool
    band_hz: tuple[float, float]

    @property
    def rms(self) -> FloatArray:
        """(n_slots, 2) rms travel and velocity."""
        travel, velocity = (
            np.mean([np.mean(getattr(m, name)[:, m.inside] ** 2, axis=1) for m in self.motions], axis=0)
            for name in ("travel", "velocity")
        )
        return np.sqrt(np.stack([travel, velocity], axis=1))

    def column(self, forces: Sequence[FloatArray]) -> FloatArray:
        """Generalised forces of each run, (n_dof, n), as a column of real numbers."""
        size = np.sqrt(np.mean(self.body.rows[: self.body.n_interfaces] ** 2, axis=0))
        scale = 1 / np.where(size > 0, size, 1.0)
        parts = []
        for motion, run, force in zip(self.motions, self.runs, forces, strict=True):
            inner = force[:, motion.inside]
            n = inner.shape[1]
            # the equation holds at every instant: under a window it needs no end terms
            lines = np.fft.rfft(inner * np.hanning(n) * scale[:, np.newaxis])
            frequency_hz = np.fft.rfftfreq(n, 1 / run.fs)
            lines = lines[:, (frequency_hz >= self.band_hz[0]) & (frequency_hz <= self.band_hz[1])].ravel()
            parts += [lines.real, lines.imag]
        return np.concatenate(parts)

    def of_slots(self, slots: Sequence[int], values: Sequence[FloatArray]) -> FloatArray:
        """Column of forces at some slots; `values` are (n_slots, n) a run."""
        rows = self.body.rows[list(slots)]
        return self.column([rows.T @ value[list(slots)] for value in values])

    def of_term(self, group: Group, term: Term) -> FloatArray:
        """Column of a term of unit amplitude in the law of a group."""
        unit = Law((Term(term.name, (1.0, *term.inner)),))
        slots = list(group.slots)
        forces = [self.body.rows[slots].T @ unit.force(m.travel[slots], m.velocity[slots]) for m in self.motions]
        return self.column(forces)

    @property
    def target(self) -> FloatArray:
        """What the columns have to make."""
        return -self.column([self.body.unit @ m.acceleration for m in self.motions]) - (
            self._known if self.body.absolute else 0.0
        )

    @property
    def _known(self) -> FloatArray:
        """What is known in kg and N/m."""
        body = self.body
        forces = []
        for motion, run in zip(self.motions, self.runs, strict=True):
            force = (body.known + run.loading) @ motion.acceleration
            for slot, spring in enumerate(body.inside, start=body.n_interfaces):
                stiffness, damping = spring.stiffness_n_per_m or 0.0, spring.damping_n_s_per_m or 0.0
                force = force + np.outer(
                    body.rows[slot], stiffness * motion.travel[slot] + damping * motion.velocity[slot]
                )
            forces.append(force)
        return self.column(forces)

    def searched(self) -> Iterator[int]:
        """Slots inside whose springs are to be found."""
        for slot, spring in enumerate(self.body.inside, start=self.body.n_interfaces):
            if spring.stiffness_n_per_m is None:
                yield slot

    def linear(self, groups: Sequence[Group]) -> list[FloatArray]:
        """Columns of everything but the laws: stiffness and damping in turn, factors, mu."""
        travel, velocity = [m.travel for m in self.motions], [m.velocity for m in self.motions]
        columns = []
        for slots in [*(group.slots for group in groups), *((slot,) for slot in self.searched())]:
            columns += [self.of_slots(slots, travel), self.of_slots(slots, velocity)]
        parts = [*self.body.parts, *([] if self.body.product is None else [self.body.product])]
        columns += [self.column([part @ m.acceleration for m in self.motions]) for part in parts]
        return [*columns, *([self._known] if self.mass_free else [])]

    def solve(self, groups: Sequence[Group]) -> tuple[FloatArray, float]:
        """Values of the columns, those of the terms last, and the share of the target that they leave."""
        columns = self.linear(groups)
        columns += [self.of_term(group, term) for group in groups for term in group.law.terms]
        matrix, target = np.stack(columns, axis=1), self.target
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        value = np.linalg.lstsq(matrix / size, target, rcond=1e-10)[0] / size
        left = target - matrix @ value
        return value, float(left @ left / (target @ target))


def _with_laws(equation: _Equation, groups: tuple[Group, ...], kinds: Sequence[str]) -> tuple[Group, ...]:
    """Add the terms that explain most, one after the other, to groups that had no law."""
    rms, open_groups = equation.rms, [k for k, group in enumerate(groups) if not group.law.terms]
    offered = [
        (k, term, equation.of_term(groups[k], term))
        for k in open_groups
        for kind in kinds
        for term in _candidates(kind, rms[list(groups[k].slots)].mean(axis=0))
    ]
    matrix, target = np.stack(equation.linear(groups), axis=1), equation.target
    for _ in range(MOST_TERMS * len(open_groups)):
        basis = np.linalg.qr(matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300))[0]
        left = target - basis @ (basis.T @ target)
        gains = []
        for k, term, column in offered:
            taken = term.name in groups[k].law.parameters or len(groups[k].law.terms) >= MOST_TERMS
            rest = column - basis @ (basis.T @ column)
            size = float(rest @ rest)
            gains.append(float(rest @ left) ** 2 / size if not taken and size > 1e-8 * float(column @ column) else 0.0)
        best = int(np.argmax(gains))
        if gains[best] < LEAST_SHARE * float(left @ left):
            break
        k, term, column = offered[best]
        groups = tuple(
            replace(group, law=group.law + Law((term,))) if number == k else group
            for number, group in enumerate(groups)
        )
        matrix = np.column_stack([matrix, column])
    return groups


def _candidates(kind: str, rms: FloatArray) -> Iterator[Term]:
    """Terms of unit amplitude of a kind, at some inner scales."""
    inner = LAWS[kind].parameters[1:]
    for share in SCALES if any(parameter.role == "scale" for parameter in inner) else (1.0,):
        yield Term(kind, (1.0, *(_inner(parameter, share, rms) for parameter in inner)))


def _inner(parameter: Parameter, share: float, rms: FloatArray) -> float:
    """An inner value of a term: a scale is a share of the rms motion."""
    if parameter.role != "scale":
        return parameter.default
    return share * float(rms[1] if parameter.unit == "m/s" else rms[0])


def _start(equation: _Equation, groups: tuple[Group, ...], value: FloatArray, explained: float) -> Start:
    body, n_springs = equation.body, len(groups) + len(list(equation.searched()))
    springs, rest = value[: 2 * n_springs].reshape(-1, 2), value[2 * n_springs :]
    n_parts = len(body.parts)
    # the product of two factors is fitted as a factor of its own, and forgotten
    factors, rest = rest[:n_parts], rest[n_parts + (body.product is not None) :]
    mu, rest = (float(rest[0]), rest[1:]) if equation.mass_free else (None, rest)
    amplitudes = iter(rest.tolist())
    with_laws = tuple(
        replace(group, law=Law(tuple(Term(t.name, (next(amplitudes), *t.inner)) for t in group.law.terms)))
        if group.law.terms
        else replace(group, law=LINEAR)
        for group in groups
    )
    n = body.n_interfaces
    return Start(with_laws, springs[:, 0], springs[:, 1], factors, mu, equation.rms[:n], explained)
