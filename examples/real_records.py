"""Real records of structures that were measured below and above their suspensions, each as a study.

    python examples/real_records.py isolated_building --data ../shared/data --out isolated_building_result

Writes the logs and `study.toml` of the set, identifies them and writes the report. The records are not part of this
project: each set names its origin. What the sensors of a set are, and what was done to its signals before they were
logs, stands at its function.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import signal

import opid
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.study import Run, Study, study_of_gear
from opid.suspensions.study_file import write_study

G = 9.80665
INCH_M = 0.0254

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RecordSet:
    """One set of records as a study.

    Args:
        study: of a folder with the set, and of the names of the records.
        records: that are taken where none are named.
        band_hz: in which the set tells of its suspension.
    """

    study: Callable[[Path, tuple[str, ...]], Study]
    records: tuple[str, ...]
    band_hz: tuple[float, float]


def isolated_building(folder: Path, records: tuple[str, ...]) -> Study:
    """A five-storey building on rubber isolators on an outdoor shake table (BNCS, UCSD 2012): ratios alone.

    Below the isolators the table is measured, above them six floors. What the isolators carry moves as the mean of the
    floors: their forces accelerate all of the mass. Somebody filtered the signals.
    """
    runs = []
    for name in records:
        data = np.load(folder / f"{name}.npz")
        floors = np.mean([data[f"level{level}_a"] for level in range(6)], axis=0)
        log = opid.recording_from_arrays([data["ground_a"], floors], ["ground", "floors"], fs=float(data["fs_hz"]))
        runs.append(Run(name, log))
    return study_of_gear("base-isolated building", sprung="floors", unsprung="ground", runs=runs, axis="horizontal")


def shake_table_frame(folder: Path, records: tuple[str, ...]) -> Study:
    """A steel frame of one storey on a small shake table, one inertial sensor below and one on top.

    The sensors are turned against each other, gravity is in them, each has a clock of its own, and one is late by an
    amount that nobody stated: each signal is turned to the direction in which it moves most, both are brought to
    one clock by their stamps and to one gain by the gravity that they read, and the delay is left to the fit.
    """
    runs = []
    for name in records:
        data = np.load(folder / f"{name}.npz")
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
        runs.append(Run(name, opid.recording_from_arrays(sides, ["ground", "top"], fs=fs)))
    late = SensorPair(SensorFacts(), SensorFacts(lag_tolerance_s=20e-3, gain_tolerance=0.03))
    return study_of_gear(
        "frame on a shake table", sprung="top", unsprung="ground", runs=runs, sensors=late, axis="horizontal"
    )


def _main_direction(acceleration: FloatArray) -> FloatArray:
    """The acceleration along the direction in which a sensor moves most."""
    centred = acceleration - acceleration.mean(axis=0)
    return np.asarray(centred @ np.linalg.svd(centred, full_matrices=False)[2][0])


def sliding_isolators(folder: Path, records: tuple[str, ...]) -> Study:
    """A frame of three storeys on friction pendulums, or with a fixed base, on a shake table (NEES at Buffalo).

    The table is measured by its acceleration, base and floors by their displacement: twice differentiated, their mean
    is good to about 3 Hz.
    """
    data, runs = np.load(folder / "frame_256Hz.npz"), []
    fs = float(data["fs"])
    for name in records:
        table = G * data[f"{name}/aextx"]
        path = INCH_M * np.mean([data[f"{name}/s{channel}"] for channel in (2, 3, 4, 5)], axis=0)
        runs.append(Run(name, opid.recording_from_arrays([table, _twice(path, fs)], ["table", "frame"], fs=fs)))
    return study_of_gear("frame on sliding isolators", sprung="frame", unsprung="table", runs=runs, axis="horizontal")


def quarter_car(folder: Path, records: tuple[str, ...]) -> Study:
    """A bench of a quarter car: encoders of a few micrometres on the tyre plate and on the body plate."""
    runs = []
    for name in records:
        data = np.load(folder / f"{name}.npz")
        fs = 1.0 / float(np.median(np.diff(data["time_s"])))
        sides = [_twice(data[f"{plate}_plate_m"], fs) for plate in ("tyre", "body")]
        runs.append(Run(name, opid.recording_from_arrays(sides, ["tyre", "body"], fs=fs)))
    return study_of_gear("quarter car", sprung="body", unsprung="tyre", runs=runs)


def _twice(path_m: FloatArray, fs: float) -> FloatArray:
    """Second derivative of a displacement, by central differences of a local parabola over 25 ms."""
    length = max(5, 2 * round(0.0125 * fs) + 1)
    return np.asarray(signal.savgol_filter(path_m, length, 3, deriv=2, delta=1.0 / fs))


SETS = {
    "isolated_building": RecordSet(isolated_building, ("CNP100", "ICA50", "ICA100", "LAC100"), (0.1, 8.0)),
    "shake_table_frame": RecordSet(
        shake_table_frame,
        (
            "Stiff_1_story_-_El_Centro_Trial_1",
            "Stiff_1_story_-_El_Centro_Trial_2",
            "Stiff_1_story_-_Sine_Wave_Trial_1_2.0cm_2.0Hz",
        ),
        (0.5, 30.0),
    ),
    "sliding_isolators": RecordSet(
        sliding_isolators,
        ("fpgm111s1", "fpgm111s2", "fpgm152s1", "fpgm152s2", "fpgm162s1", "fpgm162s2"),
        (0.15, 3.0),
    ),
    "quarter_car_bench": RecordSet(quarter_car, ("run_1", "run_2", "run_3", "run_4"), (0.3, 10.0)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=SETS, nargs="?", default="shake_table_frame", help="which set")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder that holds the sets")
    parser.add_argument("--records", help="names joined by commas; the first of the set where left out")
    parser.add_argument("--law", help="to fit; searched where left out")
    parser.add_argument("--out", type=Path, help="folder of the study and the report; none where left out")
    options = parser.parse_args()
    chosen = SETS[options.set]
    if not (options.data / options.set).is_dir():
        print(f"The records of {options.set} are not in {options.data}: give their folder with --data.")
        return
    records = tuple(options.records.split(",")) if options.records else chosen.records
    study = chosen.study(options.data / options.set, records)
    found = opid.identify(study, law=options.law, band_hz=chosen.band_hz, progress=lambda step: print("...", step))
    print(opid.result_text(found))
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        write_study(study, options.out / "study.toml")
        opid.write_report(found, options.out / "report")
        print(f"Report: {options.out / 'report'}")


if __name__ == "__main__":
    main()
