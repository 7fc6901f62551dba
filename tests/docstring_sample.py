"""Public docstrings drawn by seed, to be read and scored by a person:

    python tests/docstring_sample.py [--count 40] [--seed 0] [--inner]

Public is what the pages of docs/api offer, and the public methods of these classes; `--inner` draws among all names
without an underscore instead, of all modules without one. Score each 0-2. 2: the first sentence says what the thing is
or returns, with its noun, in the field's standard terms, and shapes, units and errors are given where there are any; 1:
some of it is left to be guessed; 0: a riddle.
"""

from __future__ import annotations

import argparse
import ast
import random
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from textwrap import indent

HOME = Path(__file__).parent.parent
FOLDERS = {"adaptctl": "adaptctl", "envs": "adaptctl.envs", "experiments": "adaptctl.experiments"}
"""Folders, by the names that they are imported by."""


def modules() -> list[tuple[str, Path]]:
    """The name and the path of every public module of the package, by name."""
    found = []
    for folder, package in FOLDERS.items():
        for path in sorted((HOME / folder).rglob("*.py")):
            name = ".".join((package, *path.relative_to(HOME / folder).with_suffix("").parts)).removesuffix(".__init__")
            if not any(part.startswith("_") for part in name.split(".")):
                found.append((name, path))
    return sorted(found)


def documented(node: ast.Module | ast.ClassDef, within: str) -> Iterator[tuple[str, str, str]]:
    """The name, the signature and the docstring of the public classes, functions and methods of a module or class."""
    for child in node.body:
        if isinstance(child, ast.ClassDef | ast.FunctionDef) and not child.name.startswith("_"):
            name = f"{within}.{child.name}"
            yield name, signature(child), ast.get_docstring(child) or ""
            if isinstance(child, ast.ClassDef):
                yield from documented(child, name)


def signature(node: ast.ClassDef | ast.FunctionDef) -> str:
    """The arguments and the type of a function's result; the bases and the typed fields of a class."""
    if isinstance(node, ast.FunctionDef):
        kind = "".join(f"@{ast.unparse(decorator)} " for decorator in node.decorator_list)
        return f"{kind}({ast.unparse(node.args)}) -> {ast.unparse(node.returns) if node.returns else 'None'}"
    fields = [ast.unparse(child) for child in node.body if isinstance(child, ast.AnnAssign)]
    return f"class({', '.join(map(ast.unparse, node.bases))}) {'; '.join(fields)}"


def inner() -> list[tuple[str, str, str]]:
    """The name, the signature and the docstring of all that has no underscore, by name."""
    found = [row for name, path in modules() for row in documented(ast.parse(path.read_text()), name)]
    return sorted({row[0]: row for row in found if row[2]}.values())


def public() -> list[tuple[str, str, str]]:
    """The name, the signature and the docstring of what the pages of docs/api offer, by name."""
    offered = set()
    for page in sorted((HOME / "docs" / "api").glob("*.md")):
        module = import_module(page.stem)
        own = [name for name, thing in vars(module).items() if getattr(thing, "__module__", "") == page.stem]
        for name in getattr(module, "__all__", own):
            thing = getattr(module, name)
            offered.add(f"{getattr(thing, '__module__', '')}.{getattr(thing, '__qualname__', '')}")
    return [row for row in inner() if row[0] in offered or row[0].rpartition(".")[0] in offered]


def main() -> None:
    """Print a sample."""
    parser = argparse.ArgumentParser(description="Public docstrings drawn by seed.")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inner", action="store_true", help="draw among all names without an underscore")
    asked = parser.parse_args()
    rows = inner() if asked.inner else public()
    for number, (name, form, text) in enumerate(random.Random(asked.seed).sample(rows, asked.count), 1):
        print(f"{number}. {name}{form}\n\n{indent(text, '    ')}\n")


if __name__ == "__main__":
    main()
