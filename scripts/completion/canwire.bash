# SPDX-License-Identifier: MIT
# shellcheck shell=bash
#
# canwire.bash - completes the command lines of canwire, canwired, canwire-usb and canwire-restbus
# in bash, which reads it by the name of each of them.
#
# Names of buses are those of the sockets in /run/canwire; nodes and rules are asked of the bus.

_canwire_commands="check vcan bits timing sim campaign analyse status watch top record extcap"
_canwire_commands+=" faults inject clear fire restart set reload run help"
_canwire_events="fault link drop restart arbitration-lost improper-arbitration error overload"
_canwire_events+=" protocol-exception overrun rx tx wake state skip sync capture"

# Words of $1 that begin as the word being typed.
_canwire_words() {
    mapfile -t COMPREPLY < <(compgen -W "$1" -- "$current")
}

_canwire_files() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f -- "$current")
}

# Configurations and folders; any file where there is neither.
_canwire_yaml() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(
        compgen -f -X '!*.yaml' -- "$current"
        compgen -f -X '!*.yml' -- "$current"
        compgen -d -- "$current"
    )
    ((${#COMPREPLY[@]})) || _canwire_files
}

_canwire_buses() {
    local socket
    for socket in "${CANWIRE_RUN:-/run/canwire}"/*.sock; do
        [[ -S $socket ]] && basename "$socket" .sock
    done
}

_canwire_nodes() {
    "$tool" status "$1" 2>/dev/null | sed -n 's/^[0-9]\+: \([^@:]*\).*/\1/p'
}

_canwire_controllers() {
    "$tool" timing --help 2>/dev/null | sed -n '/^Controllers:/,$ { s/Controllers://; p }'
}

_canwire_rules() {
    "$tool" faults "$1" 2>/dev/null | awk 'NR > 1 { print $1 }'
}

# A bus by its name, or by the path of its socket.
_canwire_bus() {
    if [[ $current == */* ]]; then
        _canwire_files
    else
        _canwire_words "$(_canwire_buses)"
    fi
}

# Options of subcommand $1, with those that take an argument as NAME=.
_canwire_options() {
    case $1 in
    check) echo --ports --journal --help ;;
    bits) echo --raw --fd-non-iso --help ;;
    timing)
        echo --bitrate --clock --tq --sample-point --delay --length --tx-delay --rx-delay --sjw \
            --controller --kernel --dbitrate --dsample-point --json --help
        ;;
    sim | campaign)
        "$tool" "$1" --help 2>/dev/null | grep -o -- '^  --[a-z-]\+' | tr -d ' ' && echo --help
        ;;
    analyse) echo --simulate --error-every --error-rate --json --help ;;
    status) echo --json --check --load --state --sinks --links --losses --wait --help ;;
    faults) echo --json --wait --help ;;
    watch) echo --json --text --wait --help ;;
    top) echo --interval --once --wait --help ;;
    record) echo --format --size --files --wait --help ;;
    extcap)
        echo --extcap-interfaces --extcap-interface --extcap-dlts --extcap-config --capture --fifo \
            --frames-only --extcap-capture-filter --extcap-version --help
        ;;
    inject) echo --keep --with --wait --help ;;
    clear) echo --injected --wait --help ;;
    reload) echo --config --pid --wait --help ;;
    run) echo --bus --as --interface --virtual --wait --help
        ;;
    fire | restart | set) echo --wait --help ;;
    *) echo --help ;;
    esac
}

# Prints the value of the last option $1 before the word that is being typed.
_canwire_value() {
    local i
    for ((i = COMP_CWORD - 2; i > 1; i--)); do
        if [[ ${COMP_WORDS[i - 1]} == "$1" ]]; then
            echo "${COMP_WORDS[i]}"
            return
        fi
    done
}

# Sets $place to how many words that are no options stand before the one being typed, and $bus to
# the first of them.
_canwire_place() {
    local i word
    place=0
    bus=
    for ((i = 2; i < COMP_CWORD; i++)); do
        word=${COMP_WORDS[i]}
        case ${COMP_WORDS[i - 1]} in
        --format | --size | --files | --with | --until | --simulate | --error-every | \
            --error-rate | --until-event | --seed | --seeds | --jobs | --from | --to | --events | \
            --log | --pcapng | --stats | --vcd | --svg | --junit | --journal | --config | --pid | \
            --bus | --as | --interface | --interval | --wait | --out | --shard | --only | --work | \
            --campaign | --ftti | --confidence) continue ;;
        esac
        [[ $word == -* || $word == = || ${COMP_WORDS[i - 1]} == = ]] && continue
        [[ -z $bus ]] && bus=$word
        place=$((place + 1))
    done
}

# Completes argument $place of subcommand $1.
_canwire_argument() {
    case $1:$place in
    analyse:0 | check:0 | sim:0 | timing:0 | inject:1 | vcan:1) _canwire_yaml ;;
    record:1 | campaign:[1-9]*) _canwire_files ;;
    vcan:0) _canwire_words "up down" ;;
    campaign:0) _canwire_words "plan run show files report" ;;
    status:0 | watch:0 | top:* | record:0 | faults:0 | inject:0 | clear:0 | fire:0 | restart:0 | \
        set:0 | reload:0)
        _canwire_bus
        ;;
    run:0) mapfile -t COMPREPLY < <(compgen -c -- "$current") ;;
    run:*) _canwire_files ;;
    clear:1 | fire:1) _canwire_words "$(_canwire_rules "$bus")" ;;
    restart:1 | set:1) _canwire_words "$(_canwire_nodes "$bus")" ;;
    set:*) _canwire_settings ;;
    watch:*) _canwire_words "$_canwire_events record" ;;
    help:0) _canwire_words "$_canwire_commands" ;;
    esac
}

# Lines KEY RANGE. SENTENCE of the settings of a node; some go on in further lines.
_canwire_setting_lines() {
    "$tool" set --help 2>/dev/null | sed -n 's/^  \([a-z][a-z0-9-]*\)  */\1 /p'
}

# KEY=VALUE; bash may have taken it apart at the '='.
_canwire_settings() {
    local key=${COMP_WORDS[COMP_CWORD - 1]}
    if [[ $current == = || $key == = ]]; then
        [[ $current == = ]] && current= || key=${COMP_WORDS[COMP_CWORD - 2]}
        _canwire_words "$(_canwire_setting_lines | sed -n "s/^$key \([a-z, ]*\)[.].*/\1/p" |
            sed 's/,\| or / /g')"
    else
        compopt -o nospace 2>/dev/null
        _canwire_words "$(_canwire_setting_lines | sed 's/ .*/=/')"
    fi
}

_canwire() {
    local tool=${COMP_WORDS[0]} command=${COMP_WORDS[1]} current=${COMP_WORDS[COMP_CWORD]}
    local place bus
    COMPREPLY=()
    if ((COMP_CWORD == 1)); then
        _canwire_words "$_canwire_commands --help --version"
        return
    fi
    case ${COMP_WORDS[COMP_CWORD - 1]} in
    --bus)
        _canwire_bus
        return
        ;;
    --as)
        _canwire_words "$(_canwire_nodes "$(_canwire_value --bus)")"
        return
        ;;
    --events | --log | --pcapng | --stats | --vcd | --svg | --junit | --journal)
        _canwire_files
        return
        ;;
    --until-event)
        _canwire_words "error-active error-warning error-passive bus-off sleeping $_canwire_events"
        return
        ;;
    --format)
        _canwire_words "candump pcapng"
        return
        ;;
    --size)
        _canwire_words "1MB 10MB 100MB 1GB"
        return
        ;;
    --controller)
        _canwire_words "$(_canwire_controllers)"
        return
        ;;
    --until | --seed | --from | --to | --with | --files | \
        --bitrate | --clock | --tq | --sample-point | --delay | --length | --tx-delay | \
        --rx-delay | --sjw | --dbitrate | --dsample-point) return ;;
    esac
    if [[ $current == -* ]]; then
        _canwire_words "$(_canwire_options "$command")"
        return
    fi
    _canwire_place
    _canwire_argument "$command"
}

