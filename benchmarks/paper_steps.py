"""The paper's chain as printed, and mended step by step: the mass that each state of it finds.

Run `python benchmarks/paper_steps.py --seeds 20`. The paper is Iwaniec & Uhl (2007). Each seed is a virtual taxi run of
the nominal gear (1850 kg, zeta 0.11, friction 400 N, sensor noise 5 mm/s^2, two runs of 40 s at 512 Hz, 220 kg
removed). Each row mends one step more than the row above it; the law is given, so that a row shows its own step and no
search. "Impossible" masses are below the 220 kg that were removed; the error is that of all masses, the impossible ones
among them.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import run_all, seeds_parser, table_head, table_row

from opid.signals.spectra import Transmissibility
from opid.suspensions import PaperChain, match_peaks, transmissibility_peaks, two_peak_mass
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.identification import identify_by_paper
from opid.suspensions.paper.printed import run_as_printed
from opid.suspensions.paper.restoring_force import fit_slice
from opid.suspensions.paper.settings import DEFAULTS, PrintedSettings
from opid.suspensions.paper.transmissibility import estimate_transmissibility, read_static_transmissibility
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

REMOVED_KG = 220.0


@dataclass(frozen=True)
class Job:
    """One seed at a damping ratio and a friction."""

    seed: int
    zeta: float
    friction_n: float

    @property
    def gear(self) -> LandingGear:
        usual = LandingGear()
        critical = 2 * np.sqrt(usual.suspension_stiffness_n_per_m * usual.sprung_mass_kg)
        law = usual.law.scaled(self.friction_n / usual.law.terms[0].amplitude)
        return replace(usual, suspension_damping_n_s_per_m=self.zeta * critical, law=law)


@dataclass(frozen=True)
class Outcome:
    """The mass of each state of the chain, kg, and T(0) where it takes part."""

    seed: int
    mass_kg: dict[str, float]
    static: dict[str, float]


def main() -> None:
    parser = seeds_parser(__doc__, seeds=10, what="taxi runs")
    parser.add_argument("--zeta", type=float, default=0.11, help="damping ratio")
    parser.add_argument("--friction", type=float, default=400.0, help="friction, N")
    args = parser.parse_args()
    jobs = [Job(seed, args.zeta, args.friction) for seed in range(args.first, args.first + args.seeds)]
    outcomes = run_all(mend, jobs, lambda each: f"seed {each.seed}", processes=args.jobs)
    print(f"\nZeta {args.zeta:g}, friction {args.friction:g} N, {len(jobs)} seeds; true: 1850 kg, T(0) = 1.\n")
    print(table_head("chain", "T(0), median", "M2, kg, median", "error, %, median / worst", "impossible"))
    for name in outcomes[0].mass_kg:
        masses = np.array([each.mass_kg[name] for each in outcomes])
        errors = np.abs(100 * (masses / jobs[0].gear.sprung_mass_kg - 1))
        static = [each.static[name] for each in outcomes if name in each.static]
        print(
            table_row(
                name,
                f"{np.median(static):.2f}" if static else "-",
                f"{np.median(masses):.0f}",
                f"{np.median(errors):.3g} / {errors.max():.3g}",
                f"{np.sum(masses < REMOVED_KG)} of {masses.size}",
            )
        )


def mend(job: Job) -> Outcome:
    """Simulate a seed, and return what each state of the chain gives."""
    test = taxi_test(job.gear, rng=np.random.default_rng(job.seed), mass_removed_kg=REMOVED_KG, duration_s=40, fs=512)
    runs = (Run("heavy", test.heavy.recording, 0.0), Run("light", test.light.recording, -REMOVED_KG))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs)
    found = identify_by_paper(study, law=job.gear.law.name)
    mass, static, chain = {}, {}, found.chain
    for name, estimate in STEPS.items():
        ratios = [estimate(run) for run in chain.runs]
        static[name] = read_static_transmissibility(ratios[0])
        mass[name] = mass_of_peaks(chain, ratios, static[name], restore_sign=False)
    last = list(STEPS)[-1]
    name = "+ T negative above its resonance"
    static[name] = static[last]
    mass[name] = mass_of_peaks(chain, [STEPS[last](run) for run in chain.runs], static[last], restore_sign=True)
    heavy, light = (run.complex_fit.value[0] for run in chain.runs)
    mass["+ a band of complex lines in the place of peaks"] = REMOVED_KG * light / (light - heavy)
    heavy, light = (run.spectral_fit.value[0] for run in chain.runs)
    mass["+ noise on both channels"] = REMOVED_KG * light / (light - heavy)
    mass["+ all runs in one problem: method classical"] = found.parameters.sprung_mass_kg.value or np.nan
    return Outcome(job.seed, mass, static)


def mass_of_peaks(chain: PaperChain, ratios: list[Transmissibility], static: float, *, restore_sign: bool) -> float:
    """Return M2 of the strongest credible pair of peaks, as `PaperChain.strongest_pair` chooses it."""
    band_hz = (PrintedSettings.lowest_peak_hz, DEFAULTS.highest_peak_hz)
    peaks = [transmissibility_peaks(each, band_hz=band_hz) for each in ratios]
    matches = match_peaks(*peaks, mass_change_kg=-REMOVED_KG)
    if not matches:
        return np.nan
    best = max(matches, key=lambda match: (match.credible, match.reference.magnitude))
    return two_peak_mass(
        best.reference,
        best.changed,
        mass_change_kg=-REMOVED_KG,
        static_transmissibility=static,
        restore_sign=restore_sign,
    ).sprung_mass_kg


def with_slope(run: RunEvidence) -> Transmissibility:
    """Return T as printed, the slope a of eq. (3) subtracted with the arctangent."""
    settings = replace(DEFAULTS, printed=PrintedSettings(subtracts_slope=True))
    return run_as_printed(run.unsprung, run.sprung, fs=run.fs, settings=settings).T


def with_motion(run: RunEvidence) -> Transmissibility:
    """Return T with eq. (3) fitted to the motion above the high-pass, and its force computed there."""
    amplitude, inside = PrintedSettings.amplitude_m_per_s2, run.motion.interior
    force = np.zeros(run.sprung[inside].size)
    for curve in run.slices:
        law = fit_slice(curve, amplitude_m_per_s2=amplitude).law
        force += law.force(run.motion.displacement, run.motion.velocity)[inside]
    settings = PrintedSettings().transmissibility
    return estimate_transmissibility(run.unsprung[inside], run.sprung[inside] + force, fs=run.fs, settings=settings)


def with_amplitude(run: RunEvidence) -> Transmissibility:
    """Return T with the fitted amplitude of the damping curve, which shows its arctangent, in the place of pi/2."""
    inside = run.motion.interior
    force = run.slice_fits[1].law.force(run.motion.displacement, run.motion.velocity)[inside]
    settings = PrintedSettings().transmissibility
    return estimate_transmissibility(run.unsprung[inside], run.sprung[inside] + force, fs=run.fs, settings=settings)


STEPS: dict[str, Callable[[RunEvidence], Transmissibility]] = {
    "as printed, with the slope of eq. (3) subtracted too": with_slope,
    "as printed": lambda run: run.printed.T,
    "+ only the motion above 0.3 Hz integrated": with_motion,
    "+ amplitude of the arctangent fitted": with_amplitude,
    "+ Hann window, 8 s blocks, 50 % overlap, law of all runs": lambda run: run.T_subtracted,
    "+ force as a second input": lambda run: run.T_without_force,
}

if __name__ == "__main__":
    main()
