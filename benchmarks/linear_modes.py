"""Linear modes from impacts beside the truth: structures with known modes, and worlds in which an assumption fails.

    python benchmarks/linear_modes.py [--seeds 20] [--first 0] [--jobs 1] [--worlds NAME,...]

Each seed hits a structure five times at each drive point with a soft pulse of random height; every channel has noise of
1 % of its rms. `cubic`, `case 1` and `case 2` are the structures of the virtual sine-beat series, so slightly hit that
their joints do not slip; `two drive points` hits case 2 at two places. The other worlds are those of case 1 with
accelerations that are 50 µs late (`late`) or 2 % too large (`gain`), one sensor that is so late that its phase at the
highest mode is 1 rad (`late sensor`), another sensor named as the drive point (`wrong point`), a record that ends while
the structure still moves (`cut`), hits up to as hard as the highest sine beats, so that joints slip (`hard`; in `hard
alike` all have nearly one height), and a force that counts in the other direction (`turned`). No seed is dropped. A
mode that is left out and an answer that is refused are counted.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from harness import quantiles, read_names, run_all, seeds_parser, share, table_head, table_row

from opid.mechanics.rig import FORCE, impact
from opid.modal.forced.excitation import quiet_s
from opid.modal.linear.fitted_modes import FittedModes
from opid.modal.linear.frequency_response import measured_response
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.linear.response_fit import fit_modes
from opid.signals.recording import Recording
from opid.virtual.modal_tests.series import virtual_series

N_HITS = 5
"""Hits at each drive point."""


@dataclass(frozen=True)
class World:
    """How a structure is hit and recorded.

    Args:
        case: of the virtual series.
        n_drives: number of drive points.
        hardest: peak of the hardest hit over that of one that reaches the highest sine beat.
        lightest: peak of the lightest hit over that of the hardest.
        late_s: delay of the accelerations.
        gain: factor on the accelerations.
        kept: fraction of the record that is kept.
        sign: of the force.
        late_rad: phase by which the first sensor is late at the highest mode.
        named: index of the sensor that is named as the drive point; the right one where None.
    """

    case: str = "1"
    n_drives: int = 1
    hardest: float = 1e-3
    lightest: float = 0.1
    late_s: float = 0.0
    gain: float = 1.0
    kept: float = 1.0
    sign: int = 1
    late_rad: float = 0.0
    named: int | None = None


WORLDS = {
    "cubic": World("cubic"),
    "case 1": World("1"),
    "case 2": World("2"),
    "two drive points": World("2", n_drives=2),
    "late": World("1", late_s=5e-5),
    "gain": World("1", gain=1.02),
    "late sensor": World("1", late_rad=1.0),
    "wrong point": World("1", named=1),
    "cut": World("1", kept=0.1),
    "hard": World("1", hardest=1.0),
    "hard alike": World("1", hardest=1.0, lightest=0.9),
    "turned": World("1", sign=-1),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one seed of a world: errors in % and what holds, one entry for each mode that is given.

    Args:
        world: its name.
        seed: the seed.
        n_modes: elastic modes in the band.
        n_wrong: modes that are given and are none of the structure.
        frequency: errors of the natural frequencies, %.
        damping: errors of the damping ratios, %.
        mass: errors of the modal masses, %.
        shape: errors of the shapes, % of the largest entry of each.
        holds: whether the intervals of the first three hold; None where none is given.
        seconds: of the processor.
        said: the reason of a refusal, or the warnings.
    """

    world: str
    seed: int
    n_modes: int
    n_wrong: int
    frequency: tuple[float, ...]
    damping: tuple[float, ...]
    mass: tuple[float, ...]
    shape: tuple[float, ...]
    holds: tuple[tuple[bool | None, ...], ...]
    seconds: float
    said: str


