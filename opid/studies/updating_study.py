"""Study files of an updating, their matrices and backbones -> `UpdatingStudy`, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from opid.errors import InputError, count_repeats, nearest, refuse, require_positive
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.kinds import LAWS, Parameter
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.modes_file import read_modes
from opid.progress import Say
from opid.provenance import read_file
from opid.signals.units import to_si
from opid.studies.schema import Document, collect_faults, derive_record, format_toml, read_tables
from opid.studies.study_file import BACKBONES
from opid.updating.checks import backbone_faults, shortened
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.measured import (
    Direction,
    MeasuredBackbone,
    Place,
    read_backbone,
    read_result_backbones,
    write_backbone,
)
from opid.updating.model_class import LINEAR_DAMPING, Family, ModelClass, Prior, UncertainTerm, spline_terms
from opid.updating.structure.affine import AffineStructure, find_joint_rows, name_faults
from opid.updating.structure.matrices_file import checked_structure, write_structure
from opid.updating.study import UpdatingSettings, UpdatingStudy
from opid.updating.unmeasured_modes import PredictionSettings

FACTOR_PRIOR = Prior("uniform", 0.05, 5.0)
"""Prior of a factor of the linear structure if the study names none: from a twentieth to five times nominal."""

PRIOR = 'a list like ["uniform", 0, 10], ["normal", 1, 0.3] or ["lognormal", 1, 0.3]'
PriorRow = Annotated[tuple[Family, float, float], PRIOR]
"""Family, first and second value of a `Prior`."""

_LINEAR = "linear_damping"  # name of the signed power of the rate with the exponent 1
_LINEAR_COEFFICIENT = Parameter("damping_n_s_per_m", "N s/m", "amplitude", 1e3)
_SPLINE = "spline"  # name of a cubic and a late cubic for each knot
_KNOT = Parameter("knots", "m", "scale", 1e-3)

_WITH_UNIT = re.compile(r"\s*([-+0-9.eE]+)\s*([kM]?)N\s*/\s*(m|mm|cm|in)\s*(?:\^|\*\*)?\s*(\d*)\s*")
_PER_METRE = {"m": 1.0, "cm": 1e2, "mm": 1e3, "in": 1 / 0.0254}
_FORCE = {"": 1.0, "k": 1e3, "M": 1e6}

_Dof = str | int
_Ends = Annotated[
    _Dof | tuple[_Dof, _Dof],
    "the two degrees of freedom that the joint lies between, or the one of a joint to the ground",
]

_Coordinates = Annotated[
    tuple[float, float, float] | tuple[float, float, float, Direction],
    'x, y and z of a sensor in m, like [0.2, 0.1, 0], and its direction if that is not z, like [0.2, 0.1, 0, "x"]',
]


def _derive_settings(*names: str) -> Any:
    """Return the fields of the settings with these names; each is None if a study file does not have it."""
    others = [each.name for each in fields(UpdatingSettings) if each.name not in names]
    return derive_record(UpdatingSettings, *others, **dict.fromkeys(names))


@dataclass(frozen=True, kw_only=True)
class _Factors:
    parameters: tuple[_Dof, ...] = ()
    priors: Mapping[str, PriorRow] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _LinearClass:
    name: str
    parameters: tuple[_Dof, ...]


@dataclass(frozen=True, kw_only=True)
class _Structure(_Factors):
    classes: tuple[_LinearClass, ...] = ()
    matrices: Annotated[
        str | Mapping[str, str] | None, "the name of a file in quotes, or a table with one for each matrix"
    ] = None
    modes: Annotated[str | None, "the name of a file of modes in quotes"] = None
    frequency_hz: float | None = None
    modal_mass_kg: float | None = None
    dofs: Annotated[str | tuple[_Dof, ...] | None, "the name of a file in quotes, or a list of names"] = None
    sensors: Annotated[tuple[_Dof, ...] | None, "a list of degrees of freedom"] = None
    internal_modes: int | None = None
    joints: Annotated[Mapping[str, _Ends] | None, 'a table of joints, each with its two ends like ["9", "10"]'] = None
    damping: Annotated[Mapping[int, float | PriorRow], f"a table of modes, each with its damping ratio or {PRIOR}"] = (
        field(default_factory=dict)
    )
    coordinates: Annotated[
        Mapping[str, _Coordinates], "a table of sensors, each with its coordinates like [0.2, 0.1, 0]"
    ] = field(default_factory=dict)

    @property
    def places(self) -> dict[str, Place]:
        """Where the sensors are."""
        return {name: Place(each[:3], each[3] if len(each) == 4 else "z") for name, each in self.coordinates.items()}

    @property
    def ratios(self) -> dict[int, float | Prior]:
        """The damping ratio of each mode, or its prior."""
        return {mode: Prior(*row) if isinstance(row, tuple) else row for mode, row in self.damping.items()}

    def __post_init__(self) -> None:
        ways = {"matrices": self.matrices, "modes": self.modes, "frequency_hz": self.frequency_hz}
        stated = [name for name, value in ways.items() if value is not None]
        if len(stated) != 1:
            raise InputError(
                f"it has {' and '.join(stated) or 'neither matrices nor modes'}: give one of 'matrices', 'modes' (a "
                "file), or 'frequency_hz' with 'modal_mass_kg' and one sensor"
            )
        if (self.modal_mass_kg is None) != (self.frequency_hz is None):
            raise InputError("'frequency_hz' and 'modal_mass_kg' of one mode belong together: give both or neither")
        for name in ("frequency_hz", "modal_mass_kg"):
            if (value := getattr(self, name)) is not None:
                require_positive(name, value)
        if self.frequency_hz is not None and len(self.sensors or ()) != 1:
            raise InputError(
                "the mode of 'frequency_hz' is seen by one sensor: give its name, like sensors = [\"tip\"]"
            )
        for name in ("dofs", "internal_modes"):
            if self.matrices is None and getattr(self, name) is not None:
                raise InputError(f"{name!r} belongs to matrices, and the structure is given by its modes: leave it out")


@dataclass(frozen=True, kw_only=True)
class _Backbone:
    file: str
    mode: Annotated[int, "the number of a mode, from 1"]
    controlled_sensor: Annotated[_Dof, "the name of a sensor in quotes"]
    name: str | None = None
    unit: str | None = None
    drive: Annotated[_Dof | None, "the name of a sensor in quotes"] = None
    day: str | None = None


@dataclass(frozen=True, kw_only=True)
class _Log:
    unit: str


Scales = Annotated[
    float | str | tuple[float | str, ...], 'a number in SI units, text like "0.068 N/mm^3" or "2 mm", or a list of such'
]
Priors = Annotated[
    PriorRow | tuple[PriorRow | Literal["known"], ...], f'{PRIOR}, or one such list or "known" for each parameter'
]

Knots = Annotated[tuple[float | str, ...], 'a list of extensions in m, or texts like "0.5 mm"']


@dataclass(frozen=True, kw_only=True)
class LawTable:
    """A table of [[classes.laws]]: the law of some joints of a class.

    Args:
        law: kinds of `opid.mechanics.laws.law`, "_stiffness" may be left out, joined by +: springs, and dampers, of
            which "linear damping" is the signed power whose exponent is known to be 1; or "spline", an odd cubic spline
            (see `opid.updating.spline_terms`), whose parameters are the cubic coefficient up to the first knot and its
            change at each knot.
        scale: one for each parameter of the kinds, in SI units or with the unit in a text; one for all if it is alone.
        prior: one for each parameter, "known" for one that keeps its scale; one for all if it is alone, uniform from 0
            to 10 where left out, and normal about 0 with the deviation 1 for the changes at knots.
        joints: names of the joints that have this law, with the same values; all where left out.
        knots: extensions at which the pieces of a spline meet, in m or with the unit in a text.
    """

    law: str
    scale: Scales
    prior: Priors | None = None
    joints: Annotated[tuple[_Dof, ...], "a list of names of joints"] = ()
    knots: Knots = ()

    @property
    def words(self) -> str:
        """The law as it is written, and where it acts."""
        return f"{self.law} at {', '.join(map(str, self.joints))}" if self.joints else self.law

    @property
    def terms(self) -> tuple[UncertainTerm, ...]:
        """The terms that the table describes."""
        kinds = [find_term(part) for part in self.law.split("+")]
        if (_SPLINE in kinds) != bool(self.knots):
            raise InputError(
                f"the law {self.law!r} has {len(self.knots)} knot(s): give 'knots' with the law 'spline', and with no "
                "other"
            )
        knots = [_read_scale(each, _KNOT) for each in self.knots]
        parts = [part for kind in kinds for part in _list_parts(kind, knots)]
        parameters = [parameter for part in parts for parameter in part.given]
        scales = self.scale if isinstance(self.scale, tuple) else (self.scale,) * len(parameters)
        usual = tuple(astuple(part.prior) for part in parts for _ in part.given)
        prior: Any = self.prior or usual
        is_list = isinstance(prior[0], tuple) or "known" in prior
        rows = prior if is_list else (prior,) * len(parameters)
        for what, given in (("scale", scales), ("prior", rows)):
            if len(given) != len(parameters):
                raise InputError(
                    f"the law {self.law!r} has {len(given)} {what}(s): give {len(parameters)}, one for each of "
                    f"{', '.join(f'{each.name} ({each.unit})' for each in parameters)}"
                )
        values = [_read_scale(scale, parameter) for scale, parameter in zip(scales, parameters, strict=True)]
        priors = [None if row == "known" else Prior(*row) for row in rows]
        found, first, joints = [], 0, tuple(map(str, self.joints))
        for part in parts:
            own = slice(first, first + len(part.given))
            known = (None,) * len(part.known)
            found.append(UncertainTerm(part.kind, (*values[own], *part.known), (*priors[own], *known), joints))
            first = own.stop
        return tuple(found)


@dataclass(frozen=True, kw_only=True)
class ClassTable:
    """A table of [[classes]], with one law at all joints, or with laws of its own for groups of joints.

    Args:
        name: of the class; the law where left out.
        law: the law of all joints, see `LawTable`, which explains `scale` and `prior`, too.
        scale: the scales of that law.
        prior: the priors of that law.
        knots: the knots of that law.
        laws: the laws of groups of joints, instead of one for all; a joint in none of them has no law.

    Raises:
        InputError: an unknown law, a scale in no unit of its parameter, a prior that is none, counts that do not match,
            or neither one law nor several.

    >>> [term.scales for term in ClassTable(law="cubic + quintic", scale=("0.0748 N/mm^3", -8.4e11)).model.terms]
    [(74800000.0,), (-840000000000.0,)]
    """

    name: str | None = None
    law: str | None = None
    scale: Scales | None = None
    prior: Priors | None = None
    knots: Knots = ()
    laws: tuple[LawTable, ...] = ()

    def __post_init__(self) -> None:
        _ = self.model  # So the faults are reported when the table is read.

    @property
    def model(self) -> ModelClass:
        """The class that the table describes."""
        stated = [each for each in (self.law, self.scale, self.prior, self.knots or None) if each is not None]
        if bool(stated) == bool(self.laws):
            raise InputError(
                f"class {self.name or self.law!r} has {'law and laws' if stated else 'no law'}: give law and scale for "
                "one at all joints, or [[classes.laws]] for groups of joints"
            )
        tables = self.laws
        if not tables:
            if self.law is None or self.scale is None:
                missing = "law" if self.law is None else "scale"
                raise InputError(f"class {self.name or self.law!r} lacks {missing!r}: give both")
            tables = (LawTable(law=self.law, scale=self.scale, prior=self.prior, knots=self.knots),)
        name = self.name or " + ".join(each.words for each in tables)
        try:
            terms = tuple(term for each in tables for term in each.terms)
        except InputError as error:
            raise InputError(f"class {name!r}: {error}") from None
        return ModelClass(name, terms)


@dataclass(frozen=True, kw_only=True)
class _Sampling(_derive_settings("sampler", "seed")):  # type: ignore[misc]
    samples: int | None = None
    confused: int | None = None
    joint: bool | None = None


@dataclass(frozen=True, kw_only=True)
class _Study(_derive_settings("form", "harmonics", "interaction", "met_damping")):  # type: ignore[misc]
    title: str | None = None
    structure: Annotated[_Structure, BACKBONES.needs["structure"]]
    log: _Log | None = None
    backbones: Annotated[tuple[_Backbone, ...], BACKBONES.needs["backbones"]]
    classes: Annotated[tuple[ClassTable, ...], BACKBONES.needs["classes"]]
    sampling: _Sampling = _Sampling()
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    prediction: PredictionSettings = field(default_factory=PredictionSettings)

    @property
    def settings(self) -> UpdatingSettings:
        named = {
            "form": self.form,
            "harmonics": self.harmonics,
            "interaction": self.interaction,
            "met_damping": self.met_damping,
            "sampler": self.sampling.sampler,
            "n_samples": self.sampling.samples,
            "n_confused": self.sampling.confused,
            "is_joint": self.sampling.joint,
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
        say("the matrices" if study.structure.matrices else "the modes")
        structure, wrong = _read_structure(study.structure, source.parent)
        files += _list_files(study.structure, source.parent)
        faults += [f"[structure]: {fault}" for fault in wrong]
    backbones: list[MeasuredBackbone] = []
    noise = study.noise
    alike: dict[str, list[str]] = {}
    for entry in study.backbones or ():
        say(entry.file)
        try:
            curves, error = _read_backbones(entry, study.log, source.parent, structure)
            backbones += curves
            noise = replace(noise, point_noise=max(noise.point_noise, error))
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
        linear_classes=_read_linear_classes(study.structure),
        noise=noise,
        source=source,
        places=study.structure.places,
        damping=study.structure.ratios,
        prediction=study.prediction,
        **vars(study.settings),
    )


def _read_linear_classes(table: _Structure) -> dict[str, tuple[str, ...]]:
    """Return the parameters of each class of the linear structure.

    Raises:
        InputError: a name that is given twice.
    """
    for name, n in count_repeats(each.name for each in table.classes).items():
        raise InputError(f"{n} of [[structure.classes]] are called {name!r}: rename them")
    return {each.name: tuple(map(str, each.parameters)) for each in table.classes}


def write_files(study: UpdatingStudy, directory: Path) -> str:
    """Write the structure and each backbone, and return the text of the study file."""
    names = [_name_file(curve) for curve in study.backbones]
    repeated = count_repeats(names)
    for curve, name in zip(study.backbones, names, strict=True):
        if name == ".csv" or name in repeated:
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
    factors, _ = read_tables(_Factors, {name: given[name] for name in ("parameters", "priors") if name in given})
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
    matrices = table.matrices.values() if isinstance(table.matrices, Mapping) else [table.matrices]
    named = (*matrices, table.modes, table.dofs if isinstance(table.dofs, str) else None)
    return [directory / name for name in named if name is not None]


def _read_structure(table: _Structure, directory: Path) -> tuple[AffineStructure | JointedModes | None, list[str]]:
    given, dofs = table.matrices, table.dofs
    sensors = None if table.sensors is None else tuple(map(str, table.sensors))
    joints = None
    if table.joints is not None:
        joints = {
            name: tuple(map(str, ends if isinstance(ends, tuple) else (ends,))) for name, ends in table.joints.items()
        }
    if given is None:
        return _read_jointed_modes(table, directory, sensors, joints or {})
    return checked_structure(
        directory / given if isinstance(given, str) else {name: directory / file for name, file in given.items()},
        sensors=sensors,
        joints=joints,
        dofs=directory / dofs if isinstance(dofs, str) else None if dofs is None else [*map(str, dofs)],
        parameters=[*map(str, table.parameters)],
    )


def _read_jointed_modes(
    table: _Structure, directory: Path, sensors: tuple[str, ...] | None, joints: Mapping[str, tuple[str, ...]]
) -> tuple[JointedModes | None, list[str]]:
    """Return the structure by its modes, those of a file or the one whose modal mass is given, and their faults."""
    faults: list[str] = []
    with collect_faults(faults):
        if table.modes is not None:
            modes = read_modes(directory / table.modes)
        else:
            assert table.modal_mass_kg is not None  # Otherwise the table would have been refused.
            assert sensors is not None
            shape = np.array([[table.modal_mass_kg**-0.5]])
            modes = LinearModes(np.array([table.frequency_hz]), np.zeros(1), shape, sensors)
        chosen = modes.sensors if sensors is None else sensors
        faults += name_faults(modes.sensors, chosen, joints, what="sensor of the modes")
        if not faults:
            at_sensors = modes.shapes[[modes.sensors.index(name) for name in chosen]]
            at_joints = find_joint_rows(joints, modes.sensors) @ modes.shapes
            eigenvalue = (2 * np.pi * modes.frequency_hz) ** 2
            return JointedModes(eigenvalue, at_sensors, at_joints, chosen, tuple(joints)), faults
    return None, faults


def _read_backbones(
    entry: _Backbone, log: _Log | None, directory: Path, structure: AffineStructure | JointedModes | None
) -> tuple[list[MeasuredBackbone], float]:
    """Return the backbones of a file, and the error of a frequency that it states, as a fraction; 0 of a CSV file."""
    file, sensor = directory / entry.file, str(entry.controlled_sensor)
    sensors = None if structure is None else structure.sensors
    if file.suffix.lower() == ".json":
        for key, why in (("unit", "is in SI units"), ("drive", "has no force that is read")):
            if getattr(entry, key) is not None:
                raise InputError(f"a result.json {why}: leave {key!r} out")
        modes = structure if isinstance(structure, JointedModes) else None
        curves, error = read_result_backbones(
            file, mode=entry.mode, controlled_sensor=sensor, sensors=sensors, modes=modes, name=entry.name
        )
        return [replace(curve, day=entry.day or "") for curve in curves], error
    unit = log.unit if entry.unit is None and log else entry.unit
    curve = read_backbone(
        file, mode=entry.mode, controlled_sensor=sensor, sensors=sensors, unit=unit, name=entry.name,
        drive=None if entry.drive is None else str(entry.drive),
    )  # fmt: skip
    return [replace(curve, day=entry.day or "")], 0.0


def find_term(text: str) -> str:
    """Return the kind of spring or damper that a short or a full name means.

    Raises:
        InputError: there is none.

    >>> find_term(" cubic "), find_term("gas column"), find_term("linear damping")
    ('cubic_stiffness', 'gas_column', 'linear_damping')
    """
    plain = "_".join(text.lower().split())
    for name in (plain, f"{plain}_stiffness"):
        if name in LAWS or name in (_LINEAR, _SPLINE):
            return name
    known = [kind.removesuffix("_stiffness") for kind in LAWS if LAWS[kind].memory is None]
    raise InputError(f"there is no law {text.strip()!r}: {nearest(plain, [*known, _LINEAR, _SPLINE])}")


@dataclass(frozen=True)
class _Part:
    """A term of a law in a table: the parameters that the table gives, those that its name tells, and a usual prior."""

    kind: str
    given: tuple[Parameter, ...]
    known: tuple[float, ...] = ()
    prior: Prior = field(default_factory=Prior)


def _list_parts(kind: str, knots_m: Sequence[float]) -> list[_Part]:
    """Return the terms that a name in a table means; `knots_m` are those of a spline."""
    if kind == _LINEAR:
        return [_Part(LINEAR_DAMPING, (_LINEAR_COEFFICIENT,), (1.0,))]
    if kind != _SPLINE:
        return [_Part(kind, LAWS[kind].parameters)]
    terms = spline_terms((1.0,) * (len(knots_m) + 1), knots_m)
    return [
        _Part(each.kind, LAWS[each.kind].parameters[:1], each.scales[1:], each.priors[0] or Prior()) for each in terms
    ]


def _read_scale(given: float | str, parameter: Parameter) -> float:
    """Return the scale of a parameter in SI units."""
    name, unit = parameter.name, parameter.unit
    if not isinstance(given, str):
        return float(given)
    number, _, own_unit = given.strip().partition(" ")
    found = _WITH_UNIT.fullmatch(given)
    try:
        value = float(found.group(1) if found else number)
    except ValueError:
        raise InputError(
            f'the scale of {name} is {given!r}: give a number in {unit}, or text like "0.068 N/mm^3" or "2 mm"'
        ) from None
    if not found and not own_unit:
        return value
    if not found:
        factor, si = to_si(own_unit)
        if si != unit:
            raise InputError(f"the scale of {name} is {given!r}: its unit is {unit}, give it in that")
        return value * factor
    _, force, length, power = found.groups()
    if unit != f"N/m^{power}" and not (unit == "N/m" and power in ("", "1")):
        raise InputError(f"the scale of {name} is {given!r}: its unit is {unit}, give it with that power")
    return value * _FORCE[force] * _PER_METRE[length] ** int(power or 1)


# ---- study -> tables -------------------------------------------------------------------------------


def _name_file(curve: MeasuredBackbone) -> str:
    """Return the name of the file of a backbone."""
    return "_".join(re.findall(r"[\w.+-]+", curve.name)).lstrip(".") + ".csv"


def tabulate_class(model: ModelClass) -> ClassTable:
    """Return the table that describes a class."""
    groups: dict[tuple[str, ...], list[UncertainTerm]] = {}
    for term in model.terms:
        groups.setdefault(term.joints, []).append(term)
    tables = tuple(_tabulate_law(terms, joints) for joints, terms in groups.items())
    if len(tables) > 1 or tables[0].joints:
        return ClassTable(name=model.name, laws=tables)
    return ClassTable(name=model.name, law=tables[0].law, scale=tables[0].scale, prior=tables[0].prior)


def _tabulate_law(terms: Sequence[UncertainTerm], joints: tuple[str, ...]) -> LawTable:
    law = " + ".join(_LINEAR if each.is_linear_damper else each.kind.removesuffix("_stiffness") for each in terms)
    given = [(each, 1 if each.is_linear_damper else len(each.scales)) for each in terms]
    scales = tuple(scale for each, n in given for scale in each.scales[:n])
    priors: Any = tuple("known" if prior is None else astuple(prior) for each, n in given for prior in each.priors[:n])
    is_alone = len(scales) == 1
    return LawTable(
        law=law, scale=scales[0] if is_alone else scales, prior=priors[0] if is_alone else priors, joints=joints
    )


def _format_study(study: UpdatingStudy, structure: AffineStructure, files: Sequence[str]) -> str:
    return format_toml(
        _Study(
            title=study.title,
            form=study.form,
            harmonics=study.harmonics,
            interaction=None if study.interaction == "omit" else study.interaction,
            met_damping=study.met_damping,
            structure=_Structure(
                matrices="structure.npz",
                sensors=tuple(structure.sensors),
                internal_modes=study.n_internal,
                parameters=tuple(study.parameters),
                classes=tuple(
                    _LinearClass(name=name, parameters=factors) for name, factors in study.linear_classes.items()
                ),
                joints={name: ends if len(ends) == 2 else ends[0] for name, ends in structure.joints.items()},
                priors={name: astuple(prior) for name, prior in study.parameters.items()},
                coordinates={name: (*each.position, each.direction) for name, each in study.places.items()},
                damping={
                    mode: astuple(ratio) if isinstance(ratio, Prior) else ratio for mode, ratio in study.damping.items()
                },
            ),
            backbones=tuple(
                _Backbone(
                    file=file,
                    mode=curve.mode,
                    controlled_sensor=curve.controlled_sensor,
                    name=None if Path(file).stem == curve.name else curve.name,
                    drive=curve.drive or None,
                    day=curve.day or None,
                )
                for curve, file in zip(study.backbones, files, strict=True)
            ),
            classes=tuple(tabulate_class(each) for each in study.classes),
            sampling=_Sampling(
                sampler=study.sampler,
                samples=study.n_samples,
                seed=study.seed,
                confused=study.n_confused or None,
                joint=study.is_joint or None,
            ),
            noise=study.noise,
            prediction=study.prediction,
        )
    )
