/* SPDX-License-Identifier: MIT
 *
 * publish.c - statistics and events over LCM, without ever delaying the bus.
 */
#include "serve/publish.h"

#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/log.h"
#include "base/text/number.h"
#include "base/thread.h"
#include "base/text/memo.h"
#include "engine/reload.h"
#include "record/data_timing.h"
#include "record/local_time.h"
#include "record/output.h"
#include "record/rate_load.h"
#include "record/residual.h"

#include <canwire_bus_fd_t.h>
#include <canwire_bus_quality_t.h>
#include <canwire_bus_stats_t.h>
#include <canwire_event_t.h>
#include <canwire_file_t.h>
#include <canwire_gateway_t.h>
#include <canwire_node_controller_t.h>
#include <canwire_node_fd_t.h>
#include <canwire_node_stats_t.h>
#include <canwire_node_time_t.h>
#include <canwire_node_timing_t.h>
#include <canwire_tunnel_t.h>
#include <canwire_verdict_t.h>
#include <errno.h>
#include <inttypes.h>
#include <lcm/lcm.h>
#include <netdb.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define REMEDY "ip link set lo up && ip route add 224.0.0.0/4 dev lo"
#define QUEUE_MESSAGES 4096
#define QUEUE_EVENTS 3072 /* of the messages; a storm of events leaves room for statistics */
#define RETRY_S 2     /* before the first retry; later ones wait twice as long each time ... */
#define RETRY_MAX_S 60 /* ... up to this */
#define LINGER_S 1  /* at the end, for queued messages */
#define GIVE_UP_S 2 /* the thread then hangs in liblcm and is left */
#define WARNING_S 10 /* between two warnings about lost messages */
#define STALL_S 5 /* in a call of liblcm: a server does not answer, or takes nothing */
#define CHANNEL_MAX 64
#define WHY_BYTES 128
#define VERDICTS_TOLD 20 /* in a message: what has failed first by the order of the file */

static const char state_starting[] = "starting";
static const char state_sending[] = "sending";
static const char state_waiting[] = "waiting"; /* LCM cannot start yet */
static const char state_failing[] = "failing"; /* messages cannot be sent */
static const char state_blocked[] = "blocked"; /* a server has answered or taken none for long */

/* The sorts of messages, each with a channel of its own. */
typedef enum channel {
    CHANNEL_BUS = 0,
    CHANNEL_QUALITY,
    CHANNEL_NODE,
    CHANNEL_TIMING,
    CHANNEL_LOCALTIME,
    CHANNEL_EVENT,
    CHANNEL_FILE,
    CHANNEL_GATEWAY,
    CHANNEL_FDBUS,
    CHANNEL_FDNODE,
    CHANNEL_CONTROLLER,
    CHANNEL_TUNNEL,
    CHANNEL_VERDICT,
    CHANNELS
} channel;

/* A period in which messages cannot be sent. */
typedef struct outage {
    uint64_t lost;
    bool warned;
    unsigned pause_s;             /* before the next retry */
    struct timespec next_warning; /* the earliest time, CLOCK_MONOTONIC */
} outage;

typedef struct message {
    channel on;
    void *data;
    unsigned size;
} message;

struct publisher {
    const cfg *config;
    char *url; /* of the thread: the configuration may change */
    char channels[CHANNELS][CHANNEL_MAX];
    cw_bus_stats last_bus;
    uint64_t last_tx_bits[CW_NODES_MAX];
    memo event; /* reused */
    pthread_t thread;
    pthread_mutex_t lock; /* of all below */
    pthread_cond_t changed;
    message queue[QUEUE_MESSAGES];
    unsigned first;
    unsigned count;
    bool stopping;
    struct timespec deadline; /* when stopping; CLOCK_MONOTONIC */
    const char *state;        /* of lcm_states[] */
    const char *why;          /* of a bad state: a text that stays, or NULL ... */
    int error;                /* ... and then this errno */
    bool calls;               /* liblcm ... */
    struct timespec stalls;   /* ... which should be back by then; CLOCK_MONOTONIC */
    atomic_uint_fast64_t dropped;
    atomic_uint_fast64_t sent;
    bool has_failed; /* of the thread: liblcm has told of a failure */
    char explained[WHY_BYTES]; /* of the loop's thread */
};

/* ---- The thread ------------------------------------------------------------------------------ */

/* Takes the first message out of the queue, which has one. The lock is held. */
static message take_first(publisher *p)
{
    const message first = p->queue[p->first];
    p->first = (p->first + 1) % QUEUE_MESSAGES;
    p->count--;
    return first;
}

