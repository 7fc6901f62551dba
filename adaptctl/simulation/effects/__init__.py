"""Effects: what real plants have besides rigid links, each a part that can be switched on."""

from adaptctl.optional_packages import imported_lazily

__all__, __getattr__, __dir__ = imported_lazily(__name__)
