#!/usr/bin/env bash
# The demonstration behind `make demo`: render a Cornell box with mirror blocks in a wheat field, on two
# workers, into out/.
#
#   scripts/demo.sh [--env FILE] [--size WxH] [--spp N] [RENDER-OPTION]...
#
# BUILD names the build tree. What it does not know it hands on to `azulejo render`.
set -eu
cd "$(dirname "$0")/.."
build=${BUILD:-build/release}
env='' size=768x512 spp=384
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
    env=out/field.exr
    "$build/bin/scenes/sky/make_sky" --field --sun-elevation 47 --sun-azimuth 335 --size 3072x1536 -o "$env"
fi
"$build/bin/azulejo" render scenes/cornell/cornell-field.gltf --env "$env" --workers 2 --exposure 0.4 \
    --size "$size" --spp "$spp" -o out/cornell ${more[@]+"${more[@]}"}
cat <<END

The picture is out/cornell.png (tone mapped) and out/cornell.exr (linear radiance). Try next:

  azulejo=$build/bin/azulejo
  \$azulejo tonemap out/cornell.exr --sweep operator=all -o out/operators.png   # the same light, by every operator
  \$azulejo estimate scenes/cornell/cornell-field.gltf --env $env               # what a smaller error costs
  \$azulejo render scenes/liquids/wine.gltf --env $env --web -o out/wine        # and watch it on a page
END
