"""The figures of the report of a body on several suspensions."""

from __future__ import annotations

from opid.report.page import Picture
from opid.suspensions.result import Identification

_OF_ANSWER = {"suspensions", "suspension_forces", "predicted_accelerations", "residual_spectra"}
"""Figures of a fit, which are not drawn of a fit that is refused."""


def body_pictures(result: Identification) -> tuple[Picture, ...]:
    """Return the figures of the report in the order of the page; those that have nothing to show are left out.

    Args:
        result: the identification.
    """
    from opid import plots

    every = (
        Picture(
            "plan_view",
            "Where everything is",
            "The body from above, its front upward: suspensions, the sensors on the body, and what the runs carry more "
            "than the reference. The cross is the centre of gravity that was found, as long as its 95 % intervals.",
            lambda result, truth: plots.plan_view(result, truth=truth),
        ),
        Picture(
            "candidates",
            "Which structure",
            "What each structure leaves of the accelerations, over the noise of the sensors: full marks for the runs "
            "it was fitted to, hollow ones for runs that the others predict. Right of the dashed line the structure "
            "is wrong, however narrow its intervals.",
            lambda result, truth: plots.structure_candidates(result),
        ),
        Picture(
            "suspensions",
            "Suspension by suspension",
            "Stiffness, damping and the amplitudes of the laws with their 95 % intervals, beside one another.",
            lambda result, truth: plots.suspension_parameters(result, truth=truth),
        ),
        Picture(
            "suspension_forces",
            "The force of each suspension",
            "The force over velocity (at z = 0) and over travel (at z′ = 0) as far as the runs went, and its nonlinear "
            "part. Outside the shaded range, the rms of the motion, few samples speak.",
            lambda result, truth: plots.suspension_forces(result, truth=truth),
        ),
        Picture(
            "predicted_accelerations",
            "Measured and predicted",
            "Some seconds of each sensor on the body: what it read, what the model said it would, and the difference.",
            lambda result, truth: plots.predicted_accelerations(result),
        ),
        Picture(
            "residual_spectra",
            "What is left over",
            "The errors of the prediction of each sensor over its noise, averaged over neighbouring lines. One is "
            "noise alone; a hump in one sensor names a place and a band that the structure does not know.",
            lambda result, truth: plots.body_residuals(result),
        ),
    )
    return tuple(picture for picture in every if not (result.is_refused and picture.name in _OF_ANSWER))
