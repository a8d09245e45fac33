"""The truth of a series of modal tests."""

import pytest

from opid.errors import InputError
from opid.mechanics.truth import ModeTruth


def test_curves_of_other_lengths_are_refused():
    with pytest.raises(InputError, match="it has 2 amplitudes, 1 frequencies and 2 damping ratios: give one of each"):
        ModeTruth({}, {}, (1e-3, 2e-3), (100.0,), (0.01, 0.01))
