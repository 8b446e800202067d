"""Visible words in other languages than English: a table for each, and what translates by it.

The English words are in the sources, of Python and of the front ends. ``de.json`` maps them to German, and another file
next to it, named by the code of its language, is another language. Another package adds its words by
:func:`add_tables`. A notebook shows errors in the language too, where the
table has their text.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
