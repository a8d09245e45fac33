"""Real records of structures measured below and above their suspensions, and of dampers and springs on the test bench.

    python examples/real_records.py isolated_building --data ../shared/data --out records
    python examples/real_records.py water_impact --records 5nthreshold_2mps_trial1 --data ../shared/data --out records

Copies the study file of the set from the folder real_records beside this script, writes the logs that it names beside
the copy, identifies them and writes the report. `opid identify records/isolated_building.toml --band 0.1 8` and
`opid law records/water_impact.toml` then do the same. The records are not part of this project: each set names its
origin. What was done to the signals of a set before they were logs, because no key of a study says it, stands at its
function.
"""

import argparse
import re
import shutil
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy import fft, signal

import opid

STUDIES = Path(__file__).parent / "real_records"
G = 9.80665
INCH_M, KIP_N = 0.0254, 4448.2216
FRAME_HZ, IMPACT_HZ, FRICTION_HZ, MR_HZ = 256.0, 5000.0, 1024.0, 3004.8
# the bench takes no shorter record
LEAST_SAMPLES = 200

# of the frame: the table hardly moves below, its accelerometer drifts there; above, the displacements hold noise
TABLE_FROM_HZ, FRAME_TO_HZ = 0.2, 10.0
# about twice the speed that the sensors show between a table and a base that is bolted to it
SLIDES_M_S = 0.05

# of the makers' model: mass of the nose of the falling body over that of both
NOSE_FRACTION = 0.228
# begins and ends where body and nose fall freely and their spring still rings, s after the release
FREE_FALL_S = (0.02, 0.13)
FREE_FALL_HZ = 200.0
# of the useful part after the impact, and before the nose comes near its stop
AFTER_IMPACT_S, BEFORE_STOP_S, NEAR_STOP_M = 0.15, 0.01, 5e-3

VOLTAGES = ("voltage_on", "voltage_off", "voltage_not_told")
# the magneto-rheological damper answers a step of the voltage within about this time
SETTLED_S = 0.02

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RecordSet:
    """What a study file does not say of its set.

    Args:
        log: of a folder with the set, and of the name of a record.
        band_hz: in which the set tells of its suspension; None on the test bench.
        records: of such a folder, on the test bench: the records that it has.
        folder: where it is not called as the set.
    """

    log: Callable[[Path, str], opid.Recording]
    band_hz: tuple[float, float] | None = None
    records: Callable[[Path], Sequence[str]] | None = None
    folder: str = ""


def isolated_building(folder: Path, record: str) -> opid.Recording:
    """Return the table and the mean of six floors: the forces of the isolators accelerate all of the mass.

    Somebody filtered the signals.
    """
    data = np.load(folder / f"{record}.npz")
    floors = np.mean([data[f"level{level}_a"] for level in range(6)], axis=0)
    return opid.signals.recording_from_arrays([data["ground_a"], floors], ["ground", "floors"], fs=float(data["fs_hz"]))


def shake_table_frame(folder: Path, record: str) -> opid.Recording:
    """Return the ground and the top of a frame, on one clock.

    The sensors are turned against each other, gravity is in them, and each has a clock of its own: each signal is
    turned to the direction in which it moves most, both are brought to one clock by their stamps and to one gain by the
    gravity that they read. One is late by an amount that nobody stated, which is left to the fit.
    """
    data = np.load(folder / f"{record}.npz")
    sides, fs = [], 120.0
    stamps = [data[f"{floor}_packet_time_us"].astype(np.float64) * 1e-6 for floor in ("ground_floor", "top_floor")]
    begin_s = max(each[1] for each in stamps)
    end_s = min(each[-1] for each in stamps)
    time_s = np.arange(begin_s, end_s, 1.0 / fs)
    for floor, own in zip(("ground_floor", "top_floor"), stamps, strict=True):
        # the first row is zero; stamps are those of packets: a straight line through them is the sensor's clock
        row = np.arange(own.size)
        clock_s = np.polyval(np.polyfit(row[1:], own[1:], 1), row)
        acceleration = data[f"{floor}_acc"].astype(np.float64)[1:]
        acceleration *= G / np.linalg.norm(acceleration.mean(axis=0))
        along = _main_direction(acceleration)
        sides.append(np.interp(time_s, clock_s[1:], along))
    if sides[0] @ sides[1] < 0:  # a frame this stiff goes with its ground
        sides[1] = -sides[1]
    return opid.signals.recording_from_arrays(sides, ["ground", "top"], fs=fs)


