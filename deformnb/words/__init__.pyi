from .languages import LANGUAGES as LANGUAGES
from .languages import add_tables as add_tables
from .languages import language as language
from .languages import set_language as set_language
from .languages import translate as translate
from .languages import word_table as word_table
from .translator import Translator as Translator
