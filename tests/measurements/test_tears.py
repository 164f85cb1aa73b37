"""Tearing energies from files of tear tests: those of the law and force that made the files."""

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.identification.tearing import off_at_break, tearing_energies
from pdsurrogate.materials import NeoHookean, homogeneous
from pdsurrogate.measurements import read_tests
from pdsurrogate.measurements.specimens import MechanicalTests, Tear
from pdsurrogate.measurements.tears import steady_force

LAW = NeoHookean(0.5, 500.0)
WIDTH, THICKNESS, HEIGHT = 7.5, 2.0, 20.0
LEGS = {"mode": "trouser", "width": "7.5 mm", "thickness": "2 mm"}


def trouser(path, plateau, head="Extension (mm),Load (N)", scale=1.0):
    """Write the test of a specimen whose legs stretch until the tear runs, as a machine does."""
    rise = np.linspace(0, 30, 61)
    run = np.linspace(30, 130, len(plateau) + 1)[1:]
    extension = np.r_[rise, run, 132.0]
    force = np.r_[np.linspace(0, plateau[0], 61), plateau, 0.02]
    rows = zip(extension, force * scale, strict=True)
    path.write_text(head + "\n" + "".join(f"{a:.4f},{b:.6f}\n" for a, b in rows))
    return path


def test_steady_and_jerking_trousers_have_their_energy(tmp_path):
    teeth = 6.0 + 1.5 * (np.linspace(0, 20, 400) % 1 - 0.5)  # the tear sticks and slips
    noise = 6.0 + 0.1 * np.random.default_rng(2).standard_normal(400)
    exact = pds.tearing_energy(LAW, 6.0, WIDTH, THICKNESS)
    for number, plateau in enumerate((np.full(200, 6.0), teeth, noise)):
        tests = read_tests(trouser(tmp_path / f"{number}.csv", plateau), **LEGS)
        assert not tests.specimens
        (tear,) = tests.tears
        assert tear.nominal_stress == pytest.approx(6.0 / 15.0, rel=0.01)
        found, _ = tearing_energies(LAW, tests)
        energy, deviation = found["trouser"]["energy"]
        assert energy == pytest.approx(exact, rel=0.015)
        assert deviation is None
        assert "the force on the legs is" in " ".join(tests.assumed)


@pytest.mark.parametrize(
    ("peak", "end", "deviation"),
    [(9.0, 140, 0.0), (15.0, 140, 0.0), (9.0, 60, 0.0), (15.0, 140, 0.1), (9.0, 60, 0.1)],
)
def test_a_peak_before_the_tear_and_zeros_after_it_are_no_part_of_it(peak, end, deviation):
    along = np.linspace(0, 140, 281)
    force = np.where(along < 30, along / 30 * peak, 9.0) * (along <= end)
    force += deviation * np.random.default_rng(1).standard_normal(281)
    first, last, mean, _ = steady_force(force, along)
    assert mean == pytest.approx(9.0, rel=1e-12 if not deviation else 0.01)
    assert along[[first, last]] == pytest.approx([30, end], abs=4)
    for rising in (np.minimum(along, 280 - 2 * along), np.sin(np.pi * along / 140), along**0.5):
        assert steady_force(rising, along) is None


def test_units_and_scatter_of_trousers(tmp_path):
    forces = np.array([5.4, 6.0, 6.6])
    files = [
        trouser(tmp_path / f"{one}.csv", np.full(200, one), "Travel in mm,Load (kN)", 1e-3)
        for one in forces
    ]
    tests = read_tests(*files, stress_unit="kPa", **LEGS)
    assert tests.unit == "kPa"
    found, _ = tearing_energies(LAW.scaled(1000.0), tests)
    energies = [1000 * pds.tearing_energy(LAW, one, WIDTH, THICKNESS) for one in forces]
    assert found["trouser"]["specimens"] == 3
    assert found["trouser"]["energy"] == pytest.approx(
        [np.mean(energies), np.std(energies, ddof=1)], rel=2e-3
    )


