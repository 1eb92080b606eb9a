#!/usr/bin/env bash
# make new-lobe NAME=x: a lobe's file, its rows, a material for its test and a section of the manual.
# What is made builds and passes, and does nothing until its weight is set. See docs/EXTENDING.md.
set -eu
cd "$(dirname "$0")/.."
name=${1:-}
if ! [[ $name =~ ^[a-z][a-z0-9_]*$ ]]; then
    echo "new-lobe: NAME must be lower case letters, digits and _, as in: make new-lobe NAME=velvet" >&2
    exit 2
fi
