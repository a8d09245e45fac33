"""Short taxi runs of known truth, and fits of them to start a search from."""

import numpy as np

from opid.mechanics.landing_gear import LandingGear, taxi_test
from opid.mechanics.laws import LINEAR
from opid.suspensions.one_gear.driven_run import driven_run
from opid.suspensions.one_gear.model_fit import fit_model


def runs_of(law, seed=0, **settings):
    test = taxi_test(
        LandingGear(law=law), rng=np.random.default_rng(seed), **({"duration_s": 20, "fs": 256} | settings)
    )
    return [
        driven_run(
            run.recording.channel("lower_z"),
            run.recording.channel("upper_z"),
            fs=run.recording.fs,
            mass_change_kg=change,
        )
        for run, change in ((test.heavy, 0.0), (test.light, test.mass_change_kg))
    ]


def fitted(runs, law=LINEAR):
    """The model of a law in newtons, started a little off the truth of the nominal gear."""
    return fit_model(runs, law.scaled(1 / 1850), stiffness_per_mass=200.0, damping_per_mass=3.0, inverse_mass=1 / 1700)
