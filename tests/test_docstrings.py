"""Docstrings name what a thing is or returns: their first word is no question word, pronoun or bare preposition."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

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


def documented(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """The name and the docstring of a module and of everything in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (
            text := ast.get_docstring(node, clean=False)
        ):
            yield getattr(node, "name", "module"), text.strip()


def is_riddle(text: str) -> bool:
    first = re.split(r"\W", text, maxsplit=1)[0]
    return first in RIDDLES and not re.match(OWN.get(first, "(?!)"), text)


def test_first_sentences_have_a_noun() -> None:
    assert [
        f"{path.relative_to(HOME)}, {name}: {text.splitlines()[0]}"
        for path in modules()
        for name, text in documented(ast.parse(path.read_text()))
        if is_riddle(text)
    ] == []


def test_riddles_are_told_from_nouns() -> None:
    texts = ("Where it is.", "For links, the place.", "Place of a link.", "For each link, its place.", "This basis.")
    assert list(map(is_riddle, texts)) == [True, True, False, False, False]
