from .napari_layers import from_napari as from_napari
from .napari_layers import to_napari as to_napari
from .pyvista_filters import warp_pyvista as warp_pyvista
from .sitk_transforms import to_sitk_transform as to_sitk_transform
from .skimage_maps import skimage_coordinates as skimage_coordinates
from .skimage_maps import skimage_map as skimage_map
