"""Worlds of `opid modes`: linear modes from hits of a hammer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
from judged_worlds import Answer, World
from made_hits import MODES, SENSORS, hit, ring
from modal_worlds import Change, clip, delay, exchange, scale
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

from opid.estimate import Estimate
from opid.modal.linear.fitted_modes import RESPONSE_FIT, FittedModes
from opid.modal.linear.frequency_response import measured_response
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.response_fit import fit_modes
from opid.signals.recording import FloatArray, Recording

BAND_HZ = (25.0, 115.0)
FORCE = len(SENSORS)
"""Column of the hammer."""


def hammer_world(
    fails: str,
    change: Change = lambda samples, rng: samples,
    *,
    structures: Callable[[int], LinearModes] = lambda number: MODES,
    record: Callable[[int], Recording] | None = None,
    n_hits: int = 5,
    named: str = "tip",
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of a structure with three elastic modes that is hit at its tip.

    Its records are changed; `structures` are those of the hits, by their number, or `record` makes that of a seed.
    `named` is the sensor that is said to be where the force acts. The shapes are compared up to their sign, with the
    tolerance of calibrations that their standard deviations leave out.
    """

    def ask(seed: int) -> Answer:
        rng = np.random.default_rng([seed, 12])
        seeds = range(100 * seed, 100 * seed + n_hits)
        rings = [
            ring(each, modes=structures(number)) if record is None else record(each)
            for number, each in enumerate(seeds)
        ]
        records = [hit(replace(each, samples=change(each.samples.copy(), rng)), named) for each in rings]
        found = fit_modes([measured_response(records)], band_hz=BAND_HZ)
        return Answer(compare(found, structures(0)), found.warnings)

    return World("modes", fails, ask, must_say, unseen)


def compare(found: FittedModes, modes: LinearModes) -> tuple[tuple[str, Estimate, float], ...]:
    """Return the estimates of each mode that has intervals, each beside that of the mode of the structure.

    A mode of the structure is that of one found mode, so that one which is too many stands beside the rigid motion.
    """
    pairs = []
    given = [(k, each.value) for k, each in enumerate(found.frequency_hz) if each.value is not None and each.std]
    numbers, found_hz = np.array(given).reshape(-1, 2).T
    for row, mode in zip(*linear_sum_assignment(np.abs(found_hz[:, None] - modes.frequency_hz)), strict=True):
        k = int(numbers[row])
        pairs += [
            (f"frequency of mode {k + 1}", found.frequency_hz[k], float(modes.frequency_hz[mode])),
            (f"damping of mode {k + 1}", found.damping_ratio[k], float(modes.damping_ratio[mode])),
            (f"mass of mode {k + 1}", found.modal_mass_kg[k], float(1 / modes.shapes[0, mode] ** 2)),
        ]
        own, std = found.shapes[:, k], np.hypot(found.shape_std[:, k], RESPONSE_FIT.gain * np.abs(found.shapes[:, k]))
        scale = 1.0 if found.has_scale else 1 / modes.shapes[np.nanargmax(np.abs(own)), mode]
        true = modes.shapes[:, mode] * scale
        sign = np.sign(np.nansum(own * true))
        pairs += [
            (f"shape of mode {k + 1} at {name}", Estimate(float(sign * value), std=float(each)), float(truth))
            for name, value, each, truth in zip(SENSORS, own, std, true, strict=True)
            if np.isfinite(value) and np.isfinite(each)
        ]
    return tuple(pairs)


def shift(number: int) -> LinearModes:
    """Return the structure of a hit; from the third on a joint has slipped, which lowers one frequency by 0.3 %."""
    return replace(MODES, frequency_hz=MODES.frequency_hz * np.array([1.0, 1.0, 0.997 if number > 1 else 1.0, 1.0]))


def bring_together(number: int) -> LinearModes:
    """Return the structure with two modes that are an eighth of the half-power width of the wider one apart."""
    return replace(MODES, frequency_hz=np.array([0.0, 62.9, 63.0, 91.0]))


