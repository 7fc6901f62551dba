"""The recursion over links: motion, energy, forces, inertia, and what follows from them."""
