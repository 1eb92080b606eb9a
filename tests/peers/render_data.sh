#!/usr/bin/env bash
# Import and render every scene of the data folder: glTF, pbrt, OBJ and PLY.
#
#   AZULEJO_DATA=../shared/data tests/peers/render_data.sh OUT-FOLDER [PATTERN]
#
# Fails when one does not import or render, when a sample was dropped because it was not finite, or
# when a scene whose name begins with "unsupported-" is not refused in words. Writes OUT-FOLDER/
# NAME.{exr,png,log,json} and, where ImageMagick's montage is there, contact sheets of twelve, which
# are for looking at: docs/SCENES.md says what is to be seen. PATTERN (a shell pattern) takes only
# the scenes whose path in the data folder it matches. A tool for people, not part of `make test`.
#
# A file without light gets an environment map. A glTF file with light of its own is rendered without
# and with it (as NAME+sky): often only its labels shine. Where a glTF file is animated, frame 20 is
# rendered too, and where it has several scenes or variants, each of them. The environment maps are
# rendered around one scene, in which a smooth and two rough metal balls mirror them.
# From the environment: BUILD, the build tree; SIZE (160x120; a file with a camera keeps its aspect);
# SPP (16); THREADS (1).
set -eu
data=$(cd "${AZULEJO_DATA:?says where the scenes are}" && pwd)
[ $# -ge 1 ] || { sed -n '2,4p' "$0"; exit 2; }
mkdir -p "$1"
out=$(cd "$1" && pwd) pattern=${2:-*}
cd "$(dirname "$0")/../.."
azulejo=${BUILD:-build/release}/bin/azulejo
size=${SIZE:-160x120} spp=${SPP:-16} threads=${THREADS:-1}
sky=$data/hdri/chinese_garden_1k.hdr
failures=0 pictures=0 refused=0
: >"$out/contents.txt"

# MESSAGE
fail() {
    echo "FAIL $1"
    failures=$((failures + 1))
}

# NAME: as high as SIZE, and as wide as the file's own camera has it
size_of() {
    local import=$out/${1%%[@+:]*}.import aspect
    if [ ! -f "$import" ] || grep -qE 'has (no|neither) camera' "$import"; then
        echo "$size"
        return
    fi
    aspect=$(sed -n 's/.*"aspect": *\([0-9.]*\).*/\1/p' "$import" | head -1)
    awk -v size="$size" -v aspect="${aspect:-0}" 'BEGIN {
        split(size, s, "x")
        print (aspect > 0 ? int(s[2] * aspect + 0.5) : s[1]) "x" s[2] }'
}

# NAME SCENE OPTION...
render() {
    local name=$1 scene=$2 dropped
    shift 2
    if ! "$azulejo" render "$scene" -o "$out/$name" --size "$(size_of "$name")" --spp "$spp" -j "$threads" \
        --json "$@" >"$out/$name.json" 2>"$out/$name.log"; then
        fail "$name: $(tail -1 "$out/$name.log")"
        return
    fi
    dropped=$(sed -n 's/.*"dropped_samples": *\([0-9]*\).*/\1/p' "$out/$name.json")
    [ "$dropped" = 0 ] || fail "$name: ${dropped:-no number of} samples dropped"
    pictures=$((pictures + 1))
    echo "$name" >>"$out/contents.txt"
}

# SCENE scene|variant: how many a glTF file has
choices() {
    python3 - "$1" "$2" <<'PYTHON'
import json, struct, sys
data = open(sys.argv[1], "rb").read()
if data[:4] == b"glTF":
    data = data[20:20 + struct.unpack("<I", data[12:16])[0]]
document = json.loads(data)
variants = document.get("extensions", {}).get("KHR_materials_variants", {}).get("variants", [])
print(len(variants if sys.argv[2] == "variant" else document.get("scenes", [])))
PYTHON
}

# SCENE
try() {
    local scene=$1 name path=${1#"$data/"} options=() choice count number
    name=$(echo "${path%.*}" | sed 's/^pbrt\/bitterli-\(.*\)\/.*/\1/; s/.*\///; s/ /-/g')
    if "$azulejo" import "$scene" --json >"$out/$name.import" 2>"$out/$name.log"; then
        case $path in */unsupported-*) fail "$path: taken, though it needs what is not supported" ;; esac
    else
        case $path in
        */unsupported-*)
            refused=$((refused + 1))
            echo "refused: $(tail -1 "$out/$name.log" | sed "s|$data/||")" ;;
        *) fail "$path: $(tail -1 "$out/$name.log")" ;;
        esac
        return
    fi
    if grep -qE 'the file has (no|neither camera nor) light' "$out/$name.import"; then
        options=(--env "$sky")
    fi
    # Frame 1 is the default of a scene that stands still, frame 0 of one that moves.
    render "$name" "$scene" "${options[@]}"
    case $path in *.gltf | *.glb) ;; *) return ;; esac
    [ "${#options[@]}" -gt 0 ] || render "$name+sky" "$scene" --env "$sky"
    if ! grep -q '"duration_s": 0.0,' "$out/$name.import"; then
        render "$name@20" "$scene" "${options[@]}" --frames 20
    fi
    for choice in scene variant; do
        count=$(choices "$scene" "$choice")
        for ((number = 0; count > 1 && number < count; number++)); do
            render "$name:$choice$number" "$scene" "${options[@]}" "--$choice" "$number"
        done
    done
}

while IFS= read -r scene; do
    # shellcheck disable=SC2254 # a pattern is meant
    case ${scene#"$data/"} in $pattern) try "$scene" ;; esac
done < <(find "$data/gltf" "$data/pbrt" "$data/mesh" \( -name '*.gltf' -o -name '*.glb' -o \
    -name '*.obj' -o -name '*.ply' -o -name '*.pbrt' \) -not -path '*/geometry/*' \
    -not -path '*/models/*' -not -path '*/meshes/*' | LC_ALL=C sort)

for map in "$data"/hdri/*.hdr "$data"/hdri/*.exr; do
    # shellcheck disable=SC2254
    case ${map#"$data/"} in
    $pattern) name=$(basename "$map")
        render "env-${name%.*}" scenes/features/metal.gltf --env "$map" ;;
    esac
done

if command -v montage >/dev/null; then
    rm -f "$out"/sheet-*.png
    mapfile -t names <"$out/contents.txt"
    for ((at = 0; at < ${#names[@]}; at += 12)); do
        sheet=()
        for name in "${names[@]:at:12}"; do sheet+=(-label "$name" "$out/$name.png"); done
        montage "${sheet[@]}" -tile 4x -geometry '+4+4' -pointsize 11 \
            "$out/sheet-$(printf %02d $((at / 12 + 1))).png"
    done
fi
echo "$pictures pictures, $refused refused as they should be, $failures failures; see $out"
[ "$failures" = 0 ]
