"""Mesh files: sets of decks and groups of gmsh files against counts by gmsh, or by hand."""

import math
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from described import SCENES
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.decks import files_of, read_deck
from pdsurrogate.discretization.mesh_facts import describe_mesh
from pdsurrogate.discretization.mesh_files import read_mesh
from pdsurrogate.results import figures, measured
from pdsurrogate.results.contents import digest_of_mesh

MESHES = Path(__file__).parents[1] / "data" / "meshes"

STRIP = "*NODE, NSET=every\n" + "".join(
    f"{10 * row + column + 1}, {column}., {row}.\n" for row in (0, 1) for column in range(5)
)
"""Nodes 1 to 5 along the bottom, 11 to 15 along the top of four squares."""


def square(number):
    return f"{number}, {number}, {number + 1}, {number + 11}, {number + 10}\n"


FOUR = "*ELEMENT, TYPE=CPS4\n" + "".join(map(square, (1, 2, 3, 4)))


def mesh_of_text(folder, text, dimension=2, parts=None):
    """The mesh of a deck with a text, and the warnings when it is read."""
    path = folder / "deck.inp"
    path.write_text(text)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = read_mesh(str(path), dimension, parts, ((text.__hash__(), 0),))
    return mesh, [str(each.message) for each in told]


def cells_of(mesh):
    return {name: members.tolist() for name, members in mesh.groups_of_cells().items()}


@pytest.mark.parametrize(
    ("name", "dimension", "counts"),
    [
        (
            name,
            2,
            {
                "all": (28, 0, 21),
                "right half": (14, 0, 12),
                "left": (2, 2, 3),
                "outline": (12, 12, 12),
            },
        )
        for name in ("plate.msh", "plate-2.2.msh", "plate.inp")
    ]
    + [
        # the corners alone of 61, 33, 5 and 24 nodes
        (
            "plate-second-order.inp",
            2,
            {"all": (12, 0, 19), "right half": (6, 0, 11), "left": (2, 2, 3)},
        ),
        (
            "block.inp",
            3,
            {
                "all": (16, 0, 45),
                "upper part": (8, 0, 27),
                "floor": (4, 4, 9),
                "lid": (4, 4, 9),
                "both": (8, 8, 18),
            },
        ),
    ],
)
def test_groups_of_gmsh_files_have_the_elements_and_nodes_that_gmsh_counts(name, dimension, counts):
    found = describe_mesh(MESHES / name)
    rows = {row["group"].replace("_", " "): row for row in found.groups()}
    assert {
        group: (rows[group]["cells"], rows[group]["sides"], rows[group]["nodes"])
        for group in counts
        if group != "outline"
    } == {group: count for group, count in counts.items() if group != "outline"}
    if "outline" in counts:
        # a cell at a corner has two of the 12 lines
        assert (rows["outline"]["sides"], rows["outline"]["nodes"]) == (12, 12)
    summary = found.summary()
    assert summary["dimension"] == dimension
    assert summary["volume" if dimension == 3 else "area"] == pytest.approx(2.0)
    assert summary["upper"] == ([2.0, 1.0] if dimension == 2 else [1.0, 1.0, 2.0])
    assert found.remarks == ()


def test_the_spacing_of_a_mesh_is_that_of_its_body(tmp_path):
    """Of a square of side 1 and a rectangle of area 4: the mean of 1 and 2 with weights 1 and 4."""
    places = "1, 0., 0.\n2, 1., 0.\n3, 5., 0.\n11, 0., 1.\n12, 1., 1.\n13, 5., 1.\n"
    path = tmp_path / "graded.inp"
    path.write_text(f"*NODE\n{places}*ELEMENT, TYPE=CPS4\n{square(1)}{square(2)}")
    assert describe_mesh(path).summary()["spacing"] == pytest.approx(9 / 5)


def test_a_file_whose_groups_cannot_be_told_apart_is_refused():
    with raising(r"same-name\.msh: two physical groups are named all"):
        describe_mesh(MESHES / "same-name.msh")


