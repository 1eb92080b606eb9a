#!/usr/bin/env bash
# How many pixels differ when Embree runs with another instruction set? (docs/NUMERICS.md)
#
#   tests/bench/isa_pixels.sh [WIDTHxHEIGHT] [SPP]
#
# Needs a built tree (BUILD) and a processor with the instruction sets; those that it lacks are
# left out. AZULEJO_DATA adds two scenes from outside. Prints one line a scene and pair.
set -eu
cd "$(dirname "$0")/../.."
size=${1:-400x400} spp=${2:-64}
build=${BUILD:-build/release}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$build/bin/scenes/sky/make_sky" --size 512x256 -o "$work/sky.exr" >"$work/log"
python3 -B tests/bench/make_scenes.py instances "$work/instances.gltf"

isas=(sse2 avx2)
if grep -q avx512f /proc/cpuinfo; then isas+=(avx512); fi

# NAME SCENE ENVIRONMENT|-
measure() {
    local env=() first second
    [ "$3" = - ] || env=(--env "$3")
    for isa in "${isas[@]}"; do
        "$build/tests/bench/bench_render" "$2" "${env[@]}" --size "$size" --spp "$spp" \
            --threads "$(nproc)" --isa "$isa" --out "$work/$isa.exr" >"$work/log"
    done
    for pair in "sse2 avx2" "avx2 avx512"; do
        read -r first second <<<"$pair"
        [ -e "$work/$second.exr" ] || continue
        "$build/bin/azulejo" compare --json "$work/$second.exr" "$work/$first.exr" \
            >"$work/compare.json" || true
        python3 -B - "$1" "$first" "$second" "$work/compare.json" <<'END'
import json
import sys
name, first, second, path = sys.argv[1:]
c = json.load(open(path))
print("%-20s %-5s %-7s %7d of %7d pixels differ, %.3g relative MSE, means %s" % (
    name, first, second, c["differing_pixels"], c["pixels"], c["relative_mse"],
    " ".join("%+.1e" % m for m in c["mean_relative"])))
END
    done
}

echo "$size, $spp samples a pixel: ${isas[*]}"
measure cornell-area scenes/cornell/cornell-area.gltf -
measure cornell-mirror scenes/cornell/cornell-mirror.gltf "$work/sky.exr"
measure textured-spheres scenes/studio/textured-spheres.gltf "$work/sky.exr"
# Faces that coincide: a medium's box and glass on a ground, liquid that fills its glass.
measure fire scenes/features/fire.pbrt -
measure media scenes/features/media.pbrt -
measure water-in-glass scenes/liquids/water-contact.gltf "$work/sky.exr"
measure instances "$work/instances.gltf" "$work/sky.exr"
if [ -n "${AZULEJO_DATA:-}" ]; then
    measure DamagedHelmet "$AZULEJO_DATA/gltf/DamagedHelmet/DamagedHelmet.glb" "$work/sky.exr"
    measure MetalRoughSpheres \
        "$AZULEJO_DATA/gltf/MetalRoughSpheresNoTextures/MetalRoughSpheresNoTextures.glb" \
        "$work/sky.exr"
fi
