"""The initial errors that the nonlinear, saturated loop survives: proved, and simulated."""
