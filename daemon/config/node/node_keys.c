/* SPDX-License-Identifier: MIT
 *
 * node_keys.c - the keys of nodes, one row each.
 *
 * Readers of nodes, `defaults` and `guests`, rules that set, `canwire set` and its help, the JSON
 * schema and the man page all take them from here.
 */
#include "base/text/chars.h"
#include "base/text/jsonput.h"
#include "config/change/live.h"
#include "config/parts.h"
#include "config/change/retime.h"
#include "config/values.h"
#include "config/node/wake.h"

#include <inttypes.h>
#include <string.h>

#define TICKS_PER_MS (CW_CLOCK_HZ / 1000u)
#define QUEUE_DEFAULT 16u

static const schema_range restart_range = {0, UINT32_MAX, sizeof(uint32_t)};
static const schema_range queue_range = {1, CW_QUEUE_MAX, sizeof(uint16_t)};
static const schema_range warning_range = {1, 255, sizeof(uint16_t)};
static const schema_range brp_range = {1, CFG_BRP_MAX, sizeof(uint32_t)};
static const schema_range prop_range = {0, CFG_SEGMENT_MAX, sizeof(uint32_t)};
static const schema_range phase_range = {1, CFG_SEGMENT_MAX, sizeof(uint32_t)};
static const schema_range sjw_range = {1, CFG_SJW_MAX, sizeof(uint32_t)};
static const schema_range tdco_range = {0, CFG_TDC_CLOCKS_MAX, sizeof(uint32_t)};
static const schema_range tdcv_range = {1, CFG_TDC_CLOCKS_MAX, sizeof(uint32_t)};
static const schema_range guests_range = {1, CW_NODES_MAX - 1, sizeof(uint8_t)};

static const schema_choice kinds[] = {
    {.name = "2.0A", .value = CFG_KIND_2_0A},
    {.name = "2.0B-passive", .value = CFG_KIND_2_0B_PASSIVE},
    {.name = "2.0B", .value = CFG_KIND_CLASSICAL},
    {.name = "classical", .value = CFG_KIND_CLASSICAL},
    {.name = "fd-tolerant", .value = CFG_KIND_FD_TOLERANT},
    {.name = "fd", .value = CFG_KIND_FD},
    {.name = NULL},
};

static const schema_choice when_full_choices[] = {
    {.name = "drop", .value = CFG_WHEN_FULL_DROP},
    {.name = "wait", .value = CFG_WHEN_FULL_WAIT},
    {.name = NULL},
};

static const schema_choice tdc_modes[] = {
    {.name = "off", .value = CFG_TDC_OFF},
    {.name = "auto", .value = CFG_TDC_AUTO},
    {.name = "manual", .value = CFG_TDC_MANUAL},
    {.name = NULL},
};

#define MEMBER(member) .offset = offsetof(cfg_node, member)
#define NODES .where = CFG_IN_NODES
#define GUESTS .where = CFG_IN_GUESTS
#define SHARED .where = CFG_IN_DEFAULTS | CFG_IN_GUESTS

/* The change of a key while its node is in use. */
#define LIVE(...) .live = &(const cfg_live){__VA_ARGS__}
#define FIXED LIVE(.kind = CFG_LIVE_FIXED)
#define NUMBER(set, member, size, of)                                                              \
    LIVE(.kind = CFG_LIVE_NUMBER, .which = (set), .offset = offsetof(cw_settings, member),         \
         .bytes = sizeof(size), .unit = (of))
#define TIME(is, key, member, allowed)                                                             \
    LIVE(.kind = CFG_LIVE_##is, .time = (key), .offset = offsetof(cfg_retime, member),             \
         .range = (allowed))
#define WAY(is, set, key, member, allowed)                                                         \
    LIVE(.kind = CFG_LIVE_##is, .which = (set), .time = (key),                                     \
         .offset = offsetof(cfg_retime, way.member), .range = (allowed))

#define MODE(key, mode, told)                                                                      \
    {                                                                                              \
        .name = (key), .read = cfg_read_mode, LIVE(.kind = CFG_LIVE_MODE, .which = (mode)),        \
        .type = "boolean", .preset = "false", .help = (told)                                       \
    }
#define WHEN_FULL(reader, ...)                                                                     \
    {                                                                                              \
        .name = "when-full", .read = (reader), MEMBER(when_full), .arg = when_full_choices, FIXED, \
        .type = TYPE_CHOICE, __VA_ARGS__,                                                          \
        .help = "What becomes of frames that the ECU writes while the queue is full: dropped and " \
                "counted (default where the port is an interface), or the port is not read "       \
                "(default of unix:, fd:, tcp: and cannelloni:), which makes the program wait."     \
    }
