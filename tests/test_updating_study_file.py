"""Study files of an updating: read back what was written, and everything that is wrong said at once."""

from dataclasses import replace

import numpy as np
import pytest
from made_chain import DOFS, curve_of, small_chain

from opid.errors import InputError
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.modes_file import write_modes
from opid.provenance import read_file
from opid.studies.study_file import read_study, write_study
from opid.updating.checks import nominal_modes
from opid.updating.measured import Place, write_backbone
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import write_structure
from opid.updating.structure.reduction import reduce
from opid.updating.unmeasured_modes import PredictionSettings, ResponseSettings

STUDY = """
title = "A chain"
[structure]
matrices = "structure.npz"
parameters = ["E"]
sensors = ["a", "b", "c", "tip"]
[structure.joints]
end = ["c", "tip"]
[structure.priors]
E = ["lognormal", 1, 0.3]
[[backbones]]
file = "first.csv"
mode = 1
controlled_sensor = "tip"
[[classes]]
name = "class 2"
law = "cubic"
scale = "0.068 N/mm^3"
prior = ["uniform", 0, 5]
[[classes]]
law = "cubic + quintic"
scale = [7.48e7, -8.4e11]
prior = [["uniform", 0, 10], ["normal", 0, 3]]
[sampling]
samples = 1500
seed = 7
"""


@pytest.fixture
def place(tmp_path):
    """A directory with structure.npz and first.csv."""
    write_structure(tmp_path / "structure.npz", small_chain())
    write_backbone(curve_of(), tmp_path / "first.csv")
    return tmp_path


def study_of(place, text):
    path = place / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_study(path)


def refused(place, text, *words):
    with pytest.raises(InputError) as caught:
        study_of(place, text)
    for word in words:
        assert word in str(caught.value)
    return str(caught.value)


def test_a_study_is_read_as_it_is_written(place):
    study = study_of(place, STUDY)
    assert study.title == "A chain"
    assert study.structure.sensors == DOFS
    assert dict(study.structure.joints) == {"end": ("c", "tip")}
    assert list(study.structure.parts) == ["E"]
    cubic = UncertainTerm("cubic_stiffness", (6.8e7,), (Prior("uniform", 0, 5),))
    assert study.classes[0] == ModelClass("class 2", (cubic,))
    assert study.classes[1].priors == (Prior(), Prior("normal", 0, 3))
    assert study.backbones[0].name == "first"
    read = [read_file(place / name) for name in ("study.toml", "structure.npz", "first.csv")]
    assert study.backbones[0].files == tuple(read)
    assert dict(study.parameters) == {"E": Prior("lognormal", 1, 0.3)}
    assert (study.form, study.sampler, study.n_samples, study.seed) == ("recommended", "adaptive", 1500, 7)
    assert study.source == place / "study.toml"


def test_what_is_written_is_read_back(place):
    noise = "[noise]\npoint_noise = 0.002\nshapes = false\ncov = {1 = 0.003}\n"
    study = study_of(place, 'form = "paper"\nharmonics = [1]\n' + STUDY + noise)
    study = replace(study, n_internal=2, sampler="transitional")
    target = place / "again" / "study.toml"
    target.parent.mkdir()
    write_study(study, target)
    again = read_study(target)
    for name in ("title", "form", "classes", "parameters", "sampler", "n_samples", "seed", "harmonics", "noise"):
        assert getattr(again, name) == getattr(study, name), name
    assert (again.n_internal, again.noise.shapes, again.noise.cov) == (2, False, {1: 0.003})
    np.testing.assert_array_equal(again.backbones[0].amplitude, study.backbones[0].amplitude)
    assert abs(again.structure.stiffness_at({}) - study.structure.stiffness_at({})).max() == 0


def test_points_in_an_interaction_are_kept_where_the_study_says_so(place):
    study = study_of(place, 'interaction = "keep"\nmet_damping = 0.002\n' + STUDY)
    assert (study.interaction, study.met_damping) == ("keep", 0.002)
    target = place / "again" / "study.toml"
    target.parent.mkdir()
    write_study(study, target)
    again = read_study(target)
    assert (again.interaction, again.met_damping) == ("keep", 0.002)
    refused(place, 'interaction = "keep"\n' + STUDY, "met_damping is missing and interaction 'keep'")
    write_study(study_of(place, STUDY), target)
    assert "interaction" not in target.read_text(encoding="utf-8")


