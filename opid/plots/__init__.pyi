# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .answer import (
    estimates as estimates,
    law_ladder as law_ladder,
)
from .bench import (
    bench_curves as bench_curves,
    bench_ladder as bench_ladder,
    bench_residual as bench_residual,
    force_against_motion as force_against_motion,
)
from .body import (
    plan_view as plan_view,
    structure_candidates as structure_candidates,
    suspension_parameters as suspension_parameters,
)
from .body_motion import (
    body_residuals as body_residuals,
    predicted_accelerations as predicted_accelerations,
    suspension_forces as suspension_forces,
)
from .comparison import compared_quantity as compared_quantity
from .force import (
    law_curves as law_curves,
    restoring_force_map as restoring_force_map,
    restoring_force_surface as restoring_force_surface,
    slices as slices,
)
from .health import health_picture as health_picture
from .laws import (
    force_departures as force_departures,
    force_sections as force_sections,
    model_ladder as model_ladder,
)
from .modal.appropriation import (
    backbone as backbone,
    drive_point_response as drive_point_response,
    harmonic_shape as harmonic_shape,
    modal_harmonics as modal_harmonics,
    sensor_harmonics as sensor_harmonics,
)
from .modal.decays import free_decay_figure as free_decay_figure
from .modal.fits import (
    modal_orders as modal_orders,
    mode_restoring_force as mode_restoring_force,
    sine_beats as sine_beats,
)
from .modal.shapes import (
    auto_mac as auto_mac,
    level_shift_figures as level_shift_figures,
    mode_indicators as mode_indicators,
)
from .modal.truth import (
    truth_test as truth_test,
    truth_test_figures as truth_test_figures,
)
from .runs import (
    accelerations as accelerations,
    integration as integration,
    recording as recording,
)
from .spectra import (
    equation_residual as equation_residual,
    transmissibilities as transmissibilities,
)
from .style import (
    figure_of as figure_of,
    house_style as house_style,
    png as png,
)
from .updating.backbones import (
    measured_backbones as measured_backbones,
    predicted_backbones as predicted_backbones,
)
from .updating.classes import (
    ForceBand as ForceBand,
    joint_forces as joint_forces,
    log_evidences as log_evidences,
)
from .updating.linear import (
    linear_updating as linear_updating,
    reduction_figure as reduction_figure,
)
from .updating.posteriors import (
    parameter_samples as parameter_samples,
    running_moments as running_moments,
)
