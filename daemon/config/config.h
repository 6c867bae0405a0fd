/* SPDX-License-Identifier: MIT
 *
 * config.h - a configuration file, parsed and validated into plain structs.
 *
 * Everything is owned by the cfg and freed with it. All errors of a file are collected in one
 * pass, each as FILE:LINE:COLUMN: message; a configuration with errors is never returned.
 */
#ifndef CANWIRE_CONFIG_CONFIG_H
#define CANWIRE_CONFIG_CONFIG_H

#include "base/text/number.h"
#include "canwire.h"
#include "timing/controllers.h"
#include "trace/errframe.h"
#include "timing/pairs.h"
#include "trace/read.h"

#include <stdio.h>

/* A place in a file, line and column from 1 on; 0: nowhere. */
typedef struct cfg_place {
    int line;
    int column;
} cfg_place;

/* The place of a rule, perhaps in a profile. */
typedef struct cfg_rule_place {
    const char *file;
    cfg_place place;
} cfg_rule_place;

typedef enum cfg_traffic_kind {
    CFG_TRAFFIC_SEND = 0, /* `frame`, release k at offset + k * every + jitter, k < count */
    CFG_TRAFFIC_REPLAY,   /* the frames of a file, count times */
    CFG_TRAFFIC_REPLY     /* `frame` answers each match, after `delay`, count times */
} cfg_traffic_kind;

/* The keys `counter` and `checksum` of an entry. */
typedef struct cfg_protect {
    bool has_counter;
    bool has_checksum;
    unsigned kind; /* in the table of protect.c */
    unsigned mode; /* of the Data ID */
    uint16_t nibble;
    bool id_list;
    uint8_t id_count;
    uint16_t id[CW_DATA_ID_MAX];
    cw_protection what; /* for the library; without the node */
} cfg_protect;

/* One entry of a node's traffic. */
typedef struct cfg_traffic {
    cfg_traffic_kind kind;
    cfg_place place;
    cw_frame frame;
    cfg_time offset; /* of a replay: time of the first entry of the file */
    cfg_time every;
    bool has_every;
    cfg_time jitter; /* at most `every`, if there is one */
    cfg_time delay;
    uint64_t count; /* UINT64_MAX: unlimited; 1 without `every` */
    cfg_protect protect; /* of a send */

    /* Of a replay: */
    char *file;
    trace_format format;
    bool fast;     /* as fast as possible, otherwise at the times of the file */
    bool loop;     /* count is UINT64_MAX */
    bool fd;       /* the node knows CAN FD frames, otherwise these are left out */
    cfg_time gap;  /* from the last entry of the file to the first one of the next pass */
    char *channel; /* only this interface of the file, or NULL */

    /* Frames of the file (none: all), or the frames to answer. */
    cw_filter filters[CW_RULE_FILTERS_MAX];
    uint8_t filter_count;
} cfg_traffic;

/* The handling of frames that an ECU writes while its node's queue is full. */
typedef enum cfg_when_full {
    CFG_WHEN_FULL_DROP = 0, /* dropped and counted: default where the port is an interface */
    CFG_WHEN_FULL_WAIT      /* frames stay in the port, which is not read: default of sockets */
} cfg_when_full;

/* The moment at which the other clients of a port see a client's frame. */
typedef enum cfg_echo {
    CFG_ECHO_AT_ONCE = 0, /* when it is handed in, as on vcan */
    CFG_ECHO_SENT         /* when the bus has sent it, as at a real interface */
} cfg_echo;

/* Programs that share a port. */
typedef struct cfg_clients {
    uint8_t max; /* that speak the protocol of canwire-ports(7), besides a plain ECU */
    cfg_echo echo;
    bool beacon; /* a port at a TCP address tells the local network of itself */
} cfg_clients;

#define CFG_CLIENTS_MAX 63u
#define CFG_NODE_NAME_MAX 32u

/* Controllers of nodes, by the frames that they know (D17). */
typedef enum cfg_kind {
    CFG_KIND_BY_BUS = 0, /* fd where the bus has a data rate, otherwise classical */
    CFG_KIND_CLASSICAL,
    CFG_KIND_2_0A,
    CFG_KIND_2_0B_PASSIVE,
    CFG_KIND_FD_TOLERANT,
    CFG_KIND_FD
} cfg_kind;

