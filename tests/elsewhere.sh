#!/usr/bin/env bash
# Does the place of a clone show? Builds HEAD in a folder that other users cannot enter and whose name has a space and a
# letter beyond ASCII, and runs the tests of farms, pages and units there: with umask 077, a TMPDIR of its own, no HOME,
# another time zone and language, and a clock that is a year ahead.
#
#   tests/elsewhere.sh [PATTERN]
set -euo pipefail
cd "$(dirname "$0")/.."
umask 077
place=$(mktemp -d "/var/tmp/azulejo é XXXXXX")
clock=$(mktemp -d /var/tmp/azulejo-clock-XXXXXX)  # LD_PRELOAD parts paths at spaces
trap 'rm -rf "$place" "$clock"' EXIT
mkdir "$place/temporary"
git clone -q --no-hardlinks . "$place/project"
cd "$place/project"
make -j"$(nproc)" all tests
printf '\x80\x33\xe1\x01\0\0\0\0' >"$clock/ahead"  # the seconds of 365 days
cp build/release/tests/farm/odd_clock.so "$clock"
env -u HOME TMPDIR="$place/temporary" TZ=Asia/Kathmandu LANG=de_DE.UTF-8 LC_ALL=de_DE.UTF-8 \
    LD_PRELOAD="$clock/odd_clock.so" ODD_CLOCK="$clock/ahead" ODD_CLOCK_OF_ALL=1 \
    tests/run.sh "${1:-^tests/(farm|web|unit)/}"
