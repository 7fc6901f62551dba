"""Pages of the API reference: every name that a package offers stands on one of them."""

from __future__ import annotations

import importlib
import re
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

Offered = Callable[[str, str, str], list[str]]
DOCS = Path(__file__).parent.parent / "docs"
OFFERED = re.compile(r"^\.\. offered:: (\S+)\n((?:   :[\w-]+:.*\n)*)", re.MULTILINE)


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch) -> Offered:
    monkeypatch.syspath_prepend(DOCS / "extensions")
    made: Offered = importlib.import_module("offered").offered
    return made


def pages() -> dict[str, str]:
    return {page.stem: page.read_text(encoding="utf-8") for page in sorted((DOCS / "api").glob("*.md"))}


def test_every_name_of_a_divided_package_is_on_one_page(offered: Offered) -> None:
    found: dict[str, Counter[str]] = {}
    for text in pages().values():
        for package, lines in OFFERED.findall(text):
            options = dict(re.findall(r":([\w-]+): (.*)", lines))
            assert set(options) <= {"made-in", "not-made-in"}
            names = offered(package, options.get("made-in", ""), options.get("not-made-in", ""))
            assert names, f"{package} {options} names nothing"
            found.setdefault(package, Counter()).update(names)
    assert len(found) > 3
    for package, names in found.items():
        assert names == Counter(import_module(package).__all__), package


def test_modules_that_pages_name_are_there(offered: Offered) -> None:
    for text in pages().values():
        for package, lines in OFFERED.findall(text):
            for one in " ".join(re.findall(r":[\w-]+: (.*)", lines)).split():
                assert import_module(f"{package}.{one}")


def test_every_page_is_in_the_table_and_in_the_tree() -> None:
    listed = (DOCS / "api.md").read_text(encoding="utf-8")
    for name in pages():
        assert f"](api/{name}.md)" in listed
        assert f"\napi/{name}\n" in listed
