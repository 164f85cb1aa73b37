"""Physical groups in files of gmsh: meshio 5.3.5 loses one of two with one name, and entities that
version 4.1 lists with a minus sign, which turns their normal
(``Physical Curve("outline") = {1, 2, -3}``).
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np


def check_names(data: bytes) -> None:
    """Raise ValueError if two physical groups of a gmsh file have one name: meshio keeps one."""
    names = re.search(rb"\$PhysicalNames(.*?)\$EndPhysicalNames", data, flags=re.DOTALL)
    found = re.findall(rb'"(.*)"', names[1]) if names else []
    twice = [name.decode(errors="replace") for name, times in Counter(found).items() if times > 1]
    if twice:
        raise ValueError(f"two physical groups are named {twice[0]}; give each a name of its own")


def signed_entities(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the dimension, the number of a physical group and the number of an entity in it, for
    all that have a minus sign in a file of gmsh's version 4.1; nothing for another file.

    Source: manual of gmsh 4.15, "MSH file format".
    """
    start = data.find(b"$Entities")
    head = data[:40].split()
    if head[:2] != [b"$MeshFormat", b"4.1"] or start < 0:
        return
    take = _reader(data[data.index(b"\n", start) + 1 :], binary=head[2] == b"1")
    for dimension, count in enumerate(take("u8", 4)):
        for _ in range(count):
            entity = take("i4", 1)[0]
            take("f8", 6 if dimension else 3)
            groups = take("i4", take("u8", 1)[0])
            if dimension:
                take("i4", take("u8", 1)[0])  # its boundary
            yield from ((dimension, -group, entity) for group in groups if group < 0)


def _reader(data: bytes, binary: bool) -> Callable[[str, int], list]:
    """Return a function that takes the next numbers of a type, such as "i4", from text or binary
    data.
    """
    place = 0
    words = iter(() if binary else data.partition(b"$EndEntities")[0].split())

    def take(kind: str, count: int) -> list:
        nonlocal place
        if not binary:
            return [(float if kind == "f8" else int)(next(words)) for _ in range(count)]
        begin, place = place, place + int(kind[1]) * count
        return np.frombuffer(data[begin:place], kind).tolist()

    return take
