#!/usr/bin/env bash
# Record four seeds of each scene at 900 tiles, into build/accuracy, and print what giving samples
# to tiles saves. Recordings are kept: remove the folder after a change of the renderer.
set -u
cd "$(dirname "$0")/../.."
build=${BUILD:-build/release}
folder=build/accuracy
mkdir -p "$folder"
record() {
    local name=$1 spp=$2 scene=$3
    [ -f "$folder/$name.rec" ] || {
        "$build/tests/accuracy/record" "$scene" --out "$folder/$name.tmp" --size 480x480 --spp "$spp" --seeds 4 &&
            mv "$folder/$name.tmp" "$folder/$name.rec"
    } || exit 1
}
record caustic 256 tests/accuracy/scenes/small-caustic.pbrt
record room 128 tests/accuracy/scenes/room-window.pbrt
record soft-sky 256 tests/accuracy/scenes/soft-sky.pbrt
record glass-sun 256 tests/accuracy/scenes/glass-sun.pbrt
record cornell 256 scenes/cornell/cornell-area.gltf
record spheres 256 scenes/studio/textured-spheres.gltf
record wine 128 scenes/liquids/wine.gltf
exec "$build/tests/accuracy/allocation" "$@" "$folder"/*.rec
