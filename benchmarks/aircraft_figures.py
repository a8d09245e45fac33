"""The figures of merit of the whole aircraft, as a Markdown table.

Run `python benchmarks/aircraft_figures.py`; in parts `--rows "independent,bending 8 Hz" --seeds 20 --jobs 2`. Seeds
count from 0 and none is dropped. Each seed is a random aircraft of 4 to 8 t on three gears (`random_aircraft`), taxied
twice for 40 s with and without a load of about a tenth of its mass, each time on a runway of its own; sensors on the
airframe stand 0.1 to 0.4 m beside the struts, every coordinate is stated with an error of 1 cm (one standard deviation;
in the row "within 1 cm" at most), all channels carry 5 mm/s2 of noise. Nothing is known of the laws. In the rows of
`FAULTS` a sensor of the left main gear is wrong, or all are, stated in the study or not; in the rows "ground spring" a
spring goes from the airframe to the ground at every gear. At last, over all rows of rigid aircraft of which an answer
is wanted, how many intervals hold.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import get_context
from time import perf_counter, process_time
from typing import NamedTuple

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from estimator import AircraftIdentification, AnyStudy, aircraft_study, gear_study, identify
from harness import read_names, table_head, table_row
from tqdm import tqdm

from opid.estimate import Estimate
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.study import MeasuredInterface, PointMass, StructureSettings
from opid.virtual.taxi_tests.aircraft import random_aircraft, with_bending
from opid.virtual.taxi_tests.airframe import Airframe
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_test

NOISE = 5e-3
TOLERANCE_M = 0.01
FS = 512.0
GROUND_N_PER_M = 1e5
GEARS = ("nose", "left", "right")


class Fault(NamedTuple):
    """What is wrong with which sensors, and what their data sheet says.

    Args:
        sensors: by channel; the others have noise alone.
        facts: of each sensor that the fault concerns, with a tolerance that holds the fault within 1.2 deviations.
        channels: that the facts are stated of.
    """

    sensors: dict[str, Sensor]
    facts: SensorFacts
    channels: tuple[str, ...]


BELOW, ABOVE = (tuple(f"{gear}_{side}_z" for gear in GEARS) for side in ("lower", "upper"))
# the same sizes as those of one gear, `scenarios.FAULTS`: the stated corner is 20 % above that of the sensors below,
# and 14 % below that of those on the body
FAULTS = {
    "gain 3 %": Fault(
        {"left_upper_z": Sensor(noise_m_per_s2=NOISE, gain=1.03)}, SensorFacts(gain_tolerance=0.03), ("left_upper_z",)
    ),
    "lag": Fault(
        {"left_upper_z": Sensor(noise_m_per_s2=NOISE, lag_s=1 / FS)},
        SensorFacts(lag_tolerance_s=1 / FS),
        ("left_upper_z",),
    ),
    "corners": Fault(
        dict.fromkeys(BELOW, Sensor(noise_m_per_s2=NOISE, corner_hz=0.33))
        | dict.fromkeys(ABOVE, Sensor(noise_m_per_s2=NOISE, corner_hz=0.462)),
        SensorFacts(corner_hz=0.396, corner_tolerance=0.3),
        BELOW + ABOVE,
    ),
}


class Row(NamedTuple):
    """What is simulated, and what is said of it.

    Args:
        coherent: whether the wheels run over one isotropic surface.
        bending_hz: frequency of a bending mode of the fuselage; None if it is stiff.
        kind: of structures that are tried.
        noise: stated, m/s^2; None if nothing is said.
        within: whether every coordinate is within 1 cm, evenly; else 1 cm is one standard deviation.
        fault: of `FAULTS`; None if the sensors are sound.
        stated: which sensors the study says it of: none "", those that have it "its own", or "all".
        ground_n_per_m: of a spring to the ground at every gear.
        fit_ground: whether the estimator may fit one.
        pushed: fraction of the airframe's motion that a force makes which nobody measures.
    """

    coherent: bool = False
    bending_hz: float | None = None
    kind: str = "rigid_body"
    noise: float | None = NOISE
    within: bool = False
    fault: str | None = None
    stated: str = ""
    ground_n_per_m: float = 0.0
    fit_ground: bool = True
    pushed: float = 0.0


ROWS = {
    "choice": Row(kind="auto"),
    "choice coherent": Row(coherent=True, kind="auto"),
    "independent": Row(),
    "coherent": Row(coherent=True),
    "within 1 cm": Row(within=True),
    "noise not stated": Row(noise=None),
    "bending 8 Hz": Row(bending_hz=8.0),
    "bending 8 Hz coherent": Row(coherent=True, bending_hz=8.0),
    # a ground spring cannot be stated, only allowed or ruled out: where it is ruled out a refusal is right
    "ground spring": Row(ground_n_per_m=GROUND_N_PER_M),
    "ground spring ruled out": Row(ground_n_per_m=GROUND_N_PER_M, fit_ground=False),
    **{
        f"{fault} {'stated' if stated else 'not stated'}": Row(fault=fault, stated=stated)
        for fault in FAULTS
        for stated in ("its own", "")
    },
    **{f"pushed {percent} %": Row(pushed=percent / 100) for percent in (1, 3, 10)},
    # one data sheet for all sensors: more is unknown than need be
    **{f"{fault} stated of all": Row(fault=fault, stated="all") for fault in ("gain 3 %", "lag")},
}
RIGHT_TO_REFUSE = ("bending 8 Hz", "bending 8 Hz coherent", "ground spring ruled out")
GROUPS = {"mass": ["mass"], "Ixx": ["Ixx"], "Iyy": ["Iyy"]} | {
    letter: [f"{letter} {gear}" for gear in GEARS] for letter in "KCFG"
}
Figures = dict[str, float]


def facts_of(gear: str, row: Row) -> dict[str, SensorPair]:
    """What the study says of the two sensors of a gear, as an argument of `MeasuredInterface`; nothing if nothing."""
    if row.fault is None or not row.stated:
        return {}
    _, facts, channels = FAULTS[row.fault]
    lower, upper = (
        facts if row.stated == "all" or f"{gear}_{side}_z" in channels else SensorFacts() for side in ("lower", "upper")
    )
    return {"facts": SensorPair(unsprung=lower, sprung=upper)}


def study_of(seed: int, row: Row) -> tuple[Airframe, AnyStudy]:
    """A random aircraft and the study of its two runs, coordinates off by 1 cm."""
    rng = np.random.default_rng([seed, 7])
    aircraft = random_aircraft(rng)
    if row.bending_hz:
        aircraft = with_bending(aircraft, frequency_hz=row.bending_hz)
    if row.ground_n_per_m:
        gears = tuple(replace(gear, ground_stiffness_n_per_m=row.ground_n_per_m) for gear in aircraft.gears)
        aircraft = replace(aircraft, gears=gears)
    places = {
        gear.name: (gear.x_m - rng.uniform(0.1, 0.4), gear.y_m - np.sign(gear.y_m) * rng.uniform(0.1, 0.4))
        for gear in aircraft.gears
    }
    loading = PointMass(rng.uniform(0.07, 0.13) * aircraft.mass_kg, rng.uniform(-0.5, 2.0), rng.uniform(-0.3, 0.3))
    test = taxi_test(
        aircraft,
        rng=rng,
        loadings=[[loading]],
        coherent_tracks=row.coherent,
        sprung_sensors=places,
        fs=FS,
        lower_sensor=Sensor(noise_m_per_s2=NOISE),
        upper_sensor=Sensor(noise_m_per_s2=NOISE),
        sensors=FAULTS[row.fault].sensors if row.fault else None,
        pushed_fraction=row.pushed,
    )

    def stated(place: tuple[float, float]) -> tuple[float, float]:
        x_m, y_m = place + TOLERANCE_M * (rng.uniform(-1, 1, 2) if row.within else rng.standard_normal(2))
        return float(x_m), float(y_m)

    interfaces = tuple(
        MeasuredInterface(
            gear.name,
            f"{gear.name}_upper_z",
            f"{gear.name}_lower_z",
            *stated((gear.x_m, gear.y_m)),
            *stated(places[gear.name]),
            **facts_of(gear.name, row),
        )
        for gear in aircraft.gears
    )
    runs = [
        (name, run.recording, loads)
        for name, run, loads in zip(("light", "heavy"), test.runs, test.loadings, strict=True)
    ]
    tolerance_m = TOLERANCE_M / np.sqrt(3) if row.within else TOLERANCE_M
    settings = StructureSettings(row.kind, position_tolerance_m=tolerance_m, noise_m_per_s2=row.noise)
    return aircraft, aircraft_study(f"aircraft {seed}", interfaces, runs, settings)


def figures(aircraft: Airframe, found: AircraftIdentification) -> Figures:
    """Relative errors in per cent, which intervals hold, and what was left."""
    out: Figures = {"residual": found.residual_over_noise, "rigid": float(found.structure == "rigid_body")}
    out["recommended"] = float(any(each.recommended and each.kind == "rigid_body" for each in found.candidates))
    truths = {
        "mass": (found.parameters.sprung_mass_kg, aircraft.mass_kg),
        "Ixx": (found.parameters.roll_inertia_kg_m2, aircraft.ixx_kg_m2),
        "Iyy": (found.parameters.pitch_inertia_kg_m2, aircraft.iyy_kg_m2),
    }
    right = True
    for gear, each in zip(aircraft.gears, found.interfaces, strict=True):
        right = right and each.law.name == gear.law.name
        if found.per_mass:
            # without a mass they have other units
            continue
        truths[f"K {gear.name}"] = (each.stiffness, gear.suspension_stiffness_n_per_m)
        truths[f"C {gear.name}"] = (each.damping, gear.suspension_damping_n_s_per_m)
        friction = each.law_estimates.get("arctan_velocity", {}).get("amplitude_n", Estimate())
        truths[f"F {gear.name}"] = (friction, gear.law.parameters["arctan_velocity"]["amplitude_n"])
        if gear.ground_stiffness_n_per_m and hasattr(each, "ground_stiffness"):
            truths[f"G {gear.name}"] = (each.ground_stiffness, gear.ground_stiffness_n_per_m)
    out["law right"] = float(right)
    for name, (estimate, truth) in truths.items():
        out[name] = 100 * abs(estimate.value / truth - 1) if estimate.value is not None else np.nan
        out[f"holds {name}"] = float(estimate.holds(truth)) if estimate.interval95 else np.nan
    truth = aircraft.x_cg_m
    out["holds x_cg"] = float(found.parameters.x_cg_m.holds(truth)) if found.parameters.x_cg_m.interval95 else np.nan
    for each in found.candidates:
        out[f"explains {each.kind} {', '.join(each.interfaces)}"] = float(each.explains)
        if each.kind != "rigid_body":
            out[f"ratio {each.kind} {', '.join(each.interfaces)}"] = each.residual_over_noise
            share = on_gears(aircraft, each.interfaces)
            value = each.sprung_mass_kg.value
            out[f"share {each.kind} {', '.join(each.interfaces)}"] = np.nan if value is None else value / share
    return out


def on_gears(aircraft: Airframe, names: tuple[str, ...]) -> float:
    """Mean of what rests on some gears, kg."""
    rows = np.array([[1.0, gear.y_m, -gear.x_m] for gear in aircraft.gears])
    shares = np.linalg.solve(rows.T, aircraft.mass_kg * np.array([1.0, aircraft.y_cg_m, -aircraft.x_cg_m]))
    return float(np.mean([shares[k] for k, gear in enumerate(aircraft.gears) if gear.name in names]))


def paper(aircraft: Airframe, study: AnyStudy) -> Figures:
    """The paper's chain, and the model of one gear, on the left main gear under a third of the load."""
    left = next(each for each in study.interfaces if each.name == "left")
    runs = [(run.name, run.recording, run.mass_change_kg / 3) for run in study.runs]
    alone = gear_study("left alone", runs, sprung=left.sprung, unsprung=left.unsprung)
    third = aircraft.mass_kg / 3
    out: Figures = {}
    for method in ("paper", "classical"):
        found = identify(alone, method=method)
        mass = found.parameters.sprung_mass_kg.value
        out[f"third by {method}"] = np.nan if mass is None else mass / third
    return out