def hit(world: World, drive: str, rng: np.random.Generator, n_hits: int) -> tuple[Iterator[Recording], LinearModes]:
    """Return the records of hits at a drive point, and the true modes."""
    series = virtual_series(world.case, shaker=False)
    case, modes = series.case, series.case.modes
    rig = replace(case.rig, drive_point=case.rig.sensors[modes.sensors.index(drive)])
    # The pulse has 16 samples, so that its spectrum is that of what acted.
    pulse_s = 0.6 / float(modes.frequency_hz.max())
    fs = 16 / pulse_s
    elastic = [int(index) + 1 for index in np.flatnonzero(modes.elastic)]
    duration_s = max(quiet_s(modes, mode, decay_to=1e-3) for mode in elastic) + 0.05
    push, omega = np.abs(modes.row(case.drive_point)), np.sqrt(modes.stiffness())
    tops = [
        series.top_m_per_s2 / (float(np.abs(modes.shapes[:, mode - 1]).max()) * omega[mode - 1] * push[mode - 1])
        for mode in case.nonlinear_modes
    ]
    peak_n = world.hardest * min(tops) * np.pi / (2 * pulse_s)

    def record() -> Iterator[Recording]:
        for _ in range(n_hits):
            height = peak_n * float(rng.uniform(world.lightest, 1.0))
            run = impact(rig, peak_n=height, pulse_s=pulse_s, fs=fs, duration_s=duration_s, rng=rng).recording
            samples, force = run.samples.copy(), run.index(FORCE)
            others = [k for k in range(samples.shape[1]) if k != force]
            frequency_hz = np.fft.rfftfreq(len(samples), 1 / fs)[:, np.newaxis]
            late = np.exp(-2j * np.pi * frequency_hz * world.late_s)
            samples[:, others] = np.fft.irfft(np.fft.rfft(samples[:, others], axis=0) * late, len(samples), axis=0)
            own = run.index(modes.sensors[0])
            turned = np.exp(-1j * world.late_rad * frequency_hz[:, 0] / float(modes.frequency_hz.max()))
            samples[:, own] = np.fft.irfft(np.fft.rfft(samples[:, own]) * turned, len(samples))
            samples[:, others] *= world.gain
            samples[:, force] *= world.sign
            yield replace(run, samples=samples[: round(world.kept * len(samples))])

    return record(), modes


def run(job: tuple[str, int]) -> Outcome:
    """Identify the modes of one seed of a world."""
    world, rng = WORLDS[job[0]], np.random.default_rng(job[1])
    series = virtual_series(world.case, shaker=False)
    modes = series.case.modes
    far = modes.sensors[int(np.argmax(np.abs(modes.shapes[:, modes.elastic]).sum(axis=1)))]
    drives = [series.case.drive_point, far][: world.n_drives]
    responses = []
    for drive in drives:
        records, _ = hit(world, drive, rng, N_HITS)
        tests = [modal_test(each, modes, name=str(k), force=FORCE, drive_point=drive) for k, each in enumerate(records)]
        response = measured_response(tests)
        named = drive if world.named is None else modes.sensors[world.named]
        responses.append(replace(response, drive_point=named))
    true_hz, begun = modes.frequency_hz[modes.elastic], time.process_time()
    band_hz = (0.7 * float(true_hz.min()), 1.1 * float(true_hz.max()))
    try:
        found = fit_modes(responses, band_hz=band_hz)
    except ValueError as error:
        seconds = time.process_time() - begun
        return Outcome(*job, true_hz.size, 0, (), (), (), (), (), seconds, f"refused: {error}")
    return compare(job, modes, drives, found, time.process_time() - begun)


