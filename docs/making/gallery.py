"""Gallery page: every experiment with a picture, its command, and what came out of it."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from html import unescape
from pathlib import Path
from subprocess import run
from typing import NamedTuple, TypeAlias

from PIL import Image

from adaptctl.experiments import EXPERIMENTS

DOCS = Path(__file__).resolve().parent.parent
PICTURES, PAGE = DOCS / "images" / "gallery", DOCS / "gallery.md"
WIDTH = 960
"""pixels of a picture"""
TRIES = 3
"""of a viewer, which on a busy machine may not answer in time"""
LOOKS = 6
"""Of a viewer, a second apart: what it says of itself when it opens goes away while it is looked at."""
FIRST = {
    "task-space": "tool-error",
    "sheu-walker-1991": "figure-3",
    "sheu-walker-1991-arms": "tip-error",
    "laws": "parameter-error",
    "laws-payload": "parameter-error",
    "laws-noise": "parameter-error",
    "laws-saturation": "parameter-error",
    "laws-friction": "friction",
    "laws-springs": "parameter-error",
}
"""Most relevant figure of an experiment, if it is not the tracking error."""


class Shown(NamedTuple):
    """A run in the gallery: its `name`, fit for a file; what it is about, in words; and the command's arguments."""

    name: str
    summary: str
    arguments: str


MORE = {
    "puma560-adaptive": (
        Shown(
            "puma560-adaptive-components",
            "Adaptive tracking of the PUMA 560 with a reduced number of essential components",
            "puma560-adaptive --components 36 34 30 25 10",
        ),
    ),
    "adaptive": (
        Shown(
            "adaptive-both",
            "One law on the built-in plant and on MuJoCo: their difference, and its cause",
            "adaptive --plant both",
        ),
    ),
    "laws": tuple(
        Shown(f"laws-{name}", summary, f"laws --disturbance {name}")
        for name, summary in (
            ("payload", "Payload pickup and release during motion: recovery time of each law"),
            ("noise", "Encoder noise, delay, lag and weak motors without excitation: drift of each law"),
            (
                "saturation",
                "Motors too weak for a temporary payload: adaptation with and without freezing during saturation",
            ),
            ("friction", "Joint friction: adapted as parameters, and ignored"),
            ("springs", "Elastic joints: largest stable bandwidth of each law against their stiffness"),
        )
    ),
    "sheu-walker-1991": (
        Shown(
            "sheu-walker-1991-arms",
            "The three-joint PUMA and the five-bar on one path in space: the cost of a closed loop",
            "sheu-walker-1991 --only serial-versus-graph",
        ),
    ),
}
"""Other runs of an experiment."""
SHOWN = [
    shown
    for entry in EXPERIMENTS
    for shown in (Shown(entry.name, entry.summary, entry.name), *MORE.get(entry.name, ()))
]
HEAD = """# Gallery

All experiments, each with a picture, its command and its result. `make gallery` updates this page.

Most pictures are of a recording. Left: the learning arm; the green ghost is the reference, the orange one the arm
without adaptation. Right: the joint errors with adaptation and without, the Lyapunov function or the energy, and the
torques over their limits. A click opens a picture in full size.
"""
Box: TypeAlias = tuple[float, float, float, float]
WHOLE = (0.0, 0.0, 1.0, 1.0)
ARM, FIGURES = (0.0, 0.064, 1.0, 0.672), (0.403, 0.064, 1.0, 0.963)
"""Shares of a viewer's window, left, upper, right and lower: the arm with its curves, and the figures of a recording
without an arm."""
TEXT_BELOW_ARM = (0.0, 0.562, 0.4165, 0.672)
BACKGROUND = (13, 13, 13)


