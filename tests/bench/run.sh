#!/usr/bin/env bash
# `make bench`: the tables of docs/PERFORMANCE.md, in some five minutes. `report.py renderer threads`: those alone; `report.py kernels`:
# each kernel against the general one; `report.py auto`: what `--effects auto` saves, in docs/EFFECTS.md; `report.py against FOLDER`: this
# tree and another checkout, which is built, in turns.
#
# BUILD names the build tree. AZULEJO_DATA, when set, adds a scene from outside. Figures are
# medians; CPU-seconds are compared rather than seconds, because machines are shared.
set -eu
cd "$(dirname "$0")/../.."
exec python3 -B tests/bench/report.py
