"""Do the stated 95 % intervals hold the truth in 95 % of cases?

Run `python benchmarks/interval_coverage.py` (`--seeds N`, 100 by default; `--method NAME`). Three questions:

1. the nominal gear, law searched, roads and noise drawn anew: spread of the estimates over the mean stated standard
   deviation;
2. random gears, laws, roads, rates and noise levels, law searched: spread of error over stated standard deviation;
3. the linear gear, law given: rms error of the mass over its Cramer-Rao bound.
"""

import argparse
from collections import Counter
from dataclasses import replace
from math import pi, sqrt

import numpy as np
from tqdm import tqdm
from trials import Case, Trial, study_of, trial

from opid.identify.classical import BAND_HZ
from opid.identify.spectral_equation import N_END_TERMS, equation_lines
from opid.mechanics.landing_gear import LandingGear, taxi_test
from opid.mechanics.laws import LINEAR, Law, law
from opid.mechanics.sensors import Sensor


def random_case(seed: int) -> Case:
    rng = np.random.default_rng([seed, 1])
    mass = rng.uniform(1000.0, 2800.0)
    stiffness = mass * (2 * pi * rng.uniform(1.4, 3.0)) ** 2
    damping = 2 * rng.uniform(0.05, 0.3) * sqrt(stiffness * mass)
    heavier = mass / 1850.0
    gear = LandingGear(
        sprung_mass_kg=mass,
        unsprung_mass_kg=105.0 * heavier,
        suspension_stiffness_n_per_m=stiffness,
        suspension_damping_n_s_per_m=damping,
        tyre_stiffness_n_per_m=6.2e5 * heavier,
        law=random_law(rng),
    )
    sensor = Sensor(noise_m_per_s2=1e-3 * rng.uniform(2.0, 10.0))
    road, fs = str(rng.choice(["A", "B", "C"])), float(rng.choice([256.0, 512.0, 1000.0]))
    settings = {"road_class": road, "fs": fs, "lower_sensor": sensor, "upper_sensor": sensor}
    return Case(gear, mass_removed_kg=mass * rng.uniform(0.08, 0.2), run=settings)


def random_law(rng: np.random.Generator) -> Law:
    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    kinds = (
        lambda: law("arctan_velocity", amplitude_n=between(100, 2000), scale_m_per_s=between(0.005, 0.05)),
        lambda: law("arctan_displacement", amplitude_n=between(100, 2000), scale_m=between(5e-4, 5e-3)),
        lambda: law("quadratic_damping", damping_n_s2_per_m2=between(1e4, 1e5)),
        lambda: law("cubic_stiffness", stiffness_n_per_m3=between(1e9, 1e10)),
    )
    return kinds[rng.integers(len(kinds))]()


def mass_bound(case: Case, seed: int) -> float:
    """Cramer-Rao bound of M2 for a linear gear, kg, its roads and noise levels given.

    The Fisher information is J^T J with J the derivatives of R/std(R) (`spectral_equation`) by k2, c2, k3, mu = 1/M2
    and the end terms of each run, at the noise-free spectra and the true parameters: R = 0 there, so that the
    weights need no derivative.
    """
    gear, sensor = case.gear, case.run["lower_sensor"]
    silent = {"lower_sensor": Sensor(0.0), "upper_sensor": Sensor(0.0)}
    test = taxi_test(gear, rng=np.random.default_rng(seed), mass_removed_kg=case.mass_removed_kg, **case.run | silent)
    study = study_of(test)
    mu = 1 / gear.sprung_mass_kg
    rows = []
    for place, run in enumerate(study.runs):
        lines = equation_lines(*study.accelerations(run), fs=study.fs, band_hz=BAND_HZ)
        omega, share = lines.omega, 1 / (1 + mu * run.mass_change_kg)
        moved = lines.unsprung - lines.sprung
        spring = share * mu * (gear.suspension_stiffness_n_per_m + 1j * omega * gear.suspension_damping_n_s_per_m)
        ground = share * mu * gear.ground_stiffness_n_per_m
        by_share = spring * moved - ground * lines.sprung
        ends = np.zeros((omega.size, len(study.runs) * N_END_TERMS), dtype=complex)
        first = place * N_END_TERMS
        ends[:, first : first + N_END_TERMS] = (1j * omega[:, None] / omega[-1]) ** np.arange(N_END_TERMS)
        by = [
            share * moved,
            share * 1j * omega * moved,
            -share * lines.sprung,
            -share * run.mass_change_kg * by_share,
        ]
        gain = np.sqrt(np.abs(spring) ** 2 + np.abs(spring + ground - omega**2) ** 2)
        # a line of white noise of rms s has variance s^2 n/fs^2, half of it in each part
        std = sensor.noise_m_per_s2 * sqrt(lines.travel.size / 2) / lines.fs * gain
        columns = np.column_stack([*by, ends]) / std[:, None]
        rows += [columns.real, columns.imag]
    jacobian = np.concatenate(rows)
    scale = np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.inv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
    return float(gear.sprung_mass_kg**2 * np.sqrt(covariance[3, 3]))