@cache
def ring_nonlinear(seed: int, stiffening: float, height: float | None = None) -> Recording:
    """Return the record of a hit where the mode at 63 Hz has a cubic spring.

    Args:
        seed: of height and noise.
        stiffening: fraction by which a motion of 0.5 mm kg^1/2, about that of the highest hits, raises its frequency.
        height: of the hit.
    """
    linear, mode, lasts_s = ring(seed, height=height), 2, 6.0
    time_s = np.arange(linear.n_samples) / linear.fs
    force, push = linear.channel("hammer"), MODES.shapes[0, mode]
    omega, ratio = 2 * np.pi * MODES.frequency_hz[mode], MODES.damping_ratio[mode]

    def move(cubic: float) -> FloatArray:
        """Return the modal acceleration; between pulls of the cubic spring the linear mode moves exactly."""
        finer, dt = 8, 1 / (8 * linear.fs)
        root = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2 * ratio * omega, push], [0.0, 0.0, 0.0]])
        (a, b, e), (c, d, f) = expm(root * dt)[:2].tolist()
        at = np.arange(round(lasts_s * linear.fs * finer)) * dt
        forces, q, speed, path = np.interp(at + dt / 2, time_s, force).tolist(), 0.0, 0.0, []
        for pull in forces:
            path.append((q, speed))
            speed -= dt / 2 * cubic * q**3
            q, speed = a * q + b * speed + e * pull, c * q + d * speed + f * pull
            speed -= dt / 2 * cubic * q**3
        moved, rate = np.array(path[::finer]).T
        return np.asarray(push * force[: moved.size] - 2 * ratio * omega * rate - omega**2 * moved - cubic * moved**3)

    changed = move(8 / 3 * stiffening * (omega / 5e-4) ** 2) - move(0.0)
    samples = linear.samples.copy()
    samples[: changed.size, :FORCE] += np.outer(changed, MODES.shapes[:, mode])
    return replace(linear, samples=samples)


def window(samples: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return records whose accelerations an analyser has made to decay, by 1/e in three seconds."""
    samples[:, :FORCE] *= np.exp(-np.arange(len(samples)) / (3.0 * 512.0))[:, None]
    return samples


def hum(samples: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return records with the frequency of the mains in all sensors, a tenth of their rms, in any phase."""
    wave = np.sin(2 * np.pi * 50.0 * np.arange(len(samples)) / 512.0 + rng.uniform(0.0, 2 * np.pi))
    samples[:, :FORCE] += 0.14 * samples[:, :FORCE].std(axis=0) * wave[:, None]
    return samples


def hit_twice(samples: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return records of a hammer that bounces: a second hit of a third of the height comes 60 ms after the first."""
    n = round(0.06 * 512.0)
    samples[n:] += samples[:-n] / 3.0
    return samples


def cut(samples: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return records that end after two seconds."""
    return samples[:1024]


HAMMER_WORLDS = [
    hammer_world("none"),
    hammer_world("sign of the force", scale([FORCE], -1.0), must_say="negative"),
    hammer_world("sign of one sensor", scale([2], -1.0), unseen="a sensor that counts the other way round is a shape"),
    hammer_world("gain of all accelerations 2 % off", scale(slice(0, FORCE), 1.02)),
    hammer_world("gain of one sensor 2 % off", scale([1], 1.02)),
    hammer_world("accelerations late by one sample", delay(slice(0, FORCE), 1.0)),
    hammer_world("accelerations late by 0.1 sample", delay(slice(0, FORCE), 0.1)),
    hammer_world("one sensor late by one sample", delay(slice(1, 2), 1.0)),
    *(
        hammer_world(f"{name} named where the force acts", named=name, must_say="the force did not act at")
        for name in SENSORS[1:]
    ),
    hammer_world(
        "two sensors exchanged",
        exchange(1, 2),
        unseen="the shape of any structure may be that of this one with two sensors exchanged",
    ),
    hammer_world("force clipped", clip(FORCE, 0.5), must_say="clipped"),
    hammer_world("acceleration clipped", clip(0, 0.5), must_say="clipped"),
    hammer_world("one mode 0.3 % lower from the third hit on", structures=shift, must_say="the records differ"),
    hammer_world("two modes closer than their widths", structures=bring_together),
    hammer_world("one hit", n_hits=1),
    *(
        hammer_world(f"a mode that {how}, {hits}", record=partial(ring_nonlinear, **given), n_hits=n_hits)
        for how, stiffening in (("stiffens", 0.01), ("softens little", -0.001))
        for hits, given, n_hits in (
            ("hits of one height", {"stiffening": stiffening, "height": 0.8}, 5),
            ("hits of other heights", {"stiffening": stiffening}, 5),
            ("one hit", {"stiffening": stiffening}, 1),
        )
    ),
    hammer_world("records end early", cut, must_say="ends with"),
    hammer_world("hum of the mains", hum),
    hammer_world("hammer bounces", hit_twice),
    hammer_world(
        "exponential window of the analyser",
        window,
        unseen="a window that decays by 1/e in T makes each mode decay faster by 1/T, as damping does",
    ),
    hammer_world(
        "accelerations in g read as m/s^2",
        scale(slice(0, FORCE), 1 / 9.80665),
        unseen="a free structure that is 9.8 times heavier answers a force so",
    ),
]
