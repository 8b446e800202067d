from .control_points import ControlPoints as ControlPoints
from .deformation import Deformation as Deformation
from .deformation import Step as Step
from .errors import DeformError as DeformError
from .extrusion import EXTRUSIONS as EXTRUSIONS
from .extrusion import Extrusion as Extrusion
from .extrusion import extrude as extrude
from .extrusion import interpolate as interpolate
from .extrusion import modulate as modulate
from .extrusion import replicate as replicate
from .fields import AbstractField as AbstractField
from .fields import DisplacementField as DisplacementField
from .fields import compose as compose
from .kernels import KERNELS as KERNELS
from .plane import VIEWS as VIEWS
from .plane import Plane as Plane
from .plane import Raster as Raster
from .rbf import RBFInterpolant as RBFInterpolant
from .rbf import fit_rbf as fit_rbf
from .trend import TRENDS as TRENDS
from .volume import Grid as Grid
from .volume import Volume as Volume

__version__: str
