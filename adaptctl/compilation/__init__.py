"""From equations over scalars to native code. Knows nothing of robots."""

from adaptctl.compilation.graph import Op
from adaptctl.compilation.kernel import Kernel, compile_function
from adaptctl.compilation.routine import Operations, Routine, outlined, trace

__all__ = ["Kernel", "Op", "Operations", "Routine", "compile_function", "outlined", "trace"]
