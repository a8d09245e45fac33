"""Real records of structures that were measured below and above their suspensions, each by its study file.

    python examples/real_records.py isolated_building --data ../shared/data --out records

Copies the study file of the set from the folder real_records beside this script, writes the logs that it names beside
the copy, identifies them and writes the report. `opid identify records/isolated_building.toml --band 0.1 8` then does
the same. The records are not part of this project: each set names its origin. What was done to the signals of a set
before they were logs, because no key of a study says it, stands at its function.
"""

import argparse
import shutil
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy import signal

import opid

STUDIES = Path(__file__).parent / "real_records"
G = 9.80665
INCH_M = 0.0254

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RecordSet:
    """What a study file does not say of its set.

    Args:
        log: of a folder with the set, and of the name of a record.
        band_hz: in which the set tells of its suspension.
    """

    log: Callable[[Path, str], opid.Recording]
    band_hz: tuple[float, float]


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


SETS = {
    "isolated_building": RecordSet(isolated_building, (0.1, 8.0)),
    "shake_table_frame": RecordSet(shake_table_frame, (0.5, 30.0)),
    "sliding_isolators": RecordSet(sliding_isolators, (0.15, 3.0)),
    "quarter_car_bench": RecordSet(quarter_car_bench, (0.3, 10.0)),
}


def records_of(name: str) -> tuple[str, ...]:
    """Return the records that the study of a set names."""
    return tuple(run["name"] for run in tomllib.loads((STUDIES / f"{name}.toml").read_text())["runs"])


def write_logs(name: str, data: Path, folder: Path, records: Sequence[str] = ()) -> Path:
    """Write the study of a set and the logs that it names into a folder, and return the study file.

    Args:
        name: of the set.
        data: folder that holds the sets.
        folder: for study and logs; made where it is not there.
        records: those to take in place of the ones that the study names; all else stays as it says.
    """
    study, target = STUDIES / f"{name}.toml", folder / f"{name}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    if records:
        document = tomllib.loads(study.read_text())
        document["runs"] = [document["runs"][0] | {"name": each, "log": f"{each}.csv"} for each in records]
        target.write_text(tomli_w.dumps(document))
    else:
        shutil.copy(study, target)
    for each in records or records_of(name):
        opid.write_log(SETS[name].log(data / name, each), folder / f"{each}.csv")
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=SETS, nargs="?", default="shake_table_frame", help="which set")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder that holds the sets")
    parser.add_argument("--records", help="names joined by commas; those of the study file where left out")
    parser.add_argument("--law", help="to fit; searched where left out")
    parser.add_argument("--out", type=Path, default=Path("real_records_result"), help="for study, logs and report")
    options = parser.parse_args()
    if not (options.data / options.set).is_dir():
        print(f"The records of {options.set} are not in {options.data}: give their folder with --data.")
        return
    records = options.records.split(",") if options.records else ()
    study = opid.read_study(write_logs(options.set, options.data, options.out, records))
    found = opid.identify(
        study, law=options.law, band_hz=SETS[options.set].band_hz, progress=lambda step: print("...", step)
    )
    print(opid.text(found))
    opid.write_report(found, options.out / f"{options.set}_report")
    print(f"Report: {options.out / f'{options.set}_report'}")


if __name__ == "__main__":
    main()