/* Transmitter delay compensation (D13) as wished. */
typedef enum cfg_tdc {
    CFG_TDC_BY_RATE = 0, /* as Linux does: auto with a prescaler of 1 or 2, otherwise off */
    CFG_TDC_OFF,
    CFG_TDC_AUTO,
    CFG_TDC_MANUAL
} cfg_tdc;

/* One phase of a bit by its keys: of all bits, or of those at the data rate (D10). */
typedef struct cfg_phase {
    bit_timing bit;           /* clock_hz 0: the bits are those of the bus, or there is no phase */
    bool found;               /* no key gives the segments: they were found as Linux does it */
    uint16_t sample_permille; /* wish; 0: none */
} cfg_phase;

#define CFG_PHASES 2u

/* The clock of a node and its place on the line, by its keys. */
typedef struct cfg_node_time {
    bool used;                   /* there is a key of time */
    bool triple_sampling;
    const timing_limits *limits; /* of its controller */
    cfg_phase phase[CFG_PHASES];
    int32_t ppm;                 /* error of the clock */
    cfg_tdc tdc;
    uint32_t tdco;               /* clocks; 0: from the start of a bit to its sample point */
    uint32_t tdcv;
    uint64_t position_mm;        /* along the line */
    uint64_t stub_mm;
    cw_node_timing timing;       /* for the library */
} cfg_node_time;

/* The buffers between the controller and its host. */
typedef enum cfg_model {
    CFG_MODEL_QUEUE = 0, /* the host takes each frame at once */
    CFG_MODEL_BASIC,     /* one transmit buffer, a few receive buffers */
    CFG_MODEL_FULL,      /* mailboxes */
    CFG_MODEL_SJA1000,   /* presets: the buffers of a chip, and the habits of its driver */
    CFG_MODEL_MCP2515,
    CFG_MODEL_M_CAN,
    CFG_MODEL_FLEXCAN,
    CFG_MODEL_BXCAN,
    CFG_MODELS
} cfg_model;

/* Returns the word of a configuration for it. */
const char *cfg_model_name(cfg_model model);

typedef struct cfg_controller {
    cfg_model model;
    uint32_t receive_buffers; /* the one for the frame on the wire included; 0: none */
    uint32_t receive_bytes;   /* ... or the bytes that they hold together; 0: any number */
    cw_mailbox *mailboxes;
    uint8_t mailbox_count;
    bool receive_fifo;        /* received frames go into the buffers, not into mailboxes */
    cw_transmit transmit;
    errframe_driver driver;   /* the host gets its error frames */
    uint64_t service_ticks;   /* time that the host needs for each frame; 0: none */
    bool overload_when_full;
    uint8_t variants; /* CW_VARIANT_* */
    uint16_t filter_count;
    cw_filter *filters;
} cfg_controller;

/* The action at the start, and at a reload, when the interface of a port is missing. */
typedef enum cfg_missing_port {
    CFG_MISSING_PORT_FAIL = 0,
    CFG_MISSING_PORT_WAIT,
    CFG_MISSING_PORT_UNSET /* of a node: as the bus has it */
} cfg_missing_port;

#define CFG_NO_CYCLE_BYTE UINT8_MAX

/* The schedule of a time-triggered node. */
typedef struct cfg_schedule {
    cw_filter reference;
    uint8_t cycles;            /* basic cycles of the matrix; 0: there is no schedule */
    uint8_t cycle_byte;        /* CFG_NO_CYCLE_BYTE: none */
    bool master;               /* one of the triggers sends the reference message */
    uint16_t trigger_count;
    cw_time_trigger *triggers; /* sorted by `at` */
    bool *arbitrating;         /* of each: its window is not exclusive */
    cfg_place place;
} cfg_schedule;

