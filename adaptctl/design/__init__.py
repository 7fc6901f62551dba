"""Designing arms for their dynamics: where mass may be added, where it helps, and which parameters it can remove."""

from adaptctl.optional_packages import imported_lazily

__all__, __getattr__, __dir__ = imported_lazily(__name__)
