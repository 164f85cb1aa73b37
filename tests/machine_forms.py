"""Invented files in the forms in which machines export tests, after public descriptions: text, and
the blocks that they hold, by hand.
"""

import numpy as np

STRAIN = np.array([0.0, 0.05, 0.1234, 0.5, 1.0, 1.5])
STRESS = np.array([0.0, 0.0858, 0.1998, 0.643, 1.103, 1.562])
TIME, LENGTH, FORCE = 2.5 * np.arange(6), 25 * STRAIN, 1200.5 * STRESS
SECOND = STRESS * 1.01
F3 = "%.3f"


def lines(*columns, separator=",", decimal=".", quoted=False, form=F3, end="\n"):
    """Rows of numbers as text."""
    mark = '"' if quoted else ""
    return "".join(
        separator.join(mark + (form % cell).replace(".", decimal) + mark for cell in row) + end
        for row in zip(*columns, strict=True)
    )


def rounded(*columns, form=F3):
    """What a reader should find."""
    return np.array([[float(form % cell) for cell in row] for row in zip(*columns, strict=True)])


THREE = rounded(TIME, LENGTH, FORCE)
TWO = rounded(STRAIN, STRESS)
OTHER = rounded(STRAIN, SECOND)
RAW = "time/s extension/mm force/N"

