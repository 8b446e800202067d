from .exercises import Choice as Choice
from .exercises import Numbers as Numbers
from .exercises import Result as Result
from .lesson import LESSONS as LESSONS
from .lesson import Lesson as Lesson
from .studio_tasks import FishTask as FishTask
from .studio_tasks import StudioTask as StudioTask
