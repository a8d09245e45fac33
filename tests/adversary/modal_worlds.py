"""Worlds of the modal wing: sine beats (`opid modal`), free decays (`opid decay`) and resonance (`opid resonance`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from judged_worlds import Answer, World
from made_beats import C2, FOUR, K3, beats, softening
from made_decays import SENSED_FS, SENSED_K3, SENSED_OMEGA, decay_at_sensors
from made_resonance import C2 as HELD_C2, K3 as HELD_K3, held_study, with_force_turned, with_mode_unknown, with_samples
from scipy.signal import butter, sosfilt

from opid.estimate import Estimate
from opid.mechanics.rig import FORCE
from opid.modal.decay.free_decay import Decay, decay_of, free_decay
from opid.modal.identification import identify_modes
from opid.modal.linear.modes import LinearModes, ModalTest, modal_test
from opid.modal.resonance.identification import identify_resonance
from opid.modal.study import ModalStudy, StudyTest

Change = Callable[[np.ndarray, np.random.Generator], np.ndarray]

# ---- sine beats ---------------------------------------------------------------------------------------


def change_tests(tests: Sequence[ModalTest], change: Change, rng: np.random.Generator, modes: LinearModes) -> list:
    """Return tests whose samples, the force in the first column, are changed, read with these modes."""
    found = []
    for test in tests:
        record = replace(test.recording, samples=change(test.recording.samples.copy(), rng))
        found.append(modal_test(record, modes, name=test.name, force="force", drive_point="a"))
    return found


def beat_world(
    fails: str,
    change: Change = lambda samples, rng: samples,
    *,
    modes: LinearModes | None = None,
    structure: LinearModes = FOUR,
    drift: float = 0.0,
    must_say: str = "",
    is_searched: bool = False,
) -> World:
    """Return the world of a softening mode at 120 Hz, the third of the structure.

    Its tests are changed and read with `modes`, those of the structure where None; `drift` is that of its frequency
    between the tests, as a fraction. The orders of the law are named, or searched together with friction, joints and
    couplings, which takes half a minute.
    """
    orders = {} if is_searched else {"stiffness_order": 3, "damping_order": 3}

    def ask(seed: int) -> Answer:
        rng = np.random.default_rng([seed, 11])
        tests, known = beats(softening(structure, 3), rng), modes or structure
        if drift:
            moved = structure.frequency_hz * np.array([1.0, 1.0, 1.0 + drift, 1.0])
            later = beats(softening(replace(structure, frequency_hz=moved), 3), rng)
            tests = [*tests[:2], *later[2:]]
        tests = change_tests(tests, change, rng, known)
        study = ModalStudy("beats", known, (3,), tuple(StudyTest(each, "fit", 3) for each in tests), "a", **orders)
        found = identify_modes(study)
        fit = found.fits[0]
        pairs = [("k3", fit.stiffness.get(3, Estimate()), K3), ("c2", fit.damping.get(2, Estimate()), C2)]
        return Answer(tuple(pairs), found.warnings)

    return World("modal", fails + ", law searched" * is_searched, ask, must_say)


def scale(columns: slice | list[int], factor: float) -> Change:
    """Return the change that multiplies columns; the force is the first one."""

    def change(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        samples[:, columns] *= factor
        return samples

    return change


def delay(columns: slice, n_samples: float) -> Change:
    """Return the change that makes columns late by samples, also by parts of one."""

    def change(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        spectrum = np.fft.rfft(samples[:, columns], axis=0)
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(len(samples)) * n_samples)
        samples[:, columns] = np.fft.irfft(spectrum * turn[:, None], len(samples), axis=0)
        return samples

    return change


def exchange(one: int, other: int) -> Change:
    """Return the change that exchanges two columns."""

    def change(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        samples[:, [one, other]] = samples[:, [other, one]]
        return samples

    return change


def clip(column: int, fraction: float) -> Change:
    """Return the change that clips a column at a fraction of its largest value."""

    def change(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        limit = fraction * np.abs(samples[:, column]).max()
        samples[:, column] = np.clip(samples[:, column], -limit, limit)
        return samples

    return change


def add_mass(force: int, drive: int, kg: float) -> Change:
    """Return the change that a mass makes which moves with the structure behind the force cell."""

    def change(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        samples[:, force] += kg * samples[:, drive]
        return samples

    return change


def hum(fraction: float, hz: float) -> Change:
    """Return the change that adds a steady line to all accelerations."""

    def change(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        line = np.sin(2 * np.pi * hz * np.arange(len(samples)) / 2048.0 + rng.uniform(0, 6))
        samples[:, 1:] += fraction * np.abs(samples[:, 1:]).max(axis=0) * line[:, None]
        return samples

    return change


def renumber(modes: LinearModes, order: Sequence[int]) -> LinearModes:
    """Return modes whose shapes are exchanged, while their frequencies stay."""
    return replace(modes, shapes=modes.shapes[:, list(order)])


def keep(modes: LinearModes, kept: Sequence[int]) -> LinearModes:
    """Return only some of the modes."""
    chosen = list(kept)
    return replace(
        modes,
        frequency_hz=modes.frequency_hz[chosen],
        damping_ratio=modes.damping_ratio[chosen],
        shapes=modes.shapes[:, chosen],
    )


def list_beat_worlds(*, is_searched: bool) -> list[World]:
    """Return the worlds of sine beats, whose law is searched, or its orders are named."""
    world = partial(beat_world, is_searched=is_searched)
    return [
        world("none"),
        world("polarity of the force reversed", scale([0], -1.0), must_say="opposite signs"),
        world("accelerations 2 % off", scale(slice(1, None), 1.02)),
        world(
            "accelerations 2 % off, as were those that showed the shapes",
            scale(slice(1, None), 1.02),
            modes=replace(FOUR, shapes=FOUR.shapes * 1.02**0.5),
        ),
        world("force 2 % off", scale([0], 0.98)),
        world("a mass behind the force cell, 5 % of the modal mass", add_mass(0, 1, 0.05 / FOUR.shapes[0, 2] ** 2)),
        world("accelerations a sample late", delay(slice(1, None), 1.0)),
        world("force a sample late", delay(slice(0, 1), 1.0)),
        world("two sensors exchanged", exchange(1, 3)),
        world("shapes of two modes exchanged", modes=renumber(FOUR, (0, 1, 3, 2))),
        world(
            "a mode is missing in the shapes",
            modes=keep(FOUR, [0, 1, 2]),
        ),
        *(
            world(
                f"a neighbour {percent} % above",
                structure=replace(FOUR, frequency_hz=np.array([0.0, 90.0, 120.0, 120.0 * (1 + percent / 100)])),
            )
            for percent in (1, 3)
        ),
        world("force clipped at 70 %", clip(0, 0.7)),
        world("a sensor clipped at 70 %", clip(1, 0.7), must_say="clipped"),
        world("frequency 0.2 % lower in the later tests", drift=-0.002),
        world("frequency 1 % lower in the later tests", drift=-0.01),
        world("accelerations in g that are stated to be in m/s^2", scale(slice(1, None), 1 / 9.80665)),
    ]


BEAT_WORLDS = list_beat_worlds(is_searched=False) + [
    replace(each, is_slow=True) for each in list_beat_worlds(is_searched=True)
]

# ---- free decays ----------------------------------------------------------------------------------------


def decay_world(fails: str, follow: Callable[[int], Decay], must_say: str = "", unseen: str = "") -> World:
    """Return the world of the hardening mode at 40 Hz that `made_decays` solves."""

    def ask(seed: int) -> Answer:
        found = follow(seed)
        pairs = [
            ("k3", found.stiffness.get(3, Estimate()), SENSED_K3),
            ("f0", found.frequency_low_hz, SENSED_OMEGA / (2 * np.pi)),
            ("zeta", found.damping_low, 0.004),
        ]
        return Answer(tuple(pairs), found.warnings)

    return World("decay", fails, ask, must_say, unseen)


def ring(
    seed: int,
    change: Change = lambda samples, rng: samples,
    told: Callable[[LinearModes], LinearModes] = lambda modes: modes,
    **made: float,
) -> Decay:
    """Follow the first mode of a test whose samples are changed, by its shapes as they are told."""
    rng = np.random.default_rng([seed, 13])
    test, _ = decay_at_sensors(seed, **made)
    record = replace(test.recording, samples=change(test.recording.samples.copy(), rng))
    return decay_of(modal_test(record, told(test.modes), name="ring"), 1)


def ring_alone(
    seed: int,
    change: Callable[[np.ndarray, np.random.Generator], np.ndarray] = lambda signal, rng: signal,
    clock: float = 1.0,
) -> Decay:
    """Follow the decay of one signal, the modal acceleration of the first mode, by a clock that may be fast."""
    rng = np.random.default_rng([seed, 17])
    test, _ = decay_at_sensors(seed)
    return free_decay(change(test.modal_acceleration(1), rng), fs=SENSED_FS * clock, near_hz=40.0)


def drift_gain(fraction: float) -> Callable[[int], Decay]:
    """Return what follows a signal whose gain falls by a fraction until the end of the record."""
    return lambda seed: ring_alone(seed, lambda signal, rng: signal * np.linspace(1.0, 1.0 - fraction, signal.size))


def lose_samples(signal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a signal of which twelve stretches of 20 samples were lost and are zero."""
    for first in rng.integers(600, signal.size - 20, 12):
        signal[first : first + 20] = 0.0
    return signal


