"""A finished comparison made visible: recording, figures, report, table and summary."""

from adaptctl.recording.artifacts import shown, write_artifacts
from adaptctl.recording.comparison import Comparison, ControllerRun, Finding, Leading, Setting, TickCost
from adaptctl.recording.judgement import judged
from adaptctl.recording.result import Progress, Result
from adaptctl.recording.verdict import Failure, Fault, Verdict

__all__ = [
    "Comparison",
    "ControllerRun",
    "Failure",
    "Fault",
    "Finding",
    "Leading",
    "Progress",
    "Result",
    "Setting",
    "TickCost",
    "Verdict",
    "judged",
    "shown",
    "write_artifacts",
]
