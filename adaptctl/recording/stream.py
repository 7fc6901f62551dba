"""Files of rerun recordings: written beside their place, read back, and put there."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.files import replacing
from adaptctl.recording import views
from adaptctl.recording.drawing import Color
from adaptctl.recording.scene import TIMELINE


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


@dataclass(frozen=True)
class Style:
    """Style of n curves that are drawn under one entity of a recording: their `names`, for the legend, and `colors`, n
    of each. The line `width` of all is in points of the screen, 1.5 by default. Nothing is checked at construction."""

    names: Sequence[str]
    colors: Sequence[Color]
    width: float = 1.5


def log_series(recording: rr.RecordingStream, path: str, time: Array, values: Array, style: Style) -> None:
    """Log n curves under the entity `path` of a rerun recording: `values` (T, n), in the unit that their view states,
    at T times `time` (T,), s, with the names and colours of `style`, n each. Without curves (n = 0) nothing is logged.
    Raises `ValueError` for values that are not two-dimensional; where there are not T times, rerun warns and draws no
    curve."""
    samples, curves = values.shape
    if curves == 0:
        return
    lines = rr.SeriesLines(colors=list(style.colors), names=list(style.names), widths=[style.width] * curves)
    recording.log(path, lines, static=True)
    recording.send_columns(
        path,
        [rr.TimeColumn(TIMELINE, duration=time)],
        rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel()).partition(np.full(samples, curves)),
    )


def log_levels(recording: rr.RecordingStream, path: str, time: Array, levels: Array, style: Style) -> None:
    """Log n horizontal lines, such as limits or true values, under the entity `path` of a rerun recording: at the
    heights `levels` (n,), in the unit that their view states, from the first to the last of T times `time` (T,), s,
    with the names and colours of `style`, n each. Raises `IndexError` without times."""
    ends = np.array([time[0], time[-1]])
    log_series(recording, path, ends, np.stack([levels, levels]), style)


def write_illustrated(path: Path, shown: Recorded, text: str, figures: Mapping[str, Path]) -> None:
    """Write a rerun recording without motion to the file `path` (.rrd), whole or not at all: a `text` in Markdown
    beside pictures. `shown` has the recording's title, experiment, seed and completeness. `figures` maps names, such as
    "tracking-error", to PNG files; they are shown one below the other, in their order, under these names. Raises
    `FileError` where the recording cannot be written or read back, `OSError` where a PNG file cannot be read."""
    pictures = [views.picture(f"figures/{name}", name.replace("-", " ").capitalize()) for name in figures]
    text_view, shown_beside = views.text("summary", "Summary"), rrb.Vertical(*pictures)
    layout = rrb.Horizontal(text_view, shown_beside, column_shares=[2, 3], name="Overview")
    with saved_stream(path, shown, text.encode(), views.tabs(layout)) as recording:
        log_markdown(recording, "summary", text)
        for name, file in figures.items():
            log_picture(recording, f"figures/{name}", file)
