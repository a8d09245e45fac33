"""One `identify` for every kind of study: its type says which wing does it, and no other one is loaded."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack, overload

from opid.errors import InputError
from opid.progress import Say

if TYPE_CHECKING:
    from opid.modal.result import ModalIdentification
    from opid.modal.study import ModalStudy
    from opid.suspensions.bench.law import BenchLaw
    from opid.suspensions.bench.record import BenchStudy
    from opid.suspensions.bench.settings import BenchSettings
    from opid.suspensions.paper.result import PaperIdentification
    from opid.suspensions.result import Identification
    from opid.suspensions.settings import Settings
    from opid.suspensions.study import Study
    from opid.updating.result import Updating
    from opid.updating.study import UpdatingStudy

IDENTIFIERS = {
    "opid.suspensions.study.Study": ("opid.suspensions.identification", "identify"),
    "opid.suspensions.bench.record.BenchStudy": ("opid.suspensions.bench.law", "law_of_bench"),
    "opid.modal.study.ModalStudy": ("opid.modal.identification", "identify_modes"),
    "opid.updating.study.UpdatingStudy": ("opid.updating.identification", "update_study"),
}
"""The full name of each kind of study, with the module and the name of what identifies from it."""


class _ForSuspensions(TypedDict, total=False):
    law: str | None
    band_hz: tuple[float, float] | None
    ground: bool
    progress: Say | None


class _ForModel(_ForSuspensions, total=False):
    method_of_law: str
    settings: Settings | None
    seed: int


class _ForPaper(_ForSuspensions, total=False):
    high_pass_hz: float | None


@overload
def identify(study: Study, *, method: Literal["model"] = "model", **options: Unpack[_ForModel]) -> Identification: ...


@overload
def identify(
    study: Study, *, method: Literal["classical", "paper"], **options: Unpack[_ForPaper]
) -> PaperIdentification: ...


@overload
def identify(study: BenchStudy, *, settings: BenchSettings = ..., progress: Say | None = None) -> BenchLaw: ...


@overload
def identify(study: ModalStudy, *, progress: Say | None = None) -> ModalIdentification: ...


@overload
def identify(study: UpdatingStudy, *, progress: Say | None = None) -> Updating: ...


def identify(study: Any, **options: Any) -> Any:
    """Identify what a study is of: suspensions under known loads, a damper on a test bench, modes, or joints.

    Args:
        study: as `opid.read_study` makes it, or by hand: a `Study` or `BenchStudy` of `opid.suspensions`, a
            `ModalStudy` of `opid.modal` or an `UpdatingStudy` of `opid.updating`.
        options: `progress` is called with the name of each step as it begins. A `Study` has more: `method`, `law`,
            `band_hz`, `ground`, `settings` and others, see `opid.suspensions.identify`.

    Returns:
        What `opid.suspensions.identify`, `opid.suspensions.law_of_bench`, `opid.modal.identify_modes` or
        `opid.updating.update_study` returns, by the kind of study.

    Raises:
        InputError: what is no study, or what the function named above refuses.
        NotDeterminedError: the data determine nothing at all.
    """
    names = [f"{each.__module__}.{each.__qualname__}" for each in type(study).__mro__]
    for kind, (module, function) in IDENTIFIERS.items():
        if kind in names:
            return getattr(import_module(module), function)(study, **options)
    kinds = "a Study, a BenchStudy, a ModalStudy or an UpdatingStudy"
    raise InputError(f"study is of type {type(study).__name__}: give {kinds}, as read_study makes one")