typedef struct cfg_node {
    char *name;          /* "", which is not a node's name, while it is unknown */
    char *port;          /* interface name, or NULL; of all guests the same */
    uint8_t guest;       /* number of a guest, from 1 on; 0: it is not one */
    cfg_place port_place;
    char *peer;          /* interface at the other end of the port, a vxcan pair, or what a port usb
                            makes; or NULL */
    char *netns;         /* network namespace that the peer is in; NULL: that of the port */
    cfg_missing_port missing_port;
    cfg_kind kind;
    bool no_exception;   /* a protocol exception is a form error (D16) */
    uint8_t modes;       /* CW_MODE_* */
    bool berr_reporting; /* CW_MODE_BERR_REPORTING is among the modes */
    cw_order order;
    uint16_t queue; /* default 16; 1024 with a port, but for usb */
    cfg_when_full when_full;
    cfg_clients clients;
    uint16_t warning_limit;
    uint32_t restart_ms;
    cfg_node_time time;
    cfg_controller controller;
    bool sleeps;         /* at the start */
    cw_sleep_settings sleep;
    cw_local_time local;   /* its unit is that of a right clock; bits 0: none */
    cfg_schedule schedule;
    size_t traffic_count;
    cfg_traffic *traffic;
    int line; /* of the node in its file */
} cfg_node;

/* The terminators of the line that are there. */
typedef enum cfg_termination {
    CFG_TERMINATION_BOTH = 0,
    CFG_TERMINATION_ONE,
    CFG_TERMINATION_NONE
} cfg_termination;

/* The first tick at which a frame for a bus at rest can begin. */
typedef enum cfg_start {
    CFG_START_BIT = 0, /* that of the next bit */
    CFG_START_TICK     /* its own */
} cfg_start;

typedef enum cfg_pacing {
    CFG_PACING_PRECISE = 0,
    CFG_PACING_TICK,
    CFG_PACING_SPIN,
    CFG_PACING_VIRTUAL /* by the programs that have joined its time */
} cfg_pacing;

#define CFG_PROGRAMS_MAX 64u

/* The virtual time of a bus. */
typedef struct cfg_virtual {
    uint8_t programs; /* that must have joined before time begins; default 1 */
    uint64_t until;   /* tick at which it stands still for good; 0: none */
    char *socket;     /* at which they join; set when `pacing` is virtual */
    cfg_place place;
} cfg_virtual;

#define CFG_PACING_TICK_NS 1000000u /* limit of `tick` pacing for coalescing wake-ups */

/* Bits of cfg_lcm.events: kinds of events that are published, 1u << cw_event_kind. */
typedef struct cfg_lcm {
    bool enabled;    /* an `lcm` key is present */
    cfg_place place;
    char *url;       /* default "udpm://239.255.76.67:7667?ttl=0" */
    cfg_place url_place;
    cfg_time period; /* default 1s */
    uint32_t events; /* default error, state, restart, overload, drop, fault */
} cfg_lcm;

/* The subjects that `canwire sim` can judge in a run. */
typedef enum cfg_expect_kind {
    CFG_EXPECT_DELIVERED = 0, /* number of frames that are delivered */
    CFG_EXPECT_DELAY,         /* their time from hand-in to delivery */
    CFG_EXPECT_SEEN,          /* presence of a frame */
    CFG_EXPECT_STATE,         /* nodes that enter one of the states */
    CFG_EXPECT_ERRORS,        /* number of events of these kinds ... */
    CFG_EXPECT_DROPS,
    CFG_EXPECT_RESTARTS,
    CFG_EXPECT_OVERLOADS,
    CFG_EXPECT_ARBITRATION_LOST,
    CFG_EXPECT_FAULTS, /* ... this one: hits of fault rules */
    CFG_EXPECT_LOAD,   /* of the whole run */
    CFG_EXPECT_EXCEPTIONS, /* number of protocol exceptions */
    CFG_EXPECT_JITTER, /* of the frames that triggers send, each trigger on its own */
    CFG_EXPECT_GAP,    /* the longest time without such a frame */
    CFG_EXPECT_COUNT
} cfg_expect_kind;

#define CFG_WINDOW_EXCLUSIVE 0x1u /* in cfg_expect.windows */
#define CFG_WINDOW_ARBITRATING 0x2u

/* The part of the delays, in percent, that has a limit of its own. */
typedef enum cfg_percentile {
    CFG_P50 = 0,
    CFG_P90,
    CFG_P95,
    CFG_P99,
    CFG_PERCENTILES
} cfg_percentile;

