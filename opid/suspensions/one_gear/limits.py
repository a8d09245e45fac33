"""What limits the precision of an answer, and what would better it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.suspensions.one_gear.model_fit import ModelFit

# a fault of the sensors that widens an interval by this much is named
WIDENING_NAMED = 1.2


def limits(fit: ModelFit, mass_changes_kg: Sequence[float], duration_s: float) -> Iterator[str]:
    """Yield what limits the mass and the law, one sentence each.

    Args:
        fit: of all runs.
        mass_changes_kg: of the runs, kg.
        duration_s: of all runs together, s.
    """
    if "inverse_mass" in fit.names and fit["inverse_mass"] > 0:
        place = fit.names.index("inverse_mass")
        mass, std = 1 / fit["inverse_mass"], float(fit.std[place]) / fit["inverse_mass"] ** 2
        share = (max(mass_changes_kg) - min(mass_changes_kg)) / mass
        yield (
            f"the mass is known to {196 * std / mass:.2g} %: the mass change, {100 * share:.0f} % of the mass, "
            f"multiplies what the sensors' noise does by {1 / share:.0f}; doubling it, or four times the "
            f"{duration_s:.0f} s of running, would halve the interval"
        )
        yield from _named(fit, place, "the mass")
    for i in range(fit.law.vector.size):
        sentences = list(_named(fit, fit.names.index(f"law[{i}]"), "the law"))
        if sentences:
            yield sentences[0]
            return


def _named(fit: ModelFit, place: int, what: str) -> Iterator[str]:
    """The fault of the sensors without which the interval would be narrower by most."""
    faults = [k for k, name in enumerate(fit.names) if name in {nuisance.name for nuisance in fit.sensors.nuisances}]
    own = fit.covariance[place, place]
    if not faults or own <= 0:
        return
    # the variance that is left once a fault is known: Schur complement
    left = [own - fit.covariance[place, k] ** 2 / max(fit.covariance[k, k], 1e-300) for k in faults]
    best = int(np.argmin(left))
    widening = float(np.sqrt(own / max(left[best], 1e-300)))
    if widening > WIDENING_NAMED:
        fault = fit.names[faults[best]]
        wording = {"gain": "gain", "corn": "AC-coupling corner", "lag_": "lag", "leak": "cross-axis leak"}[fault[:4]]
        side = (
            " of the unsprung sensor" if "unsprung" in fault else " of the sprung sensor" if "sprung" in fault else ""
        )
        times = f"{widening:.1f} times" if widening < 10 else "more than ten times"
        yield (
            f"{what} is limited by the {wording}{side}, which widens its interval {times}: calibrate it and state a "
            "smaller tolerance"
        )
