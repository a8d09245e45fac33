"""From matrices and measured backbones to the law of nonlinear joints, with its evidence and a report.

    python examples/update_backbones.py --out updating_result

The matrices are those of a plate with two pylons, the backbones are simulated; put your own in their place.
"""

import argparse
from pathlib import Path

import numpy as np

import opid
from opid.updating import (
    ModelClass,
    Prior,
    UncertainTerm,
    UpdatingStudy,
    read_backbone,
    read_structure,
    reduce,
    write_backbone,
    write_structure,
)
from opid.virtual import UPDATED, synthetic_backbones, wing_engine_structure

# f(z) = theta scale z^3, z in m and f in N, the same at all joints; and one with a quintic term beside
PRIOR = Prior("uniform", 0.0, 10.0)
CUBIC = ModelClass("cubic", (UncertainTerm("cubic_stiffness", (6.8e7,), (PRIOR,)),))
BOTH = ModelClass(
    "cubic and quintic",
    (
        UncertainTerm("cubic_stiffness", (6.8e7,), (PRIOR,)),
        UncertainTerm("quintic_stiffness", (8.4e11,), (Prior("uniform", -10, 10),)),
    ),
)


def measured(directory: Path) -> None:
    """Write structure.npz and one CSV file a backbone, as a finite-element code and a test bench would."""
    nominal = wing_engine_structure()
    write_structure(directory / "structure.npz", nominal)
    true = reduce(nominal, UPDATED)
    curves = synthetic_backbones(true, CUBIC, (1.58,), rng=np.random.default_rng(0), n_curves=(6, 4), n_points=15)
    for number, curve in enumerate(curves, start=1):
        write_backbone(curve, directory / f"mode{curve.mode}_{number}.csv")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("updating_result"))
    options = parser.parse_args()
    data = options.out / "data"
    data.mkdir(parents=True, exist_ok=True)
    measured(data)

    # 1. M, K0 and the parts of K that two moduli multiply; names of sensors and of the ends of the joints
    structure = read_structure(data / "structure.npz")
    print(f"{structure.n_dof} degrees of freedom, sensors at {', '.join(structure.sensors)}")

    # 2. columns frequency_hz and an amplitude a sensor; modes are counted from the lowest, rigid ones too
    backbones = [
        read_backbone(data / file.name, mode=int(file.stem[4]), controlled_sensor="10", sensors=structure.sensors)
        for file in sorted(data.glob("mode*.csv"))
    ]

    # 3. phase I updates the moduli, phase II both laws; the one with the larger evidence predicts
    study = UpdatingStudy(
        "Two pylons", structure, tuple(backbones), (CUBIC, BOTH), n_samples=3300,
        parameters={name: Prior("uniform", 0.05, 5.0) for name in structure.parts},
    )  # fmt: skip
    result = opid.identify(study, progress=lambda step: print("...", step))
    print(opid.text(result))

    # 4. result.json, the page and its figures
    print(f"Report: {opid.write_report(result, options.out)}")


if __name__ == "__main__":
    main()
