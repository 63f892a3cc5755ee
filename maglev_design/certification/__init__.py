"""Robustness that is proved, not sampled; every room is imported by its own name.

``intervals``
    the exact set of ratios beta_c/beta, and of gaps, for which the continuous loop is stable; the
    same enclosed for the sampled loop, with its largest period and delay
``lyapunov``
    a common quadratic Lyapunov function over gaps and ratios, by an LMI; checked in rational
    arithmetic, written, and checked again without the solver
``region``
    initial errors that the nonlinear, saturated loop is guaranteed to survive, and its map
``margins``
    gain, phase, delay, Ms, Mt and disk margins by python-control
``assessment``
    intervals and margins of one design, together
"""
