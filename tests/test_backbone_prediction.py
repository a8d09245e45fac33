import made_backbones as made
import numpy as np
import pytest

from opid.mechanics.backbones.family import backbone
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.posterior import update_class
from opid.updating.prediction import predict


@pytest.fixture(scope="module", params=["recommended", "paper"])
def predicted(request):
    measured = made.backbones(4)
    data = backbone_data(made.system(), measured, form=request.param, harmonics=(1,))
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1100, evidences=("laplace",))
    return data, found, measured, predict(data, found, measured, rng=np.random.default_rng(0))


def test_bands_hold_the_measured_points_and_the_true_backbone(predicted):
    _, _, measured, bands = predicted
    assert [band.mode for band in bands] == [2, 3]
    for band in bands:
        assert (band.low_hz < band.frequency_hz).all()
        assert (band.frequency_hz < band.high_hz).all()
        assert band.coverage > 0.85
        seen = np.concatenate([one.controlled_amplitude for one in measured if one.mode == band.mode])
        assert (band.amplitude[0], band.amplitude[-1]) == pytest.approx((seen.min(), seen.max()))
        # not all that is possible: a few offsets of 0.3 %
        assert ((band.high_hz - band.low_hz) / band.frequency_hz).max() < 0.05
        law = made.CUBIC.law("left", [made.TRUTH])
        true = backbone(made.system(), law, mode=band.mode, sensor="left", amplitude=band.amplitude).frequency_hz
        assert ((band.low_hz < true) & (true < band.high_hz)).all()


def test_same_seed_same_bands(predicted):
    data, found, measured, bands = predicted
    again = predict(data, found, measured, rng=np.random.default_rng(0))
    assert all(np.array_equal(one.low_hz, other.low_hz) for one, other in zip(bands, again, strict=True))
