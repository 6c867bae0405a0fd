/* SPDX-License-Identifier: MIT
 *
 * virtual.c - bus time that the waits of programs move, in place of the clock.
 *
 * While a program has its turn, time holds. When all of them wait, their frames are read, in the
 * order of the nodes, and the one whose turn is next is woken. When nobody is ready the bus goes on
 * to the next moment at which something happens, or at which one of them wakes up. So what the bus
 * does is a function of what the programs do.
 */
#include "base/text/counted.h"
#include "engine/core.h"

#include "base/log.h"

#include <errno.h>
#include <ev.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#define ROUNDS_MAX 100u /* of reading at one moment; an inbox may be full */
#define LOOK_S 1.0     /* of the machine, between two looks at who holds time ... */
#define HELD_LOOKS 5u  /* ... and the looks before that is told */
#define DRAIN_NS INT64_C(1000000000) /* for what is left when the last program has gone */

/* ---- Programs -------------------------------------------------------------------------------- */

static unsigned virtual_find_node(void *user, const char *name)
{
    const engine *e = user;
    const uint8_t node = cfg_find_node(e->config, name);
    return node == CW_NO_NODE ? CW_NODES_MAX : node;
}

/* Time begins when enough programs have joined, whichever way their messages were read. */
static void virtual_count_programs(engine *e)
{
    struct engine_virtual *v = e->virtual_time;
    if (!v->begun && v->turns->count >= e->config->virtual_time.programs) {
        v->begun = true;
        log_info("virtual time begins with %s", counted(v->turns->count, "program").text);
    }
    if (v->turns->count > 0)
        v->left_ns = v->now_ns;
}

/* Programs have come, gone or said something. Their frames may be unread. */
static void on_change(void *user)
{
    engine *e = user;
    e->virtual_time->unread = true;
    virtual_count_programs(e);
    e->wake(e);
}

/* Wakes programs whose ports have told them something. */
static void pass_on_told(struct engine_virtual *v, port *p)
{
    port_told told[PORT_TOLD_MAX];
    const unsigned count = p ? port_take_told(p, told) : 0;
    for (unsigned i = 0; i < count; i++)
        turns_told(v->turns, told[i].pid, told[i].what);
}

static void take_told(engine *e)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        pass_on_told(e->virtual_time, e->now.ports[i]);
    pass_on_told(e->virtual_time, e->now.door);
}

/* ---- Time ------------------------------------------------------------------------------------ */

static uint64_t tick_at(const engine *e, int64_t bus_ns)
{
    return bus_ns == TIMING_NEVER ? CW_NEVER : clock_tick(e->clock, e->clock->epoch_ns + bus_ns);
}

static int64_t ns_at(const engine *e, uint64_t tick)
{
    return clock_monotonic_ns(e->clock, tick) - e->clock->epoch_ns;
}

/* Sets the time after the bus has gone on. It never goes back, nor beyond a wake-up. */
static void set_now(engine *e, int64_t until_ns, bool there)
{
    struct engine_virtual *v = e->virtual_time;
    int64_t ns = ns_at(e, cw_bus_now(e->now.bus));
    if (there || ns > until_ns)
        ns = until_ns;
    if (ns <= v->now_ns)
        return;
    v->now_ns = ns;
    turns_go_on(v->turns);
}

/* Returns true while frames of programs that have gone are under way. */
static bool drains(const engine *e)
{
    cw_bus_stats stats;
    const struct engine_virtual *v = e->virtual_time;
    cw_bus_get_stats(e->now.bus, &stats);
    return v->now_ns < v->left_ns + DRAIN_NS &&
           (!cw_bus_idle(e->now.bus) || stats.pending > 0 ||
            cw_bus_inbox_first(e->now.bus) <= cw_bus_now(e->now.bus));
}

