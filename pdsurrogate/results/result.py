"""Result of a simulation: access to its fields and tables, writing to a folder, and reading from
a folder.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from ..arguments import check_path
from ..body import Body, CellMesh
from ..materials.covariance import LawCovariance
from ..scenes import Scene
from .contents import contents_in
from .folder import CONVERGENCE, DONE, FAILED, HISTORY, SUMMARY, claim, occupied, read_summary
from .lowest_mode import LowestMode
from .measures import values_of
from .sensitivity import Sensitivities
from .states import States, StatesInFiles, deformed_cells
from .tables import column_unit, facts, html_history, read_table, write_tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(repr=False)
class Result:
    """Result of a simulation: its summary, history, convergence, and fields on the points in every
    recorded state.

    Parameters
    ----------
    scene : Scene
        Scene as it ran.
    body : Body or None
        None for a result that was read from files.
    summary : dict
        Content of ``summary.json``: names and digests of the inputs, size, convergence, cost,
        ``levels``, scene as run and provenance.
    history : list of dict
        Rows of ``history.csv``, whose headers add units to these names: a row for every output in
        equilibrium, and for every few steps of dynamics.
    states : States
        A pair for every output of the run, in equilibrium or in dynamics: its
        `pdsurrogate.results.states.Moment` (stretch or loading parameter, and time) and a
        dictionary of its fields on the points, see `pdsurrogate.results.measures.POINT_FIELDS`.
        Each output also has an entry in `levels`; only outputs in the dynamics of a body between
        grips have none.
    convergence : list of dict
        Rows of ``convergence.csv``: residual and energy through the search for equilibrium, and
        increments that failed.
    differentiated, uncertain, resisting : callable, optional
        Functions of the run behind `sensitivity`, `standard_errors` and `lowest_mode`, with its
        scene and force; None for a result that was read from files.

    See Also
    --------
    pdsurrogate.simulate : runs a scene and returns its result.
    pdsurrogate.load_result : reads a result from the folder of a run.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> result = pds.simulate(
    ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
    ... )
    >>> result
    <Result of uniaxial with neo-hookean@2: 48 points, 1 state>
    >>> print(round(result.history[-1]["force_right_1"], 3))
    1.05
    """

    scene: Scene
    body: Body | None
    summary: dict
    history: list[dict] = dataclasses.field(default_factory=list)
    states: States = dataclasses.field(default_factory=States)
    convergence: list[dict] = dataclasses.field(default_factory=list)
    differentiated: Callable[..., Sensitivities] | None = dataclasses.field(
        default=None, compare=False
    )
    uncertain: Callable[..., dict[str, float]] | None = dataclasses.field(
        default=None, compare=False
    )
    resisting: Callable[..., LowestMode] | None = dataclasses.field(default=None, compare=False)

    @property
    def levels(self) -> list[dict]:
        """Measured quantities, such as stress or forces, at every level: a stretch between grips,
        or an output of the loading steps.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=[1.2, 1.5]), "neo-hookean"
        ... )
        >>> [level["stretch"] for level in result.levels]
        [1.2, 1.5]
        """
        return self.summary["levels"]

    @property
    def status(self) -> str:
        """Status of the run: "done", "failed", "interrupted", or "running", which also remains
        after a run is killed.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... ).status
        'done'
        """
        return self.summary.get("status", DONE if self.summary.get("converged", True) else FAILED)

    def displacement(self, level: int = -1) -> np.ndarray:
        """Return the displacements of the points in one state.

        Parameters
        ----------
        level : int
            Number of the state, from 0; the last one by default.

        Returns
        -------
        ndarray, shape (n, d)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... )
        >>> result.displacement().shape
        (48, 2)
        """
        return self._fields(level)["displacement"][:, : self.scene.dimension]

    def sensitivity(
        self, outputs: Sequence[str], parameters: Sequence[str], level: int = -1
    ) -> Sensitivities:
        """Return derivatives of measurements in equilibrium with respect to parameters of the
        scene.

        The equilibrium is first solved to a residual of 1e-10. Each parameter then costs one
        solution of linear equations with the tangent, some 15 to 40 force evaluations, and fewer
        for parameters that act like earlier ones. If there are fewer measurements than parameters,
        each measurement costs such a solution instead (adjoint), provided that the tangent is
        symmetric and that the measurements are reactions of supports, the nominal stress, the
        energy, or displacements of probes. The derivatives are those of the discrete body (theory,
        section 23). A warning names parameters for which an estimated error exceeds 1e-6 of the
        greatest derivative.

        In a step with ``control`` the controlled displacement is given, and the factor t of the
        loads is an unknown: derivatives keep this displacement, ``"t"`` can be an output, and the
        displacement, such as ``"probes.tip.displacement.0"``, is a parameter in place of t.

        With branches or softening the run is repeated, and every increment up to the output is
        differentiated (theory (100a)); the loading parameter is then no parameter.

        Parameters
        ----------
        outputs : sequence of str
            Measurements: dotted keys of an entry of `levels`, such as ``"nominal_stress"``,
            ``"forces.right.0"`` or ``"probes.tip.displacement"``; a key that is continued in
            several entries stands for all of them. ``"probes.tip.u2"`` is the second component of
            the displacement of a probe, ``"probes.tip.displacement.1"``.
        parameters : sequence of str
            Dotted keys of numbers in the scene's ``material``, ``materials``, ``loads``,
            ``prescribed`` or ``obstacles``, such as ``"material.bulk_modulus"`` or
            ``"loads.0.pressure"``; the loading parameter, ``"stretch"`` or ``"t"``; or numbers in
            the arrays of a learned model's payload, with indices from 0:
            ``"force.output_weights.3"``, ``"force.coefficients.0.2.1"``, and for the model of a
            region ``"materials.0.force.output_weights.3"``. Coefficients of energies fitted to
            tests are parameters of their law, such as ``"material.moduli.2"``.
        level : int
            Number of the output, from 0; the last one by default.

        Returns
        -------
        Sensitivities

        Raises
        ------
        IndexError
            If there is no such output.
        ValueError
            If the result was read from files or has several ranks; if an output or a parameter is
            unknown; if the force model has no double precision; if the output is one of dynamics,
            or has broken bonds; or if its tangent is nearly singular.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("uniaxial", spacing=0.25, stretches=1.5)
        >>> found = pds.simulate(scene, "bond-energy").sensitivity(
        ...     ["nominal_stress"], ["material.shear_modulus", "stretch"]
        ... )
        >>> found.derivatives.round(3)
        array([[1.044, 1.577]])
        """
        return _simulated("sensitivity", self.differentiated)(self, outputs, parameters, level)

    def standard_errors(
        self, outputs: Sequence[str], covariance: LawCovariance | None = None, level: int = -1
    ) -> dict[str, float]:
        """Return standard errors of measurements in equilibrium that follow from the covariance of
        the law (delta method, theory (86)).

        They are first-order: derivatives of the measurements by the numbers of the law, as from
        `sensitivity`, times the covariance. In them is the uncertainty of the measurements to which
        the law was fitted, but neither an unsuitable form of the law nor the discretization error
        of this simulation. The derivatives of a surrogate by the law are those of the exact force
        of its law.

        Parameters
        ----------
        outputs : sequence of str
            Measurements, as for `sensitivity`.
        covariance : LawCovariance, optional
            As from `pdsurrogate.SceneRegressor.law_covariance`. By default that of each artifact of
            the run that was fitted to measurements; materials without one are taken as certain, and
            the tests of different artifacts as independent.
        level : int
            Number of the output, from 0; the last one by default.

        Returns
        -------
        dict of float
            Standard error of each measurement, by the names of `Sensitivities.outputs`, in its
            unit.

        Raises
        ------
        IndexError
            If there is no such output.
        ValueError
            If there is no covariance, or it belongs to another law than those of the scene; or as
            for `sensitivity`.

        See Also
        --------
        pdsurrogate.Result.sensitivity : derivatives of the same measurements.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.materials.NeoHookean(0.4, 40.0)
        >>> covariance = pds.materials.LawCovariance(law, ("shear_modulus",), [[0.01**2]])
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5, material=law), "bond-energy"
        ... )
        >>> {
        ...     name: round(error, 4)
        ...     for name, error in result.standard_errors(["nominal_stress"], covariance).items()
        ... }
        {'nominal_stress': 0.0104}
        """
        return _simulated("standard_errors", self.uncertain)(self, outputs, covariance, level)

    def lowest_mode(self, level: int = -1) -> LowestMode:
        """Return the displacement that the body resists least in an equilibrium, with its
        stiffness, which tells whether it is stable.

        It is the mode of the least eigenvalue of the tangent, weighted by the volumes of the points
        (theory (83a)). Supports and loads are those of the output: at given loads, an equilibrium
        beyond a limit load is not stable. A search costs some hundred to a thousand force
        evaluations.

        Parameters
        ----------
        level : int
            Number of the output, from 0; the last one by default.

        Returns
        -------
        LowestMode

        Raises
        ------
        IndexError
            If there is no such output.
        ValueError
            If the result was read from files or has several ranks; if the force or a load has no
            energy, or the force no double precision; if the scene has rigid regions or supports
            between points; if the output is one of dynamics or has broken bonds; or if the search
            does not converge.

        See Also
        --------
        pdsurrogate.Result.sensitivity : derivatives of an equilibrium.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "bond-energy"
        ... )
        >>> mode = result.lowest_mode()
        >>> round(mode.eigenvalue, 3), mode.stable, mode.displacements.shape
        (0.781, True, (48, 2))
        """
        return _simulated("lowest_mode", self.resisting)(self, level)

    def save(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write ``summary.json``, ``history.csv``, ``convergence.csv``, a VTU series with its PVD
        index, and pictures.

        Every file is written whole, and the summary last; its ``status`` states how the run ended.
        Earlier results of the same scene and force in the folder are removed first.  If the
        simulation itself was run with this folder, its states are there already.

        Parameters
        ----------
        folder : str or path
            Folder of the results, which is made if there is none.
        overwrite : bool
            Whether to remove the results of other runs as well.

        Raises
        ------
        FolderTaken
            If the folder holds results of another run or, without a run, a file with the name of a
            result, or a run is writing there.
        ValueError
            If the result was read from another folder.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> import pdsurrogate as pds
        >>> folder = tempfile.mkdtemp()
        >>> pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... ).save(folder)
        >>> (Path(folder) / "summary.json").exists()
        True
        """
        folder = Path(folder)
        with occupied(folder):
            streamed = (
                isinstance(self.states, StatesInFiles)
                and self.states.folder.resolve() == folder.resolve()
            )
            if not streamed:
                if self.body is None or contents_in(self.summary) is None:
                    raise ValueError(
                        "the result was read from files, so there is nothing to save: copy the"
                        f" files to {folder}"
                    )
                claim(folder, self.summary, overwrite)
                written = StatesInFiles(folder, self.scene.name, self.body)
                for number in range(len(self.states)):
                    moment, fields = self.states[number]
                    written.append(moment, [fields])
            if self.states:
                _drawings().save_drawings(self, folder)
            write_tables(folder, self.summary, self.history, self.convergence, self.scene.units)

    def figure(self) -> Figure:
        """Return a figure of the deformed body at its outputs, colored by the displacement across
        the loaded direction.

        Runs with more than four outputs are shown at four of them; steps are colored by the
        magnitude of the displacement, and dynamics with fracture by damage. A solid is shown from
        outside.

        Returns
        -------
        matplotlib.figure.Figure

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... )
        >>> type(result.figure()).__name__
        'Figure'
        """
        return _drawings().whole_figure(self)

    def cells(self, level: int = -1) -> tuple[CellMesh, np.ndarray]:
        """Return the cells of the body in one state.

        Along open cracks the nodes are duplicated, so that the cells on the two sides are separate.

        Parameters
        ----------
        level : int
            Number of the state, from 0; the last one by default.

        Returns
        -------
        cells : CellMesh
            Cell around each point.
        displacements : ndarray, shape (k, d)
            Displacements of the nodes of the cells.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... )
        >>> cells, displacements = result.cells()
        >>> len(cells), displacements.shape
        (48, (65, 2))
        """
        return (
            self.states.cells(level)
            if self.body is None
            else deformed_cells(self.body, self._fields(level))
        )

    def field(self, name: str, level: int = -1) -> np.ndarray:
        """Return the values of a field on the points in one state.

        Parameters
        ----------
        name : str
            One of `field_names`, with the indices of a component appended if desired:
            ``stress_22``, ``displacement_1``.
        level : int
            Number of the state, from 0; the last one by default.

        Returns
        -------
        ndarray, shape (n,), (n, 3) or (n, 3, 3)

        Raises
        ------
        ValueError
            If the state has no such field, or the field no such component.
        IndexError
            If there is no such state.

        See Also
        --------
        pdsurrogate.Result.field_names : names of the fields.
        pdsurrogate.Result.plot : draws a field.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("uniaxial", spacing=0.25, stretches=1.5)
        >>> result = pds.simulate(scene, "neo-hookean")
        >>> result.field("stress").shape
        (48, 3, 3)
        >>> print(result.field("stress_11").mean().round(3))
        1.05
        """
        return values_of(self._fields(level), name)

    def field_names(self, level: int = -1) -> list[str]:
        """Return the names of the fields of one state; docs/reference/summary.md defines the
        fields.

        Parameters
        ----------
        level : int
            Number of the state, from 0; the last one by default.

        Returns
        -------
        list of str

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... )
        >>> "displacement" in result.field_names()
        True
        """
        return list(self._fields(level))

    def _fields(self, level: int) -> Mapping[str, np.ndarray]:
        if not -len(self.states) <= level < len(self.states):
            there = f"there are 0 to {len(self.states) - 1}" if self.states else "there are none"
            raise IndexError(f"level {level}: the result has no such output; {there}")
        return self.states[level][1]

    def plot(
        self,
        field: str = "displacement",
        level: int = -1,
        limits: tuple[float, float] | None = None,
    ) -> Figure:
        """Return a figure of the deformed body in one state, colored by a field.

        Parameters
        ----------
        field : str
            Field or component as for `field`; a vector is shown by its length.
        level : int
            Number of the state, from 0; the last one by default.
        limits : tuple of float, optional
            Values at the ends of the scale of colors; by default the least and the greatest value.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ValueError, IndexError
            If there is no such field or state, or the field is a tensor and no component is named.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
        ... )
        >>> type(result.plot("stress_11")).__name__
        'Figure'
        """
        self._fields(level)
        return _drawings().states_figure(self, field, [range(len(self.states))[level]], limits)

    def table(self):
        """Return the history as a table: steps, loading parameter, forces and displacements where
        the body is held or loaded, energies.

        Returns
        -------
        pandas.DataFrame or list of dict
            A DataFrame with the units in ``.attrs["units"]`` if pandas is installed; otherwise the
            rows, as in `history`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=[1.2, 1.5]), "neo-hookean"
        ... )
        >>> len(result.table())
        2
        """
        try:
            import pandas
        except ImportError:
            return [dict(row) for row in self.history]
        table = pandas.DataFrame(self.history)
        table.attrs["units"] = {
            column: unit
            for column in table.columns
            if (unit := column_unit(column, self.scene.units))
        }
        return table

    def __repr__(self) -> str:
        summary = self.summary
        end = "" if self.status == DONE else f", {self.status}"
        return (
            f"<Result of {summary['scene']} with {summary['force']}: {summary['n_points']} points,"
            f" {len(self.states)} state{'' if len(self.states) == 1 else 's'}{end}>"
        )

    def _repr_html_(self) -> str:
        return facts(self) + html_history(self.history[-5:], self.scene.units, without="moment_")

    def loading_figure(self) -> Figure:
        """Return a figure of nominal stress against stretch if grips load the body, otherwise of
        forces, or of displacements if no motion is prescribed, against the loading parameter t or
        the time.

        Returns
        -------
        matplotlib.figure.Figure

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> result = pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=[1.2, 1.5]), "neo-hookean"
        ... )
        >>> type(result.loading_figure()).__name__
        'Figure'
        """
        return _drawings().loading_figure(self)


