"""The figures of the report of one gear."""

from __future__ import annotations

from opid.report.page import Picture
from opid.suspensions.answer.as_json import chain_of
from opid.suspensions.law_search.force_surface import ForceSurface
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.result import Identification

_OF_CHAIN = {
    "integration",
    "restoring_force_surface",
    "restoring_force_map",
    "slices",
    "transmissibility",
    "estimates",
}
"""Figures of the steps of the paper, which cannot be taken on all runs."""
_OF_MODEL = {"force_sections", "force_departures"}
"""Figures of the driven model."""
_OF_ANSWER = {"force_sections", "force_departures", "law_curves", "equation_residual"}
"""Figures of a fit, which are not drawn of a fit that is refused."""
_OF_LAW = {"estimates"}
"""Figures of the paper's chain, which takes its law from the joint fit: likewise. (The chain beside a driven model that
is refused takes no law.)"""


def gear_pictures(result: AnyIdentification) -> tuple[Picture, ...]:
    """Return the figures of the report in the order of the page; those that have nothing to show are left out.

    Args:
        result: the identification.
    """
    from opid import plots

    every = (
        Picture(
            "accelerations",
            "What was recorded",
            "The spindle (grey) follows the road; the airframe above the strut (in colour) moves less and slower. If "
            "the grey signal is the quieter one, the sensors are swapped.",
            lambda result, truth: plots.accelerations(result),
        ),
        Picture(
            "integration",
            "From acceleration to motion",
            "Removing the mean before each integration leaves a parabola that hides the motion, for the mean of a "
            "velocity over a finite run is not its constant of integration. The steps of the paper below rest on "
            "the other curve, which keeps only the band in which the motion can be known; the driven model integrates "
            "no acceleration.",
            lambda result, truth: plots.integration(_reference_run(result)),
        ),
        Picture(
            "restoring_force_surface",
            "Restoring force",
            "The force on the sprung mass over travel and velocity, averaged over cells, before any law is assumed. "
            "A linear suspension gives a plane; a step or a bend is the nonlinearity.",
            lambda result, truth: plots.restoring_force_surface(_reference_run(result)),
        ),
        Picture(
            "restoring_force_map",
            "The same from above, and where the data are",
            "Left, straight and evenly spaced contours mean a linear law; a kink at zero velocity is friction. Right, "
            "no law is known where no samples are.",
            lambda result, truth: plots.restoring_force_map(_reference_run(result)),
        ),
        Picture(
            "slices",
            "Stiffness curve and damping curve",
            "Slices through the surface near zero velocity and near zero travel, with an arctangent fitted to each "
            "and what it leaves over (Figs. 6 and 7 of the paper).",
            lambda result, truth: plots.slices(_reference_run(result)),
        ),
        Picture(
            "law_ladder",
            "Which law",
            "Each law is fitted to all runs at once. A good one comes down to the noise floor of the sensors (dashed); "
            "a further term is kept only if it lowers the error, also of a run left out of the fit (diamonds).",
            lambda result, truth: plots.law_ladder(result),
        ),
        Picture(
            "force_sections",
            "The law against the force without a law",
            "Measured force on the predicted motion, less stiffness and damping, averaged in bins near zero velocity "
            "and near zero travel with two standard errors; the line is the law.",
            lambda result, truth: plots.force_sections(_surface(result)),
        ),
        Picture(
            "force_departures",
            "Where the law and the force disagree",
            "Mean measured force less that of the model in each visited cell, in standard errors. Speckle is chance; a "
            "patch of one colour is a term that the law lacks.",
            lambda result, truth: plots.force_departures(_surface(result)),
        ),
        Picture(
            "law_curves",
            "The law that was found",
            "The nonlinear force beside the linear one. Beyond the shaded range, and above all beyond the drawn one, "
            "the law is an extrapolation. A law that remembers is drawn as in a slow motion in one direction.",
            lambda result, truth: plots.law_curves(result, truth=truth),
        ),
        Picture(
            "transmissibility",
            "Transmissibility",
            "Ratio of airframe to spindle. With the nonlinear force taken out it should follow the dashed curve of the "
            "fitted suspension, which has one resonance; other peaks of the measured ratio are friction and chance.",
            lambda result, truth: plots.transmissibilities(result),
        ),
        Picture(
            "equation_residual",
            "What is left over",
            "The misfit of the equation of motion, expressed as the sensor noise that would cause it. Near the dashed "
            "line the model explains all that the sensors can show; a hump names the band in which it does not.",
            lambda result, truth: plots.equation_residual(result),
        ),
        Picture(
            "estimates",
            "Every method side by side",
            "Mass from two runs of known mass difference, and the ratios to it, with 95 % intervals. Values beyond the "
            "frame stand at its edge. The peak formula is the paper's; hollow marks come from peaks that the mass "
            "change cannot have moved so.",
            lambda result, truth: plots.estimates(result, truth=truth),
        ),
    )
    without: set[str] = set()
    if chain_of(result) is None:
        without |= _OF_CHAIN
    if not isinstance(result, Identification):
        without |= _OF_MODEL
    if result.is_refused:
        without |= _OF_ANSWER if isinstance(result, Identification) else _OF_ANSWER | _OF_LAW
    return tuple(picture for picture in every if picture.name not in without)


def _reference_run(result: AnyIdentification) -> RunEvidence:
    """The run without a mass change, or the first one."""
    runs = result.paper_chain.runs
    return next((run for run in runs if run.mass_change_kg == 0), runs[0])


def _surface(result: Identification) -> ForceSurface:
    return next(iter(result.evidence[0].surfaces.values()))
