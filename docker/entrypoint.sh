#!/bin/sh
# semap, with the password of its database taken from a file where one is named, as secrets of containers are.
set -eu
if [ -n "${SEMAP_DB_PASSWORD_FILE:-}" ]; then
    PGPASSWORD=$(cat -- "$SEMAP_DB_PASSWORD_FILE")
    export PGPASSWORD
fi
exec semap "$@"
