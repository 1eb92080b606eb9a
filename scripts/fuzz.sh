#!/usr/bin/env bash
# Build the fuzz targets with clang's libFuzzer and AddressSanitizer, and run each of them for
# FUZZ_SECONDS (60), with the words of tests/fuzz/dictionaries/NAME.dict where there are some. New
# inputs go to build/fuzz/corpus/NAME; what breaks a target to build/fuzz/crash-NAME-*. Run by
# `make fuzz`; scripts/fuzz.sh tests/fuzz/fuzz_exr.c runs one.
set -eu
cd "$(dirname "$0")/.."
: "${FUZZ_SECONDS:=60}"
: "${FUZZ_CC:=clang}"
: "${FUZZ_RSS_MB:=2048}"

if ! command -v "$FUZZ_CC" >/dev/null; then
    echo "fuzz: $FUZZ_CC is not installed (apt-get install clang)" >&2
    exit 1
fi
[ $# -gt 0 ] || set -- $(find tests/fuzz -name 'fuzz_*.c' | sort)
if [ $# -eq 0 ]; then
    echo "fuzz: there are no targets under tests/fuzz" >&2
    exit 1
fi

# Our libraries come from the Makefile, in a tree of their own, instrumented for libFuzzer.
instrument=address,undefined,fuzzer-no-link
tree=build/${instrument//,/-}-clang
libraries=()
for library in support client web coordinator worker render protocol common; do
    libraries+=("$tree/lib/lib$library.a")
done
objects=()
for source in "$@"; do
    objects+=("$tree/obj/${source%.c}.o")
done
# Warnings are the ordinary build's business.
make -s CC="$FUZZ_CC" SANITIZE="$instrument" WARNINGS=-w "${libraries[@]}" "${objects[@]}"
others=$(pkg-config --libs libuv openssl sqlite3 jansson libwebsockets libpng zlib libdeflate libjpeg libwebp libzstd libprotobuf-c OpenEXR draco cmocka)
embree=-lembree3
[ -e /usr/include/embree4/rtcore.h ] && embree=-lembree4
mkdir -p build/fuzz/corpus

failed=0
for source in "$@"; do
    target=$(basename "$source" .c)
    name=${target#fuzz_}
    corpus=build/fuzz/corpus/$name
    mkdir -p "$corpus"
    # clang links the sanitizer's part for C++, which draco.cc needs, only if asked to.
    # shellcheck disable=SC2086
    "$FUZZ_CC" -fsanitize=fuzzer,address,undefined -fsanitize-link-c++-runtime -pthread -o "build/fuzz/$target" \
        "$tree/obj/${source%.c}.o" "${libraries[@]}" $others $embree -lstdc++ -lm
    echo "== $target for $FUZZ_SECONDS s"
    seeds=()
    [ -d "tests/fuzz/corpus/$name" ] && seeds=("tests/fuzz/corpus/$name")
    words=()
    [ -f "tests/fuzz/dictionaries/$name.dict" ] && words=("-dict=tests/fuzz/dictionaries/$name.dict")
    if ! "build/fuzz/$target" -max_total_time="$FUZZ_SECONDS" -rss_limit_mb="$FUZZ_RSS_MB" \
        -timeout=20 -max_len=65536 -print_final_stats=1 -artifact_prefix="build/fuzz/crash-$name-" \
        "${words[@]}" "$corpus" "${seeds[@]}" >"build/fuzz/$target.log" 2>&1; then
        failed=$((failed + 1))
        echo "FAIL $target; the last lines of build/fuzz/$target.log:"
        tail -n 40 "build/fuzz/$target.log"
    else
        grep -E 'number_of_executed_units|peak_rss_mb' "build/fuzz/$target.log" | sed 's/^/   /'
    fi
done
[ "$failed" -eq 0 ]
