"""The public names as a user meets them: few, reached by attribute, known to type checkers, enough for all we show."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import opid

ROOT = Path(__file__).parent.parent
MOST_NAMES = 25
NAMESPACES = ("campaigns", "laws", "mechanics", "modal", "plots", "signals", "suspensions", "updating", "virtual")

SCRIPT = """
import opid
from opid.laws import LAWS, Kind
from opid.modal import LinearModes, ModalStudy, StudyTest, modal_test
from opid.suspensions import Run, Settings, Study, study_of_gear
from opid.virtual import LandingGear

study = opid.read_study("study.toml", kind=Study)
result = opid.identify(study, law="arctan_velocity", settings=Settings())
mass: opid.Estimate = result.parameters.sprung_mass_kg
opid.write_report(result, "report")
print(opid.text(result), mass.value, result.settings.runs.band_hz)
by_paper = opid.identify(study, method="paper", high_pass_hz=0.3)
print(by_paper.method)
log: opid.Recording = opid.read_log("run.csv")
plan: opid.campaigns.CampaignPlan = opid.campaigns.read_campaign("fleet.toml")
print(opid.inspect(opid.signals.open_log("run.csv")), len(plan.flights))
made = opid.signals.recording_from_arrays([[0.0, 1.0]], ["a"], fs=2.0)
opid.write_log(made, "made.csv")
health = opid.inspect(log)
friction: opid.Law = opid.law("coulomb_friction", amplitude_n=400.0, scale_m_per_s=0.02)
kind: Kind = LAWS["coulomb_friction"]
gear = LandingGear(law=friction)
runs = (Run("heavy", log, 0.0), Run("light", made, -220.0))
own = study_of_gear("two runs", sprung="upper_z", unsprung="lower_z", runs=runs)
slow = opid.signals.resampled(made, 1.0)
modes: LinearModes = opid.modal.read_modes("modes.npz")
test = StudyTest(modal_test(made, modes, name="beat", force="force", drive_point="tip_z"))
beams = opid.identify(ModalStudy("beam", modes, (1,), (test,)))
print(beams.fits[0].mode)
joints = opid.identify(opid.read_study("joints.toml", kind=opid.updating.UpdatingStudy))
print(joints.best_class, opid.plots.png(opid.plots.figure_of(opid.plots.recording(made))))
try:
    opid.write_study(own, "own.toml")
except opid.InputError as error:
    print(error)
"""
WRONG = """
import opid
from opid.modal import LinearMode
opid.read_studies('study.toml')
opid.signals.resample(opid.read_log('run.csv'), 1.0)
opid.identify(opid.read_study('study.toml', kind=opid.suspensions.Study), method='papers')
"""
FAULTS = ("LinearMode", "read_studies", "resample", "identify")


def namespace(name):
    return import_module(f"opid.{name}")


# ---- few, and reached by attribute -----------------------------------------------------------------


def test_there_are_few_at_the_top():
    assert len(opid.__all__) <= MOST_NAMES
    assert set(NAMESPACES) < set(opid.__all__)


@pytest.mark.parametrize("name", NAMESPACES)
def test_namespaces_are_attributes_whose_names_can_be_reached(name):
    assert getattr(opid, name) is namespace(name)
    assert len(namespace(name).__all__) > 5
    assert all(getattr(namespace(name), each) is not None for each in namespace(name).__all__)


@pytest.mark.parametrize("name", opid.__all__)
def test_every_name_at_the_top_can_be_reached(name):
    assert getattr(opid, name) is not None


def test_a_name_is_public_in_one_place():
    """And no file of a folder is called as a public name there: its module would take the name's place."""
    places = {}
    for room in ("", *NAMESPACES):
        module = namespace(room) if room else opid
        folder = Path(module.__file__).parent
        for name in module.__all__:
            if room or name not in NAMESPACES:
                places.setdefault(id(getattr(module, name)), []).append(f"{room}.{name}")
                assert room == "laws" or not (folder / f"{name}.py").exists(), f"{room}.{name}"
                assert room == "laws" or not (folder / name).exists(), f"{room}.{name}"
    assert [each for each in places.values() if len(each) > 1] == []


def test_namespaces_load_nothing_until_a_name_is_used():
    lazy = [name for name in NAMESPACES if name != "laws"]
    code = f"import sys, opid; [dir(getattr(opid, name)) for name in {lazy!r}]; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name for name in done.stdout.split() if name.startswith("opid.")}
    assert loaded == {f"opid.{name}" for name in lazy}


# ---- accepted by type checkers ---------------------------------------------------------------------

