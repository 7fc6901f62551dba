"""`adaptctl doctor`, what is installed and whether it works together; and completion of commands in a shell."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from adaptctl.cli.output import Json, print_json
from adaptctl.optional_packages import viewer_program

if TYPE_CHECKING:
    from collections.abc import Iterator


SCHEMA = "adaptctl/doctor/1"
OK, WRONG = 0, 1


def doctor(*, json: Json = False) -> int:
    """Print what is installed and whether it works; the exit code is 1 where something is wrong."""
    found = examined()
    if json:
        print_json(found)
    else:
        print("\n".join(_lines(found)))
    return WRONG if found["wrong"] else OK


def examined() -> dict[str, Any]:
    """Report of what is installed, in JSON's types; `wrong` has a sentence for each fault."""
    import platform

    required, extras = _requirements()
    packages = {name: _version(name) for name in required}
    compiler, cache, viewer = _compiler(), _cache(), viewer_program()
    wrong = [f"{name} is missing: pip install {name}" for name, found in packages.items() if found is None]
    wrong += [part["error"] for part in (compiler, cache) if part["error"]]
    wrong += [] if viewer else ["the viewer is missing: pip install rerun-sdk"]
    return {
        "schema": SCHEMA,
        "adaptctl": _version("adaptctl"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": packages,
        "compiler": compiler,
        "cache": cache,
        "viewer": viewer,
        "extras": {extra: {name: _version(name) for name in names} for extra, names in extras.items()},
        "wrong": wrong,
    }


def _requirements() -> tuple[list[str], dict[str, list[str]]]:
    """Names of the packages that are required, and of those of each extra."""
    import re

    required: list[str] = []
    extras: dict[str, list[str]] = {}
    for entry in requires("adaptctl") or ():
        name = re.split(r"[^\w.-]", entry, maxsplit=1)[0]
        extra = re.search(r"""extra\s*==\s*['"]([\w-]+)""", entry)
        (extras.setdefault(extra[1], []) if extra else required).append(name)
    return required, extras


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _compiler() -> dict[str, Any]:
    """Lanes of the processor, and what a compiled sum of squares says of the compiler."""
    try:
        from adaptctl.compilation import compile_function
        from adaptctl.compilation.native import Processor

        kernel = compile_function(lambda x: sum(x[i] * x[i] for i in range(3)), {"x": 3}, name="doctor")
        right = float(kernel([1.0, 2.0, 3.0])) == 14.0
        return {"lanes": Processor.host().lanes, "error": None if right else "compiled code gives wrong results"}
    except Exception as error:  # whatever it is, telling it is what this command is for
        return {"lanes": None, "error": f"compilation fails: {' '.join(str(error).split())}"}


def _cache() -> dict[str, Any]:
    from adaptctl.compilation.object_cache import ObjectCache, cache_folder, stored_objects

    folder = cache_folder()
    fault = ObjectCache(folder).fault() if folder else None
    instead = "make it writable, or name another folder, or off, by ADAPTCTL_CACHE"
    error = f"{folder}: nothing can be cached, and all is compiled anew ({fault}): {instead}" if fault else None
    sizes = [status.st_size for status, _ in stored_objects(folder)] if folder and folder.is_dir() else []
    return {"folder": str(folder) if folder else None, "objects": len(sizes), "bytes": sum(sizes), "error": error}


def _lines(found: dict[str, Any]) -> Iterator[str]:
    yield f"adaptctl {found['adaptctl']}, Python {found['python']}, {found['platform']}"
    compiler, cache = found["compiler"], found["cache"]
    yield f"compiler  {compiler['error'] or 'works, ' + str(compiler['lanes']) + ' lanes of doubles'}"
    yield f"cache     {cache['folder'] or 'off'}: {cache['objects']} objects, {cache['bytes'] / 2**20:.1f} MB"
    yield f"viewer    {found['viewer'] or 'missing'}"
    yield "packages"
    yield from (f"  {name:<14} {has or 'missing'}" for name, has in found["packages"].items())
    yield "extras"
    for extra, packages in found["extras"].items():
        there = ", ".join(f"{name} {has}" for name, has in packages.items() if has)
        missing = ", ".join(name for name, has in packages.items() if not has)
        yield f"  {extra:<14} {there}{'; ' if there and missing else ''}{f'missing: {missing}' if missing else ''}"
    yield from (f"wrong: {one}" for one in found["wrong"])
    if not found["wrong"]:
        yield "No problems found."


def install_completion(
    *,
    shell: Literal["bash", "zsh", "fish"] | None = None,
    out: Annotated[Path | None, Parameter(metavar="FILE")] = None,
) -> None:
    """
    Install completion of commands and flags for a shell.

    Parameters
    ----------
    shell : str
        Shell. Default: the current one.
    out : Path
        File to write the script to, instead of installing it.

    Raises
    ------
    InputError
        If no shell is named and the one in use is not known.
    """
    from cyclopts.completion import ShellDetectionError

    from adaptctl.cli.main import app
    from adaptctl.errors import InputError
    from adaptctl.files import validate_output, write_text

    if out is not None:
        validate_output(out)
    try:
        if out is None:
            path = app.install_completion(shell=shell)
        else:
            write_text(path := out, app.generate_completion(shell=shell))
    except ShellDetectionError as error:
        raise InputError("--shell: the current shell is unknown: give bash, zsh or fish") from error
    print(f"Written: {path}\nIt takes effect in new shells.", file=sys.stderr if out is not None else sys.stdout)