/* Returns the tick to which the bus may go now, CW_NEVER: it rests. */
static uint64_t next_stop(const engine *e, uint64_t wake_tick)
{
    const struct engine_virtual *v = e->virtual_time;
    const uint64_t now = cw_bus_now(e->now.bus);
    uint64_t stop = CW_NEVER;
    if (v->begun && (v->turns->count > 0 || drains(e)))
        stop = engine_next_tick(e);
    if (e->next && e->next->deadline < stop)
        stop = e->next->deadline;
    if (stop <= now)
        stop = now + 1; /* all that is due happens on the way */
    else if (stop < cw_bus_tick_after(e->now.bus, 1))
        stop = cw_bus_tick_after(e->now.bus, 1); /* a frame in the bit is taken at its end */
    return wake_tick < stop ? wake_tick : stop;
}

/* Returns the bus time at which time stands still, TIMING_NEVER: it does not. */
static int64_t limit_of(const engine *e)
{
    const uint64_t until = e->config->virtual_time.until;
    return until > 0 ? ns_at(e, until) : TIMING_NEVER;
}

/* Lets the bus go on to the next stop. Returns false when it rests. */
static bool virtual_go_on(engine *e)
{
    const struct engine_virtual *v = e->virtual_time;
    const int64_t limit_ns = limit_of(e);
    int64_t until_ns = turns_next_ns(v->turns);
    if (v->now_ns >= limit_ns)
        return false;
    if (until_ns > limit_ns && v->begun && v->turns->count > 0)
        until_ns = limit_ns;
    const uint64_t wake_tick = tick_at(e, until_ns);
    const uint64_t stop = next_stop(e, wake_tick);
    if (stop == CW_NEVER)
        return false;
    const bool present = engine_go(e, stop);
    take_told(e);
    set_now(e, until_ns, present && stop == wake_tick);
    return true;
}

/* ---- Turns ----------------------------------------------------------------------------------- */

/* Returns true when a port can be read: one read may only have let a program in. */
static bool any_waits(const engine *e)
{
    struct pollfd all[CW_NODES_MAX + 1];
    nfds_t count = 0;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (e->now.ports[i] && !(e->pushed_back >> i & 1u))
            all[count++] = (struct pollfd){.fd = port_fd(e->now.ports[i]), .events = POLLIN};
    if (e->now.door)
        all[count++] = (struct pollfd){.fd = port_fd(e->now.door), .events = POLLIN};
    return poll(all, count, 0) > 0;
}

/* Reads what programs have sent up to now. */
static void virtual_read_all(engine *e)
{
    programs_let_in(e->virtual_time->programs); /* a child has come before its parent waits */
    virtual_count_programs(e);
    const clock_pair now = engine_now(e);
    unsigned rounds = 0;
    do {
        engine_look_at_door(e);
        engine_read_ports(e, &now);
        engine_see_guests_off(e);
    } while (any_waits(e) && ++rounds < ROUNDS_MAX);
    engine_watch_door(e);
    e->virtual_time->unread = rounds == ROUNDS_MAX;
    take_told(e);
}

/* Begins the turn of a program. Returns false when nobody is ready. */
static bool give_turn(engine *e)
{
    struct engine_virtual *v = e->virtual_time;
    const unsigned place = v->begun ? turns_begin(v->turns, v->now_ns) : TURNS_NONE;
    if (place == TURNS_NONE)
        return false;
    v->given++;
    programs_tell_now(v->programs, place, v->now_ns, engine_now(e).realtime_ns);
    return true;
}

/* Goes on until somebody has a turn, the bus rests, or the time of this wake-up ends. */
static void virtual_run(engine *e)
{
    struct engine_virtual *v = e->virtual_time;
    v->more = false;
    while (!engine_is_held(e)) {
        if (v->unread)
            virtual_read_all(e);
        if (give_turn(e) || !virtual_go_on(e))
            return;
        if (engine_turn_is_over(e)) {
            v->more = true;
            return;
        }
    }
}

/* Brings a bus in virtual time up to where its programs let it go. */
static void wake(engine *e)
{
    engine_start_turn(e);
    if (e->stopping)
        engine_run_out(e, e->stop_tick);
    else
        virtual_run(e);
    engine_arm_timer(e);
}

/* A timer of the machine has no place in virtual time, but wake-ups may be too short. */
static void virtual_arm(engine *e)
{
    const struct engine_virtual *v = e->virtual_time;
    const bool soon = (v->more || e->stopping) && !e->stopped;
    if (!alarm_set(&e->alarm, soon ? clock_ns(CLOCK_MONOTONIC) : ALARM_NEVER))
        engine_fail(e, "timer", strerror(errno));
}