def make(results: Path) -> list[str]:
    """Run what has no results yet, and write pictures and page; returns sentences on what is missing."""
    missing, parts = [], [HEAD]
    PICTURES.mkdir(parents=True, exist_ok=True)
    for entry in SHOWN:
        folder = results / entry.name
        if not (folder / "report.html").is_file():
            command = [sys.executable, "-m", "adaptctl", "experiment", "run", *entry.arguments.split()]
            if run([*command, "--out", str(folder), "--figures"], check=False).returncode not in (0, 3):
                missing.append(f"{entry.name}: the run failed")
        missing += list(_picture(entry.name, folder))
        parts.append(_part(entry, folder))
    PAGE.write_text("\n".join(parts), encoding="utf-8")
    return missing


def _picture(name: str, folder: Path) -> Iterator[str]:
    """Write the picture of an experiment: its recording in the viewer, or a figure; yields what is missing."""
    target = PICTURES / f"{name}.webp"
    tries = 0 if os.environ.get("GALLERY_VIEWER", "on") == "off" else TRIES
    if not any(_screenshot(folder / "recording.rrd", target) for _ in range(tries)):
        yield f"{name}: no viewer showed it (no Vulkan, or a busy machine?), so a figure of the report is shown"
        figures = sorted((folder / "figures").glob("*.png"))
        if not figures:
            return
        chosen = folder / "figures" / f"{FIRST.get(name, 'tracking-error')}.png"
        _shrink(chosen if chosen.is_file() else figures[0], target)


def _shrink(source: Path, target: Path, part: Box = WHOLE) -> None:
    with Image.open(source) as picture:
        whole = picture.convert("RGB")
    if part == ARM:
        whole.paste(BACKGROUND, _pixels(TEXT_BELOW_ARM, whole.size))
    small = whole.crop(_pixels(part, whole.size))
    small.thumbnail((WIDTH, WIDTH), Image.Resampling.LANCZOS)
    small.save(target, "WEBP", quality=72, method=6)


def _pixels(part: Box, size: tuple[int, int]) -> tuple[int, int, int, int]:
    wide, high = size
    left, upper, right, lower = part
    return round(left * wide), round(upper * high), round(right * wide), round(lower * high)


def _screenshot(recording: Path, target: Path, seconds: float = 8.0) -> bool:
    """Write what a person sees who opens the recording; False where no viewer runs."""
    from rerun.experimental import ViewerClient

    port, path = 20_000 + os.getpid() % 10_000, str(Path(sys.executable).with_name("rerun"))
    try:
        with ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True, executable_path=path) as viewer:
            viewer.open(str(recording.resolve()))
            while viewer.get_state().loading:
                time.sleep(0.1)
            with suppress(ConnectionError, RuntimeError):  # what has no motion has no such time
                viewer.set_time("sim_time", duration=seconds)
            for _ in range(LOOKS):
                time.sleep(1.0)
                shown = viewer.take_screenshot()
            target.write_bytes(shown)
    except (RuntimeError, ConnectionError, TimeoutError, OSError):
        return False
    _shrink(target, target, FIGURES if target.stem.startswith("sheu-walker") else ARM)
    return True


def _part(entry: Shown, folder: Path) -> str:
    """Section of an experiment, in Markdown: its question and its outcome, its picture, its command."""
    outcome = outcome_of(folder / "report.html")
    shown = PICTURES / f"{entry.name}.webp"
    picture = f"![What {entry.name} shows](images/gallery/{entry.name}.webp)\n\n" if shown.is_file() else ""
    own = "" if entry.arguments == entry.name else f" --out results/{entry.name}"
    command = f"```console\nadaptctl experiment run {entry.arguments}{own}\n```\n"
    return f"## {entry.name}\n\n{picture}{entry.summary}.\n\n{outcome}\n\n{command}"


def outcome_of(report: Path) -> str:
    """Sentences of a report on what came out; none where there is no report."""
    if not report.is_file():
        return ""
    lead = re.search(r'<p class="lead">(.*?)</p>', report.read_text(encoding="utf-8"), re.DOTALL)
    return " ".join(unescape(lead[1]).split()) if lead else ""
