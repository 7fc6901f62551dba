"""Files of rerun recordings."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError
from adaptctl.files import replacing
from adaptctl.recording import views
from adaptctl.recording.colors import Color, joint_color
from adaptctl.recording.drawing import thinned
from adaptctl.recording.views import TIMELINE

# Largest number of samples of a curve.
MAX_CURVE_SAMPLES = 4000
# Time in s after which a disk is taken as full, megabytes being written in far less.
MAX_WRITING_TIME = 20.0
# Error in rad or m as which smaller ones are shown, since the axis is logarithmic.
MIN_SHOWN_ERROR = 1e-9


class Recorded(Protocol):
    """Protocol of the subject of a recording, such as a comparison or a report."""

    @property
    def experiment(self) -> str:
        """Name of the experiment or command, such as "two-arms"."""

    @property
    def title(self) -> str:
        """Title of the recording, a few words for its readers."""

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""

    @property
    def complete(self) -> bool:
        """True where it ran to its end, False where it was interrupted."""


@contextmanager
def saved_stream(
    path: str | Path,
    shown: Recorded,
    content: bytes,
    blueprint: rrb.Blueprint,
    mechanism: Mechanism | None = None,
    properties: Mapping[str, str | float | bool | list[Any]] = MappingProxyType({}),
) -> Iterator[rr.RecordingStream]:
    """Context manager with a recording stream that becomes a file, whole or not at all."""
    checksum = hashlib.sha256(content).hexdigest()
    identifier = f"{shown.experiment}-seed{shown.seed}-{checksum[:12]}"
    of: dict[str, Any] = {"geometry_sha256": mechanism.geometry_sha256} if mechanism is not None else {}
    with replacing(path) as beside:
        recording = rr.RecordingStream(f"adaptctl-{shown.experiment}", recording_id=identifier, make_default=False)
        recording.save(beside)
        recording.send_blueprint(blueprint)
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        recording.send_recording_name(shown.title)
        how: dict[str, Any] = {"experiment": shown.experiment, "seed": shown.seed, "complete": shown.complete}
        # Rerun leaves out what is empty, unless an earlier recording of this process had more under its name.
        told = {name: value for name, value in properties.items() if value not in ("", [])}
        about = rr.AnyValues(**told | how | of, content_sha256=checksum)
        recording.send_property("adaptctl", about)
        yield recording
        written(recording)
        recording.disconnect()
        _verify(beside)


def log_markdown(recording: rr.RecordingStream, path: str, text: str) -> None:
    """Log a text in Markdown at a path, the same at all times."""
    recording.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def log_picture(recording: rr.RecordingStream, path: str, file: Path) -> None:
    """Log the picture of a PNG file at a path, the same at all times."""
    recording.log(path, rr.EncodedImage(contents=file.read_bytes(), media_type="image/png"), static=True)


# Streams to a full disk, kept as rerun would wait without end before it took them apart.
_unwritten: list[rr.RecordingStream] = []


def written(recording: rr.RecordingStream) -> None:
    """Wait for all that was logged to be in the file, and no longer in memory; of a full disk rerun tells nothing."""
    try:
        recording.flush(timeout_sec=MAX_WRITING_TIME)
    except RuntimeError as error:
        _unwritten.append(recording)
        raise FileError(f"the recording cannot be written ({error}); the disk may be full") from error


def _verify(path: Path) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            RrdReader(path).store().schema()
    except (RuntimeError, Warning) as error:
        raise FileError(f"{path}: the recording cannot be read back ({error})") from error


class Curves(NamedTuple):
    """Curves (T, n) below a path over times (T,) in s, with names and colors; thinned to at most `most` samples."""

    path: str
    time: Array
    values: Array
    names: Sequence[str]
    colors: Sequence[Color]
    width: float = 1.5
    most: int = MAX_CURVE_SAMPLES


def of_joints(path: str, time: Array, values: Array, names: Sequence[str], most: int = MAX_CURVE_SAMPLES) -> Curves:
    """Curves of joints in the joints' colors."""
    return Curves(path, time, values, names, [joint_color(j) for j in range(len(names))], most=most)


def levels(path: str, time: Array, heights: Array, names: Sequence[str], colors: Sequence[Color]) -> Curves:
    """Curves that are horizontal lines at heights (n,), such as limits or true values."""
    return Curves(path, time[[0, -1]], np.stack([heights, heights]), names, colors, width=1.0)


def in_decades(errors: Array) -> Array:
    """Errors on a logarithmic scale: the power of ten in mrad or mm, at least of 1e-9 rad (m)."""
    return np.log10(1e3 * np.maximum(errors, MIN_SHOWN_ERROR))


def log_curves(recording: rr.RecordingStream, curves: Iterable[Curves]) -> None:
    """Log curves in a recording."""
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
    """Write a recording of a text in Markdown beside pictures, whole or not at all."""
    pictures = [views.picture(f"figures/{name}", name.replace("-", " ").capitalize()) for name in figures]
    text_view, shown_beside = views.text("summary", "Summary"), rrb.Vertical(*pictures)
    layout = rrb.Horizontal(text_view, shown_beside, column_shares=[2, 3], name="Overview")
    with saved_stream(path, shown, text.encode(), views.tabs(layout)) as recording:
        log_markdown(recording, "summary", text)
        for name, file in figures.items():
            log_picture(recording, f"figures/{name}", file)
