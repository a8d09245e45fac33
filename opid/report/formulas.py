"""Formulas of laws in the texts of a report: plain text in a terminal, typeset on a page."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape

# these characters mean nothing outside this package; a name that holds them makes no more than a formula
_BEGIN, _END = "\ue010", "\ue011"
_FORMULA = re.compile(f"{_BEGIN}(.*?){_END}")

# a terminal shows the LaTeX of the laws as this plain text
_PLAIN = (
    (r"\tfrac{2}{\pi}", "(2/pi)"),
    (r"\operatorname{sgn}", "sgn"),
    (r"\tfrac12", "1/2"),
    (r"\dot z", "z'"),
    (r"\dot h_u", "h_u'"),
    (r"\dot h", "h'"),
    (r"\overline{h_u}", "mean(h_u)"),
    (r"e^{-(z' / w)^2}", "exp(-(z' / w)^2)"),
    (r"\tau", "tau"),
    (r"\min", "min"),
    (r"\le", "<="),
    ("\\ ", " "),
    (r"\arctan", "arctan"),
    (r"\tanh", "tanh"),
    (r"\,", ""),
)


def embed_formula(latex: str) -> str:
    """Return a formula as a part of a text of a report.

    Args:
        latex: of a law, as its kind has it.
    """
    return f"{_BEGIN}{latex}{_END}"


def format_formula(latex: str) -> str:
    """Return the LaTeX of a law as plain text.

    >>> format_formula(r"c\\, \\dot z |\\dot z|")
    "c z' |z'|"
    """
    for written, plain in _PLAIN:
        latex = latex.replace(written, plain)
    return latex


def write_plain(text: str) -> str:
    """Return a text with its formulas as plain text.

    >>> write_plain(f"the law {embed_formula('k z^3')}")
    'the law k z^3'
    """
    return _FORMULA.sub(lambda found: format_formula(found[1]), text)


def write_html(text: str, write_words: Callable[[str], str]) -> str:
    """Return a text as HTML with its formulas as MathML, which browsers typeset without any script.

    Args:
        text: of a report.
        write_words: makes HTML of what lies between the formulas.

    >>> write_html(f"the law {embed_formula('k z^3')}", str)[:31]
    'the law <math display="inline">'
    """
    if _BEGIN not in text:
        return write_words(text)
    words = _FORMULA.split(text)
    # formulas stand at the odd indices
    return "".join(_write_mathml(part) if k % 2 else write_words(part) for k, part in enumerate(words))


_ELEMENTS = {
    *("math", "mrow", "mi", "mn", "mo", "ms", "mtext", "mspace", "msup", "msub", "msubsup", "mfrac", "msqrt", "mroot"),
    *("mover", "munder", "munderover", "mtable", "mtr", "mtd", "mstyle", "mpadded", "mphantom", "menclose"),
}
_ATTRIBUTES = {
    *("display", "stretchy", "fence", "form", "separator", "mathvariant", "columnalign", "rowspacing", "columnspacing"),
    *("linethickness", "displaystyle", "scriptlevel", "width", "minsize", "maxsize", "accent", "movablelimits"),
}


def _write_mathml(latex: str) -> str:
    """Return a formula as MathML, or as a text where it would become anything else: latex2mathml escapes no texts."""
    from xml.etree import ElementTree

    from latex2mathml.converter import convert

    try:
        html = convert(latex).replace(' xmlns="http://www.w3.org/1998/Math/MathML"', "", 1)
        found = [*ElementTree.fromstring(html).iter()]
    except Exception:  # of a formula that is none; its exceptions have no base of their own
        return escape(format_formula(latex))
    is_formula = all(each.tag in _ELEMENTS and _ATTRIBUTES.issuperset(each.attrib) for each in found)
    return html if is_formula else escape(format_formula(latex))
