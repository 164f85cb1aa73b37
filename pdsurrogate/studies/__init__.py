"""Studies: many runs of a scene, or many fits, in parallel, with one table of what they gave."""

from .description import Distribution, Fit, Study, load_study
from .study import StudyInterrupted, StudyResult, study

__all__ = ["Distribution", "Fit", "Study", "StudyInterrupted", "StudyResult", "load_study", "study"]
