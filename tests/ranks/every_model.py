"""Forces, and positions after explicit steps, of every force model, on one rank or several."""

import numpy as np
from force_models import TABLE

from pdsurrogate.body import ReflectionPlane, divided
from pdsurrogate.forces import BondEnergyForce, ForceSettings, walks
from pdsurrogate.forces.internal_force import dissipated_by, stored_by
from pdsurrogate.materials import Branch, Memory, NeoHookean, Softening
from pdsurrogate.ranks import communicator
from pdsurrogate.solvers.dynamics import ExplicitDynamics
from pdsurrogate.testing.bodies import Deformation, notched

walks.FEWEST_PAIRS = 64  # small bodies have several slabs, too

DEFORMED = Deformation(1.02, 0.99, 0.0, 0.0, 0.0003, 1)


LONGEST = 0.02
"""Time of a step: shorter than the stable one of `ba-nosb`, which rounding changes by more than
it changes forces.
"""


def cut(starts, ends):
    """Bonds across a line of a third of the body."""
    sides = (starts[:, 1] > 0.42) != (ends[:, 1] > 0.42)
    return sides & (np.maximum(starts[:, 0], ends[:, 0]) < 0.4)


def measured(row, steps, ranks, outward=None, torn=None, **settings):
    """Forces, energy, positions and the stable time step, on the first rank of the whole body.

    The bonds of the pairs that `torn` flags are broken on the way.
    """
    subject, d = row.subject, row.subject.dimension
    whole = notched(d, planes=(ReflectionPlane(0, 0.0, -1, (-1, 1, 1)[:d]),), separates=cut)
    body = divided(whole, ranks) if ranks.size > 1 else whole
    share = body.share
    if outward is not None:
        vars(body).update(outward=outward(whole)[share.numbers], loaded=True)
    force = subject.model.bind(
        body, subject.law, ForceSettings(plane=row.plane, breakable=torn is not None, **settings)
    )
    positions = DEFORMED(body.points)
    forces = np.empty_like(positions)
    force(positions, forces)
    found = {"forces": body.share.gather(forces)}
    found["energy"] = share.total(force.energy()) if force.has_energy else np.nan
    free = np.ones_like(positions)
    body.share.clear(free)
    still = lambda positions, ahead: None  # noqa: E731
    damped = {"damping": 0.5, "viscosity": 0.0, "safety": 0.3}
    integrator = ExplicitDynamics(
        force, still, positions, np.zeros_like(positions), free, body.volumes.copy(), **damped
    )
    integrator.longest = LONGEST
    integrator.begin()
    for number in range(steps):
        if torn is not None and number == steps // 2:
            force.break_bonds(np.flatnonzero(torn(body)))
        integrator.move()
        integrator.evaluate()
    found["positions"], found["time step"] = body.share.gather(positions), integrator.time_step
    return found


def arrays(steps, names=(), **settings):
    """What is measured of models given by their names, or of all, by the model's name and what
    it is.
    """
    ranks, found = communicator(), {}
    for row in TABLE:
        if not names or row.name in names:
            found |= {
                f"{row.name}: {key}": values
                for key, values in measured(row, steps, ranks, **settings).items()
            }
    return found


def pulled(body):
    """Loads of a uniform tension on the outermost layers, which the weights of gradients are
    changed for.
    """
    places = body.points - body.points.mean(axis=0)
    outermost = np.abs(places) > np.abs(places).max(axis=0) - 0.6 * body.spacing
    outermost[places[:, 0] < 0, 0] = False
    return np.where(outermost, np.sign(places) * body.spacing ** (body.dimension - 1), 0.0)


def crossing(body):
    """Flags of the pairs across a line near the upper edge, from the right, of which not all are
    at changed gradients.
    """
    ends = body.all_points[body.bonds.first], body.all_points[body.bonds.second]
    height = body.share.greatest(body.points[:, 1].max()) - 1.2 * body.spacing
    return ((ends[0][:, 1] > height) != (ends[1][:, 1] > height)) & (
        np.minimum(ends[0][:, 0], ends[1][:, 0]) > 0.4
    )


def balanced(steps, names, breaks=False):
    """What is measured of models with balanced gradients or pairs, of which some bonds break if
    `breaks`.
    """
    return arrays(steps, names, outward=pulled, torn=crossing if breaks else None)


def remembered():
    """Forces and energies of bodies with branches and softening in states accepted one after
    another, from bonds with histories of their own.
    """
    ranks, found = communicator(), {}
    falling = Branch(0.5, 10.0, ((0.05, 10.0), (2.0, 0.1)))
    for plane, d in (("strain", 2), ("stress", 2), ("space", 3)):
        slow = Branch(0.5, 10.0) if plane == "space" else falling
        memory = Memory((Branch(2.0, 1.0), slow), Softening(1.5, 0.01, 0.1))
        law = NeoHookean(shear_modulus=2.0, memory=memory)
        whole = notched(d, planes=(ReflectionPlane(0, 0.0, -1, (-1, 1, 1)[:d]),), separates=cut)
        body = divided(whole, ranks) if ranks.size > 1 else whole
        force = BondEnergyForce().bind(body, law, ForceSettings(plane=plane, paths=True))
        forces = np.empty_like(body.points)
        for number, stretch in enumerate((1.1, 1.3, 1.15, 1.2)):
            positions = Deformation(stretch, 0.95, 0.0, 0.0, 0.0003 * number, 1)(body.points)
            force.elapse(0.4 * number, 0.4 * max(0, number - 1))
            force(positions, forces)
            found[f"{plane}, {number}: forces"] = np.array(body.share.gather(forces))
            force.accept(positions)
        kept = stored_by(force), *dissipated_by(force).values()
        found[f"{plane}: energies"] = np.array([body.share.total(one) for one in kept])
    return found
