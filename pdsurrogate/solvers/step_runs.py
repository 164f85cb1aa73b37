"""Steps of explicit dynamics one after another in compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..engine.passes import BoundPass, Chain
from ..engine.threads import Chunks
from ..forces.evaluation import Evaluation, is_passes
from ..kernels.steps import keep_row, next_row, put_row
from .conditions import Loading, Motions
from .dynamics import Balance, ExplicitDynamics
from .loaded_force import LoadedForce


class Taken(NamedTuple):
    """Forces on the supports in k steps, and kinetic energies and powers of these."""

    on_points: np.ndarray
    """Forces on the held components of points, (k, m)."""

    elastic: np.ndarray
    """Elastic forces on these."""

    on_planes: np.ndarray | None
    """Forces of the planes on the body, (k, planes, d)."""

    balances: list[Balance]
    """Kinetic energies and powers."""


class StepRuns:
    """Steps of a body whose force, supports and search for broken bonds are compiled passes.

    Parameters
    ----------
    integrator : ExplicitDynamics
    loading : Loading
    most : int
        Greatest number of steps in a run.
    search : BoundPass, optional
        Pass over the pairs that returns a count where bonds break at the positions of the force.
    """

    def __init__(
        self,
        integrator: ExplicitDynamics,
        loading: Loading,
        most: int,
        search: BoundPass | None = None,
    ) -> None:
        self._integrator = integrator
        self._loading = loading
        viscous = integrator.viscosity > 0
        positions = integrator.positions
        places = integrator.ahead if viscous else positions
        self._evaluation = evaluation = Evaluation(integrator.force, places, integrator.forces)
        self._chunks = Chunks(integrator.take.threads, 1)
        self._row = np.zeros(1, dtype=np.int64)
        self._tables: list[np.ndarray] = []
        held = np.ravel_multi_index(loading.there, positions.shape)
        whole = np.arange(evaluation.shifts.size)

        def table(where: np.ndarray) -> np.ndarray:
            self._tables.append(np.zeros((most, len(where))))
            return self._tables[-1]

        def put(values: np.ndarray, where: np.ndarray) -> BoundPass:
            return put_row.bind(table(where), self._row, where, values, chunks=self._chunks)

        def keep(values: np.ndarray, where: np.ndarray) -> BoundPass:
            return keep_row.bind(values, where, self._row, table(where), chunks=self._chunks)

        steps = [put(integrator.spans, np.arange(4)), integrator.take]
        steps += [put(positions.reshape(-1), held), put(evaluation.shifts, whole)]
        if search is not None:
            steps += [evaluation.placing(positions), search]
        if viscous:
            steps += [integrator.look, put(places.reshape(-1), held)]
            steps += [put(evaluation.shifts, whole)]
        steps += evaluation.passes
        if viscous:
            steps.append(integrator.follow)
        steps += [keep(integrator.forces.reshape(-1), held)]
        steps += [keep(integrator.elastic.reshape(-1), held)]
        self.has_planes = evaluation.of_planes is not None
        if evaluation.of_planes is not None:
            find, found = evaluation.of_planes
            steps += [find, keep(found.reshape(-1), np.arange(found.size))]
        sums = integrator.sums.reshape(-1)
        steps += [integrator.find_energies, keep(sums, np.arange(sums.size))]
        self._chain = Chain(next_row.bind(self._row, chunks=self._chunks), *steps)

    def __call__(self, spans: np.ndarray, now: Motions, ahead: Motions) -> tuple[int, Taken]:
        """Take steps until one needs Python; return how many are done, and of these what the
        account needs. A step that is not done has moved the points.

        Parameters
        ----------
        spans : ndarray, shape (k, 4)
            Of each step, see `pdsurrogate.kernels.steps.take_step` and `follow`.
        now, ahead : Motions
            Motions of the supports at the ends of the steps, and a retardation time later.
        """
        integrator = self._integrator
        evaluation = self._evaluation
        count = len(spans)
        given = [spans]
        for motions in (now, ahead) if integrator.viscosity > 0 else (now,):
            given.append(self._loading.places_there + motions.of_points)
            given.append(evaluation.images_at(motions.of_planes))
        for table, rows in zip(self._tables, given, strict=False):
            table[:count] = rows
        self._row[0] = -1
        evaluation.begin()
        integrator.give_energies()
        done = self._chain.repeat(count)
        evaluation.end(done)
        on_points, elastic, *on_planes, sums = self._tables[len(given) :]
        planes = [one[:done].reshape(done, *now.of_planes.shape[1:3]) for one in on_planes]
        sums = sums[:done].reshape(done, *integrator.sums.shape).sum(axis=1)
        return done, Taken(
            on_points[:done],
            (elastic if integrator.viscosity > 0 else on_points)[:done],
            *(planes or [None]),
            [Balance(*row) for row in sums.tolist()],
        )


def can_run(force: LoadedForce, loading: Loading) -> bool:
    """Return whether steps of a body under dynamics can be `StepRuns`."""
    simple = not (loading.loads or loading.supports or loading.turning or force.rigid)
    return simple and is_passes(force.internal)