def _main_direction(acceleration: FloatArray) -> FloatArray:
    """The acceleration along the direction in which a sensor moves most."""
    centred = acceleration - acceleration.mean(axis=0)
    return np.asarray(centred @ np.linalg.svd(centred, full_matrices=False)[2][0])


def sliding_isolators(folder: Path, record: str) -> opid.Recording:
    """Return the table and the mean of base and floors, whose displacements twice differentiated are good to 3 Hz."""
    with np.load(folder / "frame_256Hz.npz") as data:
        fs = float(data["fs"])
        table = G * data[f"{record}/aextx"]
        path = INCH_M * np.mean([data[f"{record}/s{channel}"] for channel in (2, 3, 4, 5)], axis=0)
    return opid.signals.recording_from_arrays([table, _twice(path, fs)], ["table", "frame"], fs=fs)


def quarter_car_bench(folder: Path, record: str) -> opid.Recording:
    """Return the tyre plate and the body plate, from encoders with steps of a few micrometres."""
    data = np.load(folder / f"{record}.npz")
    fs = 1.0 / float(np.median(np.diff(data["time_s"])))
    sides = [_twice(data[f"{plate}_plate_m"], fs) for plate in ("tyre", "body")]
    return opid.signals.recording_from_arrays(sides, ["tyre", "body"], fs=fs)


def _twice(path_m: FloatArray, fs: float) -> FloatArray:
    """Second derivative of a displacement, by central differences of a local parabola over 25 ms."""
    length = max(5, 2 * round(0.0125 * fs) + 1)
    return np.asarray(signal.savgol_filter(path_m, length, 3, deriv=2, delta=1.0 / fs))


