"""What no file of a user can do: run code, be written elsewhere, or ask for anything: docs/security.md in tests."""

import ast
import os
import re
import shutil
import sys
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pytest
from cli_runs import opid, refused
from scripts import ROOT, script

import opid as package
from opid.errors import InputError
from opid.report.writing import write_policy
from opid.studies.schema import require_plain

MODULES = sorted((ROOT / "opid").rglob("*.py"))

# What executes something, or reads what can, by its full name (a `*` stands for any letters), and the files that may
# have it, each with its reason in docs/security.md.
USES = {
    "exec": set(),
    "eval": set(),
    "compile": set(),
    "__import__": set(),
    "__builtins__": set(),
    "os.system": set(),
    "os.popen": set(),
    "os.fork*": set(),
    "os.exec*": set(),
    "os.spawn*": set(),
    "os.posix_spawn*": set(),
    "os.startfile": set(),
    "pickle.load": {"signals/logs/apart.py"},
    "pickle.loads": set(),
    "pickle.Unpickler": set(),
    "pickle.dump": {"signals/logs/apart.py"},
    "marshal.loads": set(),
    "shelve.open": set(),
    "joblib.load": set(),
    "read_pickle": set(),
    "yaml.load": set(),
    "subprocess.Popen": {"signals/logs/apart.py"},
    "subprocess.run": set(),
    "subprocess.call": set(),
    "subprocess.check_*": set(),
    "subprocess.get*output": set(),
    "asyncio.create_subprocess_*": set(),
    "subprocess_exec": set(),
    "subprocess_shell": set(),
    "ctypes.CDLL": set(),
    "urlopen": set(),
    "socket.socket": set(),
    "import_module": {
        *("identification.py", "provenance.py", "report/writing.py", "studies/study_file.py"),
        *("signals/logs/__init__.py", "signals/logs/apart.py"),
    },
}
BUILT_IN = ("exec", "eval", "compile", "__import__", "__builtins__")
IMPORTS = {
    "pickle": {"signals/logs/apart.py", "mechanics/kernels/compilation.py"},
    "subprocess": {"signals/logs/apart.py"},
    "marshal": set(),
    "shelve": set(),
    "dill": set(),
    "cloudpickle": set(),
    "joblib": set(),
    "yaml": set(),
    "ctypes": set(),
    "cffi": set(),
    "code": set(),
    "codeop": set(),
    "runpy": set(),
    "pty": set(),
    "multiprocessing": set(),
    "socket": set(),
    "requests": set(),
    "urllib.request": set(),
    "http.client": set(),
    "ftplib": set(),
    "telnetlib": set(),
    "xml.sax": set(),
}
USUAL = {"np": "numpy", "pd": "pandas"}
"""Short names that need no import to be understood."""