def one(job: tuple[str, int]) -> tuple[str, int, Figures | str]:
    """One aircraft of one row."""
    name, seed = job
    try:
        aircraft, study = study_of(seed, ROWS[name])
        begun, begun_busy = perf_counter(), process_time()
        found = identify(study, ground=ROWS[name].fit_ground)
        spent = {"seconds": perf_counter() - begun, "busy": process_time() - begun_busy}
        beside = paper(aircraft, study) if ROWS[name].kind == "auto" else {}
        return name, seed, figures(aircraft, found) | beside | spent
    except Exception as error:
        return name, seed, f"{type(error).__name__}: {error}"


def lines(name: str, found: dict[int, Figures], failed: dict[int, str]) -> Iterator[str]:
    """What is printed of a row."""
    yield f"\n### {name}: {len(found)} aircraft, {len(failed)} failed"
    yield from (f"- seed {seed}: {error}" for seed, error in failed.items())
    if not found:
        return
    yield "\n" + table_head("", "median error %", "95th percentile %", "worst % (seed)", "interval holds")

    def column(key: str) -> np.ndarray:
        return np.array([each.get(key, np.nan) for each in found.values()])

    for label, keys in GROUPS.items():
        values = np.stack([column(key) for key in keys])
        held = np.concatenate([column(f"holds {key}") for key in keys])
        n = int(np.isfinite(held).sum())
        if np.isnan(values).all():
            yield table_row(label, "not told", "", "", "withheld")
            continue
        share = f"{int(np.nansum(held))} of {n}" if n else "withheld"
        worst = np.fmax.reduce(values)
        farthest = f"{np.nanmax(worst):.3f} ({list(found)[int(np.nanargmax(worst))]})"
        yield table_row(label, f"{np.nanmedian(values):.3f}", f"{np.nanquantile(values, 0.95):.3f}", farthest, share)
    told = int(np.isfinite(column("mass")).sum())
    held = column("holds x_cg")
    yield table_row("x_cg", "", "", "", f"{int(np.nansum(held))} of {int(np.isfinite(held).sum())}")
    residual = column("residual")
    yield (
        f"\nmass told of {told} of {len(found)}; "
        f"residual over noise {np.median(residual):.3f} median, {residual.max():.3f} at most (seed "
        f"{list(found)[int(residual.argmax())]}); law right "
        f"{int(column('law right').sum())} of {len(found)}; rigid body recommended {int(column('recommended').sum())} "
        f"of {len(found)}; {np.median(column('seconds')):.1f} s median, {column('seconds').max():.1f} s at most "
        f"(of the processor {np.median(column('busy')):.1f} and {column('busy').max():.1f} s)"
    )
    keys = sorted({key for each in found.values() for key in each})
    for key in [key for key in keys if key.startswith("ratio")]:
        ratio, share = column(key), column(key.replace("ratio", "share"))
        explained = int(np.nansum(column(key.replace("ratio", "explains"))))
        yield (
            f"- {key[6:]}: residual over noise {np.nanmedian(ratio):.1f} median, {np.nanmin(ratio):.2f} at least, "
            f"taken for right {explained} times; mass over what rests there {np.nanmin(share):.2f} to "
            f"{np.nanmax(share):.2f}"
        )
    for key in [key for key in keys if key.startswith("third")]:
        values = column(key)
        if np.isnan(values).all():
            yield f"- left main gear alone under a third, {key[6:]}: no mass for any of {len(values)}"
            continue
        yield (
            f"- left main gear alone under a third, {key[6:]}: mass over a third of the truth "
            f"{np.nanmedian(values):.2f} median, {np.nanmin(values):.2f} to {np.nanmax(values):.2f}; none for "
            f"{int(np.isnan(values).sum())}"
        )


