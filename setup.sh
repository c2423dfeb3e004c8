#!/usr/bin/env bash
# Installs what cardioid is built on, other than Rust: Embree (4.3 or later), OpenImageIO, OpenVDB and the tools of the build.
#
#   ./setup.sh
#
# Runs as root or through sudo, as often as you like: what is already there is left alone, and a second run does
# nothing. System packages come from apt. Where the distribution's Embree is too old (Debian 12 has 3.13) an Embree of
# the project's own goes to .deps/ beside this script, and nothing else on the machine changes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

readonly prefix=$PWD/.deps
readonly oldest_embree=4.3

# Embree 4.3.3 as its authors released it, repackaged without change in this wheel; pinned by content.
readonly wheel=raybender==4.0.3
readonly wheel_sha256=1308889d8a1b913d93c8afb9288e26d685b5060e4c66e03e3bc5de645d29a037
# The suite whose libembree-dev has the headers of that same version.
readonly headers_suite=trixie

say() { printf 'setup: %s\n' "$*"; }
fail() {
    printf 'setup: error: %s\n' "$*" >&2
    exit 1
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo "$@"
    else
        fail "installing packages takes root: run this as root, or install sudo"
    fi
}

# Prints those of the named packages that are not installed.
missing_packages() {
    local installed package
    # dpkg-query fails where it has never heard of one of them: that one is missing.
    installed=$(dpkg-query --show --showformat='${db:Status-Abbrev}${Package}\n' "$@" 2>/dev/null || true)
    for package in "$@"; do
        grep -qxE -- "ii +${package//+/\\+}" <<<"$installed" || printf '%s\n' "$package"
    done
}

apt_updated=no
apt_update() {
    [ "$apt_updated" = no ] || return 0
    say "refreshing apt's lists of packages"
    as_root apt-get update -qq || fail "'apt-get update' failed: see apt's message above"
    apt_updated=yes
}

# Installs those of the named packages that are not installed.
install_packages() {
    local missing
    mapfile -t missing < <(missing_packages "$@")
    [ "${#missing[@]}" -gt 0 ] || return 0
    apt_update
    say "installing from apt: ${missing[*]}"
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq --yes --no-install-recommends "${missing[@]}" >/dev/null ||
        fail "apt could not install ${missing[*]}: see apt's message above"
}

version_at_least() { # version_at_least HAVE WANTED
    dpkg --compare-versions "$1" ge "$2"
}

# Succeeds where an Embree of use stands under this prefix, whose headers may be in a folder of their own.
has_embree() { # has_embree PREFIX
    local config version
    config=$1/include/embree4/rtcore_config.h
    [ -r "$config" ] || return 1
    version=$(sed -n 's/^#define RTC_VERSION_STRING "\(.*\)"/\1/p' "$config")
    version_at_least "${version:-0}" "$oldest_embree" || return 1
    compgen -G "$1/lib*/libembree4.so" >/dev/null || compgen -G "$1/lib/*/libembree4.so" >/dev/null
}

# Succeeds, and prints the version, where apt offers an Embree of use.
apt_embree() {
    local version
    version=$(apt-cache policy libembree-dev 2>/dev/null | sed -n 's/^ *Candidate: *//p')
    [ -n "$version" ] && version_at_least "$version" "$oldest_embree" && printf '%s\n' "$version"
}

# Unpacks Embree's headers into DESTINATION/include. Nothing is installed: apt gets a state of its own, whose only source
# is the machine's own Debian mirror with the suite replaced.
fetch_headers() { # fetch_headers DESTINATION
    local state mirror
    state=$1/apt
    # shellcheck disable=SC2016 # apt's own variables
    mirror=$(apt-get indextargets --format '$(REPO_URI)' \
        'Created-By: Packages' 'Origin: Debian' 'Codename: bookworm' 'Component: main' | head -n 1)
    [ -n "$mirror" ] || fail "apt has no Debian 12 source: is there one in /etc/apt/sources.list.d?"
    mkdir -p "$state/lists/partial" "$state/cache/archives/partial"
    cat >"$state/sources.list" <<-END
	deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror $headers_suite main
	END
    : >"$state/status"
    local apt=(apt-get -qq
        -o "Dir::Etc::SourceList=$state/sources.list" -o Dir::Etc::SourceParts=/dev/null
        -o Dir::Etc::Preferences=/dev/null -o Dir::Etc::PreferencesParts=/dev/null
        -o "Dir::State=$state" -o "Dir::State::Lists=$state/lists" -o "Dir::State::status=$state/status"
        -o "Dir::Cache=$state/cache" -o APT::Sandbox::User=root -o Acquire::Languages=none)
    "${apt[@]}" update || fail "the Debian mirror of this machine does not serve $headers_suite: set EMBREE_DIR instead"
    (cd "$state" && "${apt[@]}" download libembree-dev) || fail "could not download libembree-dev of $headers_suite"
    dpkg-deb --extract "$state"/libembree-dev_*.deb "$state/package"
    mv "$state/package/usr/include" "$1/include"
}

