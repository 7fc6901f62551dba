"""Offline: which inertial parameters a motion depends on, and which smallest set is enough."""

from adaptctl.lazily import imported_lazily

__all__, __getattr__, __dir__ = imported_lazily(__name__)
