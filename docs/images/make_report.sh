#!/usr/bin/env bash
# Make the pictures of docs/REPORT.md again, from what is in this repository.
#
#   docs/images/make_report.sh [FIGURE...]
#
# Figures: contrast saturation operators result owners mirrors sampling room. Without one: all of them. Renders stay in
# out/report (WORK=FOLDER: there); those that are there are not rendered again, so remove what shall be. About six minutes on two
# idle processors. BUILD names the build tree; RESULT_SIZE=512x341 makes a larger result, which takes 2.4 times as long as its own.
set -eu
cd "$(dirname "$0")/../.."
bin=${BUILD:-build/release}/bin
work=${WORK:-out/report} images=docs/images
box=scenes/cornell/cornell-field.gltf
size=${RESULT_SIZE:-330x220}
mkdir -p "$work"

azulejo() { nice -n 10 "$bin/azulejo" "$@"; }

# The map that everything stands under.
map() {
    [ -e "$work/field.exr" ] ||
        "$bin/scenes/sky/make_sky" --field --seed 5 --sun-azimuth 325 --size 2048x1024 -o "$work/field.exr"
}

# render NAME OPTION...: the box as NAME.exr, and a line about its time and error.
render() {
    local name=$1
    shift
    map
    [ -e "$work/$name.exr" ] || azulejo render "$box" --env "$work/field.exr" -o "$work/$name.exr" --quiet --json "$@" \
        >"$work/$name.json"
    tell "$name"
}

tell() {
    python3 - "$1" "$work/$1.json" <<'PYTHON'
import json, sys
name, path = sys.argv[1:]
job = json.load(open(path))["job"]
now, error, settings = job["now"], job["now"]["figures"], job["settings"]
width, height = settings["width"], settings["height"]
print("%-18s %dx%d, %.0f samples a pixel, %.0f core-seconds; %.1f/255 (%.1f to %.1f), %s" % (
    name, width, height, now["samples"] / width / height,
    now["core_seconds"], error["display"], error["display_low"], error["display_high"],
    "reliable" if error["reliable"] else "may be understated"))
PYTHON
}

# What figures 2.1 to 2.6 are made of.
base() { render base --size 420x280 --spp 256; }

# 2.1 to 2.3
contrast() {
    base
    azulejo tonemap "$work/base.exr" --operator mantiuk08 --sweep contrast=0.4,0.8,1.6 --tile-width 400 --quality 88 \
        -o "$images/report-contrast.jpg"
}

# 2.4 to 2.6
saturation() {
    base
    azulejo tonemap "$work/base.exr" --operator mantiuk08 --sweep saturation=0.4,0.8,1.6 --tile-width 400 --quality 88 \
        -o "$images/report-saturation.jpg"
}

operators() {
    base
    azulejo tonemap "$work/base.exr" --sweep operator=reinhard02,drago03,mantiuk06,aces,agx,pbr-neutral --tile-width 400 \
        --quality 78 -o "$images/report-operators.jpg"
}

# 2.7
result() {
    render result --size "$size" --spp 4096
    azulejo tonemap "$work/result.exr" --operator mantiuk08 --quality 90 -o "$images/report-result.jpg"
}

# 3.1: a farm of three workers of one thread, on this machine.
owners() {
    local farm=$work/farm key=$work/farm/farm.key name job
    programs=()
    rm -rf "$farm"
    mkdir -p "$farm"
    map
    "$bin/azulejo" keygen -o "$key" >"$farm/keygen.log"
    "$bin/azulejo-coordinator" --listen 127.0.0.1:0 --no-web --key "$key" --store "$farm/store" --ready-file "$farm/port" \
        2>"$farm/coordinator.log" >&2 &
    programs+=($!)
    trap 'kill "${programs[@]}" 2>/dev/null || true' EXIT
    until [ -e "$farm/port" ]; do sleep 0.1; done
    export AZULEJO_COORDINATOR=127.0.0.1:$(cat "$farm/port") AZULEJO_KEY=$key
    for name in worker-1 worker-2 worker-3; do
        nice -n 10 "$bin/azulejo-worker" --name "$name" --threads 1 --cache "$farm/cache-$name" \
            2>"$farm/$name.log" >&2 &
        programs+=($!)
    done
    until [ "$("$bin/azulejo" workers --json | grep -c '"state": "idle"')" = 3 ]; do sleep 0.1; done
    # The first job brings the scene to the workers; the second one is dealt to all of them from its first tile on.
    "$bin/azulejo" submit "$box" --env "$work/field.exr" --size 128x128 --spp 16 --watch --quiet
    job=$("$bin/azulejo" submit "$box" --env "$work/field.exr" --size 128x128 --spp 256 --seed 1 --watch --quiet --json |
        python3 -c 'import json, sys; print(json.load(sys.stdin)["job"])')
    "$bin/azulejo" owners "$job" -o "$images/report-owners.png"
    "$bin/azulejo" owners "$job" --over -o "$images/report-owners-over.png" >"$farm/owners.txt"
    kill "${programs[@]}"
    wait "${programs[@]}" || true
    trap - EXIT
    unset AZULEJO_COORDINATOR AZULEJO_KEY
}

