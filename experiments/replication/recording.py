"""Recording of the replication for rerun: both arms along the stated sinusoids, the verdicts, the figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.experiments.replication.result import Replication
from adaptctl.experiments.replication.verdict import Item, Scene
from adaptctl.experiments.replication.wording import facts, headline
from adaptctl.recording import views
from adaptctl.recording.palette import MUTED, Color, run_color
from adaptctl.recording.scene import WORLD, entity, log_arm, log_base, solid_look
from adaptctl.recording.series import Style, log_series
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.stream import log_markdown, log_picture, saved_stream
from adaptctl.recording.viewpoint import Viewpoint

CURVES = (Color(235, 238, 245), MUTED, run_color(2), run_color(1))
"""The actual torque, and those of more and more components."""
WIDTHS = (4.0, 1.2, 1.5, 1.5)


def write_recording(path: str | Path, replication: Replication, figures: Mapping[str, Path]) -> None:
    """Write the recording of a `replication` of Sheu and Walker (1991) for the rerun viewer, a file .rrd at `path`:
    both arms along their sinusoids, verdicts, and `figures`, PNG files by name. The file is written whole or not at
    all; nothing is returned. Raises `FileError` where it cannot be written."""
    scenes = [item.scene for item in replication.items if item.scene is not None]
    content = ",".join((str(replication.study.seeds), *(item.name for item in replication.items))).encode()
    with saved_stream(path, replication, content, _layout(scenes, figures)) as recording:
        log_markdown(recording, "verdicts", verdicts_markdown(replication))
        log_markdown(recording, "evidence", evidence_markdown(replication.items))
        for scene in scenes:
            _log_scene(recording, scene)
        for name, file in figures.items():
            log_picture(recording, f"figure/{name}", file)


def verdicts_markdown(replication: Replication) -> str:
    """Markdown text of the outcome of a `replication` of Sheu and Walker (1991), its facts as a table, and the verdict
    on every item (table, figure or section of the paper). Nothing is checked."""
    answers = "\n".join(f"| {question} | **{answer}** |" for question, answer, _ in facts(replication))
    verdicts = "\n".join(f"- **{item.label}**, {item.verdict.value}: {item.summary}" for item in replication.items)
    return f"{headline(replication)}\n\n| | |\n|---|---|\n{answers}\n\n{verdicts}\n"


def evidence_markdown(items: Sequence[Item]) -> str:
    """Markdown text of the judged claims and the evidence of every one of the `items` (tables, figures and sections of
    the paper) that has some; where no item has any, a sentence that says so. Nothing is checked."""
    parts = []
    for item in items:
        claims = [f"- “{claim.saying.quote}”: **{claim.verdict.value}**. {claim.found}." for claim in item.claims]
        lines = [*claims, *(f"- {one}" for one in item.evidence)]
        if lines:
            parts.append("\n".join([f"## {item.label}", *lines]))
    return "\n\n".join(parts) or "Nothing was asked for that has evidence."


def _log_scene(recording: rr.RecordingStream, scene: Scene) -> None:
    parts, name = skeleton(scene.mechanism), entity(scene.label)
    viewpoint = Viewpoint.of(scene.mechanism, parts, scene.p)
    log_base(recording, scene.mechanism, parts, viewpoint.floor, f"{name}/base")
    log_arm(recording, name, scene.mechanism, parts, scene.time, scene.p, solid_look(run_color(0)))
    for j, joint in enumerate(scene.mechanism.primary_joints):
        for i, (key, torque) in enumerate(scene.torques.items()):
            style = Style((key,), (CURVES[i],), WIDTHS[i])
            path = f"torque/{name}/{entity(joint.name)}/{entity(key)}"
            log_series(recording, path, scene.time, torque[:, j : j + 1], style)


def _layout(scenes: Sequence[Scene], figures: Mapping[str, Path]) -> rrb.Blueprint:
    first = rrb.Horizontal(
        views.text("verdicts", "Verdicts"), views.text("evidence", "Claims and evidence"), name="Verdicts"
    )
    return views.tabs(*_pictures(figures), *(_arm_tab(scene) for scene in scenes), first)


def _arm_tab(scene: Scene) -> rrb.Container:
    name = entity(scene.label)
    viewpoint = Viewpoint.of(scene.mechanism, skeleton(scene.mechanism), scene.p)
    joints = [
        views.curves(
            f"/torque/{name}/{entity(joint.name)}",
            f"{joint.name}: torque [N·m], actual and of components",
            float(scene.time[-1]),
        )
        for joint in scene.mechanism.primary_joints
    ]
    arm = views.arm(f"{WORLD}/{name}", f"{scene.label} along the stated sinusoid", viewpoint)
    grid = rrb.Grid(*joints, grid_columns=int(np.ceil(len(joints) / 3)))
    return rrb.Horizontal(arm, grid, column_shares=[4, 7], name=scene.label)


def _pictures(figures: Mapping[str, Path]) -> list[rrb.Container]:
    if not figures:
        return []
    shown = [views.picture(f"figure/{name}", name.replace("-", " ").capitalize()) for name in figures]
    return [rrb.Grid(*shown, grid_columns=min(len(shown), 3), name="Figures")]
