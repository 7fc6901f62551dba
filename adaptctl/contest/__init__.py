"""Contest of laws: laws, robots, conditions and seeds, from a TOML file to tables, figures and a page."""
