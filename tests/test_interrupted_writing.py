"""Results appear whole or not at all: signals, full disks, two processes, no home, and what is the user's own stays."""

import json
import os
import pickle
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
from cli_runs import opid, refused
from scripts import script
from small_logs import ended_after
from test_cli_output import GIVEN, WRITING

from opid.campaigns.campaign_file import read_campaign
from opid.cli.group import _end_cleanly
from opid.cli.output import Output
from opid.errors import InputError
from opid.signals import files
from opid.signals.files import require_directory, reserve_directory, write_together, write_whole
from opid.suspensions.flights.results import read_flights

OLD = {"result.json": b"old", "report.html": b"old page", "old.png": b"old picture"}
NEW = {"report.html": b"new page", "new.png": b"new picture", "result.json": b"new"}
OWN = {"mine.txt": b"mine", "modes.csv": b"mine, too"}
SHORT = ("--duration", 2, "--fs", 256)


def read_all(folder):
    """Return the content of each file of a folder by its name, hidden ones too; None of a folder that is not there."""
    return {path.name: path.read_bytes() for path in folder.iterdir()} if folder.exists() else None


# ---- at every step -------------------------------------------------------------------------------

# A child of this program stops before its k-th operation on files: it is killed, interrupted, or finds a full disk.
EVERY_STEP = """
import json, os, signal, sys
from pathlib import Path
from opid.errors import InputError
from opid.signals.files import reserve_directory, write_together

stop, parent, contents, older = sys.argv[1], Path(sys.argv[2]), json.loads(sys.argv[3]), json.loads(sys.argv[4])
contents = {name: text.encode() for name, text in contents.items()}
WRITING = os.O_WRONLY | os.O_RDWR
WATCHED = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.listdir", "os.truncate"}


def stop_at(step):
    left = [step]

    def watch(event, arguments):
        removes = event in ("os.remove", "os.rmdir", "os.listdir") or event == "open" and not arguments[2] & WRITING
        if event in WATCHED and not (stop == "full disk" and removes):
            left[0] -= 1
            if left[0] == 0:
                if stop == "kill":
                    os.kill(os.getpid(), signal.SIGKILL)
                raise KeyboardInterrupt if stop == "interrupt" else OSError(28, "No space left on device")

    sys.addaudithook(watch)


def read_all(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()} if folder.exists() else None


for step in range(1, 200):
    folder = parent / str(step) / "out"
    folder.parent.mkdir()
    if older is not None:
        folder.mkdir()
        for name, text in older.items():
            (folder / name).write_text(text)
    child = os.fork()
    if child == 0:
        told = 3
        try:
            stop_at(step)
            write_together(folder, contents, stale=["old.png"])
            told = 0
        except InputError as error:
            told = 2 if "No space left on device: choose another place" in str(error) else 4
        except KeyboardInterrupt:
            told = 130
        finally:
            os._exit(told)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    now, stays = read_all(folder), [path.name for path in folder.parent.rglob(".*")]
    with reserve_directory(folder):
        pass
    left = [str(path.relative_to(parent)) for path in folder.parent.rglob(".*")]
    print(json.dumps([status, now, stays, read_all(folder), left]))
    if status == 0 and step > 60:
        break
"""


def as_text(contents):
    return {name: content.decode() for name, content in contents.items()}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the steps are watched in a child of the process")
@pytest.mark.parametrize("stop", ["kill", "interrupt", "full disk"])
@pytest.mark.parametrize("older", [None, OLD | OWN, OWN], ids=["no directory", "an older result", "files of the user"])
def test_a_stop_at_any_step_leaves_the_old_or_the_new(stop, older, tmp_path):
    before = None if older is None else as_text(older)
    words = [stop, str(tmp_path), json.dumps(as_text(NEW)), json.dumps(before)]
    done = subprocess.run([sys.executable, "-c", EVERY_STEP, *words], capture_output=True, text=True, check=True)
    after = as_text(NEW | (OWN if older else {}))
    statuses = set()
    for status, now, stays, repaired, left in map(json.loads, done.stdout.splitlines()):
        statuses.add(status)
        if stop == "kill" and now not in (before, after):
            # it is stated that there is no result, and nothing is a mixture
            assert "result.json" not in now
            assert now.items() <= before.items() or now.items() <= after.items()
        elif stop != "kill":
            assert now in (before, after)
            assert stays == []
        assert repaired in (before, after)
        assert left == []
        assert repaired == after or status != 0
    stopped = {"kill": -signal.SIGKILL, "interrupt": 130, "full disk": 2}[stop]
    assert statuses == {0, stopped}