#define CLIENTS(reader, ...)                                                                       \
    {                                                                                              \
        .name = "clients", .read = (reader), .map = cfg_clients_keys,                              \
        .type = TYPE_ANY(TYPE_INTEGER(1, 63) ", @"), __VA_ARGS__,                                  \
        .help = "Of a port unix:PATH or tcp:PORT: how programs share it (canwire-ports(7)). A "    \
                "number is that of clients."                                                       \
    }
#define WAKE_TIME(key, set, member, standard, told)                                                \
    {                                                                                              \
        .name = (key), .read = cfg_read_wake, .type = "time",                                      \
        LIVE(.kind = CFG_LIVE_WAKE_TIME, .which = (set),                                           \
             .offset = offsetof(cw_settings, sleep.member), .range = "a time such as 5us"),        \
        .preset = (standard), .help = (told)                                                       \
    }
#define DELAYS_RANGE "0 to 10ms, such as 120ns; or 120ns/180ns: to dominant, and to recessive"
#define LENGTH_RANGE "0 to 10km, such as 12m"
#define EDGES                                                                                      \
    .map = cfg_edge_keys,                                                                          \
    .type = "{'anyOf': [" TYPE_REF("time") ", @], 'examples': ['120ns']}"

/* The keys of phase n of a bit, whose names begin with a prefix: none, or d at the data rate. */
#define QUANTA(d, n, name_, KEY, limits, segment, told, ...)                                       \
    {                                                                                              \
        .name = d name_, .read = schema_read_uint, MEMBER(time.phase[n].bit.segment),              \
        .arg = &(limits), .help = (told),                                                          \
        TIME(CLOCKS, (n) * RETIME_PHASE_KEYS + (KEY), phase[n].bit.segment, NULL), __VA_ARGS__     \
    }
#define PHASE(d, n, of)                                                                            \
    {.name = d "sample-point",                                                                     \
     .read = cfg_read_sample_point,                                                                \
     MEMBER(time.phase[n].sample_permille),                                                        \
     TIME(SAMPLE, (n) * RETIME_PHASE_KEYS + RETIME_SAMPLE_POINT, phase[n].sample_permille,         \
          "10% to 99.9%, or 0.1 to 0.999"),                                                        \
     .help = "Finds the segments" of " as Linux does. Default: that of the bus."},                 \
        QUANTA(d, n, "brp", RETIME_BRP, brp_range, brp,                                            \
               "Prescaler" of ": clocks of a time quantum. With " d "prop-seg, " d                 \
               "phase-seg1 and " d "phase-seg2; the bit rate may differ from that of the bus.",    \
               .needs = d "prop-seg " d "phase-seg1 " d "phase-seg2",                              \
               .excludes = d "sample-point"),                                                      \
        QUANTA(d, n, "prop-seg", RETIME_PROP_SEG, prop_range, prop_seg, "In time quanta.",         \
               .needs = d "brp " d "phase-seg1 " d "phase-seg2",                                   \
               .excludes = d "sample-point"),                                                      \
        QUANTA(d, n, "phase-seg1", RETIME_PHASE_SEG1, phase_range, phase_seg1,                     \
               "In time quanta; the sample point follows.",                                        \
               .needs = d "brp " d "prop-seg " d "phase-seg2", .excludes = d "sample-point"),      \
        QUANTA(d, n, "phase-seg2", RETIME_PHASE_SEG2, phase_range, phase_seg2, "In time quanta.",  \
               .needs = d "brp " d "prop-seg " d "phase-seg1", .excludes = d "sample-point"),      \
        QUANTA(d, n, "sjw", RETIME_SJW, sjw_range, sjw,                                            \
               "Longest step of a resynchronisation, in time quanta. Default: half of " d          \
               "phase-seg2, as Linux does.", .needs = NULL)

/* All that depend on `port` follow it. It excludes `traffic`. Of the others `peer`, `missing-port`,
 * `clients` and `when-full` need it. The defaults of `queue` and `when-full` depend on it. Modes
 * are in the order of `ip`. */
