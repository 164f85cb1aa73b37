"""Numbers and rows that describe how far a run has come, as checkpoints keep them."""

from dataclasses import dataclass, field


@dataclass
class State:
    """Numbers and text that describe the progress of a run, in addition to its arrays.

    Attributes
    ----------
    parameter : float
        Loading parameter at the present positions.
    begin : float
        Loading parameter at which the present stage began, or the displacement that the stage
        controls.
    stage, outputs : int
        Number of the present stage, and number of its outputs so far.
    elapsed : float
        Time that earlier stages took, of those in equilibrium those with a duration.
    time : float
        Time since the present stage began, if it is in equilibrium.
    before : float
        Duration of the last increment of a body with branches, whose motion goes on smoothly, or
        else 0.
    overstress : float
        Greatest overstress of branches so far.
    steps : int
        Steps in dynamics.
    greatest_drive : float
        Greatest sum of the magnitudes of loads or reactions (`Equilibrium.drive`) of the outputs so
        far.
    crack : dict or None
        Entry of the summary about cracks; None without fracture or before dynamics.
    tear : dict or None
        Energy account and search for events of a body that tears slowly (`Tearing`); None for
        others.
    dynamics : list of dict
        Entries of the summary about the stages in dynamics.
    levels, history, convergence : list of dict
        Rows of ``summary["levels"]``, the measurements at outputs; rows of the history; rows of the
        table of convergence, about the search for equilibrium.
    beyond_data : list of dict
        With a force learned from test data, a row for every recorded state: the fraction of bonds
        or points beyond these data, and their greatest distance from the data.
    """

    parameter: float
    begin: float
    stage: int = 0
    outputs: int = 0
    elapsed: float = 0.0
    time: float = 0.0
    before: float = 0.0
    overstress: float = 0.0
    steps: int = 0
    greatest_drive: float = 0.0
    crack: dict | None = None
    tear: dict | None = None
    dynamics: list[dict] = field(default_factory=list)
    levels: list[dict] = field(default_factory=list)
    history: list[dict] = field(default_factory=list)
    convergence: list[dict] = field(default_factory=list)
    beyond_data: list[dict] = field(default_factory=list)
