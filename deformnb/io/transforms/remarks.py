"""Remarks in the headers of transform files: which way the map in them goes."""

from __future__ import annotations

import gzip
import re
import zlib
from pathlib import Path

from deformnb.io.files.errors import printable

BACKWARD = "backward: from places of the result to places of the input, LPS"
FORWARD = "forward: from places of the input to places of the result, LPS"
REMARKS = {"backward": BACKWARD, "forward": FORWARD}
"""Remarks by the direction of the map."""

_START = 1 << 14  # bytes that contain the header of each format, or the remark
_STATED = re.compile(rb"\b(?:backward|forward): from places of the [^\r\n\0\"<]{0,200}")


def read_remark(path: Path) -> str:
    r"""The remark on the map in a transform file that was written here; empty for any other file.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "there.tfm"
    >>> _ = file.write_text(f"#Insight Transform File V1.0\n# {FORWARD}\n")
    >>> read_remark(file).partition(":")[0]
    'forward'
    """
    header = path / "zarr.json" if path.is_dir() else path
    if not header.is_file():  # a pipe would block for ever
        return ""
    try:
        with gzip.open(header) if header.name.lower().endswith(".gz") else header.open("rb") as file:
            found = _STATED.search(file.read(_START))
    except (OSError, EOFError, zlib.error):
        return ""
    return printable(found[0].decode("ascii", "replace").strip().removesuffix("-->").strip(), 200) if found else ""
