"""Results -> Axes: one function a figure, each takes a result (and Axes, if you have some) and computes nothing.

The only room with matplotlib. Without Axes a function draws on a figure of its own, which no backend holds:
`opid.plots.figure_of(axes).savefig("slices.png")`.
"""

from opid.plots.answer import estimates, law_ladder
from opid.plots.bench import bench_curves, bench_ladder, bench_residual, force_against_motion
from opid.plots.body import plan_view, structure_candidates, suspension_parameters
from opid.plots.body_motion import body_residuals, predicted_accelerations, suspension_forces
from opid.plots.comparison import compared_quantity
from opid.plots.force import law_curves, restoring_force_map, restoring_force_surface, slices
from opid.plots.health import health_picture
from opid.plots.laws import force_departures, force_sections, model_ladder
from opid.plots.modal.appropriation import (
    backbone,
    drive_point_response,
    harmonic_shape,
    modal_harmonics,
    sensor_harmonics,
)
from opid.plots.modal.decays import free_decay_figure
from opid.plots.modal.fits import modal_orders, mode_restoring_force, sine_beats
from opid.plots.modal.shapes import auto_mac, level_shift_figures, mode_indicators
from opid.plots.modal.truth import truth_test, truth_test_figures
from opid.plots.runs import accelerations, integration, recording
from opid.plots.spectra import equation_residual, transmissibilities
from opid.plots.style import figure_of, house_style, png
from opid.plots.updating.backbones import measured_backbones, predicted_backbones
from opid.plots.updating.classes import ForceBand, joint_forces, log_evidences
from opid.plots.updating.linear import linear_updating, reduction_figure
from opid.plots.updating.posteriors import parameter_samples, running_moments

__all__ = [
    "ForceBand",
    "accelerations",
    "auto_mac",
    "backbone",
    "bench_curves",
    "bench_ladder",
    "bench_residual",
    "body_residuals",
    "compared_quantity",
    "drive_point_response",
    "equation_residual",
    "estimates",
    "figure_of",
    "force_against_motion",
    "force_departures",
    "force_sections",
    "free_decay_figure",
    "harmonic_shape",
    "health_picture",
    "house_style",
    "integration",
    "joint_forces",
    "law_curves",
    "law_ladder",
    "level_shift_figures",
    "linear_updating",
    "log_evidences",
    "measured_backbones",
    "modal_harmonics",
    "modal_orders",
    "mode_indicators",
    "mode_restoring_force",
    "model_ladder",
    "parameter_samples",
    "plan_view",
    "png",
    "predicted_accelerations",
    "predicted_backbones",
    "recording",
    "reduction_figure",
    "restoring_force_map",
    "restoring_force_surface",
    "running_moments",
    "sensor_harmonics",
    "sine_beats",
    "slices",
    "structure_candidates",
    "suspension_forces",
    "suspension_parameters",
    "transmissibilities",
    "truth_test",
    "truth_test_figures",
]
