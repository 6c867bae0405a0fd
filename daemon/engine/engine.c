/* SPDX-License-Identifier: MIT
 *
 * engine.c - the bus in real time.
 *
 * At each wake-up, by a port or by the timer: read all ports, hand in what arrived at its arrival
 * time, advance the bus to now, deliver. So a late wake-up delays a delivery but does not shift the
 * bus.
 */
#include "engine/engine_private.h"

#include "base/log.h"
#include "engine/due.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define READS_MAX 64 /* batches of one port at one wake-up, so that no port starves the others */
#define SLICE_TICKS (CW_CLOCK_HZ / 1000u)
#define WAKE_MAX_NS 50000000 /* of one wake-up that has much to catch up with */
#define WORK_AT_ONCE 256u /* of the bus, before a look at the clock */
#define RELEASES_AT_ONCE 16u /* before a look at the clock */
#define RELEASES_OF_A_TICK 1024u /* the same within one tick */
#define NS_PER_S INT64_C(1000000000)
#define CALM_SHOWN_BITS 24 /* behind an event: all that a recording shows of it is over */
#define CLOCK_STEP_NS 1000000 /* what the wall clock may be away from bus time in recordings */

/* ---- Clocks ---------------------------------------------------------------------------------- */

static int64_t clock_ns(clockid_t id)
{
    struct timespec t;
    (void)clock_gettime(id, &t);
    return t.tv_sec * NS_PER_S + t.tv_nsec;
}

/* A moment as seen by both clocks; time stamps of frames are CLOCK_REALTIME. */
typedef struct clock_pair {
    int64_t monotonic_ns;
    int64_t realtime_ns;
} clock_pair;

static clock_pair read_clocks(void)
{
    return (clock_pair){.monotonic_ns = clock_ns(CLOCK_MONOTONIC),
                        .realtime_ns = clock_ns(CLOCK_REALTIME)};
}

static void follow_clock(engine *e, const clock_pair *now)
{
    int64_t offset_ns = now->realtime_ns - now->monotonic_ns;
    if (llabs(offset_ns - e->realtime_offset_ns) > CLOCK_STEP_NS)
        e->realtime_offset_ns = offset_ns;
}

/* One tick is 12.5 ns. Rounded down: the bus is never ahead of the clock. */
static uint64_t tick_of(const engine *e, int64_t monotonic_ns)
{
    int64_t ns = monotonic_ns - e->epoch_ns;
    return ns > 0 ? (uint64_t)ns * 2 / 25 : 0;
}

/* Rounded up: a timer is never early. */
static int64_t monotonic_of(const engine *e, uint64_t tick)
{
    return e->epoch_ns + (int64_t)((tick * 25 + 1) / 2);
}

/* When a frame arrived, on the bus. Somebody may have set the clock: a time stamp from the
 * future is now, one from before the last wake-up the bus itself takes for now, and the frames
 * of a port come in the order in which they are read. */
static uint64_t arrival_tick(engine *e, unsigned node, const port_frame *frame,
                             const clock_pair *now)
{
    int64_t age_ns = now->realtime_ns - frame->realtime_ns;
    if (frame->realtime_ns == 0 || age_ns < 0)
        age_ns = 0;
    uint64_t tick = tick_of(e, now->monotonic_ns - age_ns);
    if (tick > e->arrived[node])
        e->arrived[node] = tick;
    return e->arrived[node];
}

/* ---- Bus and world --------------------------------------------------------------------------- */

/* They say which error frames the ECU gets, and may change while the bus runs. */
static unsigned modes_of(const engine *e, unsigned node)
{
    cw_settings settings;
    return cw_node_get_settings(e->now.bus, node, &settings) == CW_OK ? settings.modes : 0;
}

static void deliver(engine *e, unsigned node, const cw_event *event)
{
    errframe error;
    bool received = event->kind == CW_EVENT_RX;
    if (!e->now.ports[node] && received)
        conserve_missed(&e->books, node, e->config->nodes[node].port != NULL);
    else if (!e->now.ports[node])
        return;
    else if (received)
        (void)port_write(e->now.ports[node], &event->frame); /* a failure is counted there */
    else if (errframe_from_event(&error, event, modes_of(e, node)))
        (void)port_write_error(e->now.ports[node], &error, event->tick);
}