def test_what_may_be_left_out_has_its_default(place):
    text = STUDY[: STUDY.index("[sampling]")].replace('parameters = ["E"]', "").replace('E = ["lognormal", 1, 0.3]', "")
    study = study_of(place, text.replace('title = "A chain"', ""))
    assert study.title == "study"
    assert dict(study.parameters) == {}
    assert study.n_samples == 5500
    # what is not updated is as it was
    assert abs(study.structure.stiffness_at({}) - small_chain().stiffness_at({})).max() == 0
    named = study_of(place, STUDY.replace('E = ["lognormal", 1, 0.3]', ""))
    assert named.parameters["E"].family == "uniform"


def test_matrices_may_have_files_of_their_own_and_degrees_of_freedom_numbers(place):
    from scipy.io import mmwrite

    mmwrite(place / "M.mtx", small_chain().mass)
    mmwrite(place / "K.mtx", small_chain().stiffness_at({}))
    table = '{mass = "M.mtx", stiffness = "K.mtx"}'
    text = STUDY.replace('"structure.npz"', table).replace('parameters = ["E"]', "dofs = [1, 2, 3, 4]")
    text = text.replace('["a", "b", "c", "tip"]', "[1, 2, 3, 4]").replace('["c", "tip"]', "[3, 4]")
    text = text.replace('E = ["lognormal", 1, 0.3]', "").replace('"tip"', "4")
    write_backbone(replace(curve_of(), sensors=("1", "2", "3", "4"), controlled_sensor="4"), place / "first.csv")
    study = study_of(place, text)
    assert study.structure.sensors == ("1", "2", "3", "4")
    assert dict(study.structure.joints) == {"end": ("3", "4")}


def test_the_unit_of_backbones_may_stand_in_the_study(place):
    curve = curve_of()
    rows = np.column_stack([curve.frequency_hz, 1e3 * curve.amplitude])
    text = "frequency_hz,a,b,c,tip\n" + "\n".join(",".join(map(str, row)) for row in rows)
    (place / "first.csv").write_text(text, encoding="utf-8")
    study = study_of(place, STUDY + '[log]\nunit = "mm"\n')
    np.testing.assert_allclose(study.backbones[0].amplitude, curve.amplitude, rtol=1e-12)
    study = study_of(place, STUDY.replace('file = "first.csv"', 'file = "first.csv"\nunit = "cm"'))
    np.testing.assert_allclose(study.backbones[0].amplitude, 10 * curve.amplitude, rtol=1e-12)


def test_everything_that_is_wrong_is_said_at_once(place):
    text = STUDY.replace("mode = 1", 'mode = "1"').replace('law = "cubic"', 'law = "cubik"').replace("seed", "sead")
    text = text.replace('["c", "tip"]', '["c"]').replace("E = [", "F = [") + "[noise]\npoint_nois = 1\nshapes = 3\n"
    told = refused(place, text, "'mode' in [[backbones]] number 1 is '1'", "'cubik'", "did you mean 'seed'")
    for words in ("'end' in [structure.joints] is ['c'], give the two", "point_noise", "give true or false"):
        assert words in told
    assert "[structure.priors] has 'F', which is no parameter" in told
    assert "7 faults" in told
    refused(place, STUDY.replace("E = [", "F = ["), "[structure.priors] has 'F', which is no parameter to update")
    refused(place, STUDY.replace('"lognormal"', '"flat"'), "'E' in [structure.priors] holds 'flat', give a list like")
    refused(place, STUDY.replace("1, 0.3", "1, -3"), "[structure.priors] 'E': a lognormal prior has a standard deviat")


