"""Compilation of equations over scalars to native code. Knows nothing of robots."""

from adaptctl.compilation.graph import Op
from adaptctl.compilation.kernel import Kernel, compile_function
from adaptctl.compilation.lane_array import LaneArray
from adaptctl.compilation.routine import Operations, Routine, outlined, trace
from adaptctl.compilation.stepper import Ensemble, Stepper, compile_step

__all__ = [
    "Ensemble", "Kernel", "LaneArray", "Op", "Operations", "Routine", "Stepper",
    "compile_function", "compile_step", "outlined", "trace",
]  # fmt: skip