/* Whose frame it was is what its program can be found by. */
static void note_overflow(engine *e, const cw_event *event)
{
    if (event->kind != CW_EVENT_DROP || event->why != CW_DROP_QUEUE_FULL)
        return;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (event->nodes >> i & 1u)
            e->overflowed[i] = event->frame;
}

static void tell(engine *e, const cw_event *event)
{
    note_overflow(e, event);
    if (e->publisher)
        publisher_event(e->publisher, event);
    if (e->observer)
        e->observer(e->observer_user, event);
}

static void handle_events(void *user)
{
    engine *e = user;
    cw_event event;
    while (cw_bus_poll(e->now.bus, &event)) {
        e->calm_bits = 0;
        for (unsigned i = 0; i < e->config->node_count; i++)
            if (event.nodes >> i & 1u)
                deliver(e, i, &event);
        tell(e, &event);
    }
}

/* Whether this wake-up has lasted for long enough. */
static bool is_over(const engine *e)
{
    return clock_ns(CLOCK_MONOTONIC) >= e->deadline_ns;
}

static uint64_t work_since_look(const engine *e)
{
    return cw_bus_work(e->now.bus) - e->looked_at;
}

/* Whether this wake-up may go on. The clock is looked at when some work has been done meanwhile:
 * what lies in a millisecond of the bus, or in one frame, may be any amount of it. */
static bool has_time(engine *e)
{
    if (work_since_look(e) < WORK_AT_ONCE)
        return true;
    e->looked_at = cw_bus_work(e->now.bus);
    return !is_over(e);
}

/* Up to a tick; false when the time of this wake-up is over before. */
static bool go_to(engine *e, uint64_t tick)
{
    while (has_time(e))
        if (inputs_advance_some(&e->inputs, tick, WORK_AT_ONCE - work_since_look(e)))
            return true;
    return false;
}

/* Bit by bit, with a look at each; those of an idle bus, in which nothing is to be seen, go in one
 * leap. */
static bool show_bits(engine *e, uint64_t tick)
{
    const uint32_t bit_ticks = e->config->bit_ticks;
    while (cw_bus_now(e->now.bus) + bit_ticks <= tick) {
        bool calm = e->calm_bits >= CALM_SHOWN_BITS;
        uint64_t now = cw_bus_now(e->now.bus);
        uint64_t quiet = calm ? cw_bus_quiet_until(e->now.bus, tick) : now;
        cw_bus_set_watching(e->now.bus, quiet == now);
        if (!go_to(e, quiet > now ? quiet : now + bit_ticks))
            return false;
        if (quiet == now) {
            e->bit_observer(e->bit_user, e->now.bus);
            e->calm_bits++;
        }
    }
    return true;
}

/* Up to a tick; false when the time of this wake-up is over before. */
static bool advance(engine *e, uint64_t tick)
{
    return (!e->bit_observer || show_bits(e, tick)) && go_to(e, tick);
}

/* The first frame of the inbox comes up at the latest in the bit that holds its tick. False when
 * the time of this wake-up is over before. */
static bool make_room_in_inbox(engine *e)
{
    return advance(e, cw_bus_inbox_first(e->now.bus) + e->config->bit_ticks);
}

static void hand_in_batch(engine *e, unsigned node, unsigned count, const clock_pair *now)
{
    e->frames_read += count;
    for (unsigned i = 0; i < count; i++) {
        uint64_t tick = arrival_tick(e, node, &e->batch[i], now);
        (void)inputs_send(&e->inputs, node, &e->batch[i].frame, tick); /* there is room for it */
    }
}

/* For how many frames there is room in the inbox, up to a batch, once the bus has made some. */
static unsigned inbox_room(engine *e)
{
    while (cw_bus_inbox_room(e->now.bus) < PORT_BATCH && make_room_in_inbox(e))
        continue;
    unsigned room = cw_bus_inbox_room(e->now.bus);
    return room < PORT_BATCH ? room : PORT_BATCH;
}

/* How many frames a port's node takes at once; 0: its queue is full, and they wait. */
static unsigned node_room(const engine *e, unsigned node, bool waits)
{
    unsigned room = waits ? cw_node_room(e->now.bus, node) : PORT_BATCH;
    return room < PORT_BATCH ? room : PORT_BATCH;
}

