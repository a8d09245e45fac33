"""Two bolted structures with known truth, a case with components and a plate on a fixture (Pacini, section 4), on rigs.

Their joints slip (Iwan), a kind of law that no polynomial in displacement and velocity represents.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from opid.errors import InputError
from opid.mechanics.laws.law import FloatArray, law
from opid.mechanics.rig import Rig, Shaker
from opid.mechanics.structure import Joint, Structure, force_of, iwan, natural_frequencies
from opid.modal.linear.modes import LinearModes, modes_of_structure

_AXES = ("x", "y", "z")

# the case and its components: masses, positions about the centre of the case, and the mounts along x, y, z
_CASE_KG, _CASE_M = 40.0, (0.6, 0.4, 0.3)
_COMPONENT_KG = (6.0, 4.5, 3.2, 2.2)
_COMPONENT_POSITION_M = ((0.17, 0.07, 0.06), (-0.18, 0.09, -0.05), (-0.10, -0.11, 0.07), (0.14, -0.10, -0.07))
_MOUNT_N_PER_M = (
    (6.94e6, 17.0e6, 1.376e6),
    (7.66e6, 34.85e6, 2.02e6),
    (7.51e6, 35.1e6, 2.34e6),
    (13.53e6, 37.6e6, 9.69e6),
)
# loss of each mount, 2 zeta of the mode that it carries
_MOUNT_LOSS = ((0.008, 0.007, 0.006), (0.006, 0.008, 0.010), (0.005, 0.011, 0.007), (0.006, 0.014, 0.009))
# mounts that slip, by component and axis: fraction of their stiffness in sliders, and the slip force
_SLIPPING_MOUNTS = {
    (0, 2): (0.12, 150.0),
    (1, 0): (0.11, 130.0),
    (2, 0): (0.10, 80.0),
    (0, 1): (0.09, 130.0),
    (3, 0): (0.12, 60.0),
}
_CORNERS = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
# At this corner the drive-point FRF passes through phase resonance in all five modes, even with twice their damping.
_DRIVE_CORNER, _DRIVE_DIRECTION = (1, 1, 1), (3.0, 3.0, 2.0)

# the plate on its fixture; mode 10 shears the joint, mode 18 opens it
_PLATE_M, _PLATE_KG, _FIXTURE_M, _FIXTURE_KG, _FIXTURE_DEPTH_M, _COVER_KG = (0.5, 0.4), 1.5, (0.3, 0.2), 9.0, 0.06, 0.15
_SHEAR_HZ = 400.0
_OTHER_HZ = (118, 209, 303, 466, 522, 588, 641, 688, 731, 766, 934, 992, 1062, 1088, 1235, 1302, 1379, 1455)
_SHEAR_MODE, _OPENING_MODE, _N_RIGID = 10, 18, 6
_RATIO_RANGE = (1.93, 2.3)
_SHEAR_ZETA, _OPENING_ZETA = 0.003, 0.006
_SHEAR_SLIDERS_FRACTION, _SHEAR_SLIP_N, _SHEAR_CUBIC_FRACTION = 0.14, 900.0, 0.004
NOMINAL_COUPLING = 7e8


CASE_SHAKER = Shaker(second_harmonic=0.01)
PLATE_SHAKER = Shaker(armature_kg=0.15, back_emf_n_s_per_m=100.0, second_harmonic=0.02, full_voltage_v=70.0)
"""A shaker with a light armature: at 300 g an armature of 0.45 kg would need 1300 N to move itself."""


@dataclass(frozen=True, eq=False)
class CaseStudy:
    """A rig with its modes.

    Args:
        rig: the structure with its sensors and its shaker.
        modes: linear modes at the sensors, without the shaker.
        drive_point: the sensor at the drive point.
        nonlinear_modes: modes that shift with the level, counted from 1.
        text: description in one sentence.
    """

    rig: Rig
    modes: LinearModes
    drive_point: str
    nonlinear_modes: tuple[int, ...]
    text: str


@dataclass(frozen=True, eq=False)
class LevelDependence:
    """One mode at several amplitudes, with all others at rest.

    Args:
        amplitude: (n,) amplitudes of the modal displacement, m kg^1/2.
        frequency_hz: (n,) natural frequency, Hz.
        zeta: (n,) damping ratio.
    """

    amplitude: FloatArray
    frequency_hz: FloatArray
    zeta: FloatArray


def component_assembly(*, shaker: Shaker | None = None) -> CaseStudy:
    """Return a rigid case that carries four components on bolted mounts, free in space (Pacini, case study 1).

    18 modes: six rigid-body modes and twelve elastic ones from 86 to 690 Hz, each the motion of one component along one
    axis of its mount. The mounts that carry modes 7, 11, 12, 13 and 15 slip; with 10 g at their component these modes
    lose about 1 % of their frequency and are damped 1.5 to 1.9 times as much. There are eight triaxial sensors, and one
    at the drive point, a corner of the case.

    Args:
        shaker: the shaker at the drive point; None if the force is prescribed.

    >>> component_assembly().modes.frequency_hz[6:9].round()
    array([ 86., 118., 146.])
    """
    positions = np.array(_COMPONENT_POSITION_M)
    n_dof = 6 + 3 * len(positions)
    half = np.array(_CASE_M) / 2
    squares = (2 * half) ** 2
    inertia = _CASE_KG / 12.0 * (squares.sum() - squares)
    mass = np.diag(np.concatenate([np.full(3, _CASE_KG), inertia, np.repeat(_COMPONENT_KG, 3)]))

    def find_case_motion(position: FloatArray) -> FloatArray:
        return np.hstack([_find_rigid_motion(position), np.zeros((3, n_dof - 6))])

    components = np.eye(n_dof)[6:].reshape(len(positions), 3, n_dof)
    joints = tuple(
        _make_mount(component, axis, components[component, axis] - find_case_motion(position)[axis])
        for component, position in enumerate(positions)
        for axis in range(3)
    )
    corners = [find_case_motion(half * corner) for corner in _CORNERS]
    drive = np.array(_DRIVE_DIRECTION) / np.linalg.norm(_DRIVE_DIRECTION) @ find_case_motion(half * _DRIVE_CORNER)
    bodies = [f"component{k + 1}" for k in range(len(positions))] + [f"case{k + 1}" for k in range(len(corners))]
    zero = np.zeros((n_dof, n_dof))
    names = [*(f"case_{axis}" for axis in (*_AXES, "rx", "ry", "rz")), *_name_axes(bodies[: len(positions)])]
    return _put_on_rig(
        Structure(mass, zero, zero, joints, tuple(names)),
        np.vstack([*components, *corners, drive]),
        (*_name_axes(bodies), "drive"),
        shaker,
        nonlinear_modes=(7, 11, 12, 13, 15),
        text="a free case of 40 kg that carries four components on bolted mounts, five of which slip",
    )


def fixture_and_plate(
    *,
    ratio: float = 2.02,
    coupling_n_per_m2: float = NOMINAL_COUPLING,
    shaker: Shaker | None = None,
) -> CaseStudy:
    """Return a plate bolted to a fixture, free in space, in modal coordinates (Pacini, case study 2).

    26 modes: six rigid-body modes and twenty elastic ones. Mode 10, 400 Hz, shears the joint, which slips and is held
    by a weak cubic spring; mode 18 opens it and hardly moves the drive point. The force of the joint also grows with
    the square of the slip, coupling (d10 q10 + d18 q18)^2, which drives mode 18 at twice the frequency of mode 10. With
    300 g at the drive point slip alone takes 1.6 % of the frequency of mode 10 and damps it 2.4 times as much. The
    other modes are linear. Modes 21 and 22 look alike (MAC 0.6): they differ by a cover without a sensor.

    Args:
        ratio: natural frequency of mode 18 over that of mode 10, from 1.93 to 2.3.
        coupling_n_per_m2: asymmetry of the joint, N/m^2; 0 for modes that do not interact.
        shaker: the shaker at the drive point; None if the force is prescribed.

    Raises:
        InputError: a ratio at which mode 18 would have another number, or a coupling that is not finite.

    >>> fixture_and_plate(ratio=2.0).modes.frequency_hz[[9, 17]].round(6)
    array([400., 800.])
    """
    if not _RATIO_RANGE[0] <= ratio <= _RATIO_RANGE[1] or not np.isfinite(coupling_n_per_m2):
        raise InputError(
            f"the ratio is {ratio}, the coupling {coupling_n_per_m2} N/m^2: give a ratio from {_RATIO_RANGE[0]} to "
            f"{_RATIO_RANGE[1]}, between the neighbours of mode {_OPENING_MODE}, and a finite coupling"
        )
    shapes, rows = _make_plate_shapes()
    shear, opening = _SHEAR_MODE - 1, _OPENING_MODE - 1
    elastic = np.insert(np.array(_OTHER_HZ, dtype=np.float64), shear - _N_RIGID, _SHEAR_HZ)
    elastic = np.insert(elastic, opening - _N_RIGID, ratio * _SHEAR_HZ)
    zeta = 0.004 + 0.0015 * np.sin(2.0 * np.arange(elastic.size))
    zeta[[shear - _N_RIGID, opening - _N_RIGID]] = _SHEAR_ZETA, _OPENING_ZETA
    omega = np.concatenate([np.zeros(_N_RIGID), 2.0 * np.pi * elastic])
    zeta = np.concatenate([np.zeros(_N_RIGID), zeta])

    # Only modes 10 and 18 move the joint.
    extension = np.zeros(omega.size)
    extension[shear], extension[opening] = rows["slip"][shear], rows["gap"][opening]
    slip = np.where(np.arange(omega.size) == shear, extension, 0.0)
    tangent = _SHEAR_SLIDERS_FRACTION * (omega[shear] / slip[shear]) ** 2
    sliders = iwan(stiffness_n_per_m=tangent, slip_force_n=_SHEAR_SLIP_N)
    hardening = law("cubic_stiffness", stiffness_n_per_m3=_SHEAR_CUBIC_FRACTION * tangent / 1e-3**2)
    joints = [Joint("joint in shear", slip, law=hardening, sliders=sliders)]
    if coupling_n_per_m2:
        square = law("even_quadratic_stiffness", stiffness_n_per_m2=coupling_n_per_m2)
        joints.append(Joint("asymmetry of the joint", extension, law=square))
    stiffness = np.diag(omega**2) - tangent * np.outer(slip, slip)
    names = tuple(f"mode {k + 1}" for k in range(omega.size))
    return _put_on_rig(
        Structure(np.eye(omega.size), np.diag(2.0 * zeta * omega), stiffness, tuple(joints), names),
        shapes,
        tuple(name for name in rows if name not in ("slip", "gap")),
        shaker,
        nonlinear_modes=(_SHEAR_MODE,),
        text=f"a plate on a fixture whose joint slips in mode 10 at 400 Hz; mode 18 at {ratio:g} times that "
        + ("is driven by the joint" if coupling_n_per_m2 else "is not coupled"),
    )


def case_study_1(*, shaker: Shaker | None = CASE_SHAKER) -> CaseStudy:
    """Return the case with four components: 18 modes, of which 7, 11, 12, 13 and 15 are nonlinear.

    Args:
        shaker: the shaker at the drive point; None if the force is prescribed.

    >>> study = case_study_1()
    >>> study.modes.n_modes, study.nonlinear_modes
    (18, (7, 11, 12, 13, 15))
    """
    return component_assembly(shaker=shaker)


def case_study_2(
    *, ratio: float = 2.02, coupling_n_per_m2: float | None = None, shaker: Shaker | None = PLATE_SHAKER
) -> CaseStudy:
    """Return the plate on its fixture: 26 modes, of which mode 10 is nonlinear and drives mode 18.

    Args:
        ratio: natural frequency of mode 18 over that of mode 10, see `fixture_and_plate`.
        coupling_n_per_m2: asymmetry of the joint, N/m^2, see `fixture_and_plate`; the nominal one where left out.
        shaker: the shaker at the drive point; None if the force is prescribed.

    Raises:
        InputError: what `fixture_and_plate` refuses.

    >>> study = case_study_2(ratio=2.2)
    >>> study.modes.frequency_hz[[9, 17]].round(1).tolist()
    [400.0, 880.0]
    """
    coupling = NOMINAL_COUPLING if coupling_n_per_m2 is None else coupling_n_per_m2
    return fixture_and_plate(ratio=ratio, coupling_n_per_m2=coupling, shaker=shaker)


def level_dependence(structure: Structure, *, mode: int, amplitude: ArrayLike, n_phases: int = 256) -> LevelDependence:
    """Return how one mode softens or stiffens with its level, by harmonic linearisation of the joints.

    With q = a cos(omega_0 t) in this mode alone, the first harmonic of the joints' forces, in phase with q and ahead of
    it by 90 degrees, is a stiffness and a damping; means and higher harmonics are left out, and so is the coupling of
    the modes.

    Args:
        structure: the structure.
        mode: number of an elastic mode, from 1.
        amplitude: (n,) amplitudes of the modal displacement, m kg^1/2, positive.
        n_phases: number of phases of a cycle.

    Raises:
        InputError: no such mode, a rigid-body mode, or an amplitude that is not positive or leaves no stiffness.

    >>> cubic = Joint("spring", (1,), law=law("cubic_stiffness", stiffness_n_per_m3=4))
    >>> spring = Structure([[1.0]], [[0.0]], [[1.0]], (cubic,))
    >>> (2 * np.pi * level_dependence(spring, mode=1, amplitude=[0.5]).frequency_hz) ** 2
    array([1.75])
    """
    modes = natural_frequencies(structure)
    amplitudes = np.atleast_1d(np.asarray(amplitude, dtype=np.float64))
    if not 1 <= mode <= structure.n_dof or modes.frequency_hz[mode - 1] == 0.0:
        raise InputError(
            f"there is no elastic mode {mode} among the {structure.n_dof} modes: name one, for rigid modes do not shift"
        )
    if amplitudes.ndim != 1 or not ((amplitudes > 0.0) & np.isfinite(amplitudes)).all():
        raise InputError(f"the amplitudes are {amplitude!r}: give positive numbers")
    omega = 2.0 * np.pi * modes.frequency_hz[mode - 1]
    shape = modes.shapes[:, mode - 1]
    # Only the joints are nonlinear.
    stiffness = omega**2 + np.array([_linearise_joints(structure, shape, a, omega, n_phases).real for a in amplitudes])
    if stiffness.min() <= 0.0:
        gone = amplitudes[np.argmin(stiffness)]
        raise InputError(f"mode {mode} has no stiffness left at an amplitude of {gone:g} m kg^1/2: give smaller ones")
    # The velocity is that of the frequency at this amplitude.
    squares = np.array(
        [_linearise_joints(structure, shape, a, w, n_phases) for a, w in zip(amplitudes, stiffness**0.5, strict=True)]
    )
    damping = 2.0 * modes.zeta[mode - 1] * omega + squares.imag / np.sqrt(stiffness)
    return LevelDependence(
        amplitude=amplitudes, frequency_hz=np.sqrt(stiffness) / (2.0 * np.pi), zeta=damping / (2.0 * np.sqrt(stiffness))
    )


def _put_on_rig(
    structure: Structure, sensors: FloatArray, names: tuple[str, ...], shaker: Shaker | None, **facts: Any
) -> CaseStudy:
    """Return the case study of a structure that is driven at the sensor "drive"."""
    rig = Rig(structure, sensors[names.index("drive")], sensors, names, shaker)
    return CaseStudy(rig, modes_of_structure(structure, sensors, names), "drive", **facts)


def _linearise_joints(
    structure: Structure, shape: FloatArray, amplitude: float, omega: float, n_phases: int
) -> complex:
    """Return the part of omega^2 by laws and sliders, and as its imaginary part omega times their damping."""
    phase = 2.0 * np.pi * np.arange(n_phases) / n_phases
    total = 0.0 + 0.0j
    for joint in structure.joints:
        pull = float(joint.direction @ shape)
        if pull == 0.0:
            continue
        z, v = pull * amplitude * np.cos(phase), -pull * amplitude * omega * np.sin(phase)
        force = joint.law.force(z, v)
        if joint.sliders:
            # The loop repeats itself after its first turning point.
            _, start = force_of(joint.sliders, z[:1])
            force = force + force_of(joint.sliders, z, start)[0] - joint.sliders.tangent_n_per_m * z
        total += pull * complex(2.0 * np.mean(force * np.exp(-1j * phase))) / amplitude
    return total


def _make_mount(component: int, axis: int, direction: FloatArray) -> Joint:
    stiffness = _MOUNT_N_PER_M[component][axis]
    omega = np.sqrt(stiffness / _COMPONENT_KG[component])
    fraction, slip_force_n = _SLIPPING_MOUNTS.get((component, axis), (0.0, 0.0))
    sliders = iwan(stiffness_n_per_m=fraction * stiffness, slip_force_n=slip_force_n) if fraction else None
    return Joint(
        f"mount {component + 1} along {_AXES[axis]}",
        direction,
        stiffness_n_per_m=(1.0 - fraction) * stiffness,
        damping_n_s_per_m=_MOUNT_LOSS[component][axis] * stiffness / omega,
        sliders=sliders,
    )


def _find_rigid_motion(position: FloatArray) -> FloatArray:
    """Return the (3, 6) motion of a point of a rigid body for a unit of each translation and rotation."""
    x, y, z = position
    return np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]])


def _name_axes(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}" for name in names for axis in _AXES)


def _make_plate_shapes() -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return mass-normalised shapes at the sensors, (n_sensors, 26), and by name with "slip" and "gap" of the joint.

    The masses are points on a grid of the plate and one of the fixture. The shapes are the rigid-body motions, bending
    of the plate in products of Legendre polynomials, and motions of the plate against the fixture; they are made
    orthogonal one after the other, and mixed somewhat with their neighbours.
    """
    plate = _make_grid(_PLATE_M, 7, 0.0)
    fixture = _make_grid(_FIXTURE_M, 3, -_FIXTURE_DEPTH_M)
    cover = np.array([[0.0, 0.0, 0.03]])
    points = np.vstack([plate, fixture, cover])
    kg = np.repeat([_PLATE_KG / 49, _FIXTURE_KG / 9, _COVER_KG], [49, 9, 1]).repeat(3)
    rigid = np.vstack([_find_rigid_motion(point) for point in points])
    of_plate = np.arange(rigid.shape[0])[:, None] < 3 * len(plate)
    against = np.where(of_plate, rigid, 0.0)

    def bending(m: int, n: int) -> FloatArray:
        field = np.zeros((len(points), 3))
        legendre = np.polynomial.legendre.Legendre.basis
        field[: len(plate), 2] = legendre(m)(2 * plate[:, 0] / _PLATE_M[0]) * legendre(n)(2 * plate[:, 1] / _PLATE_M[1])
        return field.ravel()

    twist = np.zeros((len(points), 3))
    twist[len(plate) : -1, 2] = fixture[:, 0] * fixture[:, 1]
    alone = np.zeros((len(points), 3))
    alone[-1, 2] = 1.0
    opening = 0.5 * against[:, 2] + bending(2, 2)
    elastic = [
        *(bending(1, 1), bending(2, 0), bending(0, 2), against[:, 0], bending(2, 1), against[:, 1], bending(1, 2)),
        *(against[:, 5], bending(3, 0), bending(0, 3), against[:, 3], opening, bending(3, 1), bending(1, 3)),
        *(bending(3, 2), bending(2, 3), alone.ravel(), twist.ravel(), against[:, 4], against[:, 2], bending(3, 3)),
    ]
    weight = np.sqrt(kg)[:, None]
    orthogonal, triangle = np.linalg.qr(weight * np.column_stack([rigid, *elastic]))
    shapes = orthogonal * np.sign(np.diag(triangle)) / weight
    shapes = _mix_shapes(_make_alike(shapes, _N_RIGID + 14, mac=0.6))
    at = dict(zip(_name_axes([f"p{k}" for k in range(len(points))]), shapes, strict=True))
    corners = (0, 6, 42, 48)
    chosen = [f"p{7 * i + j}_z" for i in (0, 2, 4, 6) for j in (0, 2, 4, 6)]
    chosen += [f"p{k}_{axis}" for k in corners for axis in "xy"]
    chosen += [f"p{49 + k}_{axis}" for k in (0, 2, 6, 8) for axis in _AXES]
    rows = {name: at[name] for name in chosen}
    # The drive point is on the edge of the plate, and its direction is a little inclined.
    rows["drive"] = np.cos(0.1) * at["p45_x"] + np.sin(0.1) * at["p45_z"]
    sensors = np.stack(list(rows.values()))
    rows["slip"] = at["p24_x"] - at["p53_x"]
    rows["gap"] = at["p24_z"] - at["p53_z"]
    return sensors, rows


