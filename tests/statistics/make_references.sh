#!/usr/bin/env bash
# Make the references of tests/statistics/test_features.c again: all, or those of the scenes named.
# Needed when a scene is new or changed, or when the renderer was found to be wrong; never just
# because the test fails. About ten minutes of CPU for all; each scene is a
# process of its own.
#   tests/statistics/make_references.sh [NAME...]    BUILD names the build tree
set -eu
cd "$(dirname "$0")/../.."
program=${BUILD:-build/release}/tests/statistics/test_features
mkdir -p tests/statistics/references
if [ $# -eq 0 ]; then
    for scene in scenes/features/*.gltf scenes/features/*.pbrt scenes/cornell/*.gltf; do
        name=$(basename "$scene")
        set -- "$@" "${name%.*}"
    done
fi
printf '%s\n' "$@" | xargs -P "$(nproc)" -n 1 nice "$program" --write