/* Returns what may help against a failure, after what says so; "" when multicast is not used. */
static const char *multicast_hint(const publisher *p, const char *hint)
{
    return strstr(p->url, "udpm://") ? hint : "";
}

/* Splits host and port off "udpm://HOST:PORT?..." */
static bool split_url(const char *url, char host[64], char service[16])
{
    return sscanf(url, "udpm://%63[^:]:%15[0-9]", host, service) == 2;
}

/* Returns true when there is a multicast route. liblcm prints a page of help without one. */
static bool has_route(const char *url)
{
    char host[64];
    char service[16];
    if (!split_url(url, host, service))
        return true;
    const struct addrinfo hints = {.ai_family = AF_INET, .ai_socktype = SOCK_DGRAM,
                                   .ai_flags = AI_NUMERICHOST | AI_NUMERICSERV};
    struct addrinfo *address;
    if (getaddrinfo(host, service, &hints, &address) != 0)
        return true;
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    bool good = fd >= 0 && connect(fd, address->ai_addr, address->ai_addrlen) == 0;
    if (fd >= 0)
        (void)close(fd);
    freeaddrinfo(address);
    return good;
}

/* Sets the state that others see, with its reason: a text that stays, or an errno. */
static void set_state(publisher *p, const char *state, const char *why, int error)
{
    (void)pthread_mutex_lock(&p->lock);
    p->state = state;
    p->why = why;
    p->error = error;
    (void)pthread_mutex_unlock(&p->lock);
}

/* ---- Lines of liblcm ------------------------------------------------------------------------- */

/* The stream stderr of the process is elsewhere while a publisher that has failed calls liblcm,
 * which writes several lines about each failure. The log, which has all that counts, and has no use
 * for the stream, is not affected. */
static struct {
    pthread_mutex_t lock;
    FILE *nowhere; /* opened once */
    FILE *shown;   /* stderr as it was */
    unsigned count; /* of calls that it is hidden from */
} hidden = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* Hides what liblcm writes while a publisher that has failed calls it. Several may do so at
 * once. */
static void hide_stderr(const publisher *p)
{
    if (!p->has_failed)
        return;
    (void)pthread_mutex_lock(&hidden.lock);
    if (!hidden.nowhere)
        hidden.nowhere = fopen("/dev/null", "we");
    if (hidden.count++ == 0) {
        hidden.shown = stderr;
        stderr = hidden.nowhere ? hidden.nowhere : stderr;
    }
    (void)pthread_mutex_unlock(&hidden.lock);
}

/* Shows stderr again when the last call has returned. */
static void show_stderr(const publisher *p)
{
    if (!p->has_failed)
        return;
    (void)pthread_mutex_lock(&hidden.lock);
    if (--hidden.count == 0)
        stderr = hidden.shown;
    (void)pthread_mutex_unlock(&hidden.lock);
}

/* ---- Sending --------------------------------------------------------------------------------- */

/* Begins a call of liblcm: that waits for a server for ever. */
static void begin_call(publisher *p)
{
    (void)pthread_mutex_lock(&p->lock);
    p->calls = true;
    p->stalls = thread_in_seconds(STALL_S);
    (void)pthread_mutex_unlock(&p->lock);
    hide_stderr(p);
}

/* liblcm has come back, so a stall is over. */
static void end_call(publisher *p)
{
    show_stderr(p);
    (void)pthread_mutex_lock(&p->lock);
    p->calls = false;
    (void)pthread_mutex_unlock(&p->lock);
}

/* Tries to start LCM. Warns of the first failure, and tells when it works after that. */
static lcm_t *try_connect(publisher *p, bool *warned)
{
    const char *url = p->url;
    const bool route = has_route(url);
    begin_call(p);
    lcm_t *lcm = route ? lcm_create(url) : NULL;
    end_call(p);
    p->has_failed = p->has_failed || !lcm;
    set_state(p, lcm ? state_sending : state_waiting,
              lcm ? NULL : route ? "LCM cannot start" : "no multicast route", 0);
    if (lcm && *warned)
        log_info("LCM at %s works now", url);
    if (!lcm && !*warned)
        log_warning("LCM at %s cannot start, trying again after %d s, and later after up to %d s%s",
                    url, RETRY_S, RETRY_MAX_S,
                    multicast_hint(p, "; without multicast route: " REMEDY));
    *warned = !lcm;
    return lcm;
}