@pytest.mark.parametrize("case", SCENES["sets of a deck"])
def test_sets_of_a_deck_as_abaqus_and_calculix_define_them(tmp_path, case):
    found, expected = cells_of(mesh_of_text(tmp_path, STRIP + case["text"])[0]), case["expected"]
    assert found.pop("every") == [0, 1, 2, 3]
    assert {name: found[name] for name in expected} == expected
    assert found.keys() - expected <= {"a"}


def test_sets_of_a_deck_are_those_of_calculix():
    """CalculiX 2.20 ran this deck; what it printed of each set had these elements and nodes."""
    deck = read_deck(MESHES / "sets.inp")
    printed = {"STIFF": [1, 4], "SOFT": [1, 2, 3], "ODD": [1, 3], "LATER": [1, 2, 3]}
    assert {name: (deck.sets.elements[name] + 1).tolist() for name in printed} == printed
    assert (deck.sets.nodes["LEFT"] + 1).tolist() == [1, 6, 11, 16]
    assert len(deck.sets.nodes["EVERY"]) == 20


def test_sets_of_sides_are_sides(tmp_path):
    """Loads act on them, and not on the other sides of their cells."""
    text = f"{STRIP}{FOUR}*SURFACE, NAME=s\n1, S4\n*ELSET, ELSET=n\n1\n*NSET, NSET=n\n1, 11\n"
    mesh, _ = mesh_of_text(tmp_path, text)
    for name in ("s", "n"):
        assert sorted(mesh.side_groups[name].ravel().tolist()) == [0, 5]


@pytest.mark.parametrize(
    ("kind", "nodes"),
    [
        ("cps3", 3),
        ("CPE3", 3),
        ("CPE4RH", 4),
        ("CPS6M", 6),
        ("CPS8R", 8),
        ("S4R5", 4),
        ("M3D9", 9),
        ("C3D4", 4),
        ("C3D8I", 8),
        ("C3D10MH", 10),
        ("C3D20RH", 20),
        ("C3D27", 27),
    ],
)
def test_types_of_elements(tmp_path, kind, nodes):
    """Those of rubber, whatever their integration: meshio has no name for half of them."""
    places = "".join(f"{k}, {math.sin(k)}, {math.cos(k)}, {k}\n" for k in range(1, 28))
    numbers = [*map(str, range(nodes, 0, -1))]
    rows = ",\n".join([", ".join(["7", *numbers[:9]])] + [", ".join(numbers[9:])] * (nodes > 9))
    (tmp_path / "one.inp").write_text(f"*Node\n{places}*Element,type={kind}\n{rows}\n")
    (found,) = read_deck(tmp_path / "one.inp").elements
    assert found.nodes.tolist() == [list(range(nodes - 1, -1, -1))]
    linear = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
    solid = {4: "tetra", 8: "hexahedron", 10: "tetra10", 20: "hexahedron20", 27: "hexahedron27"}
    assert found.kind == (solid if kind.startswith("C3D") else linear)[nodes]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("*ELEMENT, TYPE=CAX4H\n1, 1, 2, 12, 11\n", "CAX4H elements: axisymmetric bodies"),
        ("*ELEMENT, TYPE=CPS4\n1, 1, 2, 12, 11, 5\n", "element 1 has 5 nodes; one of type CPS4"),
        ("*ELEMENT, TYPE=CPS4\n1, 1, 2, 12\n", "element 1 has 3 nodes; one of type CPS4 has 4"),
        ("*ELEMENT, TYPE=CPS4\n1, 1, 2, 12, 99\n", "an element has the node 99, which has no"),
        (FOUR + FOUR, "two elements have one number"),
        (f"{FOUR}*ELSET, ELSET=b\na\n", "'a' in a set of elements is neither a number nor a set"),
        ("*NGEN\n1, 5\n", "*NGEN is not read: write the deck with all its nodes"),
        (f"{FOUR}*INCLUDE, INPUT=none.inp\n", "the included file none.inp is not in"),
        ("*INCLUDE, INPUT=deck.inp\n", "deck.inp includes itself"),
        ("*INSTANCE, NAME=i, PART=p\n*END INSTANCE\n", "instance i is one of part 'p', which is"),
        ("*ELEMENT, TYPE=CPS4\n", "has no triangles or quadrilaterals"),
    ],
)
def test_decks_that_are_refused_with_the_cause(tmp_path, text, message):
    with raising(re.escape(message)):
        mesh_of_text(tmp_path, STRIP + text)


