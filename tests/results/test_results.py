"""Result files, read back with the tools that users open them with."""

import errno
import os
import subprocess
import sys

import meshio
import numpy as np
import pytest
from commands import commanded, invoke
from refusals import raising
from stopping import at_level, interrupt

import pdsurrogate as pds
from pdsurrogate.results.folder import LOCK, FolderTaken, occupied
from pdsurrogate.run.simulate import SimulationInterrupted, simulate


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    result = simulate(pds.load_scene("uniaxial", spacing=0.1, stretches=[1.2, 1.5]), "neo-hookean")
    result.save(folder)
    return result, folder


def test_vtu_with_meshio(saved):
    result, folder = saved
    mesh = meshio.read(folder / "uniaxial-001.vtu")
    (cells,), fields = mesh.cells, {name: values for name, (values,) in mesh.cell_data.items()}
    assert cells.type == "quad"
    np.testing.assert_allclose(mesh.points[cells.data].mean(axis=1)[:, :2], result.body.points)
    np.testing.assert_array_equal(fields["displacement"][:, :2], result.displacement())
    stress = fields["stress"].reshape(-1, 3, 3)
    # Corners move with what is around them: those of the grips as far as the grips.
    assert np.ptp((mesh.points + mesh.point_data["displacement"])[:, 0]) == pytest.approx(
        1.5 * 3, rel=1e-4
    )
    assert stress[:, 0, 0] == pytest.approx(result.levels[1]["nominal_stress"], rel=1e-3)
    assert np.abs(stress[:, 1, 1]).max() < 1e-3
    assert fields["principal_stretch"] == pytest.approx(1.5, rel=1e-3)
    assert fields["volume_ratio"] == pytest.approx(1.00526, rel=1e-3)


def test_series_with_pyvista(saved):
    pyvista = pytest.importorskip("pyvista")
    result, folder = saved
    reader = pyvista.PVDReader(str(folder / "uniaxial.pvd"))
    assert list(reader.time_values) == [1.2, 1.5]
    reader.set_active_time_value(1.5)
    block = reader.read()[0]
    assert (
        block.field_data["stretch"],
        block.field_data["time"],
        block.field_data["run_time"],
    ) == (1.5, 0.0, 2.0)
    assert block.n_cells == len(result.body)
    warped = block.warp_by_vector("displacement")
    assert np.ptp(warped.bounds[:2]) == pytest.approx(1.5 * 3, rel=1e-4)


def uniaxial(*stretches, **changes):
    return pds.load_scene("uniaxial", {"spacing": 0.1, "stretches": list(stretches), **changes})


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("streamed", [True, False])
def test_a_run_clears_the_files_of_an_earlier_one_and_nothing_else(saved, tmp_path, streamed):
    """`pdsurrogate run uniaxial --out x` with three levels, then with one, left `uniaxial-001.vtu`
    beside a PVD of one entry.

    Before a run begins, so that it stands for itself however it ends; what is not a run's stays.
    """
    simulate(uniaxial(1.1), "analytic").save(tmp_path)
    for name in (
        "uniaxial-001.vtu",
        "uniaxial-007.vtu",
        "uniaxial-loading.png",
    ):  # as of an earlier version of the scene
        (tmp_path / name).write_bytes(
            (
                tmp_path / ("uniaxial.png" if name.endswith("png") else "uniaxial-000.vtu")
            ).read_bytes()
        )
    mine = ["notes.txt", "uniaxial-final.vtu", "uniaxial-1.vtu", "other-000.vtu", "picture.png"]
    for name in mine:
        (tmp_path / name).write_text("mine")
    result = simulate(uniaxial(1.1), "analytic", folder=tmp_path if streamed else None)
    if streamed:
        tables = ["convergence.csv", "history.csv", "summary.json"]
        assert names_in(tmp_path) == sorted(
            [*mine, *tables, "checkpoint.npz", "uniaxial-000.vtu", "uniaxial.pvd"]
        )
    result.save(tmp_path)
    ours = [
        "convergence.csv",
        "history.csv",
        "summary.json",
        "uniaxial-000.vtu",
        "uniaxial.png",
        "uniaxial.pvd",
    ]
    ours += ["checkpoint.npz"] * streamed
    assert names_in(tmp_path) == sorted(mine + ours)
    assert all((tmp_path / name).read_text() == "mine" for name in mine)
    # Once more: its own files are in nobody's way.
    result.save(tmp_path)
    assert len(result.states) == 1
    assert names_in(tmp_path) == sorted(mine + ours)


