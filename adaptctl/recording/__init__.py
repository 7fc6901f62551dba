"""A finished comparison made visible: recording, figures, report, table and summary."""

from adaptctl.recording.artifacts import prepare_folder, write_artifacts
from adaptctl.recording.comparison import Comparison, Finding, ControllerRun, Setting, TickCost
from adaptctl.recording.result import Result

__all__ = [
    "Comparison",
    "Finding",
    "Result",
    "ControllerRun",
    "Setting",
    "TickCost",
    "prepare_folder",
    "write_artifacts",
]
