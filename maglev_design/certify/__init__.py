"""Robustness that is proved, not sampled.

Margins by python-control, Lyapunov functions checked in exact arithmetic; in modules of their own,
asked for by name because they load more: the exact interval of the ratio and the region of initial
errors that the nonlinear loop survives.
"""

from maglev_design.certify.certificate import CheckResult, check, write
from maglev_design.certify.lmi import (
    LmiCertificate,
    LmiStatus,
    certify_family,
    certify_sampled,
    widest_sampled,
)
from maglev_design.certify.margins import Margin, Margins, sampled_margins

__all__ = [
    "CheckResult",
    "LmiCertificate",
    "LmiStatus",
    "Margin",
    "Margins",
    "certify_family",
    "certify_sampled",
    "check",
    "sampled_margins",
    "widest_sampled",
    "write",
]