def test_a_table_at_fault_does_not_hide_what_is_wrong_elsewhere(place):
    text = STUDY.replace('law = "cubic"', 'law = "cubik"').replace("samples = 1500", "samples = 15")
    text = text.replace('["c", "tip"]', '["c", "top"]').replace("first.csv", "last.csv")
    told = refused(place, text, "'cubik'", "'top'", "there is no backbone", "n_samples is 15")
    assert "4 faults" in told
    # the structure is read where its table is sound, and backbones where it is not
    text = STUDY.replace("mode = 1", "mod = 1").replace('["c", "tip"]', '["c", "top"]')
    told = refused(place, text, "'mod'", "'top'")
    assert "2 faults" in told
    told = refused(place, STUDY.replace("sensors = [", "sensor = [").replace("first.csv", "last.csv"), "'sensor'")
    assert "there is no backbone" in told
    for odd in ('structure = 3\nform = "best"', "backbones = 3\nclasses = 4\nnoise = 5\nlog = 6\nsampling = 7"):
        refused(place, odd, "faults", "give a table [structure]")
    refused(place, 'harmonics = ["1", 2]\n' + STUDY, "'harmonics' in the study holds '1', give a list of whole")


def test_what_is_wrong_with_many_files_is_said_once(place):
    text = STUDY
    for number in range(5):
        (place / f"{number}.csv").write_text("frequency_hz,tipp [mm]\n1,2\n", encoding="utf-8")
        text += f'[[backbones]]\nfile = "{number}.csv"\nmode = 1\ncontrolled_sensor = "tip"\n'
    told = refused(place, text, "[[backbones]] 5 files ('0.csv' and 4 others): the column 'tipp [mm]' is not a sensor")
    assert "faults" not in told


def test_modes_to_predict_are_read_and_written(place):
    assert study_of(place, STUDY).prediction == PredictionSettings()
    table = '[prediction]\nmodes = [2]\nsensor = "b"\namplitude_m = [1e-4, 2e-3]\n'
    study = study_of(place, STUDY + table)
    assert study.prediction == PredictionSettings(modes=(2,), sensor="b", amplitude_m=(1e-4, 2e-3))
    (place / "again").mkdir()
    write_study(study, place / "again" / "study.toml")
    assert read_study(place / "again" / "study.toml").prediction == study.prediction
    refused(place, STUDY + table.replace("[2]", "[1]"), "mode 1 is to be predicted and has backbones, leave it out")
    refused(place, STUDY + table.replace("1e-4", "1"), "[prediction]: amplitude_m is [1", "give a smallest")


def test_days_of_the_tests_are_read_and_written(place):
    study = study_of(place, STUDY.replace('controlled_sensor = "tip"', 'controlled_sensor = "tip"\nday = "2 March"'))
    assert {curve.day for curve in study.backbones} == {"2 March"}
    (place / "again").mkdir()
    write_study(study, place / "again" / "study.toml")
    assert [curve.day for curve in read_study(place / "again" / "study.toml").backbones] == ["2 March"] * len(
        study.backbones
    )


def test_responses_to_predict_are_read_and_written(place):
    table = '[[prediction.responses]]\nmode = 1\ndrive = "b"\nforce_n = [2, 5.5]\nsensor = "tip"\n'
    told = refused(place, STUDY + table, "the response of mode 1 to a force is to be predicted and the mode has no")
    assert "damping ratio, name one: damping" in told
    refused(place, STUDY + table.replace("[2, 5.5]", "[-2]"), "[[prediction.responses]]", "give positive amplitudes")
    refused(place, STUDY + table.replace("[2, 5.5]", "5"), "force_n")
    settings = PredictionSettings(responses=(ResponseSettings(mode=1, drive="b", force_n=(2.0, 5.5), sensor="tip"),))
    hz, force = 2 * np.arange(1, 7) + 20.0, np.arange(1, 7)
    rows = [f"{f},{a},{a},{a},{a},{n}" for f, a, n in zip(hz, 1e-4 * force, force, strict=True)]
    (place / "first.csv").write_text("\n".join(["frequency_hz,a,b,c,tip,force [N]", *rows]), encoding="utf-8")
    driven = STUDY.replace('controlled_sensor = "tip"', 'controlled_sensor = "tip"\ndrive = "b"')
    study = study_of(place, driven + "[structure.damping]\n1 = 0.01\n" + table)
    assert study.prediction == settings
    (place / "again").mkdir()
    write_study(study, place / "again" / "study.toml")
    assert read_study(place / "again" / "study.toml").prediction == settings


COORDINATES = """
[structure.coordinates]
a = [0, 0, 0]
b = [0.1, 0, 0, "x"]
c = [0.2, 0, 0.5]
tip = [0.3, 0, 0, "y"]
"""


