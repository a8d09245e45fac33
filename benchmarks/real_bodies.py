"""`opid law` where no force was measured: a body that nothing but its suspension holds tells it by its acceleration.

Run `python benchmarks/real_bodies.py ../shared/data [sliding impact]`. The records are those of the README in that
folder; they are not part of the project. docs/real_records.md says what comes out.

sliding: a frame of three storeys on friction pendulums. The mean acceleration of its floors, weighted by their masses,
is the force of the isolators for each kilogram. Displacements of base and floors are measured, of the table the
acceleration.

impact: a falling body and its nose, joined by an actuator that plays a spring. Before the water is reached both fall
freely, and what the accelerometer reads has a fixed ratio to the second derivative of the nose's travel: this is a test
of the sensors that asks no spring.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from opid.estimate import Estimate
from opid.signals.recording import Channel, FloatArray, Recording
from opid.suspensions.bench.law import BenchLaw, law_of_bench
from opid.suspensions.bench.record import Bench, bench_from_recording
from opid.suspensions.bench.settings import DEFAULTS

G, INCH_M = 9.80665, 0.0254
FRAME_HZ, IMPACT_HZ = 256.0, 5000.0
LEAST_SAMPLES = DEFAULTS.record.least_samples

# the table hardly moves below, its accelerometer drifts there; above, the displacements hold noise
TABLE_FROM_HZ, FRAME_TO_HZ = 0.2, 10.0
# about twice the speed that the sensors show between a table and a base that is bolted to it
SLIDES_M_S = 0.05
SPEEDS_M_S = (0.06, 0.15)

# of the makers' model: mass of the body without the nose, and that of the nose over both
BODY_KG, NOSE_FRACTION = 0.639, 0.228
# begins and ends where body and nose fall freely and their spring still rings, s after the release
FREE_FALL_S = (0.02, 0.13)
FREE_FALL_HZ = 200.0
# of the useful part after the impact, and before the nose comes near its stop
AFTER_IMPACT_S, BEFORE_STOP_S, NEAR_STOP_M = 0.15, 0.01, 5e-3


def recording_of(columns: dict[str, tuple[FloatArray, str]], fs: float) -> Recording:
    """Return a recording of columns with their units."""
    channels = tuple(Channel(name, unit) for name, (_, unit) in columns.items())
    return Recording(np.stack([values for values, _ in columns.values()], axis=1), fs=fs, channels=channels)


@dataclass(frozen=True, eq=False)
class Sliding:
    """One record of the frame.

    Args:
        travel: (n,) of the base over the table, m.
        velocity: (n,) its rate, m/s.
        floors: (4, n) accelerations of base and floors, m/s^2.
    """

    travel: FloatArray
    velocity: FloatArray
    floors: FloatArray

    @property
    def slides(self) -> NDArray[np.bool_]:
        """(n,) whether base and table move apart faster than their sensors could pretend."""
        return np.abs(self.velocity) > SLIDES_M_S

    def bench(self, fractions: FloatArray) -> Bench:
        """Return force for each kilogram and travel, of the samples that slide.

        Args:
            fractions: (4,) of the mass, that of the base first.
        """
        columns = {
            "frame": (fractions @ self.floors, "m/s^2"),
            "travel": (self.travel, "m"),
            "velocity": (self.velocity, "m/s"),
        }
        record = recording_of(columns, FRAME_HZ)
        names = {"force": "frame", "travel": "travel", "velocity": "velocity"}
        return bench_from_recording(record, **names, mass_kg=1.0, counted=self.slides)


def sliding_records(folder: Path) -> dict[str, Sliding]:
    """Return the frame on sliding isolators and, as a control, bolted to the table."""
    with np.load(folder / "sliding_isolators/frame_256Hz.npz") as file:
        data = {name: file[name].astype(np.float64) for name in file}
    records = {}
    for name in sorted({key.split("/")[0] for key in data if "/" in key}):
        table = _in_band(G * data[f"{name}/aextx"], (TABLE_FROM_HZ, FRAME_TO_HZ), -2)
        paths = [INCH_M * data[f"{name}/s{channel}"] for channel in (2, 3, 4, 5)]
        travel = _in_band(paths[0], (0.0, FRAME_TO_HZ), 0) - table
        floors = np.stack([_in_band(path, (0.0, FRAME_TO_HZ), 2) for path in paths])
        records[name] = Sliding(travel, np.gradient(travel, 1 / FRAME_HZ), floors)
    return records


def _in_band(samples: FloatArray, band_hz: tuple[float, float], times: int) -> FloatArray:
    """Differentiate `times` times, or integrate where that is negative, in a band; both ends are at rest."""
    n = samples.size
    quiet = round(0.25 * FRAME_HZ)
    level = samples - np.linspace(samples[:quiet].mean(), samples[-quiet:].mean(), n)
    n_fft = fft.next_fast_len(4 * n, real=True)
    f = np.maximum(fft.rfftfreq(n_fft, 1 / FRAME_HZ), 1e-9)
    gain = (2j * np.pi * f) ** times / (1 + (band_hz[0] / f) ** 12) / (1 + (f / band_hz[1]) ** 12)
    found = fft.irfft(fft.rfft(level, n_fft) * gain, n_fft)[:n]
    # a displacement keeps where it comes to rest
    return found + (samples - level - samples[:quiet].mean() if times == 0 else 0.0)


def mass_fractions(records: dict[str, Sliding]) -> FloatArray:
    """Return how the mass is shared by base and floors, which nobody stated: (4,), the base first.

    While the base slides, sum_i w_i a_i = -(K z + C v + mu sgn v + F0), K to F0 of each record, w of the frame: linear
    least squares. With wrong fractions the frame's own swinging would be left over.

    Args:
        records: some that slide.
    """
    rows, forces = [], []
    for k, record in enumerate(records.values()):
        moving, v = record.slides, record.velocity
        law = np.zeros((int(moving.sum()), 4 * len(records)))
        own = np.stack([record.travel, v, np.sign(v), np.ones_like(v)], axis=1)
        law[:, 4 * k : 4 * k + 4] = own[moving]
        rows.append(np.concatenate([law, (record.floors[1:] - record.floors[0]).T[moving]], axis=1))
        forces.append(-record.floors[0][moving])
    floors = np.linalg.lstsq(np.concatenate(rows), np.concatenate(forces), rcond=None)[0][-3:]
    return np.concatenate([[1 - floors.sum()], floors])


def law_of_sliding(record: Sliding, fractions: FloatArray) -> BenchLaw:
    """Return the law of a pendulum with friction, F/M = z g/R + C z' + mu g, mu growing with the speed."""
    return law_of_bench(record.bench(fractions), candidates=("coulomb_friction",))


