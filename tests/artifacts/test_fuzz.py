"""Thousands of damaged and hostile files: every one a clean error or a whole object; nothing runs,
nothing hangs.

The corruptions are drawn from fixed seeds.
"""

import hashlib
import io
import json
import pickle
import shutil
import time

import numpy as np
import pytest
from bodies import build_body
from commands import commanded
from conftest import SHIPPED
from runs import started

from pdsurrogate.artifacts import ArtifactError, load_card, load_surrogate
from pdsurrogate.artifacts.store import payload_of
from pdsurrogate.results.checkpoint import Checkpoint, CheckpointError
from pdsurrogate.run.checkpoints import Checkpoints
from pdsurrogate.run.simulate import SimulationFailed, simulate
from pdsurrogate.scenes import Scene, SceneError, load_scene, scene_names
from pdsurrogate.scenes.reading import _place_of

SLOWEST = 2.0
"""Processor seconds that any one file may take: reading a good one takes milliseconds."""

GOOD = {
    name: {path.name: path.read_bytes() for path in sorted((SHIPPED / name / "1").iterdir())}
    for name in ("neo-hookean", "gent")
}

STRANGE = (
    None,
    True,
    -1,
    0,
    2**63,
    10**30,
    -1e308,
    1e-320,
    "",
    "x" * 3000,
    "[/red]",
    "\0",
    "../../etc",
    [],
    [[]],
    {},
    {"a": {}},
    [1e9] * 50,
)
"""Values that a field may be exchanged for."""


