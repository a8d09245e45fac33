"""The same command gives the same result.json to the byte, whatever number of threads is set."""

import os
import subprocess
import sys

import numpy as np
import pytest

SHORT = ("--duration", "10", "--fs", "128")
MADE = {
    "taxi": ("simulate", "taxi", "taxi", *SHORT),
    "wing": ("simulate", "backbones", "wing", "--points", "5", "--curves", "2", "1"),
}
COMMANDS = {
    "inspect": ("inspect", "taxi/heavy.csv", "taxi/light.csv"),
    "identify": ("identify", "taxi/study.toml", "--law", "arctan_velocity", "--no-figures"),
    "law": ("law", "bench.csv", "--force-channel", "load", "--travel-channel", "stroke"),
    "decay": ("decay", "hit.csv", "--channel", "az", "--stiffness-order", "3", "--damping-order", "2"),
    "update": ("update", "wing/study.toml", "--samples", "1000", "--no-figures"),
}


def run(words, folder, threads):
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads)), "SOURCE_DATE_EPOCH": "1700000000"}
    done = subprocess.run(
        [sys.executable, "-m", "opid", *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 3), done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("same")
    t, rng = np.arange(1500) / 200.0, np.random.default_rng(0)
    z = sum(2e-3 * np.sin(2 * np.pi * f * t + f) for f in (0.7, 1.9, 3.1))
    force = 1e5 * z + 2e3 * np.gradient(z, t) + rng.normal(0, 5, t.size)
    write(place / "bench.csv", "time [s],stroke [mm],load [kN]", t, 1e3 * z, 1e-3 * force)
    t = np.arange(8192) / 2048.0
    a = np.exp(-1.5 * t) * np.cos(377.0 * t) + rng.normal(0, 1e-3, t.size)
    write(place / "hit.csv", "time [s],az [g]", t, np.where(t < 0.2, 0.0, a))
    for words in MADE.values():
        run(words, place, 1)
    return place


def write(path, head, *columns):
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=head, comments="", fmt="%.9g")


@pytest.mark.parametrize("name", COMMANDS)
def test_result_json_is_the_same_to_the_byte_with_any_number_of_threads(name, folder):
    written = []
    for number, threads in enumerate((1, 2, 4)):
        out = f"{name}_{number}"
        run((*COMMANDS[name], "--out", out), folder, threads)
        written.append((folder / out / "result.json").read_bytes())
    assert written[0] == written[1] == written[2]


@pytest.mark.parametrize("name", MADE)
def test_a_simulated_test_is_the_same_to_the_byte(name, folder):
    first = {path.name: path.read_bytes() for path in (folder / name).iterdir() if path.is_file()}
    words = [f"{name}_again" if word == name and at == 2 else word for at, word in enumerate(MADE[name])]
    run(words, folder, 2)
    again = {path.name: path.read_bytes() for path in (folder / f"{name}_again").iterdir() if path.is_file()}
    assert again == first
