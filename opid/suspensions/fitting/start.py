"""Start values of a fit: linear least squares on the equations of motion of the body with integrated measurements.

The sensors on the body give q'', and with it the motion of every suspension, except slow motion. Then

    sum_k theta_k part_k q'' + mu (known + loading) q'' + sum_s j_s (k_s z_s + c_s z_s' + f_s(z_s, z_s')) = - unit q''

is linear in everything except the inner parameters of the laws, which are tried on a grid. The noise on both sides
biases the solution by some per cent: it is a start value and not an estimate. For one gear, the initial state of each
run is searched over its first seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from scipy import interpolate

from opid.errors import InputError
from opid.mechanics.driven import UnboundedResponseError, misfits_of_starts
from opid.mechanics.laws.law import LINEAR, Law, Term
from opid.mechanics.memory import force_along
from opid.signals.motion import filter_like, integrate
from opid.signals.recording import FloatArray
from opid.suspensions.law_search.dictionary import may_stand_together
from opid.suspensions.model.body import Body
from opid.suspensions.model.driven_model import Model, state_at_start
from opid.suspensions.model.law_parameters import list_terms
from opid.suspensions.model.run import DrivenRun
from opid.suspensions.model.unknowns import Group
from opid.suspensions.sensor_facts import Fault
from opid.suspensions.settings import StartSettings


@dataclass(frozen=True, eq=False)
class Start:
    """Start values of a fit.

    Args:
        groups: the groups of interfaces, with the laws found.
        stiffness: stiffness of each group and of each unknown spring inside, per unit of the reference mass, 1/s^2.
        damping: damping of the same, 1/s.
        factors: (n_parts,) free factors of the mass matrix.
        inverse_mass: one over the reference mass, 1/kg; None if it is not fitted.
        motion_rms: (n_interfaces, 2) rms travel (m) and velocity (m/s).
        ground_stiffness: stiffness of a spring to the ground at each group if it had one, per unit of the reference
            mass, 1/s^2.
        ground_std: approximate standard deviation of it.
        stiffness_beside_ground: stiffness of each group beside these springs.
        lags: delay of each sensor with a stated tolerance, by the name of the fault, s.

    The groups have springs to the ground if the equation demands them and no sensor fault would imitate them.
    """

    groups: tuple[Group, ...]
    stiffness: FloatArray
    damping: FloatArray
    factors: FloatArray
    inverse_mass: float | None
    motion_rms: FloatArray
    ground_stiffness: FloatArray
    ground_std: FloatArray
    stiffness_beside_ground: FloatArray
    lags: Mapping[str, float] = field(default_factory=dict)

    @property
    def has_ground(self) -> bool:
        """Whether the groups have springs to the ground."""
        return any(group.ground for group in self.groups)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of one run: travel, position and their rates, (n_attachments, n) each, and acceleration, (n_dof, n)."""

    travel: FloatArray
    velocity: FloatArray
    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    inside: slice


