"""The truth of a simulated test, with which a result is compared; `opid.virtual` makes, writes and reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from opid.errors import InputError
from opid.mechanics.laws.law import Law


@dataclass(frozen=True)
class GearNumbers:
    """True parameters of a gear in its reference run, under the names of the result.

    Args:
        sprung_mass_kg: sprung mass M2.
        suspension_stiffness_n_per_m: stiffness K2 of the suspension.
        suspension_damping_n_s_per_m: damping C2 of the suspension.
        ground_stiffness_n_per_m: stiffness K3 of a spring from the sprung mass to the ground.
    """

    sprung_mass_kg: float
    suspension_stiffness_n_per_m: float
    suspension_damping_n_s_per_m: float
    ground_stiffness_n_per_m: float


@dataclass(frozen=True)
class BodyNumbers:
    """True parameters of a body in its reference run, under the names of the result.

    Args:
        sprung_mass_kg: mass of the body.
        roll_inertia_kg_m2: moment of inertia about the x axis through the centre of gravity.
        pitch_inertia_kg_m2: moment of inertia about the y axis through the centre of gravity.
        x_cg_m: position of the centre of gravity, forward.
        y_cg_m: position of the centre of gravity, to the left.
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
        x_m: position of the suspension, forward.
        y_m: position of the suspension, to the left.
        stiffness_n_per_m: stiffness K.
        damping_n_s_per_m: damping C.
        law: law f.
    """

    x_m: float
    y_m: float
    stiffness_n_per_m: float
    damping_n_s_per_m: float
    law: Law


@dataclass(frozen=True)
class GearTruth:
    """The truth of a taxi test of one gear.

    Args:
        parameters: parameters of the reference run.
        law: law of the suspension.
        mass_change_kg: sprung mass of the second run less that of the first.
        settings: settings of the simulation.
    """

    parameters: GearNumbers
    law: Law
    mass_change_kg: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class BodyTruth:
    """The truth of a taxi test of an aircraft.

    Args:
        parameters: parameters of the reference run.
        interfaces: the suspensions by name.
        loadings: masses that each run carries beyond the reference run, rows of kg, x and y in m.
        settings: settings of the simulation.
    """

    parameters: BodyNumbers
    interfaces: Mapping[str, SuspensionTruth]
    loadings: Mapping[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ModeTruth:
    """The truth of a nonlinear mode; its curves hold while all other modes are at rest.

    Args:
        k: coefficients of the stiffness by power; empty where the joint does not follow a power law.
        c: coefficients of the damping by power.
        amplitude: amplitudes at which the curves are known.
        frequency_hz: natural frequency at each amplitude.
        damping_ratio: damping ratio at each amplitude.
    """

    k: Mapping[int, float]
    c: Mapping[int, float]
    amplitude: tuple[float, ...] = ()
    frequency_hz: tuple[float, ...] = ()
    damping_ratio: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        n, *others = len(self.amplitude), len(self.frequency_hz), len(self.damping_ratio)
        if others != [n, n]:
            raise InputError(
                f"it has {n} amplitudes, {others[0]} frequencies and {others[1]} damping ratios: give one of each for "
                "every amplitude"
            )


@dataclass(frozen=True)
class LinearModesTruth:
    """True frequencies and damping ratios of the linear modes, in their order.

    Args:
        frequency_hz: natural frequency of each mode.
        damping_ratio: damping ratio of each mode.
    """

    frequency_hz: tuple[float, ...] = ()
    damping_ratio: tuple[float, ...] = ()


@dataclass(frozen=True)
class ModalTruth:
    """The truth of a series of modal tests.

    Args:
        nonlinear: the nonlinear modes by number, from 1.
        linear_modes: all modes at small amplitudes.
        structure: the tested structure in a sentence.
        settings: settings of the simulation.
    """

    nonlinear: Mapping[int, ModeTruth]
    linear_modes: LinearModesTruth = LinearModesTruth()
    structure: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class UpdatingTruth:
    """The truth of measured backbones.

    Args:
        linear: factors of the linear structure by name.
        laws: law of each joint by its name.
        structure: the tested structure in a sentence.
        settings: settings of the simulation.
    """

    linear: Mapping[str, float]
    laws: Mapping[str, Law]
    structure: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


TaxiTruth = GearTruth | BodyTruth
Truth = TaxiTruth | ModalTruth | UpdatingTruth
