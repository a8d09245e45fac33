"""What is true of a virtual series of modal tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from opid.mechanics.structure import Structure
from opid.modal.power_laws import DAMPING_KINDS, STIFFNESS_KINDS
from opid.virtual.files.truth import TruthKind
from opid.virtual.modal_tests.bolted_structures import level_dependence
from opid.virtual.modal_tests.series import VirtualSeries, top_displacement

N_AMPLITUDES = 25
"""At which the truth tells frequency and damping of a nonlinear mode, up to 1.5 times its highest level."""


def _check(truth: dict[str, Any]) -> None:
    for law in truth["nonlinear"].values():
        for letter in ("k", "c"):
            law[letter] = {str(int(power)): float(value) for power, value in law[letter].items()}


MODAL_TRUTH = TruthKind("opid.modal-truth/1", "a simulated modal test", "opid simulate sine-beats", _check)


def modal_truth(series: VirtualSeries, *, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what is true of a virtual series of modal tests.

    Args:
        series: what was tested.
        settings: what it was simulated with, kept as they are.

    Returns:
        `schema`, `structure` (one sentence), `linear_modes` {frequency_hz, damping_ratio}, `nonlinear` {mode: {k, c
        (coefficients by power; empty where the joint is no power law), amplitude, frequency_hz, damping_ratio (at these
        amplitudes, all other modes at rest)}}, `settings`.
    """
    case = series.case
    return MODAL_TRUTH.content(
        settings,
        structure=case.text,
        linear_modes={"frequency_hz": case.modes.frequency_hz, "damping_ratio": case.modes.damping_ratio},
        nonlinear={str(mode): _true_mode(series, mode) for mode in case.nonlinear_modes},
    )


def _true_mode(series: VirtualSeries, mode: int) -> dict[str, Any]:
    structure = series.case.rig.structure
    largest = 1.5 * top_displacement(series, mode)
    found = level_dependence(structure, mode=mode, amplitude=np.linspace(0, largest, N_AMPLITUDES + 1)[1:])
    return {
        **_powers(structure, mode),
        "amplitude": found.amplitude,
        "frequency_hz": found.frequency_hz,
        "damping_ratio": found.zeta,
    }


def _powers(structure: Structure, mode: int) -> dict[str, dict[str, float]]:
    """The coefficients of a mode whose joint is a sum of powers in its own coordinate."""
    own = np.eye(structure.n_dof)[mode - 1]
    values: dict[str, dict[str, float]] = {"k": {}, "c": {}}
    for joint in structure.joints:
        if joint.sliders is not None or not np.array_equal(joint.direction, own):
            continue
        for letter, kinds in (("k", STIFFNESS_KINDS), ("c", DAMPING_KINDS)):
            powers = {name: power for power, name in kinds.items()}
            for term in joint.law.terms:
                if term.name in powers:
                    values[letter][str(powers[term.name])] = float(term.values[0])
    return values
