"""Moving picture of null directions: two arms that differ and move alike, and one that differs as much and does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.files import write_text
from adaptctl.recording.colors import INK, MUTED, PAPER, run_color

ROBOT = "two_link"
PERIOD, DURATION, FRAMES, STILL = 1e-3, 6.0, 72, 44
"""s of a torque and of the picture, how many poses of it are kept, and which of them is shown where nothing may move"""
HANGING, SWING, TURNS = np.array([-np.pi / 2, 0.0]), np.array([0.7, 0.9]), np.array([2, 3])
"""rad, rad, and how often each joint swings in the picture"""
PANEL, HEIGHT, BASE, METRE = 240, 320, 112, 225.0
"""pixels: width and height of an arm's part, of its first joint from above, and of a metre"""


@dataclass(frozen=True)
class Link:
    """A slender body in the plane: mass in kg, centre in m from its joint, inertia about it in kg m^2."""

    mass: float
    center: float
    inertia: float

    @property
    def at_joint(self) -> tuple[float, float]:
        """First moment and inertia about the joint."""
        return self.mass * self.center, self.inertia + self.mass * self.center**2

    @classmethod
    def with_moments(cls, mass: float, first: float, second: float) -> Link:
        """Link of that mass with these moments about its joint."""
        return cls(mass, first / mass, second - first**2 / mass)

    def parameters(self, length: float) -> list[float]:
        """Its ten inertial parameters in a frame at the far end."""
        x, thin = self.center - length, 0.1 * self.inertia
        across = self.inertia + self.mass * x**2
        return [self.mass, self.mass * x, 0.0, 0.0, thin, 0.0, across, 0.0, 0.0, across]


def arms(lengths: Sequence[float]) -> dict[str, tuple[Link, Link]]:
    """An arm, one along a null direction of it, and one of the same masses as that whose rods are uniform."""
    upper, lower = Link(2.0, 0.2, 0.028), Link(1.2, 0.15, 0.01)
    heavy = Link.with_moments(1.7, *lower.at_joint)
    first, second = upper.at_joint
    more = heavy.mass - lower.mass  # the forearm's mass hangs on the upper arm's end
    other = Link.with_moments(4.0, first - lengths[0] * more, second - lengths[0] ** 2 * more)
    rods = tuple(Link(b.mass, a / 2, b.mass * a**2 / 12) for a, b in zip(lengths, (other, heavy), strict=True))
    return {"an arm": (upper, lower), "along a null direction": (other, heavy), "as heavy, not along one": rods}


def motions() -> tuple[dict[str, tuple[Link, Link]], dict[str, Array], Sequence[float]]:
    """Arms, and positions (samples, 2) of each under the torques that move the first one to and fro."""
    arm = adaptctl.load(ROBOT)
    lengths = [0.4, 0.3]
    links = arms(lengths)
    built = {
        name: arm.with_parameters(np.concatenate([link.parameters(a) for link, a in zip(pair, lengths, strict=True)]))
        for name, pair in links.items()
    }
    if any(one.description.inconsistent_links for one in built.values()):
        raise ValueError("no body has these links")
    rate = 2.0 * np.pi * TURNS / DURATION
    phase = np.arange(0.0, DURATION, PERIOD)[:, None] * rate
    first = next(iter(built.values()))
    torque = first.inverse_dynamics(
        HANGING + SWING * np.sin(phase), SWING * rate * np.cos(phase), -SWING * rate**2 * np.sin(phase)
    )
    return links, {name: _driven(one, torque, SWING * rate) for name, one in built.items()}, lengths


def _driven(arm: adaptctl.Mechanism, torque: Array, v: Array) -> Array:
    plant = adaptctl.Plant(arm, PERIOD)
    states = [plant.init(HANGING, v)]
    for one in torque:
        states.append(plant.step(states[-1], one))
    return np.array([state.p for state in states])


def write_null_directions(path: Path) -> dict[str, float]:
    """Write the picture as SVG that moves by CSS; returns how far each arm is from the first at most, rad."""
    links, p, lengths = motions()
    first = next(iter(p.values()))
    apart = {name: float(np.abs(one - first).max()) for name, one in p.items()}
    styles, parts = [], []
    for k, name in enumerate(p):
        poses = np.degrees(-p[name][np.linspace(0, len(first) - 1, FRAMES + 1).astype(int)])
        styles += [_keyframes(f"j{k}{j}", poses[:, j]) for j in range(2)]
        parts.append(_panel(k, name, links[name], lengths, poses[STILL], apart[name]))
    write_text(path, _page("\n".join(styles), "\n".join(parts), len(p) * PANEL))
    return apart


def _keyframes(name: str, degrees: Array) -> str:
    steps = "".join(f"{100 * k / FRAMES:.4g}%{{transform:rotate({x:.1f}deg)}}" for k, x in enumerate(degrees))
    return f"@keyframes {name}{{{steps}}}\n.{name}{{animation:{name} {DURATION:g}s linear infinite}}"


def _panel(k: int, name: str, links: Sequence[Link], lengths: Sequence[float], still: Array, apart: float) -> str:
    """An arm, its links as bars, its masses as discs of their size at their centres."""
    color = run_color(k).hex
    inner = ""
    for j in (1, 0):
        length, link = METRE * lengths[j], links[j]
        body = (
            f'<rect x="-5" y="-5" width="{length + 10:.0f}" height="10" rx="5" fill="{color}" fill-opacity=".35"/>'
            f'<circle cx="{METRE * link.center:.1f}" cy="0" r="{9 * np.sqrt(link.mass):.1f}" fill="{color}"/>'
        )
        inner = f'<g class="j{k}{j}" transform="rotate({still[j]:.1f})">{body}{_at(length, inner)}<circle r="3"/></g>'
    far = f"{apart:.0e}" if apart < 1e-6 else f"{apart:.1f}"
    said = f"{far} rad apart at most" if k else "torques made for this one"
    masses = " and ".join(f"{link.mass:g}" for link in links)
    lines = (name, f"{masses} kg", said)
    text = "".join(
        f'<text x="{PANEL // 2}" y="{y}">{line}</text>' for y, line in zip((24, 42, HEIGHT - 12), lines, strict=True)
    )
    return f'<g transform="translate({k * PANEL})">{text}<g transform="translate({PANEL // 2} {BASE})">{inner}</g></g>'


def _at(length: float, inner: str) -> str:
    return f'<g transform="translate({length:.0f})">{inner}</g>' if inner else ""


def _page(styles: str, parts: str, width: int) -> str:
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" role="img">
<title>Three arms under the same torques: two that differ along a null direction move alike, the third does not</title>
<style>
text{{font:14px sans-serif;fill:{INK.hex};text-anchor:middle}}
{styles}
@media (prefers-reduced-motion:reduce),print{{g{{animation:none!important}}}}
</style>
<rect width="{width}" height="{HEIGHT}" rx="8" fill="{PAPER.hex}"/>
<path d="M0 {BASE - 60}h{width}" stroke="{MUTED.hex}" stroke-opacity=".3"/>
{parts}
</svg>
"""
