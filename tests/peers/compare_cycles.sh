#!/usr/bin/env bash
# Compare Azulejo with Blender Cycles on the same glTF file and environment map.
#
#   tests/peers/compare_cycles.sh SCENE [ENVIRONMENT|-] [WIDTHxHEIGHT] [SPP] [DEPTH]
#
# Needs Blender (Debian 12: apt-get install blender python3-numpy) and a built tree. The scene
# needs a camera. Renders in turn with Cycles, Azulejo, and Cycles with another seed (so that its
# noise is known); prints the mean relative difference per channel, what the noise alone gives,
# and the CPU-seconds of all three. A tool for people, not part of `make test`.
#
# From the environment: BUILD, the build tree; LAMBERT=1, make dielectrics Lambert's first, and
# LAMBERT=filtered, but interpolate textures (lambert_variant.py); LAMP_CUTS=N, cut the lamps of
# Cycles (cycles_render.py); OPTIONS, more of them for bench_render, such as `--without
# microfacet-multiple-scattering`, which Blender's importer leaves off; KEEP=FOLDER, keep the pictures.
set -eu
cd "$(dirname "$0")/../.."
scene=$1 environment=${2:--} size=${3:-400x400} spp=${4:-256} depth=${5:-12}
build=${BUILD:-build/release}
width=${size%x*} height=${size#*x}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
threads=$(nproc)

case ${LAMBERT:-} in
'') ;;
filtered) python3 -B tests/peers/lambert_variant.py "$scene" "$work/scene.gltf" --filtered
    scene=$work/scene.gltf ;;
*) python3 -B tests/peers/lambert_variant.py "$scene" "$work/scene.gltf"
    scene=$work/scene.gltf ;;
esac
env_option=()
[ "$environment" = - ] || env_option=(--env "$environment")

# SEED
cycles() {
    CYCLES_SEED=$1 blender -b --factory-startup -P tests/peers/cycles_render.py -- \
        "$scene" "$work/cycles$1.exr" "$width" "$height" "$spp" "$depth" "$environment" \
        >"$work/blender.log" 2>&1 || { tail -20 "$work/blender.log"; exit 1; }
    grep '^cycles:' "$work/blender.log"
}

cycles 0
"$build/tests/bench/bench_render" "$scene" "${env_option[@]}" --size "$size" --spp "$spp" \
    --max-depth "$depth" --threads "$threads" ${OPTIONS:-} --out "$work/azulejo.exr"
cycles 1
echo "Azulejo against Cycles:"
"$build/bin/azulejo" compare "$work/azulejo.exr" "$work/cycles0.exr" || true
echo "Cycles against Cycles with another seed (its noise):"
"$build/bin/azulejo" compare "$work/cycles1.exr" "$work/cycles0.exr" || true
if [ -n "${KEEP:-}" ]; then mkdir -p "$KEEP" && cp "$work"/*.exr "$KEEP"/; fi
