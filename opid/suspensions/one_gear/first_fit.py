"""The first fit of the driven model: from the classical equation's values, and from afar where they mislead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import Law
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import FROM_AFAR, FROM_FARTHER, ModelFit, fit_model
from opid.suspensions.one_gear.refit import refit
from opid.suspensions.paper.classical import Start
from opid.suspensions.paper.joint_fit import JointFit
from opid.suspensions.paper.law_search import thinned
from opid.suspensions.paper.nonlinearity import fit_surface

# a fit starts with a ground spring where the classical chain finds one above this share of K2 and this many standard
# deviations
GROUND_SHARE, GROUND_STD = 0.03, 5.0
# a fit that leaves more than this over the noise of the sensors is tried from other starts
DOUBTFUL = 1.5


def first_fit(
    start: Start, runs: Sequence[DrivenRun], *, ground: bool = True, searched: bool = True
) -> tuple[ModelFit, int]:
    """Fit the law of the classical equation from its values; where that is doubtful, from others too.

    Args:
        start: of `classical_start`.
        runs: the same runs, as the model takes them.
        ground: whether a ground spring may be free, which it is if the equation demands one.
        searched: whether another law will be searched from here; a given one must be in the fit.

    Returns:
        The best fit, and from how many starts it was tried.

    Raises:
        UnboundedResponseError: none of the starts makes a suspension that stays bounded.
    """
    facts = (start.study.sensors.unsprung, start.study.sensors.sprung)
    noise = (facts[0].noise_m_per_s2 or start.noise_floor, facts[1].noise_m_per_s2 or start.noise_floor)
    motion_rms = (
        max(float(surface.travel.std()) for surface in start.surfaces),
        max(float(surface.velocity.std()) for surface in start.surfaces),
    )
    linear = next((step.fit for step in start.ladder if step.law_name == "linear"), start.joint)

    def fitted(law: Law, near: JointFit, noisier: tuple[float, ...]) -> ModelFit | None:
        spring = ground and demands_ground(linear)
        try:
            return fit_model(
                runs,
                law,
                stiffness_per_mass=near["stiffness_per_mass"],
                damping_per_mass=near["damping_per_mass"],
                ground_stiffness_per_mass=near["ground_stiffness_per_mass"] if spring else None,
                inverse_mass=near["inverse_mass"] if "inverse_mass" in near.names else None,
                noise_m_per_s2=noise,
                motion_rms=motion_rms,
                noisier=noisier,
            )
        except UnboundedResponseError:
            return None

    law = start.joint.law

    def rough() -> Law:
        return fit_surface(thinned(start.surfaces[0]), law.name).law

    ways: tuple[tuple[Callable[[], Law], JointFit, tuple[float, ...]], ...] = (
        (lambda: law, start.joint, ()),
        (lambda: law, start.joint, FROM_AFAR),
        (lambda: law, start.joint, FROM_FARTHER),
        (rough, linear, FROM_AFAR),
        (Law, linear, FROM_AFAR),
    )
    best: ModelFit | None = None
    n_starts = 0
    while n_starts < len(ways) and (best is None or best.noise_m_per_s2 > DOUBTFUL * best.level):
        first_law, near, noisier = ways[n_starts]
        fit = fitted(first_law(), near, noisier)
        best = fit if best is None or (fit is not None and fit.bic < best.bic) else best
        n_starts += 1
    if best is None:
        raise UnboundedResponseError(
            "the suspension that the classical chain finds grows without bound when the measured spindle drives it: "
            "check that the channels are those of one gear and not swapped, or use --method classical"
        )
    if best.law.name != law.name:
        # a given law must be in the answer, and a search finds its way from the linear one
        with suppress(UnboundedResponseError) if searched else nullcontext():
            best = refit(runs, best, rough())
    return best, n_starts


def demands_ground(fit: JointFit) -> bool:
    """Return whether the classical equation asks for a ground spring that a sensor's fault would hardly feign.

    Args:
        fit: of the equation, with a free ground spring or without.
    """
    name = "ground_stiffness_per_mass"
    if name not in fit.names:
        return False
    value, std = fit[name], float(fit.std[fit.names.index(name)])
    return abs(value) > GROUND_STD * std and abs(value) > GROUND_SHARE * abs(fit["stiffness_per_mass"])
