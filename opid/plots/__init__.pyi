# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .answer import estimates as estimates
from .bench import (
    bench_curves as bench_curves,
    bench_ladder as bench_ladder,
    bench_residual as bench_residual,
    force_against_motion as force_against_motion,
)
from .body import (
    body_residuals as body_residuals,
    left_out_spectra as left_out_spectra,
    plan_view as plan_view,
    predicted_accelerations as predicted_accelerations,
    structure_candidates as structure_candidates,
    suspension_forces as suspension_forces,
    suspension_parameters as suspension_parameters,
)
from .comparison import compared_quantity as compared_quantity
from .fleet import (
    draw_fleet_map as draw_fleet_map,
    draw_flight_laws as draw_flight_laws,
    draw_strut as draw_strut,
)
from .force import (
    law_curves as law_curves,
    restoring_force_map as restoring_force_map,
    restoring_force_surface as restoring_force_surface,
    slices as slices,
    static_curves as static_curves,
)
from .health import (
    health_picture as health_picture,
    orientation_picture as orientation_picture,
)
from .laws import (
    force_departures as force_departures,
    force_sections as force_sections,
    law_ladder as law_ladder,
    model_ladder as model_ladder,
)
from .modes import (
    auto_mac as auto_mac,
    drive_point_response as drive_point_response,
    level_shift_figures as level_shift_figures,
    mode_indicators as mode_indicators,
    stage_responses as stage_responses,
)
from .nonlinear_modes import (
    backbone as backbone,
    free_decay_figure as free_decay_figure,
    harmonic_shape as harmonic_shape,
    held_out_curve as held_out_curve,
    law_trials as law_trials,
    modal_harmonics as modal_harmonics,
    modal_orders as modal_orders,
    mode_restoring_force as mode_restoring_force,
    response_curves as response_curves,
    sensor_harmonics as sensor_harmonics,
    sine_beats as sine_beats,
    truth_test as truth_test,
    truth_test_figures as truth_test_figures,
)
from .plan import expected_std as expected_std
from .runs import (
    accelerations as accelerations,
    clock_lags as clock_lags,
    equation_residual as equation_residual,
    integration as integration,
    printed_transmissibilities as printed_transmissibilities,
    recording as recording,
    transmissibilities as transmissibilities,
)
from .sensing import (
    force_spectra as force_spectra,
    rainflow_cycles as rainflow_cycles,
    sensed_histories as sensed_histories,
)
from .style import (
    figure_of as figure_of,
    house_style as house_style,
    png as png,
)
from .updating import (
    ForceBand as ForceBand,
    effective_damping as effective_damping,
    forced_responses as forced_responses,
    higher_harmonics as higher_harmonics,
    joint_forces as joint_forces,
    linear_updating as linear_updating,
    log_evidences as log_evidences,
    measured_backbones as measured_backbones,
    mode_shape as mode_shape,
    parameter_samples as parameter_samples,
    predicted_backbones as predicted_backbones,
    predicted_motions as predicted_motions,
    reduction_figure as reduction_figure,
    running_moments as running_moments,
)
