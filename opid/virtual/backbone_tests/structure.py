"""The wing-engine structure of Song et al. (2021) as a structure whose two moduli are to be updated."""

from __future__ import annotations

from opid.updating.structure.affine import AffineStructure
from opid.virtual.backbone_tests.wing_engine import JOINTS, SENSORS, WingEngine, wing_engine_matrices

E_ALUMINIUM = "E_aluminium"
E_STEEL = "E_steel"
UPDATED = {E_ALUMINIUM: 0.88, E_STEEL: 0.31}
"""What the paper finds (Table 1), as shares of 68.9 and 200 GPa."""


def wing_engine_structure(dimensions: WingEngine | None = None) -> AffineStructure:
    """Return the wing-engine structure: 14 sensors "1" to "14", four joints, factors E_aluminium and E_steel.

    Args:
        dimensions: of the structure, `WingEngine(leaf_asymmetry=0.05)` for the one with a 3:1 interaction; the
            calibrated symmetric one where left out.

    >>> sorted(wing_engine_structure().joints)
    ['12-13', '12-14', '9-10', '9-11']
    """
    matrices = wing_engine_matrices(dimensions)
    return AffineStructure(
        matrices.mass,
        matrices.stiffness,
        {E_ALUMINIUM: matrices.aluminium, E_STEEL: matrices.steel},
        matrices.dofs,
        SENSORS,
        JOINTS,
    )
