"""``.. offered:: package`` documents what a package offers, by the package's own name for it, on one page or several.

With ``:made-in:`` it takes what these modules of the package make; with ``:not-made-in:`` all the rest. So a package
with many names has a page a module, and each name is on one of them.
"""

import inspect
from importlib import import_module
from typing import Any, ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


def offered(package: str, made_in: str = "", not_made_in: str = "") -> list[str]:
    """Names of a package's `__all__` that some of its modules, named with spaces between, make; or that none of others
    does."""
    module = import_module(package)

    def among(name: str, wanted: str) -> bool:
        home = getattr(getattr(module, name), "__module__", None) or package
        return any(f"{home}.".startswith(f"{package}.{one}.") for one in wanted.split())

    return [
        name
        for name in module.__all__
        if (not made_in or among(name, made_in)) and not (not_made_in and among(name, not_made_in))
    ]


def directive(thing: Any) -> str:
    """Name of autodoc's directive for an object, and its options."""
    if inspect.isclass(thing):
        return "autoexception" if issubclass(thing, BaseException) else "autoclass"
    return "autofunction" if inspect.isroutine(thing) else "autodata"


class Offered(SphinxDirective):
    """Put autodoc's directives at this one."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"made-in": str, "not-made-in": str}

    def run(self) -> list[nodes.Node]:
        """The documented names."""
        package = self.arguments[0]
        names = offered(package, self.options.get("made-in", ""), self.options.get("not-made-in", ""))
        lines: list[str] = []
        for name in names:
            kind = directive(getattr(import_module(package), name))
            lines += [f".. {kind}:: {package}.{name}", *(["   :members:"] if kind == "autoclass" else []), ""]
        section = nodes.section()
        section.document = self.state.document
        self.state.nested_parse(StringList(lines, source=package), 0, section)
        return section.children


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("offered", Offered)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
