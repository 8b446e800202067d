from .autosave import Autosave as Autosave
from .batch import replay as replay
from .history import HistoryNode as HistoryNode
from .session import Session as Session
from .store import restore as restore
from .store import saved_sessions as saved_sessions
