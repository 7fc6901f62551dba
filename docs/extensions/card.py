"""``{card} module.Class``: the class's docstring as part of a page.

An environment's docstring is its card, in Gymnasium's manner, with headings and tables in Markdown among the sections
of numpydoc; autodoc would read it as reStructuredText.
"""

import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

LISTS = ("Parameters", "Returns", "Raises")
"""Sections that are lists of names, each with an indented text."""


def in_markdown(text: str) -> Iterator[str]:
    """Lines of a docstring with its sections as headings, lists and code."""
    section, lines = "", [*text.splitlines(), ""]
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if re.fullmatch("-{3,}", line):
            continue
        if re.fullmatch("-{3,}", below):
            if section == "Examples":
                yield "```"
            section = line
            yield from ("", f"## {line}", "", *(("```pycon",) if section == "Examples" else ()))
        elif section in LISTS and line and not line.startswith(" "):
            name, _, kind = line.partition(" : ")
            yield f"* `{name}`" + (f" ({kind})" if kind else "")
        elif section in LISTS:
            yield line and f"  {line.strip()}"
        else:
            yield line if section == "Examples" else re.sub(r"(?:\.\. )?\[(\d)\]_?", r"[\1]", line)
    if section == "Examples":
        yield "```"


class Card(SphinxDirective):
    """Put a docstring, its headings one level below the page's, at the directive."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The parsed docstring."""
        module, _, name = self.arguments[0].rpartition(".")
        text = inspect.getdoc(getattr(import_module(module), name)) or ""
        section = nodes.section()
        section.document = self.state.document
        lines = StringList(list(in_markdown(text)), source=self.arguments[0])
        self.state.nested_parse(lines, 0, section, match_titles=True)
        return section.children


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("card", Card)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
