"""The figures of an identification: those of one gear, with the steps of the paper, and those of a body."""

from __future__ import annotations

from collections.abc import Iterator

from opid import plots
from opid.mechanics.truth import BodyTruth, GearTruth, TaxiTruth
from opid.plots.force import find_rested_springs
from opid.report.document import Figure
from opid.suspensions.answer.as_json import chain_of
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.result import Identification


def list_figures(result: AnyIdentification, truth: TaxiTruth | None = None) -> Iterator[Figure]:
    """Yield the figures, in the order of the page, for which the result has data.

    A refused fit is not drawn, nor is the law of a fit whose errors prevent an answer. The steps of the paper are drawn
    only if they can be taken on all runs.
    """
    if any(run.clocks for run in result.study.runs):
        yield Figure(
            "clock_lags",
            "Two recorders, two clocks",
            "What the straight line of offset and drift leaves of the lag between two recorders, in windows of some "
            "seconds. A suspension that is not linear changes its phase with the strength of the motion, so that slow "
            "changes of a millisecond are usual; a step is a clock that jumps. The fit estimates lag and drift again, "
            "with the motion of the model.",
            lambda: plots.clock_lags(result),
        )
    if result.study.is_one_gear:
        yield from _list_gear_figures(result, truth if isinstance(truth, GearTruth) else None)
    elif isinstance(result, Identification):
        yield from _list_body_figures(result, truth if isinstance(truth, BodyTruth) else None)


def _list_gear_figures(result: AnyIdentification, truth: GearTruth | None) -> Iterator[Figure]:
    chain = chain_of(result)
    yield Figure(
        "accelerations",
        "What was recorded",
        "The spindle (grey) follows the road; the airframe above the strut (in colour) moves less and slower. "
        + (
            "If the grey signal is the quieter one, the sensors are swapped."
            if result.study.is_driven
            else "No sensor is there: its acceleration follows from the travel, up to where this sinks into its noise."
        ),
        lambda: plots.accelerations(result),
    )
    if chain is not None:
        # the reference is the run without a mass change, or else the first one
        reference = next((run for run in chain.runs if run.mass_change_kg == 0), chain.runs[0])
        yield Figure(
            "integration",
            "From acceleration to motion",
            "Removing the mean before each integration leaves a parabola that hides the motion, for the mean of a "
            "velocity over a finite run is not its constant of integration. The steps of the paper below rest on "
            "the other curve, which keeps only the band in which the motion can be known; the driven model integrates "
            "no acceleration.",
            lambda: plots.integration(reference),
        )
        yield Figure(
            "restoring_force_surface",
            "Restoring force",
            "The force on the sprung mass over travel and velocity, averaged over cells, before any law is assumed. "
            "A linear suspension gives a plane; a step or a bend is the nonlinearity.",
            lambda: plots.restoring_force_surface(reference),
        )
        yield Figure(
            "restoring_force_map",
            "The same from above, and where the data are",
            "Left, straight and evenly spaced contours mean a linear law; a kink at zero velocity is friction. Right, "
            "no law is known where no samples are.",
            lambda: plots.restoring_force_map(reference),
        )
        yield Figure(
            "slices",
            "Stiffness curve and damping curve",
            "Slices through the surface near zero velocity and near zero travel, with an arctangent fitted to each "
            "and what it leaves over (Figs. 6 and 7 of the paper).",
            lambda: plots.slices(reference),
        )
    yield Figure(
        "law_ladder",
        "Which law",
        "Each law is fitted to all runs at once. A good one comes down to the noise floor of the sensors (dashed); "
        "a further term is kept only if it lowers the error, also of a run left out of the fit (diamonds).",
        lambda: plots.law_ladder(result),
    )
    if isinstance(result, Identification) and not result.is_refused:
        surface = next(iter(result.evidence[0].surfaces.values()))
        yield Figure(
            "force_sections",
            "The law against the force without a law",
            "Measured force on the predicted motion, less stiffness and damping, averaged in bins near zero velocity "
            "and near zero travel with two standard errors, on one scale; the line is the law.",
            lambda: plots.force_sections(surface),
        )
        yield Figure(
            "force_departures",
            "Where the law and the force disagree",
            "Mean measured force less that of the model in each visited cell, in standard errors. Speckle is chance; a "
            "patch of one colour is a term that the law lacks.",
            lambda: plots.force_departures(surface),
        )
    if _has_law(result):
        yield Figure(
            "law_curves",
            "The law that was found",
            "The nonlinear force beside the linear one. Beyond the shaded range, and above all beyond the drawn one, "
            "the law is an extrapolation. A law that remembers is drawn as in a slow motion in one direction.",
            lambda: plots.law_curves(result, truth=truth),
        )
    yield from _list_rest_figures(result, truth)
    if chain is not None:
        if result.method == "paper":
            yield Figure(
                "printed_slices",
                "The same curves as printed",
                "The mean is removed before each integration, and the arctangent has the fixed amplitude of eq. (3). "
                "The parabola in the travel spreads the points, so that the curves hardly show the suspension.",
                lambda: plots.slices(chain.reference.printed),
            )
        yield Figure(
            "printed_transmissibility",
            "Transmissibilities and matched peaks as printed",
            "Both |T| with the force of eq. (3) subtracted and the spectra of Table 2 (Fig. 8 of the paper), and the "
            "matched peaks, numbered as in Table 3 (Fig. 9). A block of 32 s leaves about one average of a run, so "
            "that most peaks are chance; hollow marks are of pairs that the mass change cannot have moved so.",
            lambda: plots.printed_transmissibilities(result),
        )
        yield Figure(
            "transmissibility",
            "Transmissibility",
            "Motion of the airframe over that of the spindle, frequency by frequency. Grey is what was measured; its "
            "peaks (triangles) are of the suspension, of friction or of chance. In colour the nonlinear force is taken "
            "out: if the law is right, that curve lies on the dashed one, of a suspension without the law, but for the "
            "tip of the resonance, which few averages blunt.",
            lambda: plots.transmissibilities(result),
        )
    if not result.is_refused:
        yield Figure(
            "equation_residual",
            "What is left over",
            "The misfit of the equation of motion, expressed as the sensor noise that would cause it. Near the dashed "
            "line the model explains all that the sensors can show; a hump names the band in which it does not.",
            lambda: plots.equation_residual(result),
        )
    yield from _list_left_out_figures(result)
    if chain is not None and _has_law(result):
        has_peak_formula = result.method == "paper"
        peaks = (
            " Values beyond the frame stand at its edge. The peak formula is the paper's; hollow marks come from peaks "
            "that the mass change cannot have moved so."
        )
        yield Figure(
            "estimates",
            "Every method side by side",
            "Mass from two runs of known mass difference, and the ratios to it, with 95 % intervals."
            f"{peaks * has_peak_formula}",
            lambda: plots.estimates(result, truth=truth, has_peak_formula=has_peak_formula),
        )


