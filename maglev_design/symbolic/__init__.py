"""The only statement of the physics and of the control laws: expressions in, expressions out.

No number of any rig and no input or output stands in this package. The letters are the paper's;
the table of symbols is in :mod:`maglev_design.symbolic.plant`.
"""
