"""Sums of forces and moments at both ends of the pairs, against sums over the list of pairs."""

import numpy as np
import pytest

import pdsurrogate as pds
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.forces import ForceSettings, MaterialPart, bind_portions, walks
from pdsurrogate.materials import Branch, Memory, NeoHookean, Softening
from pdsurrogate.testing.bodies import notched

ELASTIC = NeoHookean(2.0, 200.0)
SOFT = NeoHookean(1.0, 60.0)
MEMORY = Memory((Branch(3.0, 1.0),), Softening(1.6, 0.1, 0.2))
REMEMBERING = NeoHookean(2.0, 60.0, memory=MEMORY)


def bound(name, plane, precision, laws):
    body = notched(3 if plane == "space" else 2)
    settings = ForceSettings(plane=plane, precision=precision)
    model = pds.load_surrogate(name)
    if len(laws) == 1:
        return model.bind(body, laws[0], settings)
    right = body.points[:, 0] > np.median(body.points[:, 0])
    points = np.flatnonzero(~right), np.flatnonzero(right)
    parts = [MaterialPart(law, model, at) for law, at in zip(laws, points, strict=True)]
    return bind_portions(body, parts, settings)


LEARNED = {"stress": "neo-hookean-energy", "space": "neo-hookean-isochoric"}
CASES = [
    *(
        ("bond-energy", plane, "float64", laws)
        for plane in ("stress", "strain", "space")
        for laws in ([ELASTIC], [REMEMBERING], [SOFT, ELASTIC])
    ),
    *(
        (name, plane, precision, [ELASTIC])
        for plane, name in LEARNED.items()
        for precision in ("float32", "float64")
    ),
]


@pytest.mark.parametrize("case", CASES)
def test_sums_at_both_ends_are_those_over_the_list(case, monkeypatch):
    """With many slabs, whose blocks have pairs of several; pairs outside count once."""
    learned = case[0] != "bond-energy"
    found = []
    for fewest, threads in ((walks.FEWEST_PAIRS, 1), (40, 1), (40, 2)):
        monkeypatch.setattr(walks, "FEWEST_PAIRS", fewest)
        with thread_count(threads):
            force = bound(*case)
            factors = [8.0 if learned else 1.9, 0.4, 0.5][: force.body.dimension]
            waves = 0.01 * np.sin(5 * force.body.points[:, ::-1])
            positions = force.body.points * factors + waves
            out = np.empty_like(positions)
            force(positions, out)
            (term,) = force.terms
            for part in term.parts:
                part.steps[-1]()
            found.append((out, force.energy(), [part.counts() for part in term.parts]))
    whole, *in_slabs = found
    assert len(term.parts[0].walk.slabs) > 8
    assert len(term.parts[0].walk.blocks) > len(term.parts[0].points.rows)
    for one in in_slabs:
        scale = np.abs(whole[0]).max()
        np.testing.assert_allclose(one[0], whole[0], rtol=0, atol=1e-13 * scale)
        assert one[1] == pytest.approx(whole[1], rel=1e-13)
        assert one[2] == whole[2]
    assert np.array_equal(in_slabs[0][0], in_slabs[1][0])
    if learned:
        assert whole[2][0][0] > 0

    d = force.body.dimension
    for part in term.parts:
        points = part.points
        count = np.count_nonzero(points.second > points.first)
        first, second = points.first[:count], points.second[:count]
        records = part.each(np.arange(count))
        moments, forces = np.zeros((2, len(points.positions), d * d + d))
        for ends, sign in ((first, 1), (second, -1)):
            np.add.at(moments, ends, records)
            np.add.at(forces, ends, sign * records)
        sums = np.empty((len(moments), d * d)), np.empty((len(moments), d))
        part.sum_to(*sums)()
        expected = moments[:, : d * d], forces[:, d * d :]
        for one, other in zip(sums, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(records).max())