/* Returns whether its node has room for more. When the bus is so far behind that the inbox is full,
 * what waits there waits on; all ports are looked at again soon. */
static bool read_port(engine *e, unsigned node, const clock_pair *now, bool waits)
{
    bool more = true;
    unsigned max = 1;
    for (unsigned reads = 0; more && reads < READS_MAX; reads++) {
        max = node_room(e, node, waits);
        unsigned room = max > 0 ? inbox_room(e) : 0;
        if (room == 0)
            break;
        unsigned count = port_read(e->now.ports[node], e->batch, max < room ? max : room, &more);
        hand_in_batch(e, node, count, now);
    }
    port_tell_overflow(e->now.ports[node], cw_bus_now(e->now.bus));
    return max > 0;
}

void engine_read_rest(engine *e, unsigned node)
{
    clock_pair now = read_clocks();
    (void)read_port(e, node, &now, false);
    if (cw_bus_inbox_room(e->now.bus) == 0)
        log_node_warning(e->config->nodes[node].name,
                         "what its ECU has written last is lost: the bus is too far behind");
}

/* A port that waits for room in its node's queue is not watched, or it would wake the loop for
 * ever; the bus makes room, and is looked after until then. */
static void read_or_push_back(engine *e, unsigned node, const clock_pair *now)
{
    const uint64_t bit = UINT64_C(1) << node;
    bool waits = e->config->nodes[node].when_full == CFG_WHEN_FULL_WAIT;
    if (read_port(e, node, now, waits)) {
        e->pushed_back &= ~bit;
        if (!e->ticking)
            engine_watch_port(e, node);
        return;
    }
    if (!(e->pushed_back & bit))
        port_pushed_back(e->now.ports[node]);
    e->pushed_back |= bit;
    engine_unwatch_port(e, node);
}

static void read_ports(engine *e, const clock_pair *now)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (e->now.ports[i])
            read_or_push_back(e, i, now);
}

/* What has waited for room comes in as soon as there is some. */
static void read_pushed_back(engine *e)
{
    clock_pair now = read_clocks();
    for (unsigned i = 0; i < e->config->node_count; i++)
        if ((e->pushed_back >> i & 1u) && e->now.ports[i] && cw_node_room(e->now.bus, i) > 0)
            read_or_push_back(e, i, &now);
}

/* Hands in what is to be released up to a tick. Returns up to which tick that has been done: there
 * may be more of it than any machine can do. A tick is done as a whole where it can be. */
static uint64_t run_releases(engine *e, uint64_t now)
{
    uint64_t last = CW_NEVER;
    unsigned count = 0; /* since the clock was looked at */
    uint64_t tick;
    while ((tick = release_next_tick(e->now.plan)) <= now) {
        bool look = count >= (tick == last ? RELEASES_OF_A_TICK : RELEASES_AT_ONCE);
        if (look && is_over(e)) {
            now = tick > 0 ? tick - 1 : 0;
            break;
        }
        count = look ? 1 : count + 1;
        last = tick;
        unsigned node;
        bool frame = release_first(e->now.plan, &node) != NULL;
        if (inputs_release(&e->inputs, e->now.plan) == CW_OK) {
            e->books.nodes[node].released += frame;
        } else if (!make_room_in_inbox(e)) {
            now = tick > 0 ? tick - 1 : 0;
            break;
        }
    }
    if (now > e->released)
        e->released = now;
    return now;
}

/* How far the bus may go at once. A file that is replayed as fast as possible looks after each bit
 * whether it is its turn; ports with frames that wait for room look when a frame has ended. */
static uint64_t next_look(const engine *e)
{
    uint64_t bit = cw_bus_now(e->now.bus) + e->config->bit_ticks;
    if (release_is_fast(e->now.plan))
        return bit;
    if (!e->pushed_back)
        return CW_NEVER;
    uint64_t next = cw_bus_next(e->now.bus);
    return next > bit ? next : bit;
}

uint64_t engine_run_to(engine *e, uint64_t tick)
{
    uint64_t end;
    uint64_t reached;
    release_look(e->now.plan, e->now.bus);
    do {
        end = next_look(e);
        if (end > tick)
            end = tick;
        reached = run_releases(e, end);
        if (!advance(e, reached))
            return cw_bus_now(e->now.bus);
        if (e->pushed_back)
            read_pushed_back(e);
        release_look(e->now.plan, e->now.bus);
    } while (reached == end && end < tick);
    return reached;
}

