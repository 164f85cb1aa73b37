#!/bin/sh
# CalculiX 2.20 takes the stress of an Abaqus UMAT for that of a frame that does not turn with the material, and passes the whole gradient.
#
# A UMAT that computes Cauchy's stress from DFGRD1, as Abaqus wants it, is right in CalculiX as long as nothing turns. Turned by 90 degrees,
# an element stretched by 1.5 has its normal stresses exchanged, and in shear all are wrong, while the program converges and says nothing:
# umat_abaqusnl.f turns STRESS by the stretch tensor U alone. Expected are the stresses of the program's own law with the same energy
# (*HYPERELASTIC, NEO HOOKE); seen on 2026-11-30 with CalculiX 2.20 built from Debian 12's source, is told by the calls below. The script
# fails if another behavior is found. It needs gfortran, make, and libspooles-dev, libarpack2-dev, liblapack-dev (Debian), and nothing of
# this repository; it compiles CalculiX without optimization, in some minutes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
mkdir -p lists/partial
echo "deb-src http://deb.debian.org/debian bookworm main" > sources.list
sources="-qq -o Dir::Etc::sourcelist=$folder/sources.list -o Dir::Etc::sourceparts=/dev/null -o Dir::State::lists=$folder/lists"
apt-get $sources update
apt-get $sources source --download-only calculix-ccx=2.20-1
tar -xf calculix-ccx_2.20.orig.tar.bz2
cd CalculiX/ccx_2.20/src
cat > umat.f <<'FORTRAN'
      subroutine umat(stress,statev,ddsdde,sse,spd,scd,rpl,ddsddt,
     & drplde,drpldt,stran,dstran,time,dtime,temp,dtemp,predef,dpred,
     & cmname,ndi,nshr,ntens,nstatv,props,nprops,coords,drot,pnewdt,
     & celent,f0,f,noel,npt,layer,kspt,kstep,kinc)
      implicit real*8 (a-h,o-z)
      character*80 cmname
      dimension stress(6),ddsdde(6,6),props(2),f(3,3),b(3,3)
      b = matmul(f, transpose(f))
      det = f(1,1)*(f(2,2)*f(3,3) - f(2,3)*f(3,2))
     &    - f(1,2)*(f(2,1)*f(3,3) - f(2,3)*f(3,1))
     &    + f(1,3)*(f(2,1)*f(3,2) - f(2,2)*f(3,1))
      third = (b(1,1) + b(2,2) + b(3,3))/3
      do i = 1, 3
        b(i,i) = b(i,i) - third
      end do
      b = props(1)*det**(-5.d0/3)*b
      stress = (/b(1,1), b(2,2), b(3,3), b(1,2), b(1,3), b(2,3)/)
      stress(1:3) = stress(1:3) + props(2)*(det - 1)
      ddsdde = 0
      do i = 1, 6
        ddsdde(i,i) = props(2)
      end do
      end
FORTRAN
make -s -j "$(nproc)" CC=cc FC=gfortran FFLAGS="-O0 -w -fallow-argument-mismatch" \
    CFLAGS='-O0 -w -I/usr/include/spooles -DARCH="Linux" -DSPOOLES -DARPACK -DMATRIXSTORAGE -DNETWORKOUT' ccx_2.20.o ccx_2.20.a > /dev/null 2>&1
gfortran -o "$folder/ccx" ccx_2.20.o ccx_2.20.a -lspooles -larpack -llapack -lblas -lpthread -lm -fopenmp
cd "$folder"
changed=0
stress() { # of a material (its lines), and the gradient F11 F12 F21 F22 of a unit cube: S11 S22 S12
    awk -v material="$1" -v a="$2" -v b="$3" -v c="$4" -v d="$5" 'BEGIN {
        split("0 0 0,1 0 0,1 1 0,0 1 0,0 0 1,1 0 1,1 1 1,0 1 1", corner, ",")
        print "*NODE, NSET=ALL"
        for (k = 1; k <= 8; k++) { split(corner[k], x, " "); print k ", " x[1] ", " x[2] ", " x[3] }
        print "*ELEMENT, TYPE=C3D8, ELSET=CUBE\n1, 1, 2, 3, 4, 5, 6, 7, 8\n" material
        print "*STEP, NLGEOM\n*STATIC\n0.25, 1., 0.25, 0.25\n*BOUNDARY"
        for (k = 1; k <= 8; k++) {
            split(corner[k], x, " ")
            print k ", 1, 1, " (a - 1)*x[1] + b*x[2] "\n" k ", 2, 2, " c*x[1] + (d - 1)*x[2] "\n" k ", 3, 3, 0."
        }
        print "*EL PRINT, ELSET=CUBE, FREQUENCY=100\nS\n*END STEP"
    }' > deck.inp
    ./ccx -i deck > log 2>&1
    awk 'NF == 8 {line = sprintf("%.3f %.3f %.3f", $3, $4, $6)} END {print line}' deck.dat
}
own='*MATERIAL, NAME=M
*HYPERELASTIC, NEO HOOKE
0.5, 0.02
*SOLID SECTION, ELSET=CUBE, MATERIAL=M'
umat='*MATERIAL, NAME=ABAQUSNL_M
*USER MATERIAL, CONSTANTS=2
1., 100.
*SOLID SECTION, ELSET=CUBE, MATERIAL=ABAQUSNL_M'
try() { # a name, F11 F12 F21 F22, and whether the two agreed
    one=$(stress "$own" "$2" "$3" "$4" "$5")
    other=$(stress "$umat" "$2" "$3" "$4" "$5")
    echo "$1: S11, S22, S12 of the program's law $one, of the same law as a UMAT $other"
    same=no
    [ "$one" = "$other" ] && same=yes
    [ "$same" = "$6" ] || changed=1
}
try "stretched by 1.5" 1.5 0 0 0.66666666667 yes
try "and turned by 90 degrees" 0 -0.66666666667 1.5 0 no
try "sheared by 1" 1 1 0 1 no
[ "$changed" = 0 ] || { echo "CalculiX behaves differently from what was seen"; exit 1; }
