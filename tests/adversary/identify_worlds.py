"""Worlds of `opid identify`: suspensions, clocks, sensors, loadings and runs that are not what the study says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from judged_worlds import Answer, World
from law_runs import gear_study
from scipy.interpolate import make_interp_spline

from opid.mechanics.laws.law import LINEAR
from opid.signals.recording import FloatArray, Recording, recording_from_arrays
from opid.suspensions.identification import identify
from opid.suspensions.study import Run
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

FS, DURATION_S, REMOVED_KG = 256.0, 20.0, 220.0
NAMES = ("lower_z", "upper_z")

Pair = tuple[Recording, Recording]
"""Records of the heavy and of the light run."""


def gear_world(
    fails: str,
    spoil: Callable[[Pair, np.random.Generator], Pair] = lambda pair, rng: pair,
    *,
    gear: LandingGear | None = None,
    measure: Callable[[int], Pair] | None = None,
    stated_kg: float = -REMOVED_KG,
    copies: int = 0,
    truth: tuple[float, float, float] = (1850.0, 3.9e5, 6e3),
    law: str = "arctan_velocity",
    must_say: str = "",
    unseen: str = "",
    is_slow: bool = False,
) -> World:
    """Return the world of two taxi runs of one gear, heavy and light, of which the records are spoiled.

    `truth` are mass, stiffness and damping; those of the suspension are compared where the law that is found is the
    true `law`, for the linear part beside another law is another number.
    """

    def ask(seed: int) -> Answer:
        rng = np.random.default_rng([seed, 9])
        heavy, light = spoil((measure or (lambda number: drive(gear or LandingGear(), number)))(seed), rng)
        again = [Run(f"heavy again {number}", heavy) for number in range(copies)]
        found = identify(gear_study(Run("heavy", heavy), *again, Run("light", light, stated_kg)))
        names = ("mass", "stiffness", "damping") if found.law.name == law else ("mass",)
        given = (
            found.parameters.sprung_mass_kg,
            found.parameters.suspension_stiffness_n_per_m,
            found.parameters.suspension_damping_n_s_per_m,
        )
        pairs = tuple((name, estimate, true) for name, estimate, true in zip(names, given, truth, strict=False))
        said = (found.not_determined,) if found.not_determined else ()
        return Answer(pairs, (*said, *found.warnings))

    return World("identify", fails, ask, must_say, unseen, is_slow)


def drive(gear: LandingGear, seed: int, *, second: LandingGear | None = None, removed_kg: float = REMOVED_KG) -> Pair:
    """Return records of a gear and of the same, or of a second one, with less mass."""
    given = {"duration_s": DURATION_S, "fs": FS}
    if second is None:
        test = taxi_test(gear, rng=np.random.default_rng(seed), mass_removed_kg=removed_kg, **given)
        return test.heavy.recording, test.light.recording
    light = replace(second, sprung_mass_kg=gear.sprung_mass_kg - removed_kg)
    streams = np.random.default_rng(seed).spawn(2)
    first, other = (
        taxi_run(each, rng=rng, **given).recording for each, rng in zip((gear, light), streams, strict=True)
    )
    return first, other


def change(
    edit: Callable[[FloatArray, FloatArray, np.random.Generator], tuple[FloatArray, FloatArray]],
) -> Callable[[Pair, np.random.Generator], Pair]:
    """Return what edits the samples below and above in both runs."""

    def spoil(pair: Pair, rng: np.random.Generator) -> Pair:
        heavy, light = (
            recording_from_arrays(edit(each.channel(NAMES[0]), each.channel(NAMES[1]), rng), NAMES, fs=each.fs)
            for each in pair
        )
        return heavy, light

    return spoil


def read_at(samples: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return a record at other times than those of its samples."""
    path = make_interp_spline(np.arange(samples.size) / FS, samples, 5)
    return np.asarray(path(np.clip(time_s, 0.0, (samples.size - 1) / FS)))


