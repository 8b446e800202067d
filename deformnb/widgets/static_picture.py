"""The picture that a widget leaves in a notebook, for GitHub, nbviewer and PDF, where no front end runs."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

_LOG = logging.getLogger(__name__)


def with_png(bundle: Any, draw: Callable[[], bytes]) -> Any:
    """A widget's bundle of mime types with a PNG added; without it where it cannot be drawn.

    Parameters
    ----------
    bundle : of ``_repr_mimebundle_``, alone or with metadata.
    draw : makes the PNG. What goes wrong is logged: a picture for later readers must not keep the widget from being
        shown now.
    """
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    if data is None:
        return bundle
    try:
        data["image/png"] = draw()
    except Exception:
        _LOG.exception("the static picture of a widget could not be drawn")
    return bundle
