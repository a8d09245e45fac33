# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from . import (
    mechanics as mechanics,
    modal as modal,
    plots as plots,
    report as report,
    signals as signals,
    studies as studies,
    suspensions as suspensions,
    updating as updating,
    virtual as virtual,
)
from .errors import (
    InputError as InputError,
    NotDeterminedError as NotDeterminedError,
)
from .estimate import Estimate as Estimate
from .mechanics.backbones.continuation import continued_backbone as continued_backbone
from .mechanics.backbones.family import (
    backbone as backbone,
    backbone_family as backbone_family,
)
from .mechanics.backbones.jointed_modes import (
    JointedModes as JointedModes,
    jointed_modes as jointed_modes,
)
from .mechanics.driven import (
    Interface as Interface,
    driven_response as driven_response,
    half_steps as half_steps,
)
from .mechanics.hysteresis import (
    Sliders as Sliders,
    iwan as iwan,
)
from .mechanics.laws.kinds import (
    Kind as Kind,
    Parameter as Parameter,
)
from .mechanics.laws.law import (
    LAWS as LAWS,
    Law as Law,
    default_law as default_law,
    law as law,
)
from .mechanics.laws.own_kinds import (
    register_kind as register_kind,
    unregister_kind as unregister_kind,
)
from .mechanics.prediction import (
    Noise as Noise,
    predict as predict,
)
from .mechanics.response import time_response as time_response
from .mechanics.rig import (
    Rig as Rig,
    impact as impact,
    rig_run as rig_run,
)
from .mechanics.shaker import Shaker as Shaker
from .mechanics.structure import (
    Joint as Joint,
    Structure as Structure,
)
from .modal.decay.free_decay import (
    free_decay as free_decay,
    law_of_decays as law_of_decays,
)
from .modal.forced.excitation import (
    SineBeat as SineBeat,
    beat_between_neighbours as beat_between_neighbours,
    beat_over_drive_point_peak as beat_over_drive_point_peak,
    shaped_sweep as shaped_sweep,
    sine_beat_voltage as sine_beat_voltage,
)
from .modal.forced.mode_fit import fit_mode as fit_mode
from .modal.identification import identify_modes as identify_modes
from .modal.linear.coordinates import (
    ModalTest as ModalTest,
    modal_test as modal_test,
)
from .modal.linear.frequency_response import (
    cmif as cmif,
    measured_response as measured_response,
    resynthesised as resynthesised,
)
from .modal.linear.level_shifts import (
    level_shifts as level_shifts,
    nonlinear_modes as nonlinear_modes,
)
from .modal.linear.modes import (
    LinearModes as LinearModes,
    condition_number as condition_number,
    force_projection as force_projection,
    modal_assurance as modal_assurance,
    modal_filter as modal_filter,
)
from .modal.linear.modes_file import (
    read_modes as read_modes,
    write_modes as write_modes,
)
from .modal.model import (
    NonlinearModalModel as NonlinearModalModel,
    modal_response as modal_response,
    simulate as simulate,
)
from .modal.power_law import power_law as power_law
from .modal.resonance.appropriation import (
    appropriate_force as appropriate_force,
    levels_for as levels_for,
)
from .modal.resonance.interaction import modal_interaction as modal_interaction
from .modal.result import (
    ModalIdentification as ModalIdentification,
    ModeFit as ModeFit,
)
from .modal.study import (
    ModalStudy as ModalStudy,
    StudyTest as StudyTest,
)
from .modal.truth_test import truth_test as truth_test
from .report import (
    text as text,
    write_report as write_report,
)
from .signals.exchange import (
    frame_of as frame_of,
    recording_from_frame as recording_from_frame,
    recording_from_sep005 as recording_from_sep005,
    recording_from_xarray as recording_from_xarray,
    sep005_of as sep005_of,
    xarray_of as xarray_of,
)
from .signals.health.inspection import inspect as inspect
from .signals.log_settings import (
    ChannelSettings as ChannelSettings,
    LogSettings as LogSettings,
)
from .signals.logs import (
    open_log as open_log,
    read_log as read_log,
    write_log as write_log,
)
from .signals.motion import (
    integrate as integrate,
    relative_motion as relative_motion,
)
from .signals.recording import (
    Channel as Channel,
    Recording as Recording,
    recording_from_arrays as recording_from_arrays,
)
from .signals.resampling import (
    on_common_clock as on_common_clock,
    resampled as resampled,
)
from .signals.segments import (
    sound_segments as sound_segments,
    taxi_segment as taxi_segment,
)
from .signals.spectra import (
    cross_spectra as cross_spectra,
    transmissibility as transmissibility,
)
from .studies.study_file import (
    read_study as read_study,
    write_study as write_study,
)
from .studies.suspension_study import study_from_logs as study_from_logs
from .suspensions.bench.law import (
    BenchLaw as BenchLaw,
    law_of_bench as law_of_bench,
)
from .suspensions.bench.record import (
    Bench as Bench,
    bench_from_recording as bench_from_recording,
)
from .suspensions.bench.study import BenchStudy as BenchStudy
from .suspensions.fitting.fit import (
    Fit as Fit,
    fit_model as fit_model,
)
from .suspensions.flights.comparison import (
    Comparison as Comparison,
    compare as compare,
)
from .suspensions.flights.results import read_flights as read_flights
from .suspensions.identification import identify as identify
from .suspensions.law_search.pursuit import search_laws as search_laws
from .suspensions.model.run import driven_run as driven_run
from .suspensions.own_structure import (
    StructureIdentification as StructureIdentification,
    identify_structure as identify_structure,
)
from .suspensions.paper.added_mass import (
    absolute_parameters as absolute_parameters,
    match_peaks as match_peaks,
    two_peak_mass as two_peak_mass,
)
from .suspensions.paper.chain import (
    PaperChain as PaperChain,
    compute_chain as compute_chain,
)
from .suspensions.paper.direct_parameters import (
    complex_least_squares as complex_least_squares,
    errors_in_variables as errors_in_variables,
    mass_over_stiffness as mass_over_stiffness,
)
from .suspensions.paper.joint_fit import JointFit as JointFit
from .suspensions.paper.law_search import (
    fit_law as fit_law,
    search_law as search_law,
)
from .suspensions.paper.nonlinearity import (
    fit_slice as fit_slice,
    fit_surface as fit_surface,
)
from .suspensions.paper.restoring_force import (
    binned_surface as binned_surface,
    restoring_force as restoring_force,
    slice_curve as slice_curve,
)
from .suspensions.paper.result import PaperIdentification as PaperIdentification
from .suspensions.paper.spectral_equation import (
    equation_lines as equation_lines,
    fit_equation as fit_equation,
)
from .suspensions.paper.transmissibility import (
    suspension_transmissibility as suspension_transmissibility,
    transmissibility_peaks as transmissibility_peaks,
    transmissibility_without_force as transmissibility_without_force,
)
from .suspensions.result import Identification as Identification
from .suspensions.sensor_facts import (
    Leak as Leak,
    SensorFacts as SensorFacts,
    SensorPair as SensorPair,
)
from .suspensions.settings import Settings as Settings
from .suspensions.study import (
    BodySensor as BodySensor,
    MeasuredInterface as MeasuredInterface,
    PointMass as PointMass,
    Run as Run,
    StructureSettings as StructureSettings,
    Study as Study,
    study_of_gear as study_of_gear,
)
from .updating.data.measured import MeasuredBackbone as MeasuredBackbone
from .updating.identification import update_study as update_study
from .updating.linear_updating import update_linear as update_linear
from .updating.model_class import (
    ModelClass as ModelClass,
    Prior as Prior,
)
from .updating.result import Updating as Updating
from .updating.sampling.arviz_export import to_inference_data as to_inference_data
from .updating.structure.affine import AffineStructure as AffineStructure
from .updating.structure.matrices_file import (
    read_structure as read_structure,
    write_structure as write_structure,
)
from .updating.structure.reduction import (
    craig_bampton as craig_bampton,
    reduce as reduce,
)
from .updating.study import UpdatingStudy as UpdatingStudy
from .virtual.backbone_tests.measured import (
    synthetic_backbones as synthetic_backbones,
    virtual_backbones as virtual_backbones,
)
from .virtual.backbone_tests.structure import wing_engine_structure as wing_engine_structure
from .virtual.modal_tests.bolted_structures import (
    component_assembly as component_assembly,
    fixture_and_plate as fixture_and_plate,
)
from .virtual.taxi_tests.aircraft import (
    default_aircraft as default_aircraft,
    random_aircraft as random_aircraft,
    with_bending as with_bending,
)
from .virtual.taxi_tests.airframe import (
    Airframe as Airframe,
    BendingMode as BendingMode,
    Gear as Gear,
    Loading as Loading,
    airframe_structure as airframe_structure,
    loaded as loaded,
)
from .virtual.taxi_tests.landing_gear import (
    LandingGear as LandingGear,
    taxi_run as taxi_run,
    taxi_test as taxi_test,
)
from .virtual.taxi_tests.sensors import Sensor as Sensor
from .virtual.taxi_tests.taxiing_aircraft import (
    aircraft_run as aircraft_run,
    aircraft_test as aircraft_test,
)
from .virtual.taxi_tests.wheel_tracks import iso8608_tracks as iso8608_tracks

__version__: str
