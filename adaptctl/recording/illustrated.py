"""Recordings of results without motion: a text beside figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import rerun.blueprint as rrb

from adaptctl.recording import views
from adaptctl.recording.stream import Recorded, log_markdown, log_picture, saved_stream


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