def start_values(
    runs: Sequence[DrivenRun],
    body: Body,
    groups: Sequence[Group],
    *,
    mass_free: bool,
    ground: bool = False,
    kinds: Sequence[str] = (),
    lags: Sequence[Fault] = (),
    settings: StartSettings | None = None,
) -> Start:
    """Return start values for the fit of a body.

    Args:
        runs: the runs.
        body: the body.
        groups: the groups of interfaces; a law that they have is kept, with its inner values.
        mass_free: whether one over the reference mass is fitted.
        ground: whether the groups may have springs to the ground.
        kinds: the kinds of terms that are tried in turn for a group without a law.
        lags: unknown delays of sensors: a delay of some samples looks like a law with memory.
        settings: the settings of the equation.

    Raises:
        InputError: sensors that do not see all degrees of freedom of the body.
    """
    rank = np.linalg.matrix_rank(body.readings)
    if rank < len(body.dof):
        raise InputError(
            f"the sensors on the body see {rank} of its {len(body.dof)} degrees of freedom ({', '.join(body.dof)}): "
            "measure at more places, or take a body with fewer"
        )
    settings = settings or StartSettings()

    def equation_of(runs: Sequence[DrivenRun], settings: StartSettings) -> _Equation:
        motions = tuple(_integrate_motion(run, body, settings) for run in runs)
        return _Equation(motions, tuple(runs), body, mass_free, settings)

    # A delay changes the phase most at high frequencies.
    highest_hz = float(runs[0].omega[-1]) / (2 * np.pi)
    quick = replace(settings, band_hz=(settings.lag_fraction * highest_hz, highest_hz))
    delays = {}
    for lag in lags:
        delayed = [run for run in runs if lag.run in (None, run.number)]
        if not delayed:
            continue
        delays[lag.name] = _find_delay(partial(equation_of, settings=quick), delayed, lag, groups, settings)
        runs = [_remove_delay(run, lag, delays[lag.name]) if run in delayed else run for run in runs]
    equation = equation_of(runs, settings)
    if lags:
        # A stiff suspension may hardly move in the usual band, so the higher band is tried, too.
        equation = min((equation, equation_of(runs, quick)), key=lambda each: each.left(groups))
    found = tuple(replace(group, ground=ground) for group in groups)
    if ground and not equation.demands_ground(found):
        found = tuple(replace(group, ground=False) for group in groups)
    if kinds:
        found = _with_laws(equation, found, kinds)
    return replace(_solve_start(equation, found), lags=delays)


@dataclass(frozen=True)
class Contact:
    """What tells that a body rubs on something that stands still.

    Args:
        explained: fraction of the power that spring, damper and a friction of the suspension leave while the body
            slides, which a friction against the ground explains.
        sliding: fraction of the time in which it slides.
        frequency_hz: natural frequency on its suspension, from the equation with that friction.
        frequency_std_hz: its standard deviation, from parts of the runs and from what counts as sliding.
        friction_n_per_kg: that friction in each run, over the mass.
    """

    explained: float
    sliding: float
    frequency_hz: float
    frequency_std_hz: float
    friction_n_per_kg: tuple[float, ...]


def measure_contact(runs: Sequence[DrivenRun], body: Body, settings: StartSettings) -> Contact:
    """Return how far friction against the ground explains the motion of a body on one suspension.

    A body that rubs on something that stands still has a force -f sgn(v), v its own velocity and not that of the
    travel, so that no law of a suspension is like it. While it sticks, any force up to f acts. The equation of motion
    x'' = -k z - c z' - g sgn(z') - f sgn(v) + d is therefore solved by least squares over the samples in which it
    slides; each run has an f and a d of its own.

    Args:
        runs: the runs.
        body: the body.
        settings: the settings of the equation.
    """
    columns = [_list_columns_of_contact(run, body, settings) for run in runs]
    slow, usual, quick = (_solve_contact(columns, fraction, settings) for fraction in settings.sliding_fractions)
    # What a friction does near rest is not this law, so that the value depends on what counts as sliding.
    apart_hz = max(abs(each.frequency_hz - usual.frequency_hz) for each in (slow, quick))
    return replace(usual, frequency_std_hz=float(np.hypot(usual.frequency_std_hz, apart_hz)))


def _list_columns_of_contact(run: DrivenRun, body: Body, settings: StartSettings) -> FloatArray:
    """Return acceleration, travel, its rate, sign of that, speed, and sign of that, (6, n), all filtered alike."""
    # A lower corner would spoil more than half of a short run at its ends.
    corner_hz = max(settings.high_pass_hz, 4.0 * run.recorded_fs / len(run.sprung))
    motion = _integrate_motion(run, body, replace(settings, high_pass_hz=corner_hz))
    signs = [
        integrate(np.sign(each[0]), fs=run.recorded_fs, high_pass_hz=corner_hz).acceleration[np.newaxis]
        for each in (motion.velocity, motion.speed)
    ]
    every = (motion.acceleration, motion.travel, motion.velocity, signs[0], motion.speed, signs[1])
    return np.stack([each[0, motion.inside] for each in every])


