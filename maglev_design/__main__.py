"""``python -m maglev_design``."""

from maglev_design.cli import main

if __name__ == "__main__":
    main()
