# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from . import (
    campaigns as campaigns,
    laws as laws,
    mechanics as mechanics,
    modal as modal,
    plots as plots,
    signals as signals,
    suspensions as suspensions,
    updating as updating,
    virtual as virtual,
)
from .errors import (
    InputError as InputError,
    NotDeterminedError as NotDeterminedError,
)
from .estimate import Estimate as Estimate
from .identification import identify as identify
from .mechanics.laws.law import (
    Law as Law,
    law as law,
)
from .mechanics.laws.own_kinds import register_kind as register_kind
from .report import (
    text as text,
    write_report as write_report,
)
from .signals.health.inspection import inspect as inspect
from .signals.logs import (
    read_log as read_log,
    write_log as write_log,
)
from .signals.recording import Recording as Recording
from .studies.study_file import (
    read_study as read_study,
    write_study as write_study,
)
from .studies.suspension_study import study_from_logs as study_from_logs

__version__: str
