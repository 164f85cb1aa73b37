"""Shared by all tests: threads are bounded before numba starts, and seeds are fixed."""

import os

# The many processes that tests start shall not compile the package from its source, each anew,
# where the environment asks for that.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Threads beyond the free cores spin; two are enough to test that their number changes nothing.
# Torch and scikit-learn read OMP_NUM_THREADS.
os.environ.setdefault("NUMBA_NUM_THREADS", "2")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import importlib.util
import json
import signal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

import pdsurrogate as pds
from pdsurrogate.artifacts.card import checked_card
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.materials import (
    ArrudaBoyce,
    FullNetwork,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Polyconvex,
    Yeoh,
)

# A shell starts commands in the background with Ctrl-C ignored, and processes of tests would
# inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Kernels compile in the first example of a test; no deadline, and the same examples in every run.
settings.register_profile("project", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("project")

OWN_WARNINGS = (
    "engine.threads.ThreadsLostWarning",
    "engine.threads.ThreadsSpinWarning",
    "errors.OutsideDomainWarning",
    "run.run.Oversubscribed",
    "run.stages.SinglePrecisionLeft",
)


def pytest_configure(config):
    """Let the package's own RuntimeWarnings pass, which depend on the machine and the scene;
    others are errors, as pyproject.toml says.
    """
    for name in OWN_WARNINGS:
        config.addinivalue_line("filterwarnings", f"default::pdsurrogate.{name}")


DATA = Path(__file__).parent / "data"
SHIPPED = Path(__file__).parents[1] / "artifacts"

needs_torch = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("torch", "skorch")),
    reason='needs torch and skorch: pip install "pdsurrogate[torch]"',
)


def sealed(card: dict) -> str:
    """The text of a card with the digest of what it says now, as whoever edits one on purpose
    can make it.
    """
    found = checked_card({**card, "schema_version": 3, "digest": "0" * 64})
    return found.model_copy(update={"digest": found.found_digest()}).to_json()


PUBLIC_NAMES = [
    *pds.__all__,
    *(f"{room}.{name}" for room, names in vars(pds)["_IN_ROOMS"].items() for name in names.split()),
]


@pytest.fixture(autouse=True)
def one_thread():
    """Bind forces on one thread unless a test asks for more: two threads of each worker wait for
    each other on busy cores.
    """
    with thread_count(1):
        yield


@pytest.fixture
def random():
    return np.random.default_rng(20240109)


@pytest.fixture
def fem_uniaxial():
    return json.loads((DATA / "fem_uniaxial.json").read_text())


NEO_HOOKEAN = [NeoHookean(), NeoHookean(2.5, 25.0), NeoHookean(0.3, 3000.0)]

LAWS = [
    *NEO_HOOKEAN,
    Gent(),
    Gent(0.4, 40.0, 60.0),
    MooneyRivlin(0.7, 70.0, 0.3),
    Yeoh(0.34, 50.0),
    ArrudaBoyce(0.27, 54.0),
    Ogden(),
    Ogden(moduli=(0.5,), exponents=(2.0,), bulk_modulus=20.0),
    FullNetwork(0.3, 30.0),
    Polyconvex(
        moduli=(0.4,),
        exponents=(1.5,),
        first=(0.2, 0.02, 1e-4),
        second=(0.04, 1e-5),
        roots=(0.1, 0.2),
        second_logarithm=(0.05,),
    ),
]
"""Every property test of materials runs over these; all of them reach stretches of 4 in both
directions.
"""


def _title(law):
    return f"{law.name}-K/mu={law.bulk_modulus / law.shear_modulus:g}"


@pytest.fixture(params=LAWS, ids=_title)
def law(request):
    return request.param


@pytest.fixture(params=NEO_HOOKEAN, ids=_title)
def neo_hookean(request):
    return request.param


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A sheet of 3 x 1 cm, stretched along x1 about its left edge, which contracts to x2 = 0.5."""
    folder = tmp_path_factory.mktemp("sheet") / "out"
    scene = pds.load_scene("uniaxial", spacing=0.1, stretches=[1.2, 1.5])
    pds.simulate(scene, "neo-hookean").save(folder)
    return folder
