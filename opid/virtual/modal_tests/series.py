"""A virtual test series on a rig: impacts and sine beats at several levels, and a truth test (Pacini, section 4).

Three structures have such a series: modes of which one has a known law, and the paper's two case studies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Literal

import numpy as np

from opid.errors import InputError
from opid.mechanics.rig import FORCE, Rig, RigRun, impact, rig_run
from opid.mechanics.structure import Structure
from opid.mechanics.truth import LinearModesTruth, ModalTruth, ModeTruth
from opid.modal.forced.excitation import (
    SineBeat,
    beat_between_neighbours,
    beat_over_drive_point_peak,
    quiet_s,
    shaped_sweep,
    sine_beat_voltage,
)
from opid.modal.linear.modes import LinearModes, force_projection, modal_filter, modal_test
from opid.modal.model import NonlinearModalModel
from opid.modal.power_laws import DAMPING_KINDS, STIFFNESS_KINDS, power_law
from opid.modal.study import ModalStudy, StudyTest, Use
from opid.progress import Say, Step
from opid.signals.recording import FloatArray
from opid.signals.units import STANDARD_GRAVITY
from opid.virtual.modal_tests.bolted_structures import (
    CASE_SHAKER,
    CaseStudy,
    case_study_1,
    case_study_2,
    level_dependence,
)

Truth = Literal["sweep", "beat"]
Rule = Literal["neighbours", "drive point"]

IMPACTS = (0.01, 0.1, 0.6)
"""Largest acceleration of a nonlinear mode after each impact, over that of its highest sine beat."""

NEAR_ENOUGH, MOST_TRIES = 0.05, 10
"""Relative tolerance for the peak of the highest level, and the most runs in which it is approached."""

SMALL = 1e-3
"""Amplitude of the first run, from which the other amplitudes are estimated, V or N."""

CASES = ("cubic", "1", "2")

CUBIC_MODE, CUBIC_STIFFNESS, CUBIC_DAMPING = 3, {3: -1.8e11}, {2: 20.0}
"""The nonlinear mode of case "cubic", its k3 and c2: at its top level it loses 3 % of frequency, and damps double."""

CUBIC_TOP = 5e-4
"""Largest displacement of that mode, m kg^1/2."""

N_AMPLITUDES = 25
"""Amplitudes at which the truth states frequency and damping of a mode, up to 1.5 times its highest level."""

LEVELS_2 = (0.1, 0.25, 0.45, 0.65, 0.85, 1.0)
"""Levels of case 2. The highest beat is the truth test, so 0.85 is the highest level of the fit."""


@dataclass(frozen=True, eq=False)
class VirtualSeries:
    """The plan of a test series.

    Args:
        case: the rig with its sensors, its drive point and perhaps a shaker, its linear modes, and the modes to test.
        top_m_per_s2: peak acceleration of the highest sine beat at `top_sensor`.
        top_sensor: a sensor; None for the one with the largest shape of each mode.
        fs: sampling rate, Hz; impacts are recorded at twice that rate.
        levels: voltages of the sine beats over that of the highest one, which must be among them.
        rule: rule for the length of the beats: "neighbours" for first minima on the neighbouring modes, "drive point"
            for a main lobe as wide as the peak of the mode in the drive-point response.
        truth: "sweep" for a shaped sweep through all elastic modes, "beat" for the highest sine
            beat, which is then not fitted.
        sweep_octaves_per_s: rate of the shaped sweep; at 0.1 modes of 0.3 % have the time to build up their vibration.
        title: the title of the study.

    Raises:
        InputError: levels that are not fractions of the highest one.
    """

    case: CaseStudy
    top_m_per_s2: float
    fs: float
    title: str
    top_sensor: str | None = None
    levels: tuple[float, ...] = (0.1, 0.3, 0.6, 1.0)
    rule: Rule = "neighbours"
    truth: Truth = "sweep"
    sweep_octaves_per_s: float = 0.1

    def __post_init__(self) -> None:
        if not self.sweep_octaves_per_s > 0:
            raise InputError(f"sweep_octaves_per_s is {self.sweep_octaves_per_s}: give a positive rate")
        if max(self.levels) != 1.0 or min(self.levels) <= 0:
            raise InputError(f"levels are {self.levels}: give fractions of the highest one, which is 1")


def virtual_series(case: str, *, shaker: bool | None = None) -> VirtualSeries:
    """Return the test series of a case.

    Args:
        case: "cubic" for four modes, one of which softens and damps by powers that are known; "1" for a case that
            carries components, five of its modes nonlinear, to 20 g at the components; "2" for a plate bolted to a
            fixture, to 300 g at the drive point.
        shaker: whether the force comes from a shaker and its amplifier, or is prescribed; where left out, it comes from
            a shaker in cases "1" and "2".

    Raises:
        InputError: no such case.

    >>> series = virtual_series("cubic")
    >>> series.case.nonlinear_modes, series.truth
    ((3,), 'sweep')
    """
    if case == "cubic":
        found = _make_cubic(bool(shaker))
        shape = found.modes.shapes[:, CUBIC_MODE - 1]
        top = CUBIC_TOP * float(found.modes.stiffness()[CUBIC_MODE - 1] * np.abs(shape).max())
        return VirtualSeries(found, top, 1024.0, "A mode with cubic softening and quadratic damping")
    given: dict[str, Any] = {"shaker": None} if shaker is False else {}
    if case == "1":
        return VirtualSeries(case_study_1(**given), 20 * STANDARD_GRAVITY, 2048.0, "Components on bolted mounts")
    if case == "2":
        found = case_study_2(**given)
        return VirtualSeries(
            found,
            300 * STANDARD_GRAVITY,
            4096.0,
            "A plate bolted to a fixture",
            top_sensor=found.drive_point,
            rule="drive point",
            levels=LEVELS_2,
            truth="beat",
        )
    raise InputError(f"there is no case {case!r}: give one of {', '.join(CASES)}")


def virtual_study(
    series: VirtualSeries,
    *,
    rng: np.random.Generator,
    noise_fraction: float = 0.01,
    given: LinearModes | None = None,
    progress: Say | None = None,
) -> ModalStudy:
    """Run a virtual test series and return it as a study.

    Args:
        series: the plan of the series.
        rng: source of the noise.
        noise_fraction: standard deviation of the noise over the rms of each channel.
        given: linear modes that the study states; the true ones where left out.
        progress: a function that is called with a `Step`, the name of each test before it runs.

    Raises:
        InputError: modes that cannot be excited at the drive point.
    """
    n_steps = len(IMPACTS) + len(series.case.nonlinear_modes) * (1 + len(series.levels)) + (series.truth == "sweep")
    numbers = count()
    modes = series.case.modes if given is None else given
    tests: list[StudyTest] = []
    reached: dict[int, float] = {}

    def say(name: str) -> None:
        if progress is not None:
            progress(Step(name, next(numbers) / n_steps))

    def record(name: str, run: RigRun, use: Use, mode: int | None = None) -> None:
        test = modal_test(run.recording, modes, name=name, force=FORCE, drive_point=series.case.drive_point)
        tests.append(StudyTest(test, use, mode))

    for number, level in enumerate(IMPACTS, start=1):
        say(f"impact {number}")
        record(f"impact_{number}", _run_impact(series, level, rng, noise_fraction), "level")
    for mode in series.case.nonlinear_modes:
        say(f"level of mode {mode}")
        beat, reached[mode] = _design_highest_beat(series, mode)
        for number, level in enumerate(sorted(series.levels), start=1):
            say(f"sine beat {number} of mode {mode}")
            voltage = sine_beat_voltage(replace(beat, amplitude=level * beat.amplitude), series.fs)
            run = rig_run(series.case.rig, voltage, fs=series.fs, rng=rng, noise_fraction=noise_fraction)
            use: Use = "truth" if series.truth == "beat" and level == 1.0 else "fit"
            record(f"beat_{mode}_level_{number}", run, use, mode)
    if series.truth == "sweep":
        say("shaped sweep")
        run = rig_run(
            series.case.rig, _design_sweep(series, reached), fs=series.fs, rng=rng, noise_fraction=noise_fraction
        )
        record("sweep", run, "truth")
    return ModalStudy(series.title, modes, series.case.nonlinear_modes, tuple(tests), series.case.drive_point)


def stated_modes(modes: LinearModes, *, frequency_error: float = 0.0, damping_error: float = 0.0) -> LinearModes:
    """Return linear modes as a linear test with errors would state them."""
    return replace(
        modes,
        frequency_hz=modes.frequency_hz * (1 + frequency_error),
        damping_ratio=modes.damping_ratio * (1 + damping_error),
    )


def top_displacement(series: VirtualSeries, mode: int) -> float:
    """Return the modal displacement that the highest sine beat of a mode shall reach, m kg^1/2."""
    return _find_top(series, mode) / float(series.case.modes.stiffness()[series.case.modes.index(mode)])


def _find_top(series: VirtualSeries, mode: int) -> float:
    """Return the modal acceleration that the highest level shall reach."""
    shape = series.case.modes.shapes[:, series.case.modes.index(mode)]
    if series.top_sensor is not None:
        shape = series.case.modes.row(series.top_sensor)[[series.case.modes.index(mode)]]
    return series.top_m_per_s2 / float(np.abs(shape).max())


def _design_highest_beat(series: VirtualSeries, mode: int) -> tuple[SineBeat, float]:
    """Return the beat of a mode that reaches its peak, or the limit of the amplifier, and the fraction reached."""
    modes, drive_point = series.case.modes, series.case.drive_point
    if series.rule == "neighbours":
        beat = beat_between_neighbours(modes, mode, lead_s=0.05).beat
    else:
        beat = beat_over_drive_point_peak(modes, mode, drive_point, lead_s=0.05).beat

    def find_peak(amplitude: float) -> float:
        return _find_peaks(series, sine_beat_voltage(replace(beat, amplitude=amplitude), series.fs), [mode])[0]

    amplitude, reached = _adjust_amplitude(series, find_peak)
    return replace(beat, amplitude=amplitude), reached


def _design_sweep(series: VirtualSeries, reached: Mapping[int, float]) -> FloatArray:
    """Return a sweep through all elastic modes that brings the nonlinear modes to the peaks of their beats."""
    modes = series.case.modes
    elastic, frequency = _list_elastic(modes), modes.frequency_hz[modes.elastic]
    push = np.abs(force_projection(modes, series.case.drive_point))
    # A slow sweep needs this force to bring each mode to its top, if its damping is that of a low level.
    needed = {
        mode: 2 * modes.damping_ratio[mode - 1] * most * _find_top(series, mode) / push[mode - 1]
        for mode, most in reached.items()
    }
    least = 0.3 * min(needed.values())
    heights = [needed.get(mode, least) for mode in elastic]
    low, high = 0.8 * frequency.min(), 1.15 * frequency.max()
    tail = np.zeros(round(max(quiet_s(modes, mode) for mode in elastic) * series.fs))
    length_s = float(np.log2(high / low)) / series.sweep_octaves_per_s
    shape = shaped_sweep(
        frequency, heights, start_hz=low, stop_hz=high, duration_s=length_s, fs=series.fs,
        kind="logarithmic", fade_s=0.05 * length_s,
    )  # fmt: skip
    shape = np.concatenate([shape / np.abs(shape).max(), tail])

    def find_peak(amplitude: float) -> float:
        found = _find_peaks(series, amplitude * shape, list(reached))
        return max(each / most for each, most in zip(found, reached.values(), strict=True))

    return _adjust_amplitude(series, find_peak)[0] * shape


def _find_peaks(series: VirtualSeries, voltage: FloatArray, wanted: Sequence[int]) -> list[float]:
    """Return peak modal accelerations of a run without noise, over those that the highest level shall reach."""
    run = rig_run(series.case.rig, voltage, fs=series.fs, rng=np.random.default_rng(0), noise_fraction=0.0)
    readings = run.clean.samples[:, [run.clean.index(sensor) for sensor in series.case.modes.sensors]]
    motion = readings @ modal_filter(series.case.modes).T
    return [float(np.abs(motion[:, mode - 1]).max()) / _find_top(series, mode) for mode in wanted]


def _adjust_amplitude(series: VirtualSeries, find_peak: Callable[[float], float]) -> tuple[float, float]:
    """Return the amplitude whose peak is 1, or the limit of the amplifier if that is smaller, and its peak."""
    shaker = series.case.rig.shaker
    limit = np.inf if shaker is None else shaker.full_voltage_v
    amplitude, found = SMALL, max(find_peak(SMALL), 1e-300)
    for _ in range(MOST_TRIES):
        if abs(found - 1) < NEAR_ENOUGH or (amplitude == limit and found < 1):
            break
        # Each step is limited, as a joint may stiffen.
        longest = 5.0 if amplitude > SMALL else np.inf
        amplitude = min(amplitude * float(np.clip(1 / found, 0.2, longest)), limit)
        found = find_peak(amplitude)
    return amplitude, found


def _run_impact(series: VirtualSeries, level: float, rng: np.random.Generator, noise_fraction: float) -> RigRun:
    modes, fs = series.case.modes, 2 * series.fs
    push = np.abs(force_projection(modes, series.case.drive_point))
    omega = np.sqrt(modes.stiffness())
    # An impulse I starts a mode with the velocity phi I, and with an acceleration of omega times that.
    impulse = min(_find_top(series, mode) / (omega[mode - 1] * push[mode - 1]) for mode in series.case.nonlinear_modes)
    pulse_s = max(4.0 / fs, 0.6 / float(modes.frequency_hz.max()))
    slowest = max(quiet_s(modes, mode, decay_to=1e-3) for mode in _list_elastic(modes))
    return impact(
        series.case.rig,
        peak_n=level * impulse * np.pi / (2 * pulse_s),
        pulse_s=pulse_s,
        fs=fs,
        duration_s=slowest + 0.05,
        rng=rng,
        noise_fraction=noise_fraction,
    )


def _list_elastic(modes: LinearModes) -> list[int]:
    return [int(index) + 1 for index in np.flatnonzero(modes.elastic)]


def _make_cubic(shaker: bool) -> CaseStudy:
    """Return a case with a rigid-body mode and three elastic ones at six sensors."""
    shapes = np.array(
        [
            [0.35, 0.30, 0.28, -0.22],
            [0.35, 0.22, -0.30, 0.31],
            [0.35, -0.05, -0.45, -0.25],
            [0.35, -0.28, -0.12, 0.38],
            [0.35, -0.40, 0.25, 0.10],
            [0.35, 0.12, 0.40, 0.42],
        ]
    )
    sensors = ("case_x", "case_y", "lid_x", "lid_y", "board_x", "board_y")
    modes = LinearModes(np.array([0.0, 90.0, 120.0, 158.0]), np.array([0.0, 0.005, 0.004, 0.006]), shapes, sensors)
    model = NonlinearModalModel(modes, {CUBIC_MODE: power_law(CUBIC_STIFFNESS, CUBIC_DAMPING)})
    return CaseStudy(
        rig=Rig(model.structure(), modes.row("case_x"), shapes, sensors, CASE_SHAKER if shaker else None),
        modes=modes,
        drive_point="case_x",
        nonlinear_modes=(CUBIC_MODE,),
        text=f"four modes at six sensors, of which mode {CUBIC_MODE} has k3 q^3 and c2 q'|q'|",
    )


# ---- the truth --------------------------------------------------------------------------------------


def modal_truth(series: VirtualSeries, *, settings: Mapping[str, Any] | None = None) -> ModalTruth:
    """Return the truth of a virtual series of modal tests."""
    case = series.case
    modes = case.modes
    return ModalTruth(
        {mode: _find_true_mode(series, mode) for mode in case.nonlinear_modes},
        LinearModesTruth(tuple(modes.frequency_hz.tolist()), tuple(modes.damping_ratio.tolist())),
        case.text,
        dict(settings or {}),
    )


def _find_true_mode(series: VirtualSeries, mode: int) -> ModeTruth:
    structure = series.case.rig.structure
    largest = 1.5 * top_displacement(series, mode)
    found = level_dependence(structure, mode=mode, amplitude=np.linspace(0, largest, N_AMPLITUDES + 1)[1:])
    curves = (tuple(each.tolist()) for each in (found.amplitude, found.frequency_hz, found.zeta))
    return ModeTruth(*_list_powers(structure, mode), *curves)


def _list_powers(structure: Structure, mode: int) -> tuple[dict[int, float], dict[int, float]]:
    """Return the coefficients k and c of a mode whose joint is a sum of powers in its own coordinate."""
    own = np.eye(structure.n_dof)[mode - 1]
    k: dict[int, float] = {}
    c: dict[int, float] = {}
    for joint in structure.joints:
        if joint.sliders is not None or not np.array_equal(joint.direction, own):
            continue
        for values, kinds in ((k, STIFFNESS_KINDS), (c, DAMPING_KINDS)):
            powers = {name: power for power, name in kinds.items()}
            values |= {powers[each.name]: float(each.values[0]) for each in joint.law.terms if each.name in powers}
    return k, c
