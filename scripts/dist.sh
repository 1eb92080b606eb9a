#!/usr/bin/env bash
# `make dist`: the last commit as out/azulejo-VERSION.tar.gz, the same bytes from every clone.
#
#   scripts/dist.sh VERSION [FOLDER]
#
# Git's tar has the commit's date for every file, and gzip -n no date of its own. A person's git settings that would change
# the archive are overridden.
set -eu
version=$1 folder=${2:-out}
cd "$(dirname "$0")/.."
git rev-parse --verify -q HEAD >/dev/null || { echo "make dist: this is no git clone: an archive is made of a commit" >&2; exit 1; }
if [ -n "$(git status --porcelain --untracked-files=no)" ]; then
    echo "make dist: there are changes that are not committed; the archive is without them" >&2
fi
mkdir -p "$folder"
name=azulejo-$version
git -c tar.umask=0022 -c core.autocrlf=false archive --format=tar --prefix="$name/" HEAD | gzip -n -9 >"$folder/$name.tar.gz.tmp"
mv "$folder/$name.tar.gz.tmp" "$folder/$name.tar.gz"
(cd "$folder" && sha256sum "$name.tar.gz" | tee "$name.tar.gz.sha256")