def period_s(found: BenchLaw) -> Estimate:
    """Return the period of a pendulum from its stiffness for each kilogram; without an interval where it is open."""
    stiffness = found.parameters.stiffness_n_per_m
    assert stiffness.value is not None
    if stiffness.value <= 0:
        return Estimate()
    value, ends = 2 * np.pi / np.sqrt(stiffness.value), stiffness.interval95
    if ends is None or ends[0] <= 0:
        return Estimate(float(value))
    return Estimate(float(value), None, (float(2 * np.pi / np.sqrt(ends[1])), float(2 * np.pi / np.sqrt(ends[0]))))


def friction_coefficient(found: BenchLaw, speed_m_s: float) -> float:
    """Return what slides against the motion at a speed, C v + f(v), over the weight."""
    damping = found.parameters.damping_n_s_per_m.value
    assert damping is not None
    both = found.law.force(np.zeros(2), np.array([speed_m_s, -speed_m_s]))
    return float((damping * speed_m_s + (both[0] - both[1]) / 2) / G)


@dataclass(frozen=True, eq=False)
class Impact:
    """One fall into the water.

    Args:
        travel: (n,) of the nose into the body, m.
        body: (n,) acceleration of the body, positive downwards, its lateness taken out, m/s^2.
        scale: of the body's acceleration over the nose's travel, as it is while both fall, over what their masses say.
        late_s: how much later the acceleration is than the travel.
        after_impact: samples that the water moves and no stop.
    """

    travel: FloatArray
    body: FloatArray
    scale: float
    late_s: float
    after_impact: slice

    @property
    def is_long_enough(self) -> bool:
        """Whether enough samples lie between the water and the stop."""
        return self.after_impact.stop - self.after_impact.start >= LEAST_SAMPLES

    @property
    def bench(self) -> Bench:
        """Force of the spring against its compression."""
        part = self.after_impact
        columns = {"body": (self.body[part], "m/s^2"), "travel": (self.travel[part], "m")}
        return bench_from_recording(recording_of(columns, IMPACT_HZ), force="body", travel="travel", mass_kg=BODY_KG)


