"""A finished comparison made visible."""

from adaptctl.recording.compared_runs import compared_runs
from adaptctl.recording.comparison import Comparison, ControllerRun, Finding, Leading, Setting, TickCost
from adaptctl.recording.judgement import judged
from adaptctl.recording.live import Live
from adaptctl.recording.report import shown, write_artifacts
from adaptctl.recording.result import Fact, Failure, Fault, Progress, Result, Verdict, Whose

__all__ = [
    "Comparison",
    "ControllerRun",
    "Fact",
    "Failure",
    "Fault",
    "Finding",
    "Leading",
    "Live",
    "Progress",
    "Result",
    "Setting",
    "TickCost",
    "Verdict",
    "Whose",
    "compared_runs",
    "judged",
    "shown",
    "write_artifacts",
]
