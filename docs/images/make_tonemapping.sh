#!/usr/bin/env bash
# Make the pictures of docs/TONEMAPPING.md again: render two scenes, tone map them in every way.
#
#   docs/images/make_tonemapping.sh [FOLDER]
#
# The renders stay in FOLDER (out/tonemapping); those that are there are not rendered again. Some
# four minutes on two idle processors. BUILD names the build tree.
set -eu
cd "$(dirname "$0")/../.."
azulejo=${BUILD:-build/release}/bin/azulejo sky=${BUILD:-build/release}/bin/scenes/sky/make_sky
out=${1:-out/tonemapping} images=docs/images
mkdir -p "$out"

if [ ! -e "$out/box.exr" ]; then
    "$sky" --sun-elevation 40 --sun-azimuth 325 -o "$out/sky-40.exr"
    "$azulejo" render scenes/cornell/cornell-mirror.gltf --env "$out/sky-40.exr" --size 400x400 \
        --spp 512 -o "$out/box.exr"
fi
if [ ! -e "$out/room.exr" ]; then
    "$sky" --sun-elevation 25 --sun-azimuth 170 -o "$out/sky-25.exr"
    "$azulejo" render scenes/features/portal.pbrt --env "$out/sky-25.exr" --size 480x320 \
        --spp 1024 -o "$out/room.exr"
fi
"$azulejo" tonemap "$out/box.exr" --exposure 1 --sweep operator=all --tile-width 300 \
    --quality 88 -o "$images/tonemapping-box.jpg"
"$azulejo" tonemap "$out/room.exr" --exposure 1 --sweep operator=all --tile-width 330 \
    --quality 88 -o "$images/tonemapping-room.jpg"
"$azulejo" tonemap "$out/room.exr" --operator mantiuk08 --sweep contrast=0.4,0.8,1.6 \
    --sweep saturation=0.5,1,1.5 --tile-width 330 --quality 88 \
    -o "$images/tonemapping-mantiuk08.jpg"
"$azulejo" tonemap "$out/room.exr" --operator reinhard02 --white 1e9 --exposure 1 \
    --sweep scale=global,local --tile-width 480 --quality 88 -o "$images/tonemapping-local.jpg"
