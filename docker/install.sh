#!/bin/sh
# The steps of the image, each as one command, so that they run and are tested without an image too:
#
#   install.sh page                   build the page from service/page (needs Node.js and npm)
#   install.sh wheel FOLDER           build the wheel of this checkout into FOLDER
#   install.sh venv FOLDER TARGET [EXTRAS]
#                                     install the wheel of FOLDER into a new environment TARGET
#
# PYTHON names the interpreter [default: python3]; it has `build` and hatchling for the wheel.
set -eu
checkout=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
python=${PYTHON:-python3}

case ${1:-} in
page)
    npm --prefix "$checkout/service/page" ci --no-audit --no-fund
    npm --prefix "$checkout/service/page" run build
    ;;
wheel)
    "$python" -m build --wheel --no-isolation --outdir "${2:?FOLDER}" "$checkout"
    ;;
venv)
    folder=${2:?FOLDER}
    target=${3:?TARGET}
    extras=${4:-}
    "$python" -m venv "$target"
    for wheel in "$folder"/semap-*.whl; do
        "$target/bin/python" -m pip install --no-cache-dir --disable-pip-version-check \
            -c "$checkout/constraints.txt" "$wheel${extras:+[$extras]}"
    done
    "$target/bin/semap" --version
    ;;
*)
    sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac
