#!/bin/sh
# Installs the uv of locks/all.txt into a new environment of its own, with the pip that Python brings:
#
#   fetch_uv.sh TARGET
#
# PYTHON names the interpreter [default: python3]; it needs its venv module.
set -eu
lock=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)/all.txt
target=${1:?TARGET}
rm -rf "$target"
"${PYTHON:-python3}" -m venv "$target"
sed -n '/^uv==/,/[^\\]$/p' "$lock" >"$target/uv.txt"
"$target/bin/python" -m pip --disable-pip-version-check -q install --no-cache-dir --no-deps --require-hashes -r "$target/uv.txt"
