#!/usr/bin/env bash
# Compare Azulejo with Blender Cycles, effect by effect, on the same glTF files.
#
#   tests/peers/compare_features.sh [PATTERN...]
#
# Needs Blender (Debian 12: apt-get install blender python3-numpy) and a built tree. Takes the scenes
# of scenes/features and, where AZULEJO_DATA names the data folder, models of it under a sky; each
# as it is and with the materials edited into ones that both renderers understand
# (tests/peers/features.py lists all rows; a PATTERN, as in 'glass*', takes some of them). Prints for
# each the relative difference of the means, Azulejo's over Cycles' less 1, in percent for red, green
# and blue with its standard error: in the whole picture, and where the subject is seen (with the share of the
# picture that it fills). The standard error comes from two pictures with other seeds of each renderer.
# docs/COMPARISON.md explains what is left. A tool for people, not part of `make test`.
#
# From the environment: BUILD, the build tree; SIZE (128x96); SPP (256: of each of the two pictures);
# DEPTH (12); KEEP=FOLDER, keep the pictures there.
set -eu
cd "$(dirname "$0")/../.."
build=${BUILD:-build/release}
if [ -n "${KEEP:-}" ]; then
    mkdir -p "$KEEP"
    work=$(cd "$KEEP" && pwd)
else
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
fi
"$build/bin/scenes/sky/make_sky" --no-sun --output "$work/sky.exr" >/dev/null
python3 -B tests/peers/features.py "$work" "$build/bin/azulejo" "${SIZE:-128x96}" "${SPP:-256}" \
    "${DEPTH:-12}" "$work/sky.exr" "${AZULEJO_DATA:--}" "${*:-*}"
echo "Azulejo less Cycles, percent:            the picture: R G B            | the subject: R G B"
blender -b --factory-startup -P tests/peers/cycles_features.py -- "$work/rows.json" \
    >"$work/blender.log" 2>&1 || { tail -20 "$work/blender.log"; exit 1; }
grep -q '^row:' "$work/blender.log" || { tail -20 "$work/blender.log"; exit 1; }
sed -n 's/^row: //p' "$work/blender.log"
