"""The packages that opid needs: known vulnerabilities, the bounds of their versions, and a bill of materials.

Each command makes an environment of its own, which needs the network:

    python .ci/dependencies.py audit               # known vulnerabilities in the newest versions (pip-audit)
    python .ci/dependencies.py lowest              # install the lowest versions of pyproject.toml, and run the tests
    python .ci/dependencies.py newest --python python3.13
    python .ci/dependencies.py sbom --out sbom.cdx.json    # CycloneDX, of what `pip install opid` brings

`lowest` and `newest` run a part of the tests that uses every package, or those given behind `--tests`.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
TESTS = (
    *("test_cli_identify.py", "test_cli_inspect.py", "test_cli_law.py", "test_cli_decay.py", "test_cli_resonance.py"),
    *("test_cli_compare.py", "test_cli_update.py", "test_cli_campaign.py", "test_cli_output.py", "test_cli_modal.py"),
    *("test_plots.py", "test_report.py", "test_exchange.py", "test_hostile_names.py", "test_security.py"),
    *("test_logs_excel.py", "test_logs_hdf5.py", "test_logs_ide.py", "test_logs_matlab.py", "test_logs_mdf.py"),
    *("test_logs_parquet.py", "test_logs_tdms.py", "test_logs_uff.py", "test_logs_ulog.py", "test_response_fit.py"),
    *(
        "test_sparse_regression.py",
        "test_skfem_structure.py",
        "test_own_kinds.py",
        "test_sensing.py",
        "test_posterior.py",
    ),
)
EXTRAS = ("all", "campaign")
"""The extras of which the lowest versions are installed: with `nuts` and the tools of the tests they would be newer."""


def read_project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def list_lowest(project: dict, extras: tuple[str, ...] = EXTRAS) -> Iterator[str]:
    """Yield the lowest version that pyproject.toml allows of each package, as a constraint of pip.

    >>> list(list_lowest({"dependencies": ["numpy>=2.0"], "optional-dependencies": {"all": ["a[b]>=1,<2"]}}, ("all",)))
    ['numpy==2.0.*', 'a==1.0.*']
    """
    stated = [*project["dependencies"]]
    for extra in extras:
        for each in project["optional-dependencies"][extra]:
            own = re.fullmatch(r"opid\[(.*)\]", each)
            stated += [] if own else [each]
            for name in own[1].split(",") if own else ():
                stated += project["optional-dependencies"][name]
    for each in dict.fromkeys(stated):
        found = re.match(r"([\w.-]+)(?:\[.*?\])?>=([\w.]+)", each)
        if not found:
            raise ValueError(f"{each} has no lowest version: give it one in pyproject.toml")
        yield f"{found[1]}=={found[2]}{'' if '.' in found[2] else '.0'}.*"


def run(*words: object, **settings: object) -> None:
    print("$", *words, flush=True)
    subprocess.run([str(word) for word in words], check=True, **settings)


def make_environment(folder: Path, python: str, *requirements: str, constraints: str = "") -> Path:
    """Make an environment with these packages, and return its Python."""
    run(python, "-m", "venv", "--upgrade-deps", folder)
    own = folder / "bin" / "python"
    file = folder / "constraints.txt"
    file.write_text(constraints)
    run(own, "-m", "pip", "install", "-q", "--disable-pip-version-check", "-c", file, *requirements)
    run(own, "-m", "pip", "check")
    return own


def choose_tests(tests: list[str]) -> list[Path]:
    """Return the files of tests by their names, or end where one is not there: a test that was renamed is missed."""
    chosen = [ROOT / "tests" / each for each in tests or TESTS]
    missing = [each.name for each in chosen if not each.exists()]
    if missing:
        sys.exit(f"Error: there is no test {', '.join(missing)} in {ROOT / 'tests'}: correct --tests or TESTS")
    return chosen


def test(own: Path, chosen: list[Path]) -> None:
    # a package of that time may warn of what its own successors will change
    run(own, "-m", "pytest", "-q", "-m", "", "-W", "default", "-p", "no:cacheprovider", *chosen, cwd=ROOT)


def audit(tool: Path, where: str) -> None:
    """Print what is known against the packages in a folder; a package of which nothing can be asked is a failure.

    pip-audit tells on stderr what it cannot do.
    """
    found = subprocess.run([tool, "--path", where, "--format", "json"], stdout=subprocess.PIPE, text=True)
    try:
        packages = [each for each in json.loads(found.stdout)["dependencies"] if each["name"] != "opid"]
    except (json.JSONDecodeError, KeyError):
        sys.exit(f"Error: pip-audit ended with status {found.returncode} and no list of packages: it needs the network")
    skipped = [each["name"] for each in packages if "skip_reason" in each]
    known = [(each["name"], each["version"], vuln) for each in packages for vuln in each.get("vulns", ())]
    for name, version, vuln in known:
        print(f"{name} {version}: {vuln['id']}, mended in {', '.join(vuln['fix_versions']) or 'no version'}")
    print(f"{len(packages) - len(skipped)} packages were audited, {len(known)} vulnerabilities are known")
    if skipped:
        print(
            f"{len(skipped)} could not be audited: the index answers no question about them: {', '.join(skipped[:5])}"
        )
    if known or skipped:
        sys.exit(1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("audit", "lowest", "newest", "sbom"))
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--tests", nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=Path("sbom.cdx.json"))
    parser.add_argument("--environment", type=Path, help="where the environment is made; by default it goes afterwards")
    options = parser.parse_args()
    project, tests = read_project(), choose_tests(options.tests)
    with tempfile.TemporaryDirectory() as directory:
        folder = options.environment or Path(directory, "environment")
        if options.what == "lowest":
            constraints = "\n".join(list_lowest(project))
            own = make_environment(folder, options.python, f"{ROOT}[all,campaign]", constraints=constraints)
            tools = ["psutil", "pytest", "hypothesis", "jsonschema", "lvm_read"]
            run(own, "-m", "pip", "install", "-q", "-c", folder / "constraints.txt", *tools)
            test(own, tests)
        elif options.what == "newest":
            test(make_environment(folder, options.python, f"{ROOT}[test]"), tests)
        elif options.what == "audit":
            own = make_environment(folder, options.python, f"{ROOT}[all,campaign,nuts]")
            tools = make_environment(Path(directory, "tools"), options.python, "pip-audit").with_name("pip-audit")
            where = subprocess.run(
                [own, "-c", "import site; print(site.getsitepackages()[0])"], check=True, capture_output=True, text=True
            ).stdout.strip()
            audit(tools, where)
        else:
            own = make_environment(folder, options.python, str(ROOT))
            tools = make_environment(Path(directory, "tools"), options.python, "cyclonedx-bom").with_name(
                "cyclonedx-py"
            )
            run(
                tools, "environment", own, "--pyproject", ROOT / "pyproject.toml", "--output-reproducible",
                "--of", "JSON", "-o", options.out.absolute(),
            )  # fmt: skip


if __name__ == "__main__":
    main()