def jitter(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return samples that were taken a tenth of a sample early or late, both at the same times."""
    time = (np.arange(below.size) + 0.1 * rng.standard_normal(below.size)) / FS
    return read_at(below, time), read_at(above, time)


def drift_clock(ppm_below: float, ppm_above: float):
    """Return what lets the clocks of both sensors run fast."""

    def edit(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        time = np.arange(below.size) / FS
        return read_at(below, time * (1 + 1e-6 * ppm_below)), read_at(above, time * (1 + 1e-6 * ppm_above))

    return change(edit)


def clip(fraction: float):
    """Return what limits the sensor above to a fraction of its largest reading."""

    def edit(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        most = fraction * float(np.abs(above).max())
        return below, np.clip(above, -most, most)

    return change(edit)


def unstable(seed: int) -> Pair:
    """Return records of a body on a suspension of negative stiffness, which a spring to the ground holds."""
    rng = np.random.default_rng([seed, 11])
    n = round(DURATION_S * FS)
    s = 2j * np.pi * np.fft.rfftfreq(n, 1 / FS)
    records = []
    for mass in (1850.0, 1850.0 - REMOVED_KG):
        band = (s.imag > 2 * np.pi * 0.5) & (s.imag < 2 * np.pi * 30.0)
        below = np.where(band, np.fft.rfft(rng.standard_normal(n)), 0.0)
        above = below * (6e3 * s - 1e5) / (mass * s**2 + 6e3 * s - 1e5 + 4e5)
        both = [np.fft.irfft(each, n) for each in (below, above)]
        size = 3.0 / both[0].std()
        records.append(
            recording_from_arrays([size * each + 0.005 * rng.standard_normal(n) for each in both], NAMES, fs=FS)
        )
    return records[0], records[1]


IDENTIFY_WORLDS = [
    gear_world("none"),
    gear_world(
        "no suspension in the band",
        gear=LandingGear(suspension_stiffness_n_per_m=3.9e8, suspension_damping_n_s_per_m=2e5, law=LINEAR),
        truth=(1850.0, 3.9e8, 2e5),
        law="linear",
        is_slow=True,
    ),
    gear_world(
        "negative stiffness",
        measure=unstable,
        truth=(1850.0, -1e5, 6e3),
        law="linear",
        must_say="the stiffness is negative",
    ),
    gear_world("jittered samples", change(jitter), is_slow=True),
    gear_world("clock above 200 ppm fast", drift_clock(0.0, 200.0), is_slow=True),
    gear_world("clock of both 100 ppm fast", drift_clock(100.0, 100.0)),
    gear_world(
        "clock of both 1 % fast",
        drift_clock(1e4, 1e4),
        unseen="a clock that is faster by c takes the accelerations of K and C for those of K / c^2 and C / c: with "
        "1 % the stiffness is 2 % off at any residual",
    ),
    gear_world(
        "sensors above and below exchanged",
        change(lambda below, above, rng: (above, below)),
        must_say="check the channels",
    ),
    gear_world("sign of the sensor above", change(lambda below, above, rng: (below, -above)), is_slow=True),
    gear_world("sign of both sensors", change(lambda below, above, rng: (-below, -above))),
    gear_world(
        "gain of the sensor above 2 % off",
        change(lambda below, above, rng: (below, 1.02 * above)),
        must_say="gain error",
        is_slow=True,
    ),
    gear_world(
        "gain of the sensor below 2 % off",
        change(lambda below, above, rng: (1.02 * below, above)),
        must_say="gain error",
        is_slow=True,
    ),
    gear_world(
        "mass difference 5 % off",
        stated_kg=-1.05 * REMOVED_KG,
        unseen="the accelerations depend on K / M, C / M and the mass difference over M alone: they are the same with "
        "all masses and forces 5 % larger",
    ),
    gear_world(
        "both runs at one mass",
        measure=lambda seed: drive(LandingGear(), seed, removed_kg=0.0),
        must_say="does not show in the runs",
    ),
    gear_world("both runs stated at one mass", stated_kg=0.0, must_say="different natural frequencies"),
    gear_world("one record for both runs", lambda pair, rng: (pair[0], pair[0]), must_say="hold the same samples"),
    gear_world("heavy run three times", copies=2, must_say="hold the same samples"),
    gear_world("sensor above clipped", clip(0.5), must_say="clipped", is_slow=True),
    gear_world(
        "second run with another spring",
        measure=lambda seed: drive(LandingGear(), seed, second=LandingGear(suspension_stiffness_n_per_m=1.1 * 3.9e5)),
        must_say="the runs differ",
        is_slow=True,
    ),
    gear_world(
        "second run on another tyre",
        measure=lambda seed: drive(LandingGear(), seed, second=LandingGear(tyre_stiffness_n_per_m=1.3 * 6.2e5)),
    ),
]
