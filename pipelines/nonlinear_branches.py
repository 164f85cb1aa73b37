"""Whether relaxation times that fall with the overstress describe cycles better than constant ones.

python pipelines/nonlinear_branches.py          fits both
python pipelines/nonlinear_branches.py --docs   puts the table into the documentation
"""

import numpy as np
from cases import of_rows, report
from histories import CASES, cycles

from pdsurrogate.identification import HistoryRegressor

TRIED = [
    *(("VHB 4910", "", *parts) for parts in CASES),
    *(("VHB 4905", f"{one} C", "4.0 at 0.05") for one in (0, 40, 80)),
    *(("VHB 4905", f"{one} C", "4.0 at 0.1") for one in (0, 40, 80)),
]


def compared(material, of, *parts):
    """RMS errors of curves that are fitted and kept back, with constant and with falling times."""
    data, names = cycles(material, of)
    X, y = data.histories(), data.nominal_stress
    left_out = np.array([any(part in name for part in parts) for name in names])
    numbers = np.unique(data.curve)
    kept = left_out[numbers]
    known = ~left_out[data.curve]
    errors = []
    for falling in (False, True):
        model = HistoryRegressor("energy", 2, falling_times=falling)
        model.fit(X[known], y[known])
        off = model.predict(X) - y
        rms = [
            100 * np.sqrt((off[rows] ** 2).mean()) / np.abs(y[rows]).max()
            for rows in (data.curve == one for one in numbers)
        ]
        rms = np.array(rms)
        errors.append((float(np.sqrt((rms[~kept] ** 2).mean())), rms[kept].tolist()))
    (constant, left), (falling, left_of_falling) = errors
    powers = [
        value
        for name, value in zip(model.parameter_names_, model.parameters_, strict=True)
        if name.startswith("time_power")
    ]
    name = f"{material} {of}".strip()
    yield name, ", ".join(parts), constant, falling, left, left_of_falling, powers


if __name__ == "__main__":
    titles = ("fitted (%): .2f", "falling: .2f", "kept back (%): .1f", "falling: .1f")
    report(
        __doc__,
        of_rows(
            "nonlinear-branches",
            compared,
            TRIED,
            *("material", "kept back", *titles, "powers: .2g"),
        ),
    )
