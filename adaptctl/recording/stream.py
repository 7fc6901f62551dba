"""A rerun recording as a file: written beside its place, read back, and put there."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from adaptctl.errors import FileError
from adaptctl.files import replacing


@contextmanager
def saved_stream(
    path: str | Path, experiment: str, identifier: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """A stream to log to, z up; when the block ends it is a readable file in its place. Raises FileError.

    Recordings of equal `identifier` are taken for one by a viewer that has both open.
    """
    with replacing(path) as beside:
        recording = rr.RecordingStream(f"adaptctl-{experiment}", recording_id=identifier, make_default=False)
        try:
            recording.save(beside)
            recording.send_blueprint(blueprint)
            recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            yield recording
            recording.flush()  # only this tells of a full disk
        finally:
            recording.disconnect()
        _verify(beside)


def log_markdown(recording: rr.RecordingStream, path: str, text: str) -> None:
    """Text that stands still."""
    recording.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def _verify(path: Path) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            RrdReader(path).store().schema()
    except (RuntimeError, Warning) as error:
        raise FileError(f"{path}: the recording cannot be read back ({error})") from error
