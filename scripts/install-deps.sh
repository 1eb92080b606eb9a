#!/usr/bin/env bash
# Install what building, testing and running Azulejo needs, where it is missing.
#
# Debian and Ubuntu: apt-get, through sudo when not root. Elsewhere: if everything is there
# already, nothing; else the packages' names are printed and the exit status is 1.
# --tests: also the shells whose completion is tested, the browser that the page is tested in, what the
# API's description is checked with, what Blender's Python has, and what knows the system calls that units allow (on Debian).
set -eu

debian=(gcc g++ make libc6-dev pkg-config python3 protobuf-c-compiler librsvg2-bin
        libuv1-dev libopenexr-dev libembree-dev libprotobuf-c-dev libssl-dev libsqlite3-dev
        libjansson-dev libwebsockets-dev libwebsockets-evlib-uv libpng-dev libjpeg-dev libwebp-dev zlib1g-dev libdeflate-dev libzstd-dev libdraco-dev libcmocka-dev)
if [ "${1:-}" = --tests ]; then debian+=(zsh fish chromium curl systemd python3-yaml python3-jsonschema python3-numpy); fi
fedora=(gcc gcc-c++ make glibc-devel pkgconf-pkg-config python3 protobuf-c-compiler librsvg2-tools
        libuv-devel openexr-devel embree-devel protobuf-c-devel openssl-devel sqlite-devel
        jansson-devel libwebsockets-devel libpng-devel libjpeg-turbo-devel libwebp-devel zlib-devel libdeflate-devel libzstd-devel draco-devel libcmocka-devel)
arch=(gcc make pkgconf python protobuf-c librsvg
      libuv openexr embree openssl sqlite jansson libwebsockets libpng libjpeg-turbo libwebp zlib libdeflate zstd draco cmocka)

install_on_debian() {
    local package missing=() run=()
    for package in "${debian[@]}"; do
        dpkg-query -W -f='${Status}\n' "$package" 2>/dev/null | grep -q 'ok installed' ||
            missing+=("$package")
    done
    if [ ${#missing[@]} -eq 0 ]; then
        return 0
    fi
    echo "installing: ${missing[*]}"
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            echo "not root, and there is no sudo. As root: apt-get install ${missing[*]}" >&2
            return 1
        fi
        run=(sudo)
    fi
    ${run[@]+"${run[@]}"} apt-get update -q
    ${run[@]+"${run[@]}"} env DEBIAN_FRONTEND=noninteractive \
        apt-get install -q -y --no-install-recommends "${missing[@]}"
}

# Headers and tools rather than packages: true on any system.
everything_is_there() {
    local tool
    for tool in cc c++ make pkg-config protoc-c python3 rsvg-convert; do
        command -v "$tool" >/dev/null || return 1
    done
    pkg-config --exists libuv openssl sqlite3 jansson libwebsockets libpng libjpeg libwebp zlib libdeflate libzstd libprotobuf-c OpenEXR draco \
        cmocka || return 1
    printf '#include <embree4/rtcore.h>\n' | cc -E -x c - >/dev/null 2>&1 ||
        printf '#include <embree3/rtcore.h>\n' | cc -E -x c - >/dev/null 2>&1
}

if command -v dpkg-query >/dev/null && command -v apt-get >/dev/null; then
    install_on_debian
elif everything_is_there; then
    :
else
    cat >&2 <<TEXT
Something that Azulejo is built with is missing, and this script installs only on Debian
and Ubuntu. Elsewhere, please install it and try again:
  Fedora: sudo dnf install ${fedora[*]}
  Arch:   sudo pacman -S --needed ${arch[*]}
TEXT
    exit 1
fi
