"""Files of rerun recordings: written beside their place, read back, and put there."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from adaptctl.errors import FileError
from adaptctl.files import replacing


class Recorded(Protocol):
    """Protocol of what a recording shows: the experiment, its title and seed, and whether it ran to its end."""

    @property
    def experiment(self) -> str:
        """Name of the experiment, as the command line has it."""

    @property
    def title(self) -> str:
        """Title, for a person."""

    @property
    def seed(self) -> int:
        """Seed of everything random."""

    @property
    def complete(self) -> bool:
        """False when it was interrupted."""


@contextmanager
def saved_stream(
    path: str | Path, shown: Recorded, content: bytes, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Stream to log to, z up, named and titled; when the block ends it is a readable file at `path`.

    Equal `content`, such as the positions that were run, makes recordings equal to a viewer that has both open;
    others must not be mixed up. Raises FileError where the file cannot be written or read back.
    """
    identifier = f"{shown.experiment}-seed{shown.seed}-{hashlib.sha256(content).hexdigest()[:12]}"
    with replacing(path) as beside:
        recording = rr.RecordingStream(f"adaptctl-{shown.experiment}", recording_id=identifier, make_default=False)
        try:
            recording.save(beside)
            recording.send_blueprint(blueprint)
            recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            recording.send_recording_name(shown.title)
            about = rr.AnyValues(experiment=shown.experiment, seed=shown.seed, complete=shown.complete)
            recording.send_property("adaptctl", about)
            yield recording
            _flush(recording, path)
        finally:
            recording.disconnect()
        _verify(beside)


def log_markdown(recording: rr.RecordingStream, path: str, text: str) -> None:
    """Log text in Markdown, the same at all times."""
    recording.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def log_picture(recording: rr.RecordingStream, path: str, file: Path) -> None:
    """Log a PNG file's picture, the same at all times."""
    recording.log(path, rr.EncodedImage(contents=file.read_bytes(), media_type="image/png"), static=True)


def _flush(recording: rr.RecordingStream, path: str | Path) -> None:
    """See everything written; only this tells of a full disk."""
    try:
        recording.flush()
    except RuntimeError as error:
        raise FileError(f"{path}: cannot be written ({error}); is the disk full?") from error


def _verify(path: Path) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            RrdReader(path).store().schema()
    except (RuntimeError, Warning) as error:
        raise FileError(f"{path}: the recording cannot be read back ({error})") from error
