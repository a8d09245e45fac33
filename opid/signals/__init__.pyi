# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .exchange import (
    frame_of as frame_of,
    recording_from_frame as recording_from_frame,
    recording_from_sep005 as recording_from_sep005,
    recording_from_xarray as recording_from_xarray,
    sep005_of as sep005_of,
    xarray_of as xarray_of,
)
from .health.gravity import find_orientation as find_orientation
from .health.result import Health as Health
from .log import (
    ChannelSettings as ChannelSettings,
    Log as Log,
    LogSettings as LogSettings,
)
from .logs import (
    formats as formats,
    open_log as open_log,
)
from .motion import (
    Motion as Motion,
    differentiate as differentiate,
    integrate as integrate,
    relative_motion as relative_motion,
)
from .orientation import (
    Alignment as Alignment,
    Orientation as Orientation,
    align_sensors as align_sensors,
    follow_attitude as follow_attitude,
)
from .quantities import acceleration_below as acceleration_below
from .recording import (
    Channel as Channel,
    recording_from_arrays as recording_from_arrays,
)
from .resampling import (
    on_common_clock as on_common_clock,
    resampled as resampled,
)
from .segments import (
    Segment as Segment,
    sound_segments as sound_segments,
    taxi_segment as taxi_segment,
)
from .spectra import (
    CrossSpectra as CrossSpectra,
    Transmissibility as Transmissibility,
    TransmissibilitySettings as TransmissibilitySettings,
    cross_spectra as cross_spectra,
    transmissibility as transmissibility,
)
from .units import (
    STANDARD_GRAVITY as STANDARD_GRAVITY,
    to_si as to_si,
)
