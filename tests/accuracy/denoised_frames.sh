#!/bin/sh
# Animations denoised with the frames around, against truth: the table of docs/DENOISING.md. 6 minutes on two cores.
#   tests/accuracy/denoised_frames.sh [SPP ...]
set -e
[ $# -gt 0 ] || set -- 16 64
build=${BUILD:-build/release} folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cp scenes/features/*.bin scenes/studio/*.bin scenes/studio/*.png "$folder"
make_scene() { # name, scene, moves
    python3 tests/farm/moving.py "$2" "$folder/$1.gltf" "$3"
}
box=scenes/cornell/cornell-area.gltf
cp $box "$folder/still.gltf"
make_scene camera $box camera=2.4,0,-1
make_scene dolly $box camera=0,0,-20
make_scene block $box "short block=3,0,0.7"
make_scene lamp $box lamp=4,0,0
make_scene spheres scenes/studio/textured-spheres.gltf camera=2.4,0,-1
make_scene ball scenes/studio/textured-spheres.gltf hammered=-2.4,0,1
make_scene metal scenes/features/metal.gltf camera=2.4,0,-1
make_scene glass scenes/features/glass.gltf camera=2.4,0,-1
"$build/tests/accuracy/denoised_frames" --header
for spp in "$@"; do
    for name in still camera dolly block lamp spheres ball metal glass; do
        echo "$folder/$name.gltf --cache $folder/$name.$spp --spp $spp"
    done
done | xargs -P "$(nproc)" -L 1 "$build/tests/accuracy/denoised_frames"
