"""What recordings hold, read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader


def rows(path: Path, entity: str, component: str) -> list[Any]:
    """Values of a component of an entity, a row each time it was logged."""
    chunks = RrdReader(path).store().stream().filter(content=entity, components=component)
    return [row for chunk in chunks for row in chunk.to_record_batch()[component].to_pylist()]
