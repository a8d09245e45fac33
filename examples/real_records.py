"""Real records of structures measured below and above their suspensions, and of dampers and springs on the test bench.

    python examples/real_records.py isolated_building --data ../shared/data --out records
    python examples/real_records.py water_impact --records 5nthreshold_2mps_trial1 --data ../shared/data --out records
    python examples/real_records.py shake_table_frame --data my_frame.npz --law linear --out records

`--data` is the folder that holds the sets, or one with records of the set, or a file of them; what its files hold says
which records there are. `--records` names some of them; an unknown name ends in a list of those that are there. Copies
the study file of the set from the folder real_records beside this script, writes the logs that it names beside the
copy, identifies them and writes the report. `opid identify records/isolated_building.toml --band 0.1 8` and
`opid law records/water_impact.toml` then do the same. The records are not part of this project: each set names its
origin. What was done to the signals of a set before they were logs, because no key of a study says it, stands at its
function.
"""

import argparse
import re
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

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

# of the frame on the shake table: what an upper sensor reads beyond is its own shaking, and below its first bending
# mode each frame goes with its ground
SHAKE_BAND_HZ, WITH_GROUND_HZ = (0.5, 30.0), (0.5, 3.0)

# of the sliding frame: the table hardly moves below, its accelerometer drifts there; above, displacements hold noise
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


class Place(NamedTuple):
    """Where a record stands: its file, and what it is called there."""

    path: Path
    key: str


@dataclass(frozen=True)
class RecordSet:
    """What a study file does not say of its set.

    Args:
        log: of the folder or the file with the records, and of the name of a record.
        names: of the file's channels: the records that it holds; the file itself is one where nothing is said.
        band_hz: in which the set tells of its suspension; None on the test bench.
        folder: where it is not called as the set.
    """

    log: Callable[[Path, str], opid.Recording]
    names: Callable[[Sequence[str]], Iterable[str]] | None = None
    band_hz: tuple[float, float] | None = None
    folder: str = ""


def _places(name: str, folder: Path) -> dict[str, Place]:
    """Return where the records of a set stand, in a folder or a file.

    A name that several files have begins with that of its file.

    Raises:
        opid.InputError: there are none.
    """
    names, found = SETS[name].names, []
    for path in [folder] if folder.is_file() else sorted(folder.glob("*.npz")):
        with np.load(path) as file:
            found += [Place(path, key) for key in ([path.stem] if names is None else sorted(set(names(file.files))))]
    if not found:
        raise opid.InputError(f"there are no records of {name} in {folder}: give their folder, or a file, with --data")
    keys = [place.key for place in found]
    return {place.key if keys.count(place.key) == 1 else f"{place.path.stem}_{place.key}": place for place in found}


def _place(name: str, folder: Path, record: str) -> Place:
    """Return where a record of a set stands.

    Raises:
        opid.InputError: it is not there.
    """
    places = _places(name, folder)
    if record not in places:
        raise opid.InputError(f"there is no record {record!r} of {name} in {folder}: it has {', '.join(places)}")
    return places[record]


def _channels(path: Path, *names: str) -> list[FloatArray]:
    """Return channels of a file.

    Raises:
        opid.InputError: one is not there.
    """
    with np.load(path) as file:
        missing = [name for name in names if name not in file]
        if missing:
            raise opid.InputError(f"{path} has no {', '.join(missing)}: it holds {', '.join(sorted(file))}")
        return [file[name].astype(np.float64) for name in names]


def _parts(channels: Sequence[str]) -> list[str]:
    """The records of a file whose channels are called <record>/<channel>."""
    return [channel.split("/")[0] for channel in channels if "/" in channel]


def isolated_building(folder: Path, record: str) -> opid.Recording:
    """Return the table and the mean of its floors: the forces of the isolators accelerate all of the mass.

    Somebody filtered the signals.
    """
    path = _place("isolated_building", folder, record).path
    with np.load(path) as file:
        levels = [channel for channel in file if re.fullmatch(r"level\d+_a", channel)]
    fs, ground, *floors = _channels(path, "fs_hz", "ground_a", *(levels or ["level0_a"]))
    sides = [ground, np.mean(floors, axis=0)]
    return opid.signals.recording_from_arrays(sides, ["ground", "floors"], fs=float(fs))


