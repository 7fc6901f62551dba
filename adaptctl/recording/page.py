"""Pages of HTML that need nothing else: templates that extend ``page.html``, with the figures inside."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import jinja2

from adaptctl.recording.drawing import Drawing

HOME = "adaptctl.recording"


class Figure(NamedTuple):
    """A figure inside an HTML page: its `caption`, in words, and `data`, the bytes of its PNG file as base64 text.
    Nothing is checked at construction."""

    caption: str
    data: str


def rendered(template: str, package: str = HOME, **content: object) -> str:
    """HTML, as text, made from a Jinja template: the file named `template` in the folder of the Python package
    `package`, by default "adaptctl.recording", whose templates it may extend and import. `content` has the template's
    variables, by name; texts among them are escaped for HTML.

    Raises Jinja's `TemplateNotFound` for a template that does not exist, and its `UndefinedError` for a variable that
    the template uses and `content` lacks; `ModuleNotFoundError` for a package that does not exist.
    """
    homes = dict.fromkeys([package, HOME])
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(home, ".") for home in homes]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**content)


def embedded(drawings: Iterable[Drawing], files: Mapping[str, Path]) -> dict[str, Figure]:
    """Figures to put inside an HTML page, a mapping of the drawings' names to `Figure`, each a caption and a PNG file
    in base64. `files` maps names to PNG files; a drawing without a file is left out. Raises `OSError` where a file
    cannot be read."""
    return {
        drawing.name: Figure(drawing.caption, base64.b64encode(files[drawing.name].read_bytes()).decode("ascii"))
        for drawing in drawings
        if drawing.name in files
    }
