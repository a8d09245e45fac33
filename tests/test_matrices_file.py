import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.io import hb_write, mmwrite, savemat

from opid.errors import InputError
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import read_structure, write_structure
from opid.updating.structure.reduction import craig_bampton

N_DOF = 6
DOFS = tuple(f"{node} UX" for node in range(1, N_DOF + 1))
SENSORS = ("1 UX", "6 UX")
JOINTS = {"link": ("2 UX", "5 UX")}


def chain(stiffness):
    """Springs between neighbours, the first to a wall."""
    full = np.diag(stiffness + np.append(stiffness[1:], 0.0))
    return full - np.diag(stiffness[1:], 1) - np.diag(stiffness[1:], -1)


SOFT = chain(np.array([100.0, 0, 0, 0, 0, 0]))
PART = chain(np.array([0.0, 200, 300, 400, 500, 600]))
MASS = np.diag(np.arange(1.0, N_DOF + 1))


def keys(**changes):
    found = {"mass": MASS, "stiffness": SOFT, "part_E": PART, "dofs": np.array(DOFS), "sensors": np.array(SENSORS)}
    found |= {"joints": np.array([["link", "2 UX", "5 UX"]])} | changes
    return {name: value for name, value in found.items() if value is not None}


def npz(path, **changes):
    file = path / "structure.npz"
    np.savez(file, **keys(**changes))
    return file


def same(found, truth):
    for name in ("mass", "stiffness"):
        assert abs(getattr(found, name) - getattr(truth, name)).max() == 0.0
    assert found.parts.keys() == truth.parts.keys()
    assert all(abs(found.parts[name] - truth.parts[name]).max() == 0.0 for name in truth.parts)
    assert (found.dofs, found.sensors, dict(found.joints)) == (truth.dofs, truth.sensors, dict(truth.joints))


@pytest.fixture
def truth():
    return AffineStructure(MASS, SOFT, {"E": PART}, DOFS, SENSORS, JOINTS)


def test_what_is_written_is_read_back(tmp_path, truth):
    write_structure(tmp_path / "a.npz", truth)
    same(read_structure(tmp_path / "a.npz"), truth)
    bare = AffineStructure(MASS, SOFT + PART, {}, DOFS, SENSORS)
    write_structure(tmp_path / "b.npz", bare)
    same(read_structure(str(tmp_path / "b.npz")), bare)


def test_dense_npz(tmp_path, truth):
    same(read_structure(npz(tmp_path)), truth)


def test_matlab_sparse_and_full_with_cells_and_character_matrices(tmp_path, truth):
    cells = np.array(DOFS, dtype=object)
    joints = np.array([["link", "2 UX", "5 UX"]], dtype=object)
    held = {"mass": sparse.csc_matrix(MASS), "stiffness": SOFT, "part_E": sparse.csc_matrix(PART)}
    savemat(tmp_path / "a.mat", held | {"dofs": cells, "sensors": np.array(SENSORS), "joints": joints})
    same(read_structure(tmp_path / "a.mat"), truth)


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
def test_a_file_for_each_matrix(tmp_path, truth, symmetry):
    (tmp_path / "dofs.txt").write_text("\n".join(DOFS) + "\n")
    mmwrite(tmp_path / "m.mtx", sparse.coo_matrix(MASS), symmetry=symmetry)
    mmwrite(tmp_path / "plain.mtx", sparse.coo_matrix(PART), symmetry=symmetry)
    (tmp_path / "k.mtx.gz").write_bytes(gzip.compress((tmp_path / "plain.mtx").read_bytes()))
    sparse.save_npz(tmp_path / "k0.npz", sparse.csc_matrix(SOFT))
    files = {"mass": tmp_path / "m.mtx", "stiffness": tmp_path / "k0.npz", "part_E": tmp_path / "k.mtx.gz"}
    settings = {"sensors": SENSORS, "joints": {"link": ["2 UX", "5 UX"]}, "dofs": tmp_path / "dofs.txt"}
    same(read_structure(files, **settings), truth)
    np.save(tmp_path / "m.npy", MASS)
    same(read_structure(files | {"mass": tmp_path / "m.npy"}, **settings), truth)


