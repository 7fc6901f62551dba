"""<include> elements of MJCF: other files' content put in their place, as MuJoCo does."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from adaptctl.description.readers.xml_elements import MOST_ELEMENTS, attribute, parsed, refuse
from adaptctl.errors import InputError, printable
from adaptctl.files import read_text

MOST_FILES = 100
"""files that one scene may consist of"""


def included(root: Element, path: str | Path) -> Element:
    """Replace every <include> below `root`, the root element of the MJCF file at `path`, by the elements of the file
    that it names, which may include others. `root` is changed in place and returned.

    Files are found from the folder of the main file, and must be in it or below. Raises `InputError` for a file that is
    outside, included twice, cannot be read or is no MJCF, for more than 100 files, and for more than 50 000 elements in
    all.
    """
    folder, seen = Path(path).parent, {Path(path).resolve()}
    pending = [root]
    while pending:
        element = pending.pop()
        for child in list(element):
            if child.tag == "include":
                if len(seen) > MOST_FILES:
                    refuse(child, f"<include>: more than {MOST_FILES} files, the most that are read")
                place = list(element).index(child)
                element.remove(child)
                for k, new in enumerate(_content(child, folder, seen)):
                    element.insert(place + k, new)
        if any(child.tag == "include" for child in element):
            pending.append(element)
        else:
            pending += list(element)
    if sum(1 for _ in root.iter()) > MOST_ELEMENTS:
        raise InputError(f"more than {MOST_ELEMENTS} elements with all that is included, the most that are read")
    return root


def _content(element: Element, folder: Path, seen: set[Path]) -> list[Element]:
    """The elements of the file that an <include> names. Raises `InputError` for a file outside the folder, one included
    twice, or one that cannot be read."""
    name = attribute(element, "file", "<include>")
    file = (folder / name).resolve()
    if not file.is_relative_to(folder.resolve()):
        refuse(element, f"<include>: {printable(name)!r} is outside the folder of the file: put it in there")
    if file in seen:
        refuse(element, f"<include>: {printable(name)!r} is included twice: once is enough")
    seen.add(file)
    try:
        return list(parsed(read_text(file), "mujocoinclude", "mujoco"))
    except InputError as error:
        text = str(error).removeprefix(f"{file}: ")
        raise InputError(f"<include> of {printable(name)!r}: {text}") from error
