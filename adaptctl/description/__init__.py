"""Mechanisms as data: links, joints, parameters and their names, and the readers of files."""

from adaptctl.optional_packages import imported_lazily

__all__, __getattr__, __dir__ = imported_lazily(__name__)