def _solve_contact(columns: Sequence[FloatArray], fraction: float, settings: StartSettings) -> Contact:
    """Solve the equation where the speed of each run is above a fraction of its rms."""
    sliding = [np.abs(speed) > fraction * speed.std() for *_, speed, _ in columns]
    target, travel, velocity, along, _, sign = np.hstack([own[:, on] for own, on in zip(columns, sliding, strict=True)])
    of_run = np.repeat(np.eye(len(columns)), [int(on.sum()) for on in sliding], axis=0)
    # A friction of the suspension is taken off, too, for near a resonance the body moves about as its travel does.
    plain = np.column_stack([-travel, -velocity, -along, of_run])
    full = np.column_stack([plain, -of_run * sign[:, np.newaxis]])

    def solve(matrix: FloatArray, kept: FloatArray | slice = slice(None)) -> FloatArray:
        return np.asarray(np.linalg.lstsq(matrix[kept], target[kept], rcond=1e-10)[0])

    left = [float(np.sum((target - matrix @ solve(matrix)) ** 2)) for matrix in (plain, full)]
    value = solve(full)
    # Neighbouring samples are not independent: the scatter is that of values without one part of the runs.
    part = np.arange(target.size) * settings.n_parts // target.size
    stiffness = np.array([solve(full, part != k)[0] for k in range(settings.n_parts)])
    std = float(np.sqrt((settings.n_parts - 1) * stiffness.var()))
    omega = float(np.sqrt(max(value[0], 0.0)))
    return Contact(
        explained=1.0 - left[1] / left[0] if left[0] else 0.0,
        sliding=float(np.mean([on.mean() for on in sliding])),
        frequency_hz=omega / (2 * np.pi),
        frequency_std_hz=std / (4 * np.pi * omega) if omega else np.inf,
        friction_n_per_kg=tuple(float(each) for each in value[-len(columns) :]),
    )


def _find_delay(
    equation_of: Callable[[Sequence[DrivenRun]], _Equation],
    runs: Sequence[DrivenRun],
    lag: Fault,
    groups: Sequence[Group],
    settings: StartSettings,
) -> float:
    """Return the delay with which the equation leaves the smallest residual: on a grid, then on finer grids."""

    def left(delay_s: float) -> float:
        return equation_of([_remove_delay(run, lag, delay_s) for run in runs]).left(groups)

    best, reach = lag.nominal, settings.lag_std * lag.std
    for _ in range(settings.lag_rounds):
        grid = best + np.linspace(-reach, reach, settings.n_lags)
        best = float(min(grid.tolist(), key=left))
        reach = 2 * reach / (settings.n_lags - 1)
    return best


def _remove_delay(run: DrivenRun, lag: Fault, delay_s: float) -> DrivenRun:
    """Return a run without the delay of one sensor."""
    if not delay_s:
        return run
    time = np.arange(len(run.sprung)) / run.recorded_fs
    side = (run.sprung if lag.side == "sprung" else run.unsprung).copy()
    spline = interpolate.make_interp_spline(time, side[:, lag.channel], k=3)
    side[:, lag.channel] = spline(np.clip(time + delay_s, 0.0, time[-1]))
    return replace(run, sprung=side) if lag.side == "sprung" else replace(run, unsprung=side)


def _integrate_motion(run: DrivenRun, body: Body, settings: StartSettings) -> _Motion:
    """Return the motion of the attachments, all filtered by the same high-pass."""
    n, fs = len(run.sprung), run.recorded_fs
    accelerations = np.linalg.lstsq(body.readings, run.sprung.T, rcond=None)[0]
    own = body.rows @ accelerations
    relative = own.copy()
    relative[: body.n_interfaces] -= run.unsprung.T
    motions = [integrate(each, fs=fs, high_pass_hz=settings.high_pass_hz) for each in relative]
    places = [integrate(each, fs=fs, high_pass_hz=settings.high_pass_hz) for each in own]
    return _Motion(
        np.array([motion.displacement for motion in motions]),
        np.array([motion.velocity for motion in motions]),
        np.array([place.displacement for place in places]),
        np.array([place.velocity for place in places]),
        np.array([filter_like(each, motions[0]) for each in accelerations]),
        motions[0].interior if motions[0].interior.stop - motions[0].interior.start > n // 2 else slice(0, n),
    )


