"""Gallery page: every experiment with a picture, its command, and what came out of it."""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from html import unescape
from io import BytesIO
from pathlib import Path
from subprocess import DEVNULL, Popen, run
from typing import NamedTuple, TypeAlias

from PIL import Image

from adaptctl.experiments import EXPERIMENTS
from adaptctl.hardware.udp_plant import LOOPBACK

DOCS = Path(__file__).resolve().parent.parent
PICTURES, PAGE = DOCS / "images" / "gallery", DOCS / "gallery.md"
WINDOW = (1560, 878)
"""pixels of the viewer's window, in which a figure has room for its title, and whose text is legible in half a page"""
TRIES = 3
"""of a viewer, which on a busy machine may not answer in time"""
LOOKS = 6
"""Of a viewer, a second apart: what it says of itself when it opens goes away while it is looked at."""
FIGURES = {"sheu-walker-1991": "figure-3", "sheu-walker-1991-arms": "tip-error"}
"""figure of an experiment whose recording has no arm"""
OPENING = 3.0
"""s in which a viewer opens"""
COLUMNS = 80


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

The pictures are of recordings, 8 s after the start: the learning arm, with the reference as a green ghost and the arm
without adaptation as an orange one; and the errors of its joints. `rerun results/NAME/recording.rrd` shows the whole
recording.
"""
Box: TypeAlias = tuple[float, float, float, float]
ARM, ERRORS = (0.0, 0.114, 0.4165, 0.54), (0.4175, 0.075, 0.708, 0.372)
"""shares of the viewer's window, left, upper, right and lower: the arm, and the errors of its joints"""


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
    """Write the pictures of an experiment: its recording in the viewer, or a figure; yields what is missing."""
    target = PICTURES / f"{name}.webp"
    if shows_arm(name):
        tries = 0 if os.environ.get("GALLERY_VIEWER", "on") == "off" else TRIES
        if not any(_screenshot(folder / "recording.rrd", target) for _ in range(tries)):
            yield f"{name}: no viewer showed it (no Vulkan, or a busy machine?)"
        return
    figure = folder / "figures" / f"{FIGURES[name]}.png"
    if figure.is_file():
        shutil.copy(figure, target.with_suffix(".png"))


def shows_arm(name: str) -> bool:
    """True for an experiment that is shown by its arm and the errors of its joints."""
    return name not in FIGURES


def _part_of(picture: Image.Image, part: Box) -> Image.Image:
    wide, high = picture.size
    left, upper, right, lower = part
    return picture.crop((round(left * wide), round(upper * high), round(right * wide), round(lower * high)))


def _screenshot(recording: Path, target: Path, seconds: float = 8.0) -> bool:
    """Write the arm and the errors that a person sees who opens the recording; False where no viewer runs."""
    import rerun_cli
    from rerun.experimental import ViewerClient

    port, program = str(20_000 + os.getpid() % 10_000), str(Path(rerun_cli.__file__).with_name("rerun"))
    size = "x".join(map(str, WINDOW))
    command = [program, "--headless", "--hide-welcome-screen", "--window-size", size, "--port", port]
    with Popen(command, stdout=DEVNULL, stderr=DEVNULL) as process:
        try:
            time.sleep(OPENING)
            viewer = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            viewer.open(str(recording.resolve()))
            while viewer.get_state().loading:
                time.sleep(0.1)
            for _ in range(LOOKS):
                time.sleep(1.0)
                with suppress(ConnectionError, RuntimeError):  # what has no motion has no such time
                    viewer.set_time("sim_time", duration=seconds)
                shown = viewer.take_screenshot()
        except (RuntimeError, ConnectionError, TimeoutError, OSError):
            return False
        finally:
            process.terminate()
    with Image.open(BytesIO(shown)) as picture:
        whole = picture.convert("RGB")
    errors = _part_of(whole, ERRORS)
    arm = _part_of(whole, ARM).resize(errors.size, Image.Resampling.LANCZOS)
    for picture, place in ((arm, target), (errors, target.with_stem(f"{target.stem}-errors"))):
        picture.save(place, "WEBP", quality=72, method=6)
    return True


def _part(entry: Shown, folder: Path) -> str:
    """Section of an experiment, in Markdown: its question and its outcome, its picture, its command."""
    outcome = outcome_of(folder / "report.html")
    pictures = "\n".join(
        f"![{words} {entry.name}](images/gallery/{file})" for file, words in pictures_of(entry.name).items()
    )
    return f"## {entry.name}\n\n{pictures}\n\n{entry.summary}.\n\n{outcome}\n\n```console\n{command_of(entry)}\n```\n"


def pictures_of(name: str) -> dict[str, str]:
    """Words on the pictures of an experiment, by their files."""
    if not shows_arm(name):
        return {f"{name}.png": "Figure of"}
    return {f"{name}.webp": "Arm in", f"{name}-errors.webp": "Errors in"}


def command_of(entry: Shown) -> str:
    """Command of an experiment, in lines of at most 80 columns."""
    own = "" if entry.arguments == entry.name else f"--out results/{entry.name}"
    whole = f"adaptctl experiment run {entry.arguments} {own}".strip()
    return whole if len(whole) <= COLUMNS else f"adaptctl experiment run {entry.arguments} \\\n    {own}"


def outcome_of(report: Path) -> str:
    """Sentences of a report on what came out; none where there is no report."""
    if not report.is_file():
        return ""
    lead = re.search(r'<p class="lead">(.*?)</p>', report.read_text(encoding="utf-8"), re.DOTALL)
    return " ".join(unescape(lead[1]).split()) if lead else ""