@pytest.mark.parametrize("name", ["signs.msh", "signs-binary.msh"])
def test_entities_with_a_minus_sign_are_in_their_groups(name):
    """Physical Surface("sheet") = {-1}; Physical Curve("outline") = {1, 2, -3, -4}."""
    rows = {row["group"]: row for row in describe_mesh(MESHES / name).groups()}
    assert [rows[of]["sides"] for of in ("sheet", "outline", "left")] == [0, 6, 1]
    assert rows["sheet"]["cells"] == 8


def test_groups_that_are_left_out_are_named():
    """A physical point, and a curve with a number alone."""
    facts = describe_mesh(MESHES / "left-out.msh")
    assert [row["group"] for row in facts.groups()] == ["sheet"]
    assert "physical groups without names are left out: 3; in gmsh" in facts.remarks[0]
    assert facts.remarks[1] == "groups without cells or sides of cells are left out: corner"


def test_edges_of_shells_are_no_faces(tmp_path):
    """Right edge of the last square, from node 5 to 15: S2 of CPS4, S4 of S4, E2 in Abaqus."""
    for kind, face in (("CPS4", "S2"), ("S4", "S4"), ("S4", "E2")):
        text = f"{STRIP}{FOUR}*SURFACE, NAME=s\n4, {face}\n".replace("CPS4", kind)
        assert sorted(mesh_of_text(tmp_path, text)[0].side_groups["s"].ravel()) == [4, 9]
    for kind, face, message in (
        ("S4", "S2", "is a face (S1, S2) of S4 elements"),
        ("CPS4", "E2", "a quad has 4 faces"),
    ):
        text = f"{STRIP}{FOUR}*SURFACE, NAME=s\n4, {face}\n".replace("CPS4", kind)
        with raising(re.escape(message)):
            mesh_of_text(tmp_path, text)


def test_a_surface_that_is_not_read_is_named(tmp_path):
    told = mesh_of_text(tmp_path, f"{STRIP}{FOUR}*SURFACE, NAME=skin\n4,\n")[1]
    assert told[0].startswith("body.file: surface skin is left out")


def test_wedges_of_second_order_that_gmsh_names_c3d6_are_refused():
    with raising(r"has 18 nodes; one of type C3D6 has 6"):
        describe_mesh(MESHES / "wedges.inp")


def test_elements_beside_the_cells_are_counted(tmp_path):
    """Lines that are sides of cells, as gmsh writes them, are boundary; others are said."""
    mesh, told = mesh_of_text(
        tmp_path,
        f"{STRIP}{FOUR}*ELEMENT, TYPE=T3D2, ELSET=edge\n11, 1, 2\n12, 1, 13\n"
        "*ELEMENT, TYPE=CONN2D2, ELSET=joint\n13, 1, 15\n14, 2, 15\n*ELEMENT, TYPE=U1\n15, 1, 2,\n3"
        "\n*USER ELEMENT, TYPE=U1, NODES=3\n",
    )
    assert told[0].endswith("groups without cells or sides of cells are left out: joint")
    assert told[1].endswith("elements beside the cells are left out: 1 T3D2, 2 CONN2D2, 1 U1")
    assert cells_of(mesh) == {"every": [0, 1, 2, 3], "edge": [0]}


CUBE = "*PART, NAME=cube\n*NODE\n" + "".join(
    f"{k}, {x}, {y}, {z}\n"
    for k, (x, y, z) in enumerate(
        [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (2, 0), (2, 1), (0, 1))], 1
    )
)
CUBE += "*ELEMENT, TYPE=C3D8R, ELSET=rubber\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*END PART\n"
ASSEMBLY = (
    "*ASSEMBLY, NAME=a\n*INSTANCE, NAME=one, PART=Cube\n*END INSTANCE\n"
    "*INSTANCE, NAME=two, PART=cube\n5., 0., 0.\n5., 0., 0., 5., 0., 1., 90.\n*END INSTANCE\n"
    "*ELSET, ELSET=second, INSTANCE=two\n1\n*NSET, NSET=ends\none.1, one.4, one.5, one.8\n"
    "*ELSET, ELSET=both\none.rubber, two.rubber\n*END ASSEMBLY\n"
)


