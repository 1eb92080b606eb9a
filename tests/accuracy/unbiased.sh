#!/usr/bin/env bash
# Adaptive pictures against uniform ones, over many seeds of hard scenes. Every line "right" must
# hold, at 1 % for each scene (Sidak over its frame and tiles); the other lines show what wrong
# ways would do. SEEDS (default 400) is the number of seeds.
set -u
cd "$(dirname "$0")/../.."
unbiased=${BUILD:-build/release}/tests/accuracy/unbiased
seeds=${SEEDS:-400}
bad=0
try() {
    echo "== $*"
    "$unbiased" "$@" --size 32x32 --seeds "$seeds" || bad=1
}
try tests/accuracy/scenes/lamp-in-bulb.pbrt --samples 64 --rmse 500
try tests/accuracy/scenes/small-caustic.pbrt --samples 32 --last-level 2 --rmse 25
try scenes/cornell/cornell-area.gltf --samples 32 --last-level 2 --psnr 30
[ "$bad" -eq 0 ] && echo "unbiased: ok" || echo "unbiased: a mean is off"
exit "$bad"
