"""What the tests of backbones share: a small structure with two pylons of two leaf springs, each with a joint."""

import numpy as np

from opid.mechanics.backbones.jointed_modes import JointedModes, jointed_modes
from opid.mechanics.laws.law import Law, Term

N_PLATE = 6
SENSORS = (*(f"plate {k + 1}" for k in range(N_PLATE)), "tip 1", "tip 2", "tip 3", "tip 4")
JOINTS = ("joint 1", "joint 2", "joint 3", "joint 4")
# in which the tips move against the plate
TIP_MODES = (3, 4)


def one_mass(stiffness=100.0, mass=2.0):
    """A mass on a spring, whose joint is the spring."""
    return jointed_modes(
        [[mass]], [[stiffness]], sensor_rows=[[1.0]], joint_rows=[[1.0]], sensors=("mass",), joints=("spring",)
    )


def pylon_matrices(asymmetry=0.0, suspension=50.0):
    """Mass, stiffness and joint rows: a chain of six masses, with two linked tips on the second and the fifth."""
    n = N_PLATE + 4
    mass = np.diag([0.8] * N_PLATE + [0.39] * 4)
    springs = [*((k, k + 1, 2.4e4) for k in range(N_PLATE - 1)), (6, 7, 1.5e4), (8, 9, 1.5e4)]
    leaves = [(1, 6, 1 + asymmetry), (1, 7, 1 - asymmetry), (4, 8, 1 + asymmetry / 2), (4, 9, 0.97 - asymmetry / 2)]
    stiffness = np.diag([suspension] * N_PLATE + [0.0] * 4)
    for one, other, constant in [*springs, *((one, other, 3.3e3 * fraction) for one, other, fraction in leaves)]:
        row = np.zeros(n)
        row[one], row[other] = -1.0, 1.0
        stiffness += constant * np.outer(row, row)
    joint_rows = np.zeros((4, n))
    for row, (one, other, _) in zip(joint_rows, leaves, strict=True):
        row[one], row[other] = -1.0, 1.0
    return mass, stiffness, joint_rows


def two_pylons(asymmetry=0.0, suspension=50.0) -> JointedModes:
    """The same by its modes."""
    mass, stiffness, joint_rows = pylon_matrices(asymmetry, suspension)
    return jointed_modes(mass, stiffness, sensor_rows=np.eye(10), joint_rows=joint_rows, sensors=SENSORS, joints=JOINTS)


def spring(name, *values):
    """A law of one term."""
    return Law((Term(name, values),))


CUBIC = spring("cubic_stiffness", 6e7)
QUADRATIC = spring("quadratic_stiffness", 1.8e5)
QUARTIC = spring("quartic_stiffness", 2e10)
QUINTIC = spring("quintic_stiffness", 6e12)
ROOT = spring("signed_power_stiffness", 8e3, 1.5)
EVEN = spring("even_quadratic_stiffness", 1.2e5)
GAS = spring("gas_column", 60.0, 0.02, 1.3)
ARCTAN = spring("arctan_displacement", 4.0, 2e-3)