typedef struct cfg_expect {
    cw_rule when;  /* first, for the readers of rules: filters, data, from, time_begin, time_end */
    cfg_expect_kind kind;
    char *name;    /* or NULL */
    uint64_t to;   /* frames at these receivers, for each on its own; 0: frames on the bus */
    uint64_t node; /* events of these nodes, for each on its own; 0: of all together */
    uint64_t min;  /* of the count, inclusive; of the load in permille */
    uint64_t max;
    bool never;    /* SEEN and STATE: must not occur */
    uint64_t delay_max;                   /* ticks, CW_NEVER: no limit; of JITTER and GAP, too */
    uint64_t percentile[CFG_PERCENTILES]; /* in the same way */
    uint8_t states;      /* STATE: 1u << cw_state */
    uint32_t windows;    /* frames of triggers in these windows; 0: any frames */
    uint32_t types;      /* ERRORS: 1u << cw_error_type; 0: any */
    uint32_t why;        /* DROPS: 1u << cw_drop; 0: for any reason */
    const char *rule;    /* FAULTS: its name; NULL: any */
    int line;            /* in its file */
} cfg_expect;

typedef enum cfg_record_format {
    CFG_RECORD_CANDUMP = 0, /* as candump -L writes it */
    CFG_RECORD_PCAPNG,      /* for Wireshark, with error frames */
    CFG_RECORD_VCD          /* the bits */
} cfg_record_format;

#define CFG_RECORDS_MAX 16u
#define CFG_RECORD_SIZE_MIN 64000u
#define CFG_RECORD_SIZE_MAX UINT64_C(1000000000000)

/* A file that is recorded while the bus runs. */
typedef struct cfg_record {
    char *file;               /* without parts that have no meaning in a path, such as ./ */
    cfg_place place;
    cfg_record_format format; /* default: by the extension of the name */
    uint64_t size;            /* size in bytes at which the next file begins; default 100 MB */
    uint32_t files;           /* number of files that are kept; default 5 */
} cfg_record;

/* A file that a configuration was read from. */
typedef struct cfg_file {
    const char *name;
    const char *text;
    size_t size; /* of the text, which may contain any bytes */
} cfg_file;

/* The place at which programs read the counters. */
typedef struct cfg_metrics {
    const char *name; /* HOST:PORT or unix:PATH, in full; NULL: nowhere */
    const char *path; /* of a socket; NULL: the name is an address (address_parse()) */
    cfg_place place;
} cfg_metrics;

typedef struct cfg {
    char *file;
    size_t file_count;
    cfg_file *files; /* with the texts that were read: the configuration first, then profiles */
    char *bus_name; /* default "can" */
    cfg_place bus_name_place;
    uint32_t bitrate_bps;
    cfg_place bitrate_place;
    cw_rate rate;
    uint16_t sample_permille;  /* of all nodes that have no other wish; 0: none */
    uint32_t dbitrate_bps;     /* of the data phase of CAN FD frames (D10); 0: none */
    uint16_t dsample_permille;
    bool fd_non_iso;           /* FD frames have the format from before ISO 11898-1:2015 */
    uint64_t line_ps_per_m;    /* delay of a metre of line; default 5000 */
    cfg_start start;
    cfg_termination termination; /* of which the ringing of the nodes has been made */
    uint64_t seed;
    size_t node_count;
    cfg_node *nodes;
    bool has_answers;   /* controllers may send because of a frame: by mailboxes or schedules */
    size_t guest_count; /* nodes at the end, which are on the bus while their clients are there */
    size_t rule_count;
    cw_rule *rules; /* names owned by the cfg */
    cfg_rule_place *rule_places; /* of each */
    uint32_t protection_count;
    cw_protection *protections; /* of all entries, sorted */
    size_t reply_count; /* entries of kind CFG_TRAFFIC_REPLY; a bus keeps them as quiet rules */
    size_t expect_count;
    cfg_expect *expects;
    char *expect_report; /* the file that canwired reports to, or NULL */
    cfg_place expect_report_place;
    size_t record_count;
    cfg_record *records;
    cfg_lcm lcm;
    char *control; /* socket path, or NULL */
    cfg_place control_place;
    cfg_metrics metrics;
    cfg_pacing pacing;
    cfg_virtual virtual_time;
    cfg_missing_port missing_port;
    const char *warnings; /* a line each, FILE:LINE:COLUMN: warning: ...; "" when there is none */
    bool vxcan; /* ports that are interfaces have a peer, by default one with the node's name */
    cfg_time catch_up; /* largest lag of the bus; default 1s */
} cfg;

