from .sources import LargeVolume as LargeVolume
from .sources import open_volume as open_volume
from .unpacking import unpack as unpack
from .warper import warp as warp
