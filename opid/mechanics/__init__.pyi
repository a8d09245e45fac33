# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .backbones.continuation import continued_backbone as continued_backbone
from .backbones.family import (
    Backbone as Backbone,
    BackboneFamily as BackboneFamily,
    backbone as backbone,
    family_evaluator as family_evaluator,
)
from .backbones.forced_curves import ForcedCurve as ForcedCurve, forced_curve as forced_curve
from .backbones.harmonic_balance import first_harmonic_factor as first_harmonic_factor
from .backbones.jointed_modes import (
    JointedModes as JointedModes,
    jointed_modes as jointed_modes,
)
from .backbones.quadrature_curves import MeasuredCurve as MeasuredCurve, quadrature_curve as quadrature_curve
from .backbones.specimen import Specimen as Specimen
from .driven import (
    Interface as Interface,
    Noise as Noise,
    Prediction as Prediction,
    half_steps as half_steps,
    predict as predict,
)
from .memory import force_along as force_along
from .repeatability import Departure as Departure
from .response import (
    Response as Response,
    State as State,
    time_response as time_response,
)
from .rig import (
    Rig as Rig,
    RigRun as RigRun,
    Shaker as Shaker,
    free_decay as free_decay,
    impact as impact,
    rig_run as rig_run,
)
from .structure import (
    Joint as Joint,
    Modes as Modes,
    Sliders as Sliders,
    Structure as Structure,
    force_of as force_of,
    frequency_response as frequency_response,
    iwan as iwan,
    modal_assurance as modal_assurance,
    natural_frequencies as natural_frequencies,
)
from .truth import (
    BodyTruth as BodyTruth,
    GearTruth as GearTruth,
    ModalTruth as ModalTruth,
    ModeTruth as ModeTruth,
    SuspensionTruth as SuspensionTruth,
    UpdatingTruth as UpdatingTruth,
)
from .weight import (
    ATMOSPHERE_PA as ATMOSPHERE_PA,
    GRAVITY_M_PER_S2 as GRAVITY_M_PER_S2,
)
