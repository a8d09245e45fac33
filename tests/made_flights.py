"""Results of flights as `opid identify` would write them, with independent Gaussian errors of stated size."""

import json

from opid.estimate import Estimate

GEARS = {"nose": 0.4, "left": 1.0, "right": 1.0}
TRUTH = {"stiffness": 2.0e5, "damping": 6.0e3, "friction": 900.0, "mass": 5400.0}


def error(rng, true, std, scatter=0.0):
    """An estimate of stated relative std, the truth of the flight scattered beyond it."""
    value = true * (1 + std * rng.standard_normal() + scatter * rng.standard_normal())
    return Estimate.normal(value, std * true)


def table(estimate, unit=None):
    plain = {"value": estimate.value, "std": estimate.std, "interval95": list(estimate.interval95 or ())}
    return plain | ({"unit": unit} if unit else {})


def body_result(rng, *, std=0.01, scatter=0.0, loss=None, day=None, kind="arctan_velocity"):
    """result.json of three gears; `loss` {(gear, quantity): fraction} is what has gone."""
    loss = loss or {}
    interfaces = []
    for gear, size in GEARS.items():
        k, c, friction = (
            error(rng, size * TRUTH[name] * (1 - loss.get((gear, name), 0.0)), std, scatter)
            for name in ("stiffness", "damping", "friction")
        )
        interfaces.append(
            {
                "name": gear,
                "shared_with": [],
                "x_m": 0.0,
                "y_m": 0.0,
                "stiffness": table(k, "N/m"),
                "damping": table(c, "N s/m"),
                "law": {kind: {"amplitude_n": table(friction), "scale_m_per_s": table(Estimate.normal(0.02, 0.001))}},
                "residual_over_noise": 1.0,
            }
        )
    return {
        "schema": "opid.identification/1",
        "method": "model",
        "title": "flight",
        "date": day,
        "parameters": {"sprung_mass_kg": table(error(rng, TRUTH["mass"], std, scatter))},
        "structure": {"kind": "rigid_body"},
        "interfaces": interfaces,
    }


def gear_result(rng, *, std=0.01, loss=0.0, day=None, per_mass=False, kind="arctan_velocity"):
    """result.json of a single gear."""
    k, c, friction, mass = (error(rng, TRUTH[name], std) for name in ("stiffness", "damping", "friction", "mass"))
    k = Estimate.normal(k.value * (1 - loss), k.std)
    none = {"value": None, "std": None, "interval95": None}
    absolute = {
        "sprung_mass_kg": table(mass),
        "suspension_stiffness_n_per_m": table(k),
        "suspension_damping_n_s_per_m": table(c),
        "ground_stiffness_n_per_m": none,
    }
    return {
        "schema": "opid.identification/1",
        "method": "model",
        "title": "flight",
        "date": day,
        "parameters": dict.fromkeys(absolute, none) if per_mass else absolute,
        "ratios": {"stiffness_per_mass": table(k), "damping_per_mass": table(c)},
        "law": {
            "name": kind or "linear",
            "per_mass": per_mass,
            "parameters": {kind: {"amplitude_n": table(friction)}} if kind else {},
        },
        "not_determined": "no mass change" if per_mass else None,
    }


def write_result(folder, document):
    """Write result.json into a new folder and return the folder."""
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


def day(number):
    """The date of a flight, one a week."""
    from datetime import date, timedelta

    return (date(2026, 1, 5) + timedelta(weeks=number)).isoformat()