/* Reads a file. Returns NULL after writing one line per error to `errors`. */
cfg *cfg_load(const char *file, FILE *errors);

/* A place as messages have it: FILE:LINE:COLUMN; that of a missing key is the beginning. */
typedef struct cfg_where {
    char text[256];
} cfg_where;
cfg_where cfg_place_text(const cfg *config, cfg_place place);

/* Reads a file in the same way. Neither the file nor its profiles may be pipes or devices, on which
 * reading could wait for ever. */
cfg *cfg_load_regular(const char *file, FILE *errors);

/* Reads a configuration as cfg_load() does, but only from the given files. The first one is the
 * configuration. Files of traffic are not read. */
cfg *cfg_load_given(const cfg_file *files, size_t count, FILE *errors);

/* Reads the text of a configuration; other files are read as by cfg_load(). Paths are relative to
 * the directory of its name. */
cfg *cfg_load_text(const cfg_file *file, FILE *errors);

/* Reads a configuration or a fault profile on its own; a profile may name any node. Returns true
 * when it is valid. *config is then the configuration, to be freed, or NULL for a profile, and
 * *rule_count counts its rules. Otherwise it writes one line per error to `errors`. */
bool cfg_check(cfg **config, size_t *rule_count, const char *file, FILE *errors);

/* Frees the configuration; NULL is allowed. */
void cfg_free(cfg *config);

/* Fault rules from a text that `canwire inject` sends. They are sorted for adding one after the
 * other: a rule follows the one that its `after` names. */
typedef struct cfg_rules {
    size_t count;
    cw_rule *rules; /* cfg_free_rules() frees their names */
    const char *warnings; /* in the form of a configuration's warnings */
} cfg_rules;

/* The rules of a running bus: names by index on the bus, NULL where there is no rule. */
typedef struct cfg_running {
    size_t count;
    const char *const *names;
} cfg_running;

/* Reads rules from size bytes of YAML or JSON: a list of rules, a single rule, {faults: [...]}, or
 * a profile. A profile may have `with: {PARAMETER: VALUE}` at its top. Names of nodes come from the
 * configuration. A new rule needs a name that no running rule has. `after` may name a new or a
 * running rule. An index below running->count is a rule on the bus; running->count + i is rules[i]
 * of the result. With running == NULL the rules of the configuration are running. `name` stands for
 * the text in messages. Returns NULL after writing one line per error to `errors`. */
cfg_rules *cfg_load_rules(const char *text, size_t size, const char *name, const cfg *config,
                          const cfg_running *running, FILE *errors);

/* Frees the rules; NULL is allowed. */
void cfg_free_rules(cfg_rules *rules);

/* Expectations from a text, for a running bus. */
typedef struct cfg_expects {
    size_t count;
    cfg_expect *expects;
    const char *warnings; /* in the form of a configuration's warnings */
} cfg_expects;

/* Reads expectations from size bytes of YAML or JSON: one, or a list. Nodes and rules are those of
 * the configuration. `name` stands for the text in messages. Returns NULL after writing one line
 * per error to `errors`. */
cfg_expects *cfg_load_expects(const char *text, size_t size, const char *name, const cfg *config,
                              FILE *errors);

/* Frees the expectations; NULL is allowed. */
void cfg_free_expects(cfg_expects *expects);

/* Fills a recording with the defaults. */
void cfg_record_default(cfg_record *record);

/* Find the format for the extension of a file's name or for a name ("pcapng"), and the name of a
 * format. The first two return false for other texts. */
bool cfg_record_format_of_file(cfg_record_format *format, const char *file);
bool cfg_record_format_of_name(cfg_record_format *format, const char *name);
const char *cfg_record_format_name(cfg_record_format format);

