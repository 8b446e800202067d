"""Session of one user with one volume: edits, undo, autosave, recovery, exports, batch replay."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