const schema_key cfg_node_keys[] = {
    {.name = "name", .read = cfg_read_node_name, .required = true, NODES, .type = "name",
     .help = "Distinct."},
    {.name = "count", .read = cfg_read_guest_count, .required = true, GUESTS, MEMBER(guest),
     .arg = &guests_range,
     .type = TYPE_UINT,
     .help = "Guests at the same time. With the nodes of the list at most 64."},
    {.name = "port", .read = cfg_read_guest_port, .required = true, GUESTS, .type = "unixPort",
     .help = "Where clients connect, unix:PATH."},
    {.name = "port", .read = cfg_read_port, NODES, .map = cfg_usb_keys,
     .type = TYPE_ANY(TYPE_REF("port") ", @"), .excludes = "traffic",
     .help = "A vcan or vxcan interface, or unix:PATH or fd:NUMBER, a socket in place of one, or "
             "tcp:[HOST:]PORT[/NAME] for programs that speak as to socketcand, or cannelloni:…, "
             "a tunnel to another machine (canwire-ports(7)), or what canwire-usb makes "
             "(canwire-usb(8)). Without: no ECU, but maybe traffic."},
    {.name = "peer", .read = cfg_read_peer, NODES, .map = cfg_peer_keys,
     .type = TYPE_ANY(TYPE_REF("interface") ", @"), .needs = "port",
     .help = "The other end of the port, which is then one of a pair of vxcan interfaces: its "
             "name, or name and namespace. `canwire vcan up` makes them; canwired does not look "
             "at it. Without: the ECU opens the port itself, a vcan interface, but see vxcan."},
    {.name = "missing-port", .read = cfg_read_missing_port, NODES, MEMBER(missing_port),
     .arg = cfg_missing_ports, .type = TYPE_CHOICE, .needs = "port",
     .help = "What to do at the start while the interface of this port is not there; default is "
             "what the bus does. With wait, `canwire vcan up` does not make it, whatever its "
             "name: hardware has it."},
    MODE("loopback", CW_MODE_LOOPBACK, "Hears only itself, receives its own frames."),
    MODE("listen-only", CW_MODE_LISTEN_ONLY,
         "Receives, never drives the bus, does not acknowledge."),
    MODE("one-shot", CW_MODE_ONE_SHOT, "One attempt, then the frame is dropped."),
    MODE("berr-reporting", CW_MODE_BERR_REPORTING,
         "An error frame on the port for each bus error."),
    MODE("presume-ack", CW_MODE_PRESUME_ACK, "A missing ACK is no error."),
    MODE("restricted", CW_MODE_RESTRICTED,
         "Receives and acknowledges, and sends nothing else."),
    MODE("time-triggered", CW_MODE_TIME_TRIGGERED,
         "One attempt for each frame, and no error or overload flags."),
    MODE("lost-arbitration-reporting", CW_MODE_LOST_ARBITRATION_REPORTING,
         "An error frame on the port for each lost arbitration."),
    {.name = "restart-ms", .read = schema_read_uint, MEMBER(restart_ms), .arg = &restart_range,
     NUMBER(CW_SET_RESTART, restart_ticks, uint64_t, TICKS_PER_MS), .preset = "0",
     .help = "From bus-off to the automatic restart; 0: never."},
    {.name = "queue", .read = schema_read_uint, MEMBER(queue), .arg = &queue_range,
     NUMBER(CW_SET_QUEUE, queue, uint16_t, 1),
     .help = "Frames waiting or being sent; what becomes of a further one says when-full. Default "
             "1024 with a port other than usb, else 16."},
    WHEN_FULL(cfg_read_when_full, NODES, .needs = "port"),
    WHEN_FULL(schema_read_choice, SHARED),
    CLIENTS(cfg_read_port_clients, NODES, .needs = "port"),
    CLIENTS(cfg_read_clients, .where = CFG_IN_DEFAULTS),
    {.name = "order", .read = schema_read_choice, MEMBER(order), .arg = cfg_orders,
     LIVE(.kind = CFG_LIVE_ORDER, .which = CW_SET_ORDER), .preset = "priority",
     .help = "Which of the waiting frames goes first."},
    {.name = "warning-limit", .read = schema_read_uint, MEMBER(warning_limit),
     .arg = &warning_range, NUMBER(CW_SET_WARNING, warning_limit, uint16_t, 1),
     .preset = "96",
     .help = "Counter from which on the node is error-warning."},
    {.name = "sleep", .read = schema_read_bool, MEMBER(sleeps),
     LIVE(.kind = CFG_LIVE_SLEEP, .which = CW_SET_SLEEP), .preset = "false",
     .help = "The node sleeps: it neither acknowledges nor signals until something wakes it. At "
             "the start; `set` changes it."},
    /* 5 us: the longest filter time of ISO 11898-2 */
    WAKE_TIME("wake-filter", CW_SET_WAKE_FILTER, filter_ticks, "5us",
              "How long the wire must be dominant to wake the node, 0 to 1s."),
    WAKE_TIME("wake-time", CW_SET_WAKE_TIME, wake_ticks, "0",
              "From the wake-up to the moment at which the node begins to integrate, 0 to 1s."),
    {.name = "wake-on", .read = cfg_read_wake, .type = "wakeOn", .preset = "off",
     LIVE(.kind = CFG_LIVE_WAKE_ON, .which = CW_SET_WAKE_ON,
          .range = "frames such as 123,500:7F0; or off"),
     .help = "Frames that wake the node instead, 8 at most (partial networking)."},
    {.name = "clock", .read = cfg_read_clock, .type = "clock",
     TIME(CLOCK, RETIME_CLOCK, phase[0].bit.clock_hz, "such as 16MHz"), .preset = "80MHz",
     .help = "Frequency of the controller's clock, 100kHz to 1GHz."},
    {.name = "ppm", .read = cfg_read_ppm, .type = "ppm",
     TIME(PPM, RETIME_PPM, ppm, "-100000 to 100000"), .preset = "0",
     .help = "Error of the clock in millionths; a positive one is fast."},
    {.name = "controller", .read = cfg_read_controller, FIXED, .map = cfg_model_keys,
     .type = TYPE_ANY(TYPE_REF("controller") ", @"), .preset = "any",
     .help = "Whose limits the bit timing must meet."},
    PHASE("", 0, ""),
    {.name = "triple-sampling", .read = schema_read_bool, MEMBER(time.triple_sampling),
     TIME(SWITCH, RETIME_TRIPLE_SAMPLING, triple_sampling, NULL), .preset = "false",
     .help = "The majority of three samples counts."},
    PHASE("d", 1, " of the data phase"),
    {.name = "tdc-mode", .read = schema_read_choice, MEMBER(time.tdc), .arg = tdc_modes,
     TIME(TDC, RETIME_TDC_MODE, tdc, NULL),
     .help = "Transmitter delay compensation. Default: as Linux, auto with a dbrp of 1 or 2, else "
             "off."},
    {.name = "tdco", .read = schema_read_uint, MEMBER(time.tdco), .arg = &tdco_range,
     TIME(CLOCKS, RETIME_TDCO, tdco, NULL),
     .help = "From the begin of a bit to the secondary sample point, in clocks. 0 or none: to the "
             "sample point."},
    {.name = "tdcv", .read = schema_read_uint, MEMBER(time.tdcv), .arg = &tdcv_range,
     TIME(CLOCKS, RETIME_TDCV, tdcv, NULL),
     .help = "Delay of the transceiver with tdc-mode: manual, in clocks."},
    {.name = "tx-delay", .read = cfg_read_edge_delays, MEMBER(time.timing.tx_delay),
     WAY(DELAYS, CW_SET_TX_DELAY, RETIME_TX_DELAY, tx_delay, DELAYS_RANGE), EDGES,
     .help = "From the controller to the line: one time, or one for each kind of edge."},
    {.name = "rx-delay", .read = cfg_read_edge_delays, MEMBER(time.timing.rx_delay),
     WAY(DELAYS, CW_SET_RX_DELAY, RETIME_RX_DELAY, rx_delay, DELAYS_RANGE), EDGES,
     .help = "From the line to the controller, in the same way."},
    {.name = "position", .read = cfg_read_length, MEMBER(time.position_mm), .type = "length",
     WAY(LENGTH, CW_SET_PLACE, RETIME_POSITION, position_mm, LENGTH_RANGE),
     .help = "Place along the line, from one end."},
    {.name = "stub", .read = cfg_read_length, MEMBER(time.stub_mm), .type = "length",
     WAY(LENGTH, CW_SET_STUB, RETIME_STUB, stub_mm, LENGTH_RANGE),
     .help = "Length of the way from the line to the node."},
    {.name = "ringing", .read = cfg_read_fine, MEMBER(time.timing.ringing),
     WAY(DELAY, CW_SET_RINGING, RETIME_RINGING, ringing, "0 to 10ms, at most 16 bits"),
     .help = "The wire swings for so long after each edge to recessive; in place of what "
             "termination adds."},
    {.name = "filter", .read = cfg_read_acceptance, FIXED,
     .type = TYPE_SOME(512, TYPE_REF("nodeFilter")),
     .help = "The frames that the host gets, as of candump. The node acknowledges all frames."},
    {.name = "local-time", .read = cfg_read_local_time, .map = cfg_local_time_keys,
     .help = "A counter that the clock of the node drives."},
    {.name = "schedule", .read = cfg_read_schedule, NODES, .map = cfg_schedule_keys,
     .help = "Slots of a time-triggered node in basic cycles."},
    {.name = "kind", .read = schema_read_choice, MEMBER(kind), .arg = kinds, FIXED,
     .help = "The frames that the controller knows. Default: fd where the bus has a dbitrate, "
             "else classical."},
    {.name = "fd", .read = cfg_read_fd, FIXED, .type = "boolean", .excludes = "kind",
     .help = "As kind: fd or kind: classical."},
    {.name = "protocol-exception", .read = cfg_read_exception, FIXED, .type = "boolean",
     .preset = "true",
     .help = "A frame of a later format is no error; off: a form error."},
    {.name = "traffic", .read = cfg_read_traffic, NODES,
     .type = TYPE_LIST_UP_TO(4096, TYPE_REF("traffic")),
     .help = "Frames that this node sends by itself; only without port."},
    {.name = NULL,
     .type = TYPE_IF(TYPE_ANY(TYPE_NEEDS("peer") ", " TYPE_NEEDS("missing-port")),
                     "{'properties': {'port': {'pattern': '^[^:]*$'}}}")},
};

