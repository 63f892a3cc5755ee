"""What can be said about a controller's robustness with proof: intervals and margins."""

from __future__ import annotations

from maglev_design.certify.assessment import Assessment, Subject, assess, subject
from maglev_design.certify.interval import exact_loop, gaps_at, ratios_at, ratios_over
from maglev_design.certify.margins import Margin, Margins, sampled_margins
from maglev_design.certify.sampled_interval import sampled_ratios_at
from maglev_design.certify.sampled_limits import Limit, largest_delay, largest_period
from maglev_design.certify.sampled_path import proved_over, sampled_ratios_over
from maglev_design.certify.spans import End, Span, StableSet

__all__ = [
    "Assessment",
    "End",
    "Limit",
    "Margin",
    "Margins",
    "Span",
    "StableSet",
    "Subject",
    "assess",
    "exact_loop",
    "gaps_at",
    "largest_delay",
    "largest_period",
    "proved_over",
    "ratios_at",
    "ratios_over",
    "sampled_margins",
    "sampled_ratios_at",
    "sampled_ratios_over",
    "subject",
]