def test_results_of_another_run_of_the_scene_are_not_replaced_unasked(tmp_path):
    """`pdsurrogate run uniaxial --set stretches=[1.3] --out x` took the place of a run to 1.1
    without a word: names alone were compared.
    """
    found = simulate(uniaxial(1.1), "analytic", folder=tmp_path)
    found.save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for scene, force, difference in (
        (uniaxial(1.3), "analytic", r"stretches is \[1.1\] there and \[1.3\] here"),
        (uniaxial(1.1), "neo-hookean", "force is analytic there and neo-hookean@2 here"),
        (
            uniaxial(1.1, **{"material.bulk_modulus": 50.0}),
            "analytic",
            "material.bulk_modulus is 100.0 there and 50.0 here",
        ),
    ):
        refused = (
            rf"contains the results of another run of uniaxial \({difference}\); use another"
            r" folder, or --overwrite"
        )
        with raising(refused, FolderTaken):
            simulate(scene, force, folder=tmp_path)
        with raising(refused, FolderTaken):
            simulate(scene, force).save(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    read = pds.load_result(tmp_path)
    read.save(tmp_path)  # its states stay, which it reads from there
    assert read.displacement().shape == (300, 2)
    with raising(r"the result was read from files.*: copy"):
        read.save(tmp_path / "other")
    simulate(uniaxial(1.3), "analytic", folder=tmp_path, overwrite=True).save(tmp_path)
    assert pds.load_result(tmp_path).levels[0]["stretch"] == 1.3


def test_a_run_that_was_ended_before_its_time_is_not_replaced_unasked(tmp_path):
    """Its checkpoint may be worth hours; the same command without --resume took its place."""
    with pytest.raises(SimulationInterrupted) as stopped, at_level(1, interrupt):
        simulate(uniaxial(1.1, 1.2), "analytic", folder=tmp_path)
    for summary in (False, True):  # killed, and stopped by Ctrl-C
        if summary:
            stopped.value.result.save(tmp_path)
        with raising("continue it with --resume, or start again with --overwrite", FolderTaken):
            simulate(uniaxial(1.1, 1.2), "analytic", folder=tmp_path)
        with raising(r"uniaxial \(stretches is \[1.1, 1.2\] there and \[1.1\] here", FolderTaken):
            simulate(uniaxial(1.1), "analytic", folder=tmp_path)
    simulate(uniaxial(1.1, 1.2), "analytic", folder=tmp_path, resume=True).save(tmp_path)
    # now that it has come to its end
    assert len(simulate(uniaxial(1.1, 1.2), "analytic", folder=tmp_path).states) == 2


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("summary.json", "{}"),
        ("summary.json", '{"scene": "../x", "levels": []}'),
        ("history.csv", "year,price\n"),
        ("checkpoint.npz", "x"),
    ],
)
def test_files_that_no_run_wrote_are_not_replaced(saved, tmp_path, name, content):
    (tmp_path / name).write_text(content)
    for overwrite in (False, True):
        with raising("was not written by a run", FolderTaken):
            saved[0].save(tmp_path, overwrite)
        with raising("was not written by a run", FolderTaken):
            simulate(uniaxial(1.1), "analytic", folder=tmp_path, overwrite=overwrite)
    assert names_in(tmp_path) == [name]
    assert (tmp_path / name).read_text() == content


