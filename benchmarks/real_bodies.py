"""`opid law` where no force was measured: a body that nothing but its suspension holds tells it by its acceleration.

Run `python benchmarks/real_bodies.py ../shared/data [sliding impact]`. The studies are sliding_isolators_bench.toml and
water_impact.toml in `examples/real_records`; `examples/real_records.py` says how their logs are made of the records,
which are not part of the project. docs/real_records.md says what comes out.

sliding: a frame of three storeys on friction pendulums. impact: a falling body and its nose, joined by an actuator that
plays a spring; before the water is reached both fall freely, which is a test of the sensors that asks no spring.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from harness import table_head

from opid.errors import InputError
from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.suspensions.bench.law import BenchLaw, law_of_bench

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from real_records import (
    FRAME_HZ,
    LEAST_SAMPLES,
    G,
    falling,
    folder_of,
    free_fall,
    mass_fractions,
    programmed,
    read_set,
    records_in,
    said_of_slip,
    sliding_records,
)

SPEEDS_M_S = (0.06, 0.15)


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
    for path in sorted(folder.glob("static_force_test_*.csv")):
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


SLIDING_TITLES = ("record", "period, s", "friction at 0.06 m/s", "at 0.15 m/s", "farthest, mm", "slides, s")
SLIDING_ASKED = "| asked | records agree within 3 % | within 10 % | within 10 % | | no slip where the base is fixed | |"
IMPACT_TITLES = ("record", "law", "K, N/mm", "static test", "C, N s/m", "saturates at, N", "sensors in free fall")
IMPACT_ASKED = "| asked (aim) | | within 3 % (1 %) of the static test | | | told | | |"


def told(estimate: Estimate, form: str, factor: float = 1.0) -> str:
    """Return a number with its interval, as a table shows it."""
    if estimate.value is None:
        return "-"
    ends = estimate.interval95
    beside = " (no interval)" if ends is None else f" ({factor * ends[0]:{form}} to {factor * ends[1]:{form}})"
    return f"{factor * estimate.value:{form}}{beside}"


def sliding_rows(data: Path) -> Iterator[str]:
    """Yield the table of the frame, line by line."""
    records = sliding_records(folder_of("sliding_isolators_bench", data))
    fractions = mass_fractions(tuple(records.values()))
    yield "fractions of the mass, base and floors: " + ", ".join(f"{each:.3f}" for each in fractions) + "\n"
    yield from (table_head(*SLIDING_TITLES, "explained, %"), SLIDING_ASKED)
    for name, record in records.items():
        far_mm, slides_s = 1e3 * np.abs(record.travel).max(), record.slides.sum() / FRAME_HZ
        if record.slides.sum() < LEAST_SAMPLES:
            told_of_it = f"{said_of_slip(record)}: at most {record.fastest_m_s:.3f} m/s"
            yield f"| {name} | {told_of_it} | - | - | {far_mm:.1f} | {slides_s:.1f} | - |"
            continue
        found = law_of_bench(read_set("sliding_isolators_bench", data, (name,)))
        slow, fast = (friction_coefficient(found, speed) for speed in SPEEDS_M_S)
        yield (
            f"| {name} | {told(period_s(found), '.2f')} | {slow:.4f} | {fast:.4f} | {far_mm:.0f} | {slides_s:.1f} | "
            f"{100 * found.r2_left_out:.1f} |"
        )


def impact_rows(data: Path) -> Iterator[str]:
    """Yield the table of the falls, line by line."""
    folder = folder_of("water_impact", data)
    tests = static_tests(folder)
    yield from (table_head(*IMPACT_TITLES, "explained, %"), IMPACT_ASKED)
    for name in records_in("water_impact", data):
        scale, late_s = free_fall(*falling(folder, name))
        sensors, short = f"{scale:.3f}, {1e3 * late_s:.2f} ms late", name.removesuffix("_trial1")
        try:
            study = read_set("water_impact", data, (name,))
        except InputError:
            yield f"| {short} | too short before the stop | - | - | - | - | {sensors} | - |"
            continue
        found = law_of_bench(study)
        stiffness, _, _ = programmed(name)
        saturates = saturation_n(found)
        gap = found.law_estimates["dead_zone_stiffness"]["gap_m"].value if saturates.value is not None else None
        far_m = float(study.recording.channel("travel").max()) if gap is None else gap
        static = static_stiffness(tests[f"{stiffness / 1e3:.0f}npmm"], far_m)
        damping = found.parameters.damping_n_s_per_m
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
