"""Properties required of what every force model refuses: bonds, states and settings."""

import re
import warnings
from typing import Any

import numpy as np

from ..forces import (
    InternalForce,
    InvalidState,
    OutsideDomain,
    OutsideDomainWarning,
)
from ..forces.settings import SETTINGS
from ..materials import dimension_of
from .bodies import (
    plain,
    turn,
    wavy,
)
from .forces import MIRROR, tested
from .subject import Subject, forces_at


@tested(0.0)
def unbreakable(subject: Subject) -> tuple[float, str]:
    """Return 0 if a force bound without the setting ``breakable`` refuses to break bonds with an
    error that names it, otherwise 1.
    """
    force = subject.bind(plain(subject.dimension), precision=None)
    try:
        force.break_bonds(np.arange(5))
    except ValueError as error:
        return float("breakable" not in str(error)), str(error)
    return 1.0, "broken all the same"


@tested(0.0)
def impossible_states(subject: Subject) -> tuple[float, str]:
    """Return how many of a mirrored body (det F < 0) and of positions with NaN are not refused
    with the number and place of a point.
    """
    body = plain(subject.dimension)
    inverted = body.points * MIRROR[: subject.dimension]
    lost = body.points.copy()
    lost[7] = np.nan
    taken = []
    for positions, reason in ((inverted, "inside out"), (lost, "not finite")):
        try:
            forces_at(subject.bind(body), positions)
            taken.append(reason)
        except InvalidState as error:
            if not re.search(rf"point \d+ at \(.*\): .*{reason}", str(error)):
                taken.append(f"{reason}: {error}")
    return len(taken), "; ".join(taken)


IN_WORDS = {"breakable": "bonds that break"}
"""Text by which error messages name a force setting, where it is not the name of the setting
itself.
"""


@tested(0.0)
def settings_refused(subject: Subject) -> tuple[float, str]:
    """Return the number of values of force settings that are ignored, or declared but refused, or
    refused without their name.

    A value that is accepted, differs from the default and changes neither the forces nor the number
    of warnings counts as ignored.
    """
    wrong = []
    declared = subject.model.honored(subject.plane)
    for key, values in SETTINGS.items():
        usual = _settings_outcome(subject, key, None)
        stated = getattr(_bind_with(subject, key, None), key, None)
        taken = {}
        for value in values:
            try:
                taken[value] = _settings_outcome(subject, key, value)
            except ValueError as error:
                if IN_WORDS.get(key, key) not in str(error):
                    wrong.append(f"{key}={value} is refused without its name ({error})")
        # One value may equal the model's default: then others differ, or the model declares this
        # value.
        alive = any(outcome != usual for outcome in taken.values())
        same = [value for value, outcome in taken.items() if outcome == usual]
        wrong += [
            f"{key}={value} changes nothing"
            for value in same
            if len(same) > 1 or not (alive or stated == value)
        ]
        if set(taken) != set(declared.get(key, ())):
            wrong.append(
                f"{key} is declared as {declared.get(key, ())} and taken as {tuple(taken)}"
            )
    return len(wrong), "; ".join(wrong)


def _bind_with(subject: Subject, key: str, value: Any) -> InternalForce:
    """Return the force of the model under test on a body, with the setting `key` set to a value;
    None leaves the model's default.
    """
    settings = {} if value is None else {key: value}
    dimension = dimension_of(settings.get("plane", subject.plane))
    return subject.bind(plain(dimension), **{"precision": None} | settings)


def _settings_outcome(subject: Subject, key: str, value: Any) -> Any:
    """Return the forces as bytes and the number of warnings under a setting, or "stops" if the
    evaluation raises OutsideDomain.

    The setting `key` has the given value, None for the default; if the value is True (of
    ``breakable``), five bonds are broken first.
    """
    force = _bind_with(subject, key, value)
    # The stretch is along axes off the grid, where the paper's rotation differs, and far beyond the
    # domain of any surrogate.
    d = force.body.dimension
    F = (
        np.diag([6.0, 0.6, 0.6][:d])
        if key == "outside"
        else turn(22.5, d) @ np.diag([1.5, 1.0, 0.8][:d]) @ turn(-22.5, d)
    )
    if value is True:
        force.break_bonds(np.arange(5))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OutsideDomainWarning)
        try:
            return forces_at(force, wavy(force.body.points) @ F.T).tobytes(), len(caught)
        except OutsideDomain:
            return "stops"
