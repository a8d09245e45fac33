"""Short taxi runs of known truth, and fits of the driven model to them."""

import numpy as np

from opid.mechanics.laws.law import LINEAR
from opid.suspensions.candidates import gear_body
from opid.suspensions.fitting.fit import fit_model
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.law_parameters import to_free
from opid.suspensions.model.run import driven_run
from opid.suspensions.model.unknowns import Group
from opid.suspensions.sensor_facts import SensorPair, Sensors
from opid.suspensions.settings import Settings
from opid.suspensions.study import PointMass, Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear, loaded
from opid.virtual.taxi_tests.taxiing import TaxiTest, taxi_run, taxi_test

MASS_KG, STIFFNESS, DAMPING, NOISE = 1850.0, 3.9e5, 6e3, 5e-3


def weightless_test(gear, seed=0, **settings):
    """A taxi test of which both runs rest at one place of the law, as where the motion is horizontal."""
    streams, removed = np.random.default_rng(seed).spawn(2), PointMass(-220.0, 0.0)
    gears = (gear.airframe, loaded(gear.airframe, [removed]))
    runs = (taxi_run(each, rng=rng, **settings) for each, rng in zip(gears, streams, strict=True))
    return TaxiTest(tuple(runs), ((), (removed,)))


def logs_of(gear=None, seed=0, **settings):
    """Two runs of a gear of 20 s at 256 Hz: recording and mass change of each."""
    given = {"duration_s": 20, "fs": 256} | settings
    test = taxi_test(gear or LandingGear(), rng=np.random.default_rng(seed), **given)
    return (test.heavy.recording, 0.0), (test.light.recording, test.mass_change_kg)


def gear_study(*runs, sensors=None, repeatability=0.0):
    """The study of some runs of one gear, whose strut is the same in all unless something else is said."""
    return study_of_gear(
        "taxi",
        sprung="upper_z",
        unsprung="lower_z",
        runs=runs,
        sensors=sensors or SensorPair(),
        repeatability=repeatability,
    )


def study_of(gear=None, seed=0, *, sensors=None, change_kg=None, **settings):
    """The study of these runs, the mass change as stated if it is."""
    (heavy, _), (light, change) = logs_of(gear, seed, **settings)
    change = change if change_kg is None else change_kg
    return gear_study(Run("heavy", heavy), Run("light", light, change), sensors=sensors)


def runs_of(law=None, seed=0, *, gear=None, leaks=(), **settings):
    """The same runs as the model takes them."""
    gear = gear or (LandingGear() if law is None else LandingGear(law=law))
    return [
        driven_run(
            recording.channel("lower_z"),
            recording.channel("upper_z"),
            fs=recording.fs,
            loading=change,
            leaks=np.stack([recording.channel(name) for name in leaks], axis=1) if leaks else None,
        )
        for recording, change in logs_of(gear, seed, **settings)
    ]


def sensors_of(pair):
    """The sensors of one gear of which a pair of facts is known."""
    leaks = tuple((leak.into, 0, leak.tolerance) for leak in pair.leaks)
    return Sensors((pair.unsprung,), (pair.sprung,), ("",), leaks)


def gear_model(runs, law=LINEAR, *, ground=False, sensors=None, mass_free=True, noise=(NOISE, NOISE)):
    """The model of one gear with a law in newtons."""
    return Model(
        runs=tuple(runs),
        body=gear_body(),
        groups=(Group("", (0,), law.scaled(1 / MASS_KG) if law.terms else law, ground),),
        sensors=sensors_of(sensors or SensorPair()),
        mass_free=mass_free,
        noise=(np.array(noise[:1]), np.array(noise[1:])),
        motion_rms=np.array([[0.003, 0.04]]),
        settings=Settings(),
    )


def vector_of(model, **values):
    """A vector of the model of one gear: what is named, and else the nominal values; every run begins at rest."""
    law = model.groups[0].law
    known = {fault.name: fault.nominal for fault in model.faults}
    known |= {"stiffness_per_mass": 200.0, "damping_per_mass": 3.0, "inverse_mass": 1 / 1700}
    known |= {f"law[{k}]": value for k, value in enumerate(to_free(law))}
    shared = [(known | values).get(name, 0.0) for name in model.names]
    return np.array([*shared, *[0.0] * (2 * len(model.runs))])


def fitted(runs, law=LINEAR, *, start=None, **settings):
    """The fit of a law in newtons, started a little off the truth of the nominal gear."""
    model = gear_model(runs, law, **settings)
    return fit_model(model, vector_of(model, **(start or {})))


def true_values(fit, law, **others):
    """What the shared parameters of a fit should be: positive ones of the law as logarithms."""
    known = {"stiffness_per_mass": STIFFNESS / MASS_KG, "damping_per_mass": DAMPING / MASS_KG}
    known |= {"inverse_mass": 1 / MASS_KG} | others
    known |= {f"law[{k}]": value for k, value in enumerate(to_free(law.scaled(1 / MASS_KG)) if law.terms else ())}
    return np.array([known[name] for name in fit.model.names])


def shared(fit):
    """The fitted shared parameters."""
    return fit.theta[: fit.model.n_shared]
