"""Modules that are changed in memory when they are imported, in a test's process and in those that it starts.

`CHANGED_MODULE` names one that is loaded from other code; `ENTERED_BY_TEST` names a file into which functions of the
package write their names when they are entered.
"""

from __future__ import annotations

import ast
import builtins
import marshal
import os
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType

ROOT = Path(__file__).resolve().parent.parent.parent
TOPS = ("adaptctl", "envs", "experiments")


class Entered(dict[str, bool]):
    """Names of functions, each of which is written into a file when it is first looked up."""

    def __init__(self, target: str) -> None:
        super().__init__()
        self._file = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def __missing__(self, name: str) -> bool:
        self[name] = True
        os.write(self._file, f"{name}\n".encode())
        return True


def change_modules() -> None:
    """Have modules that are imported from now on changed as the environment asks."""
    target, _, changed = os.environ.get("CHANGED_MODULE", "").partition(os.pathsep)
    entered = os.environ.get("ENTERED_BY_TEST", "")
    if entered:
        builtins.__dict__["entered_by_test"] = Entered(entered)
    original = SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, name: str) -> CodeType | None:
        path = Path(os.path.realpath(self.path))
        if str(path) == target:
            code: CodeType = marshal.loads(Path(changed).read_bytes())
            return code
        if entered and path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in TOPS:
            return compile(reporting(path), self.path, "exec")
        return original(self, name)

    if target or entered:
        SourceFileLoader.get_code = get_code  # type: ignore[method-assign,assignment]


def reporting(path: Path) -> ast.Module:
    """A module, each function of which first looks its name up."""
    tree = ast.parse(path.read_text())
    for node, function in functions(tree):
        report = ast.parse(f"entered_by_test[{f'{path.relative_to(ROOT)}::{function}'!r}]").body
        node.body[1 if ast.get_docstring(node) else 0 : 0] = report
    return ast.fix_missing_locations(tree)


def functions(node: ast.AST, within: str = "") -> Iterator[tuple[ast.FunctionDef, str]]:
    """Every function below a node, and its qualified name."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            name = f"{within}.{child.name}".lstrip(".")
            if isinstance(child, ast.FunctionDef):
                yield child, name
            yield from functions(child, name)
        else:
            yield from functions(child, within)
