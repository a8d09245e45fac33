"""What the answer of the driven model rests on beside its fit: whiteness, demands, limits, checks of the intervals."""

from __future__ import annotations

from dataclasses import dataclass

from opid.signals.recording import FloatArray
from opid.suspensions.one_gear.demands import Demand
from opid.suspensions.one_gear.force_surface import ForceSurface
from opid.suspensions.one_gear.imitations import GroundImitations
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.one_gear.whiteness import Whiteness


@dataclass(frozen=True, eq=False)
class ModelEvidence:
    """What was found out about a fitted model.

    Args:
        fit: the fit as it came, its covariance that of a white residual.
        surface: force on the predicted motion beside the law, cell by cell.
        whiteness: of its residual.
        coloured_std: (n_parameters,) standard deviations that allow for a coloured residual.
        bootstrap_std: (n_parameters,) the same by resampled blocks of time.
        demands: what had to be let in beside the suspension.
        ground: how well a spring to the ground is told from nothing and from faults of the sensors.
        mended_spikes: single samples that were mended, of the spindle's and the airframe's channel of all runs.
        n_starts: from how many starts the first law was fitted.
        limits: what limits the precision of the mass and of the law, one sentence each.
    """

    fit: ModelFit
    surface: ForceSurface
    whiteness: Whiteness
    coloured_std: FloatArray
    bootstrap_std: FloatArray
    demands: tuple[Demand, ...]
    ground: GroundImitations
    mended_spikes: tuple[int, int]
    n_starts: int
    limits: tuple[str, ...]
