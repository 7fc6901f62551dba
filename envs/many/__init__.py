"""Many arms in one vector environment."""
