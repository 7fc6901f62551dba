"""`adaptctl new`: a robot file to begin with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from adaptctl.cli.robot import AS_USUAL, RobotFlags

FORMATS = (".toml", ".xml")


def new(
    file: Annotated[Path, Parameter(name="FILE")],
    /,
    *,
    like: Annotated[str, Parameter(metavar="ROBOT")] = "two_link",
    reading: RobotFlags = AS_USUAL,
    overwrite: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """
    Write a robot file to edit, as TOML (.toml) or MJCF (.xml).

    A built-in robot of this format is copied with its comments; any other robot is converted.

    Parameters
    ----------
    file : Path
        File to write, .toml or .xml.
    like : str
        Robot to copy or convert: a built-in's name or a file.
    overwrite : bool
        Replace the file, if it exists.

    Raises
    ------
    InputError
        If the suffix is another one.
    FileError
        If a file cannot be read or written, or the format cannot hold the robot.
    NotFoundError
        If the robot is unknown.
    """
    from adaptctl.errors import InputError
    from adaptctl.files import validate_output, write_text

    if file.suffix.lower() not in FORMATS:
        raise InputError(f"{file}: expected a file name that ends in .toml or .xml (MJCF)")
    validate_output(file, overwrite)
    text = _text(like, file.suffix.lower(), reading)
    write_text(file, text)
    print(f"{file}: a copy of {like} to edit; adaptctl tune {file} tries it")


def _text(like: str, suffix: str, reading: RobotFlags) -> str:
    """Text of the file, a built-in's own where its format is asked for."""
    from adaptctl.description import builtin_file, builtin_names
    from adaptctl.files import read_text

    if like in builtin_names() and (path := builtin_file(like)).suffix == suffix and reading == AS_USUAL:
        return read_text(path)
    description = reading.load(like).description
    if suffix == ".toml":
        from adaptctl.description.writers.mechanism_file import mechanism_toml

        return mechanism_toml(description)
    from adaptctl.description.writers.mujoco_model import mjcf_text

    return mjcf_text(description)
