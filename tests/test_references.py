"""What is run is called as the user called it, and judged alike whether it is a fitted pipeline
or its artifact.
"""

import json
import shutil
import warnings

import pytest
from commands import invoke
from polynomials import polynomial
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import ArtifactError
from pdsurrogate.scenes import SceneError

LAW = pds.materials.Gent(chain_limit=30.0)


@pytest.fixture(scope="module")
def fitted():
    samples = pds.training_samples(LAW, 800, (0.6, 2.5), random_state=0)
    return (
        polynomial(samples, (10, 5)),
        samples,
    )


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PDSURROGATE_ARTIFACTS", raising=False)
    return tmp_path


def scene_of(law):
    return pds.load_scene("uniaxial", spacing=0.25, stretches=1.3, material=law.describe())


def test_a_copy_is_called_by_its_place_and_by_its_card(fitted, here):
    model, samples = fitted
    pds.store(model, samples, LAW, None, "mine", "1", "x")
    shutil.copytree("artifacts/mine", "artifacts/copy")
    shutil.copytree("artifacts/mine/1", "elsewhere")
    (here / "link").symlink_to("artifacts/mine/1")
    both = "copy@1 (mine@1 by its card)"
    for reference, name in {
        "mine": "mine@1",
        "artifacts/mine/1": "mine@1",
        "copy": both,
        "copy@1": both,
        "./elsewhere": "elsewhere (mine@1 by its card)",
        "./link": "link (mine@1 by its card)",
    }.items():
        assert pds.load_surrogate(reference).name == name
    result = pds.simulate(scene_of(LAW), "copy")
    assert result.summary["force"] == both
    result.save("out")
    assert json.loads((here / "out" / "summary.json").read_text())["force"] == both
    with raising(r"copy@1 \(mine@1 by its card\) describes gent with chain_limit = 30", SceneError):
        pds.simulate(
            pds.load_scene(
                "uniaxial",
                {"material": pds.materials.Gent(chain_limit=31.0).describe()},
                name="own",
                spacing=0.25,
            ),
            "copy",
        )
    (here / "artifacts" / "copy" / "1" / "surrogate.npz").write_bytes(b"x")
    with raising(r"copy@1 \(mine@1 by its card\): surrogate\.npz", ArtifactError):
        pds.load_surrogate("copy")
    listed = json.loads(invoke("artifacts --json").stdout)
    assert [row["called"] for row in listed if row["name"] in ("copy", "mine")] == [both, "mine@1"]


@pytest.mark.parametrize(
    ("chain_limit", "verdict"),
    [(30.0, "taken"), (27.0, "noted"), (22.0, "noted"), (15.0, "refused")],
)
def test_a_pipeline_is_compared_with_a_law_as_its_artifact_is(fitted, here, chain_limit, verdict):
    """Storing it for the law of a scene and running it in the scene: taken, noted and refused
    alike.
    """
    model, samples = fitted
    law, scene = (
        pds.materials.Gent(chain_limit=chain_limit),
        scene_of(pds.materials.Gent(chain_limit=chain_limit)),
    )
    said = []
    for use in (
        lambda: pds.simulate(scene, model),
        lambda: pds.simulate(scene, pds.store(model, samples, law, None, "mine", None, "x")),
    ):
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            try:
                use()
            except ValueError as error:
                said.append(("refused", str(error)))
            else:
                said.append(("noted" if noted else "taken", str(noted[0].message) if noted else ""))
    assert [what for what, _ in said] == [verdict] * 2, said
    for (_, message), end in zip(said, ("which the scene asks for", "is stored as"), strict=True):
        if verdict == "noted":
            assert (
                f"% relative to gent, chain_limit = {chain_limit:g}, the law that it was compared"
                f" with and {end}" in message
            )
        if verdict == "refused":
            assert "more than 10 %; it is not " in message
