#!/bin/sh
# The steps of the image, each as one command, so that they run and are tested without an image too:
#
#   install.sh page                   build the page from service/page (needs Node.js and npm)
#   install.sh wheel FOLDER           build the wheel of this checkout into FOLDER
#   install.sh venv FOLDER TARGET [EXTRAS]
#                                     install the wheel of FOLDER into a new environment TARGET
#
# PYTHON names the interpreter [default: python3], UV the uv that locks/fetch_uv.sh installs [default: uv]. What is
# fetched is of the versions of locks/all.txt, and has their hashes.
set -eu
checkout=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
python=${PYTHON:-python3}
uv=${UV:-uv}
locked=$checkout/locks/all.txt

case ${1:-} in
page)
    npm --prefix "$checkout/service/page" ci --no-audit --no-fund
    npm --prefix "$checkout/service/page" run build
    ;;
wheel)
    "$uv" build --wheel --python "$python" --build-constraints "$locked" --require-hashes \
        --out-dir "${2:?FOLDER}" "$checkout"
    ;;
venv)
    folder=${2:?FOLDER}
    target=${3:?TARGET}
    extras=${4:-}
    "$uv" venv --python "$python" "$target"
    for wheel in "$folder"/semap-*.whl; do
        "$uv" pip install --python "$target" --compile-bytecode -c "$locked" "$wheel${extras:+[$extras]}"
    done
    "$target/bin/semap" --version
    ;;
*)
    sed -n '2,10s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac
