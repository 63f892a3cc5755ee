"""How fast, against what, and how exact: ``python tests/benchmarks -o reports``."""