# ---- commands and signals ------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["taxi", "law", "decay", "inspect"])
def test_an_interrupted_command_leaves_nothing_or_all(name, tmp_path):
    """`benchmarks/interrupted_runs.py` does it for every command, at more moments."""
    runs = script("benchmarks/interrupted_runs.py")
    prepared = runs.prepare(name, tmp_path)
    rng = random.Random(sum(map(ord, name)))
    for signal_name in runs.SIGNALS:
        wrong, _, said = runs.interrupt(name, tmp_path, prepared, rng, signal_name)
        assert wrong == [], said


def test_a_signal_that_ends_the_command_is_one_sentence(field_test, tmp_path):
    words = [sys.executable, "-m", "opid", "identify", str(field_test / "study.toml"), "--out", "out"]
    for number, status, sentence in (
        (signal.SIGTERM, 143, "Error: ended by a signal of the system\n"),
        (signal.SIGINT, 130, "Error: interrupted\n"),
    ):
        process = subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        while not (tmp_path / ".out.part").exists():
            assert process.poll() is None
        process.send_signal(number)
        assert process.communicate() == ("", sentence)
        assert process.returncode == status
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_that_python_drops_is_sent_once_more(number):
    class Ends:
        def __del__(self):
            signal.raise_signal(number)

    def destroy_and_wait():
        Ends()
        time.sleep(60.0)

    with pytest.raises((SystemExit, KeyboardInterrupt)), _end_cleanly():
        destroy_and_wait()


