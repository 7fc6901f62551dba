"""What an experiment hands over, whatever it did."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol


class Result(Protocol):
    """Something that can be told in a few lines, and kept in a folder."""

    @property
    def complete(self) -> bool:
        """False when it was interrupted: what was computed is kept."""

    def headline(self) -> str:
        """The outcome in a sentence or two."""

    def facts(self) -> Iterator[tuple[str, str]]:
        """What a person asks first, and the answers."""

    def write(self, folder: Path, progress: Callable[[str, float], object]) -> None:
        """Write recording, report, figures and all into a folder that is ready, every file whole or not at all.

        `progress` is called with what is being written, and the share of this that is done.
        """
