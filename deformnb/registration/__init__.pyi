from .optimise import fit_targets as fit_targets
from .optimise import snap_to_match as snap_to_match
from .outlines import fit_outline as fit_outline
from .outlines import fix_outline as fix_outline
from .outlines import outline as outline
from .outlines import slide as slide
from .similarity import MEASURES as MEASURES
