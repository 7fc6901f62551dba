"""Settings of an experiment from a file, or from a finished run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_origin

from cyclopts import App, ArgumentCollection
from cyclopts.config import Dict

from adaptctl.errors import InputError, suggested_name

FLAG = "--config"


def filled_in(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Fill in the settings of the file or folder of `--config` that the command line leaves out."""
    given = next((token.value for one in arguments if one.name == FLAG for token in one.tokens), None)
    if given is None:
        return
    hints = {".".join(one.keys): one.hint for one in arguments if one.keys}
    settings = {name: _value(given, name, value, hints) for name, value in _read(Path(given)).items()}
    Dict(settings, use_commands_as_keys=False, source=given)(app, commands, arguments)


def _read(path: Path) -> Mapping[str, Any]:
    """Settings by name, of a TOML file or of the summary in a results folder."""
    if not path.is_dir():
        from adaptctl.files import read_toml

        return read_toml(path, dict[str, Any])
    from adaptctl.recording.compared_folders import summary_of

    flags = {name: value for name, value in summary_of(path).settings.items() if name.startswith("--")}
    if not flags:
        raise InputError(f"{path}: its experiment has no settings")
    return {name.removeprefix("--").replace("-", "_"): value for name, value in flags.items()}


def _value(path: str, name: str, value: Any, hints: Mapping[str, Any]) -> Any:
    """Value of a setting, a list where it has several."""
    if name not in hints:
        raise InputError(f"{path}: {name}: no setting of this experiment{suggested_name(name, hints)}")
    if get_origin(hints[name]) is tuple:
        value = value.split() if isinstance(value, str) else value
    elif isinstance(value, list):
        raise InputError(f"{path}: {name}: expected one value, got {len(value)}")
    if any(not isinstance(one, str | float | int) for one in (value if isinstance(value, list) else [value])):
        raise InputError(f"{path}: {name}: expected numbers or texts, got {value!r}")
    return value
