"""Errors and warnings of force models and their compilation, which commands handle before they
load any force model.
"""


class CompilerSwitchedOff(RuntimeError):
    """Error raised because numba does not compile: the environment variable NUMBA_DISABLE_JIT
    switches it off.
    """


class OutsideDomain(RuntimeError):
    """Error: bonds are outside the training domain of a surrogate, and the policy
    ``outside="raise"`` is to stop.

    See Also
    --------
    pdsurrogate.ForceSettings : policies outside the domain.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> scene = pds.load_scene("uniaxial", {"outside": "raise", "spacing": 0.1, "stretches": [4.0]})
    >>> try:
    ...     pds.simulate(scene, "neo-hookean")
    ... except pds.SimulationFailed as failed:
    ...     print(isinstance(failed.__cause__, pds.forces.OutsideDomain))
    True
    """


class OutsideDomainWarning(RuntimeWarning):
    """Warning: bonds are outside the training domain of a surrogate, whose values there are
    extrapolated.

    See Also
    --------
    pdsurrogate.ForceSettings : policies outside the domain.

    Examples
    --------
    >>> import warnings, pdsurrogate as pds
    >>> warnings.simplefilter("error", pds.forces.OutsideDomainWarning)
    """


class InvalidState(RuntimeError):
    """Error: a deformation has no force, because of det F <= 0, a limit of the material law passed,
    or numbers that are not finite.

    Examples
    --------
    >>> import numpy as np, pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.1, 0.315)
    >>> force = pds.AnalyticBondForce().bind(body, pds.materials.NeoHookean(), pds.ForceSettings())
    >>> try:
    ...     force(body.points * [-1.0, 1.0], np.empty_like(body.points))
    ... except pds.forces.InvalidState as error:
    ...     print("turned inside out" in str(error))
    True
    """
