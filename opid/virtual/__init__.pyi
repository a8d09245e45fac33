# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .backbone_tests.control_based_continuation import measured_curve as measured_curve
from .backbone_tests.measured import (
    synthetic_backbones as synthetic_backbones,
    virtual_backbones as virtual_backbones,
)
from .backbone_tests.shaker_feedback import ReadingNoise as ReadingNoise
from .backbone_tests.wing_engine import (
    UPDATED as UPDATED,
    WingEngine as WingEngine,
    wing_engine_structure as wing_engine_structure,
)
from .modal_tests.bolted_structures import (
    case_study_1 as case_study_1,
    case_study_2 as case_study_2,
    component_assembly as component_assembly,
    fixture_and_plate as fixture_and_plate,
    level_dependence as level_dependence,
)
from .modal_tests.series import (
    CUBIC_DAMPING as CUBIC_DAMPING,
    CUBIC_STIFFNESS as CUBIC_STIFFNESS,
    virtual_series as virtual_series,
    virtual_study as virtual_study,
)
from .taxi_tests.aircraft import (
    default_aircraft as default_aircraft,
    random_aircraft as random_aircraft,
    with_bending as with_bending,
)
from .taxi_tests.airframe import (
    Airframe as Airframe,
    BendingMode as BendingMode,
    Gear as Gear,
    LandingGear as LandingGear,
    airframe_structure as airframe_structure,
    loaded as loaded,
    place_directions as place_directions,
)
from .taxi_tests.road import (
    SpeedProfile as SpeedProfile,
    iso8608_road as iso8608_road,
    iso8608_tracks as iso8608_tracks,
    track_correlation as track_correlation,
)
from .taxi_tests.sensors import (
    Mounting as Mounting,
    Sensor as Sensor,
    decimate as decimate,
    measure as measure,
)
from .taxi_tests.taxiing import (
    TaxiTest as TaxiTest,
    taxi_run as taxi_run,
    taxi_test as taxi_test,
    taxi_truth as taxi_truth,
    tyre_forces as tyre_forces,
)
