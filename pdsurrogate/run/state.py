"""State of a run that a checkpoint keeps as it is: its place in the programme, and everything recorded so far."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class State:
    """Numbers and text that describe the progress of a run, in addition to its arrays.

    Attributes
    ----------
    parameter : float
        Loading parameter at the positions.
    begin : float
        Loading parameter where the stage under way began.
    stage, outputs : int
        Number of the stage that is under way, and of its outputs so far.
    elapsed : float
        Time that earlier stages in dynamics took.
    steps : int
        Steps in dynamics.
    wasted : int
        Evaluations of increments that failed.
    greatest_drive : float
        Greatest `Equilibrium.drive` of the outputs so far.
    crack : dict or None
        Entry of the summary about cracks.
    dynamics : list of dict
        Entries of the summary about the stages in dynamics.
    levels, history, convergence : list of dict
        Measures at every level; rows of the history; rows about the search for equilibrium.
    beyond_data : list of dict
        For every recorded state of an energy from test data, the share of the bonds that is beyond them, and the farthest distance.
    """

    parameter: float
    begin: float
    stage: int = 0
    outputs: int = 0
    elapsed: float = 0.0
    steps: int = 0
    wasted: int = 0
    greatest_drive: float = 0.0
    crack: dict | None = None
    dynamics: list[dict] = field(default_factory=list)
    levels: list[dict] = field(default_factory=list)
    history: list[dict] = field(default_factory=list)
    convergence: list[dict] = field(default_factory=list)
    beyond_data: list[dict] = field(default_factory=list)
