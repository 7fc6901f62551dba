"""Files of rerun recordings: written beside their place, read back, and put there."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.files import replacing
from adaptctl.recording import views
from adaptctl.recording.drawing import Color, joint_color, thinned
from adaptctl.recording.views import TIMELINE

CURVE_SAMPLES = 4000
"""At most as many samples of a curve are shown."""
SMALLEST_ERROR = 1e-9
"""rad or m: smaller errors are shown as this, since the axis is logarithmic"""


class Recorded(Protocol):
    """Protocol of the subject of a recording, such as a `Comparison` or a `Report`; reading its attributes raises
    nothing."""

    @property
    def experiment(self) -> str:
        """Name of the experiment or command, such as "two-arms"."""

    @property
    def title(self) -> str:
        """Title of the recording, a few words for its readers."""

    @property
    def seed(self) -> int:
        """Seed of all random numbers, a whole number."""

    @property
    def complete(self) -> bool:
        """True where it ran to its end, False where it was interrupted."""


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


class Curves(NamedTuple):
    """Curves, n of them, that are drawn below the entity `path` of a recording: `values` (T, n), or (T,) for one, in
    the unit that their view states, at T times `time` (T,), s, with `names` for the legend and `colors`, n of each. The
    line `width` of all is in points of the screen, 1.5 by default; samples are thinned to at most `most`, by default
    4000, for the table beside the recording has them all. Nothing is checked at construction."""

    path: str
    time: Array
    values: Array
    names: Sequence[str]
    colors: Sequence[Color]
    width: float = 1.5
    most: int = CURVE_SAMPLES


def of_joints(path: str, time: Array, values: Array, names: Sequence[str], most: int = CURVE_SAMPLES) -> Curves:
    """`Curves` of joints called `names`, in the joints' colours. Nothing is checked."""
    return Curves(path, time, values, names, [joint_color(j) for j in range(len(names))], most=most)


def levels(path: str, time: Array, heights: Array, names: Sequence[str], colors: Sequence[Color]) -> Curves:
    """`Curves` that are n horizontal lines, such as limits or true values, at `heights` (n,) from the first to the last
    of T times `time` (T,), s. Raises `IndexError` without times."""
    return Curves(path, time[[0, -1]], np.stack([heights, heights]), names, colors, width=1.0)


def in_decades(errors: Array) -> Array:
    """Errors (...), rad (m if prismatic), as curves on a logarithmic scale show them: log10(1000 e), the power of ten
    in mrad or mm. Errors below 1e-9 are taken as 1e-9."""
    return np.log10(1e3 * np.maximum(errors, SMALLEST_ERROR))


def log_curves(recording: rr.RecordingStream, curves: Iterable[Curves]) -> None:
    """Log `curves` in a rerun recording. Those without any curve (n = 0) are left out; where there are not as many
    times as values, rerun warns and draws none."""
    for one in curves:
        values = one.values[:, None] if one.values.ndim == 1 else one.values
        every, count = thinned(len(one.time), one.most), values.shape[1]
        if count == 0:
            continue
        shown = np.ascontiguousarray(values[every])
        lines = rr.SeriesLines(colors=list(one.colors), names=list(one.names), widths=[one.width] * count)
        recording.log(one.path, lines, static=True)
        recording.send_columns(
            one.path,
            [rr.TimeColumn(TIMELINE, duration=one.time[every])],
            rr.Scalars.columns(scalars=shown.ravel()).partition(np.full(len(shown), count)),
        )


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
