"""Phase I where a joint slips at the lowest points: its interval allows for it, and both phases at once mend it."""

import made_backbones as made
import numpy as np
import pytest

from opid.updating import ModelClass, NoiseSettings, Prior, UncertainTerm, UpdatingStudy
from opid.updating.identification import update_study
from opid.updating.linear_updating import update_linear
from opid.virtual import synthetic_backbones

TRUE_LEAVES = 1.05
SLIP = ModelClass(
    "slip", (UncertainTerm("iwan_friction", (1.2, 1e-3, 0.5, 0.3), (Prior("uniform", 0, 10), None, None, None)),)
)
WIDE = {"leaves": Prior("uniform", 0.3, 3.0)}


def curves(seed, model_class=SLIP, least=1e-4):
    return synthetic_backbones(
        made.system(1.0, TRUE_LEAVES), model_class, (1.0,), rng=np.random.default_rng(seed), modes=made.MODES,
        n_curves=(5, 4), n_points=14, amplitude_m=((least, 2e-3), (least, 1.5e-3)), controlled_sensor="left",
        harmonics=(1, 3), offset_fraction=0.001, point_noise=2e-4, linear_error=0.0,
    )  # fmt: skip


def study(seed, **changes):
    given = {
        "harmonics": (1, 3), "n_internal": 0, "n_samples": 1000, "seed": seed,
        "noise": NoiseSettings(linear_error=0.001, motion_error=0.0),
    } | changes  # fmt: skip
    return UpdatingStudy("friction", made.structure(), curves(seed), (SLIP,), parameters=WIDE, **given)


@pytest.mark.parametrize("seed", range(4))
def test_the_interval_of_phase_one_allows_for_the_slip_at_the_lowest_points(seed):
    given = {"cov": "inferred", "shape_std": "inferred", "common_error": 0.001}
    rng = np.random.default_rng(seed)
    slipping = update_linear(made.structure(), curves(seed), priors=WIDE, rng=rng, **given)
    estimate = slipping.estimates["leaves"]
    assert estimate.value < TRUE_LEAVES - 0.003  # It is softer as it slips, ...
    assert abs(estimate.value - TRUE_LEAVES) < 3 * estimate.std
    assert sum("extrapolate at amplitude 0" in warning for warning in slipping.warnings) == 2
    # ... and hardly wider where the springs are smooth.
    smooth = update_linear(made.structure(), curves(seed, made.CUBIC), priors=WIDE, rng=rng, **given)
    assert smooth.warnings == ()
    assert smooth.estimates["leaves"].std < 0.5 * estimate.std
    assert abs(smooth.estimates["leaves"].value - TRUE_LEAVES) < 4 * smooth.estimates["leaves"].std


@pytest.mark.slow
def test_both_phases_at_once_find_the_stiffness_while_nothing_slips():
    (found,) = update_study(study(0, is_joint=True)).classes
    slip, leaves = found.coefficients.values()
    assert slip.value == pytest.approx(1.2, rel=0.02)
    assert abs(leaves.value - TRUE_LEAVES) < 4 * leaves.std
    assert leaves.std < 0.003
