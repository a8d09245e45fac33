"""The same command writes the same result to the byte, whatever number of threads is set."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec

import pytest
from small_folders import SHORT, make_folders

MADE = {
    "taxi": ("simulate", "taxi", "made", *SHORT),
    "wing": ("simulate", "backbones", "made", "--points", "5", "--curves", "2", "1"),
    "resonance": ("simulate", "resonance", "made", "--levels", "3"),
}
LAW = ("--law", "arctan_velocity", "--no-figures")
CHAINS = ("--chains",) if find_spec("arviz") else ()
PLAN = ("--target", "sprung_mass=50%", "--law", "arctan_velocity", "--mass-change", "-200", "--duration", "20")
# the command, and the folder of `small_folders` that it runs in
COMMANDS = {
    "inspect": ("taxi", "inspect", "taxi/heavy.csv", "taxi/light.csv"),
    "identify": ("taxi", "identify", "taxi/study.toml", *LAW),
    "law": ("bench", "law", "bench.csv", "--force-channel", "load", "--travel-channel", "stroke"),
    "decay": ("bench", "decay", "hit.csv", "--channel", "az", "--stiffness-order", "3", "--damping-order", "2"),
    "update": ("chain", "update", "study.toml", "--samples", "1000", "--no-figures"),
    "update transitional": ("chain", "update", "study.toml", "--samples", "1000", "--sampler", "transitional", *CHAINS),
    "modes": ("modal", "modes", "impact.csv", "--drive-point", "case_x", "--band", "50", "500"),
    "modal": ("modal", "modal", "study.toml"),
    "resonance": ("levels", "resonance", "study.toml"),
    "compare": ("flights", "compare", "one", "two"),
    "campaign": ("campaign", "campaign", "fleet.toml", "--workers", "1"),
    "sense": ("flights", "sense", "taxi/study.toml", "one", "--log", "out/sensed.csv"),
    "wheel": ("flights", "wheel", "driven/study.toml", "one"),
    "plan": ("taxi", "plan", "taxi/study.toml", *PLAN),
}


def run(words, folder, threads):
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads)), "SOURCE_DATE_EPOCH": "1700000000"}
    done = subprocess.run(
        [sys.executable, "-m", "opid", *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 1, 3), done.stderr  # 1: what is not determined has a result, too


def take_files(folder):
    """Return what stands in each file below a folder, by its path, and remove the folder."""
    found = {each.relative_to(folder).as_posix(): each.read_bytes() for each in folder.rglob("*") if each.is_file()}
    shutil.rmtree(folder)
    return found


def differ(one, other):
    """Return the files that are not the same in both, or in one of them only."""
    return [path for path in sorted({*one, *other}) if one.get(path) != other.get(path)]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    top = tmp_path_factory.mktemp("same")
    make_folders(top, {folder for folder, *_ in COMMANDS.values()})
    return top


@pytest.mark.parametrize("name", COMMANDS)
def test_a_result_is_the_same_to_the_byte_with_any_number_of_threads(name, folders):
    """Its page, its tables and its logs are, too."""
    folder, *words = COMMANDS[name]
    written = []
    for threads in (1, 2):
        run((*words, "--out", "out"), folders / folder, threads)
        written.append(take_files(folders / folder / "out"))
    assert any(path.endswith(".json") for path in written[0])
    assert differ(*written) == []


def test_every_command_that_writes_a_result_is_held():
    from cli_runs import commands

    with_out = {words[1] for words, each in commands() if any("--out" in option.opts for option in each.params)}
    held = {command for _, command, *_ in COMMANDS.values()}
    assert with_out - {"demo"} <= held  # a demo simulates and identifies


@pytest.mark.parametrize("name", MADE)
def test_a_simulated_test_is_the_same_to_the_byte(name, tmp_path):
    written = []
    for threads in (1, 2):
        run(MADE[name], tmp_path, threads)
        written.append(take_files(tmp_path / "made"))
    assert "study.toml" in written[0]
    assert differ(*written) == []
