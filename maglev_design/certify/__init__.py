"""Robustness that is proved: margins, and Lyapunov functions checked in exact arithmetic."""

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
