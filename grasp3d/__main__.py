"""The command line as `python -m grasp3d`, for environments whose scripts are not found by name."""

import sys

from grasp3d.cli import main

if __name__ == "__main__":
    sys.exit(main())
