# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .identification import update_study as update_study
from .likelihood.backbones import (
    BackboneData as BackboneData,
    backbone_data as backbone_data,
)
from .likelihood.curves import likelihood_function as likelihood_function
from .likelihood.noise import NoiseSettings as NoiseSettings
from .linear_updating import update_linear as update_linear
from .measured import (
    MeasuredBackbone as MeasuredBackbone,
    Place as Place,
    SensorHarmonic as SensorHarmonic,
    read_backbone as read_backbone,
    read_result_backbones as read_result_backbones,
    write_backbone as write_backbone,
)
from .model_class import (
    PAPER_CLASSES as PAPER_CLASSES,
    PAPER_THETA as PAPER_THETA,
    ModelClass as ModelClass,
    Prior as Prior,
    UncertainTerm as UncertainTerm,
    spline_terms as spline_terms,
)
from .posterior import (
    density_of as density_of,
    update_class as update_class,
)
from .prediction import predict as predict
from .result import (
    BackboneBand as BackboneBand,
    ClassPosterior as ClassPosterior,
    ForcedResponse as ForcedResponse,
    HarmonicBand as HarmonicBand,
    LinearPosterior as LinearPosterior,
    SensorBand as SensorBand,
    Updating as Updating,
)
from .sampling.chains import to_inference_data as to_inference_data
from .sampling.evidence import laplace as laplace, maximum_a_posteriori as maximum_a_posteriori
from .structure.affine import AffineStructure as AffineStructure, structure_from_skfem as structure_from_skfem
from .structure.matrices_file import (
    read_structure as read_structure,
    write_structure as write_structure,
)
from .structure.reduction import (
    ReducedStructure as ReducedStructure,
    craig_bampton as craig_bampton,
    lowest_modes as lowest_modes,
    modes_of as modes_of,
    reduce as reduce,
    reduction_errors as reduction_errors,
    ritz_model as ritz_model,
    ritz_modes as ritz_modes,
)
from .study import UpdatingStudy as UpdatingStudy
from .unmeasured_modes import PredictionSettings as PredictionSettings, ResponseSettings as ResponseSettings
