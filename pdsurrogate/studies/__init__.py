"""Studies: many runs of a scene, or many fits, in parallel, with their results in one table."""

from .description import Distribution, Fit, Study, load_study
from .study import StudyInterrupted, StudyResult, study

__all__ = ["Distribution", "Fit", "Study", "StudyInterrupted", "StudyResult", "load_study", "study"]
