#!/usr/bin/env bash
# Record the units of five scenes of sky and object, and of two models more where AZULEJO_DATA names the
# folder of test data, into build/accuracy; then replay them by 2, 8 and 32 workers: how often is the
# time left right? Recordings are kept: remove them after a change of the renderer.
set -u
cd "$(dirname "$0")/../.."
build=${BUILD:-build/release}
folder=build/accuracy/time
mkdir -p "$folder"
files=()
record() {
    local name=$1 scene=$2
    shift 2
    [ -f "$folder/$name.rec" ] || {
        "$build/tests/accuracy/record" "$scene" --out "$folder/$name.tmp" --size 320x192 --spp 64 "$@" &&
            mv "$folder/$name.tmp" "$folder/$name.rec"
    } || exit 1
    files+=("$folder/$name.rec")
}
record sky scenes/features/sky.pbrt
record soft-sky tests/accuracy/scenes/soft-sky.pbrt
record media-sky tests/accuracy/scenes/media-sky.pbrt
record glass-sun tests/accuracy/scenes/glass-sun.pbrt
record spheres scenes/studio/textured-spheres.gltf
if [ -n "${AZULEJO_DATA:-}" ]; then
    record helmet "$AZULEJO_DATA/gltf/DamagedHelmet/DamagedHelmet.glb" \
        --env "$AZULEJO_DATA/hdri/kloppenheim_05_1k.hdr"
    record coats "$AZULEJO_DATA/gltf/ClearCoatTest/ClearCoatTest.glb" \
        --env "$AZULEJO_DATA/hdri/st_peters_square_night_1k.hdr"
fi
exec "$build/tests/accuracy/time_left" "${files[@]}"
