"""A log from a file of any kind that is understood."""

from __future__ import annotations

from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.identification.reading.table import MAX_BYTES, LogTable

TEXT = (".csv", ".tsv", ".txt")
BAGS = (".mcap", ".bag", ".db3")


def read_log(path: str | Path, topic: str | None = None) -> LogTable:
    """The table of a log, a `LogTable` of its columns, read by the suffix of `path`: .csv, .tsv or .txt as delimited
    text, .parquet, and .mcap, .bag, .db3 or a folder as a ROS bag. `topic` names the topic of JointState messages in a
    bag (None: its only one); other kinds ignore it. Raises `FileError` for a path that does not exist, of another
    suffix, a file above 4 GiB, and one that cannot be read as what its suffix says, `MissingExtraError` for a ROS bag
    where rosbags is not installed."""
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