# Unpacks Embree's library, and the TBB it was built against, into DESTINATION/lib under their usual names.
fetch_library() { # fetch_library DESTINATION
    local libraries tbb
    printf '%s --hash=sha256:%s\n' "$wheel" "$wheel_sha256" >"$1/requirements.txt"
    python3 -m pip --quiet download --no-deps --require-hashes --only-binary=:all: \
        --implementation cp --python-version 3.11 --abi cp311 --platform manylinux_2_28_x86_64 \
        --dest "$1" --requirement "$1/requirements.txt" || fail "pip could not download $wheel"
    python3 -m zipfile --extract "$1"/raybender-*.whl "$1/wheel"
    libraries=$1/wheel/raybender.libs
    tbb=$(basename "$libraries"/libtbb-*.so.12)
    mkdir "$1/lib"
    mv "$libraries"/libembree4-*.so.4 "$1/lib/libembree4.so.4"
    mv "$libraries/$tbb" "$1/lib/libtbb.so.12"
    # One change a call: patchelf 0.14 garbles a library when asked for two at once.
    patchelf --replace-needed "$tbb" libtbb.so.12 "$1/lib/libembree4.so.4"
    patchelf --set-soname libembree4.so.4 "$1/lib/libembree4.so.4"
    patchelf --set-soname libtbb.so.12 "$1/lib/libtbb.so.12"
    ln -s libembree4.so.4 "$1/lib/libembree4.so"
}

# Puts Embree into .deps/, all of it or nothing.
install_private_embree() {
    local staging
    say "fetching Embree 4.3.3 into .deps/"
    install_packages patchelf python3-pip
    apt_update # the mirror's address is known only once its lists are
    mkdir -p "$prefix"
    staging=$(mktemp -d "$prefix/staging.XXXXXX")
    # shellcheck disable=SC2064 # expanded now: the variable is local
    trap "rm -rf -- '$staging'" EXIT
    fetch_headers "$staging"
    fetch_library "$staging"
    rm -rf "${prefix:?}/include" "${prefix:?}/lib"
    mv "$staging/include" "$staging/lib" "$prefix"
    rm -rf -- "$staging"
    trap - EXIT
}

install_embree() {
    local place system
    # shellcheck source=/dev/null
    system=$(. /etc/os-release && echo "${ID:-}${VERSION_ID:-}")-$(uname -m)
    if [ -n "${EMBREE_DIR:-}" ]; then
        has_embree "$EMBREE_DIR" || fail "EMBREE_DIR=$EMBREE_DIR holds no Embree $oldest_embree or later:" \
            "expected include/embree4/rtcore_config.h and lib/libembree4.so there"
        return
    fi
    for place in "$prefix" /usr/local /usr; do
        ! has_embree "$place" || return 0
    done
    apt_update
    if apt_embree >/dev/null; then
        install_packages libembree-dev
    elif [ "$system" = debian12-x86_64 ]; then
        install_private_embree
    else
        fail "this system has no package of Embree $oldest_embree or later, and a private copy exists for Debian 12 on" \
            "x86-64 only. Install Embree from https://github.com/RenderKit/embree/releases, set EMBREE_DIR to its" \
            "folder, and run this again"
    fi
}

command -v apt-get >/dev/null || fail "this script knows apt only (Debian 12 or later, Ubuntu 24.04 or later)." \
    "Elsewhere install g++, libclang, OpenImageIO (2.4 or later, with headers), OpenVDB with headers, pkg-config, make and" \
    "Embree ($oldest_embree or later) by hand; set EMBREE_DIR to the folder of Embree if it is not under /usr or /usr/local"

# OpenVDB comes with OpenImageIO as a library; what is added are its headers, and those of boost that they include.
install_packages g++ make pkg-config libclang-dev libopenimageio-dev libopenvdb-dev libboost-dev
install_embree
command -v cargo >/dev/null || say "note: cargo is not on the PATH; Rust comes from https://rustup.rs"
say "ready"
