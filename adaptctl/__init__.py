"""Adaptive control of robot mechanisms on their fundamental inertial parameters.

The public names are imported when they are first used, so that importing the package costs nothing.
"""

from adaptctl.optional_packages import imported_lazily

__all__, __getattr__, __dir__ = imported_lazily(__name__)
