"""Reader of LeRobot data sets (v2.1 and v3), without videos."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from adaptctl.errors import FileError, printable
from adaptctl.logs.parquet import read_in_turn
from adaptctl.logs.table import LogTable, whole_stamps

INFO = Path("meta") / "info.json"
MAX_INFO, MAX_FILES = 4 * 2**20, 10_000
PLACE = re.compile(r"\{(chunk_index|file_index|episode_chunk|episode_index)(?::0?(\d{1,2})d)?\}")
PATTERN = re.compile(r"[\w./{}: -]{1,300}$")
DEFAULT = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
# Ends of names, and words in names of features, that tell what a number is.
KINDS = {
    "position": ("pos", "position", "q"),
    "velocity": ("vel", "velocity", "dq"),
    "effort": ("effort", "torque", "eff", "tau"),
}


def is_lerobot(path: Path) -> bool:
    """True for the folder of a LeRobot data set."""
    return (path / INFO).is_file()


def read_lerobot(path: str | Path) -> LogTable:
    """Table of a data set's observations: `position.J`, `velocity.J` and `effort.J` by the names of its joints."""
    folder = Path(path)
    info = _info(folder)
    features = info.get("features")
    if not isinstance(features, dict):
        raise FileError(f"{folder / INFO}: no features; expected those of a LeRobot data set")
    names = _names(features)
    if not any(name.startswith("effort.") for name in names.values()):
        known = ", ".join(map(printable, list(map(str, features))[:20]))
        raise FileError(
            f"{path}: no feature with efforts or torques: an action is no torque; record observation.effort; features: "
            f"{known}"
        )
    wanted = {"timestamp", "episode_index", *(feature for feature, _ in names)}
    whole = read_in_turn(str(path), _files(folder, info), sorted(wanted))
    units = {name: unit for (feature, i), name in names.items() if (unit := _unit(features[feature], i))}
    return _named(whole, names, units)


def _info(folder: Path) -> dict[str, Any]:
    try:
        if (folder / INFO).stat().st_size > MAX_INFO:
            raise FileError(f"{folder / INFO}: larger than {MAX_INFO} bytes")
        found = json.loads((folder / INFO).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FileError(f"{folder / INFO}: cannot be read ({printable(str(error)[:100])})") from error
    if not isinstance(found, dict):
        raise FileError(f"{folder / INFO}: expected a table of settings")
    return found


def _files(folder: Path, info: dict[str, Any]) -> list[Path]:
    """Files in the folder that fit its pattern, in the order of their numbers."""
    pattern = info.get("data_path", DEFAULT)
    if not isinstance(pattern, str) or not PATTERN.match(pattern) or ".." in pattern or pattern.startswith("/"):
        raise FileError(f"{folder / INFO}: data_path: expected a path within the data set, such as {DEFAULT}")
    rest = PLACE.sub("", pattern)
    if "{" in rest or "}" in rest:
        raise FileError(f"{folder / INFO}: data_path: expected numbers as in {DEFAULT}, got {printable(repr(pattern))}")
    form = re.compile(r"(\d{1,9})".join(map(re.escape, PLACE.split(pattern)[::3])) + "$")
    root, found = folder.resolve(), []
    for place in root.glob("**/*.parquet"):
        match = form.match(place.relative_to(root).as_posix())
        if match and place.resolve().is_relative_to(root):
            found.append((tuple(map(int, match.groups())), place))
        if len(found) > MAX_FILES:
            raise FileError(f"{folder}: more than {MAX_FILES} files")
    if not found:
        raise FileError(f"{folder}: no files that fit {pattern}; videos and settings alone are no log")
    return [place for _, place in sorted(found)]


def _names(features: dict[str, Any]) -> dict[tuple[str, int], str]:
    """Names of the columns of each feature's places: what they are, and of which joint."""
    found: dict[tuple[str, int], str] = {}
    for feature, about in features.items():
        if not feature.startswith("observation.") or not isinstance(about, dict):
            continue
        for i, name in enumerate(_joints(about)):
            joint, _, end = name.rpartition(".")
            kind = _kind(end) if joint else None
            kind, joint = (kind, joint) if kind else (_of_feature(feature), name)
            if kind is not None and f"{kind}.{joint}" not in found.values():
                found[feature, i] = f"{kind}.{joint}"
    return found


def _joints(about: dict[str, Any]) -> Iterator[str]:
    """Names of a feature's places; numbers from 1 where it has none."""
    if about.get("dtype") not in ("float32", "float64"):
        return
    names, shape = about.get("names"), about.get("shape")
    if isinstance(names, dict):
        names = next((one for one in names.values() if isinstance(one, list)), None)
    size = shape[0] if isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int) else 0
    if isinstance(names, list) and len(names) == size and all(isinstance(name, str) for name in names):
        yield from names
    elif 0 < size <= 1000:
        yield from (str(i + 1) for i in range(size))


def _unit(about: dict[str, Any], place: int) -> str:
    """Unit of a feature's place, where its entry has a list `units`, as this package writes it."""
    units = about.get("units")
    unit = units[place] if isinstance(units, list) and place < len(units) else None
    return unit if isinstance(unit, str) else ""


def _kind(word: str) -> str | None:
    return next((kind for kind, words in KINDS.items() if word.lower() in words), None)


def _of_feature(feature: str) -> str | None:
    """Kind of the numbers of a feature, by its name; those of observation.state are positions."""
    parts = re.split(r"[._]", feature.removeprefix("observation."))
    words = [word.removesuffix("s") for word in parts]
    told = next((kind for word in words if (kind := _kind(word))), None)
    return "position" if words == ["state"] else told


def _named(log: LogTable, names: dict[tuple[str, int], str], units: dict[str, str]) -> LogTable:
    """Table with time, episodes and the columns of the joints."""
    columns = {"time": log.columns["timestamp"]} if "timestamp" in log.columns else {}
    columns |= {"episode_index": log.columns["episode_index"]} if "episode_index" in log.columns else {}
    for (feature, i), name in names.items():
        values = log.columns.get(f"{feature}[{i}]", log.columns.get(feature))
        if values is not None:
            columns[name] = values
    if not any(name.startswith("effort.") for name in columns):
        raise FileError(f"{log.source}: its files lack the efforts that {INFO} names")
    return whole_stamps(LogTable(log.source, columns, {"time": "s"} | units))