def test_harwell_boeing_whole_or_as_one_triangle_with_either_exponent(tmp_path, truth):
    hb_write(str(tmp_path / "m.hb"), sparse.csc_matrix(MASS))
    hb_write(str(tmp_path / "whole.hb"), sparse.csc_matrix(PART))
    hb_write(str(tmp_path / "lower.hb"), sparse.csc_matrix(np.tril(PART)))
    text = (tmp_path / "lower.hb").read_text()
    (tmp_path / "k.RSA").write_text(text.replace("RUA", "RSA", 1))
    sparse.save_npz(tmp_path / "k0.npz", sparse.csc_matrix(SOFT))
    given = {"sensors": SENSORS, "joints": {"link": ["2 UX", "5 UX"]}, "dofs": list(DOFS)}
    files = {"mass": tmp_path / "m.hb", "stiffness": tmp_path / "k0.npz"}
    same(read_structure(files | {"part_E": tmp_path / "k.RSA"}, **given), truth)
    head, data = text.split("\n", 1)
    (tmp_path / "d.rsa").write_text(f"{head}\n{data.replace('RUA', 'RSA', 1).replace('E', 'D')}")
    same(read_structure(files | {"part_E": tmp_path / "d.rsa"}, **given), truth)
    same(read_structure(files | {"part_E": tmp_path / "whole.hb"}, **given), truth)
    (tmp_path / "cut.hb").write_text(text[:100])
    with pytest.raises(InputError, match=r"cut[.]hb cannot be read"):
        read_structure(files | {"part_E": tmp_path / "cut.hb"}, **given)


@pytest.mark.parametrize("triangle", [np.triu, np.tril, np.array])
def test_the_code_of_the_page_makes_matrices_of_text_with_a_triangle(tmp_path, truth, monkeypatch, triangle):
    page = (Path(__file__).parent.parent / "docs" / "bayesian_updating.md").read_text(encoding="utf-8")
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "read_triangle" in block]
    for name, matrix in (("nominal.sti", SOFT + PART), ("stiffer.sti", SOFT + 1.1 * PART), ("nominal.mas", MASS)):
        found = sparse.coo_matrix(triangle(matrix))
        entries = zip(found.row + 1, found.col + 1, found.data, strict=True)
        (tmp_path / name).write_text("".join(f"{row} {column} {value:20.13e}\n" for row, column, value in entries))
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    files = {"mass": "mass.mtx", "stiffness": "stiffness.mtx", "part_E": "part_E.mtx"}
    read = read_structure(files, sensors=SENSORS, joints={"link": ["2 UX", "5 UX"]}, dofs=list(DOFS))
    for name in ("mass", "stiffness"):
        assert abs(getattr(read, name) - getattr(truth, name)).max() < 1e-9 * abs(truth.parts["E"]).max()
    assert abs(read.parts["E"] - truth.parts["E"]).max() < 1e-9 * abs(truth.parts["E"]).max()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "".join(f"{label.replace(' ', ',')}\n" for label in DOFS)),
        ("b.csv", "node,direction\n" + "".join(f"{label.replace(' ', ', ')}\n" for label in DOFS)),
        ("c.csv", "number,DOF\n" + "".join(f"{k},{label}\n" for k, label in enumerate(DOFS))),
        ("d.csv", "\ufeffdof\n" + "".join(f"{label}\r\n" for label in DOFS)),
        ("e.txt", "".join(f"{label}  \n\n" for label in DOFS)),
    ],
)
def test_labels_from_text_and_csv(tmp_path, truth, name, text):
    (tmp_path / name).write_text(text, encoding="utf-8")
    same(read_structure(npz(tmp_path, dofs=None), dofs=tmp_path / name), truth)


def test_without_labels_they_are_numbers(tmp_path):
    found = read_structure(npz(tmp_path, dofs=None, sensors=np.array([1, 6]), joints=np.array([[1, 2, 5]])))
    assert found.dofs == ("1", "2", "3", "4", "5", "6")
    assert found.sensors == ("1", "6")
    assert found.joints["1"] == ("2", "5")


def test_what_is_told_goes_before_what_the_file_says(tmp_path):
    found = read_structure(npz(tmp_path), sensors=["3 UX"], joints={})
    assert found.sensors == ("3 UX",)
    assert not found.joints


