"""Files of an experiment's folder: a comparison written into it."""

from __future__ import annotations

from adaptctl.recording.folder import FIGURES as FIGURES
from adaptctl.recording.folder import RECORDING as RECORDING
from adaptctl.recording.folder import REPORT as REPORT
from adaptctl.recording.folder import SUMMARY as SUMMARY
from adaptctl.recording.folder import TRACE as TRACE
from adaptctl.recording.report import write_artifacts as write_artifacts
