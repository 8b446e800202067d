"""Entry point of ``python -m deformnb``, which is the command ``deformnb``."""

import sys

from deformnb.cli.main import main

sys.exit(main())
