"""What physics demands of every force, on deformations that nobody chose: hypothesis draws them."""

import io
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pdsurrogate.artifacts.store import payload_of
from pdsurrogate.forces import Domain, NetworkForce
from pdsurrogate.kernels.feature_sets import FEATURE_SETS
from pdsurrogate.kernels.network import ACTIVATIONS, pack
from pdsurrogate.scenes import Scene, SceneError, load_scene

weights = st.floats(-3, 3, allow_subnormal=False)


@given(
    feature_set=st.sampled_from(sorted(FEATURE_SETS)),
    activation=st.sampled_from(sorted(ACTIVATIONS)),
    hidden=st.lists(st.integers(1, 9), min_size=1, max_size=2),
    seed=st.integers(0, 2**31),
)
def test_networks_survive_being_stored(feature_set, activation, hidden, seed):
    """A network of any shape is the same after writing and reading, to the last bit, in NumPy and as constants of the kernel."""
    random = np.random.default_rng(seed)
    widths = [len(FEATURE_SETS[feature_set].names), *hidden, 2]
    layers = tuple((random.normal(size=(n, m)), random.normal(size=m)) for n, m in pairwise(widths))
    domain = Domain(0.5, 4.0, 0.9, 1.2)
    network = NetworkForce("any", feature_set, random.normal(size=2), domain, "neo-hookean", {}, activation, layers)
    file = io.BytesIO()
    np.savez(file, **network.payload())
    again = NetworkForce.from_payload("any", payload_of(file.getvalue()), domain, "neo-hookean", {})
    states = random.uniform(0.7, 1.4, (5, 20))
    states[1] -= 1
    np.testing.assert_array_equal(again.bond_force(*states), network.bond_force(*states))
    for mine, theirs in zip(*(pack(model.layers, model.at_rest, np.float32) for model in (network, again)), strict=True):
        np.testing.assert_array_equal(mine, theirs)


toml_values = st.recursive(
    st.one_of(
        *(st.booleans().map(lambda value: str(value).lower()), st.integers().map(str), st.floats().map(repr)),
        st.text(max_size=8).map(lambda text: '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'),
    ),
    lambda inner: st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=5,
)
keys = st.sampled_from(
    ["name", "spacing", "stretches", "body.size", "material", "material.law", "solver.tolerance", "grips", "units", "else"]
)


@settings(max_examples=200)
@given(lines=st.lists(st.tuples(keys, toml_values), max_size=6), extra=st.text(max_size=20))
def test_any_scene_file_is_a_scene_or_an_error(tmp_path_factory, lines, extra):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text("\n".join(f"{key} = {value}" for key, value in lines) + "\n" + extra, "utf-8", errors="replace")
    try:
        assert isinstance(load_scene(path), Scene)
    except SceneError:
        return


@settings(max_examples=200)
@given(key=keys, value=toml_values)
def test_any_change_is_a_scene_or_an_error(key, value):
    try:
        assert isinstance(load_scene("uniaxial", [f"{key}={value}"]), Scene)
    except SceneError:
        return