def shake_table_frame(folder: Path, record: str) -> opid.Recording:
    """Return the ground and the mean of the floors of a frame, on one clock.

    The sensors are turned against each other, gravity is in them, and each has a clock of its own: each signal is
    turned to the direction in which it moves most, all are brought to one clock by their stamps and to one gain by the
    gravity that they read. One is late by an amount that nobody stated, which is left to the fit. The columns of the
    lowest storey accelerate all floors, which are taken to be alike.
    """
    path, fs = _place("shake_table_frame", folder, record).path, 120.0
    with np.load(path) as file:
        sensors = [channel.removesuffix("_acc") for channel in file if channel.endswith("_acc")]
    floors = [each for each in sensors if each != "ground_floor"] or ["top_floor"]
    names = [(f"{floor}_packet_time_us", f"{floor}_acc") for floor in ("ground_floor", *floors)]
    signals = [_channels(path, *both) for both in names]
    begin_s, end_s = max(1e-6 * stamps[1] for stamps, _ in signals), min(1e-6 * stamps[-1] for stamps, _ in signals)
    time_s = np.arange(begin_s, end_s, 1.0 / fs)
    sides: list[FloatArray] = []
    for stamps, acceleration in signals:
        # the first row is zero; stamps are those of packets: a straight line through them is the sensor's clock
        row = np.arange(1, stamps.size)
        clock_s = np.polyval(np.polyfit(row, 1e-6 * stamps[1:], 1), row)
        along = _main_direction(acceleration[1:] * (G / np.linalg.norm(acceleration[1:].mean(axis=0))), fs)
        sides.append(np.interp(time_s, clock_s, along))
        ground, own = (_band_passed(each, WITH_GROUND_HZ, fs) for each in (sides[0], sides[-1]))
        if ground @ own < 0:
            sides[-1] = -sides[-1]
    both = [sides[0], np.mean(sides[1:], axis=0)]
    return opid.signals.recording_from_arrays(both, ["ground", "floors"], fs=fs)


def _main_direction(acceleration: FloatArray, fs: float) -> FloatArray:
    """The acceleration along the direction in which a sensor moves most in the band of the set."""
    centred = acceleration - acceleration.mean(axis=0)
    return np.asarray(centred @ np.linalg.svd(_band_passed(centred, SHAKE_BAND_HZ, fs), full_matrices=False)[2][0])


def _band_passed(samples: FloatArray, band_hz: tuple[float, float], fs: float) -> FloatArray:
    return np.asarray(signal.sosfiltfilt(signal.butter(2, band_hz, "bandpass", fs=fs, output="sos"), samples, axis=0))


def sliding_isolators(folder: Path, record: str) -> opid.Recording:
    """Return the table and the mean of base and floors, whose displacements twice differentiated are good to 3 Hz."""
    table_g, *paths_inch = _sliding_channels(_place("sliding_isolators", folder, record))
    sides = [G * table_g, _twice(INCH_M * np.mean(paths_inch, axis=0), FRAME_HZ)]
    return opid.signals.recording_from_arrays(sides, ["table", "frame"], fs=FRAME_HZ)


def _sliding_channels(place: Place) -> list[FloatArray]:
    """Acceleration of the table, g, and displacements of base and floors, inch."""
    return _channels(place.path, *(f"{place.key}/{channel}" for channel in ("aextx", "s2", "s3", "s4", "s5")))


def quarter_car_bench(folder: Path, record: str) -> opid.Recording:
    """Return the tyre plate and the body plate, from encoders with steps of a few micrometres."""
    path = _place("quarter_car_bench", folder, record).path
    time_s, *plates_m = _channels(path, "time_s", "tyre_plate_m", "body_plate_m")
    fs = 1.0 / float(np.median(np.diff(time_s)))
    return opid.signals.recording_from_arrays([_twice(each, fs) for each in plates_m], ["tyre", "body"], fs=fs)


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

    @property
    def fastest_m_s(self) -> float:
        """Of the base over the table."""
        return float(np.abs(self.velocity).max())


