#!/usr/bin/env bash
# Adaptive pictures against uniform ones, over many seeds of hard scenes. Every line "right" must
# hold, at 1 % for each scene (Sidak over its frame and tiles); the other lines show what wrong
# ways would do. SEEDS (default 200) is the number of seeds, ten times as many for the first.
set -u
cd "$(dirname "$0")/../.."
unbiased=${BUILD:-build/release}/tests/accuracy/unbiased
seeds=${SEEDS:-200}
bad=0
try() {
    echo "== $*"
    "$unbiased" "$@" || bad=1
}
try tests/accuracy/scenes/lamp-in-bulb.pbrt --size 16x16 --samples 32 --rmse 300 --seeds "$((10 * seeds))"
try tests/accuracy/scenes/lamp-in-bulb.pbrt --samples 64 --rmse 500 --seeds "$seeds"
try tests/accuracy/scenes/lamps-in-glass.pbrt --samples 32 --last-level 2 --rmse 120 --seeds "$seeds"
try tests/accuracy/scenes/small-caustic.pbrt --samples 32 --last-level 2 --rmse 25 --seeds "$seeds"
try scenes/cornell/cornell-area.gltf --samples 32 --last-level 2 --psnr 30 --seeds "$seeds"
[ "$bad" -eq 0 ] && echo "unbiased: ok" || echo "unbiased: a mean is off"
exit "$bad"
