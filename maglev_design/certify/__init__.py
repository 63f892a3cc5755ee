"""Robustness that is proved: margins, and Lyapunov functions checked in exact arithmetic."""

from maglev_design.certify.margins import Margin, Margins, sampled_margins

__all__ = ["Margin", "Margins", "sampled_margins"]
