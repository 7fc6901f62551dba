"""`make gallery`."""

import sys
from pathlib import Path

from docs.making.animation import write_animation
from docs.making.gallery import DOCS, make
from docs.making.null_directions import write_null_directions

write_animation(DOCS / "images" / "learning.webp")
write_null_directions(DOCS / "images" / "null-directions.svg")
for sentence in make(Path("results/gallery")):
    print(sentence, file=sys.stderr)
