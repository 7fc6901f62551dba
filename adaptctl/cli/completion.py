"""`adaptctl install-completion`: commands, flags and experiments completed by the shell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter


def install_completion(
    *,
    shell: Annotated[Literal["bash", "zsh", "fish"] | None, Parameter(help="The shell; else the one in use.")] = None,
    out: Annotated[Path | None, Parameter(metavar="FILE", help="Write the script here instead.")] = None,
) -> None:
    """Install completion of commands and flags for a shell: a script, and a line in the shell's startup file where it
    needs one; with `out` the script alone, in that file. Prints where the script is. Raises `InputError` where no shell
    is named and the one in use is not known, `OSError` where a file cannot be written."""
    from cyclopts.completion import ShellDetectionError

    from adaptctl.cli.main import app
    from adaptctl.errors import InputError
    from adaptctl.files import require_place

    if out is not None:
        require_place(out)
    try:
        path = app.install_completion(shell=shell, output=out, add_to_startup=out is None)
    except ShellDetectionError as error:
        raise InputError("--shell: the shell in use is not known: name bash, zsh or fish") from error
    print(f"Written: {path}\nIt works in shells opened from now on.")