@pytest.mark.parametrize("moment", ["stop()", "exec('stop()', {'stop': stop})"])
def test_an_interrupt_before_the_command_has_begun_is_one_sentence(moment, tmp_path):
    """Where a KeyboardInterrupt passes through `exec`, Python would end a module by the signal."""
    lines = "import signal\nimport opid.cli, opid.__main__\ndef stop(): signal.raise_signal(signal.SIGINT)\n"
    lines += f"opid.cli.main = lambda: {moment}\nopid.__main__.main()"
    (tmp_path / "interrupted.py").write_text(lines)
    words = [sys.executable, "-m", "interrupted"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Error: interrupted\n")


# ---- full disks ----------------------------------------------------------------------------------


@pytest.fixture
def largest_file():
    """Return a function that bounds the size of every file that is written, as a full disk does."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda n_bytes: resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("n_bytes", [0, 1, 1000, 20_000])
def test_a_full_disk_leaves_the_older_test_as_it_was(n_bytes, largest_file, tmp_path):
    assert opid("simulate", "taxi", tmp_path / "out", *SHORT).exit_code == 0
    before = read_all(tmp_path / "out")
    largest_file(n_bytes)
    done = opid("simulate", "taxi", tmp_path / "out", *SHORT, "--seed", 2, "--force")
    refused(done, f"cannot write into {tmp_path / 'out'}: File too large: choose another place")
    done = opid("simulate", "taxi", tmp_path / "new" / "out", *SHORT)
    refused(done, f"cannot write into {tmp_path / 'new' / 'out'}: File too large: choose another place")
    assert read_all(tmp_path / "out") == before
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("n_bytes", [0, 4000, 1_000_000])
def test_a_full_disk_leaves_the_older_report_as_it_was(n_bytes, field_test, largest_file, tmp_path):
    command = ("inspect", field_test / "heavy.csv", "--out", tmp_path / "out")
    assert opid(*command).exit_code == 0
    before = read_all(tmp_path / "out")
    largest_file(n_bytes)
    refused(opid(*command, "--png", "--force"), "File too large: choose another place")
    assert read_all(tmp_path / "out") == before


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
def test_a_full_disk_for_what_is_printed_is_one_sentence():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "opid", "laws"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (2, "Error: the system refuses: No space left on device\n")


# ---- two processes -------------------------------------------------------------------------------


@pytest.mark.parametrize("words", WRITING, ids=" ".join)
def test_a_second_command_for_the_same_folder_is_refused_before_its_work(words, tmp_path, monkeypatch):
    """The files that it names are not there, which it would say if it read them first."""
    monkeypatch.chdir(tmp_path)
    for folder in ("out", "there"):
        if folder == "there":
            Path(folder).mkdir()
        with reserve_directory(folder):
            done = opid(*words[1:], *GIVEN[words[1]], folder)
            refused(done, f"cannot write into {folder}: another process of opid is writing there: wait until")
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


def test_a_second_campaign_is_refused(field_test, tmp_path):
    with reserve_directory(tmp_path):
        refused(opid("campaign", field_test, "--out", tmp_path), "another process of opid is writing there")


def test_a_file_that_another_writes_is_waited_for_and_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "PATIENCE_S", 0.05)
    path = tmp_path / "note.txt"
    with write_whole(path) as file:
        file.write("first")
        with pytest.raises(InputError, match="another process of opid is writing there"), write_whole(path):
            pass
    assert read_all(tmp_path) == {"note.txt": b"first"}


def test_without_locks_nobody_is_refused_and_nothing_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_lock", lambda descriptor: None)
    with reserve_directory(tmp_path / "out") as one, reserve_directory(tmp_path / "out") as other:
        with one.replace_files() as folder:
            (folder / "a.txt").write_text("one")
        with other.replace_files() as folder:
            (folder / "a.txt").write_text("other")
    write_together(tmp_path / "out", {"b.txt": b"third"})
    with write_whole(tmp_path / "out" / "c.txt") as file:
        file.write("fourth")
    assert read_all(tmp_path / "out") == {"a.txt": b"other", "b.txt": b"third", "c.txt": b"fourth"}
    assert os.listdir(tmp_path) == ["out"]


# ---- what is left, and what is the user's --------------------------------------------------------


def test_what_a_killed_process_has_left_of_a_file_is_removed(tmp_path):
    (tmp_path / ".note.txt.part").write_text("half of something much longer")
    with write_whole(tmp_path / "note.txt") as file:
        file.write("whole")
    assert read_all(tmp_path) == {"note.txt": b"whole"}


def test_what_is_not_complete_is_read_by_nobody(field_test, identified, tmp_path):
    hidden = tmp_path / ".opid.part" / "new"
    hidden.mkdir(parents=True)
    (hidden / "study.toml").write_bytes((field_test / "study.toml").read_bytes())
    (hidden / "result.json").write_text(json.dumps(identified.result.to_dict()))
    with pytest.raises(InputError, match="there is no"):
        read_flights([tmp_path])
    with pytest.raises(InputError):
        read_campaign(tmp_path)


def test_the_folder_of_the_study_may_take_the_result(field_test, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("heavy.csv", "light.csv", "study.toml"):
        (tmp_path / name).write_bytes((field_test / name).read_bytes())
    (tmp_path / "modes.csv").write_text("mine")
    (tmp_path / "notes").mkdir()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    done = opid("identify", "study.toml", "--law", "arctan_velocity", "--no-figures", "--out", ".")
    assert done.exit_code == 0, done.output
    after = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert after.items() >= before.items()
    assert after.keys() - before.keys() == {"result.json", "report.html"}
    assert (tmp_path / "notes").is_dir()


def test_a_directory_in_the_place_of_a_file_stays(tmp_path):
    (tmp_path / "result.json").mkdir()
    (tmp_path / "report.html").write_text("old")
    with pytest.raises(InputError, match=r"result\.json: it is a directory: choose another place"):
        write_together(tmp_path, NEW)
    assert sorted(os.listdir(tmp_path)) == ["report.html", "result.json"]
    assert (tmp_path / "report.html").read_text() == "old"


def test_pictures_of_an_older_report_go_with_it(identified, tmp_path):
    """Those that its page names, whatever kind of result it was of; nothing outside the folder."""
    import opid as package

    outside = tmp_path / "outside.png"
    outside.write_bytes(b"mine")
    out = tmp_path / "out"
    out.mkdir()
    for name in ("older_mode.png", "mine.png"):
        (out / name).write_bytes(b"picture")
    (out / "report.html").write_text('<div data-chart="older_mode"></div><div data-chart="../outside"></div>')
    package.write_report(identified.result, out, figures=False)
    assert sorted(os.listdir(out)) == ["mine.png", "report.html", "result.json"]
    assert outside.exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
@pytest.mark.parametrize("name", ["report.html", "result.json"])
@pytest.mark.parametrize("put", [os.mkfifo, lambda path: path.symlink_to("/dev/zero"), Path.mkdir])
def test_what_stands_in_the_place_of_an_older_report_is_not_read(put, name, identified, tmp_path):
    """A pipe in the place of the page was read without an end."""
    import opid as package

    put(tmp_path / name)
    with ended_after(60):
        if put is Path.mkdir:
            with pytest.raises(InputError, match=f"cannot write .*{name}: it is a directory: choose another place"):
                package.write_report(identified.result, tmp_path, figures=False)
            assert os.listdir(tmp_path) == [name]
        else:
            package.write_report(identified.result, tmp_path, figures=False)
            assert sorted(os.listdir(tmp_path)) == ["report.html", "result.json"]
            assert all(path.is_file() and not path.is_symlink() for path in tmp_path.iterdir())


@pytest.mark.parametrize("is_older", [True, False])
def test_only_files_of_an_older_result_go_with_it(is_older, tmp_path):
    for name in ("modes_2.csv", "mine.csv", *(["result.json"] if is_older else [])):
        (tmp_path / name).write_text("older")
    with click.Context(click.Command("modes")):
        output = Output(tmp_path, True, False, False, False, figures=True, png=False).reserve(())
        with output.together(("modes.csv", "modes_[0-9]*.csv")) as folder:
            (folder / "modes.csv").write_text("newer")
    kept = {"mine.csv"} if is_older else {"mine.csv", "modes_2.csv"}
    assert {path.name for path in tmp_path.iterdir()} - {"result.json"} == kept | {"modes.csv"}


# ---- homes and caches ----------------------------------------------------------------------------


@pytest.mark.parametrize("home", [None, "/dev/null"])
def test_no_home_has_no_effect(home, field_test, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name not in ("HOME", "MPLCONFIGDIR")}
    environment |= {} if home is None else {"HOME": home}
    words = [sys.executable, "-m", "opid", "inspect", str(field_test / "heavy.csv"), "--out", "out", "--quiet"]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert sorted(os.listdir(tmp_path / "out")) == ["report.html", "result.json"]


KERNEL = """
from opid.mechanics.kernels.compilation import kernel

@kernel()
def add_one(x):
    return x + 1.0
"""


def make_kernel(folder):
    """Return a compiled function whose source stands in a folder, as after a new start of Python."""
    path = folder / "own_kernel.py"
    path.write_text(KERNEL)
    names = {"__name__": "own_kernel", "__file__": str(path)}
    exec(compile(KERNEL, str(path), "exec"), names)
    return names["add_one"]


def test_a_kernel_is_kept_and_found_again(tmp_path):
    assert make_kernel(tmp_path)(1.0) == 2.0
    assert {path.suffix for path in (tmp_path / "__pycache__").iterdir()} == {".nbi", ".nbc"}
    again = make_kernel(tmp_path)
    assert again(2.0) == 3.0
    assert sum(again.stats.cache_hits.values()) == 1


def test_a_kernel_without_any_place_for_its_code_is_compiled(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.caching.CacheImpl._locator_classes", [])
    assert make_kernel(tmp_path)(1.0) == 2.0


def test_a_full_disk_for_the_code_of_a_kernel_has_no_effect(largest_file, tmp_path):
    compiled = make_kernel(tmp_path)
    largest_file(10)
    assert compiled(1.0) == 2.0
    assert list((tmp_path / "__pycache__").iterdir()) == []


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
@pytest.mark.parametrize("n_kept", [0, 10, 100])
def test_the_code_of_a_kernel_that_is_cut_off_is_made_anew(ending, n_kept, tmp_path):
    assert make_kernel(tmp_path)(1.0) == 2.0
    (kept,) = (tmp_path / "__pycache__").glob(f"*{ending}")
    kept.write_bytes(kept.read_bytes()[:n_kept])
    assert make_kernel(tmp_path)(1.0) == 2.0


def test_an_index_of_something_else_is_made_anew(tmp_path):
    assert make_kernel(tmp_path)(1.0) == 2.0
    (kept,) = (tmp_path / "__pycache__").glob("*.nbi")
    kept.write_bytes(pickle.dumps("another version") + b"anything")
    assert make_kernel(tmp_path)(1.0) == 2.0


def test_a_hidden_folder_that_opid_did_not_make_ends_in_one_sentence(tmp_path):
    hidden = tmp_path / ".out.part"
    (hidden / "old").mkdir(parents=True)
    (hidden / "new").mkdir()
    (hidden / "names").write_bytes(b"../mine\0..\0")
    (hidden / "old" / "a").write_text("a", encoding="utf-8")
    (hidden / "new" / "b").write_text("b", encoding="utf-8")
    (tmp_path / "mine").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"\.out\.part"), reserve_directory(tmp_path / "out"):
        pass
    assert (tmp_path / "mine").read_text(encoding="utf-8") == "mine"


def test_a_place_that_cannot_be_made_ends_in_one_sentence(tmp_path):
    with pytest.raises(InputError, match="directories deep"):
        require_directory(tmp_path / ("x/" * 2000))
    if Path("/proc/self").is_dir():
        with pytest.raises(InputError, match="cannot write into /proc"), reserve_directory("/proc"):
            pass
