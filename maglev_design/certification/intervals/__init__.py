"""The ratios, gaps, periods and delays for which the linear loop is stable: exact or enclosed."""
