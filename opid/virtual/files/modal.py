"""What is true of a virtual series of modal tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from opid.mechanics.structure import Structure
from opid.mechanics.truth import LinearModesTruth, ModalTruth, ModeTruth
from opid.modal.power_laws import DAMPING_KINDS, STIFFNESS_KINDS
from opid.virtual.modal_tests.bolted_structures import level_dependence
from opid.virtual.modal_tests.series import VirtualSeries, top_displacement

N_AMPLITUDES = 25
"""At which the truth tells frequency and damping of a nonlinear mode, up to 1.5 times its highest level."""


def modal_truth(series: VirtualSeries, *, settings: Mapping[str, Any] | None = None) -> ModalTruth:
    """Return what is true of a virtual series of modal tests.

    Args:
        series: what was tested.
        settings: what it was simulated with, kept as they are.
    """
    case = series.case
    modes = case.modes
    return ModalTruth(
        {mode: _true_mode(series, mode) for mode in case.nonlinear_modes},
        LinearModesTruth(tuple(modes.frequency_hz.tolist()), tuple(modes.damping_ratio.tolist())),
        case.text,
        dict(settings or {}),
    )


def _true_mode(series: VirtualSeries, mode: int) -> ModeTruth:
    structure = series.case.rig.structure
    largest = 1.5 * top_displacement(series, mode)
    found = level_dependence(structure, mode=mode, amplitude=np.linspace(0, largest, N_AMPLITUDES + 1)[1:])
    curves = (tuple(each.tolist()) for each in (found.amplitude, found.frequency_hz, found.zeta))
    return ModeTruth(*_powers(structure, mode), *curves)


def _powers(structure: Structure, mode: int) -> tuple[dict[int, float], dict[int, float]]:
    """The coefficients k and c of a mode whose joint is a sum of powers in its own coordinate."""
    own = np.eye(structure.n_dof)[mode - 1]
    k: dict[int, float] = {}
    c: dict[int, float] = {}
    for joint in structure.joints:
        if joint.sliders is not None or not np.array_equal(joint.direction, own):
            continue
        for values, kinds in ((k, STIFFNESS_KINDS), (c, DAMPING_KINDS)):
            powers = {name: power for power, name in kinds.items()}
            values |= {powers[each.name]: float(each.values[0]) for each in joint.law.terms if each.name in powers}
    return k, c