/* Takes the next message, after waiting for one. Returns false to stop. The lock is held. */
static bool next_message(publisher *p, message *out)
{
    while (p->count == 0 && !p->stopping)
        (void)pthread_cond_wait(&p->changed, &p->lock);
    if (p->count == 0 || (p->stopping && thread_is_past(&p->deadline)))
        return false;
    *out = take_first(p);
    return true;
}

/* Logs the beginning and the end of an outage. */
static void note_sent(publisher *p, outage *o, bool good)
{
    const int error = errno;
    p->sent += good;
    if (good != (o->lost == 0))
        set_state(p, good ? state_sending : state_failing, NULL, good ? 0 : error);
    o->lost += !good;
    if (!good && !o->warned && thread_is_past(&o->next_warning)) {
        log_warning("LCM at %s: messages cannot be sent and are lost: %s%s", p->url,
                    strerror(error), error == ENETUNREACH ? multicast_hint(p, "; " REMEDY) : "");
        o->next_warning = thread_in_seconds(WARNING_S);
        o->warned = true;
    }
    if (!good || o->lost == 0)
        return;
    if (o->warned)
        log_info("LCM at %s works again, %s %s lost", p->url,
                 counted(o->lost, "message").text, o->lost == 1 ? "was" : "were");
    o->lost = 0;
    o->warned = false;
    o->pause_s = RETRY_S;
}

/* Waits, each time longer, dropping new messages, and adds their number. Returns false to stop. */
static bool wait_without_lcm(publisher *p, outage *o)
{
    struct timespec until = thread_in_seconds(o->pause_s);
    o->pause_s = 2 * o->pause_s < RETRY_MAX_S ? 2 * o->pause_s : RETRY_MAX_S;
    (void)pthread_mutex_lock(&p->lock);
    while (!p->stopping && !thread_is_past(&until)) {
        for (; p->count > 0; o->lost++) {
            free(take_first(p).data);
            p->dropped++;
        }
        (void)pthread_cond_timedwait(&p->changed, &p->lock, &until);
    }
    bool stop = p->stopping;
    (void)pthread_mutex_unlock(&p->lock);
    return !stop;
}

/* Publishes one message. False: errno says why not. */
static bool publish_message(publisher *p, lcm_t *lcm, const message *m)
{
    begin_call(p);
    const bool good = lcm_publish(lcm, p->channels[m->on], m->data, m->size) == 0;
    const int error = errno;
    end_call(p);
    errno = error;
    return good;
}

/* Sends messages. liblcm writes lines of its own about failures, so a failure pauses the
 * sending. */
static void send_all(publisher *p, lcm_t *lcm)
{
    message m;
    outage now = {.pause_s = RETRY_S};
    bool go_on = true;
    (void)pthread_mutex_lock(&p->lock);
    while (go_on && next_message(p, &m)) {
        (void)pthread_mutex_unlock(&p->lock);
        bool good = publish_message(p, lcm, &m);
        note_sent(p, &now, good);
        free(m.data);
        if (!good) {
            p->dropped++;
            p->has_failed = true;
            go_on = wait_without_lcm(p, &now);
        }
        (void)pthread_mutex_lock(&p->lock);
    }
    (void)pthread_mutex_unlock(&p->lock);
}

/* The thread of LCM: the bus does not wait for the network. It tries until there is LCM, then
 * sends. */
static void *publish_run(void *argument)
{
    publisher *p = argument;
    bool warned = false;
    outage start = {.pause_s = RETRY_S}; /* the warning has reported it */
    lcm_t *lcm = try_connect(p, &warned);
    while (!lcm && wait_without_lcm(p, &start))
        lcm = try_connect(p, &warned);
    if (!lcm)
        return NULL;
    send_all(p, lcm);
    lcm_destroy(lcm);
    return NULL;
}

/* ---- Start and stop -------------------------------------------------------------------------- */

/* Names the channels of the bus, CANWIRE.BUS.KIND. */
static void name_channels(publisher *p)
{
    static const char *const names[CHANNELS] = {
        "BUS",  "QUALITY", "NODE",  "TIMING", "LOCALTIME",  "EVENT",
        "FILE", "GATEWAY", "FDBUS", "FDNODE", "CONTROLLER", "TUNNEL",
        "VERDICT",
    };
    for (unsigned i = 0; i < CHANNELS; i++)
        (void)snprintf(p->channels[i], CHANNEL_MAX, "CANWIRE.%s.%s", p->config->bus_name, names[i]);
}

