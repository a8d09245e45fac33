"""Results -> text, JSON and a page that opens offline.

`result_text` is what the terminal shows, `result_json` what other programs read, `write_report` both with the figures.
"""

from opid.report.as_json import health_json, result_json
from opid.report.as_text import health_text, result_text
from opid.report.field_test import read_truth, truth_json, write_field_test
from opid.report.page import write_report

__all__ = [
    "health_json",
    "health_text",
    "read_truth",
    "result_json",
    "result_text",
    "truth_json",
    "write_field_test",
    "write_report",
]