def compare(job: tuple[str, int], modes: LinearModes, drives: list[str], found: FittedModes, seconds: float) -> Outcome:
    """Return the errors of the modes that were found."""
    errors, shape, holds, wrong = [], [], [], 0
    for k, frequency in enumerate(found.frequency_hz):
        mode = int(np.argmin(np.abs(modes.frequency_hz - (frequency.value or 0.0))))
        if abs((frequency.value or 0.0) / modes.frequency_hz[mode] - 1) > 0.01:
            wrong += 1
            continue
        drive = max(drives, key=lambda name: abs(found.shapes[found.sensors.index(name), k]))
        mass_kg = found.modal_mass_kg[k].value or np.nan
        # The modal mass is that at the drive point at which the mode moves most clearly.
        drive = min(drives, key=lambda name: abs(mass_kg * found.shapes[found.sensors.index(name), k] ** 2 - 1))
        true = (
            modes.shapes[:, mode] if found.has_scale else modes.shapes[:, mode] / _find_largest(modes.shapes[:, mode])
        )
        off = np.sign(float(np.nansum(true * found.shapes[:, k]))) * found.shapes[:, k] - true
        shape.append(100 * float(np.nanmax(np.abs(off)) / np.max(np.abs(true))))
        truths = modes.frequency_hz[mode], modes.damping_ratio[mode], 1 / modes.row(drive)[mode] ** 2
        estimates = frequency, found.damping_ratio[k], found.modal_mass_kg[k]
        errors.append(
            tuple(100 * ((one.value or np.nan) / true - 1) for one, true in zip(estimates, truths, strict=True))
        )
        holds.append(
            tuple(
                None if one.value is None else one.holds(float(true))
                for one, true in zip(estimates, truths, strict=True)
            )
        )
    columns = tuple(zip(*errors, strict=True)) or ((), (), ())
    said = " | ".join(found.warnings)
    return Outcome(*job, int(modes.elastic.sum()), wrong, *columns, tuple(shape), tuple(holds), seconds, said)


def _find_largest(shape: np.ndarray) -> float:
    """Return the entry of a shape with the largest size."""
    return float(shape[int(np.argmax(np.abs(shape)))])


def describe(one: Outcome) -> str:
    """Return the line of one seed."""
    worst = ", ".join(
        f"{name} {quantiles([abs(x) for x in each], 0.5, 1.0) if each else '-'} %"
        for name, each in (
            ("frequency", one.frequency),
            ("damping", one.damping),
            ("mass", one.mass),
            ("shape", one.shape),
        )
    )
    counts = f"{len(one.holds)} of {one.n_modes} modes, {one.n_wrong} wrong"
    return f"{one.world} {one.seed}: {counts}, {worst}; {one.seconds:.1f} s {one.said[:200]}"


def main() -> None:
    """Print a line for each seed, and the table of the worlds."""
    parser = seeds_parser(__doc__, seeds=20, what="structures hit")
    parser.add_argument("--worlds", help="names joined by commas; all where left out")
    options = parser.parse_args()
    worlds = read_names(parser, options.worlds, WORLDS, "world")
    jobs = [(world, seed) for world in worlds for seed in range(options.first, options.first + options.seeds)]
    found = run_all(run, jobs, describe, processes=options.jobs)
    hold = "intervals that hold: "
    error = "error, median / worst %"
    print(
        table_head(
            "world", "seeds", "refused", "modes given", "wrong modes", f"frequency: {error}", f"damping: {error}",
            f"modal mass: {error}", f"shape: {error}", f"{hold}frequency", "damping", "mass",
        )
    )  # fmt: skip
    for world in worlds:
        own = [each for each in found if each.world == world]
        given = [each for each in own if not each.said.startswith("refused")]
        columns = []
        for name in ("frequency", "damping", "mass", "shape"):
            sizes = [abs(x) for one in given for x in getattr(one, name) if np.isfinite(x)]
            columns.append(quantiles(sizes, 0.5, 1.0) if sizes else "-")
        held = [share([each[k] for one in given for each in one.holds if each[k] is not None]) for k in range(3)]
        modes = f"{sum(len(one.holds) for one in given)} of {sum(one.n_modes for one in given)}"
        wrong = sum(one.n_wrong for one in given)
        print(table_row(world, len(own), len(own) - len(given), modes, wrong, *columns, *held))


if __name__ == "__main__":
    main()
