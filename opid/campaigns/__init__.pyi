# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .campaign_file import (
    CampaignPlan as CampaignPlan,
    IdentifyOptions as IdentifyOptions,
    PlannedFlight as PlannedFlight,
    read_campaign as read_campaign,
)
from .engine import (
    EngineSettings as EngineSettings,
    run_campaign as run_campaign,
)
from .flight_task import TaskSettings as TaskSettings
