"""Colour maps of grey pictures: grey, and perceptually uniform maps.

The perceptual maps are those of Matplotlib: viridis, magma and inferno by S. van der Walt and N. Smith (public domain,
CC0); cividis by J. R. Nunez, C. R. Anderton and R. S. Renslow, "Optimizing colormaps with consideration for color
vision deficiency", PLoS ONE 13 (2018); and bone, a grey with a tinge of blue. Each is held at every fifth of its 256
colours, with straight lines between them: off by at most 4 of 255, where cividis has a corner.
"""

from __future__ import annotations

from functools import cache
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import check_choice

_STEP = 5  # of 255
_KNOTS = {
    "viridis": (
        "44015446085c471063481769481d6f482475472a7a46307e453781433d844142873f48893d4e8a3a538b38598c355e8d33638d31"
        "688e2e6d8e2c718e2a768e297b8e27808e25848e23898e218e8d20928c1f978b1e9c891fa18821a58524aa8328ae802eb37c35b7"
        "793dbc7446c06f50c46a5ac86465cb5e70cf577cd25089d54895d840a2da37b0dd2fbddf26cae11fd8e219e5e419f1e51dfde725"
    ),
    "magma": (
        "00000402020b0504160907200e0b2b140e361a104221114e29115a311165390f6e420f754a107952137c5a167e6219806a1c8172"
        "1f81792282812581892881912b81992d80a1307eaa337db2357bba3878c23b75ca3e72d2426fd9466be04c67e75263ec5860f160"
        "5df4695cf7725cf97b5dfb8560fc8e64fd9869fea16efeaa74feb47bfebd82fec68afecf92fed89afde2a3fdebacfcf4b6fcfdbf"
    ),
    "inferno": (
        "00000402020c0504170a072210092d160b391e0c45260c512f0a5b380962400a67490b6a510e6c59106e61136e69166e71196e78"
        "1c6d801f6c88226a902568982766a02a63a82e5fb0315bb73557bf3952c63d4dcc4248d34743d94d3ddf5337e45a31e9612bed69"
        "25f1711ff47918f78212f98b0bfa9407fb9d07fca60cfcb014fbba1ffac42af8cd37f6d746f4e156f2ea69f2f27df5f992fcffa4"
    ),
    "cividis": (
        "00224e002656002a5f002d68003070083370163770203a6f273e6e2e416d34456c3a486c3f4c6c444f6c49536c4e566c535a6d57"
        "5d6d5c616e60646f656870696b716d6f727272747676767a7a787e7d788381798885788d8878928c789690779b9476a09875a59c"
        "74aaa073afa471b5a86fbaac6dbfb06bc4b468c9b965cfbd62d4c15fdac65bdfca57e5cf52ead34cf0d846f6dd3ffce236fee838"
    ),
    "bone": (
        "00000004040609090c0d0d1212111816161e1a1a251f1f2b2323312727372c2c3d30304334344939394f3d3d5542425b4646614a"
        "4a674f4f6e535473575a775c607c606680656c846972896d788d727e927684967a8a9a7f909f8396a3889ca78ca2ac90a8b095ae"
        "b599b4b99dbabda2c0c2a6c6c6adcacab4cfcfbbd3d3c1d8d8c8dcdccfe0e0d6e5e5dde9e9e4eeedeaf2f2f1f6f6f8fbfbffffff"
    ),
}

ColourMapName: TypeAlias = Literal["grey", "viridis", "magma", "inferno", "cividis", "bone"]
"""Names of the colour maps."""

COLOUR_MAPS: tuple[ColourMapName, ...] = get_args(ColourMapName)
"""Colour maps by name; the first is the default."""


@cache
def colour_table(name: str) -> NDArray[np.uint8]:
    """The colours of a map from black to white of a window, (256, 3).

    Raises
    ------
    DeformError
        For a name that is not in :data:`COLOUR_MAPS`.

    Examples
    --------
    >>> colour_table("viridis")[[0, 255]].tolist()
    [[68, 1, 84], [253, 231, 37]]
    """
    values = np.arange(256)
    if check_choice(name, COLOUR_MAPS, "colour map") == "grey":
        made = np.repeat(values[:, None], 3, axis=1).astype(np.uint8)
    else:
        knots = np.frombuffer(bytes.fromhex(_KNOTS[name]), np.uint8).reshape(-1, 3)
        between = np.stack([np.interp(values, values[::_STEP], channel) for channel in knots.T], axis=1)
        made = between.round().astype(np.uint8)
    made.flags.writeable = False
    return made