def print_coverage(title: str, trials: list[Trial], *, one_truth: bool) -> None:
    """One line for each parameter; a law's parameters from the trials in which the law is right."""
    given = [each for each in trials if each.reason is None]
    print(f"{title}: {len(trials)} trials, {len(trials) - len(given)} not determined, ", end="")
    print(f"law right in {sum(each.law_right for each in trials)}")
    wrong = Counter(f"{each.seed}: {each.law_name}" for each in trials if not each.law_right)
    print(f"  other laws found (seed: law): {', '.join(wrong) or 'none'}")
    header = ("n", "spread/std", "mean/its std", "coverage", "worst")
    print(f"  {'parameter':38s} " + " ".join(f"{word:>12s}" for word in header) + "  (seed)")
    for name in dict.fromkeys(name for each in trials for name in each.truth):
        shown = [each for each in given if np.isfinite(each.std.get(name, np.nan))]
        if len(shown) < 2:
            continue
        score = np.array([each.score(name) for each in shown])
        error = np.array([each.error[name] for each in shown])
        spread = error.std(ddof=1) / np.mean([each.std[name] for each in shown]) if one_truth else score.std(ddof=1)
        mean = score.mean() / (score.std(ddof=1) / sqrt(score.size))
        worst = shown[int(np.abs(score).argmax())]
        inside = 100 * np.mean(np.abs(score) < 1.96)
        figures = f"{score.size:12d} {spread:12.2f} {mean:12.1f} {inside:10.1f} % {worst.score(name):12.1f}"
        print(f"  {name:38s} {figures}  ({worst.seed})")
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100, help="trials of each kind")
    parser.add_argument("--method", default="classical", help="classical (the default) or model")
    options = parser.parse_args()
    seeds, method = range(options.seeds), options.method

    def progress(what: str):
        return tqdm(seeds, desc=what, unit="trial", disable=None)

    nominal = [trial(Case(LandingGear()), seed, method=method) for seed in progress("nominal")]
    print_coverage("nominal gear", nominal, one_truth=True)
    random = [trial(random_case(seed), seed, method=method) for seed in progress("random")]
    print_coverage("random gears", random, one_truth=False)

    sensor = Sensor()
    linear = Case(replace(LandingGear(), law=LINEAR), run={"lower_sensor": sensor, "upper_sensor": sensor})
    bounds = [mass_bound(linear, seed) for seed in progress("bound")]
    trials = [trial(replace(linear, law="linear"), seed, method=method) for seed in progress("linear")]
    print_coverage("linear gear, law given", trials, one_truth=True)
    error = np.array([each.error["M2"] for each in trials])
    print(f"linear gear, mass: Cramer-Rao bound          {np.mean(bounds):.2f} kg")
    print(f"                   stated standard deviation {np.mean([each.std['M2'] for each in trials]):.2f} kg")
    print(f"                   rms error                 {sqrt(np.mean(error**2)):.2f} kg")
    print(f"                   rms of error over bound   {sqrt(np.mean((error / bounds) ** 2)):.2f}")


if __name__ == "__main__":
    main()
