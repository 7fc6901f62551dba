"""Colors of recordings, figures and reports."""

from __future__ import annotations

from typing import NamedTuple


class Color(NamedTuple):
    """Color of red, green and blue, 0 to 255."""

    red: int
    green: int
    blue: int

    @property
    def hex(self) -> str:
        """Hexadecimal text of the color, such as "#1b6cd6"."""
        return f"#{self.red:02x}{self.green:02x}{self.blue:02x}"

    def faded(self, share: float, towards: Color) -> Color:
        """Mixture with another color, of which 1 gives the other."""
        return Color(*(round(mine + share * (other - mine)) for mine, other in zip(self, towards, strict=True)))


def _palette(colors: str) -> tuple[Color, ...]:
    return tuple(Color(*bytes.fromhex(color)) for color in colors.split())


# Text on paper, paper, the background of curves in a recording, and what is there for comparison only.
INK, PAPER, DARK, MUTED = _palette("1c2230 ffffff 0d0d0d 788192")
# Axes, their grid, and the texts of their ticks.
AXES, GRID, TICKS = (INK.faded(share, PAPER) for share in (0.65, 0.9, 0.3))
# The desired arm and its positions, paler than any joint's green; and limits of torques.
GOAL, LIMIT = _palette("96f0cd cdd0d6")
# Force on the arm, the arm's links, and fixed links.
FORCE, BODY, BASE = _palette("ffcd46 e2e6ee 606878")
# True values, where each has a picture of its own.
TRUTH = INK

# Colors of controllers: the adaptive one is blue, the same with adaptation off orange, others follow.
RUN_COLORS = _palette(
    "1b6cd6 e86e1c 189270 9654be 788192 c83e6e 8c6e32 3ca0be 7ab02a "
    "d6a414 604ebe ec82b4 147080 b02c24 82aae8 f69c7c 467c3e c46ede"
)
# Colors of joints, bright enough for a dark screen, dark enough for paper.
JOINT_COLORS = _palette("2d7deb f08228 28aa6e e14b5f 9b69e1 aa8737 23afc3 d75faf 8296b4 96be3c")


def run_color(index: int) -> Color:
    """Color of a run by its index: blue for the subject, orange without adaptation."""
    return RUN_COLORS[index % len(RUN_COLORS)]


def joint_color(index: int) -> Color:
    """Color of a joint by its index."""
    return JOINT_COLORS[index % len(JOINT_COLORS)]
