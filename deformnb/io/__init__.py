"""Volume files: reading that trusts no header, writing that is complete or not done at all."""

from deformnb.io.atomic import atomic_write
from deformnb.io.formats import FORMATS, FileDescription, Format, describe_file, read_volume, write_volume
from deformnb.io.memory import available_memory, required_bytes

__all__ = [
    "FORMATS",
    "FileDescription",
    "Format",
    "atomic_write",
    "available_memory",
    "describe_file",
    "read_volume",
    "required_bytes",
    "write_volume",
]