_canwired() {
    local current=${COMP_WORDS[COMP_CWORD]}
    case ${COMP_WORDS[COMP_CWORD - 1]} in
    -c | --config) _canwire_yaml ;;
    --journal) _canwire_files ;;
    *)
        _canwire_words "-c --config --background --journal --journal-files --verbose --help \
            --version"
        ;;
    esac
}

_canwire_usb() {
    local current=${COMP_WORDS[COMP_CWORD]}
    if [[ ${COMP_WORDS[COMP_CWORD - 1]} == --user ]]; then
        mapfile -t COMPREPLY < <(compgen -u -- "$current")
    elif [[ $current == -* ]]; then
        _canwire_words "--user --help --version"
    else
        _canwire_yaml
    fi
}

_canwire_restbus() {
    local current=${COMP_WORDS[COMP_CWORD]}
    case ${COMP_WORDS[COMP_CWORD - 1]} in
    --without | --only | --cycle | --sender | --name | --bitrate | --dbitrate) return ;;
    esac
    if [[ $current == -* ]]; then
        _canwire_words "--without --only --cycle --sender --spread --no-strict --name --bitrate \
            --dbitrate --help"
        return
    fi
    _canwire_files
}

complete -F _canwire canwire
complete -F _canwire_restbus canwire-restbus
complete -F _canwire_usb canwire-usb
complete -F _canwired canwired
