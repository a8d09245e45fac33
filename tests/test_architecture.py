"""The arrows of ARCHITECTURE.md, held by walking the syntax tree of every file."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "opid"
MODULES = sorted(PACKAGE.rglob("*.py"))

# Each room, and the rooms it may import from beside itself. Wings are not in each other's rows.
GROUND = {"errors", "estimate", "json_values", "progress", "provenance", "result"}
WINGS = {"suspensions", "modal", "updating"}
BELOW_WINGS = GROUND | {"signals", "mechanics"}
MAY_IMPORT = {
    "errors": set(),
    "estimate": set(),
    "json_values": {"errors", "provenance"},
    "progress": set(),
    "provenance": {"errors"},
    "result": {"errors", "estimate", "json_values", "provenance"},
    "signals": GROUND,
    "mechanics": GROUND | {"signals"},
    "suspensions": BELOW_WINGS,
    "modal": BELOW_WINGS,
    "updating": BELOW_WINGS,
    "studies": BELOW_WINGS | WINGS,
    "virtual": BELOW_WINGS | WINGS | {"studies"},
    "plots": BELOW_WINGS | WINGS,
    "report": BELOW_WINGS | WINGS | {"plots"},
    "campaigns": BELOW_WINGS | WINGS | {"studies", "report", "__init__"},
    "planning": BELOW_WINGS | {"suspensions", "studies", "virtual"},
    "cli": BELOW_WINGS | WINGS | {"studies", "virtual", "plots", "report", "campaigns", "planning", "__init__"},
}
# A virtual test takes records from the wings, and what one who excites a structure has to know. It takes no estimator.
KNOWN_TO_VIRTUAL_TESTS = {
    "suspensions.study",
    "modal.forced.excitation",
    "modal.linear.modes",
    "modal.model",
    "modal.power_laws",
    "modal.resonance.appropriation",
    "modal.resonance.curves",
    "modal.study",
    "updating.measured",
    "updating.model_class",
    "updating.structure.affine",
    "updating.structure.matrices_file",
}
# The files of the estimator call each other; paper's chain, benches, flights, virtual sensors and wheel use it.
OF_ESTIMATOR = [PACKAGE / "suspensions" / each for each in ("", "model", "fitting", "law_search", "answer", "planning")]
ESTIMATOR = frozenset([PACKAGE / "studies", *OF_ESTIMATOR])
# So do those of each of these, and those of signals, mechanics and the other wings.
PAPER, BENCH, FLIGHTS, SENSING, WHEEL = (
    frozenset([PACKAGE / "suspensions" / each]) for each in ("paper", "bench", "flights", "sensing", "wheel")
)
WHOLE = [
    frozenset(path.parent for path in (PACKAGE / each).rglob("*.py"))
    for each in ("signals", "mechanics", "modal", "updating")
]
# Nothing but the command stands above reports, pictures and virtual tests.
OUTER = [
    frozenset(path.parent for each in rooms for path in (PACKAGE / each).rglob("*.py"))
    for rooms in (("plots", "report", "cli"), ("virtual", "cli"))
]
ROOMS = (ESTIMATOR, PAPER, BENCH, FLIGHTS, SENSING, WHEEL, *WHOLE, *OUTER)
MOST_FILES = 18
MOST_FILES_OF_ALL = 357  # lower it whenever there are fewer
MOST_LINES_TWICE = 5
# `import opid` names everything and loads nothing; `python -m opid` is the command.
MAY_IMPORT["__init__"] = GROUND
MAY_IMPORT["laws"] = {"mechanics"}
MAY_IMPORT["identification"] = GROUND | WINGS
MAY_IMPORT["__main__"] = {"cli"}

HEAVY = ("matplotlib", "pysindy", "numba", "scipy.signal")


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


@cache
def nodes_of(tree):
    return list(ast.walk(tree))


def faults(rule):
    """Return what a rule, `(path, tree) -> lines or names with words`, finds in all files: one sentence a fault."""
    return [
        f"{path.relative_to(PACKAGE).as_posix()}: {fault}" for path in MODULES for fault in rule(path, tree_of(path))
    ]


def room_of(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports(path, tree):
    """Yield each import of a module as its full name, `from . import x` included, with its line."""
    package = ("opid", *path.relative_to(PACKAGE).parent.parts)
    for node in nodes_of(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((f"{stem}.{alias.name}", node.lineno) for alias in node.names)


def test_the_walk_finds_the_package():
    assert PACKAGE / "errors.py" in MODULES
    assert {room_of(path) for path in MODULES} <= set(MAY_IMPORT)


def test_every_way_of_importing_is_seen():
    code = "import a.b\nfrom opid.plots import c\nfrom . import d\ndef f():\n    from ..clock import e\n"
    found = imports(PACKAGE / "signals" / "logs" / "x.py", ast.parse(code))
    expected = ["a.b", "opid.plots.c", "opid.signals.logs.d", "opid.signals.clock.e"]
    assert sorted(name for name, _ in found) == sorted(expected)


def against_the_arrows(path, tree):
    room = room_of(path)
    for name, line in imports(path, tree):
        parts = name.split(".")
        if parts[0] != "opid":
            continue
        target = parts[1] if len(parts) > 1 and parts[1] in MAY_IMPORT else "__init__"
        if target != room and target not in MAY_IMPORT[room]:
            yield f"line {line}: {room} may not import {name}"


def estimators_in_virtual_tests(path, tree):
    if room_of(path) == "virtual":
        for name, line in imports(path, tree):
            module = name.removeprefix("opid.").rpartition(".")[0]
            if module.split(".")[0] in WINGS and module not in KNOWN_TO_VIRTUAL_TESTS:
                yield f"line {line}: a virtual test may not know {module}"


def truths_written(path, tree):
    for node in nodes_of(tree) if path != PACKAGE / "virtual" / "truth_file.py" else ():
        writes = isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("write_whole", "write_text"))
        if writes and "truth" in ast.unparse(node):
            yield f"line {node.lineno}: a truth is written in virtual/truth_file.py"


def reaching_upward(_path, tree):
    for node in nodes_of(tree):
        if isinstance(node, ast.ImportFrom) and node.level > 1:
            yield f"line {node.lineno}: write the import from opid"


def matplotlib_outside_plots(path, tree):
    if room_of(path) != "plots":
        for name, line in imports(path, tree):
            if name.split(".")[0] == "matplotlib":
                yield f"line {line}: matplotlib"


def numba_outside_kernels(path, tree):
    if "kernels" not in path.relative_to(PACKAGE).parts:
        for name, line in imports(path, tree):
            if name.split(".")[0] in ("numba", "llvmlite"):
                yield f"line {line}: numba belongs in mechanics/kernels"


def toml_outside_studies(path, tree):
    if room_of(path) != "studies":
        for name, line in imports(path, tree):
            if name.split(".")[0] in ("tomllib", "tomli_w"):
                yield f"line {line}: study files are read and written in opid.studies"


def pysindy_outside_functions(path, tree):
    found = [line for name, line in imports(path, tree) if name.split(".")[0] == "pysindy"]
    functions = [node for node in nodes_of(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    for line in found:
        if not any(function.lineno <= line <= function.end_lineno for function in functions):
            yield f"line {line}: import it in the function"


def printing_or_silencing(path, tree):
    for node in nodes_of(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called == "print" and room_of(path) != "cli":
                yield f"line {node.lineno}: return it instead"
            if re.search(r"\b(filterwarnings|simplefilter|catch_warnings)$", called):
                yield f"line {node.lineno}: {called}"


# what the standard library asks of a library that logs
SILENT = "logging.getLogger(__name__).addHandler(logging.NullHandler())"


def done_at_import(_path, tree):
    for node in tree.body:
        call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and ast.unparse(node) != SILENT
        if call or isinstance(node, ast.For | ast.While | ast.With):
            yield f"line {node.lineno}"


def test_imports_follow_the_arrows():
    assert faults(against_the_arrows) == []


def test_virtual_tests_know_records_and_no_estimator():
    assert faults(estimators_in_virtual_tests) == []
    used = {
        name.removeprefix("opid.").rpartition(".")[0]
        for path in MODULES
        if room_of(path) == "virtual"
        for name, _ in imports(path, tree_of(path))
    }
    assert used >= KNOWN_TO_VIRTUAL_TESTS


def test_only_virtual_tests_write_a_truth():
    assert faults(truths_written) == []


def test_no_import_reaches_upward():
    assert faults(reaching_upward) == []


def test_matplotlib_stays_in_plots():
    assert faults(matplotlib_outside_plots) == []


def test_numba_stays_in_kernels():
    assert faults(numba_outside_kernels) == []


def test_only_study_files_are_toml():
    assert faults(toml_outside_studies) == []


def test_pysindy_is_imported_only_where_it_is_used():
    assert faults(pysindy_outside_functions) == []


def test_the_library_prints_nothing_and_silences_no_warnings():
    assert faults(printing_or_silencing) == []


def test_nothing_is_done_at_import():
    assert faults(done_at_import) == []


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        (against_the_arrows, "from opid.suspensions import study"),
        (against_the_arrows, "from opid.virtual.taxi_tests import road"),
        (truths_written, "write_whole(target / 'truth.json')"),
        (reaching_upward, "from ..errors import InputError"),
        (matplotlib_outside_plots, "def f():\n    import matplotlib.pyplot"),
        (numba_outside_kernels, "from numba import njit"),
        (toml_outside_studies, "import tomllib"),
        (pysindy_outside_functions, "import pysindy"),
        (printing_or_silencing, "print(1)"),
        (printing_or_silencing, "warnings.catch_warnings()"),
        (done_at_import, "register(1)"),
        (done_at_import, "for x in y:\n    pass"),
    ],
)
def test_each_rule_finds_its_fault(rule, code):
    assert len(list(rule(PACKAGE / "signals" / "x.py", ast.parse(code)))) == 1


@pytest.mark.parametrize(
    ("room", "code"),
    [
        ("modal", "from opid.virtual.modal_tests import series"),
        ("updating", "import opid.virtual.truth_file"),
        ("suspensions", "from opid.studies.study_file import read_study"),
        ("report", "from opid.virtual.truth_file import write_field_test"),
        ("virtual", "from opid.report import write_report"),
        ("studies", "from opid.virtual.truth_file import read_truth"),
    ],
)
def test_arrows_that_do_not_exist(room, code):
    assert len(list(against_the_arrows(PACKAGE / room / "x.py", ast.parse(code)))) == 1


def test_a_virtual_test_that_estimates_is_found():
    code = "from opid.suspensions.identification import identify\nfrom opid.suspensions.study import Run"
    assert len(list(estimators_in_virtual_tests(PACKAGE / "virtual" / "x.py", ast.parse(code)))) == 1


def test_import_opid_loads_nothing_heavy():
    code = f"import sys, opid; print(*[name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_default_method_loads_no_other_one():
    """The chain of the paper, pysindy's search, benches and machines with known truth wait until they are asked for."""
    code = "import sys, opid.suspensions.identification; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.removeprefix("opid.") for name in done.stdout.split() if name.startswith("opid.")}
    others = ("suspensions.own_structure", "suspensions.law_search.sparse_regression", "virtual", "studies")
    methods = ("suspensions.paper", "suspensions.bench")
    assert "suspensions.candidates" in loaded
    assert [name for name in sorted(loaded) if name.startswith(others + methods)] == []


