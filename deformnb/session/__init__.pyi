from .autosave import Autosave as Autosave
from .autosave_store import restore as restore
from .autosave_store import saved_sessions as saved_sessions
from .batch import replay as replay
from .examples import EXAMPLES as EXAMPLES
from .examples import apply_example as apply_example
from .history import HistoryNode as HistoryNode
from .session import Session as Session
