"""Many runs of an experiment: what is varied, where it runs, and what is kept."""