def arguments(node):
    """Return the argument names of a function, or the field names of a dataclass."""
    if isinstance(node, ast.FunctionDef):
        spec = node.args
        every = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs, spec.vararg, spec.kwarg]
        return [each.arg for each in every if each is not None and each.arg not in ("self", "cls")]
    if not any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list):
        return []
    fields = [each for each in node.body if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)]
    return [each.target.id for each in fields if "ClassVar" not in ast.unparse(each.annotation)]


def commented(path, node):
    """Return the names on the left of assignments that a comment explains, beside them or above: fields of a record."""
    lines = ["", *path.read_text(encoding="utf-8").splitlines()]
    assigned = [each for each in node.body if isinstance(each, ast.AnnAssign)]
    return {
        ast.unparse(each.target)
        for each in assigned
        if "  # " in lines[each.lineno] or lines[each.lineno - 1].lstrip().startswith("# ")
    }


def public_definitions(tree):
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            # an overload tells types; the documentation stands with the body of the function
            yield from [node] * ("overload" not in map(ast.unparse, node.decorator_list))


@cache
def names_beyond(folders):
    """Return the full name of everything that is imported outside of them, by the lists of public names too."""
    stubs = PACKAGE.rglob("__init__.pyi")
    outside = [*(path for path in MODULES if path.parent not in folders), *stubs]
    return {name for path in outside for name, _ in imports(path, tree_of(path))}


