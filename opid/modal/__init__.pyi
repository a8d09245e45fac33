# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .couplings import (
    Coupling as Coupling,
    Product as Product,
    expand_joint as expand_joint,
    list_products as list_products,
)
from .decay.free_decay import (
    Decay as Decay,
    decay_of as decay_of,
    free_decay as free_decay,
    law_of_decays as law_of_decays,
)
from .forced.equation import mode_lines as mode_lines
from .forced.excitation import (
    SineBeat as SineBeat,
    beat_between_neighbours as beat_between_neighbours,
    beat_over_drive_point_peak as beat_over_drive_point_peak,
    quiet_s as quiet_s,
    shaped_sweep as shaped_sweep,
    sine_beat_voltage as sine_beat_voltage,
)
from .forced.mode_fit import (
    ModeFit as ModeFit,
    fit_mode as fit_mode,
)
from .forced.restoring_fit import (
    Coefficients as Coefficients,
    fit_coefficients as fit_coefficients,
    fit_unweighted as fit_unweighted,
    linearised as linearised,
)
from .forced.system_fit import (
    SystemFit as SystemFit,
    fit_system as fit_system,
)
from .identification import identify_modes as identify_modes
from .joint_terms import (
    JointTerms as JointTerms,
    ModalJoint as ModalJoint,
)
from .linear.frequency_response import (
    cmif as cmif,
    measured_response as measured_response,
    resynthesised as resynthesised,
)
from .linear.level_shifts import (
    level_shifts as level_shifts,
    nonlinear_modes as nonlinear_modes,
)
from .linear.modes import (
    LinearModes as LinearModes,
    ModalTest as ModalTest,
    condition_number as condition_number,
    force_projection as force_projection,
    modal_filter as modal_filter,
    modal_test as modal_test,
    with_sensors as with_sensors,
)
from .linear.modes_file import (
    read_modes as read_modes,
    write_modes as write_modes,
)
from .linear.stages import (
    ModeStages as ModeStages,
    compare_stages as compare_stages,
)
from .model import (
    NonlinearModalModel as NonlinearModalModel,
    modal_response as modal_response,
    simulate as simulate,
    truth_test as truth_test,
)
from .power_laws import (
    hold_unstable as hold_unstable,
    power_law as power_law,
)
from .resonance.appropriation import (
    Appropriation as Appropriation,
    appropriate_force as appropriate_force,
    levels_for as levels_for,
    modal_interaction as modal_interaction,
)
from .resonance.curve_file import (
    read_curve as read_curve,
    write_curve as write_curve,
)
from .resonance.curve_fit import (
    fit_curves as fit_curves,
    make_curve as make_curve,
)
from .resonance.curves import (
    ResponseCurve as ResponseCurve,
    read_curve_states as read_curve_states,
)
from .resonance.identification import (
    identify_resonance as identify_resonance,
    identify_resonances as identify_resonances,
)
from .resonance.law import fit_states as fit_states
from .resonance.result import (
    Resonance as Resonance,
    Resonances as Resonances,
)
from .result import ModalIdentification as ModalIdentification
from .study import (
    ModalStudy as ModalStudy,
    StudyTest as StudyTest,
)
