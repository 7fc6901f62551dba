"""Sphinx configuration: `make docs` builds the pages of this folder, offline, and takes every warning as an error."""

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

_project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = _project["name"]
version = release = _project["version"]
author = "the adaptctl developers"
copyright = f"2026, {author}"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "card",
    "error_table",
    "live_arm",
    "mathml",
    "offered",
    "plain_docstrings",
]
exclude_patterns = ["_build", "making"]
html_theme = "furo"
html_title = f"adaptctl {version}"
html_show_sphinx = False
html_copy_source = False
html_use_index = False  # a page of every name is what the search is for
html_static_path = ["_static"]
templates_path = ["_templates"]
html_js_files = ["copy.js"]
html_css_files = ["copy.css"]
_source = _project.get("urls", {}).get("Repository")
if _source:  # then every page has a link to edit it
    html_theme_options = {"source_repository": _source, "source_branch": "main", "source_directory": "docs/"}

myst_enable_extensions = ["dollarmath", "deflist"]
suppress_warnings = ["ref.citation"]  # a reference that no sentence cites is listed all the same
myst_heading_anchors = 3

# The tutorials are notebooks: computed at every build, and an error in one ends it.
nb_execution_mode = "force"
nb_execution_timeout = 120
nb_execution_raise_on_error = True

numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "Array"}
default_role = "code"
python_maximum_signature_line_length = 88


def setup(app: Any) -> None:
    """Tidy what doctest, autodoc and tables leave."""
    app.connect("source-read", _without_blank_ends)
    app.connect("autodoc-process-signature", _plain_aliases)
    app.connect("html-page-context", _for_every_reader, priority=900)


def _without_blank_ends(app: Any, page: str, source: list[str]) -> None:
    """Doctest needs a blank line after an output; readers do not."""
    source[0] = source[0].replace("\n\n```\n", "\n```\n")


LINE = '<span class="sig-line"><em'
PARAMETERS = re.compile(r"<dl>\n((?:<dd>.*</dd>\n)+)</dl>")
"""Lines of a long signature, which Sphinx writes as definitions of nothing."""


def _for_every_reader(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """An empty corner of a table is no heading, a line of a signature no definition; captions have a level."""
    body = re.sub(r"<th[^>]*>(<p></p>)?</th>", "<td></td>", context.get("body", ""))
    if (tree := "furo_navigation_tree") in context:
        context[tree] = context[tree].replace('role="heading">', 'role="heading" aria-level="2">')
    context["body"] = PARAMETERS.sub(
        lambda found: re.sub("<(/?)dd", r"<\1span", found[1]).replace("<span><em", LINE), body
    )


def _plain_aliases(app: Any, kind: str, name: str, what: Any, options: Any, *signature: str | None) -> Any:
    """Sphinx writes aliases in a union by their representation."""
    return tuple(re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", part) if part else part for part in signature)
