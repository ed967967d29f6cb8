#!/bin/sh
# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

# Makes .venv beside this file and installs telescope_mount into it, with the ROS wheels.
#   ./install.sh [EXTRAS]     EXTRAS: ros (default), or ros,test or ros,test,bench; images: FITS;
#                             indi: mounts of an INDI server; alpaca: of an Alpaca server
# A second run changes nothing unless the requirements changed.
set -eu
cd "$(dirname "$0")"
extras=${1:-ros}
venv=${VENV:-.venv}
say() { printf '%s\n' "$*" >&2; }

python=
for name in ${PYTHON:-} python3 python3.13 python3.12 python3.11 python3.10; do
    if command -v "$name" >/dev/null 2>&1 &&
        "$name" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 15))' 2>/dev/null
    then python=$name; break; fi
done
if [ "$(uname -sm)" != 'Linux x86_64' ]; then
    say 'error: the ROS wheels exist for Linux on x86-64 only; without ROS: pip install . (docs/install.md)'
    exit 2
fi
need_apt=
[ -n "$python" ] || need_apt='python3 python3-venv'
[ -n "$need_apt" ] || "$python" -c 'import ensurepip, venv' 2>/dev/null || need_apt=python3-venv
if [ -n "$need_apt" ]; then
    if ! command -v apt-get >/dev/null 2>&1; then
        say 'error: Python 3.10 or later with its venv module is needed; install it and try again'
        exit 2
    fi
    sudo=
    [ "$(id -u)" = 0 ] || sudo=sudo
    say "installing $need_apt ..."
    # shellcheck disable=SC2086
    $sudo apt-get update -qq && $sudo apt-get install -y -qq $need_apt >/dev/null
    python=python3
fi

wanted="$extras $("$python" --version) $(cat setup.py constraints.txt | cksum)"
if [ "$(cat "$venv/.installed" 2>/dev/null || true)" != "$wanted" ]; then
    [ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
    [ $# -gt 0 ] || say 'no EXTRAS given: with ROS (for files alone: pip install ., see README.md)'
    say "installing telescope_mount[$extras] into $venv ..."
    "$venv/bin/python" -m pip install -q --disable-pip-version-check \
        -c constraints.txt -e ".[$extras]"
    # as pip does with what it copies: else the first command does it, or each that may not write
    "$venv/bin/python" -m compileall -q -x '/(\.|test/|benchmarks/)' . || :
    printf '%s\n' "$wanted" > "$venv/.installed"
    case $extras in *ros*) next='night --out night' ;; *) next=--help ;; esac
    say "done; next: $venv/bin/telescope-mount $next"
else
    say "telescope_mount[$extras] is in $venv already"
fi
