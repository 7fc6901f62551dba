"""A finished comparison made visible."""

from adaptctl.recording.compared_runs import compared_runs
from adaptctl.recording.comparison import Comparison, Finding, Setting, TaskError
from adaptctl.recording.controller_run import ControllerRun, StepCost
from adaptctl.recording.judgement import judged
from adaptctl.recording.live import Live
from adaptctl.recording.report import shown, write_artifacts
from adaptctl.recording.result import Fact, Failure, Fault, Progress, Result, RunRole, Verdict

__all__ = [
    "Comparison",
    "ControllerRun",
    "Fact",
    "Failure",
    "Fault",
    "Finding",
    "Live",
    "Progress",
    "Result",
    "RunRole",
    "Setting",
    "StepCost",
    "TaskError",
    "Verdict",
    "compared_runs",
    "judged",
    "shown",
    "write_artifacts",
]