def test_parts_that_are_not_updated_join_the_stiffness(tmp_path):
    file = npz(tmp_path, part_other=2 * PART)
    assert list(read_structure(file).parts) == ["E", "other"]
    assert list(read_structure(file, parameters=["other", "E"]).parts) == ["other", "E"]
    found = read_structure(file, parameters=["E"])
    assert list(found.parts) == ["E"]
    np.testing.assert_allclose(found.stiffness.toarray(), SOFT + 2 * PART)
    np.testing.assert_allclose(read_structure(file, parameters=[]).stiffness.toarray(), SOFT + 3 * PART)


def one_sided(matrix):
    return np.tril(matrix)


BAD = [
    ({"mass": None}, "there is no matrix 'mass': known are 'stiffness', 'part_E'"),
    ({"mass": None, "maas": MASS}, "there is no matrix 'mass': did you mean 'maas'"),
    ({"stifness": SOFT, "stiffness": None}, "'stifness' is not a known name of a matrix: did you mean 'stiffness'"),
    ({"stiffness": None, "part_E": None}, "neither a matrix 'stiffness' nor a part_NAME"),
    ({"part_E": one_sided(PART)}, "stiffness part 'E' matrix is not symmetric: export the whole matrix"),
    ({"mass": one_sided(MASS) + np.eye(N_DOF, k=-1)}, "mass matrix is not symmetric"),
    ({"stiffness": SOFT[:5, :5]}, r"'stiffness' has shape \(5, 5\) and 'mass' \(6, 6\)"),
    ({"part_E": PART[:4]}, r"'part_E' has shape \(4, 6\): give a square matrix"),
    ({"mass": np.where(MASS == 3, 0, MASS)}, "mass of '3 UX' is not positive"),
    ({"mass": MASS + 9 * (np.eye(N_DOF, k=1) + np.eye(N_DOF, k=-1))}, "mass matrix is not positive"),
    ({"part_E": -PART}, "stiffness matrix is not positive"),
    ({"mass": MASS * 1j}, "'mass' does not hold real numbers"),
    ({"mass": np.where(MASS == 3, np.nan, MASS)}, "entries that are not finite"),
    ({"sensors": np.array(["1 UX", "7 UX"])}, "names the degree of freedom '7 UX', which does not exist: did you"),
    ({"sensors": None}, "no sensor is named"),
    ({"joints": np.array([["link", "2 UX", "5 UY"]])}, "joint 'link' names the degree of freedom '5 UY'"),
    ({"joints": np.array([["link", "2 UX", "2 UX"]])}, "between '2 UX' and itself"),
    ({"joints": np.array([["link", "2 UX", "3 UX", "5 UX"]])}, "joint 'link' has 3 ends: name the two between which"),
    ({"joints": np.array([["foot", "2 UY"]])}, "joint 'foot' names the degree of freedom '2 UY'"),
    ({"joints": np.array([["a", "2 UX", "5 UX"], ["a", "1 UX", "5 UX"]])}, "two joints are called 'a'"),
    ({"dofs": np.array(DOFS[:5])}, "names 5 degrees of freedom, the matrices have 6"),
    ({"dofs": np.array([*DOFS[:5], "1 UX"])}, "called '1 UX'"),
    ({"dofs": np.array(DOFS, dtype=object)}, "'dofs' of it holds Python objects, which are never read"),
    ({"part_E": None, "part_E_indptr": np.arange(7)}, "the sparse matrix 'part_E' lacks part_E_data"),
    (
        {"mass": None, "mass_data": np.ones(6), "mass_indices": np.full(6, 9), "mass_indptr": np.arange(7)},
        "the arrays of 'mass' do not make a sparse matrix",
    ),
]


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_matrices_are_told(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        read_structure(npz(tmp_path, **changes))


def test_all_faults_of_matrices_are_told_at_once(tmp_path):
    wrong = {
        "mass": np.where(MASS == 3, 0, MASS),
        "stiffness": one_sided(SOFT + PART),
        "part_E": PART[:4],
        "part_F": SOFT[:5, :5],
        "maas": MASS,
        "sensors": np.array(["1 UX", "7 UX", "8 UX"]),
        "joints": np.array([["link", "2 UX", "5 UY"], ["loop", "2 UX", "2 UX"]]),
    }
    file = npz(tmp_path, **wrong)
    with pytest.raises(InputError) as caught:
        read_structure(file, parameters=["G"])
    message = str(caught.value)
    assert message.startswith(f"{file}: 10 faults: (1) ")
    for words in (
        "mass of '3 UX' is not positive", "stiffness matrix is not symmetric", "'part_E' has shape (4, 6)",
        "'part_F' has shape (5, 5) and 'mass' (6, 6)", "'maas' is not a known name of a matrix", "'7 UX'", "'8 UX'",
        "joint 'link' names the degree of freedom '5 UY'", "between '2 UX' and itself", "no matrix 'part_G'",
    ):  # fmt: skip
        assert words in message


def test_all_files_that_cannot_be_read_are_told_at_once(tmp_path):
    np.save(tmp_path / "m.npy", MASS)
    files = {"mass": tmp_path / "m.npy", "stiffness": tmp_path / "k.mtx", "part_E": tmp_path / "e.xls"}
    with pytest.raises(InputError) as caught:
        read_structure(files, sensors=["9"], joints={})
    message = str(caught.value)
    assert message.startswith("the matrices ")
    assert ": 3 faults: " in message
    for words in ("there is no file", "e.xls has an unknown format", "'9', which does not exist"):
        assert words in message


def test_bad_files_are_told(tmp_path):
    (tmp_path / "cut.npz").write_bytes(npz(tmp_path).read_bytes()[:200])
    (tmp_path / "text.mat").write_text("no MATLAB file at all" * 20)
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(600))
    (tmp_path / "m.mtx").write_text("%%MatrixMarket matrix coordinate real general\n2 2 1\n5 5 1.0\n")
    (tmp_path / "m.xls").write_text("1")
    for source, message in [
        (tmp_path / "none.npz", "there is no file"),
        (tmp_path / "cut.npz", "no valid .npz file"),
        (tmp_path / "text.mat", "cannot be read"),
        (tmp_path / "new.mat", "version 7.3: save it with '-v7'"),
        (tmp_path / "m.mtx", "holds one matrix: give a file for each"),
        (tmp_path / "m.xls", "unknown format: give .npz, .mat"),
        ({"mass": tmp_path / "m.xls"}, "unknown format for a matrix"),
        ({"mass": tmp_path / "m.mtx"}, "cannot be read"),
    ]:
        with pytest.raises(InputError, match=message):
            read_structure(source)


