"""All that is about one paper: Belmonte et al. (2021), reproduced and judged.

The rest of the house does not know the paper. Here are its tests, its comparison of controllers
and the ledger of its claims, each with the proof or the run that decides it.
"""
