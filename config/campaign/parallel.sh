#!/bin/sh
# SPDX-License-Identifier: MIT
# A campaign on several machines, with GNU parallel and ssh:
#
#   sh parallel.sh FILE SHARDS HOSTS
#
# HOSTS is a file for --sshloginfile: a line "4/user@host" for each machine, 4 jobs at a time
# there; "2/:" is this machine. They need canwire and rsync. Call it in a folder that has all files
# of the campaign in it. The rows come into FILE.rows, and in the end into FILE.ndjson. After any
# end, the same call makes the shards that are missing.
set -eu
file=$1 shards=$2 hosts=$3
name=${file%.yaml} work=canwire-$(printf %s "$PWD/$file" | cksum | cut -d' ' -f1)
mkdir -p "$name.rows"
# shellcheck disable=SC2016,SC2046 # variables of the other machine; an option for each file
seq "$shards" | parallel --sshloginfile "$hosts" --joblog "$name.rows/log" --resume-failed \
    --retries 3 --workdir "$work" --cleanup --results "$name.rows/{}.ndjson" --quote \
    $(canwire campaign files "$file" | sed 's/^/--basefile /') \
    sh -c '[ -e "$1" ] || cd "$3"
        canwire campaign run "$1" --shard "$2" --jobs 1 || [ $? -eq 3 ]' \
    sh "$file" "{}/$shards" "$PWD" >/dev/null || {
    echo "$0: a shard has failed; messages are in $name.rows/*.ndjson.err" >&2
    rmdir "$work" 2>/dev/null
    exit 1
}
rmdir "$work" 2>/dev/null || true # of jobs of this machine
seq -f "$name.rows/%.0f.ndjson" "$shards" | xargs cat >"$name.ndjson.part"
exec canwire campaign run "$file" --shard 1/1 --out "$name.ndjson" --resume # checks all rows
