"""What `make check-export` found, kept as JSON, and its tables in docs/export.md."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from adaptctl.recording.wording import scientific
from benchmarks.machine import Machine
from benchmarks.published import inserted, table

ROOT = Path(__file__).resolve().parent.parent
NUMBERS, PAGE = ROOT / "benchmarks" / "export.json", ROOT / "docs" / "export.md"
SCHEMA = "adaptctl/export-figures/1"
COMMAND = "make check-export PUBLISH=--publish"
ARMS = {"puma": "PUMA, 36 parameters", "semi_direct": "with a loop, 26", "puma_guarded": "PUMA, guarded"}
"""Laws that are timed, and how pages name them."""


@dataclass
class Figures:
    """Figures of a run: of each law that is timed, how long a tick takes and what it takes on a microcontroller."""

    times: dict[str, dict[str, float]] = field(default_factory=dict)
    """ns of a tick by law and compiler; `native` is Python's own code"""
    cortex: dict[str, dict[str, int]] = field(default_factory=dict)
    agree: int = 0
    builds: int = 0
    laws: int = 0

    def count(self, builds: int, wrong: int) -> None:
        """Count a law, whose builds are given, and how many of them differ."""
        self.laws, self.builds, self.agree = self.laws + 1, self.builds + builds, self.agree + builds - wrong

    def kept(self) -> dict[str, Any]:
        """The figures in JSON's types. Times by compilers are given in parts of native code's."""
        labels = dict.fromkeys(label for one in self.times.values() for label in one if label != "native")
        return {
            "schema": SCHEMA,
            "machine": f"{Machine.here()}; under a load of {os.getloadavg()[0]:.1f}",
            "laws": self.laws,
            "builds": self.builds,
            "agree": self.agree,
            "native": {law: round(one["native"]) for law, one in self.times.items()},
            "times": {
                label: {law: round(one[label] / one["native"], 2) for law, one in self.times.items() if label in one}
                for label in labels
            },
            "cortex": self.cortex,
        }


def publish(kept: Mapping[str, Any]) -> None:
    """Keep figures, and put their tables into the page."""
    NUMBERS.write_text(json.dumps(kept, indent=1, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text(inserted(PAGE.read_text(encoding="utf-8"), shown(kept), COMMAND), encoding="utf-8")


def shown(kept: Mapping[str, Any]) -> str:
    """Text of the page on figures that were kept, in Markdown."""
    built = f"The same bit for bit: {kept['agree']} of {kept['builds']} builds of {kept['laws']} laws and controllers."
    about = "Time of a tick by native code, and by compilers in parts of it:"
    cortex = "On a Cortex-M4F, in single precision (gcc -O2):"
    parts = (f"Measured on {kept['machine']}.", built, about, times(kept), cortex, microcontroller(kept))
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def times(kept: Mapping[str, Any]) -> str:
    """Table of how long a tick takes."""
    native = ("native code here", *(f"{kept['native'][law]} ns" if law in kept["native"] else "–" for law in ARMS))
    rows = [
        (label, *(f"{one[law]:.2f}" if law in one else "–" for law in ARMS)) for label, one in kept["times"].items()
    ]
    return table(("", *ARMS.values()), [native, *rows])


def microcontroller(kept: Mapping[str, Any]) -> str:
    """Table of what a tick takes on a microcontroller."""
    rows = [
        (
            name,
            f"{one['flash']:,} B",
            f"{one['stack']} B",
            f"{one['instructions_most']:,}",
            f"{scientific(1e-9 * one['nano_newton_metres_off'], 1)} N m",
        )
        for law, name in ARMS.items()
        if (one := kept["cortex"].get(law))
    ]
    return table(("", "flash", "stack", "instructions a tick", "torque off Python's"), rows)
