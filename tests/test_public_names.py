"""The public names as a user meets them: reached by attribute, accepted by a type checker."""

import subprocess
import sys

import pytest

import opid

SCRIPT = """
import opid

study = opid.read_study("study.toml", kind=opid.Study)
result = opid.identify(study, law="arctan_velocity")
mass: opid.Estimate = result.parameters.sprung_mass_kg
opid.write_report(result, "report")
print(opid.text(result), mass.value)
log: opid.Recording = opid.read_log("run.csv")
made = opid.recording_from_arrays([[0.0, 1.0]], ["a"], fs=2.0)
opid.write_log(made, "made.csv")
health = opid.inspect(log)
friction: opid.Law = opid.law("coulomb_friction", amplitude_n=400.0, scale_m_per_s=0.02)
gear = opid.LandingGear(law=friction)
settings = opid.Settings()
runs = (opid.Run("heavy", log, 0.0), opid.Run("light", made, -220.0))
own = opid.study_of_gear("two runs", sprung="upper_z", unsprung="lower_z", runs=runs)
slow = opid.resampled(made, 1.0)
try:
    opid.write_study(own, "own.toml")
except opid.InputError as error:
    print(error)
"""


@pytest.mark.parametrize(
    "name", ["mechanics", "modal", "plots", "report", "signals", "suspensions", "updating", "virtual"]
)
def test_rooms_are_attributes(name):
    assert getattr(opid, name).__name__ == f"opid.{name}"


@pytest.mark.parametrize("name", opid.__all__)
def test_every_public_name_can_be_reached(name):
    assert getattr(opid, name) is not None


def test_a_script_of_a_user_passes_the_type_checker(tmp_path):
    """Outside the repository, with 20 of the public names."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    checker = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), str(script)]
    done = subprocess.run(checker, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_name_that_is_not_public_is_refused_by_the_type_checker(tmp_path):
    """The check above can fail."""
    script = tmp_path / "script.py"
    script.write_text("import opid\nopid.read_studies('study.toml')\n")
    checker = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), str(script)]
    done = subprocess.run(checker, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "read_studies" in done.stdout
