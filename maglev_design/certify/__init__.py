"""What can be said of a finished design: margins and the region it is guaranteed to survive."""

from maglev_design.certify.margins import Margin, Margins, sampled_margins

__all__ = ["Margin", "Margins", "sampled_margins"]
