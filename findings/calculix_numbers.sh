#!/bin/sh
# CalculiX 2.20 reads 20 characters of a number in a deck, and may take what is left of a longer one for another number without a word.
#
# Node 5 of the cubes below has an x1 of 17 digits, as Python prints numbers and scripts write them. Where the exponent begins at
# the 19th or 20th character it is lost in part or whole: 6.1e-17 becomes 0.61, the program ends with status 0, and the cube is a skewed one.
# Expected is the number itself; seen on 2026-11-30 with CalculiX 2.20 (Debian 12, calculix-ccx 2.20-1) is told by each call below: the status, and
# x1 in the result file. The script fails if another version or behavior is found. It needs ccx on the PATH, and nothing of this repository.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
ccx -v | grep -q 'Version 2\.20$' || { echo "needs CalculiX 2.20"; exit 1; }
changed=0
try() { # a number, and the status and the number that were seen
    cat > one.inp <<DECK
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, $1, 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
*ELEMENT, TYPE=C3D8, ELSET=CUBE
1, 1, 2, 3, 4, 5, 6, 7, 8
*MATERIAL, NAME=M
*ELASTIC
1., 0.3
*SOLID SECTION, ELSET=CUBE, MATERIAL=M
*BOUNDARY
ALL, 1, 3
*STEP
*STATIC
*NODE FILE
U
*END STEP
DECK
    rm -f one.frd
    status=0
    ccx -i one > log 2>&1 || status=$?
    found=$(awk '$1 == "-1" && $2 == 5 { print $3; exit }' one.frd 2> none || true)
    echo "$1: status $status, read as ${found:-nothing}"
    [ "$status $found" = "$2 ${3-}" ] || changed=1
}
try 6.12323399573e-17 0 6.12323E-17    # 17 characters: right
try 6.123233995736766e-17 0 6.12323E-01 # 21 characters, the 7 is lost: e-1 is left
try 0.00012345678901234567 0 1.23457E-04 # 22 characters, digits alone are lost: right
try 1.2345678901234567e-05 201          # 22 characters, "e-" is left: refused
[ "$changed" = 0 ] || { echo "CalculiX behaves differently from what was seen"; exit 1; }
