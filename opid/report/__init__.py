"""Results -> text, JSON and a page that opens offline.

`result_text` is what the terminal shows, `result_json` what other programs read, `write_report` both with the figures,
of one gear as of a body on several suspensions. `bench_text`, `bench_json` and `write_bench_report` are the same for
the law of a test bench; `health_text` and `health_json` tell what is wrong with logs; `modal_text`, `modal_json` and
`write_modal_report` are for nonlinear modal models, `updating_text`, `updating_json` and `write_updating_report` for
Bayesian updating.
"""

from opid.report.as_json import result_json
from opid.report.bench_report import bench_json, bench_text, write_bench_report
from opid.report.comparison_report import comparison_json, comparison_text, write_comparison_report
from opid.report.health_report import health_json, health_text
from opid.report.identification_report import result_text, write_report
from opid.report.modal.report import modal_json, write_modal_report
from opid.report.modal.tables import modal_text
from opid.report.updating.report import updating_json, write_updating_report
from opid.report.updating.tables import updating_text

__all__ = [
    "bench_json",
    "bench_text",
    "comparison_json",
    "comparison_text",
    "health_json",
    "health_text",
    "modal_json",
    "modal_text",
    "result_json",
    "result_text",
    "updating_json",
    "updating_text",
    "write_bench_report",
    "write_comparison_report",
    "write_modal_report",
    "write_report",
    "write_updating_report",
]
