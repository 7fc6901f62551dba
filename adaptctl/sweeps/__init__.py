"""Many runs of an experiment."""
