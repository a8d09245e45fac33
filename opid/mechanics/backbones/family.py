"""Backbones: frequency and shape of a nonlinear normal mode over its amplitude, by harmonic balance on the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, list_names, nearest
from opid.mechanics.backbones.harmonic_balance import (
    POWERS,
    Transform,
    first_harmonic_factor,
    harmonics_of,
    period_transform,
    refuse_held_free_modes,
    refuse_velocity,
)
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.kernels import CYCLIC, backbone_slopes, backbones, code_of
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import FloatArray, Term, TermSet

# fraction of the largest value below which a shape counts as zero
NOTHING = 1e-9
N_VALUES = 4  # largest number of parameters of a kind that acts on a backbone, with its amplitude


@dataclass(frozen=True, eq=False)
class Backbone:
    """The backbone of one mode at prescribed first-harmonic amplitudes of one sensor.

    Attributes:
        mode: number of the mode, from 1.
        sensor: the sensor whose amplitude is prescribed.
        amplitude: (n,) first-harmonic amplitude of that sensor, m.
        frequency_hz: (n,) frequency, Hz; nan where Newton's method failed.
        shapes: (n, n_sensors) first-harmonic displacement of all sensors, m, `amplitude` at the prescribed one.
        harmonics: harmonics of the motion.
        converged: (n,) whether there is a solution.
        reason: the points that failed and what to try; empty where all converged.
        extension: (n, n_harmonics, n_joints) cosine coefficients of the joints' extensions, m.
    """

    mode: int
    sensor: str
    amplitude: FloatArray
    frequency_hz: FloatArray
    shapes: FloatArray
    harmonics: tuple[int, ...]
    converged: NDArray[np.bool_]
    reason: str
    extension: FloatArray


@dataclass(frozen=True, eq=False)
class BackboneFamily:
    """The backbones of one mode for many coefficients of one law.

    Attributes:
        mode: number of the mode, from 1.
        sensor: the sensor whose amplitude is prescribed.
        amplitude: (n_points,) first-harmonic amplitude of that sensor, m.
        harmonics: harmonics of the motion.
        eigenvalue: (n_samples, n_points) square of the angular frequency, 1/s^2; nan where Newton's method failed.
        shapes: (n_samples, n_points, n_sensors) first-harmonic displacement of all sensors, m.
        converged: (n_samples, n_points) whether there is a solution.
        extension: (n_samples, n_points, n_harmonics n_joints) cosine coefficients of the joints' extensions, m,
            harmonic by harmonic.
    """

    mode: int
    sensor: str
    amplitude: FloatArray
    harmonics: tuple[int, ...]
    eigenvalue: FloatArray
    shapes: FloatArray
    converged: NDArray[np.bool_]
    extension: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """(n_samples, n_points) frequencies, Hz."""
        return np.sqrt(self.eigenvalue) / (2 * np.pi)


def join_families(families: Sequence[BackboneFamily]) -> BackboneFamily:
    """Return the samples of several families of one mode at the same amplitudes as one family."""
    return replace(
        families[0],
        eigenvalue=np.concatenate([each.eigenvalue for each in families]),
        shapes=np.concatenate([each.shapes for each in families]),
        converged=np.concatenate([each.converged for each in families]),
        extension=np.concatenate([each.extension for each in families]),
    )


def take_samples(family: BackboneFamily, samples: ArrayLike) -> BackboneFamily:
    """Return some samples of a family, by their indices, as a family."""
    taken = np.asarray(samples)
    names = ("eigenvalue", "shapes", "converged", "extension")
    return replace(family, **{name: getattr(family, name)[taken] for name in names})


def backbone(
    system: JointedModes,
    law: TermSet | Sequence[TermSet],
    *,
    mode: int,
    sensor: str,
    amplitude: ArrayLike,
    harmonics: Sequence[int] = (1,),
) -> Backbone:
    """Return the backbone of one mode by harmonic balance, condensed on the joints (Song et al. 2021, section 3.2).

    With z_h the harmonics of the extensions and F_h those of the forces, l the square of the angular frequency, m the
    mode and a the sensor,

        z_1 - psi_m q + sum_{i != m} psi_i psi_i^T F_1 / (l_i - l) = 0,    (l_m - l) q + psi_m^T F_1 = 0,
        phi_m(a) q - sum_{i != m} phi_i(a) psi_i^T F_1 / (l_i - l) = A,
        z_h + sum_i psi_i psi_i^T F_h / (l_i - h^2 l) = 0 for the other harmonics.

    Newton's method starts from the linear mode and goes from amplitude to amplitude. A joint with memory has the mean
    force of both directions of its steady cycle (`Kind.cycle`), and its stiffness while nothing slides is that of the
    linear structure.

    Args:
        system: the linear structure by its modes.
        law: law of all joints, or one for each of them; springs and kinds with memory that have a cycle.
        mode: number of the mode, from 1.
        sensor: name of the sensor whose amplitude is prescribed.
        amplitude: (n,) first-harmonic amplitudes of that sensor, m, positive, in any order.
        harmonics: harmonics of the motion, 1 among them. Odd laws leave out the even ones; others need 0.

    Raises:
        InputError: an unknown mode or sensor, one that the mode does not move, impossible amplitudes or harmonics, a
            law of the rate, or another number of laws than of joints.

    >>> from opid.mechanics.laws.law import law
    >>> one = JointedModes([100.0], [[1.0]], [[1.0]], ("mass",), ("spring",))
    >>> cubic = law("cubic_stiffness", stiffness_n_per_m3=4e6)
    >>> curve = backbone(one, cubic, mode=1, sensor="mass", amplitude=[1e-3, 2e-3])
    >>> ((2 * np.pi * curve.frequency_hz) ** 2).round(9).tolist()
    [103.0, 112.0]
    """
    laws = laws_of_joints(law, system)
    terms = tuple(term for each in laws for term in each.terms)
    firsts, codes = np.cumsum([0, *(len(each.terms) for each in laws)]), [code_of(term.name) for term in terms]
    spans = firsts[:-1], firsts[1:], np.array(codes, dtype=np.int64)
    values = np.array([(*term.values, 1.0, 1.0, 1.0)[:N_VALUES] for term in terms]).reshape(1, -1, N_VALUES)
    curves = _prepare_curves(system, terms, spans, mode, sensor, amplitude, harmonics)
    eigenvalue, shapes, extension = (found[0] for found in curves.solve(values))
    converged = np.isfinite(eigenvalue)
    frequency_hz = np.sqrt(eigenvalue) / (2 * np.pi)
    extension = extension.reshape(converged.size, len(curves.harmonics), len(system.joints))
    reason = _describe_failures(curves.amplitude, frequency_hz, sensor)
    return Backbone(
        mode, sensor, curves.amplitude, frequency_hz, shapes, curves.harmonics, converged, reason, extension
    )


def family_evaluator(
    system: JointedModes,
    kinds: tuple[str, ...],
    *,
    mode: int,
    sensor: str,
    amplitude: ArrayLike,
    harmonics: Sequence[int] = (1,),
    joints: Sequence[Sequence[str]] = (),
) -> FamilyEvaluator:
    """Return a function from coefficients of laws to the backbones of one mode, which prepares everything else once.

    The function takes (n_samples, n_coefficients) values of all parameters of all kinds, in their order and SI units,
    and returns a `BackboneFamily`; with kinds of one coefficient there is one column for each kind.

    Args:
        system: the linear structure by its modes.
        kinds: names of the kinds of law that are added up; see `backbone`.
        mode: number of the mode, from 1.
        sensor: name of the sensor whose amplitude is prescribed.
        amplitude: (n_points,) first-harmonic amplitudes of that sensor, m, positive, in any order.
        harmonics: harmonics of the motion, see `backbone`.
        joints: for each kind, the names of the joints that have it, all where empty; all joints have all kinds where
            left out. The joints of one kind share its coefficients; a kind may be given once for each group of them.

    Raises:
        InputError: what `backbone` refuses, an unknown kind, or an unknown joint; the returned function refuses
            coefficients of the wrong shape.

    >>> one = JointedModes([100.0], [[1.0]], [[1.0]], ("mass",), ("spring",))
    >>> solve = family_evaluator(one, ("cubic_stiffness",), mode=1, sensor="mass", amplitude=[1e-3])
    >>> solve([[0.0], [4e6]]).eigenvalue.round(9).tolist()
    [[100.0], [103.0]]
    """
    for kind in kinds:
        if kind not in LAWS:
            raise InputError(f"there is no law {kind!r}: {nearest(kind, LAWS)}")
    positions = [(row, column) for row, kind in enumerate(kinds) for column in range(len(LAWS[kind].parameters))]
    rows, columns = np.array(positions, dtype=np.int64).reshape(-1, 2).T
    placed, spans = _place_terms(system, kinds, joints or ((),) * len(kinds))
    every = [Term(kind, tuple(each.default for each in LAWS[kind].parameters)) for kind in kinds]
    terms = tuple(every[row] for row in placed)
    curves = _prepare_curves(system, terms, spans, mode, sensor, amplitude, harmonics)
    place = np.full((len(kinds), N_VALUES), -1)
    place[rows, columns] = np.arange(rows.size)
    return FamilyEvaluator(system, mode, sensor, tuple(kinds), place, tuple(placed), curves)


@dataclass(frozen=True, eq=False)
class FamilyEvaluator:
    """A function from coefficients of laws to the backbones of one mode, see `family_evaluator`.

    Attributes:
        system: the linear structure by its modes.
        mode: number of the mode, from 1.
        sensor: the sensor whose amplitude is prescribed.
        kinds: names of the kinds of law.
        place: (n_kinds, 4) column of each parameter of each kind among the coefficients, -1 where there is none.
        placed: for each term of each joint, the number of its kind.
        curves: arguments of the compiled functions.
    """

    system: JointedModes
    mode: int
    sensor: str
    kinds: tuple[str, ...]
    place: NDArray[np.int64]
    placed: tuple[int, ...]
    curves: _Curves

    def __call__(self, coefficients: ArrayLike) -> BackboneFamily:
        """Return the backbones for coefficients, (n_samples, n_coefficients)."""
        curves = self.curves
        eigenvalue, shapes, extension = curves.solve(self._place_values(coefficients))
        return BackboneFamily(
            self.mode, self.sensor, curves.amplitude, curves.harmonics, eigenvalue, shapes, np.isfinite(eigenvalue),
            extension,
        )  # fmt: skip

    def with_system(self, system: JointedModes) -> FamilyEvaluator:
        """Return the function for another linear structure with the same modes, sensors and joints."""
        seen = _condense(system, system.index(self.mode), system.sensor(self.sensor))
        curves = replace(self.curves, arguments=(*seen, *self.curves.arguments[2:]))
        return replace(self, system=system, curves=curves)

    def without_solution(self) -> BackboneFamily:
        """Return a family of one sample that has a solution at no amplitude."""
        n_points, n_joints = self.curves.amplitude.size, len(self.system.joints)
        nothing = np.full((1, n_points), np.nan)
        return BackboneFamily(
            self.mode, self.sensor, self.curves.amplitude, self.curves.harmonics, nothing,
            np.full((1, n_points, len(self.system.sensors)), np.nan), np.isfinite(nothing),
            np.full((1, n_points, len(self.curves.harmonics) * n_joints), np.nan),
        )  # fmt: skip

    def find_slopes(
        self, coefficients: ArrayLike, found: BackboneFamily, couplings: ArrayLike = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of eigenvalue and shapes of backbones that were found, by implicit differentiation.

        Args:
            coefficients: (n_samples, n_coefficients) coefficients of the laws.
            found: the backbones for them.
            couplings: (n_linear, n_modes, n_modes) change of the stiffness between the modal coordinates for a unit of
                each linear parameter, Phi^T dK Phi, 1/s^2.

        Returns:
            (n_samples, n_points, n) and (n_samples, n_points, n_sensors, n), by each coefficient, then by each linear
            parameter; nan where there is no solution.
        """
        system, curves = self.system, self.curves
        n = system.n_modes
        modes = (
            system.eigenvalue, np.ascontiguousarray(system.at_joints.T), np.ascontiguousarray(system.at_sensors.T),
            system.index(self.mode), system.sensor(self.sensor),
        )  # fmt: skip
        values = self._place_values(coefficients)
        law = (*curves.spans, curves.powers, values, values[:, :, 0])
        slopes = backbone_slopes(
            curves.arguments[0], modes, np.asarray(couplings, dtype=np.float64).reshape(-1, n, n), curves.arguments[2],
            law, curves.over_period, self.place[list(self.placed)], found.amplitude, found.eigenvalue, found.extension,
        )  # fmt: skip
        return slopes[0], slopes[1]

    def _place_values(self, coefficients: ArrayLike) -> FloatArray:
        """Return the values of the terms of all joints, (n_samples, n_terms, 4)."""
        given, n_columns = np.asarray(coefficients, dtype=np.float64), self.place.max() + 1
        if given.ndim != 2 or given.shape[1] != n_columns:
            raise InputError(
                f"the coefficients have shape {given.shape}: give (n_samples, {n_columns}), "
                f"one column for each parameter of {', '.join(self.kinds)}"
            )
        values = np.ones((len(given), len(self.kinds), N_VALUES))
        values[:, self.place >= 0] = given
        return values[:, list(self.placed)]