def programmed(name: str) -> tuple[float, float | None, float]:
    """Return what a trial is named after: stiffness N/m, force at which the spring saturates N, speed m/s.

    >>> programmed("5npmm_2mps_trial1"), programmed("20nthreshold_6mps_trial1")
    ((5000.0, None, 2.0), (15000.0, 20.0, 6.0))
    """
    found = re.match(r"(\d+)n(pmm|threshold)_(\d+)mps", name)
    assert found is not None, name
    number, speed = float(found[1]), float(found[3])
    return (1e3 * number, None, speed) if found[2] == "pmm" else (15e3, number, speed)


def impact_records(folder: Path) -> dict[str, Impact]:
    """Return the falls, by the spring that was programmed."""
    with np.load(folder / "water_impact/impacts_5kHz.npz") as file:
        data = {name: file[name].astype(np.float64) for name in file}
    impacts = {}
    for name in sorted({key.split("/")[0] for key in data}):
        travel, body = 1e-3 * data[f"{name}/pos"], G * data[f"{name}/ay"]
        # the release is the first sample
        first = round(programmed(name)[2] / G * IMPACT_HZ)
        scale, late_s = free_fall(travel, body)
        row = np.arange(travel.size)
        body = np.interp(row + late_s * IMPACT_HZ, row, body)
        near = np.flatnonzero(travel[first:] > NEAR_STOP_M)
        stop = first + (int(near[0]) if near.size else travel.size)
        last = max(first, min(stop - round(BEFORE_STOP_S * IMPACT_HZ), first + round(AFTER_IMPACT_S * IMPACT_HZ)))
        impacts[name] = Impact(travel, body, scale, late_s, slice(first, last))
    return impacts


def free_fall(travel: FloatArray, body: FloatArray) -> tuple[float, float]:
    """Return scale and lateness (s) of the body's acceleration against the nose's travel while both fall freely.

    No force from outside acts: what an accelerometer on the body reads is alpha z'', alpha the nose's mass over both.
    A reading that is late by tau is alpha (z'' - tau z''').
    """
    low_pass = signal.butter(4, FREE_FALL_HZ, fs=IMPACT_HZ, output="sos")
    path, reading = (signal.sosfiltfilt(low_pass, each) for each in (travel, body))
    second = np.gradient(np.gradient(path, 1 / IMPACT_HZ), 1 / IMPACT_HZ)
    part = slice(*(round(each * IMPACT_HZ) for each in FREE_FALL_S))
    columns = np.stack([second, np.gradient(second, 1 / IMPACT_HZ), np.ones_like(second)], axis=1)[part]
    alpha, minus_late, _ = np.linalg.lstsq(columns, reading[part], rcond=None)[0]
    return float(alpha / NOSE_FRACTION), float(-minus_late / alpha)


def law_of_impact(impact: Impact) -> BenchLaw:
    """Return the law of the spring, of all that the library has."""
    return law_of_bench(impact.bench)


def saturation_n(found: BenchLaw) -> Estimate:
    """Return the force at which a spring saturates, K times the gap; empty where it does not.

    Beyond the gap the dead zone takes away what K adds.
    The ends are those of K times those of the gap, which errors of the two, of opposite signs, do not reach together.
    """
    stiffness = found.parameters.stiffness_n_per_m
    zone = found.law_estimates.get("dead_zone_stiffness")
    if zone is None or stiffness.value is None:
        return Estimate()
    beyond, gap = zone["stiffness_n_per_m"].value, zone["gap_m"]
    assert beyond is not None
    assert gap.value is not None
    if abs(stiffness.value + beyond) > 0.1 * stiffness.value:
        return Estimate()
    ends = None
    if stiffness.interval95 is not None and gap.interval95 is not None:
        ends = stiffness.interval95[0] * gap.interval95[0], stiffness.interval95[1] * gap.interval95[1]
    return Estimate(stiffness.value * gap.value, None, ends)


def static_tests(folder: Path) -> dict[str, list[tuple[FloatArray, FloatArray]]]:
    """Return travel from the first touch (m) and force (N) of the makers' slow tests, three of each spring."""
    tests = {}
    for path in sorted((folder / "water_impact").glob("static_force_test_*.csv")):
        table = -np.genfromtxt(path, delimiter=",", skip_header=1)
        pairs = []
        for k in range(0, table.shape[1], 2):
            travel, force = table[np.isfinite(table[:, k : k + 2]).all(axis=1), k : k + 2].T
            # the cell reads less than this where nothing touches it
            touch = travel[int(np.flatnonzero(force > 0.15)[0])]
            pairs.append((1e-3 * (travel - touch), force))
        tests[path.stem.removeprefix("static_force_test_")] = pairs
    return tests


