"""What is known of the errors of measured backbones and of the linear structure, as settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError

POSITIVE = (
    "weight", "linear_error", "point_noise", "curve_offset", "linear_shape_error", "shape_noise", "shape_offset",
)  # fmt: skip
"""Settings of the noise that must be positive."""

GROWTHS = ("linear_error_growth", "curve_growth")
"""Settings that may be 0."""

LINEAR_ERROR_GROWTH = 0.3
"""Where nothing is known: on the wing-engine structure 91 of 100 intervals hold the coefficient if the linear error is
one of the moduli, and nearly all, being too wide, if it is one of the modal eigenvalues."""

UNMENDED_GROWTH = 0.22
"""That of an error that no factor of the stiffness mends, beside what phase I leaves in the factors: that of a modal
eigenvalue grows by 0.02 and 0.1 in the two modes of the wing-engine structure, more where modes interact."""


PAPERS = ("weight", "cov", "shape_factor")
"""Settings of both phases in every form but the recommended, which does not use them."""


class LeftOut(float):
    """The default of a setting that a study may work out: a number like any other where it does not.

    A stated value is a plain float, also one that equals the default.

    >>> LeftOut(0.3) == 0.3, isinstance(NoiseSettings(linear_error_growth=0.3).linear_error_growth, LeftOut)
    (True, False)
    """


@dataclass(frozen=True)
class NoiseSettings:
    """What is known of the errors of backbones: the first three for both phases of the paper's forms and "independent".

    From `linear_error` on they are of the recommended form; `linear_error` stands in phase I of "independent", too.

    Args:
        weight: w_m, of every mode (Song eqs. 5 and 6).
        cov: coefficient of variation of lambda by the number of the mode; from the curves of each mode where None.
        shape_factor: sigma_phi over w CoV; the square root of the number of sensors where None (Song eq. 6).
        linear_error: standard deviation of the relative error of a linear frequency of the model.
        linear_error_growth: how far that error of lambda may grow while lambda doubles by the nonlinearity, in units
            of itself: 0 for an error of the modal eigenvalue, 0.5 and 0.1 for errors of the moduli in the two modes of
            the wing-engine structure. Left out in a study that updates the linear structure, it is worked out for each
            mode from what phase I leaves (`opid.updating.likelihood.linear_error`) and from 0.22 beside it; a stated
            0.3 is kept.
        point_noise: relative error of a measured frequency that is expected; the level is inferred, this weighs as
            much as one point.
        curve_offset: relative offset of the frequencies of a curve that is expected (imperfect quadrature); the level
            is inferred, its prior is half normal with twice this as its scale.
        curve_growth: how far the offset of a curve may grow while lambda doubles, in units of the noise of a point.
        linear_shape_error: standard deviation of the error of a linear shape of unit length, a sensor; of phase II
            alone: in phase I the scatter of the shapes is unknown and takes in what the model misses.
        shape_noise: expected error of a measured shape of unit length, a sensor; weighs as much as one point.
        shape_offset: expected offset of the shapes of a curve, a sensor, likewise.
        shapes: whether the shapes are used at all.

    Raises:
        InputError: a level that is not positive.
    """

    weight: float = 1.0
    cov: Mapping[int, float] | None = None
    shape_factor: float | None = None
    linear_error: float = 0.004
    linear_error_growth: float = LeftOut(LINEAR_ERROR_GROWTH)
    point_noise: float = 0.0005
    curve_offset: float = 0.003
    curve_growth: float = 3.0
    linear_shape_error: float = 0.02
    shape_noise: float = 0.003
    shape_offset: float = 0.003
    shapes: bool = True

    def __post_init__(self) -> None:
        levels = {name: getattr(self, name) for name in POSITIVE}
        levels |= {f"cov of mode {mode}": value for mode, value in (self.cov or {}).items()}
        if self.shape_factor is not None:
            levels["shape_factor"] = self.shape_factor
        for name, level in levels.items():
            if not (np.isfinite(level) and level > 0):
                raise InputError(f"{name} is {level}: give a positive number")
        for name in GROWTHS:
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise InputError(f"{name} is {getattr(self, name)}: give 0 or more")

    @property
    def stated_for_papers(self) -> tuple[str, ...]:
        """Those of `PAPERS` that are not at their default."""
        return tuple(name for name in PAPERS if getattr(self, name) != type(self).__dataclass_fields__[name].default)
