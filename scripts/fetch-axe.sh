#!/usr/bin/env bash
# Fetch axe-core, the checker of accessibility that tests/web uses, from the npm registry into
# build/axe/axe.min.js. Its version and the SHA-512 of its archive are fixed here; it is no part of Azulejo
# (licence: MPL-2.0) and is not committed. Where it is there already, nothing is done.
set -eu
cd "$(dirname "$0")/.."
version=4.14.1
sha512=FHfa+lmNjQZfJz1q8wKqIDwC6DExcHt/pkjNQb09a3NPjCKg2rhu5qb2S4r76ASyFNNtuFooJpZe37OgudVGtQ==
folder=build/axe

[ "$(cat $folder/version 2>/dev/null)" = "$version" ] && exit 0
if ! command -v npm >/dev/null; then
    echo "fetch-axe: npm is not installed (Debian: apt-get install npm)" >&2
    exit 1
fi
rm -rf $folder
mkdir -p $folder
if ! (cd $folder && timeout 60 npm pack --silent "axe-core@$version" >/dev/null); then
    echo "fetch-axe: the npm registry did not give axe-core $version" >&2
    exit 1
fi
archive=$folder/axe-core-$version.tgz
found=$(openssl dgst -sha512 -binary "$archive" | openssl base64 -A)
if [ "$found" != "$sha512" ]; then
    echo "fetch-axe: $archive is not the archive that is known: SHA-512 $found" >&2
    exit 1
fi
tar -xzf "$archive" -C $folder --strip-components=1 package/axe.min.js package/LICENSE
rm "$archive"
echo "$version" >$folder/version
