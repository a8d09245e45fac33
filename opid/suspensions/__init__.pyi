# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .bench.law import (
    BenchLaw as BenchLaw,
    law_of_bench as law_of_bench,
)
from .bench.record import (
    Bench as Bench,
    BenchStudy as BenchStudy,
    bench_from_recording as bench_from_recording,
    quasi_static_bench as quasi_static_bench,
)
from .bench.settings import BenchSettings as BenchSettings
from .bench.simulation import MovingPart as MovingPart
from .fitting.fit import (
    Fit as Fit,
    fit_model as fit_model,
)
from .flights.campaign import (
    Campaign as Campaign,
    Outcome as Outcome,
    Verdict as Verdict,
)
from .flights.comparison import (
    Comparison as Comparison,
    compare as compare,
)
from .flights.dataset import (
    FleetDataset as FleetDataset,
    FleetTable as FleetTable,
    read_dataset as read_dataset,
)
from .flights.departures import FlightSettings as FlightSettings
from .flights.fleet import (
    Fleet as Fleet,
    FleetSeries as FleetSeries,
    Strut as Strut,
    StrutChange as StrutChange,
    StrutFlight as StrutFlight,
)
from .flights.fleet_comparison import compare_fleet as compare_fleet
from .flights.fleet_model import FleetSettings as FleetSettings
from .flights.results import (
    Flights as Flights,
    read_flights as read_flights,
)
from .identification import identify as identify
from .law_search.pursuit import search_laws as search_laws
from .model.run import driven_run as driven_run
from .own_structure import (
    StructureIdentification as StructureIdentification,
    identify_structure as identify_structure,
)
from .paper.added_mass import (
    absolute_parameters as absolute_parameters,
    match_peaks as match_peaks,
    two_peak_mass as two_peak_mass,
)
from .paper.chain import (
    PaperChain as PaperChain,
    compute_chain as compute_chain,
)
from .paper.identification import (
    fit_law as fit_law,
    identify_by_paper as identify_by_paper,
    search_law as search_law,
)
from .paper.printed import (
    PrintedRun as PrintedRun,
    run_as_printed as run_as_printed,
)
from .paper.restoring_force import (
    binned_surface as binned_surface,
    fit_slice as fit_slice,
    fit_surface as fit_surface,
    restoring_force as restoring_force,
    slice_curve as slice_curve,
)
from .paper.result import PaperIdentification as PaperIdentification
from .paper.settings import (
    PaperSettings as PaperSettings,
    PrintedSettings as PrintedSettings,
)
from .paper.spectral_equation import (
    JointFit as JointFit,
    equation_lines as equation_lines,
    fit_equation as fit_equation,
)
from .paper.transmissibility import (
    Peak as Peak,
    complex_least_squares as complex_least_squares,
    errors_in_variables as errors_in_variables,
    estimate_transmissibility as estimate_transmissibility,
    mass_over_stiffness as mass_over_stiffness,
    suspension_transmissibility as suspension_transmissibility,
    transmissibility_peaks as transmissibility_peaks,
    transmissibility_without_force as transmissibility_without_force,
)
from .planning.result import (
    Costs as Costs,
    PlannedRun as PlannedRun,
    PlanResult as PlanResult,
)
from .planning.search import (
    PlanSettings as PlanSettings,
    SearchSpace as SearchSpace,
    plan_runs as plan_runs,
)
from .result import Identification as Identification
from .sensing.result import (
    Sensing as Sensing,
    VirtualSensor as VirtualSensor,
)
from .sensing.settings import SensingSettings as SensingSettings
from .sensing.virtual_sensors import sense as sense
from .sensor_facts import (
    Leak as Leak,
    SensorFacts as SensorFacts,
    SensorPair as SensorPair,
    TravelSensor as TravelSensor,
)
from .settings import (
    FaultSettings as FaultSettings,
    FitSettings as FitSettings,
    GasSettings as GasSettings,
    IntervalSettings as IntervalSettings,
    OriginSettings as OriginSettings,
    ProcessSettings as ProcessSettings,
    RegressionSettings as RegressionSettings,
    RepeatabilitySettings as RepeatabilitySettings,
    RunSettings as RunSettings,
    SearchSettings as SearchSettings,
    Settings as Settings,
    StartSettings as StartSettings,
    SurfaceSettings as SurfaceSettings,
    Verdicts as Verdicts,
    WarningSettings as WarningSettings,
    WeighingSettings as WeighingSettings,
)
from .study import (
    BodySensor as BodySensor,
    MeasuredInterface as MeasuredInterface,
    PointMass as PointMass,
    Run as Run,
    StructureSettings as StructureSettings,
    Study as Study,
    study_of_gear as study_of_gear,
)
from .weighing import WeighedMass as WeighedMass
from .wheel.identification import identify_wheel as identify_wheel
from .wheel.result import (
    WheelIdentification as WheelIdentification,
    WheelSettings as WheelSettings,
)