@dataclass(frozen=True, eq=False)
class Sliding:
    """One record of the frame on its isolators.

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


def sliding_isolators_bench(folder: Path, record: str) -> opid.Recording:
    """Return force for each kilogram, travel and velocity of the isolators, and where they slide.

    The mean acceleration of base and floors, weighted by their masses, is the force of the isolators for each kilogram.
    """
    records = sliding_records(folder)
    one = records[record]
    columns = [mass_fractions(tuple(records.values())) @ one.floors, one.travel, one.velocity, one.slides]
    names, units = ["frame", "travel", "velocity", "slides"], ["m/s^2", "m", "m/s", "1"]
    return opid.signals.recording_from_arrays(columns, names, fs=FRAME_HZ, unit=units)


@cache
def sliding_records(folder: Path) -> dict[str, Sliding]:
    """Return the frame on sliding isolators and, as a control, bolted to the table.

    The table is measured by its acceleration, base and floors by their displacement.
    """
    records = {}
    with np.load(folder / "frame_256Hz.npz") as file:
        for name in sorted({key.split("/")[0] for key in file if "/" in key}):
            table = _in_band(G * file[f"{name}/aextx"].astype(np.float64), (TABLE_FROM_HZ, FRAME_TO_HZ), -2)
            paths = [INCH_M * file[f"{name}/s{channel}"].astype(np.float64) for channel in (2, 3, 4, 5)]
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


@cache
def mass_fractions(records: tuple[Sliding, ...]) -> FloatArray:
    """Return how the mass is shared by base and floors, which nobody stated: (4,), the base first.

    While the base slides, sum_i w_i a_i = -(K z + C v + mu sgn v + F0), K to F0 of each record, w of the frame: linear
    least squares. With wrong fractions the frame's own swinging would be left over.

    Args:
        records: those that slide for fewer samples than the bench takes as a record do not count.
    """
    sliding = [record for record in records if record.slides.sum() >= LEAST_SAMPLES]
    rows, forces = [], []
    for k, record in enumerate(sliding):
        moving, v = record.slides, record.velocity
        law = np.zeros((int(moving.sum()), 4 * len(sliding)))
        own = np.stack([record.travel, v, np.sign(v), np.ones_like(v)], axis=1)
        law[:, 4 * k : 4 * k + 4] = own[moving]
        rows.append(np.concatenate([law, (record.floors[1:] - record.floors[0]).T[moving]], axis=1))
        forces.append(-record.floors[0][moving])
    floors = np.linalg.lstsq(np.concatenate(rows), np.concatenate(forces), rcond=None)[0][-3:]
    return np.concatenate([[1 - floors.sum()], floors])


def water_impact(folder: Path, record: str) -> opid.Recording:
    """Return the acceleration of a falling body and the travel of its nose, from the impact until near the stop.

    How late the acceleration is was found in the free fall before.
    """
    travel, body = falling(folder, record)
    row = np.arange(travel.size)
    body = np.interp(row + free_fall(travel, body)[1] * IMPACT_HZ, row, body)
    # the release is the first sample
    first = round(programmed(record)[2] / G * IMPACT_HZ)
    near = np.flatnonzero(travel[first:] > NEAR_STOP_M)
    stop = first + (int(near[0]) if near.size else travel.size)
    last = min(stop - round(BEFORE_STOP_S * IMPACT_HZ), first + round(AFTER_IMPACT_S * IMPACT_HZ))
    # a fall that ends on the stop at once leaves too little for a law, which is said when it is read
    part = slice(first, max(first + 2, last))
    return opid.signals.recording_from_arrays(
        [body[part], travel[part]], ["body", "travel"], fs=IMPACT_HZ, unit=["m/s^2", "m"]
    )


def falling(folder: Path, record: str) -> tuple[FloatArray, FloatArray]:
    """Return travel of the nose into the body (m) and acceleration of the body, positive downwards (m/s^2)."""
    with np.load(folder / "impacts_5kHz.npz") as file:
        travel, body = (file[f"{record}/{channel}"].astype(np.float64) for channel in ("pos", "ay"))
    return 1e-3 * travel, G * body


def programmed(name: str) -> tuple[float, float | None, float]:
    """Return what a fall is named after: stiffness N/m, force at which the spring saturates N, speed m/s.

    >>> programmed("5npmm_2mps_trial1"), programmed("20nthreshold_6mps_trial1")
    ((5000.0, None, 2.0), (15000.0, 20.0, 6.0))
    """
    found = re.match(r"(\d+)n(pmm|threshold)_(\d+)mps", name)
    assert found is not None, name
    number, speed = float(found[1]), float(found[3])
    return (1e3 * number, None, speed) if found[2] == "pmm" else (15e3, number, speed)


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


def mr_damper(folder: Path, record: str) -> opid.Recording:
    """Return force, travel and velocity of a magneto-rheological damper, and where its voltage is held as named."""
    with np.load(folder / "random_first_half.npz") as file:
        force, travel, velocity, volts = (file[name].astype(np.float64).ravel() for name in "FDVY")
    is_on = volts > 0.5 * (volts.min() + volts.max())
    changed = np.flatnonzero(np.diff(is_on)) + 1
    since = np.zeros(is_on.size, dtype=np.int64)
    since[changed] = changed
    settled = (np.arange(is_on.size) - np.maximum.accumulate(since)) / MR_HZ > SETTLED_S
    held = dict(zip(VOLTAGES, (is_on & settled, ~is_on & settled, np.ones_like(is_on)), strict=True))
    columns = [force, travel / 100, velocity / 100, held[record]]
    names, units = ["force", "travel", "velocity", "held"], ["N", "m", "m/s", "1"]
    return opid.signals.recording_from_arrays(columns, names, fs=MR_HZ, unit=units)


def friction_damper_brfd(folder: Path, record: str) -> opid.Recording:
    """Return force, travel and velocity of a band-brake friction damper, which were recorded in kip and inches."""
    with np.load(folder / "brfd.npz") as file:
        table = file[next(each for each in file if _short(each) == record)].astype(np.float64)
    columns = [table[:, 2] * KIP_N, table[:, 1] * INCH_M, table[:, 3] * INCH_M]
    return opid.signals.recording_from_arrays(
        columns, ["force", "travel", "velocity"], fs=FRICTION_HZ, unit=["N", "m", "m/s"]
    )


def _short(name: str) -> str:
    return name.split("__")[-1].removesuffix("amplitude")


def _friction_tests(folder: Path) -> tuple[str, ...]:
    with np.load(folder / "brfd.npz") as file:
        return tuple(map(_short, file))


def _falls(folder: Path) -> tuple[str, ...]:
    with np.load(folder / "impacts_5kHz.npz") as file:
        return tuple(sorted({key.split("/")[0] for key in file}))


SETS = {
    "isolated_building": RecordSet(isolated_building, (0.1, 8.0)),
    "shake_table_frame": RecordSet(shake_table_frame, (0.5, 30.0)),
    "sliding_isolators": RecordSet(sliding_isolators, (0.15, 3.0)),
    "quarter_car_bench": RecordSet(quarter_car_bench, (0.3, 10.0)),
    "sliding_isolators_bench": RecordSet(sliding_isolators_bench, records=sliding_records, folder="sliding_isolators"),
    "water_impact": RecordSet(water_impact, records=_falls),
    "mr_damper": RecordSet(mr_damper, records=lambda folder: VOLTAGES),
    "friction_damper_brfd": RecordSet(friction_damper_brfd, records=_friction_tests),
}


def folder_of(name: str, data: Path) -> Path:
    """Return the folder with the records of a set."""
    return data / (SETS[name].folder or name)


def records_in(name: str, data: Path) -> tuple[str, ...]:
    """Return the records that the folder of a set of the test bench has."""
    listed = SETS[name].records
    assert listed is not None, name
    return tuple(listed(folder_of(name, data)))


def records_of(name: str) -> tuple[str, ...]:
    """Return the records that the study of a set names."""
    document = tomllib.loads((STUDIES / f"{name}.toml").read_text())
    runs = document["runs"] if "runs" in document else [document["bench"]]
    return tuple(Path(run["log"]).stem for run in runs)


def write_logs(name: str, data: Path, folder: Path, records: Sequence[str] = ()) -> Path:
    """Write the study of a set and the logs that it names into a folder, and return the study file.

    Args:
        name: of the set.
        data: folder that holds the sets.
        folder: for study and logs; made where it is not there.
        records: those to take in place of the ones that the study names, one on the test bench; all else stays as it
            says.
    """
    study, target = STUDIES / f"{name}.toml", folder / f"{name}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    if records:
        document = tomllib.loads(study.read_text())
        if "bench" in document:
            (record,) = records
            document |= {"title": record, "bench": document["bench"] | {"log": f"{record}.csv"}}
        else:
            document["runs"] = [document["runs"][0] | {"name": each, "log": f"{each}.csv"} for each in records]
        target.write_text(tomli_w.dumps(document))
    else:
        shutil.copy(study, target)
    for each in records or records_of(name):
        opid.write_log(SETS[name].log(folder_of(name, data), each), folder / f"{each}.csv")
    return target


def read_set(
    name: str, data: Path, records: Sequence[str] = ()
) -> opid.suspensions.Study | opid.suspensions.BenchStudy:
    """Return the study of a set, whose files are there while it is read; as `write_logs`."""
    with tempfile.TemporaryDirectory() as folder:
        return opid.read_study(write_logs(name, data, Path(folder), records))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=SETS, nargs="?", default="shake_table_frame", help="which set")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder that holds the sets")
    parser.add_argument("--records", help="names joined by commas; those of the study file where left out")
    parser.add_argument("--law", help="to fit, or on the bench to choose from; searched where left out")
    parser.add_argument("--out", type=Path, default=Path("real_records_result"), help="for study, logs and report")
    options = parser.parse_args()
    if not folder_of(options.set, options.data).is_dir():
        print(f"The records of {options.set} are not in {options.data}: give their folder with --data.")
        return
    records = options.records.split(",") if options.records else ()
    study = opid.read_study(write_logs(options.set, options.data, options.out, records))
    if isinstance(study, opid.suspensions.BenchStudy):
        kinds = None if options.law is None else options.law.split("+")
        found = opid.suspensions.law_of_bench(study, candidates=kinds, progress=lambda step: print("...", step))
    else:
        found = opid.identify(
            study, law=options.law, band_hz=SETS[options.set].band_hz, progress=lambda step: print("...", step)
        )
    print(opid.text(found))
    opid.write_report(found, options.out / f"{options.set}_report")
    print(f"Report: {options.out / f'{options.set}_report'}")


if __name__ == "__main__":
    main()
