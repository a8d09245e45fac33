"""Restoring-force laws beyond `opid.law`: the kinds there are, and what a kind of your own is made of."""

from opid.mechanics.laws.kind import Kind, Parameter
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import LINEAR, Term, default_law, law_from_parameters
from opid.mechanics.laws.own_kinds import unregister_kind

__all__ = ["LAWS", "LINEAR", "Kind", "Parameter", "Term", "default_law", "law_from_parameters", "unregister_kind"]