@dataclass(frozen=True, eq=False)
class _Equation:
    """Columns and target of the least-squares problem."""

    motions: tuple[_Motion, ...]
    runs: tuple[DrivenRun, ...]
    body: Body
    mass_free: bool
    settings: StartSettings

    @property
    def rms(self) -> FloatArray:
        """(n_attachments, 2) rms travel and velocity."""
        travel, velocity = (
            np.mean([np.mean(getattr(m, name)[:, m.inside] ** 2, axis=1) for m in self.motions], axis=0)
            for name in ("travel", "velocity")
        )
        return np.sqrt(np.stack([travel, velocity], axis=1))

    def column(self, forces: Sequence[FloatArray], *, is_coarse: bool = False) -> FloatArray:
        """Return the generalised forces of each run, (n_dof, n), as a column; at the coarse rate with `is_coarse`."""
        size = np.sqrt(np.mean(self.body.rows[: self.body.n_interfaces] ** 2, axis=0))
        scale = 1 / np.where(size > 0, size, 1.0)
        parts = []
        for run, (window, inside, indices), force in zip(self.runs, self._windows, forces, strict=True):
            every = run.coarse.stride if is_coarse else 1
            # The equation holds at every instant, so that it needs no end terms under a window.
            inner = force if is_coarse else force[:, inside]
            lines = every * np.fft.rfft(inner * window[::every] * scale[:, np.newaxis])
            lines = lines[:, indices].ravel()
            parts += [lines.real, lines.imag]
        return np.concatenate(parts)

    @cached_property
    def _windows(self) -> list[tuple[FloatArray, slice, slice]]:
        """For each run a window, its samples, in number a multiple of the coarse step, and the lines of the band."""
        found = []
        for motion, run in zip(self.motions, self.runs, strict=True):
            first, stop = motion.inside.start, motion.inside.stop
            n = stop - first - (stop - first) % run.coarse.stride
            frequency_hz = np.fft.rfftfreq(n, 1 / run.recorded_fs)
            low, high = np.searchsorted(frequency_hz, self.settings.band_hz)
            high += high < frequency_hz.size and frequency_hz[high] == self.settings.band_hz[1]
            found.append((np.hanning(n), slice(first, first + n), slice(int(low), int(high))))
        return found

    def of_attachments(self, attachments: Sequence[int], values: Sequence[FloatArray]) -> FloatArray:
        """Return the column of forces at some attachments; `values` are (n_attachments, n) for each run."""
        rows = self.body.rows[list(attachments)]
        return self.column([rows.T @ value[list(attachments)] for value in values])

    def of_term(self, group: Group, term: Term, *, is_coarse: bool = False) -> FloatArray:
        """Return the column of a term of unit amplitude in the law of a group; at the coarse rate with `is_coarse`."""
        unit = Law((Term(term.name, (1.0, *term.inner)),))
        forces = []
        for motion, run, (_, inside, _) in zip(self.motions, self.runs, self._windows, strict=True):
            every = run.coarse.stride if is_coarse else 1
            taken, fs = slice(inside.start, inside.stop, every) if is_coarse else slice(None), run.recorded_fs / every
            own = [force_along(unit, motion.travel[k, taken], motion.velocity[k, taken], fs) for k in group.members]
            forces.append(self.body.rows[list(group.members)].T @ np.stack(own))
        return self.column(forces, is_coarse=is_coarse)

    @property
    def target(self) -> FloatArray:
        """The right-hand side of the equation."""
        return -self.column([self.body.unit @ m.acceleration for m in self.motions]) - (
            self._known if self.body.absolute else 0.0
        )

    @property
    def _known(self) -> FloatArray:
        """The column of all that is known in kg and N/m."""
        body = self.body
        forces = []
        for motion, run in zip(self.motions, self.runs, strict=True):
            force = (body.known + run.loading) @ motion.acceleration
            for attachment, spring in enumerate(body.inside, start=body.n_interfaces):
                stiffness, damping = spring.stiffness_n_per_m or 0.0, spring.damping_n_s_per_m or 0.0
                force = force + np.outer(
                    body.rows[attachment], stiffness * motion.travel[attachment] + damping * motion.velocity[attachment]
                )
            forces.append(force)
        return self.column(forces)

    def searched(self) -> Iterator[int]:
        """Yield the attachments of the unknown springs inside."""
        for attachment, spring in enumerate(self.body.inside, start=self.body.n_interfaces):
            if spring.stiffness_n_per_m is None:
                yield attachment

    def linear(self, groups: Sequence[Group]) -> list[FloatArray]:
        """Return all columns except laws and ground springs: stiffness and damping in turn, factors, mu."""
        travel, velocity = [m.travel for m in self.motions], [m.velocity for m in self.motions]
        columns = []
        for attachments in [*(group.members for group in groups), *((attachment,) for attachment in self.searched())]:
            columns += [self.of_attachments(attachments, travel), self.of_attachments(attachments, velocity)]
        parts = [*self.body.parts, *([] if self.body.product is None else [self.body.product])]
        columns += [self.column([part @ m.acceleration for m in self.motions]) for part in parts]
        return [*columns, *([self._known] if self.mass_free else [])]

    def springs_to_ground(self, groups: Sequence[Group]) -> list[FloatArray]:
        """Return the columns of the springs to the ground, for the groups that have them."""
        positions = [m.position for m in self.motions]
        return [self.of_attachments(group.members, positions) for group in groups if group.ground]

    def demands_ground(self, groups: Sequence[Group]) -> bool:
        """Whether the equation demands ground springs that a sensor fault would hardly imitate."""
        value, std = self.solve(groups)
        n, known = len(groups), self.settings
        ground, beside = np.abs(value[-n:]), np.abs(value[: 2 * n : 2])
        return bool(np.any((ground > known.ground_std * std[-n:]) & (ground > known.ground_fraction * beside)))

    def left(self, groups: Sequence[Group]) -> float:
        """Return the norm that stiffness, damping and masses leave of the target, as a fraction of its norm."""
        matrix, target = np.stack(self.linear(groups), axis=1), self.target
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        value = np.linalg.lstsq(matrix / size, target, rcond=1e-10)[0]
        return float(np.linalg.norm(target - matrix / size @ value) / np.linalg.norm(target))

    def solve(self, groups: Sequence[Group]) -> tuple[FloatArray, FloatArray]:
        """Return the values of the columns and their standard deviations; terms and then ground springs come last."""
        columns = self.linear(groups)
        columns += [self.of_term(group, term) for group in groups for term in group.law.terms]
        columns += self.springs_to_ground(groups)
        matrix, target = np.stack(columns, axis=1), self.target
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        value = np.linalg.lstsq(matrix / size, target, rcond=1e-10)[0] / size
        left = target - matrix @ value
        inverse = np.linalg.pinv((matrix / size).T @ (matrix / size), rcond=1e-12, hermitian=True)
        std = np.sqrt(np.maximum(np.diag(inverse), 0.0) * float(left @ left) / left.size) / size
        return value, std


