"""Pictures of an arm colored by cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.design.added_mass import CostMap
from adaptctl.design.bodies import ball_radii
from adaptctl.design.driving import DrivenArm
from adaptctl.design.study import DesignStudy
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.recording.colors import BODY, INK, MUTED, Color, run_color
from adaptctl.recording.drawing import sheet, thinned
from adaptctl.recording.figures import AVERAGING_TIME
from adaptctl.recording.moving_average import moving_rms
from adaptctl.recording.page import Report
from adaptctl.recording.skeleton import Skeleton, Solid
from adaptctl.recording.wording import torque_error_unit

if TYPE_CHECKING:
    import rerun as rr
    from matplotlib.colors import Colormap, TwoSlopeNorm
    from matplotlib.figure import Figure

    from adaptctl.recording.stream import Curves

# Balls that a shape is drawn by.
BALLS_PER_SHAPE = 24
# Positions along each edge of a link's box.
GRID_POINTS = 5
COUNTERWEIGHT_COLOR = Color(240, 200, 40)
# Time in s of a swing where nothing was run, its positions, and the most positions of a run.
SWING_TIME, NUM_FRAMES, MAX_FRAMES = 6.0, 121, 600


def scale_of_costs() -> Colormap:
    """Color map of relative changes of cost."""
    from matplotlib.colors import LinearSegmentedColormap

    steps = [(0.0, run_color(0)), (0.5, BODY), (0.75, run_color(1)), (1.0, Color(160, 24, 24))]
    return LinearSegmentedColormap.from_list("cost", [(place, color.hex) for place, color in steps])


class Spots(NamedTuple):
    """Positions, ball radii, and relative changes of cost."""

    link: Array
    place: Array
    radius: Array
    change: Array


def spots(costs: CostMap, parts: Skeleton) -> Spots:
    """Positions along an arm with their changes of cost."""
    rows = []
    names = costs.task.mechanism.description.body_names
    for shape in parts.shapes:
        name = costs.task.mechanism.links[shape.link].name
        if shape.solid is Solid.JOINT or name not in names:
            continue
        places = shape.start + np.linspace(0.0, 1.0, BALLS_PER_SHAPE)[:, None] * (shape.end - shape.start)
        values = costs.at(name, places)
        rows += [(shape.link, *x, shape.radius, value) for x, value in zip(places.tolist(), values, strict=True)]
    table = np.array(rows)
    return Spots(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5])


def norm(study: DesignStudy, change: Array) -> TwoSlopeNorm:
    """Color scale with 0 in its middle."""
    from matplotlib.colors import TwoSlopeNorm

    low = min(*(cost.least for cost in study.links), float(change.min()), 0.0)
    high = max(float(change.max()), 0.0)
    least = 1e-3 * max(high, -low, 1e-9)
    return TwoSlopeNorm(0.0, min(low, -least), max(high, least))


def colors(change: Array, scale: TwoSlopeNorm) -> NDArray[np.uint8]:
    """Colors (n, 4) of relative changes."""
    return np.asarray(scale_of_costs()(scale(change), bytes=True), dtype=np.uint8)


def record(
    study: DesignStudy, runs: Sequence[DrivenArm], shown: Report, path: Path, figures: Mapping[str, Path]
) -> None:
    """Write the rerun recording of a design study, whole or not at all."""
    import rerun.blueprint as rrb

    from adaptctl.recording import views
    from adaptctl.recording.scene import WORLD, log_base
    from adaptctl.recording.skeleton import Viewpoint, floor_height, skeleton
    from adaptctl.recording.stream import log_curves, log_markdown, log_picture, saved_stream

    mechanism = study.task.mechanism
    parts, (time, p) = skeleton(mechanism), _moved(study, runs)
    label = f"Effect of {study.body.mass:g} kg: blue decreases, red increases the energy · yellow: counterweights"
    arm = views.arm(WORLD, label, Viewpoint.of(mechanism, parts, p))
    pictures = [views.picture(f"figures/{name}", name.capitalize()) for name in figures]
    right = rrb.Vertical(views.text("summary", "Summary"), *_beside(study, runs))
    layout = views.tabs(rrb.Horizontal(arm, right, name="Overview"), rrb.Grid(*pictures, name="Figures"))
    content = np.ascontiguousarray(np.concatenate([study.counterweights.parameters, p.ravel()])).tobytes()
    with saved_stream(path, shown, content, layout, mechanism) as recording:
        log_markdown(recording, "summary", shown.markdown())
        log_base(recording, mechanism, parts, floor_height(mechanism, parts, p))
        _log_costs(recording, study, parts, time, p)
        for name, picture in figures.items():
            log_picture(recording, f"figures/{name}", picture)
        log_curves(recording, _curves(runs))


def _beside(study: DesignStudy, runs: Sequence[DrivenArm]) -> list[Any]:
    from adaptctl.recording import views

    if not runs:
        return [views.picture("figures/components", "Energy error against the number of components")]
    error = f"Tracking error of all joints (RMS), log10 [{error_unit(study.task.mechanism)}]"
    torque = f"Torque of all joints (RMS over {AVERAGING_TIME:g} s, {torque_error_unit(study.task.mechanism)})"
    end = max(run.demand.duration for run in runs)
    return [views.curves("/error", error, end), views.curves("/torque", torque, end)]


def _curves(runs: Sequence[DrivenArm]) -> Iterator[Curves]:
    from adaptctl.recording.stream import Curves, in_decades

    for i, run in enumerate(runs):
        period = run.demand.duration / len(run.time)
        error, torque = (moving_rms(values, AVERAGING_TIME, period) for values in (run.error, run.applied))
        for name, values in (("error", in_decades(error)), ("torque", torque)):
            yield Curves(f"{name}/{run.name}", run.time, values, (run.label,), (run_color(i),), 2.0)


def _moved(study: DesignStudy, runs: Sequence[DrivenArm]) -> tuple[Array, Array]:
    """Times (T,) and positions (T, r) of the last run, or of swinging joints."""
    if runs:
        every = thinned(len(runs[-1].time), MAX_FRAMES)
        return runs[-1].time[every], runs[-1].p[every]
    mechanism = study.task.mechanism
    phase = np.linspace(0.0, 2.0 * np.pi, NUM_FRAMES)[:, None] * np.arange(1, mechanism.dof + 1).clip(max=3)
    swing = np.where([joint.kind.is_revolute for joint in mechanism.primary_joints], 0.25, 0.05)
    if mechanism.description.loops is not None:
        swing = swing * np.where(np.arange(mechanism.dof) == 0, 1.0, 0.5)
    return np.linspace(0.0, SWING_TIME, NUM_FRAMES), np.asarray(mechanism.neutral_configuration + swing * np.sin(phase))


def _log_costs(recording: rr.RecordingStream, study: DesignStudy, parts: Skeleton, time: Array, p: Array) -> None:
    import rerun as rr

    from adaptctl.recording.scene import WORLD, entity, log_poses

    mechanism, found = study.task.mechanism, spots(study.map, parts)
    scale, weights = norm(study, found.change), study.counterweights.weights
    log_poses(recording, "arm", mechanism, time, link_poses(mechanism, p))
    for i, link in enumerate(mechanism.links):
        if (own := found.link == i).any():
            shown = rr.Points3D(found.place[own], radii=found.radius[own], colors=colors(found.change[own], scale))
            recording.log(f"{WORLD}/arm/{entity(link.name)}/cost", shown, static=True)
    for places in study.bounds:
        grid = places.grid(GRID_POINTS)
        shades = colors(np.clip(study.map.at(places.link, grid), scale.vmin, scale.vmax), scale)
        small = rr.Points3D(grid, radii=[0.004], colors=shades)
        recording.log(f"{WORLD}/arm/{entity(places.link)}/room", small, static=True)
    for weight in weights:
        radius, label = ball_radii(weight.mass, weight.density), f"{weight.mass:.3g} kg"
        ball = rr.Points3D([weight.place], radii=[radius], colors=[COUNTERWEIGHT_COLOR], labels=[label])
        recording.log(f"{WORLD}/arm/{entity(weight.link)}/counterweight", ball, static=True)


def arm_figure(study: DesignStudy, parts: Skeleton, p: Array) -> Figure:
    """Figure of an arm from the side and from above."""
    found = spots(study.map, parts)
    world, scale = _in_world(study.task.mechanism, p, found.link, found.place), norm(study, found.change)
    figure = sheet(4.4)
    weights = study.counterweights.weights
    names = [link.name for link in study.task.mechanism.links]
    links = np.array([names.index(weight.link) for weight in weights], dtype=np.float64)
    balls = _in_world(study.task.mechanism, p, links, np.array([w.place for w in weights]).reshape(-1, 3))
    for axes, (i, j), title in zip(
        figure.subplots(1, 2), ((0, 2), (0, 1)), ("from the side", "from above"), strict=True
    ):
        order = np.argsort(world[:, 3 - i - j])
        colored = {"c": found.change[order], "cmap": scale_of_costs(), "norm": scale}
        axes.scatter(world[order, i], world[order, j], s=130.0, linewidths=0.0, **colored)
        axes.scatter(
            balls[:, i], balls[:, j], s=110.0, color=COUNTERWEIGHT_COLOR.hex, edgecolors=INK.hex, label="counterweight"
        )
        axes.set_aspect("equal", "datalim")
        axes.set(xlabel="x [m]", ylabel=f"{'xyz'[j]} [m]", title=title)
        if len(weights):
            axes.legend(loc="best")
    bar = figure.colorbar(axes.collections[0], ax=figure.axes, shrink=0.8, format="{x:+.0%}")
    bar.set_label(f"change of the energy due to {study.body.mass:g} kg", color=MUTED.hex)
    return figure


def _in_world(mechanism: Mechanism, p: Array, link: Array, place: Array) -> Array:
    poses, index = link_poses(mechanism, p), link.astype(np.int64)
    turned = np.einsum("nij,nj->ni", poses.rotations[index], place)
    return np.asarray(poses.translations[index] + turned)
