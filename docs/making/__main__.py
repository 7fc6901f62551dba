"""`make gallery`."""

import sys
from pathlib import Path

from docs.making.animation import write_animation
from docs.making.gallery import DOCS, make

write_animation(DOCS / "images" / "learning.webp")
for sentence in make(Path("results/gallery")):
    print(sentence, file=sys.stderr)