/* Reads the size at which the next file begins, "100MB". Returns NULL, or the allowed values. */
const char *cfg_record_parse_size(uint64_t *size, const char *text);

/* Returns true when its frames have a counter or a checksum. */
bool cfg_is_protected(const cfg_traffic *traffic);

/* Returns true when the traffic never ends by itself. */
bool cfg_traffic_is_endless(const cfg_traffic *traffic);

/* Returns such traffic, or NULL. */
const cfg_traffic *cfg_find_endless(const cfg *config);

#define CFG_GUEST_NAME_MAX 12 /* bytes of guest-255 and a final 0 */

/* Prints the name that a guest has while no client gives it another one. */
void cfg_guest_name(char out[CFG_GUEST_NAME_MAX], unsigned number);

/* Returns the port of the guests, or NULL without guests. */
const char *cfg_guest_port(const cfg *config);

/* Returns the index of the node of that name, or CW_NO_NODE. */
uint8_t cfg_find_node(const cfg *config, const char *name);

/* Returns the unit of a node's local time by a clock with an error in millionths; 0: none. */
cw_span cfg_local_unit(const cfg_node *node, int32_t ppm);

/* Returns the place of the schedule of a time master, which never ends by itself, or NULL. */
const cfg_place *cfg_find_master(const cfg *config);

/* Traffic, a rule or a schedule that never ends by itself. */
typedef struct cfg_unending {
    const char *what;   /* in words */
    const char *remedy; /* keys that would end it, as words before an "or"; or "" */
    const char *file;
    cfg_place place;
    bool is_rule;       /* a rule with `period`, otherwise what a node does */
} cfg_unending;

/* Finds traffic, a rule or the schedule of a time master that never ends by itself. Returns false
 * when all ends; `found` may be NULL. */
bool cfg_find_unending(const cfg *config, cfg_unending *found);

/* Returns true when settings take `time-triggered` from a node that has a schedule. */
bool cfg_stops_schedule(const cfg_node *node, const cw_settings *settings);

/* Returns true for a node with `port: { usb: … }`, whose controller is in a program. */
bool cfg_is_usb(const cfg_node *node);

/* Returns true when the bus starts without the port of a node, as long as that is missing. */
bool cfg_waits_for_port(const cfg *config, const cfg_node *node);

/* Returns true when a node knows CAN FD frames. */
bool cfg_knows_fd(const cfg *config, const cfg_node *node);

/* Returns the name of the kind that a node has, by itself or by its bus. */
const char *cfg_kind_name(const cfg *config, const cfg_node *node);

/* Returns true when a node is of CAN 2.0A or 2.0B passive: it sends no extended frames. */
bool cfg_is_old(const cfg_node *node);

/* Returns true when any node does. */
bool cfg_has_fd(const cfg *config);

/* Finds for each node of a configuration the node of that name in an old one, or CW_NO_NODE. Guests
 * are found by their numbers, since their clients give them other names. */
void cfg_match_nodes(uint8_t from[CW_NODES_MAX], const cfg *config, const cfg *old);

/* Describes what T10 looks at: the clock, the bit timing and the place of a node. A node without
 * keys for them has the bits of the bus, in 16 quanta. Segments that were found, and those with a
 * prop-seg of 0, only say where the sample point is. Of them phase-seg1 is as long as phase-seg2,
 * and all else is for delays. */
void cfg_timing_node(timing_node *out, const cfg *config, size_t node);

/* Finds prescaler and error of a node's clock for what the library has just now. The prescaler is
 * that of the configuration, while the clock can have such an error. */
void cfg_timing_now(bit_timing *bit, int64_t *ppm, const cfg *config, size_t node,
                    const cw_bit_timing *now);

/* Returns true when a node has a clock, a bit timing or delays of its own. */
bool cfg_has_clocks(const cfg *config);

/* Describes the bus of this configuration; *out points into *nodes (node_count of them, from the
 * caller) and into the cfg. There is room for the replies, see release_add_replies(). */
void cfg_bus_config(cw_bus_config *out, cw_node_config *nodes, const cfg *config);

#endif
