"""The figures of merit of the nonlinear modal models, as a Markdown table.

Run `python benchmarks/modal_figures.py`; in parts `--rows cubic,iwan --seeds 5 --jobs 2`. Seeds count from 0 and none
is dropped. Noise is white on force and accelerations, its standard deviation 1 % of the rms of each record; the rows
"1 % of the peak" have it at 1 % of the largest value instead, some ten times as much. `--silverbox FILE` adds the
measured Duffing circuit (SNLS80mV.csv of the benchmark of Wigren and Schoukens), which is not part of the project.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import read_names, table_head, table_row
from silverbox import silverbox_rows
from tqdm import tqdm

from opid.mechanics.rig import Rig, rig_run
from opid.mechanics.structure import Joint, Sliders, Structure, iwan
from opid.modal.couplings import Product, expand_joint
from opid.modal.forced.equation import mode_lines
from opid.modal.forced.excitation import SineBeat, quiet_s, sine_beat_voltage
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.restoring_fit import fit_unweighted
from opid.modal.identification import identify_modes
from opid.modal.linear.modes import LinearModes, ModalTest, modal_filter, modal_test, with_sensors
from opid.modal.model import NonlinearModalModel
from opid.modal.power_laws import power_law
from opid.modal.resonance.appropriation import appropriate_force, levels_for, modal_interaction
from opid.modal.result import ModalIdentification
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import Recording
from opid.signals.units import STANDARD_GRAVITY
from opid.virtual.modal_tests.bolted_structures import NOMINAL_COUPLING, case_study_2
from opid.virtual.modal_tests.series import CUBIC_DAMPING, CUBIC_STIFFNESS, virtual_series, virtual_study

FREQUENCY_HZ, ZETA, TOP, FS = 120.0, 0.004, 1e-3, 4096.0
OMEGA = 2 * np.pi * FREQUENCY_HZ
# -3 % of frequency and twice the damping at the top displacement TOP, m kg^1/2
K3 = -0.06 * 4 / 3 * OMEGA**2 / TOP**2
C2 = 2 * ZETA * 3 * np.pi / 8 / TOP
MODES = LinearModes([FREQUENCY_HZ], [ZETA], [[0.5]], ("a",))
LEVELS = (0.1, 0.3, 0.6, 1.0)
BEAT = SineBeat(FREQUENCY_HZ, 0.75, lead_s=0.05, tail_s=quiet_s(MODES, 1))
IWAN_SHARE, N_SLIDERS, SEGALMAN_SLIPS_AT = 0.10, 40, 2.0
# the truth must be finer than what is fitted to it: a frequency wrong by 1e-5 moves k3 by 0.1 %
STEPS_PER_SAMPLE = 8
N_LEVELS, TOP_G = 70, 300.0

Figures = dict[str, float]


def single_mode(kind: str) -> Structure:
    """The mode with its polynomial law, or with a joint that slips and holds a tenth of its stiffness."""
    if kind == "cubic":
        return NonlinearModalModel(MODES, {1: power_law({3: K3}, {2: C2})}).structure()
    held = IWAN_SHARE * OMEGA**2
    if kind == "iwan":
        # Iwan's own joint (1966): slip forces spread evenly, the last of which lets go at the top level
        slips = held * TOP * (np.arange(N_SLIDERS) + 0.5) / N_SLIDERS**2
        sliders = Sliders(np.full(N_SLIDERS, held / N_SLIDERS), slips)
    else:
        # Segalman's, with many that slip early: chi = -1/2 and beta = 1, slips altogether at 1.5 F_S / K_T
        sliders = iwan(stiffness_n_per_m=held, slip_force_n=SEGALMAN_SLIPS_AT * TOP * held / 1.5)
    joint = Joint("bolts", np.ones(1), stiffness_n_per_m=OMEGA**2 - held, sliders=sliders)
    return Structure(np.eye(1), np.array([[2 * ZETA * OMEGA]]), np.zeros((1, 1)), (joint,))


def run_beat(kind: str, amplitude: float) -> Recording:
    rig = Rig(single_mode(kind), MODES.row("a"), MODES.shapes, ("a",))
    voltage = sine_beat_voltage(replace(BEAT, amplitude=amplitude), FS)
    return rig_run(
        rig, voltage, fs=FS, rng=np.random.default_rng(0), noise_fraction=0.0, steps_per_sample=STEPS_PER_SAMPLE
    ).clean


def top_amplitude(kind: str) -> float:
    """The beat that brings the mode to its top displacement."""
    amplitude = 1.0
    for _ in range(12):
        reached = np.abs(run_beat(kind, amplitude).channel("a")).max() / (0.5 * OMEGA**2 * TOP)
        amplitude *= float(np.clip(1 / reached, 0.3, 3.0))
    return amplitude


def with_noise(clean: Recording, rng: np.random.Generator, of: str) -> Recording:
    size = clean.samples.std(axis=0) if of == "rms" else np.abs(clean.samples).max(axis=0)
    return replace(clean, samples=clean.samples + 0.01 * size * rng.standard_normal(clean.samples.shape))


def as_test(recording: Recording, name: str, modes: LinearModes = MODES) -> ModalTest:
    return modal_test(recording, modes, name=name, force="force", drive_point="a")


def beats_of(kind: str, seed: int, noise_of: str, truths: tuple[float, ...]) -> tuple[list[ModalTest], list[ModalTest]]:
    """Tests to fit at the four levels, and truth tests at others, each with noise of its own."""
    rng = np.random.default_rng(seed)
    made = [as_test(with_noise(CLEAN[kind][level], rng, noise_of), f"{level:g}") for level in LEVELS]
    return made, [as_test(with_noise(CLEAN[kind][level], rng, noise_of), f"truth {level:g}") for level in truths]


CLEAN: dict[str, dict[float, Recording]] = {}


def prepare() -> None:
    """Make the clean records once, before the processes part."""
    for kind in ("cubic", "iwan", "segalman"):
        top = top_amplitude(kind)
        CLEAN[kind] = {level: run_beat(kind, level * top) for level in (*LEVELS, 0.8, 1.5)}


def study_of(fits: list[ModalTest], truths: list[ModalTest], **settings: object) -> ModalStudy:
    tests = [*(StudyTest(test, "fit", 1) for test in fits), *(StudyTest(test, "truth") for test in truths)]
    # Virtual sensors are exact.
    exact = {"gain_tolerance": 0.0, **settings}
    return ModalStudy("beats", fits[0].modes, (1,), tuple(tests), "a", **exact)  # type: ignore[arg-type]


def cubic(seed: int, noise_of: str = "rms") -> Figures:
    fits, truths = beats_of("cubic", seed, noise_of, (0.8, 1.0))
    found = identify_modes(study_of(fits, truths, stiffness_order=3, damping_order=3, free_linear=False))
    fit = found.fits[0]
    printed = fit_unweighted([mode_lines(test, 1, fit.band_hz) for test in fits], stiffness_order=3, damping_order=3)
    figures = {
        "k3, %": 100 * (fit.stiffness[3].value / K3 - 1),
        "c2, %": 100 * (fit.damping[2].value / C2 - 1),
        "k3 of the printed least squares, %": 100 * (printed.stiffness()[3].value / K3 - 1),
        "c2 of the printed least squares, %": 100 * (printed.damping()[2].value / C2 - 1),
        "interval of k3 holds": float(fit.stiffness[3].holds(K3)),
        "interval of c2 holds": float(fit.damping[2].holds(C2)),
    }
    return figures | truth_figures(found)


def virtual_beats(seed: int) -> Figures:
    """The series that `opid simulate sine-beats` writes: an integration that is too coarse shows as a mean error."""
    start = perf_counter()
    study = virtual_study(virtual_series("cubic"), rng=np.random.default_rng(seed))
    seconds = perf_counter() - start
    fits = tuple(each for each in study.tests if each.use == "fit")
    found = identify_modes(
        replace(study, tests=fits, stiffness_order=3, damping_order=3, free_linear=False, gain_tolerance=0.0)
    )
    k, c = found.fits[0].stiffness, found.fits[0].damping
    return {
        "k3, %": 100 * (k[3].value / CUBIC_STIFFNESS[3] - 1),
        "c2, %": 100 * (c[2].value / CUBIC_DAMPING[2] - 1),
        "k2 (none in truth), of its standard deviation, %": 100 * k[2].value / k[2].std,
        "interval of k3 holds": float(k[3].holds(CUBIC_STIFFNESS[3])),
        "interval of k2 holds": float(k[2].holds(0.0)),
        "time to simulate, s": seconds,
    }


def cubic_loud(seed: int) -> Figures:
    return cubic(seed, "peak")


def truth_figures(found: object) -> Figures:
    figures = {}
    for test in found.truth_tests:  # type: ignore[attr-defined]
        each = test.sensors["a"]
        figures[f"peak, {test.name}, %"] = 100 * (each.peak_ratio_nonlinear - 1)
        figures[f"NRMSE, {test.name}, %"] = 100 * each.nrmse_nonlinear
        figures[f"linear model's peak, {test.name}, times"] = each.peak_ratio_linear
    return figures


def iwan_joint(seed: int, free: bool = False, kind: str = "iwan") -> Figures:
    fits, truths = beats_of(kind, seed, "rms", (0.8, 1.0, 1.5))
    return truth_figures(identify_modes(study_of(fits, truths, stiffness_order=3, damping_order=3, free_linear=free)))


def iwan_free(seed: int) -> Figures:
    return iwan_joint(seed, free=True)


def segalman(seed: int) -> Figures:
    return iwan_joint(seed, kind="segalman")


def segalman_free(seed: int) -> Figures:
    return iwan_joint(seed, free=True, kind="segalman")


def segalman_searched(seed: int) -> Figures:
    """The law is searched, with friction and slip; its exponent is -1/2."""
    fits, truths = beats_of("segalman", seed, "rms", (0.8, 1.0, 1.5))
    found = identify_modes(study_of(fits, truths))
    exponent = found.fits[0].joint_estimates.slip_exponent
    told = {
        "interval of the exponent holds": float(exponent.holds(-0.5)),
        "exponent of slip": float(exponent.value) if exponent.value is not None else float("nan"),
    }
    return truth_figures(found) | told


def off(seed: int) -> Figures:
    """Linear frequency stated 0.1 % and damping 5 % too high; the data decide whether they are corrected."""
    wrong = replace(MODES, frequency_hz=MODES.frequency_hz * 1.001, damping_ratio=MODES.damping_ratio * 1.05)
    fits, _ = beats_of("cubic", seed, "rms", ())
    fits = [replace(test, modes=wrong) for test in fits]
    fixed = fit_mode(fits, 1, stiffness_order=3, damping_order=3, free_linear=False)
    free = fit_mode(fits, 1, stiffness_order=3, damping_order=3)
    return {
        "k3, free linear, %": 100 * (free.stiffness[3].value / K3 - 1),
        "c2, free linear, %": 100 * (free.damping[2].value / C2 - 1),
        "k3, linear as stated, %": 100 * (fixed.stiffness[3].value / K3 - 1),
        "c2, linear as stated, %": 100 * (fixed.damping[2].value / C2 - 1),
        "the data asked for it": float(free.free_linear),
    }


def appropriation(seed: int, **structure: float) -> Figures:
    case = case_study_2(**structure)
    rng = np.random.default_rng(seed)
    levels = levels_for(case.rig, case.modes, 10, top_m_per_s2=TOP_G * STANDARD_GRAVITY, rng=rng, n_levels=N_LEVELS)
    done = appropriate_force(case.rig, case.modes, 10, levels_v=levels, rng=rng)
    found = modal_interaction(done)
    locked = [level.locked for level in done.levels]
    return {
        f"levels locked, of {N_LEVELS}": float(sum(locked)),
        "longest time to lock, s": max(level.lock_time_s for level in done.levels),
        "interaction flagged": float(found.flagged),
        "flagged from level": float("nan") if found.first_level is None else float(found.first_level),
    }


def coupled_below(seed: int) -> Figures:
    return appropriation(seed, ratio=1.99)


def coupled_above(seed: int) -> Figures:
    return appropriation(seed, ratio=2.02)


def detuned(seed: int) -> Figures:
    return appropriation(seed, ratio=2.2)


def uncoupled(seed: int) -> Figures:
    return appropriation(seed, ratio=2.02, coupling_n_per_m2=0.0)


def case_figures(case: str, seed: int, **settings: object) -> Figures:
    study = virtual_study(virtual_series(case), rng=np.random.default_rng(seed))
    start = perf_counter()
    found = identify_modes(replace(study, gain_tolerance=0.0, **settings))
    figures = {"time to identify, s": perf_counter() - start, "condition number": found.condition_number}
    if case == "2":
        figures |= plate_figures(found)
    for test in found.truth_tests:
        # of case 2 where the mode moves that is modelled: at the drive point, which has the largest shape
        sensors = list(test.sensors.values()) if case == "1" else [test.sensors[study.drive_point]]
        where = "of 25 sensors" if case == "1" else "at the drive point"
        peaks = np.array([sensor.peak_ratio_nonlinear - 1 for sensor in sensors])
        figures[f"peak, worst {where}, %"] = 100 * float(peaks[np.argmax(np.abs(peaks))])
        figures[f"NRMSE, median {where}, %"] = 100 * float(np.median([each.nrmse_nonlinear for each in sensors]))
        figures[f"NRMSE, worst {where}, %"] = 100 * max(each.nrmse_nonlinear for each in sensors)
        figures[f"NRMSE of the linear model, median {where}, %"] = 100 * float(
            np.median([each.nrmse_linear for each in sensors])
        )
        figures[f"linear model's peak, most {where}, times"] = max(each.peak_ratio_linear for each in sensors)
    seen = [each for fit in found.fits for each in fit.interactions] + [
        each for system in found.systems for each in system.couplings
    ]
    figures["interaction told by the beats"] = float(bool(seen))
    flagged = tuple(shift.mode for shift in found.shifts if shift.nonlinear)
    figures["level tests find the nonlinear modes"] = float(set(study.nonlinear) <= set(flagged))
    figures["modes flagged beside them"] = float(len(set(flagged) - set(study.nonlinear)))
    return figures


def plate_figures(found: ModalIdentification) -> Figures:
    """All sensors of the truth test of case 2, and the harmonic that mode 10 makes by driving mode 18."""
    (test,) = found.truth_tests
    errors = [each.nrmse_nonlinear for each in test.sensors.values()]
    spectra = [np.abs(np.fft.rfft(each.samples, axis=0)) for each in (test.measured, test.nonlinear)]
    frequency = np.fft.rfftfreq(test.measured.n_samples, 1 / test.measured.fs)
    second = [np.linalg.norm(each[(frequency > 760) & (frequency < 860)], axis=0) for each in spectra]
    largest = int(np.argmax(second[0]))
    return {
        "NRMSE, median of all sensors, %": 100 * float(np.median(errors)),
        "NRMSE, worst of all sensors, %": 100 * max(errors),
        "second harmonic where it is largest, %": 100 * float(second[1][largest] / second[0][largest] - 1),
    }


def coupled(seed: int) -> Figures:
    """The plate of case 2, its ratio 1.99 to 2.02 and its coupling 0.5 to 1.2 times the nominal, of either sign."""
    rng = np.random.default_rng([seed, 20])
    ratio, coupling = float(rng.uniform(1.99, 2.02)), float(rng.uniform(0.5, 1.2) * rng.choice([-1, 1]))
    case = case_study_2(ratio=ratio, coupling_n_per_m2=coupling * NOMINAL_COUPLING)
    study = virtual_study(replace(virtual_series("2"), case=case), rng=np.random.default_rng(seed))
    start = perf_counter()
    found = identify_modes(replace(study, gain_tolerance=0.0))
    figures: Figures = {
        "time to identify, s": perf_counter() - start,
        "interaction given as a coupling": float(bool(found.systems and found.systems[0].couplings)),
    }
    if not figures["interaction given as a coupling"]:
        return figures
    (joint,) = [each for each in case.rig.structure.joints if each.name == "asymmetry of the joint"]
    truth = expand_joint(
        {mode: float(joint.direction[mode - 1]) for mode in (10, 18)}, coupling * NOMINAL_COUPLING / 3, 3
    )
    known = {each.product: each.coefficient for each in found.systems[0].couplings}
    first = Product((10, 10, 18))
    figures["coefficient of q10^2 q18, %"] = 100 * (float(known[first].value) / truth[first] - 1)
    figures["interval of q10^2 q18 holds"] = float(known[first].holds(truth[first]))
    figures["relatives whose interval holds, %"] = 100 * float(
        np.mean([known[each].holds(truth[each]) if each in known else False for each in truth if each != first])
    )
    (test,) = found.truth_tests
    back = modal_filter(with_sensors(study.modes, test.measured.names)).T
    measured, model = test.measured.samples @ back, test.nonlinear.samples @ back
    for mode in (10, 18):
        error = np.linalg.norm((model - measured)[:, mode - 1]) / np.linalg.norm(measured[:, mode - 1])
        figures[f"NRMSE of mode {mode} in the truth test, %"] = 100 * float(error)
    return figures | {"warnings about it": float(len(found.systems[0].warnings))}


def case_1(seed: int) -> Figures:
    return case_figures("1", seed, stiffness_order=3, damping_order=3)


def case_1_searched(seed: int) -> Figures:
    return case_figures("1", seed)


def case_2(seed: int) -> Figures:
    return case_figures("2", seed)


def case_2_powers(seed: int) -> Figures:
    return case_figures("2", seed, stiffness_order=5, damping_order=5, couplings=())


ROWS: dict[str, tuple[str, Callable[[int], Figures]]] = {
    "cubic": ("cubic softening, quadratic damping, N = 3", cubic),
    "series": ("series of `opid simulate sine-beats`, N = 3", virtual_beats),
    "loud": ("the same, noise 1 % of the peak", cubic_loud),
    "off": ("linear frequency 0.1 %, damping 5 % off", off),
    "iwan": ("Iwan joint, N = 3", iwan_joint),
    "iwan_free": ("Iwan joint, N = 3, free linear", iwan_free),
    "segalman": ("Segalman's joint, N = 3", segalman),
    "segalman_searched": ("Segalman's joint, law searched", segalman_searched),
    "segalman_free": ("Segalman's joint, N = 3, free linear", segalman_free),
    "below": ("appropriation, ratio 1.99", coupled_below),
    "above": ("appropriation, ratio 2.02", coupled_above),
    "detuned": ("appropriation, ratio 2.2", detuned),
    "uncoupled": ("appropriation, ratio 2.02, uncoupled", uncoupled),
    "case1": ("case 1, N = 3, swept truth test", case_1),
    "case1_searched": ("case 1, orders searched", case_1_searched),
    "case2": ("case 2, law and coupling searched, highest beat", case_2),
    "case2_powers": ("case 2, N = 5, highest beat", case_2_powers),
    "coupled": ("case 2, ratio 1.99 to 2.02, coupling unknown", coupled),
}


def trial(job: tuple[str, int]) -> tuple[str, int, Figures]:
    row, seed = job
    return row, seed, ROWS[row][1](seed)


def lines_of(row: str, found: list[Figures]) -> Iterator[str]:
    for name in dict.fromkeys(key for figures in found for key in figures):
        values = np.array([figures[name] for figures in found if name in figures])
        if name.startswith(("interval", "level tests", "interaction", "the data")):
            text = f"{int(np.nansum(values))} of {len(found)}"
        elif name.endswith("%"):
            text = f"{values.mean():+.3f} +- {values.std():.3f}, worst {values[np.argmax(np.abs(values))]:+.3f}"
        else:
            text = f"{np.nanmin(values):.4g} to {np.nanmax(values):.4g}" if np.isfinite(values).any() else "-"
        yield table_row(ROWS[row][0], name, text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default=",".join(ROWS), help="of the table, joined by commas")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--silverbox", type=Path, help="SNLS80mV.csv")
    options = parser.parse_args()
    wanted = read_names(parser, options.rows, ROWS, "row")
    prepare()
    jobs = [(row, seed) for row in wanted for seed in range(options.seeds)]
    found: dict[str, list[Figures]] = {row: [] for row in wanted}
    with get_context("fork").Pool(options.jobs) as pool:
        for row, _, figures in tqdm(pool.imap(trial, jobs), total=len(jobs), file=sys.stderr, disable=None):
            found[row].append(figures)
    print(table_head("case", "figure", f"{options.seeds} seeds"))
    for row in wanted:
        print("\n".join(lines_of(row, found[row])))
    if options.silverbox:
        print("\n".join(silverbox_rows(options.silverbox)))


if __name__ == "__main__":
    main()
