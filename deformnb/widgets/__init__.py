"""Widgets for notebooks: each is an anywidget whose browser side is plain text files, without a build step.

They load on first use, so that ``import deformnb`` and the command line never pay for them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
