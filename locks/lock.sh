#!/bin/sh
# Writes the locks that ./dev and the image install from:
#
#   locks/all.txt    every package of every extra and of the group dev, direct and indirect, with its hashes
#   locks/demo.txt   those of all.txt that the demo needs; their hashes are in all.txt alone
#
# Both are for every Python from the least that pyproject.toml promises, and for every platform. Versions stay as they
# are unless pyproject.toml asks for others.
#
#   lock.sh             write them; options go to uv, such as --upgrade or --upgrade-package numpy
#   lock.sh --check     fail unless the least Python can have the locks and they are what would be written
#
# UV names uv [default: the one that ./dev has fetched].
set -eu
CDPATH='' cd -- "$(dirname -- "$0")/.."
uv=${UV:-$PWD/.uv/bin/uv}
least=$(sed -n 's/^requires-python = ">=\([0-9.]*\)"$/\1/p' pyproject.toml)

fail() {
    printf 'lock: %s\n' "$1" >&2
    exit 1
}

# NAME FOLDER and what of pyproject.toml is in it
compile() {
    to=$2/$1.txt
    shift 2
    "$uv" pip compile -q pyproject.toml --universal --python-version "$least" --fork-strategy fewest \
        --group build --no-header --no-annotate -o "$to" "$@"
}

write() {
    folder=$1
    shift
    compile all "$folder" --all-extras --group dev --generate-hashes "$@" &&
        compile demo "$folder" --extra perception -c "$folder/all.txt"
}

case ${1:-} in
--check)
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    cp locks/all.txt locks/demo.txt "$work"
    "$uv" pip compile -q --python-version "$least" --no-header -o "$work/fit.txt" locks/all.txt >"$work/said" ||
        fail "Python $least, which pyproject.toml promises, cannot have locks/all.txt: see above. Make it anew: ./dev lock"
    write "$work"
    diff -u locks/all.txt "$work/all.txt" && diff -u locks/demo.txt "$work/demo.txt" ||
        fail 'locks/ is not what pyproject.toml leads to: the lines with + and - above. Make it anew: ./dev lock'
    ;;
*) write locks "$@" ;;
esac