def test_instances_of_a_part(tmp_path):
    """The second is shifted by 5 along x1, then turned by a right angle about the line x1 = 5."""
    mesh, told = mesh_of_text(tmp_path, CUBE + ASSEMBLY, 3)
    assert told == [
        f"body.file: the body has the cells of all parts of {tmp_path / 'deck.inp'}: one (1),"
        ' two (1); parts = ["one"] takes one, and parts that touch are bonded'
    ]
    assert cells_of(mesh) == {
        **{"second": [1], "ends": [0], "both": [0, 1], "one.rubber": [0], "two.rubber": [1]},
        **{"one": [0], "two": [1]},
    }
    np.testing.assert_allclose(mesh.centroids[0], [[1, 0.5, 0.5], [4.5, 1, 0.5]], atol=1e-12)
    alone, told = mesh_of_text(tmp_path, CUBE + ASSEMBLY, 3, ("two",))
    assert not told
    np.testing.assert_allclose(alone.centroids[0], [[4.5, 1, 0.5]], atol=1e-12)
    assert cells_of(alone) == {
        **{"second": [0], "both": [0], "two.rubber": [0], "two": [0], "ends": []}
    }
    with raising(r"^body\.parts: .* no elements in 'three'; it has sec"):
        mesh_of_text(tmp_path, CUBE + ASSEMBLY, 3, ("three",))
    rigid = CUBE.replace("cube", "tool").replace(
        "C3D8R, ELSET=rubber\n1, 1, 2, 3, 4, 5, 6, 7, 8", "R3D4\n1, 1, 2, 3, 4"
    )
    _, told = mesh_of_text(
        tmp_path, CUBE + rigid + ASSEMBLY.replace("PART=cube", "PART=tool").split("*ELSET")[0], 3
    )
    assert [each.split(": ")[-1] for each in told] == ["1 R3D4"]
    wedge = CUBE.replace("cube", "wedge").replace("C3D8R", "C3D6").replace(", 7, 8\n*END", "\n*END")
    beside = ASSEMBLY.replace("PART=Cube", "PART=wedge")
    with raising("has wedge cells; use only tetra and hexahedron"):
        mesh_of_text(tmp_path, CUBE + wedge + beside, 3)
    assert len(mesh_of_text(tmp_path, CUBE + wedge + beside, 3, ("two",))[0].cells) == 1
    once, told = mesh_of_text(tmp_path, CUBE, 3)
    assert not told
    assert cells_of(once) == {"rubber": [0]}


def test_inverted_cells_are_turned_and_said(tmp_path):
    text = CUBE.replace("1, 1, 2, 3, 4, 5, 6, 7, 8", "1, 5, 6, 7, 8, 1, 2, 3, 4")
    mesh, told = mesh_of_text(tmp_path, text, 3)
    assert told[0].endswith("were inverted (corners in the wrong order), and are turned")
    np.testing.assert_allclose(mesh.centroids[1], 2.0)
    tetrahedra = "*ELEMENT, TYPE=C3D4\n1, 1, 2, 4, 5\n2, 2, 3, 4, 7\n3, 2, 7, 6, 5\n"
    text = CUBE[: CUBE.index("*ELEMENT")] + tetrahedra + "*END PART\n"
    mesh, told = mesh_of_text(tmp_path, text, 3)
    assert told[0].split(":")[1].startswith(" 1 of 3 cells")
    np.testing.assert_allclose(mesh.centroids[1], 1 / 3)