class Trap:
    """Unpickling this makes a folder."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        import os

        return os.mkdir, (self.path,)


def with_payload(files: dict, payload: bytes) -> dict:
    """An artifact whose card was made to match a payload: what an attacker would hand out."""
    card = json.loads(files["card.json"])
    card["payloads"]["surrogate.npz"].update(
        sha256=hashlib.sha256(payload).hexdigest(), bytes=len(payload)
    )
    return {**files, "surrogate.npz": payload, "card.json": json.dumps(card).encode()}


def flipped(data: bytes, random, count: int) -> bytes:
    """A few bits turned over."""
    changed = bytearray(data)
    for _ in range(count):
        changed[random.integers(len(changed))] ^= 1 << random.integers(8)
    return bytes(changed)


def exchanged(value, random):
    """One node of a tree of plain data exchanged for something strange, removed, or given a new
    name.
    """
    if isinstance(value, dict) and value and random.random() < 0.8:
        key = list(value)[random.integers(len(value))]
        fate = random.random()
        rest = {name: item for name, item in value.items() if name != key}
        if fate < 0.15:
            return rest
        if fate < 0.25:
            return {**rest, key + "x": value[key]}
        return {**value, key: exchanged(value[key], random)}
    if isinstance(value, list) and value and random.random() < 0.8:
        place = random.integers(len(value))
        return [exchanged(item, random) if k == place else item for k, item in enumerate(value)]
    return STRANGE[random.integers(len(STRANGE))]


def as_plain_json(value) -> bytes:
    return json.dumps(value).encode()


def archived(arrays: dict) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def truncated_payload(random, trap, number):
    files = GOOD["neo-hookean"]
    payload = files["surrogate.npz"]
    cut = payload[: (number * 48) % len(payload)]
    return {**files, "surrogate.npz": cut} if number % 2 else with_payload(files, cut)


def flipped_payload(random, trap, number):
    files = GOOD["neo-hookean"]
    changed = flipped(files["surrogate.npz"], random, 1 + number % 3)
    return {**files, "surrogate.npz": changed} if number % 4 == 0 else with_payload(files, changed)


def exchanged_payload(random, trap, number):
    files = GOOD["neo-hookean"]
    arrays = payload_of(files["surrogate.npz"])
    key = list(arrays)[random.integers(len(arrays))]
    fate, value = random.integers(5), np.asarray(arrays[key])
    if fate == 0:
        del arrays[key]
    elif fate == 1:
        arrays[key + "x"] = arrays.pop(key)
    elif fate == 2:
        arrays[key] = (
            value.astype(["f4", "c16", "U8", "S3"][random.integers(4)])
            if value.dtype.kind == "f"
            else value.astype("S")
        )
    elif fate == 3:
        arrays[key] = value.reshape(-1)[: random.integers(value.size + 1)]
    else:
        strange = STRANGE[random.integers(len(STRANGE))]
        arrays[key] = (
            np.array(strange) if isinstance(strange, str | float) else np.full(value.shape, np.nan)
        )
    return with_payload(files, archived(arrays))


def broken_card(random, trap, number):
    files = GOOD["gent"]
    card = files["card.json"]
    changed = (
        card[: random.integers(len(card))]
        if number % 3 == 0
        else flipped(card, random, 1 + number % 5)
    )
    return {**files, "card.json": changed}


def exchanged_card(random, trap, number):
    files = GOOD["gent"]
    return {**files, "card.json": as_plain_json(exchanged(json.loads(files["card.json"]), random))}


def swapped_card(random, trap, number):
    ours, theirs = GOOD["neo-hookean"], GOOD["gent"]
    if number % 2:
        return {**ours, "card.json": theirs["card.json"]}
    card = json.loads(theirs["card.json"])
    card["features"]["set"] = "paper"
    return with_payload({**theirs, "card.json": as_plain_json(card)}, ours["surrogate.npz"])


def other_schema(random, trap, number):
    files = GOOD["neo-hookean"]
    card = json.loads(files["card.json"])
    card["schema_version"] = [0, -1, 1, 99, "1", 1.5, None, True, 2**70, [1]][number % 10]
    return {**files, "card.json": as_plain_json(card)}


DAMAGE = (
    truncated_payload,
    flipped_payload,
    exchanged_payload,
    broken_card,
    exchanged_card,
    swapped_card,
    other_schema,
)


def check_artifacts(folder, each: int) -> dict[str, int]:
    """Try `each` corruptions of every kind; returns how many were refused."""
    trap, place = folder / "trap", folder / "artifact"
    refused = {}
    for damage in DAMAGE:
        random = np.random.default_rng(sum(damage.__name__.encode()))
        refused[damage.__name__] = 0
        for number in range(each):
            files = damage(random, trap, number)
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            for name, data in files.items():
                (place / name).write_bytes(data)
            began = time.process_time()
            model = None
            try:
                card = load_card(place)
                model = load_surrogate(place)
            except ArtifactError:
                refused[damage.__name__] += 1
            assert time.process_time() - began < SLOWEST, f"{damage.__name__} {number}"
            if model is not None:
                # Whatever was accepted is whole: digests that match, and numbers where numbers
                # belong.
                data = (place / "surrogate.npz").read_bytes()
                assert card.payloads["surrogate.npz"].sha256 == hashlib.sha256(data).hexdigest()
                with np.errstate(all="ignore"):
                    assert model.bond_force([1.1], [0.05], [0.5], [0.9], [1.05]).shape == (1, 2)
                    model.compiled(np.float32)
            assert not trap.exists(), f"{damage.__name__} {number} ran code"
    return refused


def assert_refused(refused: dict[str, int], each: int) -> None:
    for name in ("truncated_payload", "swapped_card", "other_schema"):
        assert refused[name] == each, name
    # Some bits are harmless where the digest was made to match: a weight's last place, a letter of
    # the description.
    for name in ("flipped_payload", "exchanged_payload", "broken_card", "exchanged_card"):
        assert refused[name] > 0.3 * each, name


def test_500_corrupted_artifacts(tmp_path):
    each = -(-500 // len(DAMAGE))
    assert_refused(check_artifacts(tmp_path, each), each)


def test_the_trap_is_a_real_one(tmp_path):
    pickle.loads(pickle.dumps(Trap(tmp_path / "trap")))
    assert (tmp_path / "trap").exists()


@pytest.fixture(scope="module")
def checkpointed(tmp_path_factory):
    """A run with a crack under way, and its checkpoint."""
    folder = tmp_path_factory.mktemp("run")
    scene = load_scene(
        "tear",
        {
            "spacing": 0.2,
            "body.size": [3.0, 1.0],
            "precuts": [{"start": [0.0, 0.5], "end": [1.0, 0.5]}],
            "stretches": [1.2],
            "fracture.critical_stretch": 1.8,
            "dynamics.stretch": 1.6,
            "dynamics.stretch_rate": 60.0,
            "dynamics.outputs": 2,
        },
    )
    simulate(scene, "analytic", folder=folder)
    return scene, (folder / "checkpoint.npz").read_bytes()


def rewritten(checkpoint: bytes, random) -> bytes:
    """A checkpoint with one thing exchanged, its check sums right."""
    with np.load(io.BytesIO(checkpoint)) as file:
        arrays = {key: file[key] for key in file.files}
    fate = random.integers(5)
    key = list(arrays)[random.integers(len(arrays))]
    if fate == 0:
        del arrays[key]
    elif fate == 1 and arrays[key].dtype == np.float64:
        arrays[key] = arrays[key].copy()
        arrays[key].flat[random.integers(arrays[key].size)] = [np.nan, np.inf, 1e308][
            random.integers(3)
        ]
    elif fate == 2:
        arrays[key] = (
            np.array([Trap("/nowhere")], dtype=object)
            if random.random() < 0.5
            else arrays[key].astype("U4")[:3]
        )
    elif fate == 3:
        arrays[key] = arrays[key].reshape(-1)[: random.integers(arrays[key].size)]
    else:
        description = exchanged(json.loads(arrays["description"].tobytes()), random)
        arrays["description"] = np.frombuffer(json.dumps(description).encode(), dtype=np.uint8)
    file = io.BytesIO()
    (np.savez_compressed if random.random() < 0.1 else np.savez)(file, **arrays)
    return file.getvalue()


def test_300_corrupted_checkpoints(checkpointed, tmp_path):
    """A clean error, or a run that goes on from numbers that are numbers; nothing else, and
    nothing of the checkpoint runs.
    """
    scene, good = checkpointed
    run = started(scene, "analytic", tmp_path)
    random, refused = np.random.default_rng(11), 0
    shapes = {"positions": (run.positions.shape, np.float64)}
    for k in range(300):
        if k % 4 == 0:
            data = good[: (k * 323) % len(good)]
        elif k % 4 == 1:
            data = flipped(good, random, 1 + k % 5)
        else:
            data = rewritten(good, random)
        (tmp_path / "checkpoint.npz").write_bytes(data)
        began = time.process_time()
        try:
            found = Checkpoint.read(tmp_path, Checkpoints(run).identity, shapes)
            assert all(np.isfinite(array).all() for array in found.arrays.values())
        except CheckpointError:
            refused += 1
        assert time.process_time() - began < SLOWEST
    assert refused > 210


def test_resuming_from_corrupted_checkpoints_ends_cleanly(checkpointed, tmp_path):
    """The whole way, for those whose arrays pass: an error about the checkpoint, a failed run
    that says why, or a run.
    """
    scene, good = checkpointed
    random = np.random.default_rng(12)
    ends = set()
    for _ in range(12):
        (tmp_path / "checkpoint.npz").write_bytes(rewritten(good, random))
        try:
            simulate(scene, "analytic", folder=tmp_path, resume=True)
            ends.add("run")
        except CheckpointError:
            ends.add("refused")
        except SimulationFailed:
            ends.add("failed")
    assert "refused" in ends


def test_a_checkpoint_cannot_fill_the_memory(checkpointed, tmp_path):
    """Thirty megabytes of nothing, squeezed into thirty kilobytes, and an array that claims to
    be larger than any memory.
    """
    scene, good = checkpointed
    run = started(scene, "analytic", tmp_path)
    file = io.BytesIO()
    np.savez_compressed(
        file, positions=np.zeros(4_000_000), description=np.zeros(3, dtype=np.uint8)
    )
    claims = good.replace(b"'shape': (75, 2)", b"'shape': (9" + b"9" * 9 + b")")
    for data in (file.getvalue(), claims):
        (tmp_path / "checkpoint.npz").write_bytes(data)
        with pytest.raises(CheckpointError):
            Checkpoint.read(tmp_path, Checkpoints(run).identity, {})


LITERALS = (
    *(
        "nan",
        "-inf",
        "0",
        "-1",
        "1e308",
        "1e-320",
        "1e-9",
        "9" * 40,
        "true",
        "''",
        "'x'",
        "'[/red]'",
        "'../../x'",
        "'$\\\\frac'",
        '"\\u0000"',
    ),
    *(
        "[]",
        "[[]]",
        "[1, 'a']",
        "{}",
        "{a = {}}",
        "1979-05-27",
        "[1,2,3,4,5,6,7]",
        "[" * 300 + "]" * 300,
        "[" * 60 + "]" * 60,
    ),
)


def damaged_scene(text: str, random) -> bytes:
    """A scene file with something wrong in it."""
    lines = text.splitlines()
    places = [
        k for k, line in enumerate(lines) if "=" in line and not line.lstrip().startswith("#")
    ]
    kind = random.integers(9)
    data = text.encode()
    if kind == 0:
        return data[: random.integers(len(data))]
    if kind == 1:
        return flipped(data, random, int(random.integers(1, 6)))
    place = places[random.integers(len(places))]
    key = lines[place].split("=")[0].strip()
    if kind in (2, 3, 4, 5):
        lines[place] = f"{key} = {LITERALS[random.integers(len(LITERALS))]}"
    elif kind == 6:
        lines[place] = f"{key}x = 1"
    elif kind == 7:
        lines.insert(place, lines[random.integers(len(lines))])
    else:
        lines.pop(place)
    data = "\n".join(lines).encode()
    return (
        data + bytes(random.integers(0, 256, 4, dtype=np.uint8)) if random.random() < 0.05 else data
    )


def check_scenes(folder, number: int) -> int:
    """Try corrupted scene files; returns how many were refused."""
    random, refused = np.random.default_rng(7), 0
    texts = [_place_of(name)[0].read_text("utf-8") for name in scene_names()]
    path = folder / "scene.toml"
    for k in range(number):
        path.write_bytes(damaged_scene(texts[k % len(texts)], random))
        began = time.process_time()
        try:
            scene = load_scene(path)
            assert isinstance(scene, Scene)
            # A body that is merely large takes its time: only its description is of interest here.
            with np.errstate(over="ignore"):
                lower, upper = scene.body.bounds()
                points = np.prod((upper - lower) / np.float64(scene.spacing))
            # In space, cells that curved surfaces cut take their time too.
            if points < (3e4 if scene.dimension == 2 else 3e3) or points > 1e9:
                build_body(scene)
        except SceneError:
            refused += 1
        assert time.process_time() - began < SLOWEST, path.read_text("utf-8", "replace")
    return refused


def test_500_corrupted_scene_files(tmp_path):
    assert check_scenes(tmp_path, 500) > 250


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("spacing=1e-9", "points"),
        ("horizon_ratio=1e9", "horizon_ratio"),
        ("stretches=1e300", "stretches.0"),
        ("solver.largest_increment=1e-300", "largest_increment"),
        ("name='../../outside'", "name"),
        ("name='[/red]'", "name"),
        ("units.length='$\\\\frac'", "units.length"),
        ("units.length='[/red]'", "units.length"),
    ],
)
def test_scenes_that_would_fill_memory_or_write_elsewhere_are_refused(
    change, message, tmp_path, monkeypatch
):
    """A grid of 3e18 points, all pairs of a body, a step count past memory, names that are paths
    or markup: status 2 at once.
    """
    monkeypatch.chdir(tmp_path)
    began = time.process_time()
    done = commanded("run uniaxial --set", change, "--out", tmp_path / "out", status=2)
    assert message in done.stderr
    assert "Traceback" not in done.output
    assert time.process_time() - began < 10
    assert not [path for path in tmp_path.iterdir() if path.name != "out"]
