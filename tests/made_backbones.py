"""A small structure with two joints, five degrees of freedom, and noisy backbones of it for the tests of updating."""

from functools import cache

import numpy as np
from scipy import sparse

from opid.mechanics.backbones.jointed_modes import JointedModes, jointed_modes
from opid.updating.likelihood.curves import likelihood_function
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.structure.affine import AffineStructure
from opid.virtual.backbone_tests.measured import synthetic_backbones

MASS = np.diag([3.6, 1.2, 1.0, 0.8, 0.8])
# rigid motion, bending and torsion of a plate, on whose two arms hang the tips
ARMS = np.array([[1.0, 0.55, 0.5], [1.0, 0.55, -0.5]])
TIPS = (3, 4)
MODES, AMPLITUDE_M = (2, 3), ((2e-4, 2e-3), (2e-4, 1.5e-3))
SENSORS = ("plate", "bend", "twist", "left", "right")
CUBIC = ModelClass("cubic", (UncertainTerm("cubic_stiffness", (6.8e7,), (Prior("uniform", 0.0, 10.0),)),))
QUADRATIC = ModelClass("quadratic", (UncertainTerm("quadratic_stiffness", (2.16e5,), (Prior("uniform", 0.0, 10.0),)),))
BOTH = ModelClass(
    "cubic and quintic",
    (
        UncertainTerm("cubic_stiffness", (7.48e7,), (Prior("uniform", 0.0, 10.0),)),
        UncertainTerm("quintic_stiffness", (-8.4e11,), (Prior("uniform", -40.0, 40.0),)),
    ),
)
TRUTH = 1.58


def log_likelihood(data, model_class, theta):
    """Return log p(D | theta), (n,), of theta (n, n_parameters)."""
    value, _ = likelihood_function(data, model_class)(theta)
    return value


def parts() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Suspension, plate and leaf springs."""
    suspension = np.diag([300.0, 0, 0, 0, 0])
    plate = np.diag([0, 1.2 * (2 * np.pi * 22) ** 2, (2 * np.pi * 30) ** 2, 0, 0])
    leaves = sum(6300.0 * np.outer(row, row) for row in joint_rows())
    return suspension, plate, leaves


def joint_rows() -> np.ndarray:
    rows = np.zeros((2, 5))
    for row, arm, tip in zip(rows, ARMS, TIPS, strict=True):
        row[:3], row[tip] = -arm, 1.0
    return rows


@cache
def system(plate: float = 1.0, leaves: float = 1.0) -> JointedModes:
    given = parts()
    return jointed_modes(
        MASS,
        given[0] + plate * given[1] + leaves * given[2],
        sensor_rows=np.eye(5),
        joint_rows=joint_rows(),
        sensors=SENSORS,
        joints=("left", "right"),
    )


def structure() -> AffineStructure:
    """The same with stiffness parts, its arms as massless-looking but light degrees of freedom of their own."""
    light, stiff = 1e-3, 5e6
    mass = sparse.block_diag([MASS, light * np.eye(2)], format="csr")
    rows = np.zeros((2, 7))
    ties = np.zeros((2, 7))
    for k, tip in enumerate(TIPS):
        rows[k, 5 + k], rows[k, tip] = -1.0, 1.0
        ties[k, :3], ties[k, 5 + k] = -ARMS[k], 1.0
    suspension, plate, _ = parts()
    base = sparse.block_diag([suspension, np.zeros((2, 2))]) + stiff * ties.T @ ties
    return AffineStructure(
        mass,
        sparse.csr_matrix(base),
        {
            "plate": sparse.csr_matrix(sparse.block_diag([plate, np.zeros((2, 2))])),
            "leaves": sparse.csr_matrix(6300.0 * rows.T @ rows),
        },
        (*SENSORS, "arm left", "arm right"),
        SENSORS,
        {"left": ("arm left", "left"), "right": ("arm right", "right")},
    )


def backbones(seed: int, *, true: JointedModes | None = None, **errors: object) -> tuple[MeasuredBackbone, ...]:
    """Six curves of the second mode and four of the third."""
    given = {"n_curves": (6, 4), "n_points": 12, "offset_fraction": 0.003, "point_noise": 0.001} | errors
    return synthetic_backbones(
        true or system(),
        CUBIC,
        (TRUTH,),
        rng=np.random.default_rng(seed),
        modes=MODES,
        amplitude_m=AMPLITUDE_M,
        controlled_sensor="left",
        harmonics=(1,),
        **given,
    )