def sliding_isolators_bench(folder: Path, record: str) -> opid.Recording:
    """Return force for each kilogram, travel and velocity of the isolators, and where they slide.

    The mean acceleration of base and floors, weighted by their masses, is the force of the isolators for each kilogram.

    Raises:
        opid.InputError: the base does not slide in the record, or too shortly.
    """
    _place("sliding_isolators_bench", folder, record)
    records = sliding_records(folder)
    one = records[record]
    if one.slides.sum() < LEAST_SAMPLES:
        slides = [name for name, each in records.items() if each.slides.sum() >= LEAST_SAMPLES]
        raise opid.InputError(
            f"the base {said_of_slip(one)} in {record}: it moves over the table at {one.fastest_m_s:.3f} m/s at the "
            f"most, and above {SLIDES_M_S} m/s it counts as sliding, which a law needs for {LEAST_SAMPLES} samples; "
            f"records that slide for so long: {', '.join(slides) or 'none'}"
        )
    columns = [mass_fractions(tuple(records.values())) @ one.floors, one.travel, one.velocity, one.slides]
    names, units = ["frame", "travel", "velocity", "slides"], ["m/s^2", "m", "m/s", "1"]
    return opid.signals.recording_from_arrays(columns, names, fs=FRAME_HZ, unit=units)


def said_of_slip(record: Sliding) -> str:
    """Return what the base does where it does not slide for long enough."""
    return "slides too little to tell" if record.slides.any() else "never slips"


@cache
def sliding_records(folder: Path) -> dict[str, Sliding]:
    """Return the frame on sliding isolators and, as a control, bolted to the table.

    The table is measured by its acceleration, base and floors by their displacement.
    """
    records = {}
    for name, place in _places("sliding_isolators_bench", folder).items():
        table_g, *paths_inch = _sliding_channels(place)
        table = _in_band(G * table_g, (TABLE_FROM_HZ, FRAME_TO_HZ), -2)
        paths = [INCH_M * path for path in paths_inch]
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
    first = round(programmed(_place("water_impact", folder, record).key)[2] / G * IMPACT_HZ)
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
    path, key = _place("water_impact", folder, record)
    travel_mm, body_g = _channels(path, f"{key}/pos", f"{key}/ay")
    return 1e-3 * travel_mm, G * body_g


def programmed(name: str) -> tuple[float, float | None, float]:
    """Return what a fall is named after: stiffness N/m, force at which the spring saturates N, speed m/s.

    Raises:
        opid.InputError: it is named otherwise.

    >>> programmed("5npmm_2mps_trial1"), programmed("20nthreshold_6mps_trial1")
    ((5000.0, None, 2.0), (15000.0, 20.0, 6.0))
    """
    found = re.match(r"(\d+)n(pmm|threshold)_(\d+)mps", name)
    if found is None:
        raise opid.InputError(
            f"the fall {name!r} does not say its spring and speed: a name begins like 5npmm_2mps or 15nthreshold_4mps"
        )
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
    path, key = _place("mr_damper", folder, record)
    force, travel, velocity, volts = (each.ravel() for each in _channels(path, *"FDVY"))
    is_on = volts > 0.5 * (volts.min() + volts.max())
    changed = np.flatnonzero(np.diff(is_on)) + 1
    since = np.zeros(is_on.size, dtype=np.int64)
    since[changed] = changed
    settled = (np.arange(is_on.size) - np.maximum.accumulate(since)) / MR_HZ > SETTLED_S
    held = dict(zip(VOLTAGES, (is_on & settled, ~is_on & settled, np.ones_like(is_on)), strict=True))
    columns = [force, travel / 100, velocity / 100, held[key]]
    names, units = ["force", "travel", "velocity", "held"], ["N", "m", "m/s", "1"]
    return opid.signals.recording_from_arrays(columns, names, fs=MR_HZ, unit=units)


