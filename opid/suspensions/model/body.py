"""A body on suspensions whose unsprung sides are measured, as a function of its unknown parameters.

Per unit of a reference mass the body obeys M q'' = - sum over attachments of j_s F_s, with

    M = unit + sum_k theta_k part_k + theta_1 theta_2 product + mu (known + loading),

mu one over the reference mass: masses known in kg fix the scale. An attachment is where a force acts on the body: an
interface, or a spring inside. A rigid airframe has heave, roll and pitch about the origin of coordinates as degrees of
freedom: there M is linear in mass, static moments and moments of inertia, and a point mass adds m j j^T,
j = (1, y, -x).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.mechanics.structure import Structure
from opid.signals.recording import FloatArray

RIGID = ("x_cg_m", "y_cg_m", "rxx_m2", "ryy_m2")
"""Free numbers of a rigid airframe per unit of mass: centre of gravity, and moments of inertia about the origin."""


class ImpossibleBodyError(NotDeterminedError):
    """Free factors give a mass matrix that is not positive definite."""


@dataclass(frozen=True)
class Coordinate:
    """A coordinate of an interface or a sensor with a known standard deviation.

    Args:
        name: "x_m[left]", "sensor_y_m[nose]", ...
        attachment: number of the attachment of the interface, or of the sensor.
        of_sensor: whether it is a coordinate of the sensor; otherwise of the suspension.
        derivative: (n_dof,) derivative of the row j by it.
        std: standard deviation of the coordinate, m.
    """

    name: str
    attachment: int
    of_sensor: bool
    derivative: tuple[float, ...]
    std: float


@dataclass(frozen=True)
class Inside:
    """A spring and damper inside of the body, or from the body to the ground.

    Args:
        name: name of the joint.
        stiffness_n_per_m: known stiffness; None if it is unknown.
        damping_n_s_per_m: known damping; None if it is unknown.
    """

    name: str
    stiffness_n_per_m: float | None
    damping_n_s_per_m: float | None


@dataclass(frozen=True)
class Scale:
    """A sensor of a force in N, with which the mass is known.

    Args:
        channel: number of its channel on the body.
        kg: reference mass if the gain of its scaled readings is 1, kg.
        tolerance: relative standard deviation of what it reads, over that of the acceleration.
    """

    channel: int
    kg: float
    tolerance: float


@dataclass(frozen=True, eq=False)
class Body:
    """The known and the unknown properties of a body.

    Args:
        dof: names of the degrees of freedom.
        unit: (n_dof, n_dof) part of the mass matrix that has no free factor, per unit of the reference mass.
        names: names of the free factors theta.
        parts: (n_parts, n_dof, n_dof) matrices that the factors multiply.
        known: (n_dof, n_dof) mass matrix of all masses known in kg.
        rows: (n_attachments, n_dof) j of each attachment, interfaces first.
        readings: (n_sensors, n_dof) readings of the sensors for unit q'', n_sensors at most n_attachments.
        inside: springs of the attachments that are no interfaces.
        coordinates: coordinates with a known standard deviation.
        absolute: whether `unit` is in kg already, so that mu is 1.
        product: (n_dof, n_dof) matrix that the product of the first two factors multiplies; None for none.
        fall: (n_dof,) acceleration of the body in free fall, m/s^2; None if no weight acts.
        piston_area_m2: piston area of the strut of a gear alone; 0 if it is not stated.
        of_travel: (n_sensors, n_attachments) reading of each sensor for a unit travel of each attachment, 1/s^2; None
            if no sensor reads travel.
        of_force: (n_sensors, n_attachments) R of sensors that read forces, per unit of force over the reference mass,
            whatever the mass of a run is; None if no sensor reads a force.
        scales: sensors of forces in N.
        prior_mass_kg: the reference mass as it is known beforehand; 0 if it is not.
        prior_tolerance_kg: its standard deviation.
    """

    dof: tuple[str, ...]
    unit: FloatArray
    names: tuple[str, ...]
    parts: FloatArray
    known: FloatArray
    rows: FloatArray
    readings: FloatArray
    inside: tuple[Inside, ...] = ()
    coordinates: tuple[Coordinate, ...] = ()
    absolute: bool = False
    product: FloatArray | None = None
    fall: FloatArray | None = None
    piston_area_m2: float = 0.0
    of_travel: FloatArray | None = None
    of_force: FloatArray | None = None
    scales: tuple[Scale, ...] = ()
    prior_mass_kg: float = 0.0
    prior_tolerance_kg: float = 0.0

    @property
    def n_attachments(self) -> int:
        """Number of attachments."""
        return self.rows.shape[0]

    @property
    def n_interfaces(self) -> int:
        """Number of attachments whose other side is measured."""
        return self.n_attachments - len(self.inside)

    @property
    def is_one_gear(self) -> bool:
        """Whether the body is one mass on one suspension; further attachments are those of sensors."""
        return self.n_attachments == 1 or (len(self.dof) == 1 and not self.rows[1:].any())

    def mass(self, theta: FloatArray, mu: float, loading: FloatArray) -> FloatArray:
        """Return M per unit of the reference mass, (n_dof, n_dof), under a loading in kg; mu in 1/kg."""
        mass = self.unit + np.tensordot(theta, self.parts, axes=1) + mu * (self.known + loading)
        return mass if self.product is None else mass + theta[0] * theta[1] * self.product

    def by_factors(self, theta: FloatArray) -> FloatArray:
        """Return the derivatives of M by its factors, (n_parts, n_dof, n_dof)."""
        if self.product is None:
            return self.parts
        changes = self.parts.copy()
        changes[:2] += theta[1::-1, np.newaxis, np.newaxis] * self.product
        return changes


@dataclass(frozen=True, eq=False)
class Mobility:
    """Accelerances of a body at its attachments, and their derivatives.

    Args:
        accelerance: (n_attachments, n_attachments) A, acceleration at the row for a unit force at the column.
        reading: (n_attachments, n_attachments) R, reading of the sensor at the row for a unit force at the column; 0
            without a sensor.
        by_accelerance: (n_directions, n_attachments, n_attachments) derivatives of A by the free factors, mu and the
            coordinates.
        by_reading: (n_directions, n_attachments, n_attachments) the same derivatives of R.
    """

    accelerance: FloatArray
    reading: FloatArray
    by_accelerance: FloatArray
    by_reading: FloatArray


def mobility(body: Body, theta: FloatArray, mu: float, shifts: FloatArray, loading: FloatArray) -> Mobility:
    """Return the accelerances of a body at its attachments under a loading.

    Args:
        body: the body.
        theta: (n_parts,) free factors of its mass.
        mu: one over the reference mass, 1/kg.
        shifts: (n_coordinates,) true coordinates minus the stated ones, m.
        loading: (n_dof, n_dof) mass matrix of the loading, kg.

    Raises:
        ImpossibleBodyError: a mass matrix that is not positive definite.
    """
    rows, seen = body.rows.copy(), np.zeros_like(body.rows)
    seen[: len(body.readings)] = body.readings
    for coordinate, shift in zip(body.coordinates, shifts, strict=True):
        (seen if coordinate.of_sensor else rows)[coordinate.attachment] += shift * np.array(coordinate.derivative)
    mass = body.mass(theta, mu, loading)
    if np.linalg.eigvalsh(mass)[0] <= 0.0:
        raise ImpossibleBodyError(
            "the mass matrix of the body is not positive definite: check channels (exchanged, upside down, in another "
            "unit), coordinates and loadings"
        )
    inverse = np.linalg.inv(mass)
    by_force, by_row = inverse @ rows.T, seen @ inverse
    parts = [*body.by_factors(theta), body.known + loading]
    by_accelerance = [-by_force.T @ part @ by_force for part in parts]
    by_reading = [-by_row @ part @ by_force for part in parts]
    for coordinate in body.coordinates:
        change = np.zeros_like(rows)
        change[coordinate.attachment] = coordinate.derivative
        half = change @ by_force
        by_accelerance.append(np.zeros_like(half) if coordinate.of_sensor else half + half.T)
        by_reading.append(half if coordinate.of_sensor else by_row @ change.T)
    reading = seen @ by_force
    if body.of_force is not None:
        reading[: len(body.of_force)] += body.of_force
    return Mobility(rows @ by_force, reading, np.array(by_accelerance), np.array(by_reading))


def with_strut_sensors(
    body: Body, n_sensors: int, travels: Mapping[int, int], forces: Mapping[int, int], *, travel_per_s2: float
) -> Body:
    """Return a body with sensors of struts behind those of the accelerations.

    Args:
        body: the body without them.
        n_sensors: number of all sensors on the body with them.
        travels: attachment of each sensor of a travel, by the number of its channel.
        forces: attachment of each sensor of a force, by the number of its channel.
        travel_per_s2: reading of a travel of 1 m, m/s^2.
    """
    # A further sensor is at an attachment without a spring.
    n_more = max(0, n_sensors - body.n_attachments)
    n, n_dof = body.n_attachments + n_more, len(body.dof)
    of_travel, of_force = np.zeros((n_sensors, n)), np.zeros((n_sensors, n))
    for channel, attachment in travels.items():
        of_travel[channel, attachment] = travel_per_s2
    for channel, attachment in forces.items():
        of_force[channel, attachment] = 1.0
    first = len(body.inside) + 1
    return replace(
        body,
        rows=np.vstack([body.rows, np.zeros((n_more, n_dof))]),
        readings=np.vstack([body.readings, np.zeros((n_sensors - len(body.readings), n_dof))]),
        inside=(*body.inside, *(Inside(f"sensor {first + k}", 0.0, 0.0) for k in range(n_more))),
        of_travel=of_travel if travels else None,
        of_force=of_force if forces else None,
    )


def rigid_body(
    positions: Sequence[tuple[float, float]],
    sensor_positions: Sequence[tuple[float, float]] | None = None,
    *,
    names: Sequence[str] = (),
    tolerance_m: float = 0.0,
) -> Body:
    """Return a rigid airframe in heave, roll and pitch with unknown mass, centre of gravity and inertias.

    Positions are (x, y) in m, x forward and y to the left: of each interface; of the sensor above each interface,
    then of further sensors. Their standard deviation is `tolerance_m`; 0 means that they are exact.

    >>> body = rigid_body([(3.0, 0.0), (-1.0, 1.5), (-1.0, -1.5)])
    >>> body.mass(np.array([0.0, 0.0, 1.0, 2.0]), 0.0, np.zeros((3, 3)))
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 2.]])
    """
    names = tuple(names) or tuple(str(k + 1) for k in range(len(positions)))
    sensors = tuple(positions) if sensor_positions is None else tuple(sensor_positions)
    rows, seen = (np.array([vertical(x, y) for x, y in where]) for where in (positions, sensors))
    parts = np.zeros((4, 3, 3))
    parts[0, 0, 2] = parts[0, 2, 0] = -1.0
    parts[1, 0, 1] = parts[1, 1, 0] = 1.0
    parts[2, 1, 1] = parts[3, 2, 2] = 1.0
    unit = np.zeros((3, 3))
    unit[0, 0] = 1.0
    # A symmetric airframe has no product of inertia about its own centre of gravity.
    product = np.zeros((3, 3))
    product[1, 2] = product[2, 1] = -1.0
    n_more = max(0, len(seen) - len(rows))
    # A further sensor is at an attachment without a spring.
    inside = tuple(Inside(f"sensor {k + 1}", 0.0, 0.0) for k in range(n_more))
    return Body(
        ("heave", "roll", "pitch"),
        unit,
        RIGID,
        parts,
        known=np.zeros((3, 3)),
        rows=np.vstack([rows, np.zeros((n_more, 3))]),
        readings=seen,
        inside=inside,
        coordinates=_list_coordinates(names, tolerance_m) if tolerance_m else (),
        product=product,
    )


def _list_coordinates(names: Sequence[str], tolerance_m: float) -> tuple[Coordinate, ...]:
    """Return the coordinates of the interfaces, then of their sensors."""
    return tuple(
        Coordinate(f"{'sensor_' if of_sensor else ''}{axis}_m[{name}]", attachment, of_sensor, derivative, tolerance_m)
        for of_sensor in (False, True)
        for attachment, name in enumerate(names)
        for axis, derivative in (("x", (0.0, 0.0, -1.0)), ("y", (0.0, 1.0, 0.0)))
    )


def vertical(x_m: float, y_m: float) -> FloatArray:
    """Return j, (3,): the vertical displacement at a point for a unit of heave, roll and pitch about the origin.

    Args:
        x_m: x of the point, forward.
        y_m: y of the point, to the left.
    """
    return np.array([1.0, y_m, -x_m])


def own_body(
    structure: Structure,
    interfaces: Sequence[str],
    sensors: Sequence[str],
    *,
    unknown: Sequence[str] = (),
    unknown_mass: Sequence[str] = (),
) -> Body:
    """Return a user's own structure on interfaces whose other side is measured.

    Its stiffness and damping matrices, and its joints, are springs inside of it or to the ground. An unknown mass has a
    start value in the mass matrix; if no mass or spring is known, ratios to the first unknown mass are found.

    Raises:
        InputError: an unknown degree of freedom or joint, one named twice, or a joint with a law.
    """
    eye = np.eye(structure.n_dof)
    for what, names in (("interfaces", interfaces), ("sensors", sensors), ("unknown_mass", unknown_mass)):
        for name in names:
            if list(names).count(name) > 1:
                raise InputError(f"{what} names {name!r} {list(names).count(name)} times: give it once")
    springs = [*_list_joints(structure, unknown), *_resolve_matrices(structure)]
    rows = [*(eye[structure.index(name)] for name in interfaces), *(row for _, row in springs)]
    inside = [spring for spring, _ in springs]
    seen = np.array([eye[structure.index(name)] for name in sensors])
    for k in range(len(seen) - len(rows)):
        inside.append(Inside(f"sensor {k + 1}", 0.0, 0.0))
        rows.append(np.zeros(structure.n_dof))
    rows_of_unknown = [structure.index(name) for name in unknown_mass]
    parts = np.array([np.outer(eye[k], eye[k]) for k in rows_of_unknown]).reshape(-1, *structure.mass.shape)
    known = np.array(structure.mass)
    first, others = (parts[0], parts[1:]) if rows_of_unknown else (known.copy(), parts)
    known[rows_of_unknown, rows_of_unknown] = 0.0
    return Body(
        structure.names,
        unit=first,
        names=tuple(f"mass[{name}] / mass[{unknown_mass[0]}]" for name in unknown_mass[1:]),
        parts=others,
        known=known if rows_of_unknown else np.zeros_like(known),
        rows=np.array(rows),
        readings=seen,
        inside=tuple(inside),
        absolute=not rows_of_unknown,
    )


def _list_joints(structure: Structure, unknown: Sequence[str]) -> Iterator[tuple[Inside, FloatArray]]:
    """Yield the joints, each with its row."""
    names = [joint.name for joint in structure.joints]
    for name in unknown:
        if name not in names:
            known_joints = nearest(name, names) if names else "it has none"
            raise InputError(f"there is no joint {name!r} in the structure: {known_joints}")
    for joint in structure.joints:
        if joint.law.terms or joint.sliders is not None:
            raise InputError(f"the joint {joint.name!r} inside of the structure has a law: make an interface of it")
        known = (None, None) if joint.name in unknown else (joint.stiffness_n_per_m, joint.damping_n_s_per_m)
        yield Inside(joint.name, *known), np.asarray(joint.direction)


def _resolve_matrices(structure: Structure) -> Iterator[tuple[Inside, FloatArray]]:
    """Yield the stiffness and damping matrices as springs and dampers along their eigenvectors."""
    for what, matrix in (("stiffness", structure.stiffness), ("damping", structure.damping)):
        values, vectors = np.linalg.eigh(matrix)
        spring, least = what == "stiffness", 1e-12 * np.abs(values).max(initial=0.0)
        for number, (value, row) in enumerate(zip(values.tolist(), vectors.T, strict=True), start=1):
            if abs(value) > least:
                yield Inside(f"{what} {number}", value if spring else 0.0, 0.0 if spring else value), row
