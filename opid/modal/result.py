"""What the identification of a nonlinear modal model found, and how result.json says it: nothing computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from opid.estimate import Estimate
from opid.json_values import plain
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.model import NonlinearModalModel, TruthTest
from opid.modal.power_laws import coefficient_rows, coefficients_json
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.modal/1"

FORCED_ONLY = (
    *("band_hz", "n_lines", "residual_share", "condition_raw", "condition_scaled", "modal_mass", "force_curves"),
    *("frequency_at_hz", "damping_at"),
)
"""Keys of a mode in result.json that are null where only free decays show it."""


@dataclass(frozen=True, eq=False, repr=False)
class ModalIdentification(Result):
    """A nonlinear modal model with what it rests on.

    Args:
        title: of the study.
        modes: the linear modes.
        drive_point: the sensor where the force acts; None where no test has a force.
        tests: all tests, in modal coordinates.
        fits: one a nonlinear mode.
        model: the nonlinear modal model.
        truth_tests: tests that no fit has seen.
        decays: free decays, with the amplitude-dependent frequency and damping they show.
        shifts: how frequency and damping of each mode move with the level, where tests were recorded for that.
        condition_number: of the shapes.
        auto_mac: (n_modes, n_modes) modal assurance criterion of the shapes against each other.
        warnings: what to doubt.
        not_determined: why there is no answer, "" if there is one.
        settings: what it was made with.
        decay_laws: the law that the free decays of a mode give together, by the number of the mode; the model has it
            where no forced test moves the mode.
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

    @property
    def modes_by_decays_alone(self) -> list[int]:
        """The modes that no forced test moves and whose law comes from their free decays."""
        fitted = {fit.mode for fit in self.fits}
        return [mode for mode in sorted(self.decay_laws) if mode not in fitted]

    @property
    def all_warnings(self) -> list[str]:
        """All warnings, those of modes, decays and their laws last, each once."""
        # worded as by `identify_modes`, which says them too
        of_decays = {
            f"free decay {decay.name!r} of mode {decay.mode}: {text}": (decay.mode, text)
            for decay in self.decays
            for text in decay.warnings
        }
        of_laws = {
            f"the free decays of mode {mode} together: {text}": (mode, text)
            for mode, law in sorted(self.decay_laws.items())
            for text in law.warnings
        }
        # the law of a single decay has that decay's warnings
        twice = {text for text, said in of_laws.items() if said in of_decays.values()}
        every = [*self.warnings, *(text for fit in self.fits for text in fit.warnings), *of_decays, *of_laws]
        return [text for text in dict.fromkeys(every) if text not in twice]

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the coefficients of each nonlinear mode; k1 and c1 of free decays are k0 and c0 themselves."""
        laws = [(f"mode_{fit.mode}.", fit.stiffness, fit.damping) for fit in self.fits]
        laws += [(f"mode_{n}.decays.", law.stiffness, law.damping) for n, law in sorted(self.decay_laws.items())]
        return tuple(row for name, k, c in laws for row in coefficient_rows(k, c, name))

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The study, the modes and the logs of the tests, as they were when they were read."""
        return tuple(file for test in self.tests for file in test.recording.files)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, which docs/schemas/modal-1.schema.json describes.

        A mode that only free decays show stands in `modes` with the same keys, after the others: `known_by` is "free
        decays" instead of "forced tests", `k` and `c` are those of `decay_laws` (power 1 as for all `modes` the
        correction of k0 and c0; in `decay_laws` and `decays` it is k0 and c0 itself), `tests` are its decays, and what
        only forced tests give (`band_hz`, `force_curves`, ...) is null.
        """
        names = ("title", "drive_point", "condition_number", "auto_mac", "not_determined", "settings")
        of_decays = [_mode_of_decays(self, mode) for mode in self.modes_by_decays_alone]
        return plain(
            {
                "schema": SCHEMA,
                **{name: getattr(self, name) for name in names},
                "modes": [*(fit.as_json() for fit in self.fits), *of_decays],
                "linear_modes": {name: getattr(self.modes, name) for name in ("frequency_hz", "damping_ratio")},
                "truth_tests": [test.as_json() for test in self.truth_tests],
                "level_shifts": [asdict(shift) for shift in self.shifts],
                "decays": [decay.fields_json() for decay in self.decays],
                "decay_laws": {str(mode): law.as_json() for mode, law in sorted(self.decay_laws.items())},
                "warnings": self.all_warnings,
            }
        )

    def _headline(self) -> str:
        nonlinear = ", ".join(str(fit.mode) for fit in self.fits) or "none"
        return f"{self.title or 'without a title'} ({self.modes.n_modes} modes, nonlinear by forced tests: {nonlinear})"


def _mode_of_decays(result: ModalIdentification, mode: int) -> dict[str, Any]:
    """A mode that only free decays show, with the keys of the others; null is what forced tests alone give."""
    law, index = result.decay_laws[mode], result.modes.index(mode)
    linear = float(result.modes.stiffness()[index]), float(result.modes.damping()[index])
    # k0 and c0 as corrections of those that are given
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
        **dict.fromkeys(FORCED_ONLY),
        "tests": [decay.name for decay in result.decays if decay.mode == mode],
        "orders": [],
        "warnings": law.warnings,
    }
