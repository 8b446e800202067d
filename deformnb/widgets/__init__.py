"""Widgets for notebooks: each is an anywidget whose front end is a bundled ES module.

They load on first use, so that ``import deformnb`` and the command line never pay for them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
