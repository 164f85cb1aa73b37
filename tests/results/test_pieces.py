"""States written in pieces: by each rank its own, read as one."""

import itertools

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.body import Body
from pdsurrogate.ranks import Communicator
from pdsurrogate.results import vtk
from pdsurrogate.results.contents import contents_in
from pdsurrogate.results.files import write_json
from pdsurrogate.results.folder import make_room
from pdsurrogate.results.states import Moment, StatesInFiles


class Rank:
    together = Communicator.together

    def __init__(self, rank, size):
        self.rank, self.size = rank, size

    def agree(self, error):
        if error is not None:
            raise error


class SomePoints:
    """Which points of a whole body are here, and which of these this rank owns."""

    def __init__(self, rank, size, numbers, own):
        self.ranks, self.numbers, self.own = Rank(rank, size), numbers, own
        self.divided, self.is_first = True, rank == 0


def parts_of(body, bounds, reach):
    """Strips of a body along x1, each with the points within reach of its own."""
    for rank, (low, high) in enumerate(itertools.pairwise(bounds)):
        x = body.points[:, 0]
        numbers = np.flatnonzero((x > low - reach) & (x < high + reach))
        cells = body.cells.only(np.isin(np.arange(len(body)), numbers))[0]
        part = Body(
            body.points[numbers],
            body.volumes[numbers],
            body.horizon,
            body.spacing,
            mesh_cells=cells,
        )
        own = (x[numbers] > low) & (x[numbers] < high)
        object.__setattr__(part, "share", SomePoints(rank, len(bounds) - 1, numbers, own))
        yield numbers, part


@pytest.fixture(scope="module")
def result():
    return pds.simulate(pds.load_scene("hole", {"spacing": 0.25, "stretches": 1.2}), "analytic")


@pytest.fixture
def written(result, tmp_path):
    """The same state whole, and in three pieces of unequal size; the first rank writes last, as
    it may.
    """
    moment, fields = result.states[0]
    (tmp_path / "whole").mkdir()
    (tmp_path / "pieces").mkdir()
    StatesInFiles(tmp_path / "whole", "hole", result.body).append(moment, [fields])
    parts = list(parts_of(result.body, [-1.5, -0.75, 0.0, 1.5], 2 * result.body.spacing))
    for numbers, part in reversed(parts):
        StatesInFiles(tmp_path / "pieces", "hole", part).append(
            moment, [{name: values[numbers] for name, values in fields.items()}]
        )
    return tmp_path


def test_pieces_hold_what_the_whole_holds(result, written):
    whole, pieces = (StatesInFiles.saved(written / name, "hole") for name in ("whole", "pieces"))
    assert pieces.moments == whole.moments == [result.states.moments[0]]
    fields, others = whole[0][1], pieces[0][1]
    assert list(fields) == list(others)
    for name, values in fields.items():
        np.testing.assert_array_equal(others[name], values)


def test_paraview_s_reader_finds_them(result, written):
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    grid = pyvista.read(written / "pieces" / "hole-000.pvtu")
    assert grid.n_cells == len(result.body)
    order = np.argsort(grid.cell_data[vtk.NUMBER])
    np.testing.assert_array_equal(
        grid.cell_data["displacement"][order], result.field("displacement", 0)
    )
    assert set(grid.cell_data) - {vtk.NUMBER} >= set(result.states[0][1])


def test_a_rank_that_cannot_write_leaves_the_states_before(result, written, monkeypatch):
    monkeypatch.setattr(
        vtk,
        "write_state",
        lambda *arguments: (_ for _ in ()).throw(OSError(28, "No space left on device")),
    )
    numbers, part = next(parts_of(result.body, [-1.5, 1.5], 1.0))
    states = StatesInFiles(written / "pieces", "hole", part, [result.states.moments[0]])
    with raising("No space left", OSError):
        states.append(
            Moment(2.0, 1.3, 0.0),
            [{name: values[numbers] for name, values in result.states[0][1].items()}],
        )
    assert len(states.moments) == len(StatesInFiles.saved(written / "pieces", "hole").moments) == 1


def test_a_new_run_takes_the_place_of_pieces(result, written):
    write_json(written / "pieces" / "summary.json", result.summary)
    make_room(written / "pieces", contents_in(result.summary), overwrite=True)
    assert not list((written / "pieces").iterdir())
