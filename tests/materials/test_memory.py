"""Branches and softening as part of a law and of a scene's material."""

import pytest
from refusals import raising, refused

import pdsurrogate as pds
from pdsurrogate.materials import Branch, Gent, Memory, NeoHookean, Softening
from pdsurrogate.scenes.model import MaterialSpec


def test_prony_ratios_are_of_the_modulus_of_fast_motions():
    law = MaterialSpec(
        law="neo-hookean", shear_modulus=0.5, prony=[[0.3, 1.0], [0.2, 10.0]]
    ).build()
    assert [branch.modulus for branch in law.memory.branches] == pytest.approx([0.3, 0.2])
    assert law.shear_modulus + law.memory.modulus == pytest.approx(1.0)


def test_a_law_with_memory_is_described_and_read_again():
    branches = Branch(0.4, 2.0), Branch(0.1, 9.0, ((0.2, 9.0), (4.0, 0.1)))
    law = Gent(0.6, 60.0, 15.0, memory=Memory(branches, Softening(1.5, 0.1, 0.1)))
    assert MaterialSpec.model_validate(law.describe()).build() == law
    scaled = law.scaled(1e3)
    assert scaled.memory.branches == (
        Branch(400.0, 2.0),
        Branch(100.0, 9.0, ((200.0, 9.0), (4000.0, 0.1))),
    )
    assert scaled.memory.branches[1].time_at(900.0) == pytest.approx(branches[1].time_at(0.9))
    assert scaled.memory.softening == Softening(1.5, 100.0, 0.1)
    assert law.parameters.tolist() == Gent(0.6, 60.0, 15.0).parameters.tolist()


@refused("memories")
def test_memories_without_sense_are_refused(given, told):
    with raising(told):
        MaterialSpec(law="neo-hookean", **given)


def test_a_model_without_memory_refuses_branches():
    body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    law = NeoHookean(memory=Memory((Branch(1.0, 1.0),)))
    with raising("does not describe branches"):
        pds.forces.NOSBForce().bind(body, law, pds.ForceSettings())


def test_built_in_scenes_with_memory_have_no_elastic_reference():
    changes = {"material.prony": [[0.3, 1.0]], "times": [1.0, 2.0, 3.0]}
    assert pds.load_scene("uniaxial", changes).reference is None
    assert pds.load_scene("uniaxial", {"times": [1.0, 2.0, 3.0]}).reference == "uniaxial"
    with raising("reference: uniaxial is a solution for elastic", pds.SceneError):
        pds.load_scene("uniaxial", changes | {"reference": "uniaxial"})
