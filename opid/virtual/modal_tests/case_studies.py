"""Both case studies of the paper as virtual rigs with their linear modes (Pacini, section 4)."""

from __future__ import annotations

from dataclasses import dataclass

from opid.mechanics.rig import Rig
from opid.mechanics.shaker import Shaker
from opid.modal.linear.modes import LinearModes, modes_of_structure
from opid.virtual.modal_tests.bolted_structures import BoltedStructure, component_assembly, fixture_and_plate

CASE_SHAKER = Shaker(second_harmonic=0.01)
PLATE_SHAKER = Shaker(armature_kg=0.15, back_emf_n_s_per_m=100.0, second_harmonic=0.02, full_voltage_v=70.0)
"""A light armature: at 300 g one of 0.45 kg would take 1300 N to move itself."""


@dataclass(frozen=True, eq=False)
class CaseStudy:
    """A rig, and what a modal test of low level would say of it.

    Args:
        rig: the structure with its sensors and its shaker.
        modes: its linear modes at the sensors, without the shaker.
        drive_point: the sensor at the drive point.
        nonlinear_modes: modes that shift with the level, counted from 1.
        text: what it is, in one sentence.
    """

    rig: Rig
    modes: LinearModes
    drive_point: str
    nonlinear_modes: tuple[int, ...]
    text: str


def case_study_1(*, shaker: Shaker | None = CASE_SHAKER) -> CaseStudy:
    """Return the case with four components: 18 modes, of which 7, 11, 12, 13 and 15 are nonlinear.

    Args:
        shaker: at the drive point; None where the force itself is given.

    >>> study = case_study_1()
    >>> study.modes.n_modes, study.nonlinear_modes
    (18, (7, 11, 12, 13, 15))
    """
    return _case_study(component_assembly(), shaker)


def case_study_2(
    *, ratio: float = 2.02, coupling_n_per_m2: float | None = None, shaker: Shaker | None = PLATE_SHAKER
) -> CaseStudy:
    """Return the plate on its fixture: 26 modes, of which 10 is nonlinear and works on mode 18.

    Args:
        ratio: natural frequency of mode 18 over that of mode 10.
        coupling_n_per_m2: the joint's asymmetry, N/m^2; 0 for modes that do not interact, and that of
            `opid.virtual.fixture_and_plate` where left out.
        shaker: at the drive point; None where the force itself is given.

    Raises:
        InputError: as `fixture_and_plate`.

    >>> study = case_study_2(ratio=2.2)
    >>> study.modes.frequency_hz[[9, 17]].round(1).tolist()
    [400.0, 880.0]
    """
    if coupling_n_per_m2 is None:
        return _case_study(fixture_and_plate(ratio=ratio), shaker)
    return _case_study(fixture_and_plate(ratio=ratio, coupling_n_per_m2=coupling_n_per_m2), shaker)


def _case_study(bolted: BoltedStructure, shaker: Shaker | None) -> CaseStudy:
    row = bolted.sensors[bolted.sensor_names.index(bolted.drive_point)]
    return CaseStudy(
        rig=Rig(bolted.structure, row, bolted.sensors, bolted.sensor_names, shaker),
        modes=modes_of_structure(bolted.structure, bolted.sensors, bolted.sensor_names),
        drive_point=bolted.drive_point,
        nonlinear_modes=bolted.nonlinear_modes,
        text=bolted.text,
    )
