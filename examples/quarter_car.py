"""A quarter car on the road: body mass, spring and damper from an accelerometer on the hub and one on the body.

    python examples/quarter_car.py --out quarter_car_result

Driven twice, the second time with sandbags of known mass; the tyre and the road need not be known. The recordings are
simulated, put your own in their place.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import opid
from opid.mechanics import Joint, Structure, time_response
from opid.plots import house_style
from opid.suspensions import StructureIdentification, identify_structure
from opid.virtual import Sensor, decimate, iso8608_road, measure

FS, SECONDS, LEAD_IN, SPEED = 512.0, 30.0, 5.0, 20.0
SANDBAGS_KG = 60.0
# the truth: the damper is 1.5 kN s/m on average, a third more in rebound and a third less in compression
BODY_KG, HUB_KG, SPRING, DAMPER, REBOUND = 310.0, 38.0, 21e3, 1.5e3, 500.0
TYRE, TYRE_DAMPER = 190e3, 150.0


def drive(loading_kg: float, rng: np.random.Generator) -> opid.Recording:
    """Return what hub and body measure on a road of their own, m/s^2."""
    strut = Joint("strut", (-1, 1), SPRING, DAMPER, opid.law("asymmetric_damping", damping_n_s_per_m=REBOUND))
    car = Structure(
        np.diag([HUB_KG, BODY_KG + loading_kg]),
        np.diag([TYRE_DAMPER, 0.0]),
        np.diag([TYRE, 0.0]),
        (strut,),
        ("hub", "body"),
    )
    road = iso8608_road("B", length_m=SPEED * (LEAD_IN + SECONDS), rng=rng, footprint_m=0.15)

    def through_the_tyre(t: np.ndarray) -> np.ndarray:
        force = TYRE * road.elevation(SPEED * t) + TYRE_DAMPER * SPEED * road.slope(SPEED * t)
        return np.stack([force, np.zeros_like(t)], axis=1)

    motion = time_response(car, through_the_tyre, fs=4 * FS, duration_s=LEAD_IN + SECONDS)
    true = decimate(motion.acceleration, 4)[round(LEAD_IN * FS) :]
    sensor = Sensor(noise_m_per_s2=0.01)
    readings = [measure(column, fs=FS, sensor=sensor, rng=rng) for column in true.T]
    return opid.signals.recording_from_arrays(readings, ["hub", "body"], fs=FS)


def draw(found: StructureIdentification, path: Path) -> None:
    """Draw the damper's force over its velocity."""
    strut = found.interfaces["body"]
    v = np.linspace(strut.velocity.min(), strut.velocity.max(), 201)
    with house_style():
        figure, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
        ax.plot(v, DAMPER * v + REBOUND * np.abs(v), color="0.7", linewidth=5, label="truth")
        ax.plot(v, strut.damping.value * v + strut.law.force(0.0, v), label="identified")
        ax.set(xlabel="velocity of the damper [m/s]  (compression | rebound)", ylabel="force of the damper [N]")
        ax.legend()
        figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("quarter_car_result"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)

    # 1. one degree of freedom on one interface; its mass is not known, 300 kg is a guess
    runs, loadings = [drive(0.0, rng), drive(SANDBAGS_KG, rng)], [{}, {"body": SANDBAGS_KG}]
    car_body = Structure([[300.0]], [[0.0]], [[0.0]], names=("body",))

    # 2. the law of the damper is searched
    found = identify_structure(
        car_body,
        runs,
        interfaces={"body": "hub"},
        sensors={"body": "body"},
        unknown_mass=["body"],
        loadings=loadings,
        axis="up",
        progress=lambda step: print("...", step),
    )

    # 3. beside the truth
    strut = found.interfaces["body"]
    print(f"law: {strut.law.name}; {found.residual_over_noise:.2f} times the noise is left")
    rows = [
        ("body mass [kg]", found.masses["body"], BODY_KG),
        ("spring [N/m]", strut.stiffness, SPRING),
        ("damper, mean of both ways [N s/m]", strut.damping, DAMPER),
    ]
    if "asymmetric_damping" in strut.law_estimates:
        rebound = strut.law_estimates["asymmetric_damping"]["damping_n_s_per_m"]
        rows.append(("more in rebound [N s/m]", rebound, REBOUND))
    for name, estimate, truth in rows:
        low, high = estimate.interval95
        print(f"{name:34} {estimate.value:9.1f}  ({low:.1f} to {high:.1f}), truth {truth:g}")
    for sentence in (*found.warnings, found.not_determined):
        if sentence:
            print(sentence)
    draw(found, options.out / "damper.png")
    print(f"Figure: {options.out / 'damper.png'}")


if __name__ == "__main__":
    main()