/* ---- Timer ----------------------------------------------------------------------------------- */

/* When something happens next if no port has news; CW_NEVER: the bus rests, nothing is planned. */
static uint64_t next_tick(const engine *e)
{
    return due_tick(e->now.bus, e->now.plan, e->config);
}

/* Reading the CPU time is a system call, so only who spins does it. */
static bool may_spin(engine *e)
{
    return e->config->pacing == CFG_PACING_SPIN &&
           pacing_may_spin(&e->duty, clock_ns(CLOCK_MONOTONIC), clock_ns(CLOCK_THREAD_CPUTIME_ID));
}

static int64_t next_wake_ns(engine *e)
{
    int64_t wake_ns = INT64_MAX;
    if (e->due_ns != INT64_MAX)
        wake_ns = pacing_wake_ns(e->config->pacing, e->due_ns, may_spin(e));
    if (!e->ticking)
        return wake_ns;
    int64_t tick_ns = pacing_next_tick_ns(clock_ns(CLOCK_MONOTONIC));
    return tick_ns < wake_ns ? tick_ns : wake_ns;
}

/* A bus that would go on now and then, when somebody asks for its state, must not seem to run. */
static void fail(engine *e, const char *what, const char *why)
{
    if (!e->failed)
        log_error("%s: %s; the bus cannot go on", what, why);
    e->failed = true;
    ev_break(e->loop, EVBREAK_ALL);
}

/* libev has given up a descriptor since the kernel does not take it, and calls once more. */
static bool is_watched(engine *e, int events, const char *what)
{
    if (events & EV_ERROR)
        fail(e, what, "it cannot be watched any more");
    return !(events & EV_ERROR);
}

bool engine_has_failed(const engine *e)
{
    return e->failed;
}

static void arm_timer(engine *e)
{
    uint64_t tick = next_tick(e);
    if (e->stopping && e->stop_tick < tick)
        tick = e->stop_tick;
    if (e->next && e->next->deadline < tick)
        tick = e->next->deadline;
    e->due_ns = tick == CW_NEVER ? INT64_MAX : monotonic_of(e, tick);
    if (!alarm_set(&e->alarm, next_wake_ns(e)))
        fail(e, "timer", strerror(errno));
}

/* A timer that is due has been set for a little earlier, to be up in time. One that was not, or
 * rings for another reason, finds nothing to wait for. */
static void spin(const engine *e)
{
    if (e->config->pacing != CFG_PACING_SPIN ||
        e->due_ns > clock_ns(CLOCK_MONOTONIC) + PACING_SPIN_NS)
        return;
    while (clock_ns(CLOCK_MONOTONIC) < e->due_ns)
        continue;
}

/* From the first frame after a pause on ports are looked at once a tick, until a tick has none. */
static void start_ticking(engine *e)
{
    e->ticking = true;
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_unwatch_port(e, i);
    arm_timer(e);
}

static void stop_ticking(engine *e)
{
    e->ticking = false;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (!(e->pushed_back >> i & 1u))
            engine_watch_port(e, i);
}

/* ---- Wake-ups -------------------------------------------------------------------------------- */

/* When the bus is too far behind, bus time stands still for what it has missed, and what has
 * arrived meanwhile comes as much earlier. */
static void skip_missed_time(engine *e)
{
    int64_t boot_ns = clock_ns(CLOCK_BOOTTIME); /* goes on while the machine is suspended */
    int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    uint64_t excess = catchup_excess(next_tick(e), tick_of(e, now_ns), e->catch_up_ticks);
    uint64_t skipped_ns = excess / 2 * 25;
    e->epoch_ns += (int64_t)skipped_ns;
    for (unsigned i = 0; i < e->config->node_count; i++)
        e->arrived[i] -= e->arrived[i] < excess ? e->arrived[i] : excess;
    skipped_ns += catchup_suspended(&e->catchup, boot_ns, now_ns);
    if (skipped_ns > 0) {
        const cw_event event = inputs_skip(&e->inputs, skipped_ns / 25 * 2, excess);
        catchup_note(&e->catchup, skipped_ns);
        tell(e, &event);
    }
    catchup_log(&e->catchup, now_ns);
}

