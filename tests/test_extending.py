"""What is added by the recipes of CONTRIBUTING.md is documented where they say."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

from adaptctl import control
from adaptctl.control import AdaptationLaw, Controller
from adaptctl.description.readers.registry import READERS, SCHEMAS, builtin_names
from adaptctl.experiments import EXPERIMENTS
from adaptctl.simulation import effects
from adaptctl.simulation.effects import Effect

HOME = Path(__file__).parent.parent


def concrete(package: Any, base: type) -> list[str]:
    """The names that a package offers of dataclasses that derive from a base class."""
    offered = ((name, getattr(package, name)) for name in package.__all__)
    kinds = ((name, kind) for name, kind in offered if isinstance(kind, type) and dataclasses.is_dataclass(kind))
    return [name for name, kind in kinds if issubclass(kind, base) and not kind.__abstractmethods__]  # type: ignore[attr-defined]


PAGES = {
    "robots": [*builtin_names(), *READERS, *SCHEMAS],
    "control": [*concrete(control, AdaptationLaw), *concrete(control, Controller)],
    "environments": concrete(effects, Effect),
    "cli": [entry.name for entry in EXPERIMENTS],
}


def test_what_is_registered_is_on_its_page() -> None:
    texts = {page: (HOME / "docs" / f"{page}.md").read_text() for page in PAGES}
    missing = [
        f"add a row or a line about `{name}` to docs/{page}.md"
        for page, names in PAGES.items()
        for name in names
        if not re.search(rf"[`\"]{re.escape(name)}[`\"(]", texts[page])
    ]
    assert missing == []


def test_all_kinds_are_found() -> None:
    assert {page: len(names) > 7 for page, names in PAGES.items()} == dict.fromkeys(PAGES, True)


def test_recipes_name_files_that_exist() -> None:
    files = re.findall(r"`((?:tests|experiments|adaptctl)/[\w./]+)`", (HOME / "CONTRIBUTING.md").read_text())
    assert len(files) > 10
    assert [file for file in files if not (HOME / file).exists()] == []
