"""Bounds that the project promises, and the figures that its tests find today: `make figures` writes them as JSON."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from adaptctl.files import write_text

FOLDER = "ADAPTCTL_FIGURES"
"""the environment's variable that names where figures are left"""
SCHEMA = "adaptctl/figures/1"


def require(name: str, figure: float, bound: float, meaning: str, *, at_least: bool = False, unit: str = "1") -> None:
    """Assert that an invariant's figure is at most its bound, or at least; and leave both, where they are asked for,
    the figure that comes nearest to the bound where there are several of a name."""
    figure, bound = float(figure), float(bound)
    if folder := os.environ.get(FOLDER):
        place, side = Path(folder) / f"{name}.json", "at_least" if at_least else "at_most"
        worse = min if at_least else max
        worst = worse(figure, json.loads(place.read_text())["figure"]) if place.exists() else figure
        told = {"name": name, "meaning": meaning, "unit": unit, side: bound, "figure": worst}
        write_text(place, json.dumps(told, allow_nan=False) + "\n")
    assert figure >= bound if at_least else figure <= bound, f"{meaning}: {figure:.3g} {unit}, promised {bound:.3g}"


def gathered(folder: Path) -> str:
    """All figures of a folder as JSON, in order of their names."""
    figures = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    return json.dumps({"schema": SCHEMA, "figures": figures}, indent=1, allow_nan=False) + "\n"


if __name__ == "__main__":
    write_text(Path(sys.argv[2]), gathered(Path(sys.argv[1])))