@pytest.mark.parametrize(
    "name",
    [
        "uniaxial-007.vtu",
        "uniaxial.png",
        "uniaxial-loading.png",
        "uniaxial.pvd",
        "history.csv",
    ],
)
def test_files_that_have_names_of_a_runs_own_are_left_and_refused(tmp_path, name):
    """They were deleted, without a word and without --overwrite."""
    scene = uniaxial(1.1)
    (tmp_path / name).write_text("t,price\n1,2\n")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for options in ({}, {"overwrite": True}):
        with raising(f"{name} was not written by a run and would be overwritten", FolderTaken):
            simulate(scene, "analytic", folder=tmp_path, **options)
    with raising(f"{name} was not written by a run", FolderTaken):
        simulate(scene, "analytic").save(tmp_path, overwrite=True)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_all_that_a_run_writes_is_known_again(tmp_path):
    """Pictures, states and their index."""
    scene = pds.load_scene(
        "tear",
        {
            **{
                "spacing": 0.25,
                "body.size": [2.0, 1.0],
                "precuts": [],
                "stretches": [1.1],
                "fracture.critical_stretch": 3.0,
            },
            **{"dynamics.stretch": 1.15, "dynamics.stretch_rate": 60.0, "dynamics.outputs": 2},
        },
    )
    for _ in range(2):
        simulate(scene, "analytic", folder=tmp_path).save(tmp_path)
    assert {"tear.png", "tear-loading.png", "tear.pvd", "tear-002.vtu"} <= set(names_in(tmp_path))
    meshio.read(tmp_path / "tear-002.vtu")


def test_the_same_folder_by_another_path_is_not_cleared(tmp_path, monkeypatch):
    """States that were written as they were reached are read from their files: they must not be
    removed to make room for themselves.
    """
    monkeypatch.chdir(tmp_path)
    result = simulate(uniaxial(1.1), "analytic", folder="out")
    result.save(tmp_path / "out")
    assert np.isfinite(result.displacement()).all()


def test_a_folder_holds_one_run_at_a_time(tmp_path):
    """Two runs in one folder mixed their files."""
    lock = tmp_path / LOCK
    with occupied(tmp_path):
        own, host, *_ = lock.read_text().split()
        assert own == str(os.getpid())
    lock.write_text(f"{os.getppid()}\n{host}\n")
    with raising(f"process {os.getppid()} on .* is writing a run to this folder", FolderTaken):
        simulate(uniaxial(1.2), "neo-hookean", folder=tmp_path)
    ended = invoke("run uniaxial --set spacing=0.1 --out", tmp_path)
    assert (ended.exit_code, names_in(tmp_path)) == (2, [LOCK])
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    # The last one began at another time: the system has given its number anew.
    for left in (f"{gone.pid}\n{host}\n", f"{os.getpid()}\n{host}\n1\n"):
        lock.write_text(left)
        with occupied(tmp_path), occupied(tmp_path):
            assert lock.read_text().split()[:2] == [own, host]
        assert names_in(tmp_path) == []
    lock.write_text("1\nanother.host\n")
    with raising(r"on another\.host", FolderTaken), occupied(tmp_path):
        pass


def test_a_folder_that_cannot_be_made_is_named(monkeypatch, tmp_path):
    """A temporary file was named in its place."""

    def refused(*arguments, **options):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), f"{options['dir']}/tmpabc")

    monkeypatch.setattr("tempfile.NamedTemporaryFile", refused)
    ended = commanded("run uniaxial --set spacing=0.1 --out", tmp_path / "some" / "where", status=2)
    assert (
        f"{tmp_path / 'some' / 'where'}: files cannot be created here ({tmp_path}" in ended.stderr
    )
    assert "tmpabc" not in ended.output


def test_results_need_a_folder(tmp_path):
    (tmp_path / "file").write_text("mine")
    for given in (str(tmp_path / "file"), os.devnull, ""):
        ended = commanded("run uniaxial --set spacing=0.1 --out", given, status=2)
        assert "folder" in ended.output
    assert (tmp_path / "file").read_text() == "mine"
