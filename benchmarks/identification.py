"""Time and memory of one identification of two 40 s runs at 512 Hz, and a plain reference in the same process.

Run `python benchmarks/identification.py`. The reference is what one writes in an afternoon with scipy: each run is
integrated twice, every signal passes the same zero-phase 0.3 Hz high-pass, the law (known to it) is fitted to -x2''
over (z, z') by `curve_fit`, and the mass follows from the two ratios K2/M2. Everything is timed after one call of
each, best of several; memory is the peak of what Python and numpy allocate in one call.
"""

import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import integrate, optimize, signal
from trials import study_of

from opid.identify.classical import classical_chain
from opid.identify.identification import identify_study
from opid.identify.result import Identification
from opid.identify.study import Study
from opid.mechanics.landing_gear import LandingGear, taxi_test

N_SEEDS, N_REPEATS = 5, 3
GEAR = LandingGear()
LAW_NAME = GEAR.law.name


def reference(study: Study) -> tuple[float, float, float]:
    """Mass, stiffness and friction force by high-pass, trapezoidal rule, curve_fit and two ratios."""
    high_pass = signal.butter(2, 0.3, "highpass", fs=study.fs, output="sos")
    margin = round(4 * study.fs)

    def force_per_mass(motion, k, c, a, s):
        z, v = motion
        return k * z + c * v + a * np.arctan(v / s)

    def filtered(samples):
        return signal.sosfiltfilt(high_pass, samples)

    def integral(samples):
        return integrate.cumulative_trapezoid(samples, dx=1 / study.fs, initial=0)

    fits = []
    for run in study.runs:
        lower, upper = study.accelerations(run)
        once = filtered(integral(filtered(upper - lower)))
        travel, velocity, target = filtered(integral(once)), filtered(once), -filtered(filtered(filtered(upper)))
        motion = np.stack([travel, velocity])[:, margin:-margin]
        fits.append(optimize.curve_fit(force_per_mass, motion, target[margin:-margin], p0=(200.0, 3.0, 0.1, 0.05))[0])
    (heavy, light), change = fits, study.runs[1].mass_change_kg
    mass = change * light[0] / (heavy[0] - light[0])
    # amplitude and scale may both have turned their sign
    return mass, heavy[0] * mass, abs(heavy[2] * mass) * np.pi / 2


def answer(found: Identification) -> tuple[float, float, float]:
    parameters, law = found.parameters, found.law_estimates[LAW_NAME]
    return (
        parameters["sprung_mass_kg"].value,
        parameters["suspension_stiffness_n_per_m"].value,
        law["amplitude_n"].value,
    )


def best_s(function: Callable[[], Any]) -> float:
    times = []
    for _ in range(N_REPEATS):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return min(times)


def peak_mib(function: Callable[[], Any]) -> float:
    tracemalloc.start()
    function()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20


def main() -> None:
    truth = np.array(
        [GEAR.sprung_mass_kg, GEAR.suspension_stiffness_n_per_m, GEAR.law.parameters[LAW_NAME]["amplitude_n"]]
    )
    studies = [study_of(taxi_test(GEAR, rng=np.random.default_rng(seed))) for seed in range(N_SEEDS)]
    first = studies[0]
    ways: dict[str, Callable[[Study], tuple[float, float, float]]] = {
        "classical, law searched": lambda study: answer(identify_study(study)),
        "classical, law given": lambda study: answer(identify_study(study, law=LAW_NAME)),
        "model, law searched": lambda study: answer(identify_study(study, method="model")),
        "model, law given": lambda study: answer(identify_study(study, method="model", law=LAW_NAME)),
        "plain reference, law given": reference,
    }
    errors = {
        name: np.median([np.abs(np.array(way(study)) / truth - 1) for study in studies], axis=0)
        for name, way in ways.items()
    }
    seconds = {name: best_s(lambda way=way: way(first)) for name, way in ways.items()}
    plain_s = seconds["plain reference, law given"]

    print(f"Two 40 s runs at 512 Hz; median error of {N_SEEDS} seeds, best time of {N_REPEATS}\n")
    print("| | time, s | over plain | peak memory, MiB | M2, % | K2, % | friction force, % |")
    print("|---|---|---|---|---|---|---|")
    for name, way in ways.items():
        memory = peak_mib(lambda way=way: way(first))
        percent = " | ".join(f"{100 * error:.2f}" for error in errors[name])
        print(f"| {name} | {seconds[name]:.2f} | {seconds[name] / plain_s:.1f} | {memory:.0f} | {percent} |")

    steps: list[tuple[str, float]] = []
    classical_chain(first, progress=lambda step: steps.append((step, time.perf_counter())))
    end = time.perf_counter()
    print("\nsteps of the search: ", end="")
    spans = zip(steps, [*steps[1:], ("", end)], strict=True)
    print(", ".join(f"{name} {after - begin:.2f} s" for (name, begin), (_, after) in spans))


if __name__ == "__main__":
    main()
