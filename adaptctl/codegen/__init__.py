"""Export of a controller to the robot: as C that needs nothing else, or as WebAssembly.

Both are written from the graph of the law that Python runs (`adaptctl.compilation`); neither needs a compiler here.
"""

from adaptctl.optional_packages import imported_lazily

__all__, __getattr__, __dir__ = imported_lazily(__name__)
