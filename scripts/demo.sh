#!/usr/bin/env bash
# The demonstration behind `make demo`: render a Cornell box with a mirror under a clear sky, on two
# workers, into out/.
#
#   scripts/demo.sh [--env FILE] [--size WxH] [--spp N] [RENDER-OPTION]...
#
# BUILD names the build tree. What it does not know it hands on to `azulejo render`.
set -eu
cd "$(dirname "$0")/.."
build=${BUILD:-build/release}
env='' size=512x512 spp=256
more=()
while [ $# -gt 0 ]; do
    case $1 in
    --env | --size | --spp)
        [ $# -ge 2 ] || { echo "$1 needs a value" >&2; exit 2; }
        declare "${1#--}=$2"
        shift 2
        ;;
    --env=* | --size=* | --spp=*)
        option=${1#--}
        declare "${option%%=*}=${option#*=}"
        shift
        ;;
    -h | --help)
        sed -n '2,/^set/s/^# \{0,1\}//p' "$0"
        exit 0
        ;;
    *)
        more+=("$1")
        shift
        ;;
    esac
done

mkdir -p out
if [ -z "$env" ]; then
    env=out/sky.exr
    "$build/bin/scenes/sky/make_sky" --sun-elevation 40 --sun-azimuth 325 -o "$env"
    echo "made the sky: $env"
fi
"$build/bin/azulejo" render scenes/cornell/cornell-mirror.gltf --env "$env" --workers 2 \
    --size "$size" --spp "$spp" -o out/cornell ${more[@]+"${more[@]}"}
echo
echo "the picture:  $PWD/out/cornell.png (tone mapped)"
echo "              $PWD/out/cornell.exr (linear radiance)"
