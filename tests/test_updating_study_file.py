"""Study files of an updating: read back what was written, units to SI, and everything that is wrong said at once."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from opid.errors import InputError
from opid.updating.backbone_file import read_backbone, write_backbone
from opid.updating.class_tables import class_table, kind_named, model_class, prior_of
from opid.updating.matrices_file import write_structure
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass, Prior
from opid.updating.structure import AffineStructure
from opid.updating.study_checks import backbone_faults, nominal_modes, structure_faults
from opid.updating.study_file import read_updating_study, write_updating_study

DOFS = ("a", "b", "c", "tip")
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


def small_chain(stiffness=4e4):
    """Four masses of 2 kg on equal springs, the first on the ground: half of each spring is updated."""
    k = stiffness * (2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    k[3, 3] = stiffness
    half = sparse.csr_matrix(0.5 * k)
    return AffineStructure(sparse.csr_matrix(2 * np.eye(4)), half, {"E": half}, DOFS, DOFS, {"end": ("c", "tip")})


def curve_of(mode=1, *, name="first", factor=1.0, n=6):
    """A backbone of the chain that hardens a little."""
    modes = nominal_modes(small_chain(), 4)
    shape = modes.at_sensors[:, mode - 1] / modes.at_sensors[3, mode - 1]
    level = np.linspace(1e-4, 2e-3, n)
    hz = factor * modes.frequency_hz[mode - 1] * (1 + 1e4 * level**2)
    return MeasuredBackbone(name, mode, "tip", hz, level[:, None] * shape, DOFS)


@pytest.fixture
def place(tmp_path):
    """A directory with structure.npz and first.csv."""
    write_structure(tmp_path / "structure.npz", small_chain())
    write_backbone(curve_of(), tmp_path / "first.csv")
    return tmp_path


def study_of(place, text):
    path = place / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_updating_study(path)


def refused(place, text, *words):
    with pytest.raises(InputError) as caught:
        study_of(place, text)
    for word in words:
        assert word in str(caught.value)
    return str(caught.value)


# ---- backbones -------------------------------------------------------------------------------------


def written(tmp_path, text):
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_backbone_is_read_back_to_the_last_bit(tmp_path):
    curve = curve_of(2)
    write_backbone(curve, tmp_path / "second.csv")
    back = read_backbone(tmp_path / "second.csv", mode=2, controlled_sensor="tip", sensors=DOFS)
    assert (back.name, back.mode, back.sensors) == ("second", 2, DOFS)
    np.testing.assert_array_equal(back.frequency_hz, curve.frequency_hz)
    np.testing.assert_array_equal(back.amplitude, curve.amplitude)


@pytest.mark.parametrize(
    ("unit", "order", "factor"),
    [("mm", 0, 1e3), ("µm", 0, 1e6), ("m/s", 1, 1.0), ("m/s^2", 2, 1.0), ("g", 2, 1 / 9.80665)],
)
def test_any_unit_of_motion_becomes_metres(tmp_path, unit, order, factor):
    curve = curve_of()
    values = factor * curve.amplitude * (2 * np.pi * curve.frequency_hz[:, None]) ** order
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in np.column_stack([curve.frequency_hz, values]))
    path = written(tmp_path, f"Frequency [Hz],a ({unit}),b [{unit}],c [{unit}],tip [{unit}]\n{rows}\n")
    back = read_backbone(path, mode=1, controlled_sensor="tip")
    np.testing.assert_allclose(back.amplitude, curve.amplitude, rtol=1e-14)
    bare = written(tmp_path, f"freq,a,b,c,tip\n{rows}\n")
    told = read_backbone(bare, mode=1, controlled_sensor="tip", unit=unit)
    np.testing.assert_allclose(told.amplitude, curve.amplitude, rtol=1e-14)


def test_columns_come_in_the_order_of_the_sensors_and_forces_are_left_out(tmp_path):
    path = written(tmp_path, "# test 3\ntip [mm];omega;force [N];a [mm]\n0,1;90,5;3,1;0,2\n1;91;4;0,3\n2;92;5;0,4\n")
    back = read_backbone(path, mode=1, controlled_sensor="tip", sensors=DOFS)
    assert back.sensors == ("a", "tip")
    np.testing.assert_allclose(back.frequency_hz, np.array([90.5, 91, 92]) / (2 * np.pi))
    np.testing.assert_allclose(back.amplitude, [[2e-4, 1e-4], [3e-4, 1e-3], [4e-4, 2e-3]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "one column"),
        ("tip,a\n1,2\n", "no column of frequencies"),
        ("f,frequency_hz,tip\n1,1,2\n", "2 columns of frequencies"),
        ("f [s],tip\n1,2\n", "give them in Hz"),
        ("f,tip\n1,2\n2,x\n", "line 3 has 'x'"),
        ("f,tip\n1,2\n2\n", "line 3 has 1 cells"),
        ("f,tip [kg]\n1,2\n2,3\n3,4\n", "give a unit of motion"),
        ("f,tip [mm]\n1,2\n0,3\n3,4\n", "row 2 has no positive frequency"),
        ("f,tip [mm],tpi [mm]\n1,2,3\n", "'tpi [mm]' is no sensor of the structure: did you mean 'tip'"),
        ("f,tip [mm],tip [m]\n1,2,3\n", "two columns"),
        ("f,force [N]\n1,2\n", "no column of a sensor"),
        ("f,tip\n14,0.2\n15,1\n16,4\n", "reaches 4 m, for no unit is stated"),
        ("f,tip [m]\n14,0.2\n15,1\n16,4\n", "reaches 4 m, as it is stated"),
        ("f,tip [mm]\n14,1\n15,2\n", "has 2 point(s): give at least 3"),
        ("f,tip [mm]\n14,1\n15,3\n16,2\n", "does not grow at point 3"),
        ("f,tip [mm]\n14,1\n15,\n16,2\n", "not finite"),
    ],
)
def test_a_file_that_is_no_backbone_is_refused(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        read_backbone(written(tmp_path, text), mode=1, controlled_sensor="tip", sensors=DOFS)
    assert words in str(caught.value)
    assert "curve.csv" in str(caught.value)


def test_a_sensor_that_cannot_head_a_column_is_not_written(tmp_path):
    curve = replace(curve_of(), sensors=("a", "b", "f", "tip"))
    with pytest.raises(InputError, match="'f' cannot be the name of a column"):
        write_backbone(curve, tmp_path / "x.csv")


# ---- classes ---------------------------------------------------------------------------------------


def test_laws_have_short_and_full_names_and_scales_have_units():
    assert kind_named("Even quadratic") == "even_quadratic_stiffness"
    assert kind_named("cubic_stiffness") == "cubic_stiffness"
    table = {"law": "cubic+quartic", "scale": ["0.0884 N/mm^3", "-0.0027 N/mm4"]}
    found = model_class(table)
    assert found.name == "cubic+quartic"
    np.testing.assert_allclose(found.scales, [8.84e7, -2.7e9], rtol=1e-12)
    assert found.priors == (Prior(), Prior())
    assert model_class({"law": "quadratic", "scale": "0.216 kN / m^2"}).scales == (216.0,)
    assert model_class(class_table(found)) == replace(found, name="cubic+quartic")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"law": "cubik", "scale": 1}, "did you mean 'cubic'"),
        ({"law": "cubic + quintic", "scale": [1]}, "2 term(s) and 1 scale(s)"),
        ({"law": "cubic", "scale": "0.068 N/mm^2"}, "its unit is N/m^3"),
        ({"law": "cubic", "scale": "much"}, "give a number in N/m^3"),
        ({"law": "cubic", "scale": 0}, "other than 0"),
        ({"law": "cubic", "scale": 1, "prior": ["flat", 0, 1]}, "no prior 'flat'"),
        ({"law": "cubic", "scale": 1, "prior": ["uniform", 0]}, 'give a list like ["uniform", 0, 10]'),
        ({"law": "cubic", "scale": 1, "prior": ["uniform", 5, 0]}, "lower end first"),
        ({"law": "cubic + quintic", "scale": 1, "prior": [["uniform", 0, 1]]}, "2 term(s) and 1 prior(s)"),
        ({"law": "cubic + cubic", "scale": 1}, "twice"),
        ({"law": "signed power", "scale": 1}, "no spring with one coefficient"),
        ({"law": "cubic damping", "scale": 1}, "no spring"),
    ],
)
def test_a_class_that_cannot_be_is_refused(table, words):
    with pytest.raises(InputError) as caught:
        model_class(table)
    assert words in str(caught.value)


def test_priors_are_lists():
    assert prior_of(["uniform", -9, 9]) == Prior("uniform", -9.0, 9.0)
    for given in (None, [], ["uniform", "a", 1], "uniform"):
        with pytest.raises(InputError, match="give a list like"):
            prior_of(given)


# ---- against the structure -------------------------------------------------------------------------


def test_sound_backbones_have_no_faults():
    assert list(backbone_faults(small_chain(), [curve_of(), curve_of(2, name="second")])) == []
    # an initial structure may be stiffer by far, as in the paper
    assert list(backbone_faults(small_chain(2.4 * 4e4), [curve_of()])) == []


def test_frequencies_far_from_any_mode_are_told_with_the_nearest():
    # radians a second
    (fault,) = backbone_faults(small_chain(), [curve_of(4, factor=2 * np.pi)])
    assert "begins at 265.8 Hz" in fault
    assert "nearest is mode 4 at 42.3" in fault
    assert "look at the unit" in fault


def test_a_mode_with_another_number_is_told_by_its_shape():
    (fault,) = backbone_faults(small_chain(), [replace(curve_of(4), mode=1)])
    assert "its shape and frequency are those of mode 4 at 42.3" in fault
    (fault,) = backbone_faults(small_chain(), [replace(curve_of(), mode=9)])
    assert "is of mode 9, and the structure has 4" in fault


def test_modes_that_cross_and_curves_that_stand_apart_are_told():
    crossing = [curve_of(1, factor=2.9), curve_of(2, name="second", factor=0.8)]
    (fault,) = backbone_faults(small_chain(), crossing)
    assert "they cross" in fault
    apart = [curve_of(), curve_of(name="b"), curve_of(name="c", factor=1.2)]
    (fault,) = backbone_faults(small_chain(), apart)
    assert "'c' begins at" in fault
    assert "of another mode?" in fault


def test_matrices_that_are_not_positive_are_told():
    chain = small_chain()
    assert list(structure_faults(chain)) == []
    free = np.diag([1.0, 2, 2, 1]) - np.eye(4, k=1) - np.eye(4, k=-1)
    assert list(structure_faults(replace(chain, stiffness=1e6 * free, parts={}))) == []  # it may float
    wrong = replace(chain, stiffness=-1.2 * chain.stiffness)
    assert "the stiffness matrix is not positive" in next(iter(structure_faults(wrong)))
    mass = 2 * np.eye(4) + 3 * np.eye(4, k=1) + 3 * np.eye(4, k=-1)
    assert "the mass matrix is not positive" in next(iter(structure_faults(replace(chain, mass=mass))))


# ---- whole studies ---------------------------------------------------------------------------------


def test_a_study_is_read_as_it_is_written(place):
    study = study_of(place, STUDY)
    assert study.title == "A chain"
    assert study.structure.sensors == DOFS
    assert dict(study.structure.joints) == {"end": ("c", "tip")}
    assert list(study.structure.parts) == ["E"]
    assert study.classes[0] == ModelClass("class 2", ("cubic_stiffness",), (6.8e7,), (Prior("uniform", 0, 5),))
    assert study.classes[1].priors == (Prior(), Prior("normal", 0, 3))
    assert study.backbones[0].name == "first"
    assert dict(study.parameters) == {"E": Prior("lognormal", 1, 0.3)}
    assert (study.form, study.sampler, study.n_samples, study.seed) == ("recommended", "adaptive", 1500, 7)
    assert study.source == place / "study.toml"


def test_what_is_written_is_read_back(place):
    study = study_of(
        place, 'form = "paper"\nharmonics = [1]\n' + STUDY + "[noise]\npoint_noise = 0.002\nshapes = false\n"
    )
    study = replace(study, noise=replace(study.noise, cov={1: 0.003}), n_internal=2, sampler="transitional")
    target = place / "again" / "study.toml"
    target.parent.mkdir()
    write_updating_study(study, target)
    again = read_updating_study(target)
    for name in ("title", "form", "classes", "parameters", "sampler", "n_samples", "seed", "harmonics", "noise"):
        assert getattr(again, name) == getattr(study, name), name
    assert (again.n_internal, again.noise.shapes, again.noise.cov) == (2, False, {1: 0.003})
    np.testing.assert_array_equal(again.backbones[0].amplitude, study.backbones[0].amplitude)
    assert abs(again.structure.stiffness_at({}) - study.structure.stiffness_at({})).max() == 0


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
    for words in ("the joint 'end' is ['c']", "'F', which is no parameter", "point_noise", "give true or false"):
        assert words in told
    assert "7 faults" in told


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
    write_updating_study(replace(study, backbones=named), place / "again" / "study.toml")
    files = {path.name for path in (place / "again").iterdir()}
    assert files == {"mode_1_sensor_a_b.csv", "_x.csv", "plain.csv", "structure.npz", "study.toml"}
    back = read_updating_study(place / "again" / "study.toml")
    assert [curve.name for curve in back.backbones] == [curve.name for curve in named]


def test_what_cannot_be_written_is_refused(place):
    study = study_of(place, STUDY)
    for names in (("..",), ("a b", "a,b")):
        wrong = replace(study, backbones=tuple(replace(study.backbones[0], name=name) for name in names))
        with pytest.raises(InputError, match="cannot name its file"):
            write_updating_study(wrong, place / "x.toml")
    modes = nominal_modes(study.structure, 4)
    with pytest.raises(InputError, match="needs its matrices"):
        write_updating_study(replace(study, structure=modes, parameters={}), place / "x.toml")