# pyright with a Node of its own, beside this Python or elsewhere
PYRIGHT = shutil.which("basedpyright", path=os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"])))
CHECKERS = {
    "mypy": [sys.executable, "-m", "mypy", "--strict", "script.py"],
    "pyright": [PYRIGHT, "--pythonpath", sys.executable],
}


@pytest.fixture(scope="module")
def mypy_cache(tmp_path_factory):
    """A folder in which mypy keeps what it knows of opid for the next script."""
    return tmp_path_factory.mktemp("mypy_cache")


def checked(checker, folder, text, mypy_cache):
    """What a type checker says of a script of a user, outside of the repository."""
    if checker == "pyright" and PYRIGHT is None:
        pytest.skip("basedpyright is not installed: it comes with the extra dev")
    (folder / "script.py").write_text(text)
    # what pyright finds by default: basedpyright by itself finds more
    (folder / "pyrightconfig.json").write_text('{"include": ["script.py"], "typeCheckingMode": "standard"}')
    environment = os.environ | {"MYPY_CACHE_DIR": str(mypy_cache)}
    command = CHECKERS[checker]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("checker", [pytest.param("mypy", marks=pytest.mark.slow), "pyright"])
def test_a_script_of_a_user_passes_the_type_checkers(checker, tmp_path, mypy_cache):
    done = checked(checker, tmp_path, SCRIPT, mypy_cache)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("checker", [pytest.param("mypy", marks=pytest.mark.slow), "pyright"])
def test_what_is_not_public_is_refused_by_the_type_checkers(checker, tmp_path, mypy_cache):
    """The check above can fail."""
    said = checked(checker, tmp_path, WRONG, mypy_cache).stdout
    assert [each for each in FAULTS if f'"{each}"' not in said] == []


# ---- enough for all we show ------------------------------------------------------------------------


def cells(path):
    """Return the code of a notebook, without the commands of IPython."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    code = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return re.sub(r"(?m)^(\s*)[%!].*$", r"\1pass", "\n".join(code))


def shown_code(path):
    """Return the Python that a page, a notebook or an example shows."""
    if path.suffix == ".ipynb":
        return cells(path)
    text = path.read_text(encoding="utf-8")
    return text if path.suffix == ".py" else "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))


def names_used(code):
    """Yield what code takes from opid as full names, by import or by attribute."""
    tree = ast.parse(code)
    rooms = {"opid": "opid"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name.split(".")[0] == "opid")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "opid":
            yield from (f"{node.module}.{each.name}" for each in node.names)
            rooms |= {each.asname or each.name: f"opid.{each.name}" for each in node.names if node.module == "opid"}
    for node in ast.walk(tree):
        dotted = isinstance(node, ast.Attribute) and re.fullmatch(r"(\w+)\.(\w+)(?:\.(\w+))?", ast.unparse(node))
        if dotted and dotted[1] in rooms:
            yield ".".join([rooms[dotted[1]], *(each for each in dotted.groups()[1:] if each)])


def is_public(name):
    """Whether a full name is one of opid or of a namespace; what follows such a name is its own."""
    _, *parts = name.split(".")
    if not parts or parts[0] not in NAMESPACES:
        return not parts or parts[0] in opid.__all__
    return len(parts) == 1 or parts[1] in namespace(parts[0]).__all__


SHOWN = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "examples/**/*.py", "notebooks/*.ipynb")
    for path in ROOT.glob(pattern)
)


@pytest.mark.parametrize("page", SHOWN)
def test_what_we_show_uses_public_names_alone(page):
    assert sorted({each for each in names_used(shown_code(ROOT / page)) if not is_public(each)}) == []


def named(text):
    """Return the full names of opid that prose holds in backticks; `opid.law/1` is the name of a schema."""
    return set(re.findall(r"`(opid(?:\.[A-Za-z_]\w*)+)(?![\w/])", text))


def is_module(name):
    return (ROOT.joinpath(*name.split(".")).with_suffix(".py")).exists() or ROOT.joinpath(*name.split(".")).is_dir()


@pytest.mark.parametrize("page", [page for page in SHOWN if page.endswith(".md")])
def test_names_in_prose_are_public_or_modules(page):
    names = named((ROOT / page).read_text(encoding="utf-8"))
    assert [each for each in sorted(names) if not is_public(each) and not is_module(each)] == []


def test_a_name_in_prose_that_is_gone_is_found():
    names = named(
        "`opid.modal_text` and `opid.virtual.files` are gone, `opid.law/1` is no name, `opid.signals.logs` stays"
    )
    assert names == {"opid.modal_text", "opid.virtual.files", "opid.signals.logs"}
    assert {each for each in names if not is_public(each) and not is_module(each)} == names - {"opid.signals.logs"}


def test_pages_with_code_are_found():
    assert len([page for page in SHOWN if "opid" in names_used(shown_code(ROOT / page))]) > 15


@pytest.mark.parametrize(
    "code",
    [
        "import opid.modal.forced",
        "from opid.modal.forced.mode_fit import fit_mode",
        "import opid\nopid.modal.forced.mode_fit.fit_mode()",
        "from opid import modal\nmodal.forced.mode_fit",
        "from opid import studies",
        "import opid\nopid.fit_mode()",
    ],
)
def test_a_name_that_is_not_public_is_found(code):
    assert [each for each in names_used(code) if not is_public(each)] != []
