"""Results -> Axes: one function a figure, each takes a result (and Axes, if you have some) and computes nothing.

The only room with matplotlib. Without Axes a function draws on a figure of its own, which no backend holds:
`opid.plots.figure_of(axes).savefig("slices.png")`.
"""

from opid.plots.answer import estimates, law_ladder
from opid.plots.bench import bench_curves, bench_ladder, bench_residual, force_against_motion
from opid.plots.force import law_curves, restoring_force_map, restoring_force_surface, slices
from opid.plots.health import health_picture
from opid.plots.laws import force_departures, force_sections, model_ladder
from opid.plots.runs import accelerations, integration, recording
from opid.plots.spectra import equation_residual, transmissibilities
from opid.plots.style import figure_of, house_style, png

__all__ = [
    "accelerations",
    "bench_curves",
    "bench_ladder",
    "bench_residual",
    "equation_residual",
    "estimates",
    "figure_of",
    "force_against_motion",
    "force_departures",
    "force_sections",
    "health_picture",
    "house_style",
    "integration",
    "law_curves",
    "law_ladder",
    "model_ladder",
    "png",
    "recording",
    "restoring_force_map",
    "restoring_force_surface",
    "slices",
    "transmissibilities",
]
