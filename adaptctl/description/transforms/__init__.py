"""From one description to another: joined, snapped to right angles, on a floating base."""
