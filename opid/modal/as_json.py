"""A nonlinear modal model, and a free decay, as the content of result.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from opid.estimate import Estimate
from opid.json_values import plain
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import SCHEMA as DECAY_SCHEMA, Decay
from opid.modal.power_laws import unit_of, unit_per_mass
from opid.modal.result import SCHEMA, ForceCurve, ModalIdentification, ModeFit, TruthTest

FORCED_ONLY = (
    *("band_hz", "n_lines", "residual_share", "condition_raw", "condition_scaled", "modal_mass", "force_curves"),
    *("frequency_at_hz", "damping_at"),
)
"""Keys of a mode in result.json that are null where only free decays show it."""


def modal_json(result: ModalIdentification) -> dict[str, Any]:
    """Return a nonlinear modal model as the content of result.json.

    Args:
        result: from `identify_modes`.

    Returns:
        What `docs/schemas/modal-1.schema.json` describes. A mode that only free decays show stands in `modes` with the
        same keys, after the others: `known_by` is "free decays" instead of "forced tests", `k` and `c` are those of
        `decay_laws` (power 1 as for all `modes` the correction of k0 and c0; in `decay_laws` and `decays` it is k0 and
        c0 itself), `tests` are its decays, and what only forced tests give (`band_hz`, `force_curves`, ...) is null.
    """
    return plain(
        {
            "schema": SCHEMA,
            "title": result.title,
            "drive_point": result.drive_point,
            "condition_number": result.condition_number,
            "auto_mac": result.auto_mac,
            "modes": [
                *(_mode(fit) for fit in result.fits),
                *(_mode_of_decays(result, mode) for mode in result.modes_by_decays_alone),
            ],
            "linear_modes": {
                "frequency_hz": result.modes.frequency_hz,
                "damping_ratio": result.modes.damping_ratio,
            },
            "truth_tests": [_truth_test(test) for test in result.truth_tests],
            "level_shifts": [asdict(shift) for shift in result.shifts],
            "decays": [decay_fields(decay) for decay in result.decays],
            "decay_laws": {str(mode): _decay_law(law) for mode, law in sorted(result.decay_laws.items())},
            "warnings": result.all_warnings,
            "not_determined": result.not_determined,
            "settings": result.settings,
        }
    )


def _mode(fit: ModeFit) -> dict[str, Any]:
    """One nonlinear mode; `k` and `c` by power, as the paper calls them."""
    return {
        "mode": fit.mode,
        "known_by": "forced tests",
        "frequency_hz": fit.frequency_hz,
        "damping_ratio": fit.damping_ratio,
        "stiffness_order": fit.stiffness_order,
        "damping_order": fit.damping_order,
        "free_linear": fit.free_linear,
        **coefficients(fit.stiffness, fit.damping),
        "band_hz": fit.band_hz,
        "n_lines": fit.n_lines,
        "residual_share": fit.residual_share,
        "condition_raw": fit.condition_raw,
        "condition_scaled": fit.condition_scaled,
        "modal_mass": asdict(fit.modal_mass),
        "tests": fit.tests,
        "force_curves": {
            "stiffness": _curve(fit.stiffness_curve, "displacement"),
            "damping": _curve(fit.damping_curve, "velocity"),
        },
        "frequency_at_hz": fit.frequency_at_hz,
        "damping_at": fit.damping_at,
        "orders": [asdict(rung) for rung in fit.orders],
        "warnings": fit.warnings,
    }


def _mode_of_decays(result: ModalIdentification, mode: int) -> dict[str, Any]:
    """A mode that only free decays show, with the keys of the others; null is what forced tests alone give."""
    law, place = result.decay_laws[mode], result.modes.index(mode)
    stiffness = dict(law.stiffness) | {1: _less(law.stiffness[1], float(result.modes.stiffness()[place]))}
    damping = dict(law.damping) | {1: _less(law.damping[1], float(result.modes.damping()[place]))}
    return {
        "mode": mode,
        "known_by": "free decays",
        "frequency_hz": result.modes.frequency_hz[place],
        "damping_ratio": result.modes.damping_ratio[place],
        "stiffness_order": max(law.stiffness),
        "damping_order": max(law.damping),
        "free_linear": True,
        **coefficients(stiffness, damping),
        **dict.fromkeys(FORCED_ONLY),
        "tests": [decay.name for decay in result.decays if decay.mode == mode],
        "orders": [],
        "warnings": law.warnings,
    }


def _less(estimate: Estimate, given: float) -> Estimate:
    """An estimate of k0 or c0 as the correction of the one that is given."""
    return Estimate() if estimate.value is None else Estimate.normal(estimate.value - given, estimate.std)


def _decay_law(law: DecayLaw) -> dict[str, Any]:
    """The law that the free decays of a mode give together."""
    return {
        **coefficients(law.stiffness, law.damping),
        "frequency_low_hz": asdict(law.frequency_low_hz),
        "damping_low": asdict(law.damping_low),
        "amplitude": law.amplitude,
        "frequency_hz": law.frequency_hz,
        "damping_ratio": law.damping_ratio,
        "misfit": law.misfit,
        "warnings": law.warnings,
    }


def _curve(curve: ForceCurve, along: str) -> dict[str, Any]:
    values = {"force": curve.force, "low": curve.low, "high": curve.high, "linear": curve.linear}
    return {along: curve.position, **values}


def _truth_test(test: TruthTest) -> dict[str, Any]:
    figures = {name: asdict(each) for name, each in test.sensors.items()}
    return {"name": test.name, "band_hz": test.band_hz, "sensors": figures}


def decay_json(decay: Decay) -> dict[str, Any]:
    """Return a free decay as the content of result.json.

    Args:
        decay: from `free_decay`.

    Returns:
        What `docs/schemas/decay-1.schema.json` describes.
    """
    return plain({"schema": DECAY_SCHEMA, **decay_fields(decay), "settings": decay.settings})


def decay_fields(decay: Decay) -> dict[str, Any]:
    """Return the fields of a free decay for JSON, without its record; `k` and `c` by power, 1 is k0 and c0.

    Args:
        decay: the decay.
    """
    kept = (
        *("name", "mode", "amplitude", "amplitude_unit", "frequency_hz", "frequency_std_hz", "damping_ratio"),
        *("damping_std", "start_s", "stop_s", "residual_share", "law_misfit", "warnings"),
    )
    return {
        **{name: getattr(decay, name) for name in kept},
        "frequency_low_hz": asdict(decay.frequency_low_hz),
        "damping_low": asdict(decay.damping_low),
        **coefficients(decay.stiffness, decay.damping, per_mass=decay.mode is None),
    }


def coefficients(
    stiffness: Mapping[int, Estimate], damping: Mapping[int, Estimate], *, per_mass: bool = False
) -> dict[str, Any]:
    """Return `k` and `c` by power, and their units, for JSON.

    Args:
        stiffness: k_n by its power n.
        damping: c_n by its power n.
        per_mass: whether they are of a sensor's motion, per unit mass, instead of a modal coordinate.
    """
    unit = unit_per_mass if per_mass else unit_of
    return {
        "k": {str(power): asdict(estimate) for power, estimate in stiffness.items()},
        "c": {str(power): asdict(estimate) for power, estimate in damping.items()},
        "units": {f"k{power}": unit("k", power) for power in stiffness}
        | {f"c{power}": unit("c", power) for power in damping},
    }