def test_sets_after_an_include_and_a_change_of_the_included_file(tmp_path):
    """meshio gives sets after *INCLUDE no members; digests and reading see all files."""
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "nodes.inc").write_text(STRIP)
    (tmp_path / "inner" / "mesh.inc").write_text(f"*INCLUDE, INPUT=nodes.inc\n{FOUR}")
    text = "*INCLUDE, INPUT=inner\\mesh.inc\n*ELSET, ELSET=a\n2, 3\n"
    mesh, _ = mesh_of_text(tmp_path, text)
    assert cells_of(mesh)["a"] == [1, 2]
    body = pds.shapes.Mesh(file=str(tmp_path / "deck.inp"))
    before = digest_of_mesh(body)
    (tmp_path / "inner" / "nodes.inc").write_text(STRIP.replace("15, 4.", "15, 5."))
    assert digest_of_mesh(body) != before


@pytest.mark.parametrize("line", ["* Include, INPUT=nodes.inc", "*INCLUDE,\nINPUT = nodes.inc"])
def test_an_included_file_is_found_however_its_line_is_written(tmp_path, line):
    (tmp_path / "nodes.inc").write_text(STRIP)
    (tmp_path / "deck.inp").write_text(f"{line}\n{FOUR}")
    assert files_of(tmp_path / "deck.inp") == [tmp_path / "deck.inp", tmp_path / "nodes.inc"]


def test_a_stiff_part_given_by_two_blocks_of_elements_is_stiff_in_both(tmp_path):
    """The force is that with the part as a box; with meshio's reading it is that of one block."""
    nodes = "".join(f"{13 * j + i + 1}, {i}, {j}\n" for j in range(5) for i in range(13))
    first = {(i, j): 13 * j + i + 1 for j in range(4) for i in range(12)}
    lines = {
        (i, j): f"{12 * j + i + 1}, {node}, {node + 1}, {node + 14}, {node + 13}\n"
        for (i, j), node in first.items()
    }
    blocks = [[(2, 4), "stiff"], [(0, 2), ""], [(6, 8), "stiff"], [(4, 6), ""], [(8, 12), ""]]
    text = f"*NODE\n{nodes}"
    for (low, high), name in blocks:
        text += f"*ELEMENT, TYPE=CPS4{', ELSET=' + name if name else ''}\n"
        text += "".join(line for (i, _), line in lines.items() if low <= i < high)
    (tmp_path / "sheet.inp").write_text(text)
    boxes = [[[2.0, 0.0], [4.0, 4.0]], [[6.0, 0.0], [8.0, 4.0]]]
    regions = {
        "deck": {"group": "stiff"},
        "boxes": {"or": [{"box": box} for box in boxes]},
        "last": {"box": boxes[1]},
    }
    forces = {}
    for name, region in regions.items():
        scene = pds.Scene(
            name="sheet",
            body={"shape": "mesh", "file": str(tmp_path / "sheet.inp")},
            material={"law": "neo-hookean"},
            materials=[
                {"region": region, "material": {"law": "neo-hookean", "shear_modulus": 9.0}}
            ],
            grips=[
                {"edge": "left", "holds": "normal"},
                {"edge": "right", "holds": "normal", "travel": 1.0},
            ],
            stretches=1.1,
        )
        forces[name] = pds.simulate(scene, "bond-energy").levels[-1]["nominal_stress"]
    assert forces["deck"] == forces["boxes"]
    assert forces["last"] < 0.9 * forces["boxes"]


@pytest.mark.parametrize("name", ["plate.msh", "block.inp"])
def test_the_figure_of_a_mesh_names_its_groups(name, tmp_path):
    facts = describe_mesh(MESHES / name)
    mesh = facts.mesh
    figure = measured.mesh_figure(mesh.cells, mesh.cell_groups, mesh.side_groups, name)
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    covered = {f"{group} (covered)" for group in ("all", "Volume2", "both")}
    groups = {row["group"] for row in facts.groups()}
    assert {label.removesuffix(" (covered)") for label in labels} == groups
    assert labels - groups == (covered if name == "block.inp" else set())
    figures.save(figure, tmp_path / "mesh.png")
    assert (tmp_path / "mesh.png").stat().st_size > 5000
