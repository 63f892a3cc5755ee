"""Published numbers, each with the place it was printed in; no other test file quotes any."""

from __future__ import annotations

BETA = 0.00136884
"""beta = K C^2/m. Belmonte et al., Mathematics 9 (2021) 1424, eq. (26)."""
EQUILIBRIUM_VOLTAGE = 2.0825
"""U [V] at Y = 0.0246 m. Same, sec. 4."""
EQUILIBRIUM_GAP = 0.0246
"""Y [m]. Same, sec. 4."""

BEZIER_COEFFICIENTS = (12870, 91520, 288288, 524160, 600600, 443520, 205920, 54912, 6435)
"""r_1, ..., r_9 of the reference path. Same, eq. (29)."""

POLES = (1.0, 70.0)
"""zeta_d and omega_nd. Same, sec. 4."""
GAINS = (24_010_000.0, 1_372_000.0, 29_400.0, 280.0)
"""k_0, ..., k_3 at these poles: (s + 70)^4 by hand. Same, eq. (25)."""

NOMINAL = {"ise": 1.71888e-09, "iae": 1.0681e-05, "itae": 8.191e-07}
"""[m^2 s, m s, m s^2] Continuous TAN-GPI on its own rig at POLES, true error over 7 s.

Found beforehand by independent integration (SciPy LSODA and CasADi cvodes agree in these digits).
"""
NOMINAL_DIGITS = {"ise": 6, "iae": 5, "itae": 4}
"""Significant digits of NOMINAL."""

WORST_ITAE = {"model": 3.1e-5, "appendix-a": 9.8e-7, "measured": 9.3e-7}
"""[m s^2] Worst sampled ITAE at POLES over beta_c/beta in [0.85, 1.15], by reading.

Found beforehand. Two digits; ``appendix-a`` with forward Euler, ``measured`` with Tustin.
"""
WORST_METHOD = {"model": "tustin", "appendix-a": "euler", "measured": "tustin"}
"""Discretisation for which each of WORST_ITAE is met."""

APPENDIX_A_BOUND = 1 / 5
"""mu = beta/beta_c must be larger, at zeta = 1 with U measured. Same, App. A, corrected.

1/(4 zeta^2 + 1); the paper prints 1/2.63, which does not follow from its (A7).
"""

PCG4D_MULTIPLIER, PCG4D_INCREMENT = 1664525, 1013904223
"""Jarzynski and Olano, J. Computer Graphics Techniques 9(3), 2020, listing of pcg4d."""