def static_stiffness(pairs: list[tuple[FloatArray, FloatArray]], to_m: float) -> float:
    """Return the mean slope of slow tests, up and down, between the first touch and a travel, N/m."""
    slopes = []
    for travel, force in pairs:
        part = (travel > 0.05e-3) & (travel < to_m)
        slopes.append(np.polyfit(travel[part], force[part], 1)[0])
    return float(np.mean(slopes))


def static_saturation_n(pairs: list[tuple[FloatArray, FloatArray]], from_m: float) -> float:
    """Return the mean force of slow tests, up and down, beyond a travel, N."""
    return float(np.mean([force[travel > from_m].mean() for travel, force in pairs]))


SLIDING_HEAD = (
    "| record | period, s | friction at 0.06 m/s | at 0.15 m/s | farthest, mm | slides, s | explained, % |\n"
    "|---|---|---|---|---|---|---|"
)
IMPACT_HEAD = (
    "| record | law | K, N/mm | static test | C, N s/m | saturates at, N | sensors in free fall | explained, % |\n"
    "|---|---|---|---|---|---|---|---|"
)


def told(estimate: Estimate, form: str, factor: float = 1.0) -> str:
    """Return a number with its interval, as a table shows it."""
    if estimate.value is None:
        return "-"
    ends = estimate.interval95
    beside = " (no interval)" if ends is None else f" ({factor * ends[0]:{form}} to {factor * ends[1]:{form}})"
    return f"{factor * estimate.value:{form}}{beside}"


def sliding_rows(folder: Path) -> Iterator[str]:
    """Yield the table of the frame, line by line."""
    records = sliding_records(folder)
    sliding = {name: record for name, record in records.items() if record.slides.sum() >= LEAST_SAMPLES}
    fractions = mass_fractions(sliding)
    yield "fractions of the mass, base and floors: " + ", ".join(f"{each:.3f}" for each in fractions) + "\n"
    yield SLIDING_HEAD
    for name, record in records.items():
        far_mm, slides_s = 1e3 * np.abs(record.travel).max(), record.slides.sum() / FRAME_HZ
        if name not in sliding:
            fastest = np.abs(record.velocity).max()
            said = "no slip" if slides_s == 0 else "slides too little to tell"
            yield f"| {name} | {said}: at most {fastest:.3f} m/s | - | - | {far_mm:.1f} | {slides_s:.1f} | - |"
            continue
        found = law_of_sliding(record, fractions)
        slow, fast = (friction_coefficient(found, speed) for speed in SPEEDS_M_S)
        yield (
            f"| {name} | {told(period_s(found), '.2f')} | {slow:.4f} | {fast:.4f} | {far_mm:.0f} | {slides_s:.1f} | "
            f"{100 * found.r2_left_out:.1f} |"
        )


def impact_rows(folder: Path) -> Iterator[str]:
    """Yield the table of the falls, line by line."""
    tests = static_tests(folder)
    yield IMPACT_HEAD
    for name, impact in impact_records(folder).items():
        sensors = f"{impact.scale:.3f}, {1e3 * impact.late_s:.2f} ms late"
        if not impact.is_long_enough:
            yield f"| {name.removesuffix('_trial1')} | too short before the stop | - | - | - | - | {sensors} | - |"
            continue
        found = law_of_impact(impact)
        stiffness, _, _ = programmed(name)
        saturates = saturation_n(found)
        gap = found.law_estimates["dead_zone_stiffness"]["gap_m"].value if saturates.value is not None else None
        far_m = float(impact.travel[impact.after_impact].max()) if gap is None else gap
        static = static_stiffness(tests[f"{stiffness / 1e3:.0f}npmm"], far_m)
        damping, short = found.parameters.damping_n_s_per_m, name.removesuffix("_trial1")
        yield (
            f"| {short} | `{found.law.name}` | {told(found.parameters.stiffness_n_per_m, '.2f', 1e-3)} | "
            f"{static / 1e3:.2f} | {told(damping, '.1f')} | {told(saturates, '.2f')} | {sensors} | "
            f"{100 * found.r2_left_out:.1f} |"
        )
    slow = static_saturation_n(tests["15n_threshold"], 1.2e-3)
    yield f"\nslow test of the spring that is to saturate at 15 N: {slow:.2f} N"


SETS = {"sliding": sliding_rows, "impact": impact_rows}


if __name__ == "__main__":
    for each in sys.argv[2:] or SETS:
        print(f"\n{each}:\n")
        for line in SETS[each](Path(sys.argv[1])):
            print(line, flush=True)
