"""Comparison of a serial arm and one with a loop on one task: the experiment, its result, and how it is shown."""

from adaptctl.experiments.serial_versus_graph.result import OperationCounts, Side, SideBySide

__all__ = ["OperationCounts", "Side", "SideBySide"]
