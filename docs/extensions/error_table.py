"""``{error-table} errors`` or ``warnings``: classes of `adaptctl.errors`, each with its first sentence."""

import inspect
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

import adaptctl.errors
from adaptctl.errors import AdaptctlError, InputError, VerdictError

KINDS = {"errors": AdaptctlError, "warnings": Warning}
HEAD = ["| Class | Meaning | Also a | Exit code |", "|---|---|---|---|"]


def classes(kind: type) -> list[type]:
    """Classes of a kind that the module makes, in its order."""
    made = [one for one in vars(adaptctl.errors).values() if inspect.isclass(one) and issubclass(one, kind)]
    return [one for one in made if one.__module__ == adaptctl.errors.__name__]


def exit_code(kind: type) -> str:
    """Exit code of a command that ends by an error; none for warnings, after which it goes on."""
    if issubclass(kind, Warning):
        return "–"
    return "3" if issubclass(kind, VerdictError) else "2" if issubclass(kind, InputError) else "1"


def row(kind: type) -> str:
    """Line of the table."""
    meaning = (inspect.getdoc(kind) or "").split(".\n")[0].rstrip(".").replace("\n", " ")
    also = ", ".join(f"`{base.__name__}`" for base in kind.__bases__ if base is not Exception)
    name = f"[{kind.__name__}](api/adaptctl.errors.md)"
    return f"| {name} | {meaning} | {also or '–'} | {exit_code(kind)} |"


class ErrorTable(SphinxDirective):
    """Put the table at the directive."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The parsed table."""
        lines = [*HEAD, *map(row, classes(KINDS[self.arguments[0]]))]
        parent = nodes.container()
        parent.document = self.state.document
        self.state.nested_parse(StringList(lines, source="adaptctl.errors"), 0, parent)
        return parent.children


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("error-table", ErrorTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
