"""Description of the machine of the figures; nothing that names a host, a user or a place."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from adaptctl.compilation.native import Processor

PACKAGES = ("adaptctl", "numpy", "llvmlite", "pin", "mujoco")
BUSY = 0.5
"""Load above which others probably slow the run down."""


@dataclass(frozen=True)
class Machine:
    """A processor, and what runs on it."""

    processor: str
    cores: int
    lanes: int
    system: str
    python: str
    versions: Mapping[str, str]
    date: str

    @classmethod
    def here(cls) -> Machine:
        """This machine, today."""
        return cls(
            processor=_processor(),
            cores=os.cpu_count() or 1,
            lanes=Processor.host().lanes,
            system=platform.system(),
            python=platform.python_version(),
            versions={name: version(name) for name in PACKAGES},
            date=datetime.now(UTC).date().isoformat(),
        )

    def __str__(self) -> str:
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        hardware = f"{self.processor}, {self.cores} cores, {self.lanes} lanes of doubles"
        return f"{hardware}; {self.system}, Python {self.python}, {versions}; {self.date}"


def load() -> float:
    """Mean number of processes that wanted a core in the last minute; 0 where the system has no such number."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


def _processor() -> str:
    """The maker's name for it, and LLVM's."""
    known = Path("/proc/cpuinfo")
    text = known.read_text(encoding="utf-8") if known.is_file() else ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return f"{named[1].strip() if named else platform.machine()} ({Processor.host().name})"