def _make_alike(shapes: FloatArray, first: int, *, mac: float) -> FloatArray:
    """Replace three shapes f, g and a by two orthogonal ones that are alike, by the given MAC, wherever a is zero."""
    f, g, a = shapes[:, first : first + 3].T
    alike, other = np.sqrt(mac), np.sqrt(1.0 - mac)
    pair = np.column_stack([(f + a) / np.sqrt(2.0), (alike * (f - a) + other * g) / np.sqrt(1.0 + mac)])
    return np.hstack([shapes[:, :first], pair, shapes[:, first + 3 :]])


def _mix_shapes(shapes: FloatArray) -> FloatArray:
    """Mix the elastic shapes a little; the two modes of the joint and the two that look alike stay as they are."""
    free = np.setdiff1d(np.arange(_N_RIGID, shapes.shape[1]), [_SHEAR_MODE - 1, _OPENING_MODE - 1, 20, 21])
    i, j = np.meshgrid(free, free, indexing="ij")
    angles = np.triu(0.3 * np.sin(i * j), 1) / (1.0 + np.abs(i - j))
    mixed = shapes.copy()
    mixed[:, free] = shapes[:, free] @ linalg.expm(angles - angles.T)
    return mixed


def _make_grid(size_m: tuple[float, float], n: int, height_m: float) -> FloatArray:
    x, y = np.meshgrid(*(np.linspace(-side / 2, side / 2, n) for side in size_m), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height_m)])
