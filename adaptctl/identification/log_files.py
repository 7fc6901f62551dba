"""Logs as they were written."""

from __future__ import annotations

from pathlib import Path

from adaptctl.errors import FileError, MissingExtraError
from adaptctl.files import similar, validate_readable
from adaptctl.logs.isolated import read_isolated
from adaptctl.logs.lerobot import INFO
from adaptctl.logs.table import MAX_BYTES
from adaptctl.logs.table import LogTable as LogTable
from adaptctl.logs.table import table as table
from adaptctl.logs.text import read_delimited
from adaptctl.stages import stage

TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
BAG_SUFFIXES = (".mcap", ".bag", ".db3")
READERS = {".parquet": "parquet:read_parquet", ".rrd": "rerun_recording:read_rrd"}
# File that makes a folder a bag of ROS 2.
BAG = "metadata.yaml"
PACKED, SHEETS = (".gz", ".bz2", ".xz", ".zst", ".zip", ".7z", ".tar", ".tgz"), (".xlsx", ".xls", ".ods")
# Logs in folders of results.
RUNS = ("trace.parquet", "run.parquet")
# Mark between the files of one log, whose columns are joined.
JOIN = "+"


@stage("reading logs")
def read_log(path: str | Path, topic: str | None = None) -> LogTable:
    """Table of a log, read by the suffix of its path; of several files joined by +, that of all their columns."""
    if JOIN in str(path) and not Path(path).exists():
        from adaptctl.identification.joined_files import joined

        return joined(str(path), [_read(part, topic) for part in str(path).split(JOIN)])
    return _read(path, topic)


def _read(path: str | Path, topic: str | None) -> LogTable:
    place, suffix = Path(path), Path(path).suffix.lower()
    if not place.exists():
        hint = "; the example brings its robot: give it without --robot" if str(path) == "tx40" else similar(path)
        raise FileError(f"{path}: does not exist{hint}")
    if place.is_dir() and (place / INFO).is_file():
        return read_isolated("lerobot:read_lerobot", path)
    if place.is_dir():
        _validate_folder(path, place)
    else:
        _validate_file(path, place)
    if place.is_dir() or suffix in BAG_SUFFIXES:
        return _read_bag(path, topic)
    if suffix in READERS:
        return read_isolated(READERS[suffix], path)
    if suffix in TEXT_SUFFIXES:
        return read_delimited(path)
    part = "sheet" if suffix in SHEETS else "columns, with names,"
    way = "unpack it" if suffix in PACKED else f"write its {part} as .csv"
    raise FileError(
        f"{path}: logs are read from {', '.join((*TEXT_SUFFIXES, *READERS, *BAG_SUFFIXES))} and folders of ROS 2 bags "
        f"and LeRobot data sets, not from {suffix or 'a file without suffix'}; {way}"
    )


def _validate_folder(path: str | Path, place: Path) -> None:
    if runs := [str(place / name) for name in RUNS if (place / name).is_file()]:
        raise FileError(f"{path}: is a folder of results; its log is {runs[0]}")
    if not (place / BAG).is_file():
        raise FileError(f"{path}: is a folder without a log; give a file, or a folder with {BAG} (ROS 2) or {INFO}")


def _validate_file(path: str | Path, place: Path) -> None:
    validate_readable(path)
    size = place.stat().st_size
    if size > MAX_BYTES:
        raise FileError(f"{path}: larger than the limit of {MAX_BYTES} bytes; split it into several logs")
    if not size and place.suffix.lower() not in TEXT_SUFFIXES:
        raise FileError(f"{path}: is empty; give a log that was written to its end")


def _read_bag(path: str | Path, topic: str | None) -> LogTable:
    from importlib.util import find_spec

    is_mcap = Path(path).suffix.lower() == ".mcap"
    for name in ("rosbags", "mcap") if is_mcap else ("rosbags",):
        if find_spec(name) is None:
            raise MissingExtraError(f"ROS bags and MCAP need {name}: pip install 'adaptctl[logs]'")
    reader = "foxglove:read_mcap" if is_mcap else "ros_bag:read_ros_bag"
    return read_isolated(reader, path, *([] if topic is None else [topic]))
