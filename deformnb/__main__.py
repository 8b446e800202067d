"""Entry point of ``python -m deformnb``, which is the command ``deformnb``."""

import sys

from deformnb.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