def undocumented_arguments(path, tree):
    if room_of(path) == "cli":
        return  # click's options carry their own help
    module = ".".join(("opid", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__")
    beyond = [names_beyond(folders) for folders in ROOMS if path.parent in folders]
    for node in public_definitions(tree):
        # what such files call among themselves has a sentence and a good name, its records have fields
        if any(f"{module}.{node.name}" not in names for names in beyond):
            continue
        docstring, beside = ast.get_docstring(node) or "", commented(path, node)
        for name in arguments(node):
            if not (name.startswith("_") or name in beside or re.search(rf"\b{name}\b", docstring)):
                yield f"{node.name}: {name}"


def without_docstring(path, tree):
    if not ast.get_docstring(tree) and path.read_text(encoding="utf-8").strip():
        yield "the file itself"
    yield from (node.name for node in public_definitions(tree) if not ast.get_docstring(node))


def test_every_argument_is_documented():
    assert faults(undocumented_arguments) == []


def test_every_public_name_has_a_docstring():
    assert faults(without_docstring) == []


def fields_of_any_type(path, tree):
    """Results are typed: no record of the estimator holds what another module must guess."""
    for node in nodes_of(tree) if room_of(path) == "suspensions" else ():
        if isinstance(node, ast.ClassDef):
            for each in node.body:
                if isinstance(each, ast.AnnAssign) and re.search(r"\bAny\b", ast.unparse(each.annotation)):
                    yield f"{node.name}: {ast.unparse(each.target)}"


def evidence_read_by_keys(path, tree):
    """What an identification rests on is read by attributes: `result.evidence[0].fit`, never `evidence["fit"]`."""
    for node in nodes_of(tree) if room_of(path) in ("suspensions", "plots", "report", "cli") else ():
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
            read = ast.unparse(node.value)
            if isinstance(node.slice.value, str) and re.search(r"\b(evidence|diagnostics)$", read):
                yield f"line {node.lineno}: {ast.unparse(node)}"


PROSE = re.compile(r"message|warning|sentence|reason\b|note|status|clause|doubt")
PHRASE = re.compile(r"[a-z] [a-z]")
SEARCHES = ("match", "search", "fullmatch", "findall", "split", "sub")


def text_of(node):
    """Return what is written in a constant or between the braces of an f-string; "" of anything else."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return "".join(each.value for each in parts if isinstance(each, ast.Constant) and isinstance(each.value, str))


def decided_by_words(path, tree):
    """Decisions are made on types and codes: no message is searched for words, and no phrase is looked for."""
    # reports only lay out what others have said
    for node in nodes_of(tree) if room_of(path) not in ("plots", "report", "cli") else ():
        is_fault = False
        if isinstance(node, ast.Compare):
            for op, looked_in in zip(node.ops, node.comparators, strict=True):
                searched = isinstance(op, ast.In) and PHRASE.search(text_of(node.left))
                text = isinstance(op, ast.In | ast.NotIn) and text_of(node.left)
                is_fault |= bool(searched or (text and PROSE.search(ast.unparse(looked_in))))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            on, name = ast.unparse(node.func.value), node.func.attr
            if name in ("startswith", "endswith"):
                is_fault = bool(PROSE.search(on))
            elif on == "re" and name in SEARCHES:
                is_fault = any(PROSE.search(ast.unparse(each)) for each in node.args[1:])
        if is_fault:
            yield f"line {node.lineno}: {ast.unparse(node)}"


MEANING_OF_PLUS_MINUS = re.compile(r"\bstd\b|standard\s+deviation")


def plus_minus_unexplained(path, tree):
    """± is one standard deviation, never half an interval: `with_std` writes it, and heads and legends say so."""
    if path == PACKAGE / "estimate.py":
        return
    of_f_strings = {id(each) for node in nodes_of(tree) if isinstance(node, ast.JoinedStr) for each in node.values}
    for node in nodes_of(tree):
        if isinstance(node, ast.Constant | ast.JoinedStr) and id(node) not in of_f_strings:
            text = text_of(node)
            is_separator = isinstance(node, ast.Constant) and text.strip() == "±"
            if re.search(r"±(?!·)|[ (:]\+-", text) and not is_separator and not MEANING_OF_PLUS_MINUS.search(text):
                yield f"line {node.lineno}: {text}"


def test_only_the_reader_of_results_reads_a_result_by_keys():
    """And that of a dataset its columns. The rest of the comparison of flights goes by attributes."""
    folder = PACKAGE / "suspensions" / "flights"
    texts = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.py")}
    reading = {name for name, text in texts.items() if "load_document(" in text or "json" in text.split()}
    assert reading == {"result_file.py"}
    by_keys = [
        f"{path.name}: {ast.unparse(node)}"
        for path in folder.glob("*.py")
        for node in nodes_of(tree_of(path))
        if isinstance(node, ast.Subscript)
        and isinstance(node.slice, ast.Constant)
        and isinstance(node.slice.value, str)
    ]
    assert [each for each in by_keys if not each.startswith(("result_file.py", "dataset.py"))] == []


def test_records_of_the_estimator_are_typed():
    assert faults(fields_of_any_type) == []


def test_evidence_is_read_by_attributes():
    assert faults(evidence_read_by_keys) == []


def test_plus_minus_is_one_standard_deviation():
    assert faults(plus_minus_unexplained) == []


def test_no_decision_is_made_on_the_text_of_a_message():
    assert faults(decided_by_words) == []


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        (fields_of_any_type, "class A:\n    model: Any"),
        (evidence_read_by_keys, "x = result.evidence['fit']"),
        (decided_by_words, "if 'upside down' in finding.message:\n    pass"),
        (decided_by_words, "kept = [note for note in flights.notes if 'is left out' in note]"),
        (decided_by_words, "kept = not point.status.startswith('no ')"),
        (decided_by_words, "short = re.split('[:;] ', str(reason))[0]"),
        (decided_by_words, "failed = [each for each in of_failed if f'of mode {mode}:' in each]"),
        (decided_by_words, "told = clause if 'mean' not in clause else ''"),
        (plus_minus_unexplained, "head = '± (95 %)'"),
        (plus_minus_unexplained, "said = f'known to +-{percent} % (95 %)'"),
    ],
)
def test_each_rule_of_the_estimator_finds_its_fault(rule, code):
    assert len(list(rule(PACKAGE / "suspensions" / "x.py", ast.parse(code)))) == 1


def folders_in(picture):
    """Return the paths of the folders that the picture of ARCHITECTURE.md draws, below opid."""
    above, found = [], []
    for line in picture.splitlines():
        drawn = re.match(r"((?:│   |    )*)[├└]── (\w+)/", line)
        if drawn:
            above = [*above[: len(drawn[1]) // 4], drawn[2]]
            found.append("/".join(above))
    return found


def folders_there():
    """Return the paths of the folders with files in them, below opid."""
    files = [path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {path.parent.relative_to(PACKAGE).as_posix() for path in files} - {"."}


def test_the_picture_is_read():
    assert folders_in("opid/\n├── a/   WORDS with b/\n│   │    on\n│   └── c/\n│       └── d/\n└── e/\n") == [
        "a",
        "a/c",
        "a/c/d",
        "e",
    ]


def test_the_picture_names_the_folders_that_there_are():
    picture = (PACKAGE.parent / "ARCHITECTURE.md").read_text(encoding="utf-8").split("```")[1]
    assert sorted(folders_in(picture)) == sorted(folders_there())


def test_no_folder_has_too_many_files():
    counts = {
        folder: sum(path.is_file() for path in (PACKAGE / folder).iterdir()) for folder in (".", *folders_there())
    }
    assert {folder: count for folder, count in counts.items() if count > MOST_FILES} == {}


def test_the_package_has_no_more_files():
    assert len(MODULES) <= MOST_FILES_OF_ALL


# ---- nothing stands twice --------------------------------------------------------------------------


def lines_that_work(path, text):
    """Yield (place, line) of a file without imports, docstrings, comments and the arguments of functions."""
    left_out = set()
    for node in nodes_of(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            left_out |= set(range(node.lineno, node.end_lineno + 1))
        elif isinstance(node, ast.FunctionDef):
            left_out |= set(range(node.lineno + 1, node.body[0].lineno))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            left_out |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if line and number not in left_out and not line.startswith("#"):
            yield f"{path}:{number}", line


def stand_twice(files):
    """Return where more lines than allowed stand in the same order as elsewhere, file by file or in one."""
    places = {}
    for path, text in files:
        lines = list(lines_that_work(path, text))
        for begin in range(len(lines) - MOST_LINES_TWICE):
            part = lines[begin : begin + MOST_LINES_TWICE + 1]
            places.setdefault(tuple(line for _, line in part), []).append(part[0][0])
    return [each for each in places.values() if len(each) > 1]


def test_no_six_lines_stand_twice():
    files = [(path.relative_to(PACKAGE), path.read_text(encoding="utf-8")) for path in MODULES]
    assert stand_twice(files) == []


def test_lines_that_stand_twice_are_found():
    body = "".join(f"    x{k} = {k}\n" for k in range(MOST_LINES_TWICE + 1))
    one, other = f'def f(a):\n    """Return."""\n{body}', f"import x\n\n\ndef g(\n    a,\n):\n{body}    # end\n"
    assert stand_twice([("a.py", one), ("b.py", other)]) == [["a.py:3", "b.py:7"]]
    assert stand_twice([("a.py", one), ("b.py", other.replace("    x0 = 0\n", ""))]) == []
