#!/bin/sh
# Fields of a sheet whose law is known, as two programs for image correlation write them.
#
# Finite elements (FElupe 11.3.0) give the motion and the forces of a rubber sheet with a hole; draw.py draws speckle images of it through
# four cameras; sun-dic 0.0.36 and al-dic 1.0.3 correlate them and write their own tables, which are tests/data/speckle. check.py compares
# them with the motion that was drawn. Each program has a venv of its own in a temporary folder, with Python 3.12, which sun-dic asks for.
# Nothing of this repository is used. It takes half an hour on one core; PYTHON names another interpreter.
#
#     sh tests/data/speckle/made_by/run.sh tests/data/speckle
set -eu
out=${1:?folder of the tables}
here=$(cd "$(dirname "$0")" && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
export QT_QPA_PLATFORM=offscreen
install() {
    name=$1
    shift
    "${PYTHON:-python3.12}" -m venv "$folder/$name"
    "$folder/$name/bin/pip" install -q "$@"
}
install felupe felupe==11.3.0 matplotlib==3.11.2 numpy==2.4.6 pillow==13.0.0 scipy==1.17.1
install sun-dic sun-dic==0.0.36 numpy==2.5.5 numba==0.68.1 opencv-contrib-python-headless==5.0.0.93 pandas==3.1.1 scipy==1.18.1
install al-dic al-dic==1.0.3 numpy==2.5.5 numba==0.68.1 opencv-python==5.0.0.93 scipy==1.18.1
"$folder/felupe/bin/python" "$here/draw.py" "$folder"
for variant in base turned moved lost; do
    "$folder/sun-dic/bin/python" "$here/by_sun_dic.py" "$folder/$variant"
    "$folder/al-dic/bin/python" "$here/by_al_dic.py" "$folder/$variant"
    mkdir -p "$out/$variant"
    cp -r "$folder/$variant/sun-dic" "$out/$variant"
    cp "$folder/$variant/al-dic/al-dic.npz" "$out/$variant"
done
mkdir -p "$out/base/al-dic"
cp "$folder"/base/al-dic/*.csv "$out/base/al-dic"
cp "$folder/forces.csv" "$out"
"$folder/felupe/bin/python" "$here/check.py" "$folder"