def _place_terms(
    system: JointedModes, kinds: Sequence[str], joints: Sequence[Sequence[str]]
) -> tuple[list[int], tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]]:
    """Return the terms of all joints, one joint after the other, and for each joint its first and last one, and codes.

    Terms that all joints have are there once, and all joints share them.
    """
    for name in (name for at in joints for name in at):
        if name not in system.joints:
            raise InputError(f"there is no joint {name!r}: {nearest(name, system.joints)}")
    own = [[row for row, at in enumerate(joints) if not at or joint in at] for joint in system.joints]
    if all(len(each) == len(kinds) for each in own):
        rows, first = [*range(len(kinds))], np.zeros(len(own), dtype=np.int64)
        last = np.full(len(own), len(kinds), dtype=np.int64)
    else:
        rows = [row for each in own for row in each]
        ends = np.cumsum([0, *map(len, own)])
        first, last = ends[:-1], ends[1:]
    return rows, (first, last, np.array([code_of(kinds[row]) for row in rows], dtype=np.int64))


def laws_of_joints(law: TermSet | Sequence[TermSet], system: JointedModes) -> tuple[TermSet, ...]:
    """Return one law for each joint.

    Raises:
        InputError: another number of laws than of joints, or a law that does not rest at its origin.
    """
    laws = (law,) * len(system.joints) if isinstance(law, TermSet) else tuple(law)
    if len(laws) != len(system.joints):
        raise InputError(
            f"there are {len(laws)} laws for the {len(system.joints)} joints: give one law, or one for each joint"
        )
    for each in laws:
        if each.rest_m and each.terms:
            raise InputError(
                f"{each.name} rests {each.rest_m:g} m from its origin: give a law about its position at rest"
            )
    return laws


