"""The result of identifying a nonlinear modal model, and its content in result.json; nothing is computed here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from opid.estimate import Estimate
from opid.json_values import plain
from opid.modal.decay.free_decay import Decay
from opid.modal.decay.law import DecayLaw
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.forced.system_fit import SystemFit
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.model import NonlinearModalModel, TruthTest
from opid.modal.power_laws import coefficient_rows, coefficients_json
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.modal/1"


@dataclass(frozen=True, eq=False, repr=False)
class ModalIdentification(Result):
    """A nonlinear modal model with its fits, its truth tests and the warnings about it.

    Args:
        title: the title of the study.
        modes: the linear modes.
        drive_point: the sensor where the force acts; None where no test has a force.
        tests: all tests, in modal coordinates.
        fits: one fit for each nonlinear mode that forced tests move.
        model: the nonlinear modal model.
        truth_tests: tests that no fit has seen, compared with the model.
        decays: free decays, with their frequency and damping over amplitude.
        shifts: how frequency and damping of each mode move with the level, where level tests were given.
        condition_number: condition number of the shapes.
        auto_mac: (n_modes, n_modes) modal assurance criterion of the shapes against each other.
        warnings: one sentence for each warning about the result, those of decays included.
        not_determined: the reason why there is no answer, "" if there is one.
        settings: the settings of the study.
        decay_laws: the law that the free decays of a mode give together, by the number of the mode; the model has it
            where no forced test moves the mode.
        systems: modes that were fitted by simulation, for they drive each other or their joints slip.
    """

    title: str
    modes: LinearModes
    drive_point: str | None
    tests: tuple[ModalTest, ...]
    fits: tuple[ModeFit, ...]
    model: NonlinearModalModel
    truth_tests: tuple[TruthTest, ...]
    decays: tuple[Decay, ...]
    shifts: tuple[LevelShift, ...]
    condition_number: float
    auto_mac: FloatArray
    warnings: tuple[str, ...]
    not_determined: str
    settings: Mapping[str, Any]
    decay_laws: Mapping[int, DecayLaw] = field(default_factory=dict)
    systems: tuple[SystemFit, ...] = ()

    @property
    def modes_by_decays_alone(self) -> list[int]:
        """The modes that no forced test moves and whose law comes from their free decays."""
        fitted = {fit.mode for fit in self.fits}
        return [mode for mode in sorted(self.decay_laws) if mode not in fitted]

    @property
    def all_warnings(self) -> list[str]:
        """All warnings, those of the fits last, each once."""
        return list(dict.fromkeys([*self.warnings, *(text for fit in self.fits for text in fit.warnings)]))

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the coefficients of each nonlinear mode; k1 and c1 of free decays are k0 and c0 themselves."""
        laws = [(f"mode_{fit.mode}.", fit.stiffness, fit.damping) for fit in self.fits]
        laws += [(f"mode_{n}.decays.", law.stiffness, law.damping) for n, law in sorted(self.decay_laws.items())]
        rows = [row for name, k, c in laws for row in coefficient_rows(k, c, name)]
        joints = [(f"mode_{fit.mode}.", fit.joint_estimates) for fit in self.fits]
        joints += [(f"mode_{n}.decays.", law.joint_estimates) for n, law in self.decay_laws.items()]
        rows += [row for name, joint in joints for row in joint.list_rows(name)]
        return (*rows, *(each.row() for system in self.systems for each in system.couplings))

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The study, the modes and the logs of the tests, as they were when they were read."""
        return tuple(file for test in self.tests for file in test.recording.files)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, which docs/schemas/modal-1.schema.json describes.

        A mode that only free decays show has the same keys and follows the others in `modes`. Its `known_by` is "free
        decays" instead of "forced tests", its `tests` are its decays, and its `k` and `c` are those of `decay_laws`.
        There the power 1 is k0 and c0 itself, as in `decays`; in all `modes` it is their correction. Keys that only
        forced tests can fill (`band_hz`, `force_curves`, ...) are null.
        """
        names = ("title", "drive_point", "condition_number", "auto_mac", "not_determined", "settings")
        of_decays = [_describe_mode_of_decays(self, mode) for mode in self.modes_by_decays_alone]
        return plain(
            {
                "schema": SCHEMA,
                **{name: getattr(self, name) for name in names},
                "modes": [*(fit.as_json() for fit in self.fits), *of_decays],
                "linear_modes": {name: getattr(self.modes, name) for name in ("frequency_hz", "damping_ratio")},
                "truth_tests": [test.as_json() for test in self.truth_tests],
                "level_shifts": [asdict(shift) for shift in self.shifts],
                "decays": [decay.fields_json() for decay in self.decays],
                "systems": [system.as_json() for system in self.systems],
                "decay_laws": {str(mode): law.as_json() for mode, law in sorted(self.decay_laws.items())},
                "warnings": self.all_warnings,
            }
        )

    def _write_headline(self) -> str:
        nonlinear = ", ".join(str(fit.mode) for fit in self.fits) or "none"
        return f"{self.title or 'without a title'} ({self.modes.n_modes} modes, nonlinear by forced tests: {nonlinear})"


def _describe_mode_of_decays(result: ModalIdentification, mode: int) -> dict[str, Any]:
    """Return a mode that only free decays show, with the same keys as the other modes."""
    law, index = result.decay_laws[mode], result.modes.index(mode)
    linear = float(result.modes.stiffness()[index]), float(result.modes.damping()[index])
    # The power 1 becomes a correction of the k0 and c0 that are given.
    stiffness, damping = (
        {**found, 1: Estimate.normal(float(found[1].value or 0.0) - given, found[1].std)}
        for found, given in zip((law.stiffness, law.damping), linear, strict=True)
    )
    return {
        "mode": mode,
        "known_by": "free decays",
        "frequency_hz": result.modes.frequency_hz[index],
        "damping_ratio": result.modes.damping_ratio[index],
        "stiffness_order": max(law.stiffness),
        "damping_order": max(law.damping),
        "free_linear": True,
        **coefficients_json(stiffness, damping),
        **law.joint_estimates.as_json("joint_"),
        **dict.fromkeys(("band_hz", "n_lines", "residual_share", "condition_raw", "condition_scaled", "modal_mass")),
        **dict.fromkeys(("force_curves", "frequency_at_hz", "damping_at", "misfit", "delay_s")),
        "tests": [decay.name for decay in result.decays if decay.mode == mode],
        "orders": [],
        "interactions": [],
        "warnings": law.warnings,
    }