def list_imports(tree):
    """Yield (name in the file, full name) of each import; `import os.path` gives `os` its name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for each in node.names:
                yield each.asname or each.name.split(".")[0], each.name if each.asname else each.name.split(".")[0]
        elif isinstance(node, ast.ImportFrom):
            for each in node.names:
                yield each.asname or each.name, f"{'.' * node.level}{node.module or ''}.{each.name}"


def resolve(text, names):
    """Return the full name of a dotted one, by what its first part was imported as."""
    first, dot, rest = text.partition(".")
    return f"{names.get(first, first)}{dot}{rest}".removeprefix("builtins.")


def is_named(full, pattern):
    """Whether a full name is that of a built-in, or ends as that of a function of a module; `re.compile` is none."""
    return fnmatchcase(full, pattern) or (pattern not in BUILT_IN and fnmatchcase(full, f"*.{pattern}"))


def find_faults(sources):
    """Return each use and each import that stands where it may not, from {path in opid: source}.

    A name counts wherever it stands, called, handed on or imported.
    """
    faults = []
    for path, source in sources.items():
        tree = ast.parse(source)
        imported = list(list_imports(tree))
        names = USUAL | dict(imported)
        nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute | ast.Name)]
        uses = dict.fromkeys([*(full for _, full in imported), *(resolve(ast.unparse(each), names) for each in nodes)])
        faults += [
            f"{path}: {full}"
            for full in uses
            for pattern, allowed in USES.items()
            if is_named(full.removeprefix("builtins."), pattern) and path not in allowed
        ]
        faults += [f"{path}: from {full} import *" for name, full in imported if name == "*"]
        called = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                called.add(id(node.func))
                stated = [ast.unparse(each.value) for each in node.keywords if each.arg == "allow_pickle"]
                loads = is_reader_of_arrays(resolve(ast.unparse(node.func), names))
                if stated not in ([], ["False"]) or (loads and not stated):
                    faults.append(f"{path}: {ast.unparse(node.func)} without allow_pickle=False")
                faults += [f"{path}: a shell" for each in node.keywords if each.arg == "shell"]
        faults += [
            f"{path}: {ast.unparse(each)} is handed on"
            for each in nodes
            if is_reader_of_arrays(resolve(ast.unparse(each), names)) and id(each) not in called
        ]
        for node in ast.walk(tree):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                modules += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
            faults += [
                f"{path}: import {each}"
                for each in modules
                for name, allowed in IMPORTS.items()
                if (each == name or each.startswith(f"{name}.")) and path not in allowed
            ]
    return faults


def is_reader_of_arrays(full):
    return full == "numpy.load" or full.endswith(("npy.read_array", "format.read_array"))


def test_nothing_is_executed_but_in_the_places_that_the_page_names():
    sources = {each.relative_to(ROOT / "opid").as_posix(): each.read_text(encoding="utf-8") for each in MODULES}
    assert len(sources) > 300
    assert find_faults(sources) == []
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    for path in {path for allowed in (*USES.values(), *IMPORTS.values()) for path in allowed}:
        assert f"`opid/{path}`" in page, path


@pytest.mark.parametrize(
    "source",
    [
        "exec('1')", "x = eval(text)", "compile(text, '', 'exec')", "import pickle", "from pickle import loads",
        "import os\nos.system('x')", "np.load(path)", "np.load(path, allow_pickle=True)", "import yaml",
        "run(words, shell=True)", "from subprocess import run", "__import__('x')", "import urllib.request",
        "importlib.import_module(name)",
        # by other names, and by what does the same
        "from os import system", "from os import system as s", "import os as o\no.popen('x')",
        "import builtins\nbuiltins.eval(x)",
        "from builtins import exec as e", "from builtins import *", "__builtins__['eval'](x)", "map(eval, texts)",
        "import os\nos.execv(path, words)", "os.spawnl(0, path)", "os.posix_spawn(path, [], {})", "import runpy",
        "from runpy import run_path", "pandas.read_pickle(path)", "import pandas as p\np.read_pickle(path)",
        "from pandas import read_pickle", "asyncio.create_subprocess_shell(x)", "asyncio.create_subprocess_exec(x)",
        "from asyncio import create_subprocess_shell as run", "import numpy as n\nn.load(p)",
        "from numpy import load\nload(p)", "from numpy import load as l\nl(p, allow_pickle=True)",
        "map(np.load, paths)",
        "from urllib import request", "from http import client", "import multiprocessing.shared_memory",
        "from importlib import import_module as i\ni(name)",
    ],
)  # fmt: skip
def test_the_walk_sees_each_of_them(source):
    assert find_faults({"new.py": source}) != []
    sound = "import re\nfrom numpy import load as l\nre.compile('x')\nnp.load(path, allow_pickle=False)"
    sound += "\nl(path, allow_pickle=False)\nimport os\nos.path.exists(path)\nmodel.eval(1)\nsys.executable"
    assert find_faults({"new.py": sound}) == []


def test_a_module_is_imported_by_a_name_of_this_package_only():
    """The names of modules come from tables in the code: none from a file."""
    for name in ("studies/study_file.py", "report/writing.py", "identification.py"):
        source = (ROOT / "opid" / name).read_text(encoding="utf-8")
        given = re.findall(r"import_module\((.*?)\)", source)
        assert given, name
        assert all("opid." in each or each == "module" for each in given), given


# ---- files -------------------------------------------------------------------------------------------


class Trap:
    """An object whose pickle makes a file when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (Path(self.path),)


@pytest.mark.parametrize("key", ["shapes", "frequency_hz", "more"])
def test_a_pickle_in_an_archive_is_not_loaded(key, tmp_path):
    arrays = {
        "frequency_hz": np.ones(1),
        "damping_ratio": np.ones(1),
        "shapes": np.ones((1, 1)),
        "sensors": np.array(["a"]),
    }
    arrays[key] = np.array([Trap(tmp_path / "owned")], dtype=object)
    np.savez(tmp_path / "modes.npz", **arrays)
    shutil.copy(tmp_path / "modes.npz", tmp_path / "log.npz")
    opid("inspect", tmp_path / "log.npz")
    with pytest.raises(InputError):
        package.modal.read_modes(tmp_path / "modes.npz")
    assert not (tmp_path / "owned").exists()
    with np.load(tmp_path / "modes.npz", allow_pickle=True) as archive:  # the trap is one
        _ = archive[key]
    assert (tmp_path / "owned").exists()


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated") / "taxi"
    assert opid("simulate", "taxi", folder, "--duration", 10, "--fs", 128).exit_code == 0
    return folder


LAW = ("--law", "arctan_velocity", "--no-figures", "--quiet")