def test_coordinates_of_the_sensors_are_read_and_written(place):
    study = study_of(place, STUDY + COORDINATES)
    assert study.places["b"] == Place((0.1, 0.0, 0.0), "x")
    assert study.places["c"] == Place((0.2, 0.0, 0.5))
    (place / "copy").mkdir()
    write_study(study, place / "copy" / "study.toml")
    assert dict(read_study(place / "copy" / "study.toml").places) == dict(study.places)
    assert dict(study_of(place, STUDY).places) == {}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("d = [0, 0, 0]", "the coordinates name the sensor 'd', which does not exist"),
        ("a = [0, 0]", "give x, y and z of a sensor in m"),
        ('a = [0, 0, 0, "up"]', "give x, y and z of a sensor in m"),
        ("a = [0, 0, inf]", "give x, y and z of a sensor in m"),
        ("", "there are no coordinates of the sensors 'a': give those of all sensors, or of none"),
    ],
)
def test_coordinates_that_do_not_fit_are_refused(place, wrong, words):
    refused(place, STUDY + COORDINATES.replace("a = [0, 0, 0]", wrong), words)


@pytest.mark.parametrize("growth", [0.3, 0.2])
def test_a_growth_of_the_linear_error_that_is_stated_is_read_and_written(place, growth):
    study = study_of(place, STUDY + f"[noise]\nlinear_error_growth = {growth}\n")
    (place / "again").mkdir()
    write_study(study, place / "again" / "study.toml")
    again = read_study(place / "again" / "study.toml")
    for each in (study, again):
        assert each.noise.linear_error_growth == growth
    # what is left out is not written
    assert study_of(place, STUDY).noise.linear_error_growth is None
    write_study(study_of(place, STUDY), place / "again" / "study.toml")
    assert "[noise]" not in (place / "again" / "study.toml").read_text(encoding="utf-8")


def test_faults_of_files_are_said_at_once(place):
    refused(place, STUDY.replace('["c", "tip"]', '["c", "top"]'), "'top'", "did you mean 'tip'")
    refused(place, STUDY.replace("structure.npz", "matrices.npz"), "there is no file")
    refused(place, STUDY.replace("first.csv", "last.csv"), "there is no backbone")
    refused(place, STUDY.replace('parameters = ["E"]', 'parameters = ["G", "E"]'), "'part_G'")
    refused(place, STUDY + "[noise]\npoint_noise = -1\n", "[noise]: point_noise is -1")
    refused(place, STUDY.replace("1500", "15"), "n_samples is 15")
    (place / "first.csv").write_text("frequency_hz,tip [mm]\n1,2\n", encoding="utf-8")
    told = refused(place, STUDY.replace("sensors = [", 'sensors = ["d", '), "'d'", "at least 3")
    assert "2 faults" in told


def test_a_backbone_that_is_not_of_the_structure_is_refused(place):
    write_backbone(curve_of(4, factor=2 * np.pi), place / "first.csv")
    refused(place, STUDY.replace("mode = 1", "mode = 4"), "far from any mode of the structure", "at 42.3 Hz")


def test_a_name_of_a_backbone_becomes_that_of_a_file(place):
    study = study_of(place, STUDY)
    named = [replace(study.backbones[0], name=name) for name in ("mode 1, sensor a/b", "../x", "plain")]
    (place / "again").mkdir()
    write_study(replace(study, backbones=named), place / "again" / "study.toml")
    files = {path.name for path in (place / "again").iterdir()}
    assert files == {"mode_1_sensor_a_b.csv", "_x.csv", "plain.csv", "structure.npz", "study.toml"}
    back = read_study(place / "again" / "study.toml")
    assert [curve.name for curve in back.backbones] == [curve.name for curve in named]


def test_what_update_study_would_refuse_is_said_when_the_study_is_read(place):
    even = STUDY.replace('law = "cubic"\nscale = "0.068 N/mm^3"', 'law = "even quadratic"\nscale = 1e5')
    told = refused(place, 'form = "paper"\n' + even + "[noise]\ncov = {4 = 0.01}\n", "3 faults", "cov names mode 4")
    assert "class 'class 2': even_quadratic_stiffness is not odd" in told
    assert "the curves of mode 1 do not show how lambda varies" in told
    other = curve_of(name="b")
    write_backbone(replace(other, sensors=DOFS[1:], amplitude=other.amplitude[:, 1:]), place / "b.csv")
    twice = STUDY + '[[backbones]]\nfile = "b.csv"\nmode = 1\ncontrolled_sensor = "tip"\n'
    refused(place, twice + 'day = "1 May"\n', "of mode 1 has no day, and others of this mode have one")


