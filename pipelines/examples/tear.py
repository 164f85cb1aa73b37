"""A sheet with a cut is torn: equilibrium, then the crack in dynamics, its energies, a page with everything.

A notebook as a script: cells begin with ``# %%``.  The built-in scene ``tear`` at spacing 0.02 takes minutes; this is a coarse one.
"""

# %%
from pathlib import Path

import pdsurrogate as pds
from pdsurrogate.results.drawings import html_page

changes = {"spacing": 0.25, "stretches": [1.1, 1.2], "fracture.critical_stretch": 2.0}
changes |= {"dynamics.stretch": 1.5, "dynamics.stretch_rate": 20.0, "dynamics.viscosity": 5e-5, "dynamics.outputs": 6}
scene = pds.load_scene("tear", changes)
pds.preview(scene).savefig("tear-scene.png")

# %%
result = pds.simulate(scene, "bond-energy", folder="tear")
result.save("tear")
crack = result.summary["crack"]
print("first bond broken at stretch", crack["start"]["stretch"], "at", crack["start"]["x"], "- in all:", crack["broken_bonds"])

# %% Work of the grips is strain, motion, what damping took and what the crack released.
rows = [row for row in result.history if "time" in row]
first, last = rows[0], rows[-1]
parts = ("strain_energy", "kinetic_energy", "damped_energy", "released_energy")
gap = last["work"] - sum(last[part] - first[part] for part in parts)
print("the account is open by", abs(gap) / last["work"])

# %%
saved = pds.load_result("tear")
saved.plot("damage").savefig("damage.png")
Path("tear.html").write_text(html_page(saved, ["damage"]))
