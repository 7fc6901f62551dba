"""Writers of mechanisms: our own TOML, and URDF whose inertials alone are new."""