def test_a_joint_that_the_mode_does_not_extend_is_said_when_the_study_is_read(place):
    k = np.zeros((4, 4))
    for one in range(3):
        k[one : one + 2, one : one + 2] += [[1e4, -1e4], [-1e4, 1e4]]
    # symmetric about the middle, where the joint lies: odd modes leave it as it is
    chain = replace(small_chain(), stiffness=k + 1e2 * np.eye(4), parts={}, joints={"middle": ("b", "c")})
    write_structure(place / "structure.npz", chain)
    modes = nominal_modes(chain, 4)
    shape = modes.at_sensors[:, 2] / modes.at_sensors[3, 2]
    level = np.linspace(1e-4, 2e-3, 6)
    curve = replace(curve_of(), frequency_hz=modes.frequency_hz[2] * (1 + level), amplitude=level[:, None] * shape)
    write_backbone(curve, place / "first.csv")
    text = STUDY.replace('parameters = ["E"]', "").replace('E = ["lognormal", 1, 0.3]', "")
    text = text.replace("mode = 1", "mode = 3").replace('end = ["c", "tip"]', 'middle = ["b", "c"]')
    refused(place, text, "mode 3 extends no joint", "take another mode, such as 2, 4")


def test_what_cannot_be_written_is_refused(place):
    study = study_of(place, STUDY)
    for names in (("..",), ("a b", "a,b")):
        wrong = replace(study, backbones=tuple(replace(study.backbones[0], name=name) for name in names))
        with pytest.raises(InputError, match="cannot name its file"):
            write_study(wrong, place / "x.toml")
    modes = nominal_modes(study.structure, 4)
    with pytest.raises(InputError, match="needs its matrices"):
        write_study(replace(study, structure=modes, parameters={}), place / "x.toml")


# ---- structures by their modes ----------------------------------------------------------------------

MODES = """
[structure]
modes = "modes.npz"
[structure.joints]
end = ["c", "tip"]
foot = "a"
[[backbones]]
file = "first.csv"
mode = 1
controlled_sensor = "tip"
[[classes]]
law = "cubic"
scale = 6.8e7
"""
ONE_MODE = MODES.replace('modes = "modes.npz"', 'frequency_hz = 25\nmodal_mass_kg = 4\nsensors = ["tip"]')
ONE_MODE = ONE_MODE.replace('end = ["c", "tip"]\nfoot = "a"', 'spring = "tip"')


@pytest.fixture
def modal(place):
    """The same directory with the modes of the chain in modes.npz, and the backbone of one mass in tip.csv."""
    modes = nominal_modes(small_chain(), 4)
    write_modes(LinearModes(modes.frequency_hz, np.full(4, 0.01), modes.at_sensors, DOFS), place / "modes.npz")
    (place / "tip.csv").write_text("frequency_hz,tip [mm]\n25,0.1\n25.2,0.5\n25.9,1\n", encoding="utf-8")
    return place


def test_the_modes_of_a_structure_are_worth_its_matrices(modal):
    by_modes = study_of(modal, MODES)
    text = STUDY.replace('end = ["c", "tip"]', 'end = ["c", "tip"]\nfoot = "a"').replace('["E"]', "[]")
    by_matrices = study_of(modal, text.replace('[structure.priors]\nE = ["lognormal", 1, 0.3]\n', ""))
    one, other = by_modes.structure, reduce(by_matrices.structure, n_modes=0)
    assert (one.sensors, one.joints) == (other.sensors, other.joints) == (DOFS, ("end", "foot"))
    np.testing.assert_allclose(one.eigenvalue, other.eigenvalue, rtol=1e-12)
    # a shape has no sign of its own
    for seen in ("at_joints", "at_sensors"):
        pairs = [np.einsum("im,jm->ijm", each, each) for each in (getattr(one, seen), getattr(other, seen))]
        np.testing.assert_allclose(*pairs, atol=1e-12)
    assert [file.name for file in by_modes.backbones[0].files[1:]] == [
        str(modal / n) for n in ("modes.npz", "first.csv")
    ]
    chosen = study_of(
        modal, MODES.replace("[structure.joints]", 'sensors = ["tip", "c", "b", "a"]\n[structure.joints]')
    )
    np.testing.assert_array_equal(chosen.structure.at_sensors, one.at_sensors[::-1])
    np.testing.assert_array_equal(chosen.structure.at_joints, one.at_joints)


