"""Worlds of a test bench (`opid law`): errors of calibration, lag, moving parts, memory, and a damper that switches."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from judged_worlds import Answer, World
from scipy import signal
from scipy.interpolate import make_interp_spline

from opid.estimate import Estimate
from opid.mechanics.laws.law import Law, Term
from opid.signals.recording import Channel, Recording
from opid.suspensions.bench.intervals import sine_of
from opid.suspensions.bench.law import BenchLaw, law_of_bench
from opid.suspensions.bench.record import bench_from_recording

Readings = tuple[np.ndarray, np.ndarray]
"""Force, N, and travel, m."""
Spoil = Callable[[np.ndarray, np.ndarray, np.random.Generator], Readings]
FS, N = 500.0, 4000
STIFFNESS, DAMPING, CUBIC = 2e4, 150.0, 4e7
SINES_HZ = {"sine": 3.0, "sine of 8 Hz": 8.0}
QUICK = "none, noise", "force 2 ms late, sine of 8 Hz", "third harmonic of the travel sensor, 1 %, noise"
"""Worlds that tests ask for every kind of law, too; the benchmark asks all."""
FEW_KINDS = "cubic_stiffness", "quadratic_damping", "coulomb_friction"


def move(motion: str, rng: np.random.Generator) -> np.ndarray:
    """Return a travel, m: a sine of 3 or 8 Hz that grows, or noise from 0.5 to 12 Hz."""
    time = np.arange(N) / FS
    if motion in SINES_HZ:
        return np.linspace(0.002, 0.01, N) * np.sin(2 * np.pi * SINES_HZ[motion] * time)
    band = signal.butter(4, (0.5, 12.0), "band", fs=FS, output="sos")
    travel = signal.sosfiltfilt(band, rng.standard_normal(N + 2000))[1000:-1000]
    return 0.005 * travel / travel.std()


def no_more(travel: np.ndarray, velocity: np.ndarray, late: np.ndarray | float) -> np.ndarray | float:
    """Return that nothing is beside spring and damper."""
    return 0.0


def bench_world(
    fails: str,
    *,
    motion: str,
    spoil: Spoil = lambda force, travel, rng: (force, travel),
    beside: Callable[..., np.ndarray | float] = no_more,
    by_area: bool = False,
    mass_kg: float = 0.0,
    lag_s: float = 0.0,
    gains: tuple[float, float] = (1.0, 1.0),
    polarity: float = 1.0,
    switched: bool = False,
    slip_n: float = 0.0,
    steps: tuple[float, float] = (0.0, 0.0),
    stiffness: float = STIFFNESS,
    cubic_stiffness: float = CUBIC,
    kinds: tuple[str, ...] | None = FEW_KINDS,
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of a spring with a cubic part and a damper; `gains` are those of force and travel,
    and `steps` those of their values, over their standard deviations.

    What is read is changed by `spoil`, and `beside` is a further force by travel, velocity and the time from 0 to 1.
    Where it is not among the candidates, the law of the library that is most like it has other parameters: its energy
    in a cycle alone is compared (`by_area`).

    The law is searched among `kinds`; None for every kind of the library.

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
        force = force + slip_n * follow_slip(travel) + beside(travel, velocity, np.linspace(0.0, 1.0, N))
        if lag_s:
            force = make_interp_spline(time, force, 5)(np.clip(time - lag_s, 0.0, None))
        read = polarity * gains[0] * force + 0.002 * force.std() * rng.standard_normal(N)
        seen = gains[1] * travel + 5e-4 * travel.std() * rng.standard_normal(N)
        read, seen = (
            np.round(each / (step * each.std())) * step * each.std() if step else each
            for each, step in zip((read, seen), steps, strict=True)
        )
        read, seen = spoil(read, seen, rng)
        record = Recording(np.stack([read, seen], 1), fs=FS, channels=(Channel("load", "N"), Channel("stroke", "m")))
        found = law_of_bench(
            bench_from_recording(record, force="load", travel="stroke"),
            candidates=kinds,
        )
        cubic = found.law_estimates.get("cubic_stiffness", {}).get("stiffness_n_per_m3", Estimate())
        same_energy = float(np.sum(damping * velocity**2) / np.sum(velocity**2))
        area = measure_area(found, stiffness, cubic_stiffness, same_energy, slip_n, beside)
        cycle = "cycle", found.cycle.area_j, area
        if by_area:
            return Answer((cycle,), found.warnings)
        is_like = cubic.value is not None or (kinds is None and found.law.terms)
        instead = 0.0 if is_like else cubic_stiffness * np.sum(travel**4) / np.sum(travel**2)
        pairs = (
            ("K", found.parameters.stiffness_n_per_m, stiffness + float(instead)),
            ("k3", cubic, cubic_stiffness),
            ("C", found.parameters.damping_n_s_per_m, same_energy),
        )
        if kinds is None:
            # Beside a term with a force of travel or velocity, stiffness or damping are not those of the true law.
            others = [term for term in found.law.terms if term.name != "cubic_stiffness"]
            pairs = (
                cycle,
                *(() if any(depends_on(term, 1.0, 0.0) for term in others) else pairs[:2]),
                *(() if any(depends_on(term, 0.0, 1.0) for term in others) else pairs[2:]),
            )
        return Answer(() if found.not_determined else pairs, found.warnings)

    if kinds is None:
        return World("law", f"{fails}, every kind of law", ask, must_say, unseen, is_slow=fails not in QUICK)
    return World("law", fails, ask, must_say, unseen)


def depends_on(term: Term, travel: float, velocity: float) -> bool:
    """Return whether a term has a force in a motion of these amplitudes, m and m/s."""
    motion = np.linspace(-1.0, 1.0, 20)
    return term.kind.memory is not None or bool(np.any(Law((term,)).force(travel * motion, velocity * motion)))


def measure_area(
    found: BenchLaw,
    stiffness: float,
    cubic_stiffness: float,
    damping: float,
    slip_n: float,
    beside: Callable[..., np.ndarray | float],
) -> float:
    """Return the energy that the true force takes in the cycle of a result, J."""
    z, v, fs = sine_of(found.bench)
    force = stiffness * z + damping * v + cubic_stiffness * z**3 + slip_n * follow_slip(z) + beside(z, v, 0.0)
    return float(np.sum(force * v) / fs / 4)


def follow_slip(travel: np.ndarray, scale_m: float = 5e-4) -> np.ndarray:
    """Return the force of a Dahl element over its largest: hysteresis that no law of travel and velocity has."""
    force, state = np.empty_like(travel), 0.0
    for k, step in enumerate(np.diff(travel, prepend=travel[0])):
        direction = np.sign(step)
        state = direction - (direction - state) * np.exp(-abs(step) / scale_m)
        force[k] = state
    return force


def pass_high(channel: np.ndarray, hz: float) -> np.ndarray:
    """Return a channel behind a high-pass filter of first order."""
    return np.asarray(signal.sosfilt(signal.butter(1, hz, "high", fs=FS, output="sos"), channel))


def pass_low(channel: np.ndarray, hz: float) -> np.ndarray:
    """Return a channel behind a low-pass filter of second order."""
    return np.asarray(signal.sosfilt(signal.butter(2, hz, "low", fs=FS, output="sos"), channel))


def lose(channel: np.ndarray, rng: np.random.Generator, *, is_held: bool) -> np.ndarray:
    """Return a channel without 2 % of its samples, in stretches of 20 ms: zero, or the last value, in their place."""
    channel, n = channel.copy(), round(0.02 * FS)
    for first in rng.integers(0, N - n, round(0.02 * N / n)):
        channel[first : first + n] = channel[first] if is_held else 0.0
    return channel


def add_spikes(channel: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a channel of which one sample in 500 is off by ten standard deviations."""
    return channel + (rng.random(N) < 0.002) * 10.0 * channel.std() * rng.choice([-1.0, 1.0], N)


