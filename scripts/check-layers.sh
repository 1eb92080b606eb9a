#!/usr/bin/env bash
# Prove the dependency rule: common <- protocol <- {coordinator, web, worker, client};
# worker/render sees only common; uv.h, sqlite3.h, embree and jansson.h only where they belong.
set -u
cd "$(dirname "$0")/.."
bad=0

# forbid FOLDER REGEX: no source under FOLDER may include a path that matches REGEX.
forbid() {
    local hits
    hits=$(grep -rnE "^[[:space:]]*#[[:space:]]*include[[:space:]]*[<\"]($2)" --include='*.c' --include='*.h' "$1" 2>/dev/null)
    if [ -n "$hits" ]; then
        printf '%s must not include %s:\n%s\n' "$1" "$2" "$hits"
        bad=1
    fi
}
forbid common '(protocol|coordinator|web|worker|client|tests)/'
forbid common 'uv\.h|sqlite3\.h|embree'
forbid protocol '(coordinator|web|worker|client|tests)/'
forbid protocol 'sqlite3\.h|embree'
forbid worker/render '(protocol|coordinator|client|tests)/|uv\.h|sqlite3\.h|openssl/|pthread\.h|stdio\.h.*socket'
forbid worker/render 'worker/[a-z_]+\.h'
forbid coordinator '(web|worker|client|tests)/|embree|jansson'
forbid web '(coordinator|worker|client|tests)/|sqlite3\.h|embree'
forbid worker '(coordinator|web|client|tests)/|sqlite3\.h'
forbid client '(coordinator|web|worker|tests)/|sqlite3\.h|embree'
forbid scenes '(protocol|coordinator|worker|client|tests)/'

# Only the store speaks SQL; only accel*.c speak Embree.
hits=$(grep -rln 'sqlite3\.h' --include='*.[ch]' coordinator 2>/dev/null | grep -vE '^coordinator/store/store' )
[ -z "$hits" ] || { echo "only coordinator/store/store*.c may include sqlite3.h: $hits"; bad=1; }
hits=$(grep -rlnE 'embree[34]/' --include='*.[ch]' worker 2>/dev/null | grep -vE '^worker/render/accel/accel(_[a-z]+)?\.[ch]$')
[ -z "$hits" ] || { echo "only worker/render/accel/accel*.c may include Embree: $hits"; bad=1; }
hits=$(grep -rln 'jansson\.h' --include='*.[ch]' protocol 2>/dev/null | grep -v '^protocol/json/json_wire_read\.c$')
[ -z "$hits" ] || { echo "in protocol, only json_wire_read.c may include jansson: $hits"; bad=1; }
# Only web/http speaks libwebsockets, and the server knows what serves the page only as its guest.
hits=$(grep -rln 'libwebsockets\.h' --include='*.[ch]' common protocol coordinator web worker client 2>/dev/null | grep -v '^web/http/')
[ -z "$hits" ] || { echo "only web/http may include libwebsockets.h: $hits"; bad=1; }
for folder in farm frame job film store events net pictures steering; do
    forbid "coordinator/$folder" 'coordinator/page/'
done
# Logic takes time and output as arguments: no uv.h.
for folder in coordinator/farm coordinator/pictures coordinator/steering coordinator/frame coordinator/job coordinator/film coordinator/store coordinator/events; do
    forbid "$folder" 'uv\.h'
done
for file in coordinator/net/admission coordinator/net/descriptors web/http/guard web/http/http_queue; do
    for source in "$file".[ch] "${file}"_*.[ch]; do
        [ -f "$source" ] && forbid "$source" 'uv\.h'
    done
done
[ "$bad" -eq 0 ] && echo "layers: ok"
exit "$bad"
