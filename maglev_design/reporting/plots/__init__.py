"""Every figure of the package, in the one style of :mod:`maglev_design.reporting.plots.style`."""