def clip(channel: np.ndarray, fraction: float) -> np.ndarray:
    """Return a channel that is clipped at a fraction of its largest value."""
    return np.clip(channel, *(sign * fraction * np.abs(channel).max() for sign in (-1.0, 1.0)))


def bend(channel: np.ndarray, order: int, fraction: float) -> np.ndarray:
    """Return the reading of a sensor that is not linear, by a fraction at the largest value."""
    return channel * (1.0 + fraction * (channel / np.abs(channel).max()) ** (order - 1))


def hum(channel: np.ndarray, fraction: float) -> np.ndarray:
    """Return a channel with the frequency of the mains."""
    return channel + fraction * channel.std() * np.sin(2 * np.pi * 50.0 * np.arange(N) / FS)


def follow_play(travel: np.ndarray, width_m: float) -> np.ndarray:
    """Return what a travel sensor with backlash reads."""
    read, state = np.empty_like(travel), float(travel[0])
    for k, each in enumerate(travel.tolist()):
        state = min(max(state, each - width_m), each + width_m)
        read[k] = state
    return read


LATE = np.linspace(-1.0, 1.0, N)
"""Time from the middle of a record, over half its length."""
SECOND_DAY = LATE > 0

SPOILT: dict[str, tuple[Spoil, str]] = {
    "second harmonic of the force cell, 2 %": (lambda force, travel, rng: (bend(force, 2, 0.02), travel), ""),
    "second harmonic of the travel sensor, 2 %": (lambda force, travel, rng: (force, bend(travel, 2, 0.02)), ""),
    "third harmonic of the travel sensor, 1 %": (lambda force, travel, rng: (force, bend(travel, 3, 0.01)), ""),
    "spikes in the force": (lambda force, travel, rng: (add_spikes(force, rng), travel), ""),
    "spikes in the travel": (lambda force, travel, rng: (force, add_spikes(travel, rng)), ""),
    "lost samples of the force are zero": (
        lambda force, travel, rng: (lose(force, rng, is_held=False), travel),
        "",
    ),
    "lost samples of the travel are zero": (
        lambda force, travel, rng: (force, lose(travel, rng, is_held=False)),
        "",
    ),
    "lost samples of the travel are the last ones": (
        lambda force, travel, rng: (force, lose(travel, rng, is_held=True)),
        "",
    ),
    "force clipped at 70 %": (lambda force, travel, rng: (clip(force, 0.7), travel), ""),
    "travel clipped at 70 %": (lambda force, travel, rng: (force, clip(travel, 0.7)), ""),
    "travel clipped at 90 %": (lambda force, travel, rng: (force, clip(travel, 0.9)), ""),
    "gain of the force drifts by 5 %": (lambda force, travel, rng: (force * (1 + 0.025 * LATE), travel), ""),
    "gain of the travel drifts by 5 %": (lambda force, travel, rng: (force, travel * (1 + 0.025 * LATE)), ""),
    "zero of the force drifts": (lambda force, travel, rng: (force + 0.1 * force.std() * LATE, travel), ""),
    "two days, the gain of the force 5 % off on one": (
        lambda force, travel, rng: (force * (1 + 0.05 * SECOND_DAY), travel),
        "",
    ),
    "two days, the zero of the travel elsewhere on one": (
        lambda force, travel, rng: (force, travel + 0.3 * travel.std() * SECOND_DAY),
        "",
    ),
    "force behind a low-pass filter of 30 Hz": (lambda force, travel, rng: (pass_low(force, 30.0), travel), ""),
    "travel behind a low-pass filter of 30 Hz": (lambda force, travel, rng: (force, pass_low(travel, 30.0)), ""),
    "hum in the force": (lambda force, travel, rng: (hum(force, 0.1), travel), ""),
    "weak hum in the travel": (lambda force, travel, rng: (force, hum(travel, 0.01)), ""),
    "hum in the travel": (lambda force, travel, rng: (force, hum(travel, 0.05)), ""),
    "backlash of the travel sensor": (lambda force, travel, rng: (force, follow_play(travel, 0.05 * travel.std())), ""),
    "half a record twice": (lambda force, travel, rng: (np.tile(force[: N // 2], 2), np.tile(travel[: N // 2], 2)), ""),
    "record read backwards": (lambda force, travel, rng: (force[::-1].copy(), travel[::-1].copy()), ""),
}
"""What is read otherwise than it was, and what is said then."""

UNLIKE: dict[str, Callable[..., np.ndarray]] = {
    "stops that no candidate is": lambda z, v, late: 2e5 * np.maximum(np.abs(z) - 0.008, 0.0) * np.sign(z),
    "friction that falls with velocity": lambda z, v, late: 20.0 * np.sign(v) * (1.0 + np.exp(-np.abs(v) / 0.01)),
    "a valve that opens at 0.1 m/s": lambda z, v, late: -0.6 * DAMPING * np.sign(v) * np.maximum(np.abs(v) - 0.1, 0.0),
}
"""Forces beside spring and damper that are not among the candidates."""


def list_worlds(kinds: tuple[str, ...] | None) -> list[World]:
    """Return the worlds of a bench whose law is searched among these kinds; None for every kind of the library."""
    world = partial(bench_world, kinds=kinds)
    return [
        *(
            world(f"{words}, {motion}", motion=motion, **settings)
            for motion in ("sine", "sine of 8 Hz", "noise")
            for words, settings in (
                ("none", {}),
                ("gain of the force 2 % off", {"gains": (1.02, 1.0)}),
                ("gain of the travel 2 % off", {"gains": (1.0, 1.02)}),
                ("0.3 kg between specimen and force cell", {"mass_kg": 0.3}),
                *((f"force {1e3 * lag_s:g} ms late", {"lag_s": lag_s}) for lag_s in (-2e-3, -1e-3, 5e-4, 1e-3, 2e-3)),
                ("polarity of the force reversed", {"polarity": -1.0, "must_say": "reverse the sign"}),
                ("hysteresis that no candidate has", {"slip_n": 40.0}),
            )
        ),
        world("3 kg between specimen and force cell, noise", motion="noise", mass_kg=3.0, must_say="moving"),
        world("a scheduled damper, noise", motion="noise", switched=True, must_say="change with time"),
        world("a scheduled damper, sine", motion="sine", switched=True, must_say="no law of the library"),
        *(
            world(f"{words}, {motion}", motion=motion, **settings)
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
        *(
            world(f"{words}, {motion}", motion=motion, spoil=spoil, must_say=must_say)
            for motion in ("sine", "noise")
            for words, (spoil, must_say) in SPOILT.items()
        ),
        *(
            world(f"{words}, {motion}", motion=motion, beside=beside, by_area=True)
            for motion in ("sine", "noise")
            for words, beside in UNLIKE.items()
        ),
        world(
            "force behind a high-pass filter of 0.5 Hz, noise",
            motion="noise",
            spoil=lambda force, travel, rng: (pass_high(force, 0.5), travel),
        ),
        world(
            "travel behind a high-pass filter of 0.5 Hz, noise",
            motion="noise",
            spoil=lambda force, travel, rng: (force, pass_high(travel, 0.5)),
        ),
        world(
            "force behind a high-pass filter of 0.5 Hz, sine",
            motion="sine",
            spoil=lambda force, travel, rng: (pass_high(force, 0.5), travel),
            unseen="a filter of 0.5 Hz turns a sine of 3 Hz by 9.5 degrees, as a damping of K tan(9.5 deg)/omega does",
        ),
        *(
            world(
                f"a rig 20 times as stiff as the specimen, {motion}",
                motion=motion,
                spoil=lambda force, travel, rng: (force, travel + force / (20 * STIFFNESS)),
                unseen="the travel between the ends of a rig 20 times as stiff is that of a spring 4.8 % softer, and "
                "k3 is 17 % less",
            )
            for motion in ("sine", "noise")
        ),
    ]


BENCH_WORLDS = [*list_worlds(FEW_KINDS), *list_worlds(None)]