def _with_laws(equation: _Equation, groups: tuple[Group, ...], kinds: Sequence[str]) -> tuple[Group, ...]:
    """Add the terms that explain most, one after the other, to groups that had no law."""
    rms, open_groups = equation.rms, [k for k, group in enumerate(groups) if not group.law.terms]
    offered = [
        # Every few samples are enough to rank the terms.
        (k, term, equation.of_term(groups[k], term, is_coarse=True))
        for k in open_groups
        for kind in kinds
        for term in _list_candidates(kind, rms[list(groups[k].members)].mean(axis=0), equation.settings)
    ]
    most_terms = equation.settings.most_terms
    matrix = np.stack([*equation.linear(groups), *equation.springs_to_ground(groups)], axis=1)
    target = equation.target
    for _ in range(most_terms * len(open_groups)):
        basis = np.linalg.qr(matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300))[0]
        left = target - basis @ (basis.T @ target)
        gains = []
        for k, term, column in offered:
            have = groups[k].law
            taken = term.name in have.parameters or len(have.terms) >= most_terms
            taken |= not may_stand_together([*have.parameters, term.name])
            rest = column - basis @ (basis.T @ column)
            size = float(rest @ rest)
            gains.append(float(rest @ left) ** 2 / size if not taken and size > 1e-8 * float(column @ column) else 0.0)
        best = int(np.argmax(gains))
        if gains[best] < equation.settings.least_fraction * float(left @ left):
            break
        k, term, column = offered[best]
        groups = tuple(
            replace(group, law=group.law + Law((term,))) if number == k else group
            for number, group in enumerate(groups)
        )
        matrix = np.column_stack([matrix, column])
    return groups


