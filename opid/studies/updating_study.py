"""Study files of an updating, their matrices and backbones -> `UpdatingStudy`, and back."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from opid.errors import InputError, nearest, refuse
from opid.studies.class_tables import CLASS, class_faults, class_table, model_class, prior_list, prior_of
from opid.studies.kinds import BACKBONES
from opid.studies.tables import (
    MAYBE_TEXT,
    MAYBE_WHOLE,
    TEXT,
    Document,
    Key,
    Say,
    dict_at,
    keys_of,
    list_at,
    maybe,
    noted,
    one_of,
    table_faults,
    toml_of,
)
from opid.updating.data.backbone_file import read_backbone, write_backbone
from opid.updating.data.checks import backbone_faults, shortened
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.data.noise_settings import NoiseSettings
from opid.updating.model_class import Prior
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import checked_structure, write_structure
from opid.updating.study import SAMPLERS, UpdatingStudy, setting_faults

FACTOR_PRIOR = Prior("uniform", 0.05, 5.0)
"""Of a factor of the linear structure where the study names none: from a twentieth of nominal to five times."""

_STRUCTURE = {
    "matrices": Key((str, dict), "the name of a file in quotes, or a table with one for each matrix"),
    "dofs": maybe((str, list), "the name of a file in quotes, or a list of names"),
    "sensors": maybe(list, "a list of degrees of freedom"),
    "joints": maybe(dict, 'a table of joints, each with its two ends like ["9", "10"]'),
    "parameters": maybe(list, "a list of names"),
    "internal_modes": MAYBE_WHOLE,
    "priors": maybe(dict, 'a table of priors, each like ["uniform", 0.1, 2]'),
}
_LOG = {"unit": TEXT}
_BACKBONE = {
    "file": TEXT,
    "mode": Key(int, "the number of a mode, from 1"),
    "controlled_sensor": Key((str, int), "the name of a sensor in quotes"),
    "name": MAYBE_TEXT,
    "unit": MAYBE_TEXT,
}
_SAMPLING = {"sampler": maybe(str, one_of(SAMPLERS)), "samples": MAYBE_WHOLE, "seed": MAYBE_WHOLE}
_NOISE = keys_of(NoiseSettings, cov=maybe(dict, "a table with a number for each mode"))
_STUDY = {
    "title": MAYBE_TEXT,
    "form": maybe(str, "'recommended', 'paper', 'literal' or 'independent'"),
    "harmonics": maybe(list, "a list of harmonics of the model like [1, 3]"),
    "structure": Key(dict, BACKBONES.needs["structure"], keys=_STRUCTURE),
    "log": maybe(dict, "a table [log]", keys=_LOG),
    "backbones": Key(list, BACKBONES.needs["backbones"], keys=_BACKBONE),
    "classes": Key(list, BACKBONES.needs["classes"], keys=CLASS),
    "sampling": maybe(dict, "a table [sampling]", keys=_SAMPLING),
    "noise": maybe(dict, "a table [noise]", keys=_NOISE),
}


def build_updating_study(document: Document, source: Path, say: Say) -> UpdatingStudy:
    """Read the matrices and the backbones that a study file names, and return the study."""
    faults, table = list(_document_faults(document)), document.get("structure")
    structure, backbones = None, []
    # what is sound is read even so: its faults are told with the others
    if isinstance(table, dict) and not [*table_faults("", table, _STRUCTURE), *_structure_faults(table)]:
        say("the matrices")
        structure, wrong = _structure(table, source.parent)
        faults += [f"[structure]: {fault}" for fault in wrong]
    alike: dict[str, list[str]] = {}
    for entry in list_at(document, "backbones"):
        if list(table_faults("", entry, _BACKBONE)):
            continue
        say(entry["file"])
        try:
            backbones.append(_backbone(entry, _sound(document.get("log"), _LOG), source.parent, structure))
        except InputError as error:
            file = str(source.parent / entry["file"])
            alike.setdefault(str(error).removeprefix(f"{file}: "), []).append(file)
    faults += [_of_files(fault, files) for fault, files in alike.items()]
    if structure is not None:
        faults += backbone_faults(structure, backbones)
    noise = NoiseSettings()
    with noted(faults, "[noise]: "):
        noise = _noise(_sound(document.get("noise"), _NOISE))
    if faults:
        faults += setting_faults(**_settings(document))
    refuse(faults, source)
    assert structure is not None  # or it would have been refused
    assert table is not None
    priors = table.get("priors", {})
    return UpdatingStudy(
        title=document.get("title", source.stem),
        structure=structure,
        backbones=tuple(backbones),
        classes=tuple(model_class(each) for each in document["classes"]),
        parameters={str(n): prior_of(priors[n]) if n in priors else FACTOR_PRIOR for n in table.get("parameters", [])},
        noise=noise,
        source=source,
        **_settings(document),
    )


def write_backbones(study: UpdatingStudy, directory: Path) -> str:
    """Write the structure and each backbone, and return the text of the study file."""
    names = [_file_of(curve) for curve in study.backbones]
    for curve, name in zip(study.backbones, names, strict=True):
        if name == ".csv" or names.count(name) > 1:
            raise InputError(f"the backbone {curve.name!r} cannot name its file: give each a name of its own")
    if not isinstance(study.structure, AffineStructure):
        raise InputError("the structure of the study is given by its modes: a study file needs its matrices")
    write_structure(directory / "structure.npz", study.structure)
    for curve, name in zip(study.backbones, names, strict=True):
        write_backbone(curve, directory / name)
    return _toml(study)


# ---- tables -> study -------------------------------------------------------------------------------


def _sound(table: object, keys: Mapping[str, Key]) -> dict[str, Any]:
    """The entries of a table whose keys are known and whose values have the right type."""
    pairs = table.items() if isinstance(table, dict) else ()
    return {name: value for name, value in pairs if name in keys and keys[name].takes(value)}


def _of_files(fault: str, files: Sequence[str]) -> str:
    """A fault with the files that have it; those that are not read at all are named in it."""
    if len(files) == 1:
        return f"[[backbones]] {fault}" if files[0] in fault else f"[[backbones]] {files[0]}: {fault}"
    return f"[[backbones]] {len(files)} files ({shortened([Path(file).name for file in files])}): {fault}"


def _document_faults(document: Document) -> Iterator[str]:
    yield from table_faults("the study", document, _STUDY)
    yield from _structure_faults(dict_at(document, "structure"))
    for number, entry in enumerate(list_at(document, "classes"), start=1):
        yield from class_faults(number, entry)
    for name in ("backbones", "classes"):
        if document.get(name) == []:
            yield f"[[{name}]] is empty, give {_STUDY[name].what}"


def _structure_faults(table: Mapping[str, Any]) -> Iterator[str]:
    """What is wrong with lists and tables within [structure]."""
    for name, ends in dict_at(table, "joints").items():
        if not isinstance(ends, list) or len(ends) != 2:
            yield f"the joint {name!r} is {ends!r}, give the two degrees of freedom that it lies between"
    names = table.get("parameters", [])
    for name, given in dict_at(table, "priors").items():
        if isinstance(names, list) and name not in names:
            hint = nearest(name, map(str, names)) if names else "'parameters' names none"
            yield f"[structure.priors] has {name!r}, which is no parameter to update: {hint}"
        try:
            prior_of(given)
        except InputError as error:
            yield f"[structure.priors] {name!r}: {error}"
    for name, file in dict_at(table, "matrices").items():
        if not isinstance(file, str):
            yield f"{name!r} in [structure.matrices] is {file!r}, give the name of a file in quotes"


def _structure(table: Mapping[str, Any], directory: Path) -> tuple[AffineStructure | None, list[str]]:
    given = table["matrices"]
    files = {name: directory / file for name, file in given.items()} if isinstance(given, dict) else directory / given
    dofs, joints, sensors = table.get("dofs"), table.get("joints"), table.get("sensors")
    return checked_structure(
        files,
        sensors=None if sensors is None else [str(sensor) for sensor in sensors],
        joints=None if joints is None else {name: [str(end) for end in ends] for name, ends in joints.items()},
        dofs=directory / dofs if isinstance(dofs, str) else None if dofs is None else [str(dof) for dof in dofs],
        parameters=[str(name) for name in table.get("parameters", [])],
    )


def _backbone(
    entry: Mapping[str, Any], log: Mapping[str, Any], directory: Path, structure: AffineStructure | None
) -> MeasuredBackbone:
    return read_backbone(
        directory / entry["file"],
        mode=entry["mode"],
        controlled_sensor=str(entry["controlled_sensor"]),
        sensors=None if structure is None else structure.sensors,
        unit=entry.get("unit", log.get("unit")),
        name=entry.get("name"),
    )


def _noise(table: Mapping[str, Any]) -> NoiseSettings:
    given = dict(table)
    if "cov" in given:
        try:
            given["cov"] = {int(mode): float(value) for mode, value in given["cov"].items()}
        except (ValueError, TypeError):
            raise InputError(f"'cov' is {given['cov']!r}: give a number for each mode") from None
    return NoiseSettings(**given)


def _settings(document: Document) -> dict[str, Any]:
    """What is not left to the defaults of `UpdatingStudy`, by the names of its fields; of the right types alone."""
    whole, sampling = _sound(document, _STUDY), _sound(document.get("sampling"), _SAMPLING)
    given = {
        "form": whole.get("form"),
        "harmonics": whole.get("harmonics"),
        "sampler": sampling.get("sampler"),
        "n_samples": sampling.get("samples"),
        "seed": sampling.get("seed"),
        "n_internal": _sound(document.get("structure"), _STRUCTURE).get("internal_modes"),
    }
    return {name: value for name, value in given.items() if value is not None}


# ---- study -> tables -------------------------------------------------------------------------------


def _file_of(curve: MeasuredBackbone) -> str:
    """The name of a backbone as that of a file."""
    return "_".join(re.findall(r"[\w.+-]+", curve.name)).lstrip(".") + ".csv"


def _toml(study: UpdatingStudy) -> str:
    assert isinstance(study.structure, AffineStructure)  # or it would have been refused
    structure: dict[str, Any] = {"matrices": "structure.npz", "sensors": list(study.structure.sensors)}
    structure["internal_modes"] = study.n_internal
    if study.parameters:
        structure["parameters"] = list(study.parameters)
    structure["joints"] = {name: list(ends) for name, ends in study.structure.joints.items()}
    if study.parameters:
        structure["priors"] = {name: prior_list(prior) for name, prior in study.parameters.items()}
    head = {"title": study.title, "form": study.form, "harmonics": list(study.harmonics)}
    backbones = []
    for curve in study.backbones:
        file = _file_of(curve)
        entry = {"file": file, "mode": curve.mode, "controlled_sensor": curve.controlled_sensor}
        backbones.append(entry | ({} if Path(file).stem == curve.name else {"name": curve.name}))
    classes = [class_table(each) for each in study.classes]
    text = toml_of({**head, "structure": structure}, backbones=backbones, classes=classes)
    samples = {} if study.n_samples is None else {"samples": study.n_samples}
    sampling = {"sampler": study.sampler, **samples, "seed": study.seed}
    given, usual = vars(study.noise), vars(NoiseSettings())
    # a stated growth is another thing than one that is left out, though they be equal
    stated = [name for name, value in given.items() if value != usual[name] or type(value) is not type(usual[name])]
    noise = {name: given[name] for name in stated}
    if noise.get("cov"):
        noise["cov"] = {str(mode): value for mode, value in noise["cov"].items()}
    return text + "\n" + toml_of({"sampling": sampling, **({"noise": noise} if noise else {})})
