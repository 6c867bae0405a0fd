#!/bin/bash
# Checks the place that scripts/guest provides. Needs nothing built.
set -uo pipefail

cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." || exit 1
if [[ -z ${CANWIRE_PLACE:-} ]]; then
    named=$(mktemp -d) file=$(mktemp) && trap 'rm -rf -- "$named" "$file"' EXIT
    echo 'a file' >"$file" && echo 'in a folder' >"$named/file"
    scripts/guest -- tests/kernel/guest_selftest.sh "$file" "$named/file"
    status=$?
    if [[ $(cat "$file" "$named/file") != $'a file\nin a folder' ]]; then
        echo "what a guest has written is on the host" >&2
        status=1
    fi
    exit "$status"
fi

passed=0 failed=0
work=$(mktemp -d) && trap 'rm -rf -- "$work"' EXIT

# check NAME EXPECTED ACTUAL
check() {
    if [[ $2 == "$3" ]]; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        printf 'FAIL %s: expected <%s>, got <%s>\n' "$1" "$2" "$3"
    fi
}

# check_run NAME STATUS COMMAND…: also leaves the outputs in $work/out and $work/err
check_run() {
    local name=$1 expected=$2
    shift 2
    "$@" >"$work/out" 2>"$work/err"
    check "$name: status" "$expected" "$?"
}

# Waits for up to ten seconds until a command succeeds.
wait_until() {
    local try
    for ((try = 0; try < 200; try++)); do
        if "$@" 2>/dev/null; then return; fi
        sleep 0.05
    done
    return 1
}

links() { ip -o link show | sed 's/^[0-9]*: \([^:@]*\).*/\1/' | LC_ALL=C sort | tr '\n' ' '; }
listening() { grep -q "^ *$1 " /proc/net/can/rcvlist_all; }

the_place() {
    check "user" 0 "$(id -u)"
    check "links" "lo " "$(links)"
    check "lo is up" 1 "$(ip -o link show dev lo up | wc -l)"
    check "multicast route" 1 "$(ip route show 224.0.0.0/4 | grep -c 'dev lo')"
    check "standard input is empty" 0 "$(wc -c)"
    check "no terminal" 1 "$(tty -s && echo 0 || echo 1)"
    check_run "/run is writable" 0 touch /run/x
    check_run "/tmp is writable" 0 touch /tmp/canwire-selftest && rm -f /tmp/canwire-selftest
    check_run "/dev/null" 0 dd if=/dev/zero of=/dev/null count=1
    check "/dev/urandom" 8 "$(head -c 8 /dev/urandom | wc -c)"
    check_run "a pseudo-terminal" 0 script -qec true /dev/null
    mkdir -p build
    check_run "the checkout is writable" 0 mktemp build/selftest.XXXXXX
    rm -f -- "$(<"$work/out")"
    check_run "other users' namespaces" 0 unshare -Urn true
    check "files of /tmp that are named" "$shared" "$(cat -- "$@" | tr '\n' ' ')"
    if (($#)) && [[ $CANWIRE_PLACE == qemu ]]; then
        # shellcheck disable=SC2016 # that is the point
        check_run "they can be written" 0 sh -c 'echo >>"$1" && mkdir "${2%/*}/new"' sh "$@"
    fi
}

shared=''
if (($#)); then shared='a file in a folder '; fi

frames() {
    check_run "vcan" 0 ip link add vcan0 type vcan
    check_run "vxcan" 0 ip link add vx0 type vxcan peer name vx1
    check_run "up" 0 ip link set vcan0 up
    timeout 20 candump -L -n 2 vcan0 >"$work/dump" &
    local dump=$!
    check_run "candump listens" 0 wait_until listening vcan0
    check_run "cansend" 0 cansend vcan0 123#DEADBEEF
    check_run "cansend, extended" 0 cansend vcan0 12345678#R
    wait "$dump"
    check "candump: status" 0 "$?"
    check "frames" "123#DEADBEEF 12345678#R " "$(cut -d' ' -f3 "$work/dump" | tr '\n' ' ')"
    check_run "cangw" 0 cangw -A -s vcan0 -d vx0
    check_run "clean up" 0 ip link delete vcan0
    check_run "clean up" 0 ip link delete vx0
}

# The script inside itself: always the host namespace, whose kernel is now the guest's.
nested() {
    local status
    for status in 0 1 77 255; do
        check_run "exit $status" "$status" scripts/guest -q sh -c "exit $status"
    done
    check_run "killed" 143 scripts/guest -q sh -c 'kill -TERM $$'
    check_run "time limit" 124 scripts/guest -q -t 1 sleep 60
    check_run "no such command" 127 scripts/guest -q ./no-such-command
    check_run "no command" 2 scripts/guest
    check_run "bad option" 2 scripts/guest --bad true
    check_run "bad limit" 2 scripts/guest -t soon true
    check_run "outputs" 0 scripts/guest sh -c 'echo out; echo err >&2'
    check "standard output" "out" "$(<"$work/out")"
    check "standard error" "guest: host network namespace err " "$(tr '\n' ' ' <"$work/err")"
    # shellcheck disable=SC2016 # that is the point
    check_run "arguments" 0 scripts/guest -q -- printf '<%s>' 'a b' "it's" '"$HOME"' '' '*' $'x\ny'
    check "arguments arrive" "<a b><it's><\"\$HOME\"><><*><x"$'\n'"y>" "$(<"$work/out")"
    check_run "a network of its own" 0 scripts/guest -q ip link add vcan0 type vcan
    check "nothing is left" "lo " "$(links)"
    check_run "no multicast" 0 scripts/guest -q --no-multicast ip route
    check "no route" "" "$(<"$work/out")"
    check_run "without privileges" 0 setpriv --reuid 65534 --regid 65534 --clear-groups \
        scripts/guest -q ip link add vcan0 type vcan
}

for part in the_place frames nested; do
    before=$failed
    "$part" "$@"
    if ((failed > before)); then echo "in $part: $((failed - before)) failed"; fi
done
printf '%s passed, %s failed\n' "$passed" "$failed"
((failed == 0))