/* The thread has ended. Messages that it has not sent are lost. */
static void free_publisher(publisher *p)
{
    while (p->count > 0)
        free(take_first(p).data);
    memo_end(&p->event);
    free(p->url);
    free(p);
}

publisher *publisher_start(const cfg *config)
{
    publisher *p = calloc(1, sizeof *p);
    if (!p)
        return NULL;
    p->config = config;
    p->state = state_starting;
    p->url = strdup(config->lcm.url);
    name_channels(p);
    (void)pthread_mutex_init(&p->lock, NULL);
    thread_init_condition(&p->changed);
    if (!p->url || !memo_begin(&p->event) || thread_start(&p->thread, publish_run, p) != 0) {
        free_publisher(p);
        return NULL;
    }
    return p;
}

/* Returns true when the thread has ended: a server that stalls blocks it for ever. */
static bool wait_for_thread(const publisher *p)
{
    struct timespec until = thread_in_seconds(GIVE_UP_S);
    return pthread_clockjoin_np(p->thread, NULL, CLOCK_MONOTONIC, &until) == 0;
}

void publisher_stop(publisher *p)
{
    if (!p)
        return;
    (void)pthread_mutex_lock(&p->lock);
    p->stopping = true;
    p->deadline = thread_in_seconds(LINGER_S);
    (void)pthread_cond_signal(&p->changed);
    (void)pthread_mutex_unlock(&p->lock);
    bool ended = wait_for_thread(p);
    (void)pthread_mutex_lock(&p->lock);
    unsigned left = p->count;
    (void)pthread_mutex_unlock(&p->lock);
    const char *verb = left == 1 ? "is" : "are";
    if (!ended)
        log_warning("LCM at %s does not answer: the last %s %s lost", p->url,
                    counted(left, "message").text, verb);
    else if (left > 0)
        log_info("LCM at %s: the last %s %s lost", p->url, counted(left, "message").text, verb);
    if (ended)
        free_publisher(p);
}

void publisher_remap(publisher *p, const uint8_t from[CW_NODES_MAX])
{
    reload_remap(p->last_tx_bits, sizeof p->last_tx_bits[0], from);
}

/* Takes over data, which may be NULL without memory. */
static void enqueue(publisher *p, channel on, void *data, int size)
{
    unsigned limit = on == CHANNEL_EVENT ? QUEUE_EVENTS : QUEUE_MESSAGES;
    (void)pthread_mutex_lock(&p->lock);
    bool room = data && size >= 0 && p->count < limit;
    if (room) {
        p->queue[(p->first + p->count) % QUEUE_MESSAGES] =
            (message){.on = on, .data = data, .size = (unsigned)size};
        p->count++;
        (void)pthread_cond_signal(&p->changed);
    }
    (void)pthread_mutex_unlock(&p->lock);
    if (!room) {
        free(data);
        p->dropped++;
    }
}

/* Returns why nothing goes to a server, or NULL. A full queue says it before the call that does not
 * end. The lock is held. */
static const char *blocked_by(const publisher *p)
{
    const bool stalls = p->calls && thread_is_past(&p->stalls);
    if (p->state == state_starting && stalls)
        return "the server does not answer";
    if (p->state == state_sending && (stalls || p->count >= QUEUE_EVENTS))
        return "nobody takes the messages";
    return NULL;
}