def test_what_a_trouser_test_leaves_open_is_asked_for(tmp_path):
    path = trouser(tmp_path / "0.csv", np.full(200, 6.0), "Extension,Load")
    missing = " ".join(read_tests(path, mode="trouser").missing)
    assert "the force on the legs" in missing
    assert "the width of a leg" in missing
    assert "the thickness of the legs" in missing
    rising = tmp_path / "1.csv"
    force = np.r_[np.linspace(0, 20, 200), 0.0]
    rows = zip(np.linspace(0, 60, 201), force, strict=True)
    rising.write_text("Extension (mm),Load (N)\n" + "".join(f"{a:.3f},{b:.3f}\n" for a, b in rows))
    tests = read_tests(rising, **LEGS)
    assert not tests.tears
    assert "as of legs that break" in " ".join(tests.assumed)


@pytest.mark.parametrize(
    ("stated", "width"),
    [
        ("7.5 mm", 7.5),
        ("15 mm", 15.0),
        ("leg", 15.0),
        ("specimen", 7.5),
        ("9 mm", 0.0),
        (None, 0.0),
    ],
)
def test_whose_width_the_file_of_trousers_states_is_said(stated, width, tmp_path):
    head = "Width,15,mm\nThickness,2.0,mm\n\nExtension (mm),Load (N)"
    path = trouser(tmp_path / "0.csv", np.full(200, 6.0), head)
    facts = {"mode": "trouser"} | ({"width": stated} if stated else {})
    if stated == "9 mm":
        with raising("neither that of a leg nor that of both"):
            read_tests(path, **facts)
        return
    tests = read_tests(path, **facts)
    if stated is None:
        (missing,) = tests.missing
        assert "whose width the file's 15 mm is" in missing
        return
    assert tests.tears[0].length == width
    assert f"the width of a leg is {width:g} mm" in tests.assumed[0]


def test_a_file_without_a_mode_may_be_of_a_trouser_which_needs_no_gauge_length(tmp_path):
    path = trouser(tmp_path / "0.csv", np.full(200, 6.0))
    assert "gauge length: --gauge-length '25 mm', unless it is a trouser" in " ".join(
        read_tests(path).missing
    )


def test_a_cut_strip_in_pure_shear_tears_at_the_work_of_its_height(tmp_path):
    most = 1.6
    stretch = np.r_[np.linspace(1, most, 61), most + 0.01, most + 0.02]
    stress = np.array([homogeneous.pure_shear(LAW, one).nominal_stress for one in stretch])
    stress[-2:] *= 0.1
    path = tmp_path / "strip.csv"
    rows = zip((stretch - 1) * HEIGHT, stress * 100, strict=True)
    path.write_text("Extension (mm),Load (N)\n" + "".join(f"{a:.5f},{b:.5f}\n" for a, b in rows))
    stated = {"mode": "pure-shear-tear", "gauge_length": "20 mm", "area": "100 mm2"}
    tests = read_tests(path, **stated)
    assert not tests.specimens
    found, _ = tearing_energies(LAW, tests)
    exact = homogeneous.pure_shear(LAW, most).energy_density * HEIGHT
    assert found["pure-shear-tear"]["energy"][0] == pytest.approx(exact, rel=1e-3)
    whole = tmp_path / "whole.csv"
    whole.write_text("\n".join(path.read_text().splitlines()[:-2]))
    assert not read_tests(whole, **stated).tears


def test_a_law_that_has_no_such_state_says_so():
    tests = MechanicalTests("strip", tears=(Tear("strip", "pure-shear-tear", 20.0, 1.0, 5.0),))
    found, remarks = tearing_energies(pds.materials.Gent(0.5, 500.0, 1.2), tests)
    assert not found
    assert "strip: no tearing energy" in remarks[0]


def test_a_law_that_is_off_at_break_is_remarked(tmp_path):
    """Of the law that made the curve nothing is said; one that is 30 % stiffer has more energy."""
    stretch = np.r_[np.linspace(1, 3, 81), 3.02]
    stress = np.array([homogeneous.uniaxial(LAW, one).nominal_stress for one in stretch])
    stress[-1] = 0.0
    path = tmp_path / "0.csv"
    rows = zip(stretch, stress, strict=True)
    path.write_text("Stretch,Stress (MPa)\n" + "".join(f"{a:.4f},{b:.6f}\n" for a, b in rows))
    tests = read_tests(path, mode="uniaxial")
    assert off_at_break(LAW, tests) == []
    (remark,) = off_at_break(LAW.scaled(1.3), tests)
    assert "at the mean stretch at break, 3," in remark
    assert off_at_break(LAW, None) == []
