#!/usr/bin/env bash
# What the figures of error cost: the share of a render's CPU samples (perf) that the coordinator spends in the code of
# the figures and of the level statistics, on three scenes and sizes. Needs perf.
set -u
cd "$(dirname "$0")/../.."
build=${BUILD:-build/release}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
command -v perf >/dev/null || { echo "figures_cost: perf is missing (Debian: linux-perf)" >&2; exit 2; }
figures='accuracy_|gather|contrast|pair_variance|half_difference|spread|quantile|complement_erf|share_|figure_|measurement_|show_codes|map_tiles|top_share|tails|film_develop_group'
levels='film_level|level_|measure_codes|measure_spreads|add_side|mean_around|tonemap_pixels|film_codes|spread_add'
codes='expose_lines|srgb_|reinhard_row|tonemap_'
echo "| scene | size | samples | coordinator | of it figures | levels | display codes for both |"
echo "|---|---|---:|---:|---:|---:|---:|"
try() {
    local scene=$1 size=$2 spp=$3
    perf record -q -F 499 -o "$folder/data" "$build/bin/azulejo" render "$scene" --size "$size" --spp "$spp" \
        --allocation adaptive -o "$folder/picture.exr" >"$folder/log" 2>&1 || { cat "$folder/log" >&2; exit 1; }
    perf script -i "$folder/data" -F comm,ip,sym 2>/dev/null |
        awk -v figures="$figures" -v levels="$levels" -v codes="$codes" -v row="$(basename "$scene") | $size | $spp" '
            { all++ }
            $1 ~ /coord|libuv/ { ours++; if ($3 ~ levels) l++; else if ($3 ~ codes) c++; else if ($3 ~ figures) f++ }
            END { printf "| %s | %.1f %% | %.1f %% | %.1f %% | %.1f %% |\n", row, 100 * ours / all, 100 * f / all, 100 * l / all, 100 * c / all }'
}
try scenes/cornell/cornell-area.gltf 480x480 64
try tests/accuracy/scenes/soft-sky.pbrt 320x240 64
try scenes/features/metal.gltf 640x360 32
