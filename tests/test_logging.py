"""What the library logs under the name `opid`: silent until somebody listens."""

import logging
import subprocess
import sys

import opid


def test_nothing_is_shown_where_nobody_listens():
    assert any(isinstance(each, logging.NullHandler) for each in logging.getLogger("opid").handlers)
    code = "import logging, opid; logging.getLogger('opid').error('a word')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_files_structures_laws_and_evaluations_are_logged(field_test, caplog):
    with caplog.at_level(logging.DEBUG, logger="opid"):
        study = opid.read_study(field_test / "study.toml", kind=opid.suspensions.Study)
        opid.identify(study, law="arctan_velocity")
    said = [(each.name, each.levelname, each.getMessage()) for each in caplog.records]
    assert ("opid.studies.study_file", "INFO", f"read {study.source}: a study of suspensions") in said
    opened = [message for name, level, message in said if (name, level) == ("opid.signals.logs", "INFO")]
    assert opened == [f"opened {field_test / name}.csv: CSV with 2 channels" for name in ("heavy", "light")]
    (fitted, *_) = [message for name, _, message in said if name == "opid.suspensions.identification"]
    assert fitted.startswith("each gear alone (gear): law arctan_velocity, ")
    assert fitted.endswith(" evaluations in the last fit")
    assert any(name == "opid.suspensions.fitting.fit" for name, *_ in said)