def test_one_mode_is_its_frequency_and_its_mass(modal):
    found = study_of(modal, ONE_MODE.replace("first.csv", "tip.csv")).structure
    assert found.frequency_hz == pytest.approx([25.0])
    # 4 kg: a unit of the modal coordinate moves sensor and joint by half a metre
    assert (found.at_sensors.tolist(), found.at_joints.tolist()) == ([[0.5]], [[0.5]])
    assert (found.sensors, found.joints) == (("tip",), ("spring",))
    # as the matrices of this mass on its spring to the ground
    spring = 4 * (2 * np.pi * 25) ** 2
    mass = reduce(AffineStructure([[4.0]], [[spring]], {}, ("tip",), ("tip",), {"spring": ("tip",)}), n_modes=0)
    for name in ("eigenvalue", "at_sensors", "at_joints"):
        np.testing.assert_allclose(np.abs(getattr(mass, name)), getattr(found, name), rtol=1e-12)


def test_what_is_written_of_a_joint_to_the_ground_is_read_back(place):
    study = study_of(place, STUDY.replace('end = ["c", "tip"]', 'end = ["c", "tip"]\nfoot = "a"'))
    (place / "again").mkdir()
    write_study(study, place / "again" / "study.toml")
    assert read_study(place / "again" / "study.toml").structure.joints == {"end": ("c", "tip"), "foot": ("a",)}


@pytest.mark.parametrize(
    ("text", "change", "by", "words"),
    [
        (MODES, '"tip"]', '"top"]', "joint 'end' names the sensor of the modes 'top', which does not exist: did you"),
        (MODES, '"c", "tip"', '"tip", "tip"', "joint 'end' lies between 'tip' and itself"),
        (MODES, '"a"', "[]", "'foot' in [structure.joints] is [], give the two degrees of freedom"),
        (MODES, "modes.npz", "mods.npz", "there is no file of modes"),
        (MODES, 'end = ["c", "tip"]\nfoot = "a"', "", "the structure has no joint, name the two"),
        (MODES, 'modes = "modes.npz"', "", "[structure]: it has neither matrices nor modes: give one of"),
        (MODES, "[structure]", '[structure]\nmatrices = "m.npz"', "it has matrices and modes: give one"),
        (MODES, "[structure]", "[structure]\ninternal_modes = 3", "'internal_modes' belongs to matrices"),
        (MODES, "[structure]", '[structure]\nparameters = ["E"]', "the structure is given by its modes"),
        (MODES, 'sensor = "tip"', 'sensor = "tap"', "'tap', which is not one of its sensors: did you mean"),
        (MODES, "mode = 1", "mode = 7", "of mode 7 begins at"),
        (ONE_MODE, "modal_mass_kg = 4\n", "", "'frequency_hz' and 'modal_mass_kg' of one mode belong together"),
        (ONE_MODE, "= 4", "= -4", "modal_mass_kg is -4"),
        (ONE_MODE, "frequency_hz = 25", "frequency_hz = 0", "frequency_hz is 0"),
        (ONE_MODE, '["tip"]', '["tip", "top"]', "is seen by one sensor: give its name"),
        (ONE_MODE, 'spring = "tip"', 'spring = "top"', "joint 'spring' names the sensor of the modes 'top'"),
        (ONE_MODE, "frequency_hz = 25", "frequency_hz = 2500", "far from any mode of the structure"),
    ],
)  # fmt: skip
def test_modes_that_do_not_fit_are_refused(modal, text, change, by, words):
    told = refused(modal, text.replace("first.csv", "tip.csv" if text is ONE_MODE else "first.csv").replace(change, by))
    assert words in told
    assert "faults" not in told
