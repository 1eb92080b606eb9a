#!/usr/bin/env bash
# Compare Azulejo with the reference pictures that come with the pbrt scenes of the data folder.
#
#   AZULEJO_DATA=../shared/data tests/peers/compare_pbrt.sh [NAME...]
#
# Needs Blender (Debian 12: apt-get install blender python3-numpy), which reads the pictures, and a
# built tree. Prints the relative difference of the means, Azulejo's over the reference's less 1, in
# percent for red, green and blue with its standard error, and the relative MSE of blocks of a
# sixteenth of the width; for the whole picture and for parts of it that docs/COMPARISON.md speaks of. Ours
# are two pictures with other seeds; of the reference's noise only a bound is known. A tool for
# people, not part of `make test`.
#
# From the environment: BUILD, the build tree; SPP (64: of each of the two pictures); KEEP=FOLDER, keep
# the pictures there.
set -eu
data=$(cd "${AZULEJO_DATA:?says where the scenes are}" && pwd)
cd "$(dirname "$0")/../.."
build=${BUILD:-build/release} spp=${SPP:-64}
if [ -n "${KEEP:-}" ]; then
    mkdir -p "$KEEP"
    work=$(cd "$KEEP" && pwd)
else
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
fi
rows=() wanted=" $* "

# NAME SCENE SIZE DEPTH PART=REGION...: the whole and parts of one picture
compare() {
    local name=$1 folder=$data/pbrt/bitterli-$2 size=$3 depth=$4 seed part
    shift 4
    case $wanted in '  ' | *" $name "*) ;; *) return 0 ;; esac
    for seed in 0 1; do
        "$build/bin/azulejo" render "$folder/scene-v4.pbrt" -o "$work/$name$seed.exr" --size "$size" \
            --spp "$spp" --max-depth "$depth" --seed "$seed" --quiet
    done
    for part in "whole=all" "$@"; do
        rows+=("$name ${part%%=*},$work/${name}0.exr,$work/${name}1.exr,$folder/TungstenRender.exr,${part#*=}")
    done
}

# The depths are those that the references were made with, as far as they can be told: see
# docs/COMPARISON.md.
compare cornell-box cornell-box 256x256 65
compare coffee coffee 400x500 17 backdrop=0.02:0.05:0.2:0.5 orange=0.42:0.3:0.6:0.45 \
    black=0.42:0.51:0.56:0.55 glass=0.35:0.6:0.6:0.78
compare staircase2 staircase2 256x256 65 wall=0.1:0.2:0.3:0.4 floor=0.1:0.85:0.5:1
compare veach-mis veach-mis 320x180 1 wall=0.05:0.05:0.3:0.4 lamp=0.63:0.15:0.68:0.25 \
    mirror=0.62:0.4:0.67:0.46 rough=0.3:0.82:0.7:0.87
compare veach-mis-depth3 veach-mis 320x180 3 wall=0.05:0.05:0.3:0.4
for depth in 4 5; do
    compare "volumetric-caustic-depth$depth" volumetric-caustic 256x256 "$depth" \
        above=0.55:0.05:0.9:0.25 right=0.7:0.3:0.9:0.8 caustic=0.1:0.6:0.4:0.95
done
echo "Azulejo less reference, percent:          R G B"
blender -b --factory-startup -P tests/peers/reference_table.py -- "${rows[@]}" \
    2>"$work/blender.log" | sed -n 's/^row: //p'
! grep -A20 Traceback "$work/blender.log"
