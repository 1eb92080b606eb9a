#!/usr/bin/env bash
# Compare Azulejo with Blender Cycles on the same glTF file and environment map.
#
#   tests/peers/compare_cycles.sh SCENE [ENVIRONMENT|-] [WIDTHxHEIGHT] [SPP] [DEPTH]
#
# Needs Blender (Debian 12: apt-get install blender python3-numpy) and a built tree. The scene
# needs a camera. Renders with Cycles twice (two seeds, so that its noise is known) and with
# Azulejo, prints the mean relative difference per channel and what the noise alone would give,
# and the CPU-seconds of both. A tool for people, not part of `make test`.
set -eu
cd "$(dirname "$0")/../.."
scene=$1 environment=${2:--} size=${3:-400x400} spp=${4:-256} depth=${5:-12}
build=${BUILD:-build/release}
width=${size%x*} height=${size#*x}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
threads=$(nproc)

for seed in 0 1; do
    CYCLES_SEED=$seed blender -b --factory-startup -P tests/peers/cycles_render.py -- \
        "$scene" "$work/cycles$seed.exr" "$width" "$height" "$spp" "$depth" "$environment" \
        >"$work/blender$seed.log" 2>&1 || { tail -20 "$work/blender$seed.log"; exit 1; }
    grep '^cycles:' "$work/blender$seed.log"
done
env_option=()
[ "$environment" = - ] || env_option=(--env "$environment")
"$build/tests/bench/bench_render" "$scene" "${env_option[@]}" --size "$size" --spp "$spp" \
    --max-depth "$depth" --threads "$threads" --out "$work/azulejo.exr"
echo "Azulejo against Cycles:"
"$build/bin/azulejo" compare "$work/azulejo.exr" "$work/cycles0.exr" || true
echo "Cycles against Cycles with another seed (its noise):"
"$build/bin/azulejo" compare "$work/cycles1.exr" "$work/cycles0.exr" || true
if [ -n "${KEEP:-}" ]; then mkdir -p "$KEEP" && cp "$work"/*.exr "$KEEP"/; fi