FORMS = {
    "bluehill with results": (
        "utf-8",
        "Results Table 1\n,Maximum Load,Tensile stress at Maximum Load,Thickness,Width\n"
        ",(N),(MPa),(mm),(mm)\n1,1875.2,1.562,2.00,6.00\nMean,1875.2,1.562,2.00,6.00\n"
        "Standard deviation,,,,\n\nRaw Data\nTime,Extension,Load\n(s),(mm),(N)\n"
        + lines(TIME, LENGTH, FORCE, quoted=True),
        [(RAW, THREE, {"thickness": "2 mm", "width": "6 mm"})],
    ),
    "bluehill of cycles": (
        "utf-8",
        "Time,Total cycle count,Extension,Load,Tensile strain (Extension),Tensile stress\n"
        "(s),,(mm),(N),(%),(MPa)\n"
        + lines(TIME, np.ones(6), LENGTH, FORCE, 100 * STRAIN, STRESS, quoted=True),
        [
            (
                "time/s cycle/ extension/mm force/N engineering-strain/% nominal-stress/MPa",
                rounded(TIME, np.ones(6), LENGTH, FORCE, 100 * STRAIN, STRESS),
                {},
            )
        ],
    ),
    "bluehill in German, UTF-16": (
        "utf-16",
        "Probenbezeichnung;G 7\nBreite;6,00;mm\nZeit;Verfahrweg;Kraft\n(s);(mm);(N)\n"
        + lines(TIME, LENGTH, FORCE, separator=";", decimal=",", quoted=True),
        [(RAW, THREE, {"specimen": "G 7", "width": "6 mm"})],
    ),
    "UTF-16 without a mark": (
        "utf-16-le",
        "Time\tExtension\tLoad\n(s)\t(mm)\t(N)\n" + lines(TIME, LENGTH, FORCE, separator="\t"),
        [(RAW, THREE, {})],
    ),
    "testXpert": (
        "cp1252",
        '"Prüfzeit";"Standardweg";"Standardkraft"\n"s";"mm";"N"\n'
        + lines(TIME, LENGTH, FORCE, separator=";", decimal=","),
        [(RAW, THREE, {})],
    ),
    "testXpert side by side": (
        "cp1252",
        "Probe 1\t\tProbe 2\t\nDehnung\tStandardkraft\tDehnung\tStandardkraft\n%\tN\t%\tN\n"
        + lines(100 * STRAIN, FORCE, 100 * STRAIN, FORCE + 1, separator="\t", decimal=","),
        [
            ("engineering-strain/% force/N", rounded(100 * STRAIN, FORCE), {}),
            ("engineering-strain/% force/N", rounded(100 * STRAIN, FORCE + 1), {}),
        ],
    ),
    "MTS with blocks": (
        "cp1252",
        "".join(
            "MTS793|BTW|ENU|1|0|.|/|:|1|0|0|A\n\nData Header:\tTime:\t17.2\tSec\t11/30/2026\n"
            "Data Acquisition: Timed\nStation Name: 858.cfg\nTest File Name: rubber.tst\n"
            "Time\tAxial Displacement\tAxial Force\ns\tmm\tN\n"
            + lines(TIME, LENGTH, FORCE, separator="\t")
            + "\n\n"
            for _ in range(2)
        ),
        [(RAW, THREE, {"Test File Name": "rubber.tst"})] * 2,
    ),
    "MTS in pieces": (
        "cp1252",
        "".join(
            f"Data Header:\tTime: {17 * (1 + number)} s\nStation Name: 858.cfg\n"
            "Force\tDisplacement\tRunning Time\tCount\nN\tmm\ts\tsegments\n"
            + lines(FORCE, LENGTH, TIME + 50 * number, TIME, separator="\t")
            for number in (0, 1)
        ),
        [
            (
                "force/N extension/mm time/s cycle/segments",
                np.vstack([rounded(FORCE, LENGTH, TIME + 50 * number, TIME) for number in (0, 1)]),
                {},
            )
        ],
    ),
    "entries that are no sizes": (
        "utf-8",
        'Lab Section Number,"10"\nDiameter,6.97,mm\nFinal Diameter,6.20,mm\nWidth,6\n'
        'Notes During Test,""\n\nHora,Siła,Przemieszczenie\n(s),(N),(mm)\n'
        + lines(TIME, FORCE, LENGTH),
        [
            (
                "time/s force/N /mm",
                rounded(TIME, FORCE, LENGTH),
                {"area": None, "diameter": "6.97 mm", "width": None, "Width": "6"},
            )
        ],
    ),
    "TestWorks": (
        "cp1252",
        "Specimen 3\nTime ,Crosshead ,Load \ns ,mm ,lbf \n" + lines(TIME, LENGTH, FORCE),
        [("time/s extension/mm force/lbf", THREE, {})],
    ),
    "Trapezium in Japanese": (
        "cp932",
        '"キー語","製品名","試験日"\n"","ゴム","2026/11/30"\n\n"バッチ数:","1"\n'
        '"名前","厚さ","幅","標点距離"\n"寸法単位:","mm","mm","mm"\n"1 _ 1","2.0","6.0","25.0"\n'
        '"1 _ 2","2.1","6.0","25.0"\n\n"名前","最大点試験力","最大点応力"\n"単位","N","MPa"\n'
        '"1 _ 1","1875.2","1.562"\n"1 _ 2","1875.2","1.562"\n"平均値","1875.2","1.562"\n\n'
        + "\n".join(
            f'"1 _ {number}"\n"時間","ストローク","試験力"\n"sec","mm","N"\n'
            + lines(TIME, LENGTH, FORCE, quoted=True)
            for number in (1, 2)
        ),
        [
            ("time/sec extension/mm force/N", THREE, {"thickness": "2 mm", "width": "6 mm"}),
            ("time/sec extension/mm force/N", THREE, {"thickness": "2.1 mm", "width": "6 mm"}),
        ],
    ),
    "Trapezium side by side": (
        "utf-8",
        '"1 _ 1","","","1 _ 2","",""\n"Time","Stroke","Force","Time","Stroke","Force"\n'
        '"sec","mm","N","sec","mm","N"\n'
        + lines(TIME, LENGTH, FORCE, TIME, LENGTH, FORCE + 2, quoted=True),
        [
            ("time/sec extension/mm force/N", THREE, {}),
            ("time/sec extension/mm force/N", rounded(TIME, LENGTH, FORCE + 2), {}),
        ],
    ),
    "Chinese": (
        "gb18030",
        "试样编号\tR-1\n标距(mm)\t25\n宽度(mm)\t6.0\n厚度(mm)\t2.0\n\n时间(s)\t位移(mm)\t试验力(N)\n"
        + lines(TIME, LENGTH, FORCE, separator="\t"),
        [(RAW, THREE, {"specimen": "R-1", "gauge length": "25 mm", "thickness": "2 mm"})],
    ),
    "Chinese stresses": (
        "utf-8",
        "名义应变（％）,工程应力（ＭＰａ）\n"  # noqa: RUF001
        + lines(100 * STRAIN, STRESS),
        [("engineering-strain/% nominal-stress/MPa", rounded(100 * STRAIN, STRESS), {})],
    ),
    "Japanese stresses": (
        "utf-8-sig",
        "公称ひずみ,公称応力[MPa],真ひずみ,真応力[MPa]\n" + lines(STRAIN, STRESS, STRAIN, STRESS),
        [
            (
                "engineering-strain/ nominal-stress/MPa true-strain/ true-stress/MPa",
                rounded(STRAIN, STRESS, STRAIN, STRESS),
                {},
            )
        ],
    ),
    "French": (
        "cp1252",
        "Éprouvette : F 2\nLargeur : 6,0 mm\nÉpaisseur : 2,0 mm\nLongueur initiale : 25 mm\n\n"
        "Temps (s);Déplacement (mm);Force (N)\n"
        + lines(TIME, LENGTH, FORCE, separator=";", decimal=",", end=";\r\n"),
        [(RAW, THREE, {"specimen": "F 2", "width": "6 mm", "gauge length": "25 mm"})],
    ),
    "French with thousands": (
        "utf-8",
        "Déformation (%)\tContrainte (kPa)\n0\t0\n5,5\t998,5\n12\t1\u202f234,5\n50\t2\u00a0000\n",
        [
            (
                "engineering-strain/% nominal-stress/kPa",
                np.array([[0, 0], [5.5, 998.5], [12, 1234.5], [50, 2000]]),
                {},
            )
        ],
    ),
    "Spanish": (
        "cp1252",
        "Probeta;E-4\nEspesor (mm);2,0\nTiempo (s);Alargamiento (mm);Carga (N)\n"
        + lines(TIME, LENGTH, FORCE, separator=";", decimal=","),
        [(RAW, THREE, {"thickness": "2 mm"})],
    ),
    "quoted thousands": (
        "utf-8",
        'Time (min),Position (in),Load (lbf)\n"0.0","0.0","998.5"\n"1","1.5","1,234"\n'
        '"2","2.5","1,234,567.25"\n',
        [
            (
                "time/min extension/in force/lbf",
                np.array([[0, 0, 998.5], [1, 1.5, 1234], [2, 2.5, 1234567.25]]),
                {},
            )
        ],
    ),
    "written by NumPy": (
        "utf-8",
        "# strain stress\n" + lines(STRAIN, STRESS, separator=" ", form="%.18e"),
        [("engineering-strain/ nominal-stress/", rounded(STRAIN, STRESS, form="%.18e"), {})],
    ),
    "blocks with comments": (
        "utf-8",
        "# two columns: stretch, nominal stress in MPa\n# Specimen: 1\n# made by hand\n"
        + lines(1 + STRAIN, STRESS, separator="  ")
        + "\n# Specimen: 2\n"
        + lines(1 + STRAIN, SECOND, separator="  "),
        [
            ("/ /", rounded(1 + STRAIN, STRESS), {"specimen": "1"}),
            ("/ /", rounded(1 + STRAIN, SECOND), {"specimen": "2"}),
        ],
    ),
    "fixed widths": (
        "utf-8",
        "Rubber of Monday\nGauge length   25.0 mm\nArea = 12 mm2\n\n"
        "  Time (s)  Cross-head position (mm)   Load (N)\n"
        + lines(TIME, LENGTH, FORCE, separator=" ", form="%14.3f"),
        [(RAW, THREE, {"gauge length": "25 mm", "area": "12 mm2"})],
    ),
    "units after a slash": (
        "utf-8",
        "λ / -;P / MPa\n" + lines(1 + STRAIN, STRESS, separator=";"),
        [("stretch/- nominal-stress/MPa", rounded(1 + STRAIN, STRESS), {})],
    ),
    "strains shared by specimens": (
        "utf-8",
        ",Specimen 1,Specimen 2\nEngineering strain,Stress (MPa),Stress (MPa)\n"
        + lines(STRAIN, STRESS, SECOND),
        [
            ("engineering-strain/ nominal-stress/MPa", TWO, {}),
            ("engineering-strain/ nominal-stress/MPa", OTHER, {}),
        ],
    ),
    "statistics at the end": (
        "utf-8",
        "Strain,Stress\n%,MPa\n" + lines(STRAIN, STRESS) +
        "\nMean,0.5,0.6\nStd. dev.,0.1,0.2\nEND\n",
        [("engineering-strain/% nominal-stress/MPa", TWO, {})],
    ),
    "stacked specimens": (
        "utf-8",
        "Specimen 1\nStrain,Stress\n-,MPa\n" + lines(STRAIN, STRESS)
        + "Specimen 2\nWidth,5.9,mm\nStrain,Stress\n-,MPa\n" + lines(STRAIN, SECOND),
        [
            ("engineering-strain/- nominal-stress/MPa", TWO, {}),
            ("engineering-strain/- nominal-stress/MPa", OTHER, {"width": "5.9 mm"}),
        ],
    ),
    "CellScale": (
        "utf-8",
        "SetName,Cycle,Time_S,Displacement_mm,Force_N\n"
        + "".join(f"pull,1,{line}" for line in lines(TIME, LENGTH, FORCE).splitlines(True)),
        [("/ cycle/ time/S extension/mm force/N", None, {})],
    ),
    "dates and times of day": (
        "utf-8",
        "Start: 30.11.2026 12:01\nDate;Time (s);Extension (mm);Load (N)\n"
        + "".join(
            f"30.11.2026 12:01;{line}"
            for line in lines(TIME, LENGTH, FORCE, separator=";").splitlines(True)
        ),
        [("/ time/s extension/mm force/N", None, {})],
    ),
    "NIST": (
        "utf-8",
        "Displacement_(mm),Force_(kN),Extensometer\n" + lines(LENGTH, FORCE, STRAIN),
        [("extension/mm force/kN extension/", rounded(LENGTH, FORCE, STRAIN), {})],
    ),
    "two directions": (
        "utf-8",
        "# width = 4 mm, thickness = 1.5 mm\nlambda1,lambda2,P1 (MPa),P2 (MPa)\n1,1,0,0\n"
        "1.1,1.05,0.2,\u22120.1\n",
        [
            (
                "stretch/ lateral-stretch/ nominal-stress/MPa lateral-stress/MPa",
                np.array([[1, 1, 0, 0], [1.1, 1.05, 0.2, -0.1]]),
                {"width": "4 mm", "thickness": "1.5 mm"},
            )
        ],
    ),
    "sizes of specimens": (
        "utf-8",
        "Specimen,Width (mm),Thickness (mm),Gauge length (mm)\nS1,6,2,25\nS2,6.1,2.1,25\n\n"
        "S1,,S2,\nStrain,Stress (MPa),Strain,Stress (MPa)\n"
        + lines(STRAIN, STRESS, STRAIN, SECOND),
        [
            ("engineering-strain/ nominal-stress/MPa", TWO, {"width": "6 mm"}),
            ("engineering-strain/ nominal-stress/MPa", OTHER, {"width": "6.1 mm"}),
        ],
    ),
    "own curves": (
        "utf-8",
        "# tests.csv\nmode,stretch,nominal_stress,weight\nuniaxial,1.1,0.2,1\n\n# planar ones\n"
        "pure-shear,1.2,0.4,2\n",
        [("mode/ stretch/ nominal-stress/ weight/", None, {})] * 2,
    ),
    "own grid": (
        "utf-8",
        "stretch,lateral_stretch,nominal_stress,lateral_stress\n1.1,1.2,0.2,0.3\n1.3,1.2,0.4,0.3\n",
        [
            (
                "stretch/ lateral-stretch/ nominal-stress/ lateral-stress/",
                np.array([[1.1, 1.2, 0.2, 0.3], [1.3, 1.2, 0.4, 0.3]]),
                {},
            )
        ],
    ),
}  # fmt: skip
"""Encoding, text, and for each block its quantities with units, numbers and some facts."""
