#!/usr/bin/env bash
# Does the place of a clone show? Builds HEAD in a folder that other users cannot enter and whose name has a space and a
# letter beyond ASCII, and runs the tests of farms, pages and units there: with umask 077, a TMPDIR of its own, no HOME,
# another time zone and language, and, where faketime is installed, a clock that is a year ahead.
#
#   tests/elsewhere.sh [PATTERN]
set -euo pipefail
cd "$(dirname "$0")/.."
umask 077
place=$(mktemp -d "/var/tmp/azulejo é XXXXXX")
trap 'rm -rf "$place"' EXIT
mkdir "$place/temporary"
git clone -q --no-hardlinks . "$place/project"
cd "$place/project"
make -j"$(nproc)" all tests
ahead=()
if command -v faketime >/dev/null; then
    ahead=(env NO_FAKE_STAT=1 faketime -m --exclude-monotonic -f +365d)
else
    echo "the date is today's: faketime is not installed"
fi
env -u HOME TMPDIR="$place/temporary" TZ=Asia/Kathmandu LANG=de_DE.UTF-8 LC_ALL=de_DE.UTF-8 \
    "${ahead[@]}" tests/run.sh "${1:-^tests/(farm|web|unit)/}"
