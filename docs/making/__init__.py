"""What `make gallery` and `make figures` make: pictures that move, the page of all experiments, that of invariants."""