static const char no_name[] = "";

/* Returns true for a key that gives a node time of its own as soon as it is read. Without it the
 * node has the time of the bus, so its preset is for people alone. */
static bool gives_time(const schema_key *key)
{
    return cfg_is_retime(key) || key->read == cfg_read_controller;
}

void cfg_node_defaults(cfg_node *node)
{
    schema self = {.has_open = false};

    *node = (cfg_node){
        .name = (char *)no_name, /* nobody writes to it */
        .missing_port = CFG_MISSING_PORT_UNSET,
        .queue = QUEUE_DEFAULT,
    };
    for (const schema_key *key = cfg_node_keys; key->name; key++)
        if (!gives_time(key))
            schema_read_preset(&self, key, node);
    schema_read_presets(&self, cfg_clients_keys, node);
}

const schema_key *cfg_find_node_key(const char *name)
{
    for (const schema_key *key = cfg_node_keys; key->name; key++)
        if (strcmp(key->name, name) == 0)
            return key;
    return NULL;
}

const schema_key *cfg_retime_row(retime_key key)
{
    const schema_key *row = cfg_node_keys;
    while (!cfg_is_retime(row) || cfg_live_of(row)->time != key)
        row++;
    return row;
}

void cfg_put_number(cw_settings *settings, const schema_key *key, uint64_t number)
{
    const cfg_live *live = cfg_live_of(key);
    void *member = (char *)settings + live->offset;

    settings->which |= live->which;
    if (live->bytes == sizeof(uint16_t))
        *(uint16_t *)member = (uint16_t)(number * live->unit);
    else
        *(uint64_t *)member = number * live->unit;
}

uint64_t cfg_get_number(const cw_settings *settings, const schema_key *key)
{
    const cfg_live *live = cfg_live_of(key);
    const void *member = (const char *)settings + live->offset;

    return (live->bytes == sizeof(uint16_t) ? *(const uint16_t *)member
                                            : *(const uint64_t *)member) / live->unit;
}

/* Writes the words of a choice as people list them: "a, b or c". */
static void print_words(char *text, size_t size, const schema_choice *choice)
{
    size_t used = 0;

    for (; choice->name; choice++)
        used = chars_print(text, size, used, "%s%s", choice->name,
                           !choice[1].name ? "" : choice[2].name ? ", " : " or ");
}

void cfg_print_range(char *text, size_t size, const schema_key *key)
{
    const schema_range *range = key->arg;

    if (cfg_live_of(key)->range)
        (void)snprintf(text, size, "%s", cfg_live_of(key)->range);
    else if (key->read == schema_read_uint)
        (void)snprintf(text, size, "%" PRIu64 " to %" PRIu64, range->min, range->max);
    else if (key->read == schema_read_choice)
        print_words(text, size, key->arg);
    else
        (void)snprintf(text, size, "on or off");
}
