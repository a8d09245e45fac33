"""The laws that can be fitted, simulated and named: `opid laws`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import example, main

if TYPE_CHECKING:
    from opid.mechanics.laws.kind import Kind


@main.command(epilog=example("opid laws --json"))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def laws(as_json: bool) -> None:
    """List the laws of the library with their formulas and parameters.

    z is the extension of the suspension and z' its rate. A law that is fitted or simulated is one of these or a sum of
    them, as in `--law arctan_velocity+cubic_stiffness`, beside the linear stiffness and damping.
    """
    from opid.json_values import json_text
    from opid.mechanics.laws.kinds import LAWS

    kinds = list(LAWS.values())
    click.echo(json_text(_tabulate_laws(kinds)) if as_json else _format_laws(kinds), nl=False)


def _format_laws(kinds: list[Kind]) -> str:
    from opid.report.as_text import align_table
    from opid.report.formulas import format_formula

    head = ("parameter", "unit", "default", "role")
    cells = [
        (f"  {each.name}", each.unit, f"{each.default:g}", each.role) for kind in kinds for each in kind.parameters
    ]
    lines = iter(align_table([(f"  {head[0]}", *head[1:]), *cells], left=(0, 1)))
    n_searched = sum(kind.searched and not kind.bench_only for kind in kinds)
    head_line = f"{len(kinds)} laws, {n_searched} of them searched by `opid identify`; the columns of their parameters:"
    parts = [head_line, next(lines)]
    for kind in kinds:
        parts += ["", f"{kind.name}: {format_formula(kind.latex)}", f"  {_say_which_search(kind)}"]
        parts += [next(lines) for _ in kind.parameters]
    return "\n".join(parts) + "\n"


def _say_which_search(kind: Kind) -> str:
    """Say whether a law remembers the motion, and which search tries it."""
    memory = "" if kind.memory is None else "it remembers the motion; "
    if kind.bench_only:
        return f"{memory}searched by `opid law` alone"
    return f"{memory}{'searched' if kind.searched else 'not searched: name it'}"


def _tabulate_laws(kinds: list[Kind]) -> dict[str, Any]:
    from opid.report.formulas import format_formula

    return {
        "schema": "opid.laws/1",
        "laws": [
            {
                "name": kind.name,
                "formula": format_formula(kind.latex),
                "latex": kind.latex,
                "has_memory": kind.memory is not None,
                "is_searched": kind.searched,
                "is_bench_only": kind.bench_only,
                "parameters": [
                    {"name": each.name, "unit": each.unit, "role": each.role, "default": each.default}
                    for each in kind.parameters
                ],
            }
            for kind in kinds
        ],
    }
