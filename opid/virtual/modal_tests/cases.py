"""Test series of three structures: one mode with a known law, and the paper's two case studies."""

from __future__ import annotations

import numpy as np

from opid.errors import InputError
from opid.mechanics.rig import Rig
from opid.modal.linear.modes import LinearModes
from opid.modal.model import NonlinearModalModel
from opid.modal.power_laws import power_law
from opid.signals.units import STANDARD_GRAVITY
from opid.virtual.modal_tests.case_studies import CASE_SHAKER, CaseStudy, case_study_1, case_study_2
from opid.virtual.modal_tests.series import VirtualSeries

CASES = ("cubic", "1", "2")

CUBIC_MODE, CUBIC_STIFFNESS, CUBIC_DAMPING = 3, {3: -1.8e11}, {2: 20.0}
"""The nonlinear mode of case "cubic": at its top level it loses 3 % of frequency, and damps twice as much."""

CUBIC_TOP = 5e-4
"""Its largest displacement, m kg^1/2."""


LEVELS_2 = (0.1, 0.25, 0.45, 0.65, 0.85, 1.0)
"""Of case 2, whose highest beat is the truth test: the fit ends at 0.85 of it."""


def virtual_series(case: str, *, shaker: bool | None = None) -> VirtualSeries:
    """Return the test series of a case.

    Args:
        case: "cubic" for four modes, one of which softens and damps by powers that are known; "1" for a case that
            carries components, five of its modes nonlinear, to 20 g at the components; "2" for a plate bolted to a
            fixture, to 300 g at the drive point.
        shaker: whether the force comes from a shaker and its amplifier, or is given as it is; where left out, it comes
            from one in cases "1" and "2".

    Raises:
        InputError: no such case.

    >>> series = virtual_series("cubic")
    >>> series.case.nonlinear_modes, series.truth
    ((3,), 'sweep')
    """
    if case == "cubic":
        found = _cubic(bool(shaker))
        shape = found.modes.shapes[:, CUBIC_MODE - 1]
        top = CUBIC_TOP * float(found.modes.stiffness()[CUBIC_MODE - 1] * np.abs(shape).max())
        return VirtualSeries(found, top, 1024.0, "A mode with cubic softening and quadratic damping")
    if case == "1":
        found = case_study_1() if shaker is not False else case_study_1(shaker=None)
        return VirtualSeries(found, 20 * STANDARD_GRAVITY, 2048.0, "Components on bolted mounts")
    if case == "2":
        found = case_study_2() if shaker is not False else case_study_2(shaker=None)
        return VirtualSeries(
            found,
            300 * STANDARD_GRAVITY,
            4096.0,
            "A plate bolted to a fixture",
            top_sensor=found.drive_point,
            rule="drive point",
            levels=LEVELS_2,
            truth="beat",
        )
    raise InputError(f"there is no case {case!r}: give one of {', '.join(CASES)}")


def _cubic(shaker: bool) -> CaseStudy:
    """A rigid-body mode and three elastic ones at six sensors."""
    shapes = np.array(
        [
            [0.35, 0.30, 0.28, -0.22],
            [0.35, 0.22, -0.30, 0.31],
            [0.35, -0.05, -0.45, -0.25],
            [0.35, -0.28, -0.12, 0.38],
            [0.35, -0.40, 0.25, 0.10],
            [0.35, 0.12, 0.40, 0.42],
        ]
    )
    sensors = ("case_x", "case_y", "lid_x", "lid_y", "board_x", "board_y")
    modes = LinearModes(np.array([0.0, 90.0, 120.0, 158.0]), np.array([0.0, 0.005, 0.004, 0.006]), shapes, sensors)
    model = NonlinearModalModel(modes, {CUBIC_MODE: power_law(CUBIC_STIFFNESS, CUBIC_DAMPING)})
    return CaseStudy(
        rig=Rig(model.structure(), modes.row("case_x"), shapes, sensors, CASE_SHAKER if shaker else None),
        modes=modes,
        drive_point="case_x",
        nonlinear_modes=(CUBIC_MODE,),
        text=f"four modes at six sensors, of which mode {CUBIC_MODE} has k3 q^3 and c2 q'|q'|",
    )
