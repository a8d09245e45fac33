# The public names, one line a room.
from .errors import InputError, NotDeterminedError
from .estimate import Estimate
from .mechanics.backbones.continuation import continued_backbone
from .mechanics.backbones.family import backbone, backbone_family
from .mechanics.backbones.jointed_modes import JointedModes, jointed_modes
from .mechanics.driven import Interface, driven_response, half_steps
from .mechanics.hysteresis import Sliders, iwan
from .mechanics.laws.kinds import Kind, Parameter
from .mechanics.laws.law import LAWS, Law, default_law, law
from .mechanics.laws.own_kinds import register_kind, unregister_kind
from .mechanics.prediction import Noise, predict
from .mechanics.response import time_response
from .mechanics.rig import Rig, impact, rig_run
from .mechanics.shaker import Shaker
from .mechanics.structure import Joint, Structure
from .modal.decay.free_decay import free_decay, law_of_decays
from .modal.forced.excitation import (
    SineBeat,
    beat_between_neighbours,
    beat_over_drive_point_peak,
    shaped_sweep,
    sine_beat_voltage,
)
from .modal.forced.mode_fit import fit_mode
from .modal.identification import identify_modes
from .modal.linear.coordinates import ModalTest, modal_test
from .modal.linear.frequency_response import cmif, measured_response, resynthesised
from .modal.linear.level_shifts import level_shifts, nonlinear_modes
from .modal.linear.modes import LinearModes, condition_number, force_projection, modal_assurance, modal_filter
from .modal.linear.modes_file import read_modes, write_modes
from .modal.model import NonlinearModalModel, modal_response, simulate
from .modal.power_law import power_law
from .modal.resonance.appropriation import appropriate_force, levels_for
from .modal.resonance.interaction import modal_interaction
from .modal.result import ModalIdentification, ModeFit
from .modal.study import ModalStudy, StudyTest
from .modal.truth_test import truth_test
from .report import text, write_report
from .signals.exchange import (
    frame_of,
    recording_from_frame,
    recording_from_sep005,
    recording_from_xarray,
    sep005_of,
    xarray_of,
)
from .signals.health.inspection import inspect
from .signals.log_settings import ChannelSettings, LogSettings
from .signals.logs import open_log, read_log, write_log
from .signals.motion import integrate, relative_motion
from .signals.recording import Channel, Recording, recording_from_arrays
from .signals.resampling import on_common_clock, resampled
from .signals.segments import sound_segments, taxi_segment
from .signals.spectra import cross_spectra, transmissibility
from .studies.study_file import read_study, write_study
from .studies.suspension_study import study_from_logs
from .suspensions.bench.law import BenchLaw, law_of_bench
from .suspensions.bench.record import Bench, bench_from_recording
from .suspensions.fitting.fit import Fit, fit_model
from .suspensions.flights.comparison import Comparison, compare
from .suspensions.flights.results import read_flights
from .suspensions.identification import identify
from .suspensions.law_search.pursuit import search_laws
from .suspensions.model.run import driven_run
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
from .updating.data.measured import MeasuredBackbone
from .updating.identification import update_study
from .updating.linear_updating import update_linear
from .updating.model_class import ModelClass, Prior
from .updating.result import Updating
from .updating.sampling.arviz_export import to_inference_data
from .updating.structure.affine import AffineStructure
from .updating.structure.matrices_file import read_structure, write_structure
from .updating.structure.reduction import craig_bampton, reduce
from .updating.study import UpdatingStudy
from .virtual.backbone_tests.measured import synthetic_backbones, virtual_backbones
from .virtual.backbone_tests.structure import wing_engine_structure
from .virtual.modal_tests.bolted_structures import component_assembly, fixture_and_plate
from .virtual.taxi_tests.aircraft import default_aircraft, random_aircraft, with_bending
from .virtual.taxi_tests.airframe import Airframe, BendingMode, Gear, Loading, airframe_structure, loaded
from .virtual.taxi_tests.landing_gear import LandingGear, taxi_run, taxi_test
from .virtual.taxi_tests.sensors import Sensor
from .virtual.taxi_tests.taxiing_aircraft import aircraft_run, aircraft_test
from .virtual.taxi_tests.wheel_tracks import iso8608_tracks

__version__: str
__all__: list[str]