/* Up to now, in slices and not for longer than WAKE_MAX_NS: a bus that is too much for this machine
 * falls behind, but keeps no signal and no statistics waiting. */
static void catch_up(engine *e, uint64_t now)
{
    uint64_t tick;
    do {
        uint64_t next = next_tick(e);
        tick = next < now && now - next > SLICE_TICKS ? next + SLICE_TICKS : now;
        tick = engine_run_to(e, tick);
    } while (tick < now && !is_over(e));
}

static bool may_stop(const engine *e)
{
    return cw_bus_idle(e->now.bus) || cw_bus_now(e->now.bus) >= e->stop_tick;
}

/* Bit by bit up to now, so that the bus stops where the frame ends; or by the clock, when this
 * machine cannot keep up with the bus. */
static void run_out(engine *e, uint64_t now)
{
    const uint32_t bit_ticks = e->config->bit_ticks;
    while (!may_stop(e) && cw_bus_now(e->now.bus) + bit_ticks <= now)
        if (!advance(e, cw_bus_now(e->now.bus) + bit_ticks))
            break;
    if (may_stop(e) || clock_ns(CLOCK_MONOTONIC) >= e->stop_ns)
        ev_break(e->loop, EVBREAK_ALL);
}

/* ---- Wake-ups -------------------------------------------------------------------------------- */

static void start_turn(engine *e)
{
    e->deadline_ns = clock_ns(CLOCK_MONOTONIC) + WAKE_MAX_NS;
    e->looked_at = cw_bus_work(e->now.bus);
}

static void wake(engine *e)
{
    if (!e->stopping)
        skip_missed_time(e);
    clock_pair clocks = read_clocks();
    follow_clock(e, &clocks);
    start_turn(e);
    uint64_t now = tick_of(e, clocks.monotonic_ns);
    if (e->stopping) {
        run_out(e, now);
    } else {
        read_ports(e, &clocks);
        start_turn(e); /* whatever the ports took, the bus has time of its own */
        engine_run_to_boundary(e, now);
        if (!e->next || !is_over(e))
            catch_up(e, now);
    }
    arm_timer(e);
}

static void on_port(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine *e = ((port_watch *)io)->engine;
    if (!is_watched(e, events, "port"))
        return;
    if (e->config->pacing == CFG_PACING_TICK && !e->stopping)
        start_ticking(e);
    else
        wake(e);
}

void engine_watch_port(engine *e, unsigned node)
{
    if (!e->now.ports[node] || ev_is_active(&e->watches[node].io))
        return;
    e->watches[node].engine = e;
    ev_io_init(&e->watches[node].io, on_port, port_fd(e->now.ports[node]), EV_READ);
    ev_io_start(e->loop, &e->watches[node].io);
}

void engine_unwatch_port(engine *e, unsigned node)
{
    if (e->now.ports[node])
        ev_io_stop(e->loop, &e->watches[node].io);
}

static void on_timer(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine *e = io->data;
    if (!is_watched(e, events, "timer") || !alarm_take(&e->alarm))
        return;
    spin(e);
    uint64_t read_before = e->frames_read;
    wake(e);
    if (e->ticking && e->frames_read == read_before) {
        stop_ticking(e);
        arm_timer(e);
    }
}

/* ---- Start and stop -------------------------------------------------------------------------- */

static bool make_timer(engine *e)
{
    if (!alarm_open(&e->alarm)) {
        log_error("timerfd: %s", strerror(errno));
        return false;
    }
    ev_io_init(&e->timer, on_timer, e->alarm.fd, EV_READ);
    e->timer.data = e;
    return true;
}

void engine_read_limits(engine *e)
{
    e->catch_up_ticks = text_time_ticks(e->config->catch_up, e->config->bit_ticks);
}