def coverage(found: list[Figures]) -> Iterator[str]:
    """Which share of the intervals of each quantity holds."""
    for label in (*GROUPS, "x_cg"):
        held = np.array([each.get(f"holds {key}", np.nan) for each in found for key in GROUPS.get(label, ["x_cg"])])
        n = int(np.isfinite(held).sum())
        if n:
            yield f"- {label}: {int(np.nansum(held))} of {n} intervals hold, {100 * np.nansum(held) / n:.1f} %"


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", help="names of rows, joined by commas; all where left out")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    names = read_names(parser, args.rows, ROWS, "row")
    rigid: list[Figures] = []
    for name in names:
        jobs = [(name, seed) for seed in range(args.first, args.first + args.seeds)]
        found: dict[int, Figures] = {}
        failed: dict[int, str] = {}
        with get_context("spawn").Pool(args.jobs) as pool:
            for _, seed, result in tqdm(
                pool.imap(one, jobs), total=len(jobs), desc=name, disable=not sys.stderr.isatty()
            ):
                if isinstance(result, str):
                    failed[seed] = result
                else:
                    found[seed] = result
        print("\n".join(lines(name, found, failed)), flush=True)
        rigid += found.values() if name not in RIGHT_TO_REFUSE else []
    print("\n" + "\n".join(coverage(rigid)), flush=True)


if __name__ == "__main__":
    main()
