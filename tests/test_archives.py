"""NumPy archives that are sound, damaged, absurd or hostile: arrays, or one clear sentence, and never an allocation."""

import io
import tracemalloc
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from numpy.lib import format as npy
from scipy import sparse

from opid.errors import InputError
from opid.modal.linear.modes_file import read_modes
from opid.signals.logs import archives, open_log
from opid.signals.logs.archives import read_archive, read_array
from opid.updating.structure.matrices_file import read_structure

ARRAYS = {"mass": np.eye(3), "stiffness": 9.0 * np.eye(3), "names": np.array(["a", "b", "c"])}


def archive_of(members, compression=zipfile.ZIP_DEFLATED):
    """The bytes of an archive whose members are bytes by their name, in pairs."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return file.getvalue()


def array_of(shape, dtype="<f8", data=b""):
    """The bytes of an array whose header may say anything."""
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"shape": shape, "fortran_order": False, "descr": dtype})
    return file.getvalue() + data


def saved(array, **choices):
    file = io.BytesIO()
    np.save(file, array, **choices)
    return file.getvalue()


SOUND = archive_of([(f"{name}.npy", saved(array)) for name, array in ARRAYS.items()])
SPOILED = {
    "an absurd shape": ([("a.npy", array_of((1 << 40, 1 << 40)))], "has the shape (1099511627776, 1099511627776)"),
    "a shape that wraps around": ([("a.npy", array_of((1 << 62, 4)))], "has the shape"),
    "a negative shape": ([("a.npy", array_of((-1, 8), data=bytes(64)))], "-1"),
    "12 GB promised": ([("a.npy", array_of((1_500_000_000,)))], "which takes 12000000000 bytes, and there are 0"),
    "text in the place of an array": ([("a.npy", b"hello, this is no array")], "no valid .npz file"),
    "an empty member": ([("a.npy", b"")], "no valid .npz file"),
    "a header that is a program": ([("a.npy", b"\x93NUMPY\x01\x00\x10\x00__import__('os')")], "no valid .npz file"),
    "two arrays of a name": ([("a.npy", saved(np.ones(2))), ("a.npy", saved(np.ones(3)))], "2 arrays of the name 'a'"),
    "an unknown version": ([("a.npy", b"\x93NUMPY\x09\x00" + bytes(20))], "unknown version"),
}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("kind", SPOILED)
def test_what_is_spoiled_is_told_before_anything_is_allocated(kind, tmp_path):
    members, words = SPOILED[kind]
    path = tmp_path / "spoiled.npz"
    path.write_bytes(archive_of(members))
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        read_archive(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert words in str(caught.value)
    assert peak < 5e6


def test_an_encrypted_member_is_told(tmp_path):
    content = bytearray(archive_of([("a.npy", saved(np.ones(3)))], zipfile.ZIP_STORED))
    # the flag of encryption in the local header and in the directory
    content[6] |= 1
    content[content.index(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "locked.npz").write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"'a.npy' is encrypted: write the file without a password"):
        read_archive(tmp_path / "locked.npz")


def test_what_the_memory_of_the_machine_does_not_hold_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("opid.signals.logs.archives.MEMORY_FRACTION", 1e-9)
    (tmp_path / "large.npz").write_bytes(SOUND)
    with pytest.raises(InputError, match="its arrays would take"):
        read_archive(tmp_path / "large.npz")


def test_objects_are_named_and_never_read(tmp_path):
    path = tmp_path / "pickled.npz"
    path.write_bytes(archive_of([("a.npy", saved(np.ones(2))), ("b.npy", saved(np.array([{}]), allow_pickle=True))]))
    found = read_archive(path)
    assert list(found.arrays) == ["a"]
    assert found.pickled == ("b",)
    with pytest.raises(InputError, match="'b' of it holds Python objects"):
        found.require_plain_arrays()
    (tmp_path / "b.npy").write_bytes(saved(np.array([{}]), allow_pickle=True))
    with pytest.raises(InputError, match="Python objects"):
        read_array(tmp_path / "b.npy")


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_damage_is_read_or_told(tmp_path, data):
    content = bytearray(SOUND)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    path = tmp_path / "damaged.npz"
    path.write_bytes(bytes(content))
    # Any other exception fails the test.
    with suppress(InputError):
        assert all(isinstance(array, np.ndarray) for array in read_archive(path).arrays.values())


FORMATS = ("csr", "csc", "bsr", "coo", "dia")


@pytest.mark.parametrize("kind", FORMATS)
def test_a_sparse_matrix_of_scipy_is_read_in_every_format(kind, tmp_path):
    sparse.save_npz(tmp_path / "mass.npz", sparse.csr_matrix(np.diag([2.0, 3.0])).asformat(kind))
    sparse.save_npz(tmp_path / "stiffness.npz", sparse.csr_matrix(np.array([[5.0, -1.0], [-1.0, 5.0]])).asformat(kind))
    found = read_structure({"mass": tmp_path / "mass.npz", "stiffness": tmp_path / "stiffness.npz"}, sensors=["1"])
    assert found.stiffness.toarray().tolist() == [[5.0, -1.0], [-1.0, 5.0]]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"indptr": np.array([0, -4, 2])}, "cannot be read"),
        ({"indices": np.array([0, 7])}, "cannot be read"),
        ({"data": np.array([np.inf, 1.0])}, "not finite"),
        ({"format": np.array(b"lil")}, "holds no sparse matrix"),
    ],
)
def test_a_sparse_matrix_that_is_none_is_told(changes, words, tmp_path):
    whole = sparse.csr_matrix(np.eye(2))
    arrays = {"format": np.array(b"csr"), "shape": np.array([2, 2])}
    arrays |= {piece: getattr(whole, piece) for piece in ("data", "indices", "indptr")} | changes
    np.savez(tmp_path / "mass.npz", **arrays)
    sparse.save_npz(tmp_path / "stiffness.npz", whole)
    with pytest.raises(InputError, match=words):
        read_structure({"mass": tmp_path / "mass.npz", "stiffness": tmp_path / "stiffness.npz"})


@pytest.mark.parametrize("read", [read_structure, read_modes, open_log])
def test_every_reader_of_archives_names_the_file_once(read, tmp_path):
    path = tmp_path / "absurd.npz"
    path.write_bytes(archive_of(SPOILED["an absurd shape"][0]))
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value).count("absurd.npz") == 1
    assert "has the shape" in str(caught.value)


def test_an_archive_of_many_members_is_told_before_any_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "MOST_MEMBERS", 3)
    few, many = tmp_path / "few.npz", tmp_path / "many.npz"
    np.savez(few, **{f"a{k}": np.ones(2) for k in range(3)})
    np.savez(many, **{f"a{k}": np.ones(2) for k in range(4)})
    assert len(read_archive(few).arrays) == 3
    with pytest.raises(InputError, match="4 arrays, and at most 3 are read"):
        read_archive(many)
