"""Animation of an arm that learns beside one that does not, from a real run."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
from PIL import Image, ImageDraw, ImageFont

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import SlotineLi
from adaptctl.envs.rendering import Renderer
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive

DURATION, FRAMES_A_SECOND = 6.0, 10
WIDTH, HEIGHT, CURVES = 380, 300, 92
"""pixels: of each arm's picture, and of the curves below"""
FONT = 20
"""pixels, of which a phone shows half"""
LEARNS, OFF, INK, PAPER = (27, 108, 214), (232, 110, 28), (28, 34, 48), (255, 255, 255)
TITLES = ("learning", "adaptation off")


def runs() -> tuple[adaptctl.Mechanism, tuple[adaptctl.Rollout, ...]]:
    """The PUMA 560, and its runs from zero estimates with adaptation and without."""
    settings = Puma560Adaptive(duration=DURATION)
    env = gymnasium.make("adaptctl.envs:adaptctl/Puma560Tracking-v0", duration=DURATION)
    arm = env.unwrapped.mechanism
    model = adaptctl.ReducedModel(arm)
    gains = (settings.bandwidth, np.array(settings.damping))
    learning, off = (
        adaptctl.rollout(env, SlotineLi(model, *gains, law), seed=0) for law in (adaptctl.adaptation_gain(model), None)
    )
    return arm, (learning, off)


def write_animation(path: Path) -> None:
    """Write the animation, as WebP that loops."""
    arm, both = runs()
    renderers = [Renderer(arm, WIDTH, HEIGHT) for _ in both]
    errors = [1e3 * np.sqrt(np.mean(run.error**2, axis=1)) for run in both]
    step = round(1.0 / FRAMES_A_SECOND / both[0].control_period)
    frames = [_frame(both, renderers, errors, k) for k in range(0, len(both[0].time), step)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=1000 // FRAMES_A_SECOND, loop=0, quality=45)


def _frame(runs: tuple[adaptctl.Rollout, ...], renderers: list[Renderer], errors: list[Array], k: int) -> Image.Image:
    frame = Image.new("RGB", (2 * WIDTH, HEIGHT + CURVES), PAPER)
    draw, font = ImageDraw.Draw(frame), ImageFont.load_default(FONT)
    for i, (run, renderer) in enumerate(zip(runs, renderers, strict=True)):
        picture = renderer.bare_image(run.p[k], run.reference_p[k])
        frame.paste(Image.fromarray(picture), (i * WIDTH, 0))
        color = (LEARNS, OFF)[i]
        text = f"{TITLES[i]}: {errors[i][k]:.1f} mrad"
        draw.text((i * WIDTH + 12, 6), text, fill=color, font=font)
    draw.text(
        (12, HEIGHT + 4),
        "RMS tracking error, 6 s, 0.1 to 100 mrad (logarithmic); green: reference",
        fill=INK,
        font=font,
    )
    for values, color in zip(errors, (LEARNS, OFF), strict=True):
        draw.line(_curve(values, k), fill=color, width=2)
    return frame


def _curve(values: Array, k: int) -> list[tuple[float, float]]:
    """Points of a curve until sample k, on a logarithmic scale of three decades from 0.1 mrad."""
    at = np.arange(0, k + 1, 20)
    heights = np.clip((np.log10(np.maximum(values[at], 1e-9)) + 1.0) / 3.0, 0.0, 1.0)
    rows = HEIGHT + CURVES - 6 - heights * (CURVES - 40)
    points = [(12 + (2 * WIDTH - 24) * float(i) / len(values), float(y)) for i, y in zip(at, rows, strict=True)]
    return points if len(points) > 1 else points * 2