/* Adds what it has sent. */
void publisher_sink(publisher *p, sink_list *out)
{
    (void)pthread_mutex_lock(&p->lock);
    const char *blocked = blocked_by(p);
    sink_info s = {.kind = SINK_LCM,
                   .name = p->url,
                   .state = blocked ? state_blocked : p->state,
                   .why = blocked ? blocked : p->why};
    const int error = p->error;
    (void)pthread_mutex_unlock(&p->lock);
    if (!blocked && error != 0) {
        (void)snprintf(p->explained, sizeof p->explained, "%s", strerror(error));
        s.why = p->explained;
    }
    s.good = s.state == state_sending || s.state == state_starting;
    s.written = p->sent;
    s.lost = p->dropped;
    sinks_add(out, &s);
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Encodes a value of a generated type and queues it. */
#define PUBLISH(p, channel, type, value)                                                           \
    do {                                                                                           \
        int size_ = type##_encoded_size(value);                                                    \
        void *data_ = malloc((size_t)size_);                                                       \
        if (data_ && type##_encode(data_, 0, size_, value) != size_)                               \
            size_ = -1;                                                                            \
        enqueue(p, channel, data_, size_);                                                         \
    } while (0)

static int64_t realtime_us(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_REALTIME, &t);
    return t.tv_sec * INT64_C(1000000) + t.tv_nsec / 1000;
}

static int64_t ticks_to_ns(uint64_t ticks)
{
    return (int64_t)text_ticks_ns(ticks);
}

/* The first fields of all messages. */
#define HEAD(p, ticks)                                                                             \
    .utime_us = realtime_us(), .bus_time_ns = ticks_to_ns(ticks), .bus = (p)->config->bus_name
#define HEAD_OF_NODE(p, bus, i)                                                                    \
    HEAD(p, cw_bus_now(bus)), .node = (p)->config->nodes[i].name

/* Sets the field of a message that has the name of a counter. */
#define SET(form, type, name, unit, shown, also, column, sentence) SET_##also(name)
#define SET_NONE(name)
#define SET_SIM(name)
#define SET_LCM(name) m->name = (__typeof__(m->name))s->name;
#define SET_LCM_SIM(name) SET_LCM(name)

static void set_bus_counters(canwire_bus_stats_t *m, const cw_bus_stats *s)
{
    CW_BUS_COUNTERS(SET)
}

static void set_host_counters(canwire_node_controller_t *m, const cw_host_stats *s)
{
    CW_HOST_COUNTERS(SET)
}

static void set_tunnel_counters(canwire_tunnel_t *m, const port_tunnel_info *s)
{
    PORT_TUNNEL_COUNTERS(SET)
}

/* Publishes the counters of the bus, and its load since the last message. */
static void publish_bus(publisher *p, const cw_bus_stats *s)
{
    canwire_bus_stats_t m = {
        HEAD(p, s->ticks),
        .bitrate_bps = (int32_t)p->config->bitrate_bps,
        .load_second_permille = s->load_permille,
        .load_period_permille = (int32_t)cw_load_permille(&p->last_bus, s),
        .events_dropped = (int64_t)p->dropped,
    };
    set_bus_counters(&m, s);
    PUBLISH(p, CHANNEL_BUS, canwire_bus_stats_t, &m);
}

/* Publishes how good the bus is: errors, and arbitrations won by the wrong frame. */
static void publish_quality(publisher *p, const cw_bus_stats *s)
{
    const canwire_bus_quality_t m = {
        HEAD(p, s->ticks),
        .improper_arbitrations = (int64_t)s->improper_arbitrations,
        .error_rate_ppm = (int64_t)residual_error_ppm(s),
        .undetected_expected_ppt = (int64_t)residual_expected_ppt(s),
    };
    PUBLISH(p, CHANNEL_QUALITY, canwire_bus_quality_t, &m);
}

/* Fills in how long frames have waited, from handing in to the end of transmission. */
static void set_delay(canwire_node_stats_t *m, const cw_delay *d)
{
    m->delay_count = (int64_t)d->count;
    m->delay_min_ns = ticks_to_ns(d->min_ticks);
    m->delay_mean_ns = d->count ? ticks_to_ns(d->sum_ticks / d->count) : 0;
    m->delay_max_ns = ticks_to_ns(d->max_ticks);
    m->delay_p50_ns = ticks_to_ns(cw_delay_quantile_ticks(d, 500));
    m->delay_p99_ns = ticks_to_ns(cw_delay_quantile_ticks(d, 990));
}

/* Fills in the counters of a node. Those that the message sums up or calls otherwise come one by
 * one. */
static void set_counters(canwire_node_stats_t *m, const cw_node_stats *s)
{
    m->tec = s->tec;
    m->rec = s->rec;
    m->handed_in = (int64_t)(s->handed_in + s->made_by_rules);
    m->dropped_queue_full = (int64_t)s->dropped[CW_DROP_QUEUE_FULL];
    m->dropped_one_shot =
        (int64_t)(s->dropped[CW_DROP_ONE_SHOT] + s->dropped[CW_DROP_SLOT_MISSED]);
    m->dropped_bus_off = (int64_t)(s->dropped[CW_DROP_BUS_OFF] + s->dropped[CW_DROP_LINK_DOWN]);
    m->dropped_listen_only = (int64_t)s->dropped[CW_DROP_LISTEN_ONLY];
    m->dropped_bad_frame = (int64_t)s->dropped[CW_DROP_BAD_FRAME];
    m->dropped_fault = (int64_t)s->dropped[CW_DROP_FAULT];
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        m->dropped_rx += (int64_t)s->rx_dropped[why];
    m->bit_errors = (int64_t)s->errors[CW_ERROR_BIT];
    m->stuff_errors = (int64_t)s->errors[CW_ERROR_STUFF];
    m->form_errors = (int64_t)s->errors[CW_ERROR_FORM];
    m->crc_errors = (int64_t)s->errors[CW_ERROR_CRC];
    m->ack_errors = (int64_t)s->errors[CW_ERROR_ACK];
    CW_NODE_COUNTERS(SET)
}

/* Publishes the counters of a node, of its controller and of its port. */
static void publish_node(publisher *p, const cw_bus_stats *bus, const cw_node_stats *s, unsigned i,
                         const port_stats *interface)
{
    const cfg_node *node = &p->config->nodes[i];
    uint64_t bits = bus->bits - p->last_bus.bits;
    char none[] = "";
    canwire_node_stats_t m = {
        HEAD(p, bus->ticks),
        .node = node->name,
        .port = node->port ? node->port : none,
        .state = (char *)(uintptr_t)cw_state_name(s->state), /* only read when encoded */
        .load_period_permille =
            bits ? (int32_t)((s->tx_bits - p->last_tx_bits[i]) * 1000 / bits) : 0,
    };
    p->last_tx_bits[i] = s->tx_bits;
    set_counters(&m, s);
    set_delay(&m, &s->delay);
    m.dropped_rx += (int64_t)interface->write_failed;
    m.dropped_kernel = (int64_t)interface->kernel_dropped;
    m.dropped_loopless = (int64_t)interface->loopless;
    m.pushed_back = (int64_t)interface->pushed_back;
    m.error_frames_left_out = (int64_t)interface->errors_left_out;
    m.error_frames_ignored = (int64_t)interface->errors_ignored;
    PUBLISH(p, CHANNEL_NODE, canwire_node_stats_t, &m);
}

/* Publishes how a node synchronises, where it has a clock of its own. */
static void publish_timing(publisher *p, const cw_bus *bus, unsigned i)
{
    cw_sync_stats s;
    if (!output_sync_stats(&s, p->config, bus, i))
        return;
    const canwire_node_timing_t m = {
        HEAD_OF_NODE(p, bus, i),
        .hard_syncs = (int64_t)s.hard_syncs,
        .resyncs = (int64_t)s.resyncs,
        .phase_error_tq = s.phase_error_tq,
        .phase_error_ps = text_span_ps(s.phase_error),
        .margin_ps = s.margin == CW_NO_MARGIN ? -1 : text_span_ps(s.margin),
    };
    PUBLISH(p, CHANNEL_TIMING, canwire_node_timing_t, &m);
}

/* Publishes the local time of a time-triggered node, and its slots. */
static void publish_time(publisher *p, const cw_bus *bus, unsigned i)
{
    cw_node_time t;
    if (cw_node_get_time(bus, i, &t) != CW_OK)
        return;
    const cw_trigger_stats slots = local_time_slots(bus, i);
    char none[] = "";
    const bool known = t.has_global && t.master < p->config->node_count;
    const canwire_node_time_t m = {
        HEAD_OF_NODE(p, bus, i),
        .local_time = (int64_t)t.local,
        .captured = (int64_t)t.captured,
        .captures = (int64_t)t.captures,
        .global_time = t.has_global ? (int64_t)t.global : -1,
        .master = known ? p->config->nodes[t.master].name : none,
        .in_cycle = t.in_cycle ? 1 : 0,
        .cycle = t.cycle,
        .cycle_time = t.in_cycle ? (int64_t)t.cycle_time : -1,
        .references = (int64_t)t.references,
        .slots = (int64_t)slots.slots,
        .sent = (int64_t)slots.sent,
        .missed = (int64_t)slots.missed,
        .failed = (int64_t)slots.failed,
        .arbitration_lost = (int64_t)slots.lost,
        .late_max_ns = ticks_to_ns(slots.late_most),
    };
    PUBLISH(p, CHANNEL_LOCALTIME, canwire_node_time_t, &m);
}

/* Publishes how often and how long a bus is at the nominal rate and at the data rate. */
static void publish_bus_fd(publisher *p, const cw_bus_stats *s)
{
    const cw_bus_stats start = {.bits = 0};
    const rate_load nominal = rate_load_nominal(&start, s), data = rate_load_data(&start, s);
    const canwire_bus_fd_t m = {
        HEAD(p, s->ticks),
        .fd_frames = (int64_t)s->fd_frames,
        .nominal_bits = (int64_t)nominal.bits,
        .nominal_ns = ticks_to_ns(nominal.ticks),
        .nominal_load_period_permille = (int32_t)rate_load_nominal(&p->last_bus, s).permille,
        .data_bits = (int64_t)data.bits,
        .data_ns = ticks_to_ns(data.ticks),
        .data_load_period_permille = (int32_t)rate_load_data(&p->last_bus, s).permille,
    };
    PUBLISH(p, CHANNEL_FDBUS, canwire_bus_fd_t, &m);
}

/* Publishes the data rate of a node and the errors in data phases. */
static void publish_node_fd(publisher *p, const cw_bus *bus, unsigned i)
{
    cw_data_stats s;
    data_timing t = {.tdc.mode = CW_TDC_OFF};
    if (cw_node_get_data_stats(bus, i, &s) != CW_OK)
        return;
    const bool has_rate = data_timing_now(&t, p->config, bus, i);
    const canwire_node_fd_t m = {
        HEAD_OF_NODE(p, bus, i),
        .dbitrate_bps = has_rate ? (int32_t)timing_bitrate_bps(&t.bit) : 0,
        .data_bit_errors = (int64_t)s.errors[CW_ERROR_BIT],
        .data_stuff_errors = (int64_t)s.errors[CW_ERROR_STUFF],
        .data_form_errors = (int64_t)s.errors[CW_ERROR_FORM],
        .data_crc_errors = (int64_t)s.errors[CW_ERROR_CRC],
        .data_ack_errors = (int64_t)s.errors[CW_ERROR_ACK],
        .tdc_mode = (char *)(uintptr_t)data_timing_tdc_name(t.tdc.mode), /* only read */
        .tdcv = (int32_t)t.tdcv,
        .tdco = (int32_t)t.tdc.tdco,
    };
    PUBLISH(p, CHANNEL_FDNODE, canwire_node_fd_t, &m);
}

/* Publishes what the buffers and mailboxes of a controller hold and have lost. */
static void publish_controller(publisher *p, const cw_bus *bus, unsigned i,
                               const cw_node_stats *node)
{
    const cfg_node *config = &p->config->nodes[i];
    cw_host_stats s;
    if (cw_node_get_host_stats(bus, i, &s) != CW_OK)
        return;
    canwire_node_controller_t m = {
        HEAD_OF_NODE(p, bus, i),
        .model = (char *)(uintptr_t)cfg_model_name(config->controller.model), /* only read */
        .stored = (int64_t)node->stored,
        .waiting = (int32_t)node->rx_held,
    };
    set_host_counters(&m, &s);
    PUBLISH(p, CHANNEL_CONTROLLER, canwire_node_controller_t, &m);
}

/* Publishes the state of a tunnel and what has gone through it. */
static void publish_tunnel(publisher *p, const cw_bus *bus, unsigned i, const port *own)
{
    port_tunnel_info info;
    if (!own || !port_tunnel(own, &info))
        return;
    canwire_tunnel_t m = {
        HEAD_OF_NODE(p, bus, i),
        .state = (char *)(uintptr_t)info.state, /* only read when encoded */
    };
    set_tunnel_counters(&m, &info);
    PUBLISH(p, CHANNEL_TUNNEL, canwire_tunnel_t, &m);
}

void publisher_stats(publisher *p, const cw_bus *bus, const report *beyond)
{
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    publish_bus(p, &stats);
    publish_quality(p, &stats);
    if (output_has_fd(p->config, bus))
        publish_bus_fd(p, &stats);
    for (unsigned i = 0; i < p->config->node_count; i++) {
        cw_node_stats node;
        if (cw_node_get_stats(bus, i, &node) == CW_OK) {
            publish_node(p, &stats, &node, i, &beyond->nodes[i].interface);
            publish_controller(p, bus, i, &node);
        }
        publish_timing(p, bus, i);
        publish_time(p, bus, i);
        publish_node_fd(p, bus, i);
        publish_tunnel(p, bus, i, beyond->nodes[i].port);
    }
    p->last_bus = stats;
}

/* Returns a text that is only read while encoding; "" for a missing one. */
static char *publish_text_of(const json_t *object, const char *key)
{
    const char *text = get_text(object, key);
    return (char *)(uintptr_t)(text ? text : "");
}

/* Publishes how far a recording or a journal is. */
static void publish_file(publisher *p, const sink_info *s)
{
    const canwire_file_t m = {
        .utime_us = realtime_us(),
        .bus = p->config->bus_name,
        /* texts that are only read while encoding */
        .kind = (char *)(uintptr_t)sink_kind_name(s->kind),
        .file = (char *)(uintptr_t)s->name,
        .state = (char *)(uintptr_t)s->state,
        .why = (char *)(uintptr_t)(s->why ? s->why : ""),
        .entries = (int64_t)s->written,
        .lost = (int64_t)s->lost,
        .gaps = (int32_t)s->gaps,
    };
    PUBLISH(p, CHANNEL_FILE, canwire_file_t, &m);
}

void publisher_sinks(publisher *p, const sink_list *all)
{
    for (size_t i = 0; i < all->count; i++)
        publish_file(p, &all->all[i]);
}

/* Adds up a counter of all rules of a gateway. */
static int64_t sum_of(const json_t *rules, const char *key)
{
    int64_t sum = 0;
    for (size_t i = 0; i < json_array_size(rules); i++)
        sum += get_number(json_array_get(rules, i), key);
    return sum;
}

/* Publishes what a gateway passes on from this bus. The other bus publishes the other direction. */
static void publish_gateway(publisher *p, const json_t *gateway)
{
    const json_t *ends = json_object_get(gateway, "between");
    const char *first = json_string_value(json_array_get(ends, 0));
    const size_t length = strlen(p->config->bus_name);
    const bool forward = strncmp(first, p->config->bus_name, length) == 0 && first[length] == ':';
    const json_t *direction = json_object_get(gateway, forward ? "forward" : "backward");
    const json_t *rules = json_object_get(direction, "rules");
    const canwire_gateway_t m = {
        .utime_us = realtime_us(),
        .bus = p->config->bus_name,
        .name = publish_text_of(gateway, "name"),
        .node = (char *)(uintptr_t)(json_string_value(json_array_get(ends, !forward)) + length + 1),
        .other = (char *)(uintptr_t)json_string_value(json_array_get(ends, forward)),
        .forwarded = sum_of(rules, "forwarded"),
        .lost = sum_of(rules, "lost"),
        .dropped = get_number(direction, "dropped"),
    };
    PUBLISH(p, CHANNEL_GATEWAY, canwire_gateway_t, &m);
}

void publisher_gateways(publisher *p, const json_t *gateways)
{
    for (size_t i = 0; i < json_array_size(gateways); i++)
        publish_gateway(p, json_array_get(gateways, i));
}

void publisher_verdicts(publisher *p, const cw_bus *bus, const verdicts *all)
{
    char *name[VERDICTS_TOLD], *wanted[VERDICTS_TOLD], *got[VERDICTS_TOLD], *event[VERDICTS_TOLD];
    int64_t failed_ns[VERDICTS_TOLD];
    int32_t count = 0;
    if (verdicts_count(all) == 0)
        return;
    for (size_t i = 0; i < verdicts_count(all) && count < VERDICTS_TOLD; i++) {
        const verdict *one = verdicts_at(all, i);
        if (!one->failed)
            continue;
        name[count] = one->name;
        wanted[count] = one->wanted;
        got[count] = one->got;
        event[count] = one->event;
        failed_ns[count++] = ticks_to_ns(one->tick);
    }
    const canwire_verdict_t m = {
        HEAD(p, cw_bus_now(bus)),
        .expectations = (int32_t)verdicts_count(all),
        .failed = (int32_t)verdicts_failed(all),
        .count = count,
        .name = name,
        .wanted = wanted,
        .got = got,
        .event = event,
        .failed_ns = failed_ns,
    };
    PUBLISH(p, CHANNEL_VERDICT, canwire_verdict_t, &m);
}

/* Splits the lines of output_event(), one for each node, in the order of the nodes. */
static void publish_lines(publisher *p, const cw_event *event, char *text)
{
    char none[] = "";
    uint64_t left = event->nodes;
    for (char *line = strtok_r(text, "\n", &text); line; line = strtok_r(NULL, "\n", &text)) {
        unsigned i = 0;
        while (left && !(left >> i & 1u))
            i++;
        const canwire_event_t m = {
            .bus_time_ns = ticks_to_ns(event->tick),
            .bus = p->config->bus_name,
            .node = left ? p->config->nodes[i].name : none,
            .event = (char *)(uintptr_t)cw_event_name(event->kind), /* only read when encoded */
            .json = line,
        };
        left &= left - 1;
        PUBLISH(p, CHANNEL_EVENT, canwire_event_t, &m);
    }
}

void publisher_event(publisher *p, const cw_event *event)
{
    if (!(p->config->lcm.events >> event->kind & 1u))
        return;
    rewind(p->event.out);
    output_event(p->event.out, p->config, event);
    if (memo_text(&p->event) && p->event.size > 0)
        publish_lines(p, event, p->event.text);
}