@pytest.mark.parametrize("form", ["../{}", "../../{}/taxi/../taxi/heavy.csv", "absolute", "link"])
def test_a_study_may_read_anywhere_and_its_result_is_written_to_its_folder_only(form, simulated, tmp_path):
    """A study is a file of the user, like a command: it names the logs where they are."""
    place = tmp_path / "deep" / "study"
    place.mkdir(parents=True)
    shutil.copytree(simulated, tmp_path / "taxi")
    study = (simulated / "study.toml").read_text(encoding="utf-8").replace("light.csv", "../../taxi/light.csv")
    heavy = {"absolute": str(tmp_path / "taxi" / "heavy.csv"), "link": "heavy.csv"}.get(form, "../../taxi/heavy.csv")
    if form == "link":
        (place / "heavy.csv").symlink_to(tmp_path / "taxi" / "heavy.csv")
    (place / "study.toml").write_text(study.replace('"heavy.csv"', f'"{heavy}"'), encoding="utf-8")
    before = {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file()}
    assert opid("identify", place / "study.toml", *LAW, "--out", tmp_path / "out").exit_code == 0
    after = {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file() and "out" not in each.parts}
    assert after == before
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == ["report.html", "result.json"]


NAMES = [
    "../x",
    "a/b",
    "..",
    ".",
    "",
    "/etc/x",
    "a\\b",
    "a\0b",
    "a\nb",
    "con",
    "NUL.txt",
    "x.",
    "x ",
    300 * "x",
    "\x1b[1m",
]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_becomes_that_of_a_file_is_one_word(name):
    with pytest.raises(InputError, match="call it by one plain word"):
        require_plain("run", name)
    for usual in ("heavy", "flight 7", "$x$", "Aéro 前", "console", "a.b"):
        require_plain("run", usual)


@pytest.mark.parametrize("name", ["../x", "..", "/tmp/x", "a/../../x", "A\\..\\x"])
@pytest.mark.parametrize("column", ["flight", "tail"])
def test_no_flight_of_a_campaign_is_written_outside_its_folder(name, column, simulated, tmp_path):
    pytest.importorskip("distributed")
    shutil.copytree(simulated, tmp_path / "fleet" / "f1")
    cells = {"flight": "f1", "tail": "A", column: name}
    table = f'flight,tail,study\n"{cells["flight"]}","{cells["tail"]}",f1/study.toml\n'
    (tmp_path / "fleet" / "flights.csv").write_text(table, encoding="utf-8")
    (tmp_path / "fleet" / "fleet.toml").write_text('flights = "flights.csv"\n', encoding="utf-8")
    before = sorted(tmp_path.rglob("*"))
    refused(opid("campaign", tmp_path / "fleet" / "fleet.toml", "--out", tmp_path / "out"), "one plain word")
    assert sorted(tmp_path.rglob("*")) == before


def test_flights_that_differ_in_case_only_are_one_folder_on_some_disks(simulated, tmp_path):
    shutil.copytree(simulated, tmp_path / "f1")
    (tmp_path / "flights.csv").write_text("flight,study\nF1,f1/study.toml\nf1,f1/study.toml\n", encoding="utf-8")
    (tmp_path / "fleet.toml").write_text('flights = "flights.csv"\n', encoding="utf-8")
    pytest.importorskip("distributed")
    refused(opid("campaign", tmp_path / "fleet.toml", "--out", tmp_path / "out"), "stands in the table twice")


def test_a_log_with_a_long_name_has_pictures_with_a_short_one(simulated, tmp_path):
    log = tmp_path / f"{240 * 'x'}.csv"
    shutil.copy(simulated / "heavy.csv", log)
    assert opid("inspect", log, "--out", tmp_path / "out", "--png").exit_code in (0, 1)
    names = os.listdir(tmp_path / "out")
    assert max(map(len, names)) < 100
    assert sum(each.endswith(".png") for each in names) == 1


# ---- pages and packages ------------------------------------------------------------------------------


def test_a_page_may_run_its_own_scripts_and_ask_for_nothing(simulated, tmp_path):
    assert opid("identify", simulated / "study.toml", *LAW, "--out", tmp_path / "out").exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    policy = re.search(r'Content-Security-Policy" content="(.*?)">', page)[1]
    assert policy.startswith("default-src &#39;none&#39;; script-src &#39;none&#39;;")
    assert "unsafe-eval" not in write_policy(["a"])
    assert "http" not in write_policy(["a"])
    assert re.findall(r"(?:src|href)=\"(?!#)[^\"]*\"", page) == []


def test_the_lowest_versions_are_those_of_the_project():
    dependencies = script(".ci/dependencies.py")
    lowest = list(dependencies.list_lowest(dependencies.read_project()))
    assert "numpy==2.0.*" in lowest
    assert all(re.fullmatch(r"[\w.-]+==\d+(\.\d+)+\.\*", each) for each in lowest)
    assert len(lowest) > 25
    assert sys.version_info >= (3, 11)
