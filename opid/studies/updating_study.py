"""Study files of an updating, their matrices and backbones -> `UpdatingStudy`, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

from opid.errors import InputError, nearest, refuse
from opid.mechanics.laws.kinds import LAWS
from opid.progress import Say
from opid.provenance import read_file
from opid.studies.schema import Document, collect_faults, derive_record, format_toml, read_tables
from opid.studies.study_file import BACKBONES
from opid.updating.checks import backbone_faults, shortened
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.measured import MeasuredBackbone, read_backbone, write_backbone
from opid.updating.model_class import Family, ModelClass, Prior
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import checked_structure, write_structure
from opid.updating.study import UpdatingSettings, UpdatingStudy

FACTOR_PRIOR = Prior("uniform", 0.05, 5.0)
"""Prior of a factor of the linear structure if the study names none: from a twentieth to five times nominal."""

PRIOR = 'a list like ["uniform", 0, 10], ["normal", 1, 0.3] or ["lognormal", 1, 0.3]'
PriorRow = Annotated[tuple[Family, float, float], PRIOR]
"""Family, first and second value of a `Prior`."""

_WITH_UNIT = re.compile(r"\s*([-+0-9.eE]+)\s*([kM]?)N\s*/\s*(m|mm|cm|in)\s*(?:\^|\*\*)?\s*(\d*)\s*")
_PER_METRE = {"m": 1.0, "cm": 1e2, "mm": 1e3, "in": 1 / 0.0254}
_FORCE = {"": 1.0, "k": 1e3, "M": 1e6}

_Dof = str | int
_Ends = Annotated[tuple[_Dof, _Dof], "the two degrees of freedom that the joint lies between"]


def _derive_settings(*names: str) -> Any:
    """Return the fields of the settings with these names; each is None if a study file does not have it."""
    others = [each.name for each in fields(UpdatingSettings) if each.name not in names]
    return derive_record(UpdatingSettings, *others, **dict.fromkeys(names))


@dataclass(frozen=True, kw_only=True)
class _Structure:
    matrices: Annotated[str | Mapping[str, str], "the name of a file in quotes, or a table with one for each matrix"]
    dofs: Annotated[str | tuple[_Dof, ...] | None, "the name of a file in quotes, or a list of names"] = None
    sensors: Annotated[tuple[_Dof, ...] | None, "a list of degrees of freedom"] = None
    internal_modes: int | None = None
    parameters: tuple[_Dof, ...] = ()
    joints: Annotated[Mapping[str, _Ends] | None, 'a table of joints, each with its two ends like ["9", "10"]'] = None
    priors: Mapping[str, PriorRow] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _Backbone:
    file: str
    mode: Annotated[int, "the number of a mode, from 1"]
    controlled_sensor: Annotated[_Dof, "the name of a sensor in quotes"]
    name: str | None = None
    unit: str | None = None


@dataclass(frozen=True, kw_only=True)
class _Log:
    unit: str


@dataclass(frozen=True, kw_only=True)
class ClassTable:
    """A table of [[classes]].

    Args:
        name: of the class; the law where left out.
        law: kinds of `opid.mechanics.laws.law`, "_stiffness" may be left out, joined by +.
        scale: one for all terms or one each, in SI units or with the unit in a text.
        prior: one for all terms or one each; uniform from 0 to 10 where left out.

    Raises:
        InputError: an unknown law, a scale in no unit of its term, a prior that is none, or counts that do not match.

    >>> ClassTable(law="cubic + quintic", scale=("0.0748 N/mm^3", -8.4e11)).model.scales
    (74800000.0, -840000000000.0)
    """

    name: str | None = None
    law: str
    scale: Annotated[
        float | str | tuple[float | str, ...], 'a number in SI units, text like "0.068 N/mm^3", or a list of such'
    ]
    prior: Annotated[PriorRow | tuple[PriorRow, ...] | None, f"{PRIOR}, or one such list for each term"] = None

    def __post_init__(self) -> None:
        _ = self.model  # So the faults are reported when the table is read.

    @property
    def model(self) -> ModelClass:
        """The class that the table describes."""
        kinds = tuple(find_spring(part) for part in self.law.split("+"))
        name = self.law if self.name is None else self.name
        scales = self.scale if isinstance(self.scale, tuple) else (self.scale,) * len(kinds)
        prior = astuple(Prior()) if self.prior is None else self.prior
        rows = prior if prior and isinstance(prior[0], tuple) else (prior,) * len(kinds)
        for what, given in (("scale", scales), ("prior", rows)):
            if len(given) != len(kinds):
                raise InputError(f"class {name!r} has {len(kinds)} term(s) and {len(given)} {what}(s): give one a term")
        values = tuple(_read_scale(scale, kind) for scale, kind in zip(scales, kinds, strict=True))
        return ModelClass(name, kinds, values, tuple(Prior(*row) for row in rows))


@dataclass(frozen=True, kw_only=True)
class _Sampling(_derive_settings("sampler", "seed")):  # type: ignore[misc]
    samples: int | None = None


@dataclass(frozen=True, kw_only=True)
class _Study(_derive_settings("form", "harmonics")):  # type: ignore[misc]
    title: str | None = None
    structure: Annotated[_Structure, BACKBONES.needs["structure"]]
    log: _Log | None = None
    backbones: Annotated[tuple[_Backbone, ...], BACKBONES.needs["backbones"]]
    classes: Annotated[tuple[ClassTable, ...], BACKBONES.needs["classes"]]
    sampling: _Sampling = _Sampling()
    noise: NoiseSettings = field(default_factory=NoiseSettings)

    @property
    def settings(self) -> UpdatingSettings:
        named = {
            "form": self.form,
            "harmonics": self.harmonics,
            "sampler": self.sampling.sampler,
            "n_samples": self.sampling.samples,
            "seed": self.sampling.seed,
            "n_internal": self.structure and self.structure.internal_modes,
        }
        return UpdatingSettings(**{name: value for name, value in named.items() if value is not None})


def build_study(document: Document, source: Path, say: Say) -> UpdatingStudy:
    """Read the matrices and the backbones that a study file names, and return the study."""
    study, faults = read_tables(_Study, document)
    # The sound keys are read even so, and the faults of their files are reported with the others.
    parameters, wrong = _read_parameters(document.get("structure"))
    faults += wrong
    structure, files = None, [source]
    if study.structure:
        say("the matrices")
        structure, wrong = _read_structure(study.structure, source.parent)
        files += _list_files(study.structure, source.parent)
        faults += [f"[structure]: {fault}" for fault in wrong]
    backbones = []
    alike: dict[str, list[str]] = {}
    for entry in study.backbones or ():
        say(entry.file)
        try:
            backbones.append(_read_backbone(entry, study.log, source.parent, structure))
        except InputError as error:
            file = str(source.parent / entry.file)
            alike.setdefault(str(error).removeprefix(f"{file}: "), []).append(file)
    faults += [_prefix_files(fault, faulty) for fault, faulty in alike.items()]
    if structure is not None:
        faults += backbone_faults(structure, backbones)
    if faults:
        faults += study.settings.setting_faults
    refuse(faults, source)
    assert structure is not None  # Otherwise the study has been refused.
    beside = tuple(map(read_file, files))
    return UpdatingStudy(
        title=source.stem if study.title is None else study.title,
        structure=structure,
        backbones=tuple(replace(each, files=(*beside, *each.files)) for each in backbones),
        classes=tuple(each.model for each in study.classes),
        parameters=parameters,
        noise=study.noise,
        source=source,
        **vars(study.settings),
    )


def write_files(study: UpdatingStudy, directory: Path) -> str:
    """Write the structure and each backbone, and return the text of the study file."""
    names = [_name_file(curve) for curve in study.backbones]
    for curve, name in zip(study.backbones, names, strict=True):
        if name == ".csv" or names.count(name) > 1:
            raise InputError(f"the backbone {curve.name!r} cannot name its file: give each a name of its own")
    if not isinstance(study.structure, AffineStructure):
        raise InputError("the structure of the study is given by its modes: a study file needs its matrices")
    write_structure(directory / "structure.npz", study.structure)
    for curve, name in zip(study.backbones, names, strict=True):
        write_backbone(curve, directory / name)
    return _format_study(study, study.structure, names)


# ---- tables -> study -------------------------------------------------------------------------------


def _prefix_files(fault: str, files: Sequence[str]) -> str:
    """Return a fault with the files that have it, unless it names its file itself."""
    if len(files) == 1:
        return f"[[backbones]] {fault}" if files[0] in fault else f"[[backbones]] {files[0]}: {fault}"
    return f"[[backbones]] {len(files)} files ({shortened([Path(file).name for file in files])}): {fault}"


def _read_parameters(table: object) -> tuple[dict[str, Prior], list[str]]:
    """Return the prior of each factor to update, and the faults of these keys, even if other keys are wrong."""
    given = table if isinstance(table, dict) else {}
    factors, _ = read_tables(_Structure, {name: given[name] for name in ("parameters", "priors") if name in given})
    found: dict[str, Prior] = dict.fromkeys(map(str, factors.parameters), FACTOR_PRIOR)
    faults: list[str] = []
    if not found and given.get("parameters"):
        return found, faults  # The list itself is at fault, and `read_tables` has reported it.
    for name, row in factors.priors.items():
        if name not in found:
            hint = nearest(name, found) if found else "'parameters' names none"
            faults.append(f"[structure.priors] has {name!r}, which is no parameter to update: {hint}")
        with collect_faults(faults, f"[structure.priors] {name!r}: "):
            found[name] = Prior(*row)
    return found, faults


def _list_files(table: _Structure, directory: Path) -> list[Path]:
    matrices = [table.matrices] if isinstance(table.matrices, str) else [*table.matrices.values()]
    return [directory / name for name in (*matrices, *([table.dofs] if isinstance(table.dofs, str) else []))]


def _read_structure(table: _Structure, directory: Path) -> tuple[AffineStructure | None, list[str]]:
    given, dofs = table.matrices, table.dofs
    return checked_structure(
        directory / given if isinstance(given, str) else {name: directory / file for name, file in given.items()},
        sensors=None if table.sensors is None else [*map(str, table.sensors)],
        joints=None if table.joints is None else {name: [*map(str, ends)] for name, ends in table.joints.items()},
        dofs=directory / dofs if isinstance(dofs, str) else None if dofs is None else [*map(str, dofs)],
        parameters=[*map(str, table.parameters)],
    )


def _read_backbone(
    entry: _Backbone, log: _Log | None, directory: Path, structure: AffineStructure | None
) -> MeasuredBackbone:
    return read_backbone(
        directory / entry.file,
        mode=entry.mode,
        controlled_sensor=str(entry.controlled_sensor),
        sensors=None if structure is None else structure.sensors,
        unit=log.unit if entry.unit is None and log else entry.unit,
        name=entry.name,
    )


def find_spring(text: str) -> str:
    """Return the kind of spring that a short or a full name means.

    Raises:
        InputError: there is none.

    >>> find_spring(" cubic "), find_spring("gas column")
    ('cubic_stiffness', 'gas_column')
    """
    plain = "_".join(text.lower().split())
    for name in (plain, f"{plain}_stiffness"):
        if name in LAWS:
            return name
    springs = [kind.removesuffix("_stiffness") for kind in LAWS if len(LAWS[kind].parameters) == 1]
    raise InputError(f"there is no law {text.strip()!r}: {nearest(plain, springs)}")


def _read_scale(given: float | str, kind: str) -> float:
    """Return the scale of a term in SI units."""
    unit = LAWS[kind].parameters[0].unit
    if not isinstance(given, str):
        return float(given)
    found = _WITH_UNIT.fullmatch(given)
    try:
        number, force, length, power = found.groups() if found else ("", "", "m", "")
        value = float(number)
    except ValueError:
        raise InputError(
            f'the scale of {kind} is {given!r}: give a number in {unit}, or text like "0.068 N/mm^3"'
        ) from None
    if unit != f"N/m^{power}" and not (unit == "N/m" and power in ("", "1")):
        raise InputError(f"the scale of {kind} is {given!r}: its unit is {unit}, give it with that power")
    return value * _FORCE[force] * _PER_METRE[length] ** int(power or 1)


# ---- study -> tables -------------------------------------------------------------------------------


def _name_file(curve: MeasuredBackbone) -> str:
    """Return the name of the file of a backbone."""
    return "_".join(re.findall(r"[\w.+-]+", curve.name)).lstrip(".") + ".csv"


def tabulate_class(model: ModelClass) -> ClassTable:
    """Return the table that describes a class."""
    scales, priors = model.scales, tuple(astuple(each) for each in model.priors)
    return ClassTable(
        name=model.name,
        law=" + ".join(kind.removesuffix("_stiffness") for kind in model.kinds),
        scale=scales if model.n_parameters > 1 else scales[0],
        prior=priors if model.n_parameters > 1 else priors[0],
    )


def _format_study(study: UpdatingStudy, structure: AffineStructure, files: Sequence[str]) -> str:
    return format_toml(
        _Study(
            title=study.title,
            form=study.form,
            harmonics=study.harmonics,
            structure=_Structure(
                matrices="structure.npz",
                sensors=tuple(structure.sensors),
                internal_modes=study.n_internal,
                parameters=tuple(study.parameters),
                joints=structure.joints,
                priors={name: astuple(prior) for name, prior in study.parameters.items()},
            ),
            backbones=tuple(
                _Backbone(
                    file=file,
                    mode=curve.mode,
                    controlled_sensor=curve.controlled_sensor,
                    name=None if Path(file).stem == curve.name else curve.name,
                )
                for curve, file in zip(study.backbones, files, strict=True)
            ),
            classes=tuple(tabulate_class(each) for each in study.classes),
            sampling=_Sampling(sampler=study.sampler, samples=study.n_samples, seed=study.seed),
            noise=study.noise,
        )
    )
