"""Derivatives of measurements of a result by parameters of its scene: checks of the names, and
warnings of errors.
"""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from ..forces import ForceModel
from ..forces.learned import Learned
from ..materials.covariance import numbers_of
from ..problem.program import stages_of
from ..results import Result
from ..results.sensitivity import Sensitivities
from ..scenes import Scene
from ..scenes.amplitudes import amplitude_of
from ..scenes.problems import suggestion
from ..scenes.reading import leaves
from ..solvers.equilibrium import NoEquilibrium
from .differentiated import STEP, differentiated
from .parameters import by_key, check_not_at_break, laws_of, numbers_in
from .reopened import check_intact, number_of_output
from .sensitivity import LEAST_EXACT, TINY, Jacobian, jacobian


def differentiate(
    scene: Scene,
    models: Sequence[ForceModel],
    result: Result,
    outputs: Sequence[str],
    parameters: Sequence[str],
    level: int,
) -> Sensitivities:
    """Return the derivatives of measurements of a result in equilibrium, see
    `Result.sensitivity`; `models` are those of its run.
    """
    loading = "stretch" if scene.stretched else "t"
    for what, names in (("outputs", outputs), ("parameters", parameters)):
        if isinstance(names, str) or not all(isinstance(name, str) for name in names):
            raise ValueError(
                f"{what}: must be a list of names such as ['nominal_stress'] or"
                f" ['material.shear_modulus'], not {names!r}"
            )
        check_not_at_break(names, what)
    number = number_of_output(scene, models, result, level, "sensitivity", "derivatives")
    control = [stage.control for stage in stages_of(scene) for _ in range(stage.outputs)][number]
    _check(scene, models, result, parameters, loading, control, number)
    at = result.levels[number][loading]
    if scene.remembers:
        from .followed import FollowedRun  # here, for few materials remember

        run = FollowedRun(scene, models)
        body = run.followed
    else:
        body = differentiated(scene, models)
    check_intact(body.system.problem, result, number, "derivatives")
    try:
        if scene.remembers:
            found = run.follow(outputs, parameters, number)[-1]
        else:
            found = jacobian(body, at, result.displacement(number), outputs, parameters, control)
    except NoEquilibrium as error:
        why = (
            ""
            if body.system.force.has_energy
            else f"; the forces of {models[0].name} have no energy: use bond-energy"
        )
        raise ValueError(f"sensitivity at {loading} {at:g}: {error}{why}") from None
    row = dict(leaves(result.levels[number]))
    values = body.numbers | {loading: at} | ({} if control is None else {control: row[control]})
    _warn_of_errors(found, row, [values[name] for name in parameters], parameters)
    return Sensitivities(
        found.names, tuple(parameters), found.values, found.derivatives, found.moved, found.errors
    )


def _warn_of_errors(
    found: Jacobian, row: Mapping[str, float], values: Sequence[float], parameters: Sequence[str]
) -> None:
    """Warn of parameters whose derivatives have estimated errors above `LEAST_EXACT` of the
    greatest one.

    Errors that would change measurements by less than `TINY` of the greatest one of their kind,
    where the parameter doubles, are rounding, as in measurements that vanish by symmetry. `row` has
    all measurements of the output, and `values` are those of the parameters.
    """
    sizes: dict[str, float] = {}
    for key, size in row.items():
        if isinstance(size, float):
            kind = key.split(".")[0]
            sizes[kind] = max(sizes.get(kind, 0.0), abs(size))
    rounding = TINY * np.array([sizes.get(name.split(".")[0], 0.0) for name in found.names])
    poor = []
    for name, value, column, errors in zip(
        parameters, values, found.derivatives.T, found.errors.T, strict=True
    ):
        greatest = float(np.abs(column).max(initial=0.0))
        off = errors[errors * abs(value) > rounding].max(initial=0.0)
        if off > LEAST_EXACT * greatest:
            poor.append(f"{name} ({off / greatest:.0e})" if greatest else name)
    if poor:
        bound = f"{LEAST_EXACT:g} of the greatest derivative"
        warnings.warn(
            f"sensitivity: errors of the derivatives are estimated as more than {bound} by"
            f" {', '.join(poor)}",
            stacklevel=4,
        )


def _check(
    scene: Scene,
    models: Sequence[ForceModel],
    result: Result,
    parameters: Sequence[str],
    loading: str,
    control: str | None,
    number: int,
) -> None:
    """Check the parameters of `Result.sensitivity` at an output of a step with the key `control`
    of a displacement, or None.
    """
    if control is not None and loading in parameters:
        raise ValueError(
            f"parameters: {loading} is an unknown of a step that controls {control}: differentiate"
            f" by {control!r}, and name {loading!r} as an output"
        )
    if scene.remembers and loading in parameters:
        raise ValueError(
            f"parameters: {loading} changes with time, and with branches or softening the body"
            " depends on its whole course: name other numbers"
        )
    if not scene.stretched and loading in parameters:
        _check_smooth(scene, result.levels[number][loading])
    known = numbers_in(scene, models)
    ours = loading if control is None else control
    if control is not None:  # what else moves with t is refused by the scene
        known = {name: value for name, value in known.items() if not name.startswith("prescribed")}
    if not parameters:
        raise ValueError(
            f"parameters: name at least one number to differentiate by, such as {ours!r} or"
            " 'material.shear_modulus'"
        )
    for name in parameters:
        if name not in known and name != ours:
            _check_of_laws(scene, models, name)
            raise ValueError(
                f"parameters: there is no number {name!r} to differentiate by;"
                f" {suggestion(name, [*known, ours])}"
            )


def _check_smooth(scene: Scene, t: float) -> None:
    """Raise ValueError if an amplitude has different derivatives before and after t, which is
    not the end of the scene.
    """
    step = STEP * max(t, 1.0)
    if t + step > scene.steps[-1].to:
        return
    for kind in ("prescribed", "loads", "obstacles"):
        for number, entry in enumerate(getattr(scene, kind)):
            behind, here, ahead = (
                amplitude_of(entry.amplitude)(time) for time in (t - step, t, t + step)
            )
            before = (here - behind) / step
            after = (ahead - here) / step
            if abs(after - before) > 1e-3 * max(abs(before), abs(after), 1e-3):
                raise ValueError(
                    f"parameters: {kind}.{number}.amplitude has a kink at t = {t:g}, with the"
                    f" derivatives {before:.4g} before and {after:.4g} after it, so that there is"
                    " no derivative by t: take an output at another t"
                )


def _check_of_laws(scene: Scene, models: Sequence[ForceModel], name: str) -> None:
    """Raise ValueError if a name is that of a number of a law, which is no parameter."""
    for key, law in laws_of(scene).items():
        model = by_key(models, "material")[key]
        number = name.removeprefix(f"{key}.")
        if name == f"{key}.{number}" and number in numbers_of(law):
            learned = (
                f"{model.name} describes one value of {number} alone: for derivatives by {name} run"
                " the scene with force="
            )
            why = (
                f"{learned}{model.exact}"
                if isinstance(model, Learned)
                else f"{name} is 0, so that {law.name} has no such term"
            )
            raise ValueError(f"parameters: {why}")
