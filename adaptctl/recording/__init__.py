"""A finished comparison made visible: recording, figures, report, table and summary."""

from adaptctl.recording.artifacts import shown, write_artifacts
from adaptctl.recording.comparison import Comparison, ControllerRun, Finding, Setting, TickCost
from adaptctl.recording.result import Progress, Result

__all__ = [
    "Comparison",
    "ControllerRun",
    "Finding",
    "Progress",
    "Result",
    "Setting",
    "TickCost",
    "shown",
    "write_artifacts",
]