/* A port is readable. While somebody has a turn that waits. */
static void on_port(struct ev_loop *loop, ev_io *io, int events)
{
    const port_watch *w = (port_watch *)io;
    engine *e = w->engine;
    (void)loop;
    if (!engine_is_watched(e, events, "port"))
        return;
    e->virtual_time->unread = true;
    if (engine_is_held(e))
        engine_unwatch_port(e, (unsigned)(w - e->watches));
    else
        e->wake(e);
}

/* ---- Who holds time -------------------------------------------------------------------------- */

/* Returns the first program that has its turn, or whose process has not ended; NULL: none. */
static const turn *find_holder(const turns *t)
{
    for (unsigned i = 0; i < TURNS_MAX; i++)
        if (t->all[i].state == TURN_RUNS || t->all[i].state == TURN_ENDS)
            return &t->all[i];
    return NULL;
}

/* Tells why virtual time has stood still for some time. */
static void tell_why(const engine *e)
{
    const struct engine_virtual *v = e->virtual_time;
    const turn *holder = find_holder(v->turns);
    if (holder)
        log_info("virtual time holds for %u s: process %d computes, or waits for something else: "
                 "%s", HELD_LOOKS, holder->pid, holder->program);
    else if (!engine_is_held(e) && !v->more && v->turns->count > 0)
        log_info("virtual time rests: all %u programs wait, and the bus has nothing to do",
                 v->turns->count);
}

/* Tells, once, when time has stood still for some seconds of the machine. */
static void on_look(struct ev_loop *loop, ev_timer *timer, int events)
{
    engine *e = timer->data;
    struct engine_virtual *v = e->virtual_time;
    (void)loop;
    (void)events;
    v->same = v->begun && v->given == v->seen ? v->same + 1 : 0;
    v->seen = v->given;
    if (v->same == HELD_LOOKS)
        tell_why(e);
}

/* ---- Begin and end --------------------------------------------------------------------------- */

bool engine_open_virtual(engine *e)
{
    static const programs_calls calls = {.find_node = virtual_find_node, .changed = on_change};
    struct engine_virtual *v = calloc(1, sizeof *v);
    if (!v) {
        log_error("out of memory");
        return false;
    }
    e->virtual_time = v;
    v->programs = programs_open(e->loop, e->config->virtual_time.socket,
                                cfg_place_text(e->config, e->config->virtual_time.place).text,
                                &calls, e);
    if (!v->programs)
        return false;
    v->turns = programs_turns(v->programs);
    e->wake = wake;
    e->arm = virtual_arm;
    e->on_port = on_port;
    clock_begin_virtual(e->clock);
    return true;
}

void engine_begin_virtual(engine *e)
{
    struct engine_virtual *v = e->virtual_time;
    programs_begin(v->programs);
    ev_timer_init(&v->look, on_look, LOOK_S, LOOK_S);
    v->look.data = e;
    ev_timer_start(e->loop, &v->look);
}

/* Closes virtual time, and with it the connections of programs. */
void engine_close_virtual(engine *e)
{
    if (!e->virtual_time)
        return;
    ev_timer_stop(e->loop, &e->virtual_time->look);
    programs_close(e->virtual_time->programs);
    free(e->virtual_time);
    e->virtual_time = NULL;
}

/* Reports the programs in virtual time, and which of them it waits for. */
void engine_report_virtual(const engine *e, report *out)
{
    const struct engine_virtual *v = e->virtual_time;
    if (!v)
        return;
    out->virtual_time = (report_virtual){.on = true,
                                         .programs = v->turns->count,
                                         .begun = v->begun,
                                         .now_ns = (uint64_t)v->now_ns};
    for (unsigned i = 0; i < TURNS_MAX; i++)
        if (v->turns->all[i].state == TURN_RUNS)
            out->virtual_time.runs = v->turns->all[i].program;
    out->virtual_time.rests = !engine_is_held(e) && !v->more;
}
