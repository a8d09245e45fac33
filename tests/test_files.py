"""A file is written whole or not at all."""

import os
import stat

import pytest

from opid.errors import InputError
from opid.signals.files import write_whole


def write(path, text="new"):
    with write_whole(path) as file:
        file.write(text)


def test_the_file_appears_at_the_end_and_nothing_else_stays(tmp_path):
    path = tmp_path / "note.txt"
    with write_whole(path) as file:
        file.write("one\ntwo\n")
        assert not path.exists()
    assert path.read_bytes() == b"one\ntwo\n"
    assert os.listdir(tmp_path) == ["note.txt"]


def test_bytes(tmp_path):
    with write_whole(tmp_path / "picture.png", "wb") as file:
        file.write(b"\x89PNG")
    assert (tmp_path / "picture.png").read_bytes() == b"\x89PNG"


def fail_while_writing(path):
    with write_whole(path) as file:
        file.write("half")
        raise ZeroDivisionError


def test_a_failure_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError):
        fail_while_writing(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["note.txt"]


def test_the_permissions_are_the_usual_ones(tmp_path):
    (tmp_path / "usual").write_text("")
    write(tmp_path / "ours")
    assert stat.S_IMODE((tmp_path / "ours").stat().st_mode) == stat.S_IMODE((tmp_path / "usual").stat().st_mode)


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to("target")
    write(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"


def test_a_missing_directory_a_directory_and_a_device_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is no directory"):
        write(tmp_path / "missing" / "note.txt")
    with pytest.raises(InputError, match="a directory or a device"):
        write(tmp_path)
    with pytest.raises(InputError, match="a directory or a device"):
        write("/dev/null")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_directory_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"):
        write(tmp_path / "note.txt")


def write_to_a_full_disk(path):
    with write_whole(path) as file:
        full = os.open("/dev/full", os.O_WRONLY)
        os.dup2(full, file.fileno())
        os.close(full)
        file.write("more than fits")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
def test_a_full_disk_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="No space left"):
        write_to_a_full_disk(tmp_path / "note.txt")
    assert os.listdir(tmp_path) == []


def test_an_error_about_another_file_passes_through(tmp_path):
    with pytest.raises(FileNotFoundError), write_whole(tmp_path / "note.txt"):
        (tmp_path / "other").read_text()
    assert os.listdir(tmp_path) == []
