"""An identified robot made visible, and as files: robot, estimates, report, recording, validation."""
