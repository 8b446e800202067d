from .curve_editor import CurveEditor as CurveEditor
from .depth_keys import DepthKeys as DepthKeys
from .editor import Editor as Editor
from .live_view import LiveView as LiveView
from .standalone import standalone_html as standalone_html
from .standalone import write_standalone as write_standalone
from .transfer_editor import TransferEditor as TransferEditor
from .studio import Studio as Studio
