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
    """Protocol of the subject of a recording: `experiment`, the experiment's name, `title`, `seed` of its random
    numbers, and `complete`, True where it ran to its end. An implementation needs these four attributes alone; reading
    them raises nothing."""

    @property
    def experiment(self) -> str:
        """Name of the experiment as the command line takes it, such as "two-arms"; for results without an experiment,
        that of the command."""

    @property
    def title(self) -> str:
        """Title of the recording, a few words for its readers."""

    @property
    def seed(self) -> int:
        """Seed of all random numbers of the experiment, a whole number."""

    @property
    def complete(self) -> bool:
        """True where the experiment ran to its end, False where it was interrupted."""


@contextmanager
def saved_stream(
    path: str | Path, shown: Recorded, content: bytes, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """A context with a rerun recording stream to log to, z up, which becomes the file `path` (.rrd), whole or not at
    all. When the block ends the file is complete and readable; when it raises, `path` stays as it was.

    `shown` gives title, experiment, seed and completeness; `blueprint` is the layout of its views. `content` is hashed
    into the recording's identifier: recordings of one experiment and seed with equal `content`, such as the bytes of
    the positions that were run, count as one recording in a viewer that has both open, others never. Raises `FileError`
    where the file cannot be written or read back.
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
    """Log a text in Markdown under the entity `path` of a rerun recording, the same at all times. Nothing is
    checked."""
    recording.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def log_picture(recording: rr.RecordingStream, path: str, file: Path) -> None:
    """Log the picture of a PNG file under the entity `path` of a rerun recording, the same at all times. Raises
    `OSError` where the file cannot be read."""
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
