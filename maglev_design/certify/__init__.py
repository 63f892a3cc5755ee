"""Robustness that is proved, not sampled; each room is imported by its own name.

=================  ================================================================================
``assessment``     everything below on one design except Lyapunov functions and the region
``interval``       the exact set of ratios beta_c/beta, and of gaps, of the continuous loop
``sampled_*``      the same for the sampled loop, enclosed; its largest period and delay
``margins``        gain, phase, delay, Ms, Mt and disk margin by python-control
``lmi``            a common quadratic Lyapunov function over gaps and ratios, by an LMI
``exact``          the check of such a function in rational arithmetic; ``enclosure`` its vertices
``certificate``    the written certificate, and its check without solver and without CasADi
``region``         initial errors that the nonlinear, saturated loop is guaranteed to survive
``region_map``     the same plane by simulation
=================  ================================================================================
"""
