"""A log from a file of any kind that is understood."""

from __future__ import annotations

from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.identification.reading.table import MAX_BYTES, LogTable

TEXT = (".csv", ".tsv", ".txt")
BAGS = (".mcap", ".bag", ".db3")


def read_log(path: str | Path, topic: str | None = None) -> LogTable:
    """The columns of a log, read by its suffix; a folder is taken as a ROS 2 bag. Raises `FileError` for a file that is
    missing, too large or of an unknown kind, and as its reader does."""
    place = Path(path)
    suffix = place.suffix.lower()
    if not place.exists():
        raise FileError(f"{path}: does not exist")
    if place.is_file() and place.stat().st_size > MAX_BYTES:
        raise FileError(f"{path}: larger than {MAX_BYTES} bytes, the most that is read; cut it into several logs")
    if place.is_dir() or suffix in BAGS:
        from adaptctl.identification.reading.ros_bag import read_ros_bag

        return read_ros_bag(path, topic)
    if suffix == ".parquet":
        from adaptctl.identification.reading.parquet import read_parquet

        return read_parquet(path)
    if suffix in TEXT:
        from adaptctl.identification.reading.delimited import read_delimited

        return read_delimited(path)
    raise FileError(
        f"{path}: logs are read from {', '.join((*TEXT, '.parquet', *BAGS))} and folders of ROS 2 bags, not from "
        f"{suffix or 'a file without suffix'}"
    )
