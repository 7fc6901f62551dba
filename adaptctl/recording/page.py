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
    """Caption of a figure, and its PNG file in base64."""

    caption: str
    data: str


def rendered(template: str, package: str = HOME, **content: object) -> str:
    """HTML of a template beside the modules of `package`; it may extend or import those of this package."""
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
    """Figures whose files are given, as a page holds them, by name."""
    return {
        drawing.name: Figure(drawing.caption, base64.b64encode(files[drawing.name].read_bytes()).decode("ascii"))
        for drawing in drawings
        if drawing.name in files
    }
