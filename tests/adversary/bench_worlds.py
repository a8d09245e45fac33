"""Worlds of a test bench (`opid law`): errors of calibration, lag, moving parts, memory, and a damper that switches."""

from __future__ import annotations

import numpy as np
from judged_worlds import Answer, World
from scipy import signal
from scipy.interpolate import make_interp_spline

from opid.estimate import Estimate
from opid.signals.recording import Channel, Recording
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import bench_from_recording

FS, N = 500.0, 4000
STIFFNESS, DAMPING, CUBIC = 2e4, 150.0, 4e7


def move(motion: str, rng: np.random.Generator) -> np.ndarray:
    """Return a travel, m: a sine of 3 Hz that grows, or noise from 0.5 to 12 Hz."""
    time = np.arange(N) / FS
    if motion == "sine":
        return np.linspace(0.002, 0.01, N) * np.sin(2 * np.pi * 3.0 * time)
    band = signal.butter(4, (0.5, 12.0), "band", fs=FS, output="sos")
    travel = signal.sosfiltfilt(band, rng.standard_normal(N + 2000))[1000:-1000]
    return 0.005 * travel / travel.std()


def bench_world(
    fails: str,
    *,
    motion: str,
    mass_kg: float = 0.0,
    lag_s: float = 0.0,
    gains: tuple[float, float] = (1.0, 1.0),
    polarity: float = 1.0,
    switched: bool = False,
    slip_n: float = 0.0,
    steps: tuple[float, float] = (0.0, 0.0),
    stiffness: float = STIFFNESS,
    cubic_stiffness: float = CUBIC,
    must_say: str = "",
) -> World:
    """Return the world of a spring with a cubic part and a damper; `gains` are those of force and travel,
    and `steps` those of their values, over their standard deviations.

    The damping of a damper that is switched is the one that takes the same energy on average, and the stiffness beside
    a law without the cubic part the one that holds the same energy.
    """

    def ask(seed: int) -> Answer:
        rng = np.random.default_rng([seed, 7])
        time = np.arange(N) / FS
        path = make_interp_spline(time, move(motion, rng), 5)
        travel, velocity, acceleration = path(time), path(time, 1), path(time, 2)
        damping = DAMPING * (np.where(np.sin(2 * np.pi * 0.4 * time) > 0, 3.0, 1.0) if switched else np.ones(N))
        force = stiffness * travel + damping * velocity + cubic_stiffness * travel**3 + mass_kg * acceleration
        force = force + slip_n * follow_slip(travel)
        if lag_s:
            force = make_interp_spline(time, force, 5)(np.clip(time - lag_s, 0.0, None))
        read = polarity * gains[0] * force + 0.002 * force.std() * rng.standard_normal(N)
        seen = gains[1] * travel + 5e-4 * travel.std() * rng.standard_normal(N)
        read, seen = (
            np.round(each / (step * each.std())) * step * each.std() if step else each
            for each, step in zip((read, seen), steps, strict=True)
        )
        record = Recording(np.stack([read, seen], 1), fs=FS, channels=(Channel("load", "N"), Channel("stroke", "m")))
        found = law_of_bench(
            bench_from_recording(record, force="load", travel="stroke"),
            candidates=("cubic_stiffness", "quadratic_damping", "coulomb_friction"),
        )
        cubic = found.law_estimates.get("cubic_stiffness", {}).get("stiffness_n_per_m3", Estimate())
        beside = 0.0 if cubic.value is not None else cubic_stiffness * np.sum(travel**4) / np.sum(travel**2)
        pairs = (
            ("K", found.parameters.stiffness_n_per_m, stiffness + float(beside)),
            ("k3", cubic, cubic_stiffness),
            ("C", found.parameters.damping_n_s_per_m, float(np.sum(damping * velocity**2) / np.sum(velocity**2))),
        )
        return Answer(() if found.not_determined else pairs, found.warnings)

    return World("law", fails, ask, must_say)


def follow_slip(travel: np.ndarray, scale_m: float = 5e-4) -> np.ndarray:
    """Return the force of a Dahl element over its largest: hysteresis that no law of travel and velocity has."""
    force, state = np.empty_like(travel), 0.0
    for k, step in enumerate(np.diff(travel, prepend=travel[0])):
        direction = np.sign(step)
        state = direction - (direction - state) * np.exp(-abs(step) / scale_m)
        force[k] = state
    return force


BENCH_WORLDS = [
    bench_world(f"{words}, {motion}", motion=motion, **settings)
    for motion in ("sine", "noise")
    for words, settings in (
        ("none", {}),
        ("gain of the force 2 % off", {"gains": (1.02, 1.0)}),
        ("gain of the travel 2 % off", {"gains": (1.0, 1.02)}),
        ("0.3 kg between specimen and force cell", {"mass_kg": 0.3}),
        ("force a sample late", {"lag_s": 1 / FS}),
        ("force 0.5 ms late", {"lag_s": 5e-4}),
        ("polarity of the force reversed", {"polarity": -1.0, "must_say": "reverse the sign"}),
        ("hysteresis that no candidate has", {"slip_n": 40.0}),
    )
] + [
    bench_world("3 kg between specimen and force cell, noise", motion="noise", mass_kg=3.0, must_say="moving"),
    bench_world("a scheduled damper, noise", motion="noise", switched=True, must_say="change with time"),
    bench_world("a scheduled damper, sine", motion="sine", switched=True, must_say="no law of the library"),
    *(
        bench_world(f"{words}, {motion}", motion=motion, **settings)
        for motion in ("sine", "noise")
        for words, settings in (
            ("steps of the force of 3 deviations", {"steps": (3.0, 0.0), "must_say": "distinct values"}),
            ("steps of the travel of 3 deviations", {"steps": (0.0, 3.0), "must_say": "distinct values"}),
            ("steps of the force of 0.3 deviations", {"steps": (0.3, 0.0), "must_say": "distinct values"}),
            ("steps of the travel of 0.3 deviations", {"steps": (0.0, 0.3), "must_say": "distinct values"}),
            ("steps of the force of 0.1 deviations", {"steps": (0.1, 0.0)}),
            ("steps of the travel of 0.1 deviations", {"steps": (0.0, 0.1)}),
            ("steps of the travel of 0.02 deviations", {"steps": (0.0, 0.02)}),
            ("polarity of the travel reversed", {"gains": (1.0, -1.0), "must_say": "reverse the sign"}),
            (
                "negative stiffness",
                {"stiffness": -2e4, "cubic_stiffness": 0.0, "must_say": "the stiffness is negative"},
            ),
        )
    ),
]