engine *engine_start(struct ev_loop *loop, live *config, publisher *sink)
{
    engine *e = calloc(1, sizeof *e);
    if (!e) {
        log_error("out of memory");
        return NULL;
    }
    e->loop = loop;
    e->live = config;
    e->config = live_config(config);
    e->publisher = sink;
    e->alarm = ALARM_CLOSED;
    bool memory = setup_make(&e->now, e->config);
    inputs_init(&e->inputs, config, e->now.bus, handle_events, e);
    if (!memory)
        log_error("out of memory");
    if (!memory || !engine_open_ports(e) || !make_timer(e) || !engine_watch_links(e)) {
        engine_free(e);
        return NULL;
    }
    e->epoch_ns = clock_ns(CLOCK_MONOTONIC);
    e->realtime_offset_ns = clock_ns(CLOCK_REALTIME) - e->epoch_ns;
    catchup_begin(&e->catchup, clock_ns(CLOCK_BOOTTIME), e->epoch_ns);
    engine_read_limits(e);
    release_look(e->now.plan, e->now.bus);
    ev_io_start(loop, &e->timer);
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_watch_port(e, i);
    arm_timer(e);
    return e;
}

static void unwatch_all(engine *e)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_unwatch_port(e, i);
    engine_unwatch_links(e);
}

void engine_stop(engine *e)
{
    if (e->stopping)
        return;
    wake(e); /* what has arrived up to now still counts */
    e->stopping = true;
    e->ticking = false;
    catchup_log(&e->catchup, INT64_MAX);
    e->stop_tick = cw_bus_now(e->now.bus) + BOUNDARY_BITS * e->config->bit_ticks;
    e->stop_ns = clock_ns(CLOCK_MONOTONIC) + NS_PER_S +
                 2 * (int64_t)text_ticks_ns((uint64_t)BOUNDARY_BITS * e->config->bit_ticks);
    reload_free(e->next);
    e->next = NULL;
    unwatch_all(e);
    wake(e);
}

void engine_free(engine *e)
{
    if (!e)
        return;
    unwatch_all(e);
    if (e->alarm.fd >= 0)
        ev_io_stop(e->loop, &e->timer);
    alarm_close(&e->alarm);
    reload_free(e->next);
    setup_free(&e->now);
    free(e);
}

void engine_update(engine *e)
{
    wake(e);
}

int64_t engine_time_ns(const engine *e, uint64_t tick)
{
    return monotonic_of(e, tick);
}

inputs *engine_change(engine *e)
{
    wake(e);
    return &e->inputs;
}

inputs *engine_inputs(engine *e)
{
    return &e->inputs;
}

void engine_on_change(engine *e, engine_changed *changed, void *user)
{
    e->changed = changed;
    e->changed_user = user;
}

void engine_observe(engine *e, engine_observer *observer, void *user)
{
    e->observer = observer;
    e->observer_user = user;
}

void engine_observe_bits(engine *e, engine_bit_observer *observer, void *user)
{
    e->bit_observer = observer;
    e->bit_user = user;
    e->calm_bits = 0; /* who is new sees how things are */
    if (!observer)
        cw_bus_set_watching(e->now.bus, false);
}

uint64_t engine_realtime_ns(const engine *e, uint64_t tick)
{
    int64_t ns = e->epoch_ns + e->realtime_offset_ns + (int64_t)text_ticks_ns(tick);
    return ns > 0 ? (uint64_t)ns : 0;
}

const cw_bus *engine_bus(const engine *e)
{
    return e->now.bus;
}

static uint64_t lag_ns(const engine *e)
{
    uint64_t now = tick_of(e, clock_ns(CLOCK_MONOTONIC));
    uint64_t due = next_tick(e);
    return due < now ? (now - due) / 2 * 25 : 0;
}

void engine_report(const engine *e, report *out)
{
    memset(out, 0, sizeof *out);
    out->epoch_ns = engine_realtime_ns(e, 0);
    out->lag_ns = lag_ns(e);
    out->skips = e->catchup.skips;
    out->skipped_ns = e->catchup.skipped_ns;
    for (unsigned i = 0; i < e->config->node_count; i++) {
        port *own = e->now.ports[i];
        out->nodes[i].link = e->links.state[i];
        conserve_get_stats(&out->nodes[i].interface, &e->books, i, own);
        out->nodes[i].pushed_back = e->pushed_back >> i & 1u;
        out->nodes[i].overflowed = e->overflowed[i];
        out->nodes[i].conserved = conserve_balances(&e->books, e->now.bus, i, own);
    }
}

unsigned engine_check_books(const engine *e)
{
    return conserve_check(&e->books, e->config, e->now.bus, e->now.ports);
}
