from .editor import Editor as Editor
from .live_view import LiveView as LiveView