def _simulated(name: str, function: Callable | None) -> Callable:
    """Return a function of a run; raise ValueError if a result has none."""
    if function is None:
        raise ValueError(
            f"{name}: a result that was read from files has no force model: call it on the result"
            " of pds.simulate"
        )
    return function


def _drawings():
    """Return the module `drawings`, imported on first use because it loads matplotlib, which a
    simulation does not need.
    """
    from . import drawings

    return drawings


def load_result(folder: str | Path) -> Result:
    """Return the result of a run from the folder in which it was saved; of an unfinished or killed
    run, the states that it reached.

    Parameters
    ----------
    folder : str or path

    Returns
    -------
    Result
        Result that reads its states from their files on access; its `body` is None, and points are
        in the field ``position``.

    Raises
    ------
    FileNotFoundError
        If the folder holds no result.
    ValueError
        If the result is damaged, or was saved by a version that did not keep the scene.

    See Also
    --------
    pdsurrogate.simulate : runs a scene, and writes its result to a folder if one is given.

    Examples
    --------
    >>> import tempfile
    >>> import pdsurrogate as pds
    >>> folder = tempfile.mkdtemp()
    >>> pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean").save(
    ...     folder
    ... )
    >>> pds.load_result(folder)
    <Result of uniaxial with neo-hookean@2: 48 points, 1 state>
    """
    check_path(folder, "folder")
    folder = Path(folder)
    summary = read_summary(folder)
    if summary is None:
        raise FileNotFoundError(
            f"{folder}: not a folder with results of a run (no valid {SUMMARY} found)"
        )
    if "scene_as_run" not in summary:
        raise ValueError(
            f"{folder / SUMMARY}: it was written by an older version and does not contain the"
            " scene: run the scene again"
        )
    name = summary["scene"]
    try:
        scene = Scene.model_validate(summary["scene_as_run"])
        states = (
            StatesInFiles.saved(folder, name, summary.get("states"))
            if (folder / f"{name}.pvd").exists()
            else States()
        )
        history, convergence = (read_table(folder / table) for table in (HISTORY, CONVERGENCE))
    except (ValueError, KeyError, TypeError, OSError, ElementTree.ParseError) as error:
        raise ValueError(
            f"{folder}: the result cannot be read: {' '.join(str(error).split())}"
        ) from None
    return Result(scene, None, summary, history, states, convergence)