# 4.1: the blocks, out of a picture of 1200x800.
mirrors() {
    render mirrors --size 1200x800 --region 420,270,400,400 --spp 192
    azulejo tonemap "$work/mirrors.exr" --operator mantiuk08 --quality 86 -o "$images/report-mirrors.jpg"
}

# Directions by the map's brightness, or from all of the sphere: the same core time under a clear sky, with the sun and without.
sampling() {
    local way sun
    for sun in sun no-sun; do
        [ -e "$work/sky-$sun.exr" ] ||
            "$bin/scenes/sky/make_sky" --sun-azimuth 325 $([ $sun = sun ] || echo --no-sun) -o "$work/sky-$sun.exr"
        box=scenes/cornell/cornell-mirror.gltf render "reference-$sun" --size 128x128 --spp 2048 --env "$work/sky-$sun.exr"
        for way in importance uniform-only; do
            box=scenes/cornell/cornell-mirror.gltf render "$way-$sun" --size 128x128 --core-limit 4s --spp 100000 \
                --allocation uniform --seed 7 --env "$work/sky-$sun.exr" --env-sampling "$way"
            azulejo compare "$work/$way-$sun.exr" "$work/reference-$sun.exr" --json >"$work/$way-$sun-compare.json" || true
            azulejo tonemap "$work/$way-$sun.exr" --operator mantiuk08 --quality 90 -o "$images/report-$way-$sun.jpg"
        done
        python3 - "$work" "$sun" <<'PYTHON'
import json, sys
work, sun = sys.argv[1:]
def cost(way):
    seconds = json.load(open("%s/%s-%s.json" % (work, way, sun)))["job"]["now"]["core_seconds"]
    return seconds * json.load(open("%s/%s-%s-compare.json" % (work, way, sun)))["mse"]
print("%s: uniform sampling takes %.3g times as long to the same mean squared error" % (
    sun, cost("uniform-only") / cost("importance")))
PYTHON
    done
}

# Directions by the map's brightness, and by what arrives of it: a room with a window, the same core time for both.
room() {
    local way
    [ -e "$work/sky-room.exr" ] || "$bin/scenes/sky/make_sky" --sun-azimuth 60 -o "$work/sky-room.exr"
    box=scenes/features/window.pbrt render reference-room --size 192x128 --spp 1024 --without portal --env "$work/sky-room.exr"
    for way in importance learned; do
        box=scenes/features/window.pbrt render "room-$way" --size 192x128 --core-limit 10s --spp 100000 --without portal \
            --allocation uniform --seed 7 --env "$work/sky-room.exr" --env-sampling "$way"
        azulejo compare "$work/room-$way.exr" "$work/reference-room.exr" --json >"$work/room-$way-compare.json" || true
        azulejo tonemap "$work/room-$way.exr" --operator mantiuk08 --quality 90 -o "$images/report-room-$way.jpg"
    done
    python3 - "$work" <<'PYTHON'
import json, sys
def mse(way):
    return json.load(open("%s/room-%s-compare.json" % (sys.argv[1], way)))["mse"]
print("by the map's brightness alone %.3g times as long to the same mean squared error" % (mse("importance") / mse("learned")))
PYTHON
}

[ $# -gt 0 ] || set -- owners contrast saturation operators result mirrors sampling room
for figure in "$@"; do
    case $figure in
    contrast | saturation | operators | result | owners | mirrors | sampling | room) "$figure" ;;
    *) echo "$0: no figure '$figure': contrast saturation operators result owners mirrors sampling room" >&2; exit 2 ;;
    esac
done
