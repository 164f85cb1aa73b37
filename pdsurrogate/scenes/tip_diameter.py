"""Effective crack-tip diameters in horizons, measured in simulated tears, by family of force model, plane and horizon/spacing."""

TIP_DIAMETER = 1.15
"""Effective diameter of a crack tip, in horizons, in sheets whose bonds have forces and no energy.

The diameter is the energy release rate at which a crack runs, divided by the uniaxial energy density at the critical stretch.  It was
measured in the tear scene at spacings of 0.02 to 0.05 cm, between 1.11 and 1.22 (`pipelines/reproduce_paper.py`), and gives the peak of a
strip in pure shear within 7 % at horizons of 2.2 to 4.2 spacings."""

TIP_DIAMETERS = (
    ("bond force", "stress", (2.2, 4.2), TIP_DIAMETER),
    ("bond energy", "space", (1.75, 1.75), 1.2),
    ("bond energy", "space", (2.2, 2.2), 0.83),
)
"""Diameters that were measured: family of the force models, plane, least and greatest ratio of horizon to spacing, diameter in horizons.

In three dimensions the diameter at a horizon of 2.2 spacings is from trouser tears at a spacing of 2/3 mm, 0.82 and 0.84; tears at another
spacing, and with another critical stretch, are predictions.  The diameter at 1.75 spacings is the mean of 1.29 and 1.13, of tears at two
spacings (`docs/validation/cracks-in-space.md`).  A sheet by `bond-energy` tears at 8 to 23 % less than a diameter of 1.15 would give, so
it is not in the table.  See `pdsurrogate.critical_stretch_of`."""


def tip_diameter(plane: str, horizon_ratio: float, family: str | None = None) -> float:
    """Return the effective diameter of a crack tip, in horizons, as measured in simulated tears.

    The diameter is the energy release rate at which a crack runs, divided by the uniaxial energy density at the critical stretch.

    Parameters
    ----------
    plane : str
        "stress", "strain" or "space".
    horizon_ratio : float
        Horizon divided by the spacing of the points.
    family : str, optional
        Family of the force model, see `pdsurrogate.forces.ForceModel`; by default any family: the first entry of
        `TIP_DIAMETERS` for this plane and ratio.

    Raises
    ------
    ValueError
        If no diameter was measured for these arguments; the message lists the measured cases.
    """
    for known, state, (least, greatest), diameter in TIP_DIAMETERS:
        if state == plane and family in (None, known) and least - 1e-9 <= horizon_ratio <= greatest + 1e-9:
            return diameter
    ratios = [" to ".join(dict.fromkeys(f"{ratio:g}" for ratio in measured)) for _, _, measured, _ in TIP_DIAMETERS]
    entries = zip(TIP_DIAMETERS, ratios, strict=True)
    there = "; ".join(f"{known}, plane={state}, horizon_ratio {ratio}" for (known, state, *_), ratio in entries)
    here = f"{'' if family is None else f'{family}, '}plane={plane}, horizon_ratio {horizon_ratio:g}"
    limited = f"for which the diameter of a crack tip was calibrated ({there}), not for {here}"
    raise ValueError(f"fracture.energy is available only in cases {limited}; set fracture.critical_stretch instead")
