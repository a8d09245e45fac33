"""Results -> text, and a page that opens offline.

`text` is what the terminal shows, `write_report` writes the page with its figures and result.json, both of any result.
"""

from opid.report.writing import text, write_report

__all__ = ["text", "write_report"]
