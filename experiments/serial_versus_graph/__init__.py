"""Several arms on one task, next to one another."""

from adaptctl.experiments.serial_versus_graph.result import OperationCounts, Side, SideBySide

__all__ = ["OperationCounts", "Side", "SideBySide"]
