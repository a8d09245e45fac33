"""A base-isolated building in an earthquake: its sliding bearings and its storeys from accelerometers on each floor.

    python examples/isolated_building.py --out isolated_building_result

The ground and every floor are measured and the masses are known; the earthquake is whatever it was. The recordings are
simulated, put your own in their place.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline

import opid
from opid.mechanics import Joint, Structure, time_response
from opid.plots import house_style
from opid.suspensions import StructureIdentification, identify_structure
from opid.virtual import Sensor, decimate, measure

FS, SECONDS, STEPS = 256.0, 40.0, 4
FLOORS = ("base", "floor1", "floor2", "roof")
MASS_KG = (45e3, 40e3, 40e3, 35e3)
# the truth: sliders with a friction of 4 % of the weight on springs for a period of 2 s
BEARING, BEARING_DAMPER, FRICTION, SCALE = 1.6e6, 5e4, 63e3, 0.02
STOREYS = {"storey1": (1.1e8, 2.0e5), "storey2": (1.0e8, 1.8e5), "storey3": (0.9e8, 1.6e5)}


def storeys(known: bool) -> list[Joint]:
    """Return the joints from floor to floor; without their values if these are to be found."""
    directions = np.diff(np.eye(len(FLOORS)), axis=0)
    return [
        Joint(name, direction, *(values if known else (0.0, 0.0)))
        for (name, values), direction in zip(STOREYS.items(), directions, strict=True)
    ]


def earthquake(rng: np.random.Generator) -> CubicSpline:
    """Return the acceleration of the ground, m/s^2: noise through soil of 2.5 Hz (Kanai & Tajimi) under an envelope."""
    n = round(FS * SECONDS)
    frequency = np.fft.rfftfreq(n, 1 / FS)
    ratio = frequency / 2.5
    soil = (1 + 1.2j * ratio) / (1 - ratio**2 + 1.2j * ratio)
    # no ground moves away, and none shakes above 20 Hz
    band = 1 / (1 - 1j * 0.25 / np.maximum(frequency, 1e-3)) ** 2 / (1 + (frequency / 20) ** 4)
    shaking = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * soil * band, n)
    t = np.arange(n) / FS
    envelope = np.minimum(t / 4, 1) ** 2 * np.exp(-np.maximum(t - 14, 0) / 6)
    ground = envelope * shaking
    return CubicSpline(t, 3.5 * ground / np.abs(ground).max())


def measured(rng: np.random.Generator) -> opid.Recording:
    """Return what the sensors on the ground and on the floors read in an earthquake, m/s^2."""
    bearing = Joint(
        "bearing",
        (1, 0, 0, 0),
        BEARING,
        BEARING_DAMPER,
        opid.law("coulomb_friction", amplitude_n=FRICTION, scale_m_per_s=SCALE),
    )
    none = np.zeros((len(FLOORS), len(FLOORS)))
    building = Structure(np.diag(MASS_KG), none, none, (bearing, *storeys(known=True)), FLOORS)
    ground = earthquake(rng)
    motion = time_response(
        building, lambda t: -np.outer(ground(t), MASS_KG), fs=STEPS * FS, duration_s=SECONDS - 1 / FS
    )
    below = ground(motion.time_s)[:, np.newaxis]
    true = decimate(np.hstack([below, motion.acceleration + below]), STEPS)
    sensor = Sensor(noise_m_per_s2=5e-3)
    readings = [measure(column, fs=FS, sensor=sensor, rng=rng) for column in true.T]
    return opid.signals.recording_from_arrays(readings, ["ground", *FLOORS], fs=FS)


def draw(found: StructureIdentification, path: Path) -> None:
    """Draw the force of the bearings over their travel."""
    bearing = found.interfaces["base"]
    z, v = bearing.travel, bearing.velocity
    fitted = bearing.stiffness.value * z + bearing.damping.value * v + bearing.law.force(z, v)
    true = BEARING * z + BEARING_DAMPER * v + FRICTION * np.tanh(v / SCALE)
    with house_style():
        figure, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
        ax.plot(1e3 * z, 1e-3 * true, color="0.7", linewidth=3, label="truth")
        ax.plot(1e3 * z, 1e-3 * fitted, linewidth=0.8, label="identified")
        ax.set(xlabel="travel of the bearings [mm]", ylabel="force of the bearings [kN]")
        ax.legend()
        figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("isolated_building_result"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)

    # 1. the masses are known, the joints between the floors are not; the ground is below the bearings
    none = np.zeros((len(FLOORS), len(FLOORS)))
    building = Structure(np.diag(MASS_KG), none, none, storeys(known=False), FLOORS)

    # 2. the law of the bearings is searched
    found = identify_structure(
        building,
        [measured(np.random.default_rng(0))],
        interfaces={"base": "ground"},
        sensors={name: name for name in FLOORS},
        unknown=list(STOREYS),
        progress=lambda step: print("...", step),
    )

    # 3. beside the truth
    bearing = found.interfaces["base"]
    print(f"law of the bearings: {bearing.law.name}; {found.residual_over_noise:.2f} times the noise is left")
    rows = [
        ("bearings [kN/m]", bearing.stiffness, BEARING),
        ("their damping [kN s/m]", bearing.damping, BEARING_DAMPER),
    ]
    if "coulomb_friction" in bearing.law_estimates:
        rows.append(("their friction [kN]", bearing.law_estimates["coulomb_friction"]["amplitude_n"], FRICTION))
    rows += [(f"{name} [kN/m]", found.joints[name].stiffness, values[0]) for name, values in STOREYS.items()]
    rows += [(f"{name}, damping [kN s/m]", found.joints[name].damping, values[1]) for name, values in STOREYS.items()]
    for name, estimate, truth in rows:
        low, high = estimate.interval95
        print(
            f"{name:28} {1e-3 * estimate.value:10.1f}  ({1e-3 * low:.1f} to {1e-3 * high:.1f}), truth {1e-3 * truth:g}"
        )
    for sentence in (*found.warnings, found.not_determined):
        if sentence:
            print(sentence)
    draw(found, options.out / "bearings.png")
    print(f"Figure: {options.out / 'bearings.png'}")


if __name__ == "__main__":
    main()