def _list_candidates(kind: str, rms: FloatArray, settings: StartSettings) -> list[Term]:
    """Return terms of unit amplitude of a kind, at several inner scales."""
    return list_terms(
        kind,
        travel_rms=float(rms[0]),
        velocity_rms=float(rms[1]),
        n_scales=settings.n_scales,
        fractions=settings.scale_fractions,
    )


def _solve_start(equation: _Equation, groups: tuple[Group, ...]) -> Start:
    body, n_springs = equation.body, len(groups) + len(list(equation.searched()))
    value, _ = equation.solve(groups)
    springs, rest = value[: 2 * n_springs].reshape(-1, 2), value[2 * n_springs :]
    n_parts, n = len(body.parts), body.n_interfaces
    # The product of two factors is fitted as a further factor, whose value is not used.
    factors, rest = rest[:n_parts], rest[n_parts + (body.product is not None) :]
    mu, rest = (float(rest[0]), rest[1:]) if equation.mass_free else (None, rest)
    amplitudes = iter(rest.tolist())
    with_laws = tuple(
        replace(group, law=Law(tuple(Term(t.name, (next(amplitudes), *t.inner)) for t in group.law.terms)))
        if group.law.terms
        else replace(group, law=LINEAR)
        for group in groups
    )
    beside, std = equation.solve([replace(group, ground=True) for group in groups])
    return Start(
        groups=with_laws,
        stiffness=springs[:, 0],
        damping=springs[:, 1],
        factors=factors,
        inverse_mass=mu,
        motion_rms=equation.rms[:n],
        ground_stiffness=beside[-len(groups) :],
        ground_std=std[-len(groups) :],
        stiffness_beside_ground=beside[: 2 * len(groups) : 2],
    )


def look_for_start(model: Model, theta: FloatArray) -> FloatArray:
    """Return the vector with the initial travel and velocity that predict the first seconds of each run best.

    It is for one gear. All cells of a grid are predicted for a short time, then the best of them for a longer time.
    """
    known, found = model.settings.fit, theta.copy()
    grid = np.linspace(-known.start_reach_rms, known.start_reach_rms, known.n_start_grid)
    rms = model.motion_rms[0]
    std = (grid[1] - grid[0]) / 2 * rms
    for index in range(len(model.runs)):
        cells = [np.array([z, v]) * rms for z in grid for v in grid]
        for seconds, n_kept in known.start_rounds:
            misfits = _compute_misfits_of_cells(model, theta, index, cells, std, seconds)
            cells = [cells[k] for k in np.argsort(misfits, kind="stable")[:n_kept]]
        found[model.indices_of_run(index)[0]] = cells[0]
    return found


def _compute_misfits_of_cells(
    model: Model, theta: FloatArray, index: int, cells: Sequence[FloatArray], cell_std: FloatArray, seconds: float
) -> list[float]:
    """Return the misfit of the first seconds of a run for each initial state."""
    run, (below, above) = model.runs[index], model.correct(theta, index)
    try:
        (gear,) = model.resting_interfaces(theta, index)
    except UnboundedResponseError:
        return [np.inf] * len(cells)
    usual, covariance = state_at_start(model, theta, index)
    np.fill_diagonal(covariance[:2, :2], cell_std**2)
    starts = []
    for cell in cells:
        starts.append(usual.copy())
        starts[-1][:2, 0] = cell
    n = min(run.n_samples, round(seconds * run.fs))
    return misfits_of_starts(
        gear,
        model.mobility(theta, index).accelerance,
        below.value[: 2 * n - 1],
        above.value[:n],
        fs=run.fs,
        noise=model.noise_in(theta, run),
        starts=starts,
        start_covariance=covariance,
        ground=model.ground,
    )
