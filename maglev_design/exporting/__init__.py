"""A saved design as a controller that stands alone, in Python, C or MATLAB, and its check.

``export_folder`` prints; ``verify_folder`` prints again, compares byte for byte, builds what it
printed, runs it and holds it to the design that it came from.
"""

from maglev_design.exporting.folder import Export, export_folder
from maglev_design.exporting.verdict import Check, Verdict
from maglev_design.exporting.verify import verify_folder

__all__ = ["Check", "Export", "Verdict", "export_folder", "verify_folder"]
