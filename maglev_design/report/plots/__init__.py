"""Every figure of the package, in the one style of :mod:`maglev_design.report.plots.style`."""