def friction_damper_brfd(folder: Path, record: str) -> opid.Recording:
    """Return force, travel and velocity of a band-brake friction damper, which were recorded in kip and inches."""
    path, key = _place("friction_damper_brfd", folder, record)
    with np.load(path) as file:
        table = file[next(each for each in file if _short(each) == key)].astype(np.float64)
    if table.ndim != 2 or table.shape[1] < 4:
        raise opid.InputError(
            f"{record} in {path} has the shape {table.shape}: its columns are time, travel, force and velocity"
        )
    columns = [table[:, 2] * KIP_N, table[:, 1] * INCH_M, table[:, 3] * INCH_M]
    return opid.signals.recording_from_arrays(
        columns, ["force", "travel", "velocity"], fs=FRICTION_HZ, unit=["N", "m", "m/s"]
    )


def _short(name: str) -> str:
    return name.split("__")[-1].removesuffix("amplitude")


SETS = {
    "isolated_building": RecordSet(isolated_building, band_hz=(0.1, 8.0)),
    "shake_table_frame": RecordSet(shake_table_frame, band_hz=SHAKE_BAND_HZ),
    # its second bending mode swings at 11 Hz
    "flexible_frame": RecordSet(shake_table_frame, band_hz=(0.5, 6.0), folder="shake_table_frame"),
    "sliding_isolators": RecordSet(sliding_isolators, _parts, (0.15, 3.0)),
    "quarter_car_bench": RecordSet(quarter_car_bench, band_hz=(0.3, 10.0)),
    "sliding_isolators_bench": RecordSet(sliding_isolators_bench, _parts, folder="sliding_isolators"),
    "water_impact": RecordSet(water_impact, _parts),
    "mr_damper": RecordSet(mr_damper, lambda channels: VOLTAGES),
    "friction_damper_brfd": RecordSet(friction_damper_brfd, lambda channels: map(_short, channels)),
}


def folder_of(name: str, data: Path) -> Path:
    """Return the folder with the records of a set.

    Args:
        name: of the set.
        data: folder that holds the sets, or that with the records, or a file of them.
    """
    has_records = data.suffix == ".npz" or any(data.glob("*.npz"))
    return data if has_records else data / (SETS[name].folder or name)


def records_in(name: str, data: Path) -> tuple[str, ...]:
    """Return the records of a set that are there, as `folder_of`."""
    return tuple(_places(name, folder_of(name, data)))


def records_of(name: str) -> tuple[str, ...]:
    """Return the records that the study of a set names."""
    document = tomllib.loads((STUDIES / f"{name}.toml").read_text())
    runs = document["runs"] if "runs" in document else [document["bench"]]
    return tuple(Path(run["log"]).stem for run in runs)


def default_records(name: str, data: Path) -> tuple[str, ...]:
    """Return the records that the study of a set names, or all that are there where it names none of them."""
    there, named = records_in(name, data), records_of(name)
    return named if set(named) & set(there) else there


def write_logs(name: str, data: Path, folder: Path, records: Sequence[str] = ()) -> Path:
    """Write the study of a set and the logs that it names into a folder, and return the study file.

    Args:
        name: of the set.
        data: folder that holds the sets.
        folder: for study and logs; made where it is not there.
        records: those to take in place of the ones that the study names, one on the test bench; all else stays as it
            says.

    Raises:
        opid.InputError: a record or a channel of it is not there, several records of a test bench, or a frame that
            does not slide.
    """
    study, target = STUDIES / f"{name}.toml", folder / f"{name}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    if records:
        document = tomllib.loads(study.read_text())
        if "bench" in document:
            if len(records) > 1:
                raise opid.InputError(
                    f"a law is that of one record, and {len(records)} of {name} are given: take one, of "
                    f"{', '.join(records)}"
                )
            document |= {"title": records[0], "bench": document["bench"] | {"log": f"{records[0]}.csv"}}
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
    if not folder_of(options.set, options.data).exists():
        print(f"The records of {options.set} are not in {options.data}: give their folder with --data.")
        return
    try:
        identify_set(options)
    except (opid.InputError, opid.NotDeterminedError) as error:
        sys.exit(f"{options.set}: {error}")


def identify_set(options: argparse.Namespace) -> None:
    """Write study and logs, identify them, print the answer and write the report."""
    records = options.records.split(",") if options.records else default_records(options.set, options.data)
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