@dataclass(frozen=True, eq=False)
class _Curves:
    """The arguments of the compiled Newton's method, except for the values of the laws."""

    amplitude: FloatArray
    harmonics: tuple[int, ...]
    order: NDArray[np.int64]
    powers: NDArray[np.int64]
    arguments: tuple[Any, ...]
    spans: tuple[Any, ...]
    over_period: tuple[FloatArray, FloatArray, FloatArray]

    def solve(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return eigenvalue, shapes and extensions at all amplitudes, as given, for values (n_samples, n_terms, 4)."""
        system, sensors, harmonics, transform = self.arguments
        factors = values[:, :, 0].copy()
        if transform[0].shape[1] == 0:
            factors *= first_harmonic_factor(np.where(self.powers > 0, self.powers, values[:, :, 1]))
        law = (*self.spans, self.powers, values, factors)
        found = backbones(system, sensors, harmonics, law, transform, self.amplitude[self.order])
        back = np.argsort(self.order)
        eigenvalue, shapes, extension = (each[:, back] for each in found)
        return eigenvalue, shapes, extension


def _prepare_curves(
    system: JointedModes,
    terms: tuple[Term, ...],
    spans: tuple[Any, ...],
    mode: int,
    sensor: str,
    amplitude: ArrayLike,
    harmonics: Sequence[int],
) -> _Curves:
    prescribed = require_amplitudes(amplitude)
    refuse_velocity(terms, cycles=True)
    used = harmonics_of(terms, harmonics)
    if 0 in used:
        refuse_held_free_modes(system)
    powers = np.array([CYCLIC if term.kind.cycle else POWERS.get(term.name, 0) for term in terms], dtype=np.int64)
    closed = used == (1,) and bool(((powers > 0) | (powers == POWERS["signed_power_stiffness"])).all())
    nothing = np.empty((1, 0))
    over_period = _multiply_out(period_transform(terms, used))
    transform = _multiply_out(Transform(nothing, nothing, nothing[0])) if closed else over_period
    condensed, seen = _condense(system, system.index(mode), system.sensor(sensor))
    return _Curves(
        amplitude=prescribed,
        harmonics=used,
        order=np.argsort(prescribed, kind="stable"),
        powers=powers,
        arguments=(
            condensed,
            seen,
            np.array(used, dtype=np.int64),
            transform,
        ),
        spans=spans,
        over_period=over_period,
    )


def _multiply_out(transform: Transform) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cosines and weights of a transform, and their products for all pairs of harmonics."""
    products = transform.weights[:, np.newaxis] * transform.cosines[np.newaxis]
    n = len(transform.cosines)
    return transform.cosines, transform.weights, products.reshape(n**2, -1 if products.size else 0)


def _condense(system: JointedModes, m: int, a: int) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return the modes in the form that the kernel takes, without those that no joint moves."""
    refuse_unseen(system, m, a)
    psi, phi = system.at_joints.T, system.at_sensors.T
    size = np.linalg.norm(psi, axis=1)
    moved = size > NOTHING * size.max(initial=0.0)
    others = moved.copy()
    others[m] = False
    # The equation of the sensor replaces the coordinate q of the mode.
    relative = psi[others] - np.outer(phi[others, a] / phi[m, a], psi[m])
    by_pairs = np.einsum("ij,ik->ijk", relative, psi[others]).reshape(int(others.sum()), psi.shape[1] ** 2)
    at_sensor = phi[others, a]
    own = np.array([system.eigenvalue[m], phi[m, a]])
    every = np.einsum("ij,ik->ijk", psi[moved], psi[moved]).reshape(int(moved.sum()), psi.shape[1] ** 2)
    condensed = (
        own,
        psi[m].copy(),
        system.eigenvalue[others],
        np.hstack([by_pairs, at_sensor[:, np.newaxis] * psi[others]]),
        system.eigenvalue[moved],
        every,
    )
    return condensed, (phi[m].copy(), phi[others], psi[others], at_sensor)


def require_amplitudes(amplitude: ArrayLike) -> FloatArray:
    """Return amplitudes as an array of their own.

    Raises:
        InputError: none, or values that are not positive or not finite.
    """
    prescribed = np.array(amplitude, dtype=np.float64)
    if prescribed.ndim != 1 or prescribed.size == 0 or not (np.isfinite(prescribed) & (prescribed > 0)).all():
        raise InputError(f"the amplitudes are {amplitude!r}: give a list of positive numbers, m")
    return prescribed


def refuse_unseen(system: JointedModes, m: int, a: int) -> None:
    """Refuse a mode, column `m` of `system`, that is a rigid-body motion, or that the sensor of row `a` does not see.

    Raises:
        InputError: either of the two.
    """
    if system.eigenvalue[m] <= NOTHING * np.abs(system.eigenvalue).max():
        raise InputError(
            f"mode {m + 1} is a rigid-body motion at {system.frequency_hz[m]:.3g} Hz: name one with springs"
        )
    shape = np.abs(system.at_sensors[:, m])
    if shape[a] <= NOTHING * shape.max():
        raise InputError(
            f"mode {m + 1} does not move the sensor {system.sensors[a]!r}: prescribe the amplitude of "
            f"{system.sensors[int(np.argmax(shape))]!r}, where it is largest"
        )


def _describe_failures(amplitude: FloatArray, frequency_hz: FloatArray, sensor: str) -> str:
    failed = np.flatnonzero(np.isnan(frequency_hz))
    if failed.size == 0:
        return ""
    points = list_names((f"{point + 1} ({amplitude[point]:.4g} m at {sensor!r})" for point in failed), 5)
    return (
        f"there is no solution near the curve at point {points}: take smaller steps of the amplitude or fewer "
        "harmonics, or follow the curve with continued_backbone, which passes interactions with other modes"
    )