def _has_law(result: AnyIdentification) -> bool:
    """Return whether the law of a fit is drawn: not of a refused one, nor where its errors prevent an answer.

    Then the terms of a wrong law may be thousands of times the force, and cancel. Runs at one loading give no mass
    whatever the law is, so that theirs is drawn.
    """
    if result.is_refused or isinstance(result, PaperIdentification):
        return not result.is_refused
    is_one_loading = len({run.loading for run in result.runs}) == 1
    return is_one_loading or not (result.not_determined and result.limited_by == "model")


def _list_body_figures(result: Identification, truth: BodyTruth | None) -> Iterator[Figure]:
    yield Figure(
        "plan_view",
        "Where everything is",
        "The body from above, its front upward: suspensions, the sensors on the body, and what the runs carry more "
        "than the reference. The cross is the centre of gravity that was found, as long as its 95 % intervals.",
        lambda: plots.plan_view(result, truth=truth),
    )
    yield Figure(
        "candidates",
        "Which structure",
        "What each structure leaves of the accelerations, over the noise of the sensors: full marks for the runs "
        "it was fitted to, hollow ones for runs that the others predict. Right of the dashed line the structure "
        "is wrong, however narrow its intervals.",
        lambda: plots.structure_candidates(result),
    )
    if result.is_refused:
        return
    if _has_law(result):
        yield Figure(
            "suspensions",
            "Suspension by suspension",
            "Stiffness, damping and the amplitudes of the laws: 95 % intervals about each estimate, whose value stands "
            "above; ± is one standard deviation.",
            lambda: plots.suspension_parameters(result, truth=truth),
        )
        yield Figure(
            "suspension_forces",
            "The force of each suspension",
            "The force over velocity (at z = 0) and over travel (at z′ = 0) as far as the runs went, and its nonlinear "
            "part. Outside the shaded range, the rms of the motion, few samples speak.",
            lambda: plots.suspension_forces(result, truth=truth),
        )
    yield from _list_rest_figures(result, truth)
    yield Figure(
        "predicted_accelerations",
        "Measured and predicted",
        "Some seconds of each sensor on the body: what it read, what the model said it would, and "
        "the difference on a scale of its own.",
        lambda: plots.predicted_accelerations(result),
    )
    yield Figure(
        "residual_spectra",
        "What is left over",
        "The errors of the prediction of each sensor over its noise, averaged over neighbouring lines. One is "
        "noise alone; a hump in one sensor names a place and a band that the structure does not know.",
        lambda: plots.body_residuals(result),
    )
    yield from _list_left_out_figures(result)


def _list_left_out_figures(result: AnyIdentification) -> Iterator[Figure]:
    """The runs as the others predict them, where more than noise is left."""
    if isinstance(result, Identification) and result.left_out and not result.is_refused:
        yield Figure(
            "left_out_spectra",
            "Runs that the others predict",
            "Each run was left out of a fit of the others, which then predicts it from the motion below the suspension "
            "alone, no reading on the body among it. The shaded band is as wide as what holds 95 % of the errors of "
            "another run, a third of an octave at a time. Where the error comes up to the measured line, the model "
            "says nothing of the motion there.",
            lambda: plots.left_out_spectra(result),
        )


def _list_rest_figures(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Figure]:
    """Where each run rests, if a law depends on travel."""
    if isinstance(result, Identification) and _has_law(result) and find_rested_springs(result):
        yield Figure(
            "static_curves",
            "Where each run rests",
            "The force of the springs standing still, beyond that at rest in the reference run, over the travel from "
            "the origin of the law (extension positive). A run that carries another mass rests elsewhere on it (marks) "
            "and is as stiff as the curve is steep there. Dashed, no run went.",
            lambda: plots.static_curves(result, truth=truth),
        )
