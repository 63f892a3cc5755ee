"""One quadratic Lyapunov function for a family of loops: found by a solver, proved without it."""
