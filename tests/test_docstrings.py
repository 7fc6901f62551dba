"""Docstrings name what a thing is or returns: their first word is no question word, pronoun or bare preposition."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

HOME = Path(__file__).parent.parent
FOLDERS = ("adaptctl", "envs", "experiments", "benchmarks")
RIDDLES = {
    *("What", "How", "Where", "That", "Whether", "Which", "When", "Who", "Whose", "Why", "Those", "These", "This"),
    *("Of", "From", "To", "By", "With", "Without", "In", "On", "At", "For", "As", "It", "Its", "They", "Their", "None"),
    *("Nothing", "Itself", "Likewise", "So", "Up", "There", "Here", "Everything", "Something", "Or", "And", "But"),
}
"""Words with which a first sentence leaves its noun to be guessed."""
OWN = {"This": r"This \w+", "These": r"These \w+", "For": r"For (each|every) \w+"}
"""but with a noun after it: `This basis with ...`, `For each link, the ...`"""


def modules() -> list[Path]:
    """All modules, each once: two folders of the package are links."""
    return sorted({path.resolve() for folder in FOLDERS for path in (HOME / folder).rglob("*.py")})


def documented(node: ast.AST, within: str = "") -> Iterator[tuple[str, str]]:
    """The name and the docstring of a module and of everything in it."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
        yield within or "module", text
    for child in ast.iter_child_nodes(node):
        yield from documented(child, f"{within}.{child.name}".lstrip(".") if hasattr(child, "name") else within)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(HOME)))
def test_first_sentences_have_a_noun(path: Path) -> None:
    for name, text in documented(ast.parse(path.read_text())):
        first = re.split(r"\W", text, maxsplit=1)[0]
        assert first not in RIDDLES or re.match(OWN.get(first, "(?!)"), text), f"{name}: {text.splitlines()[0]}"
