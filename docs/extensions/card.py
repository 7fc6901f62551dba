"""``{card} module.Class``: the class's docstring, which is Markdown, as part of a page.

An environment's docstring is its card, in Gymnasium's manner, with headings and tables; autodoc would read
it as reStructuredText.
"""

import inspect
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


class Card(SphinxDirective):
    """Put a docstring, its headings one level below the page's, where the directive stands."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The parsed docstring."""
        module, _, name = self.arguments[0].rpartition(".")
        text = inspect.getdoc(getattr(import_module(module), name)) or ""
        section = nodes.section()
        section.document = self.state.document
        self.state.nested_parse(StringList(text.splitlines(), source=self.arguments[0]), 0, section, match_titles=True)
        return section.children


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("card", Card)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
