"""Compile every kernel once for all processes of a run; numba keeps what is compiled on disk."""

import numpy as np

from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.driven import Interface, Noise, predict
from opid.mechanics.laws.law import LINEAR, default_law, law
from opid.mechanics.memory import force_along
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run

taxi_run(LandingGear(), rng=np.random.default_rng(0), duration_s=2.0)
one_mass = JointedModes([400.0], [[1.0]], [[1.0]], ("mass",), ("spring",))
backbone(one_mass, law("cubic_stiffness", stiffness_n_per_m3=4e9), mode=1, sensor="mass", amplitude=np.array([1e-4]))
force_along(default_law("dahl_friction"), np.zeros(9), np.ones(9), 100.0)
friction = default_law("dahl_friction")
singles = [(1, ground, own) for ground in (False, True) for own in (LINEAR, friction)]
for n, ground, own in (*singles, (2, False, LINEAR)):
    rows = 6 if ground else 4
    predict(
        [Interface(400.0, 4.0, law=own)] * n,
        np.eye(n),
        np.zeros((99, n)),
        np.ones((50, n)),
        fs=512.0,
        noise=Noise(0.0, 0.01),
        start=np.zeros((rows, n)),
        start_covariance=1e-6 * np.eye(rows * n),
        ground=ground,
    )