def test_a_joint_to_the_ground_has_one_end(tmp_path):
    """From a table, from rows with or without a column for the other end, and from the file that is written."""
    rows = np.array([["link", "2 UX", "5 UX"], ["foot", "3 UX", ""]])
    found = read_structure(npz(tmp_path, joints=rows))
    assert dict(found.joints) == {"link": ("2 UX", "5 UX"), "foot": ("3 UX",)}
    np.testing.assert_array_equal(found.joint_rows, [[0, -1, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0]])
    write_structure(tmp_path / "again.npz", found)
    assert read_structure(tmp_path / "again.npz").joints == found.joints
    assert read_structure(npz(tmp_path), joints={"foot": "3 UX"}).joints == {"foot": ("3 UX",)}
    assert read_structure(npz(tmp_path, joints=rows[1:, :2])).joints == {"foot": ("3 UX",)}
    # the reduced structure keeps the end as a coordinate
    assert "3 UX" in craig_bampton(found, n_modes=1).boundary


def test_bad_labels_and_names_are_told(tmp_path):
    file = npz(tmp_path)
    (tmp_path / "few.csv").write_text("1 UX\n")
    (tmp_path / "holes.csv").write_text("number,dof\n1\n")
    (tmp_path / "binary.txt").write_bytes(b"\xff\xfe\xfa")
    for settings, message in [
        ({"dofs": tmp_path / "few.csv"}, "few.csv names 1 degrees of freedom, the matrices have 6"),
        ({"dofs": tmp_path / "holes.csv"}, "lines without the column 'dof'"),
        ({"dofs": tmp_path / "binary.txt"}, "cannot be read as text"),
        ({"dofs": tmp_path / "gone.txt"}, "there is no file"),
        ({"parameters": ["e"]}, "no matrix 'part_e' for the parameter 'e'"),
        ({"sensors": "1 UX"}, "sensors is the text '1 UX': give a list"),
        (
            {"joints": {"link": []}},
            "joint 'link' has 0 ends: name the two between which it lies, or one for the ground",
        ),
    ]:
        with pytest.raises(InputError, match=message):
            read_structure(file, **settings)
