# The public names, one line a room.
from .errors import InputError, NotDeterminedError
from .estimate import Estimate
from .mechanics.airframe import Airframe, BendingMode, Gear, Loading, airframe_structure, loaded
from .mechanics.backbones import backbone, backbone_family
from .mechanics.bolted_structures import component_assembly, fixture_and_plate
from .mechanics.continuation import continued_backbone
from .mechanics.driven import Interface, driven_response, half_steps
from .mechanics.hysteresis import Sliders, iwan
from .mechanics.jointed_modes import JointedModes, jointed_modes
from .mechanics.kinds import Kind, Parameter
from .mechanics.landing_gear import LandingGear, taxi_run, taxi_test
from .mechanics.laws import LAWS, Law, default_law, law
from .mechanics.own_kinds import register_kind, unregister_kind
from .mechanics.prediction import Noise, predict
from .mechanics.response import time_response
from .mechanics.rig import Rig, impact, rig_run
from .mechanics.sensors import Sensor
from .mechanics.shaker import Shaker
from .mechanics.structure import Joint, Structure
from .mechanics.taxiing_aircraft import aircraft_run, aircraft_test
from .mechanics.virtual_aircraft import default_aircraft, random_aircraft, with_bending
from .mechanics.wheel_tracks import iso8608_tracks
from .modal.appropriation import appropriate_force, levels_for
from .modal.coordinates import ModalTest, modal_test
from .modal.excitation import (
    SineBeat,
    beat_between_neighbours,
    beat_over_drive_point_peak,
    shaped_sweep,
    sine_beat_voltage,
)
from .modal.free_decay import free_decay, law_of_decays
from .modal.frequency_response import cmif, measured_response, resynthesised
from .modal.identification import identify_modes
from .modal.interaction import modal_interaction
from .modal.level_shifts import level_shifts, nonlinear_modes
from .modal.mode_fit import fit_mode
from .modal.model import NonlinearModalModel, modal_response, simulate
from .modal.modes import LinearModes, condition_number, force_projection, modal_assurance, modal_filter
from .modal.modes_file import read_modes, write_modes
from .modal.power_law import power_law
from .modal.result import ModalIdentification, ModeFit
from .modal.study import ModalStudy, StudyTest
from .modal.study_file import read_modal_study, write_modal_study
from .modal.truth_test import truth_test
from .report import (
    bench_text,
    modal_text,
    result_text,
    updating_text,
    write_bench_report,
    write_modal_report,
    write_report,
    write_updating_report,
)
from .signals.exchange import (
    frame_of,
    recording_from_frame,
    recording_from_sep005,
    recording_from_xarray,
    sep005_of,
    xarray_of,
)
from .signals.health import inspect
from .signals.log_settings import ChannelSettings, LogSettings
from .signals.logs import open_log, read_log, write_log
from .signals.motion import integrate, relative_motion
from .signals.recording import Channel, Recording, recording_from_arrays
from .signals.resampling import on_common_clock, resampled
from .signals.segments import sound_segments, taxi_segment
from .signals.spectra import cross_spectra, transmissibility
from .suspensions.bench.law import BenchLaw, law_of_bench
from .suspensions.bench.record import Bench, bench_from_recording
from .suspensions.fit import Fit, fit_model
from .suspensions.flights.comparison import Comparison, compare
from .suspensions.flights.results import read_flights
from .suspensions.identification import identify
from .suspensions.law_search import search_laws
from .suspensions.own_structure import StructureIdentification, identify_structure
from .suspensions.paper.added_mass import absolute_parameters, match_peaks, two_peak_mass
from .suspensions.paper.chain import PaperChain, compute_chain
from .suspensions.paper.direct_parameters import complex_least_squares, errors_in_variables, mass_over_stiffness
from .suspensions.paper.joint_fit import JointFit
from .suspensions.paper.law_search import fit_law, search_law
from .suspensions.paper.nonlinearity import fit_slice, fit_surface
from .suspensions.paper.restoring_force import binned_surface, restoring_force, slice_curve
from .suspensions.paper.result import PaperIdentification
from .suspensions.paper.spectral_equation import equation_lines, fit_equation
from .suspensions.paper.transmissibility import (
    suspension_transmissibility,
    transmissibility_peaks,
    transmissibility_without_force,
)
from .suspensions.result import Identification
from .suspensions.run import driven_run
from .suspensions.sensor_facts import Leak, SensorFacts, SensorPair
from .suspensions.settings import Settings
from .suspensions.study import (
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
    study_of_gear,
)
from .suspensions.study_file import read_study, study_from_logs, write_study
from .updating.arviz_export import to_inference_data
from .updating.identification import update_study
from .updating.linear_updating import update_linear
from .updating.matrices_file import read_structure, write_structure
from .updating.measured import MeasuredBackbone
from .updating.model_class import ModelClass, Prior
from .updating.reduction import craig_bampton, reduce
from .updating.result import Updating
from .updating.structure import AffineStructure
from .updating.study import UpdatingStudy
from .updating.study_file import read_updating_study, write_updating_study
from .updating.surrogate import wing_engine_structure
from .updating.virtual_backbones import synthetic_backbones, virtual_backbones

__version__: str
__all__: list[str]
