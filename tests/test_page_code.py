"""Code of README and documentation: narrow enough for a page, and without calls in calls in calls."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *(p for p in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in p.parts)]
BLOCK = re.compile(r"^(`{3,})(.*?)\n(.*?)^\1$", re.DOTALL | re.MULTILINE)
COLUMNS, CELL = 80, "{code-cell}"


def blocks(page: Path) -> list[tuple[str, str]]:
    """Languages and texts of blocks; directives but cells hold no code."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [(kind, text) for _, kind, text in found if not kind.startswith("{") or kind == CELL]


def statements(text: str) -> Iterator[ast.AST]:
    """Syntax trees of a block of Python, with prompts or without."""
    prompted = [line[4:] for line in text.splitlines() if re.match(r"(>>>|\.\.\.)( |$)", line)]
    try:
        yield ast.parse("\n".join(prompted) or text)
    except SyntaxError:  # what the page shows as refused, or the head of a cell
        return


def depth(call: ast.Call) -> int:
    """Number of calls within each other, from a call to the innermost of its arguments."""
    given = [*call.args, *(word.value for word in call.keywords)]
    inner = [node for one in given for node in ast.walk(one) if isinstance(node, ast.Call)]
    return 1 + max(map(depth, inner), default=0)


def nested(text: str) -> list[str]:
    calls = [node for tree in statements(text) for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [ast.unparse(call) for call in calls if depth(call) > 2]


@pytest.mark.parametrize("text", ["f(g(h(1)))", ">>> f(a=[g(*h())])\n1"])
def test_calls_in_calls_in_calls_are_found(text: str) -> None:
    assert nested(text)


def test_lines_of_code_fit_a_page() -> None:
    lines = [(page.name, line) for page in PAGES for _, text in blocks(page) for line in text.splitlines()]
    assert len(lines) > 1000
    assert [(name, line) for name, line in lines if len(line) > COLUMNS] == []


def test_no_page_nests_three_calls() -> None:
    python = [(page.name, text) for page in PAGES for kind, text in blocks(page) if kind in (CELL, "python")]
    assert [(name, call) for name, text in python for call in nested(text)] == []
