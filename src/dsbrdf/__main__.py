"""`python -m dsbrdf`: the command line."""

import sys

from dsbrdf.cli import main

if __name__ == "__main__":
    sys.exit(main())
