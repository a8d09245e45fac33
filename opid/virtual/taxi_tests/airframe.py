"""A rigid airframe on one gear or several, with one bending mode if wanted: records, loadings and its structure.

Coordinates have any common origin: x forward, y to the left, z up. The airframe heaves by w, rolls by rx about x and
pitches by ry about y; at (x, y) it goes up by j . (w, rx, ry), j = (1, y, -x). A gear alone is an airframe on one gear
that only heaves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR, FloatArray, Law, law
from opid.mechanics.structure import Joint, Sliders, Structure
from opid.suspensions.study import PointMass

BODY_MOTIONS = ("heave", "roll", "pitch", "bending")
"""The degrees of freedom of an airframe, in m, rad, rad, and m for a unit of the bending shape."""

DEFAULT_LAW = law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.02)


@dataclass(frozen=True)
class Gear:
    """A gear of an airframe: a strut between the airframe and a wheel, and a tyre below.

    The strut pulls with F = K z + C z' + f(z, z'), z the motion of the airframe at (x, y) less that of the wheel.

    Args:
        name: prefix of its channels; empty only for a gear alone.
        x_m: position of the gear, forward.
        y_m: position of the gear, to the left.
        unsprung_mass_kg: mass of wheel and rocker.
        suspension_stiffness_n_per_m: stiffness K of the strut.
        suspension_damping_n_s_per_m: damping C of the strut.
        tyre_stiffness_n_per_m: stiffness of the tyre.
        tyre_damping_n_s_per_m: damping of the tyre.
        law: f(z, z') of the strut.
        ground_stiffness_n_per_m: stiffness of a spring from the airframe to the ground at (x, y); 0 if it is free.
        sliders: sliders of the strut, beside the law; None if it has none.

    Raises:
        InputError: the name of a motion of the airframe, a position that is not finite, a mass or tyre stiffness
            that is not positive, a suspension without any spring, another value that is negative.
    """

    name: str
    x_m: float
    y_m: float
    unsprung_mass_kg: float
    suspension_stiffness_n_per_m: float
    suspension_damping_n_s_per_m: float
    tyre_stiffness_n_per_m: float
    tyre_damping_n_s_per_m: float
    law: Law = LINEAR
    ground_stiffness_n_per_m: float = 0.0
    sliders: Sliders | None = None

    def __post_init__(self) -> None:
        if self.name in BODY_MOTIONS:
            raise InputError(f"a gear is called {self.name!r}: give a name, and none of {', '.join(BODY_MOTIONS)}")
        for field, value in vars(self).items():
            if field in ("name", "law", "sliders"):
                continue
            may_be_zero = "damping" in field or field == "ground_stiffness_n_per_m"
            # The gas alone may carry the weight.
            may_be_zero |= field == "suspension_stiffness_n_per_m" and float(self.law.gradient(0.0, 0.0)[0]) > 0.0
            if field in ("x_m", "y_m"):
                is_sound, needed = np.isfinite(value), "a finite number"
            elif may_be_zero:
                is_sound, needed = 0.0 <= value < np.inf, "zero or more"
            else:
                is_sound, needed = 0.0 < value < np.inf, "a positive number"
            if not is_sound:
                gear = f"gear {self.name!r}" if self.name else "landing gear"
                raise InputError(f"{field} of the {gear} is {value}: give {needed}")


@dataclass(frozen=True)
class LandingGear(Gear):
    """A main gear and the mass that it carries: an aircraft with one leg, Iwaniec & Uhl 2007, Fig. 5.

        M2 x2'' = -C2 z' - K2 z - K3 x2 - f(z, z'),   z = x2 - x1
        M1 x1'' = +C2 z' + K2 z + f(z, z') - K1 (x1 - xb) - C1 (x1' - xb')

    Displacements are upward from static equilibrium; xb is the road under the tyre.

    Args:
        name: empty, for its channels need none.
        x_m: position of the gear, forward; it has no effect.
        y_m: position of the gear, to the left; it has no effect.
        unsprung_mass_kg: M1, mass of wheel and rocker.
        suspension_stiffness_n_per_m: K2.
        suspension_damping_n_s_per_m: C2.
        tyre_stiffness_n_per_m: K1.
        tyre_damping_n_s_per_m: C1.
        law: f(z, z') of the strut.
        sprung_mass_kg: M2.
    """

    name: str = ""
    x_m: float = 0.0
    y_m: float = 0.0
    unsprung_mass_kg: float = 105.0
    suspension_stiffness_n_per_m: float = 3.9e5
    suspension_damping_n_s_per_m: float = 6e3
    tyre_stiffness_n_per_m: float = 6.2e5
    tyre_damping_n_s_per_m: float = 1.5e3
    law: Law = DEFAULT_LAW
    sprung_mass_kg: float = 1850.0

    @property
    def airframe(self) -> Airframe:
        """The airframe on this gear alone."""
        gear = Gear(**{each.name: getattr(self, each.name) for each in fields(Gear)})
        return Airframe(self.sprung_mass_kg, None, None, self.x_m, self.y_m, (gear,))


@dataclass(frozen=True)
class BendingMode:
    """A mode in which the fuselage bends, the same over the whole width; linear between the stations.

    Args:
        frequency_hz: sqrt(k/m)/(2 pi) with heave, roll and pitch held; without coupling, that of the free airframe.
        damping_ratio: c/(2 sqrt(k m)).
        modal_mass_kg: modal mass m, for the shape as it is given.
        stations_m: positions along x, ascending.
        shape: upward motion at each station for a unit of the mode.
        coupling: mass that couples the mode to heave (kg), roll and pitch (kg m), sum of dm shape j; zero for a free
            mode of the airframe, until masses are put on it.

    Raises:
        InputError: a frequency or mass that is not positive, negative damping, stations that do not ascend or do not
            go with the shape, values that are not finite.
    """

    frequency_hz: float
    damping_ratio: float
    modal_mass_kg: float
    stations_m: tuple[float, ...]
    shape: tuple[float, ...]
    coupling: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for field in ("stations_m", "shape", "coupling"):
            object.__setattr__(self, field, tuple(float(value) for value in getattr(self, field)))
        values = (self.frequency_hz, self.modal_mass_kg)
        if not (all(0.0 < value < np.inf for value in values) and 0.0 <= self.damping_ratio < np.inf):
            raise InputError(
                f"the bending mode has {self.frequency_hz} Hz, {self.modal_mass_kg} kg and a damping ratio of "
                f"{self.damping_ratio}: give positive numbers, the damping zero or more"
            )
        n_stations = len(self.stations_m)
        if n_stations < 2 or len(self.shape) != n_stations or not (np.diff(self.stations_m) > 0.0).all():
            raise InputError(
                f"the bending mode has {n_stations} station(s) and {len(self.shape)} value(s) of its shape: "
                "give two stations or more that ascend, and one value for each"
            )
        if len(self.coupling) != 3 or not np.isfinite([*self.stations_m, *self.shape, *self.coupling]).all():
            raise InputError(
                "stations, shape or coupling of the bending mode are wrong: give finite numbers and three couplings"
            )

    @property
    def stiffness_n_per_m(self) -> float:
        """k, for a unit of the mode."""
        return self.modal_mass_kg * (2.0 * np.pi * self.frequency_hz) ** 2

    @property
    def damping_n_s_per_m(self) -> float:
        """c, for a unit of the mode."""
        return 4.0 * np.pi * self.damping_ratio * self.frequency_hz * self.modal_mass_kg

    def deflection(self, x_m: ArrayLike) -> FloatArray:
        """Return the shape at positions x, m; InputError beyond the stations."""
        position = np.asarray(x_m, dtype=np.float64)
        first, last = self.stations_m[0], self.stations_m[-1]
        if not ((position >= first) & (position <= last)).all():
            raise InputError(
                f"the bending shape goes from {first:g} to {last:g} m, a position is at {position} m: "
                "give it further stations"
            )
        return np.asarray(np.interp(position, self.stations_m, self.shape))


@dataclass(frozen=True)
class Airframe:
    """Everything above the struts, and the gears it stands on.

    Args:
        mass_kg: sprung mass.
        ixx_kg_m2: sum of dm y^2 about the centre of gravity, moment of inertia in roll; None, as the next one, for an
            airframe on one gear that only heaves.
        iyy_kg_m2: sum of dm x^2 about the centre of gravity, moment of inertia in pitch.
        x_cg_m: centre of gravity, forward.
        y_cg_m: centre of gravity, to the left.
        gears: one gear or more.
        bending: bending mode; None for a rigid airframe.
        ixy_kg_m2: sum of dm x y about the centre of gravity; 0 for a symmetric airframe.

    Raises:
        InputError: values that are not finite, masses and inertias that no body has, no inertia of more than one gear,
            no gear or two of one name, a gear beyond the stations of the bending shape.
    """

    mass_kg: float
    ixx_kg_m2: float | None
    iyy_kg_m2: float | None
    x_cg_m: float
    y_cg_m: float
    gears: tuple[Gear, ...]
    bending: BendingMode | None = None
    ixy_kg_m2: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "gears", tuple(self.gears))
        names = [gear.name for gear in self.gears]
        if self.is_one_gear and (self.iyy_kg_m2 is not None or self.bending or len(names) != 1):
            raise InputError("an airframe without ixx_kg_m2 only heaves: give it one gear, no iyy_kg_m2 and no bending")
        for field, value in vars(self).items():
            if isinstance(value, (int, float)) and not np.isfinite(value):
                raise InputError(f"{field} of the airframe is {value}: give a finite number")
        for field in ("mass_kg",) if self.is_one_gear else ("mass_kg", "ixx_kg_m2", "iyy_kg_m2"):
            if not (getattr(self, field) or 0.0) > 0.0:
                raise InputError(f"{field} of the airframe is {getattr(self, field)}: give a positive number")
        if not names or len(set(names)) != len(names) or ("" in names and len(names) > 1):
            raise InputError(f"the gears are called {names}: give one gear or more, each with a name of its own")
        if not _is_positive(airframe_mass(self)):
            raise InputError(
                f"the mass matrix of the airframe is not positive definite: ixy_kg_m2 is {self.ixy_kg_m2}, "
                "or the coupling of the bending mode is, too large beside masses and inertias"
            )
        _ = self.strut_directions

    @property
    def is_one_gear(self) -> bool:
        """Whether the airframe is a gear alone with the mass that it carries, which only heaves."""
        return self.ixx_kg_m2 is None

    @property
    def body_motions(self) -> tuple[str, ...]:
        """The degrees of freedom of the airframe: "heave", "roll", "pitch" and, if it bends, "bending"."""
        return BODY_MOTIONS[:1] if self.is_one_gear else BODY_MOTIONS if self.bending else BODY_MOTIONS[:3]

    @property
    def strut_directions(self) -> FloatArray:
        """(n_gears, n_body) upward motion of each strut for a unit of each motion, by `place_directions`."""
        return place_directions(self, [(gear.x_m, gear.y_m) for gear in self.gears])


def place_directions(airframe: Airframe, places_m: ArrayLike) -> FloatArray:
    """Return the upward motion of positions for a unit of each motion of the airframe, (1, y, -x) and bending shape.

    Args:
        airframe: the airframe.
        places_m: (n, 2) x and y of each position, m.

    Returns:
        (n, n_body), n_body 3, or 4 if it bends, or 1 of a gear alone.

    Raises:
        InputError: positions of another shape or not finite; one beyond the stations of the bending shape.

    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> place_directions(default_aircraft(), [(2.0, 1.5)])
    array([[ 1. ,  1.5, -2. ]])
    """
    try:
        positions = np.asarray(places_m, dtype=np.float64)
    except ValueError:
        positions = np.empty(0)
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.isfinite(positions).all():
        raise InputError(f"the positions are {places_m!r}: give a pair of finite numbers, x and y in m, for each")
    x, y = positions.T
    bent = [airframe.bending.deflection(x)] if airframe.bending else []
    return np.stack([np.ones(x.size), y, -x, *bent][: len(airframe.body_motions)], axis=1)


def airframe_mass(airframe: Airframe) -> FloatArray:
    """Return the mass matrix of the airframe about the origin, sum of dm j j^T, (n_body, n_body).

    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> airframe_mass(default_aircraft())[0]
    array([ 5400.,     0., -3240.])
    """
    m, x, y = airframe.mass_kg, airframe.x_cg_m, airframe.y_cg_m
    if airframe.ixx_kg_m2 is None or airframe.iyy_kg_m2 is None:
        return np.array([[m]])
    ixy = airframe.ixy_kg_m2 + m * x * y
    mass = np.zeros((len(airframe.body_motions),) * 2)
    mass[:3, :3] = [
        [m, m * y, -m * x],
        [m * y, airframe.ixx_kg_m2 + m * y**2, -ixy],
        [-m * x, -ixy, airframe.iyy_kg_m2 + m * x**2],
    ]
    if airframe.bending:
        mass[3, 3] = airframe.bending.modal_mass_kg
        mass[3, :3] = mass[:3, 3] = airframe.bending.coupling
    return mass


def loaded(airframe: Airframe, loadings: Iterable[PointMass]) -> Airframe:
    """Return the airframe with point masses put on it: mass, centre of gravity, inertias and bending mode change.

    Stiffness and damping of the bending mode do not change.

    Args:
        airframe: the airframe.
        loadings: the masses.

    Raises:
        InputError: a loading that is not finite, or more mass or inertia taken off than there is.

    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> heavy = loaded(default_aircraft(), [PointMass(600.0, -0.6)])
    >>> heavy.mass_kg, round(heavy.x_cg_m, 3)
    (6000.0, 0.48)
    """
    given = tuple(loadings)
    mass = airframe_mass(airframe)
    for loading in given:
        if not np.isfinite([loading.mass_kg, loading.x_m, loading.y_m]).all():
            raise InputError(
                f"a loading of {loading.mass_kg} kg is at ({loading.x_m}, {loading.y_m}) m: give finite numbers"
            )
        (direction,) = place_directions(airframe, [(loading.x_m, loading.y_m)])
        mass += loading.mass_kg * np.outer(direction, direction)
    if not _is_positive(mass):
        raise InputError(
            f"loadings of {[loading.mass_kg for loading in given]} kg leave a mass matrix that is not positive "
            "definite: they take off more mass or inertia than there is, check signs and positions"
        )
    total = float(mass[0, 0])
    if airframe.is_one_gear:
        return replace(airframe, mass_kg=total)
    x, y = -float(mass[0, 2]) / total, float(mass[0, 1]) / total
    return replace(
        airframe,
        mass_kg=total,
        x_cg_m=x,
        y_cg_m=y,
        ixx_kg_m2=float(mass[1, 1]) - total * y**2,
        iyy_kg_m2=float(mass[2, 2]) - total * x**2,
        ixy_kg_m2=-float(mass[1, 2]) - total * x * y,
        bending=_load_bending(airframe.bending, mass) if airframe.bending else None,
    )


def airframe_structure(airframe: Airframe) -> Structure:
    """Return the structure of an airframe on its gears, displacements upward from static equilibrium.

    Degrees of freedom: "heave" (m), "roll" and "pitch" (rad) at the origin of coordinates, "bending" if it bends, and
    the wheel of each gear by its name (m); "heave" and "wheel" of a gear alone. The struts are joints by the names of
    their wheels. A ground spring K3 pulls the airframe down at its strut by K3 times its upward motion there. The road
    acts through forces on the wheels.

    Args:
        airframe: the airframe.

    >>> from opid.mechanics.structure import natural_frequencies
    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> natural_frequencies(airframe_structure(default_aircraft())).frequency_hz.round(2)
    array([ 1.36,  1.52,  1.77, 14.86, 16.03, 16.04])
    >>> natural_frequencies(airframe_structure(LandingGear().airframe)).frequency_hz.round(2)
    array([ 1.8 , 15.68])
    """
    n_body, n_gears = len(airframe.body_motions), len(airframe.gears)
    mass, damping, stiffness = (np.zeros((n_body + n_gears,) * 2) for _ in range(3))
    mass[:n_body, :n_body] = airframe_mass(airframe)
    if airframe.bending:
        damping[3, 3], stiffness[3, 3] = airframe.bending.damping_n_s_per_m, airframe.bending.stiffness_n_per_m
    names = [gear.name or "wheel" for gear in airframe.gears]
    joints = []
    for row, (gear, at_strut) in enumerate(zip(airframe.gears, airframe.strut_directions, strict=True), start=n_body):
        mass[row, row] = gear.unsprung_mass_kg
        damping[row, row], stiffness[row, row] = gear.tyre_damping_n_s_per_m, gear.tyre_stiffness_n_per_m
        stiffness[:n_body, :n_body] += gear.ground_stiffness_n_per_m * np.outer(at_strut, at_strut)
        wheel = -np.eye(n_gears)[row - n_body]
        joints.append(
            Joint(
                names[row - n_body],
                np.concatenate([at_strut, wheel]),
                gear.suspension_stiffness_n_per_m,
                gear.suspension_damping_n_s_per_m,
                gear.law,
                gear.sliders,
            )
        )
    return Structure(mass, damping, stiffness, tuple(joints), (*airframe.body_motions, *names))


def _load_bending(bending: BendingMode, mass: FloatArray) -> BendingMode:
    """Return the mode with the mass matrix of a loaded airframe; its stiffness and damping are kept."""
    ratio = float(mass[3, 3]) / bending.modal_mass_kg
    return replace(
        bending,
        modal_mass_kg=float(mass[3, 3]),
        frequency_hz=bending.frequency_hz / np.sqrt(ratio),
        damping_ratio=bending.damping_ratio / np.sqrt(ratio),
        coupling=tuple(mass[3, :3].tolist()),
    )


def _is_positive(mass: FloatArray) -> bool:
    """Return whether a mass matrix is positive definite, whatever the units of its motions."""
    scale = np.sqrt(np.abs(np.diag(mass)))
    return bool((np.diag(mass) > 0.0).all() and np.linalg.eigvalsh(mass / np.outer(scale, scale))[0] > 1e-12)
