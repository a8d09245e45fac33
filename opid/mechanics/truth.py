"""What is true of a simulated test: a result is compared with it; `opid.virtual` makes, writes and reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from opid.mechanics.laws.law import Law


@dataclass(frozen=True)
class GearNumbers:
    """What is true of a gear in its reference run, under the names of the result.

    Args:
        sprung_mass_kg: M2.
        suspension_stiffness_n_per_m: K2.
        suspension_damping_n_s_per_m: C2.
        ground_stiffness_n_per_m: K3, of a spring from the sprung mass to the ground.
    """

    sprung_mass_kg: float
    suspension_stiffness_n_per_m: float
    suspension_damping_n_s_per_m: float
    ground_stiffness_n_per_m: float


@dataclass(frozen=True)
class BodyNumbers:
    """What is true of a body in its reference run, under the names of the result.

    Args:
        sprung_mass_kg: of the body.
        roll_inertia_kg_m2: about the x axis through the centre of gravity.
        pitch_inertia_kg_m2: about the y axis through it.
        x_cg_m: of the centre of gravity, forward.
        y_cg_m: likewise, to the left.
    """

    sprung_mass_kg: float
    roll_inertia_kg_m2: float
    pitch_inertia_kg_m2: float
    x_cg_m: float
    y_cg_m: float


@dataclass(frozen=True)
class SuspensionTruth:
    """One suspension of a body and its force K z + C z' + f(z, z').

    Args:
        x_m: where it is, forward.
        y_m: likewise, to the left.
        stiffness_n_per_m: K.
        damping_n_s_per_m: C.
        law: f.
    """

    x_m: float
    y_m: float
    stiffness_n_per_m: float
    damping_n_s_per_m: float
    law: Law


@dataclass(frozen=True)
class GearTruth:
    """What is true of a taxi test of one gear.

    Args:
        parameters: of the reference run.
        law: of the suspension.
        mass_change_kg: sprung mass of the second run less that of the first.
        settings: that it was simulated with.
    """

    parameters: GearNumbers
    law: Law
    mass_change_kg: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class BodyTruth:
    """What is true of a taxi test of an aircraft.

    Args:
        parameters: of the reference run.
        interfaces: the suspensions by name.
        loadings: by run, what it carries more than the reference: rows of kg, x and y in m.
        settings: that it was simulated with.
    """

    parameters: BodyNumbers
    interfaces: Mapping[str, SuspensionTruth]
    loadings: Mapping[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ModeTruth:
    """What is true of a nonlinear mode; its curves hold while all other modes are at rest.

    Args:
        k: coefficients of the stiffness by power; none where the joint is no power law.
        c: those of the damping.
        amplitude: at which the curves are known.
        frequency_hz: at each amplitude.
        damping_ratio: at each amplitude.
    """

    k: Mapping[int, float]
    c: Mapping[int, float]
    amplitude: tuple[float, ...] = ()
    frequency_hz: tuple[float, ...] = ()
    damping_ratio: tuple[float, ...] = ()


@dataclass(frozen=True)
class LinearModesTruth:
    """What is true of the linear modes, in their order.

    Args:
        frequency_hz: of each.
        damping_ratio: of each.
    """

    frequency_hz: tuple[float, ...] = ()
    damping_ratio: tuple[float, ...] = ()


@dataclass(frozen=True)
class ModalTruth:
    """What is true of a series of modal tests.

    Args:
        nonlinear: the nonlinear modes by number, from 1.
        linear_modes: all modes at small amplitudes.
        structure: what was tested, in a sentence.
        settings: that it was simulated with.
    """

    nonlinear: Mapping[int, ModeTruth]
    linear_modes: LinearModesTruth = LinearModesTruth()
    structure: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class UpdatingTruth:
    """What is true of measured backbones.

    Args:
        linear: factors of the linear structure by name.
        law: of the joints.
        structure: what was tested, in a sentence.
        settings: that it was simulated with.
    """

    linear: Mapping[str, float]
    law: Law
    structure: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


TaxiTruth = GearTruth | BodyTruth
Truth = TaxiTruth | ModalTruth | UpdatingTruth
