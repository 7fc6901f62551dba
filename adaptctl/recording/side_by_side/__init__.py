"""Several arms on one task, next to one another."""

from adaptctl.recording.side_by_side.result import OperationCounts, Side, SideBySide

__all__ = ["OperationCounts", "Side", "SideBySide"]