def pass_filter(signal: np.ndarray, hz: float, kind: str) -> np.ndarray:
    """Return a signal behind a filter of first order."""
    return np.asarray(sosfilt(butter(1, hz, kind, fs=SENSED_FS, output="sos"), signal))


def add_neighbour(signal: np.ndarray, rng: np.random.Generator, hz: float, fraction: float) -> np.ndarray:
    """Return a signal with the decay of a linear mode near it."""
    time = np.arange(signal.size - 400) / SENSED_FS
    other = np.exp(-0.004 * 2 * np.pi * hz * time) * np.cos(2 * np.pi * hz * time + rng.uniform(0, 6))
    return signal + fraction * np.abs(signal).max() * np.concatenate([np.zeros(400), other])


DECAY_WORLDS = [
    decay_world("none", ring),
    decay_world("all sensors 2 % off", lambda seed: ring(seed, scale(slice(None), 1.02))),
    decay_world("a signal alone, 2 % off", lambda seed: ring_alone(seed, lambda signal, rng: 1.02 * signal)),
    decay_world("a sensor 30 % off", lambda seed: ring(seed, wrong_gain=1.3)),
    decay_world("shapes 3 % off", lambda seed: ring(seed, n_sensors=10, shape_error=0.03)),
    decay_world("two sensors exchanged", lambda seed: ring(seed, exchange(0, 1))),
    decay_world("shapes of two modes exchanged", lambda seed: ring(seed, told=lambda modes: renumber(modes, (1, 0)))),
    decay_world("a mode is missing in the shapes", lambda seed: ring(seed, told=lambda modes: keep(modes, [0]))),
    decay_world("a sensor clipped at 60 %", lambda seed: ring(seed, clip(0, 0.6))),
    decay_world(
        "the signal clipped at 70 %",
        lambda seed: ring_alone(
            seed, lambda signal, rng: np.clip(signal, -0.7 * np.abs(signal).max(), 0.7 * np.abs(signal).max())
        ),
    ),
    decay_world(
        "a neighbour 1 % above beats with it",
        lambda seed: ring_alone(seed, lambda signal, rng: add_neighbour(signal, rng, 40.4, 0.3)),
    ),
    decay_world(
        "a neighbour 5 % above beats with it",
        lambda seed: ring_alone(seed, lambda signal, rng: add_neighbour(signal, rng, 42.0, 0.3)),
    ),
    decay_world(
        "hum at 50 Hz",
        lambda seed: ring_alone(
            seed,
            lambda signal, rng: (
                signal + 0.02 * np.abs(signal).max() * np.sin(2 * np.pi * 50.0 * np.arange(signal.size) / SENSED_FS)
            ),
        ),
    ),
    decay_world("clock 100 ppm fast", lambda seed: ring_alone(seed, clock=1.0001)),
    decay_world(
        "clock 1 % fast",
        lambda seed: ring_alone(seed, clock=1.01),
        unseen="a mode at 40 Hz by a clock that is 1 % fast is one at 40.4 Hz",
    ),
    decay_world("gain drifts by 1 %", drift_gain(0.01)),
    decay_world(
        "gain drifts by 5 %",
        drift_gain(0.05),
        unseen="a gain that falls by 5 % in 6.4 s is a damping ratio larger by 3.2e-5, which is 0.8 % of it",
    ),
    decay_world(
        "sensor saturates by 5 % at the largest reading",
        lambda seed: ring_alone(seed, lambda signal, rng: signal * (1 - 0.05 * (signal / np.abs(signal).max()) ** 2)),
    ),
    decay_world(
        "high-pass filter of 5 Hz", lambda seed: ring_alone(seed, lambda signal, rng: pass_filter(signal, 5.0, "high"))
    ),
    decay_world(
        "low-pass filter of 200 Hz",
        lambda seed: ring_alone(seed, lambda signal, rng: pass_filter(signal, 200.0, "low")),
    ),
    decay_world("lost samples are zero", lambda seed: ring_alone(seed, lose_samples)),
    decay_world(
        "a second hit after 3 s",
        lambda seed: ring_alone(
            seed, lambda signal, rng: signal + 0.3 * np.concatenate([np.zeros(3000), signal[:-3000]])
        ),
    ),
    decay_world(
        "the first half of a record twice",
        lambda seed: ring_alone(seed, lambda signal, rng: np.tile(signal[: signal.size // 2], 2)),
    ),
]

# ---- resonance ------------------------------------------------------------------------------------------


def resonance_world(fails: str, change: Callable[[ModalStudy], ModalStudy], must_say: str = "", **made) -> World:
    """Return the world of a force appropriation of the cubic mode of the virtual structure."""

    def ask(seed: int) -> Answer:
        found = identify_resonance(change(held_study(seed, **made)))
        law = found.law
        pairs = (
            [("k3", law.stiffness.get(3, Estimate()), HELD_K3), ("c2", law.damping.get(2, Estimate()), HELD_C2)]
            if law
            else []
        )
        return Answer(tuple(pairs), found.warnings)

    return World("resonance", fails, ask, must_say)


def at_columns(change: Change, *, is_force: bool) -> Callable[[ModalStudy], ModalStudy]:
    """Return the change of a study by a change of its force or of all accelerations."""

    def apply(study: ModalStudy) -> ModalStudy:
        def of_samples(samples: np.ndarray, record: object) -> np.ndarray:
            force = record.index(FORCE)  # type: ignore[attr-defined]
            others = [k for k in range(samples.shape[1]) if k != force]
            chosen = [force] if is_force else others
            samples[:, chosen] = change(samples[:, chosen].copy(), np.random.default_rng(0))
            return samples

        return with_samples(study, of_samples)

    return apply


def exchange_shapes(study: ModalStudy) -> ModalStudy:
    """Return the study with the shapes of the mode under test and of another elastic one exchanged."""
    number = study.tests[0].mode
    other = next(k for k in range(1, study.modes.n_modes + 1) if k != number and study.modes.elastic[k - 1])
    order = list(range(study.modes.n_modes))
    order[number - 1], order[other - 1] = other - 1, number - 1
    modes = renumber(study.modes, order)
    tests = tuple(replace(each, test=replace(each.test, modes=modes)) for each in study.tests)
    return replace(study, modes=modes, tests=tests)


def load_force_cell(study: ModalStudy, share: float) -> ModalStudy:
    """Return the study with a mass behind the force cell, given as a fraction of the modal mass."""
    drive, number = study.drive_point, study.tests[0].mode
    (at,) = np.flatnonzero(np.array(study.modes.sensors) == drive)
    kg = share / study.modes.shapes[at, number - 1] ** 2

    def of_samples(samples: np.ndarray, record: object) -> np.ndarray:
        index = record.index  # type: ignore[attr-defined]
        return add_mass(index(FORCE), index(drive), kg)(samples, np.random.default_rng(0))

    return with_samples(study, of_samples)


RESONANCE_WORLDS = [
    resonance_world("none", lambda study: study),
    resonance_world("polarity of the force reversed", at_columns(scale([0], -1.0), is_force=True)),
    resonance_world("accelerations 2 % off", at_columns(scale(slice(None), 1.02), is_force=False)),
    resonance_world("force 2 % off", at_columns(scale([0], 1.02), is_force=True)),
    resonance_world("force turned by 5 degrees", lambda study: with_force_turned(study, 5.0)),
    *(
        resonance_world(
            f"a mass behind the force cell, {percent:g} % of the modal mass",
            lambda study, percent=percent: load_force_cell(study, percent / 100),
        )
        for percent in (0.4, 2)
    ),
    resonance_world("accelerations a sample late", at_columns(delay(slice(None), 1.0), is_force=False)),
    resonance_world("the loop is 5 degrees off", lambda study: study, phase_error_deg=-5.0),
    resonance_world("a neighbour is not among the shapes", with_mode_unknown),
    resonance_world("shapes of two modes exchanged", exchange_shapes),
    resonance_world("a sensor clipped at 70 %", at_columns(clip(0, 0.7), is_force=False)),
    resonance_world("force clipped at 80 %", at_columns(clip(0, 0.8), is_force=True)),
]

MODAL_WORLDS = [*BEAT_WORLDS, *DECAY_WORLDS, *RESONANCE_WORLDS]
