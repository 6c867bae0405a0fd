/* SPDX-License-Identifier: MIT
 *
 * run.c - lets time go on, up to a time, a frame or an event.
 */
#include "embed/embed.h"

#include "base/least.h"
#include "base/text/number.h"

#include <assert.h>
#include <string.h>

#define SLICE_TICKS (CW_CLOCK_HZ / 100u) /* of a rig, whose gateways keep frames meanwhile */

/* ---- Awaited events -------------------------------------------------------------------------- */

/* Returns what the awaited event is at a bus: all but the name of the bus. NULL: it is one of
 * another bus. */
static const char *event_at(const canwire_sim *sim, const embed_bus *b, const char *text)
{
    for (size_t i = 0; sim->rig && i < sim->count; i++) {
        const char *name = sim->buses[i].config->bus_name;
        const size_t length = strlen(name);
        if (strncmp(text, name, length) == 0 && text[length] == ':')
            return i == b->index ? text + length + 1 : NULL;
    }
    return text;
}

static void forget_told(canwire_sim *sim)
{
    (void)fflush(sim->told.out);
    (void)fseeko(sim->told.out, 0, SEEK_SET);
}

/* Notes what runs have told as the error. */
static int fail_told(canwire_sim *sim, int status)
{
    const char *text = memo_text(&sim->told);
    size_t size = text ? sim->told.size : 0;
    while (size > 0 && text[size - 1] == '\n')
        size--;
    return embed_fail(sim, status, "%.*s", (int)size, text);
}

/* Awaits an event at all buses that know its words. Returns false after noting an error. */
static bool run_await(canwire_sim *sim, const char *text)
{
    bool any = false;
    sim->awaits_any = strcmp(text, "any") == 0;
    for (size_t i = 0; i < sim->count; i++) {
        embed_bus *b = &sim->buses[i];
        const char *here = !sim->awaits_any ? event_at(sim, b, text) : NULL;
        if (here && sim_until_read(&b->awaited, here, &b->run, ""))
            any = true;
        else
            b->awaited = (sim_until){.text = NULL};
        embed_choose_events(b);
    }
    if (any || sim->awaits_any)
        return true;
    (void)fail_told(sim, CANWIRE_SIM_INVALID);
    return false;
}

/* Other calls may pass on events. */
static void await_nothing(canwire_sim *sim)
{
    sim->awaits_any = false;
    for (size_t i = 0; i < sim->count; i++) {
        sim->buses[i].awaited = (sim_until){.text = NULL};
        embed_choose_events(&sim->buses[i]);
    }
}

/* ---- Conditions ------------------------------------------------------------------------------ */

/* The nodes of a bus that a number names: one, all, or none. */
typedef struct nodes_at {
    const embed_node *first;
    size_t count;
} nodes_at;

/* A number without a node on this bus names none: it may be one of another bus. */
static nodes_at find_nodes(const embed_bus *b, int at)
{
    if (at == CANWIRE_SIM_ANY_NODE)
        return (nodes_at){.first = b->nodes, .count = b->config->node_count};
    const int n = at - b->first_node;
    const bool here = n >= 0 && (size_t)n < b->config->node_count;
    return here ? (nodes_at){.first = &b->nodes[n], .count = 1} : (nodes_at){.count = 0};
}

/* Returns the tick of the first frame that is kept for a node, or for any; CW_NEVER without one. It
 * may be after `reached`, when a bit had to end after that. */
static uint64_t first_frame(const canwire_sim *sim, int at)
{
    uint64_t first = CW_NEVER;
    for (size_t i = 0; i < sim->count; i++) {
        const nodes_at nodes = find_nodes(&sim->buses[i], at);
        for (const embed_node *n = nodes.first; n < nodes.first + nodes.count; n++)
            if (n->listens && n->count > 0)
                first = least(first, n->frames[n->first].tick);
    }
    return first;
}

/* Returns true when the program gets more than what a node receives, or any does. sim_group_next()
 * does not know when that comes. */
static bool hears_more(const canwire_sim *sim, int at)
{
    unsigned listens = 0;
    for (size_t i = 0; i < sim->count; i++) {
        const nodes_at nodes = find_nodes(&sim->buses[i], at);
        for (const embed_node *n = nodes.first; n < nodes.first + nodes.count; n++)
            listens |= n->listens;
    }
    return listens & ~(unsigned)CANWIRE_SIM_LISTEN_RX;
}

/* Returns a tick before which nothing can happen on a bus that rests; now otherwise. */
static uint64_t rests_until(const embed_bus *b)
{
    const cw_bus *bus = b->run.bus;
    const uint64_t now = cw_bus_now(bus);
    if (b->config->rule_count > 0 || b->config->reply_count > 0 || !cw_bus_idle(bus) ||
        cw_bus_pending(bus) > 0 || !cw_bus_is_on_grid(bus) || cw_bus_recessive_bits(bus) < 11 ||
        release_is_fast(b->run.plan))
        return now;
    return least(cw_bus_next(bus), release_next_tick(b->run.plan));
}

/* Lets a bus pause at an event. Returns false where it cannot: several buses, and nodes with bits
 * of their own, have events at several ticks in a step. A run to the end looks at each bit. */
static bool pauses(canwire_sim *sim, uint64_t until)
{
    sim_run *run = &sim->buses[0].run;
    const bool pauses = sim->count == 1 && cw_bus_is_on_grid(run->bus) && until != CW_NEVER;
    sim_go_in_steps(run, pauses);
    return pauses;
}

/* Returns the tick to which time goes next. Buses that cannot pause at an event, and do not rest,
 * go bit by bit before it. So do all where only the end of the traffic is to come. */
static uint64_t next_step(canwire_sim *sim, uint64_t until, bool awaits)
{
    const bool singly = awaits && !pauses(sim, until);
    const uint64_t bit = sim_group_bit(&sim->group);
    uint64_t next = sim_group_next(&sim->group);
    for (size_t i = 0; singly && i < sim->count; i++)
        next = least(next, rests_until(&sim->buses[i]));
    if (next == CW_NEVER)
        return until == CW_NEVER ? bit : until;
    return next > bit ? next : bit;
}

int64_t canwire_sim_next(const canwire_sim *sim)
{
    const uint64_t next = sim_group_next(&sim->group);
    const uint64_t ns = text_ticks_ns(next);
    return next == CW_NEVER || ns > CANWIRE_SIM_NEVER ? CANWIRE_SIM_NEVER : (int64_t)ns;
}

/* ---- Runs ------------------------------------------------------------------------------------ */

/* Returns why a call has ended. Want of memory stays: what follows it would not be what
 * happened. */
static int outcome(canwire_sim *sim, int stop)
{
    if (sim->no_memory || sim->group.no_memory) {
        sim->no_memory = true;
        return embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "out of memory");
    }
    return sim_group_failed(&sim->group) ? fail_told(sim, CANWIRE_SIM_FAILED) : stop;
}

static void reach(canwire_sim *sim, uint64_t tick)
{
    sim->reached = tick > sim->reached ? tick : sim->reached;
}

/* Goes on to a tick, in slices in which others have time to look. */
static int go_to(canwire_sim *sim, uint64_t tick)
{
    const uint64_t before = cw_bus_now(sim->buses[0].run.bus);
    while (sim->rig && sim_group_now(&sim->group) + SLICE_TICKS < tick && !sim->no_memory &&
           !sim_group_failed(&sim->group))
        sim_group_go_to(&sim->group, sim_group_now(&sim->group) + SLICE_TICKS);
    sim_group_go_to(&sim->group, tick);
    const bool paused = sim->buses[0].run.paused;
    if (!paused && cw_bus_now(sim->buses[0].run.bus) == before) /* a bit does it before it begins */
        sim_group_do_due(&sim->group, tick);
    if (!paused)
        sim_group_settle(&sim->group, tick);
    reach(sim, paused ? sim_group_now(&sim->group) : tick);
    return outcome(sim, CANWIRE_SIM_AT_TIME);
}

/* Goes on to the end of the traffic. */
static int run_finish(canwire_sim *sim)
{
    if (sim->rig)
        sim_group_simulate(&sim->group);
    else
        (void)sim_finish(&sim->buses[0].run);
    reach(sim, sim_group_now(&sim->group));
    return outcome(sim, CANWIRE_SIM_AT_END);
}

/* Goes one step on, at most to a tick. */
static int run_step(canwire_sim *sim, uint64_t until, uint64_t next)
{
    if (next >= until)
        return go_to(sim, until);
    sim_group_go_to(&sim->group, next);
    reach(sim, sim_group_known(&sim->group, next));
    return outcome(sim, CANWIRE_SIM_OK);
}

/* Goes on in steps, with a look after each of them. */
static int embed_run_watch(canwire_sim *sim, uint64_t until, bool awaits, int frame_at)
{
    int status = CANWIRE_SIM_OK;
    while (status >= 0) {
        const uint64_t frame = first_frame(sim, frame_at);
        if (sim->happened) {
            reach(sim, sim_group_now(&sim->group)); /* the bit of the event may end later */
            return CANWIRE_SIM_AT_EVENT;
        }
        if (frame <= sim->reached)
            return CANWIRE_SIM_AT_FRAME;
        if (sim->reached >= until)
            return CANWIRE_SIM_AT_TIME;
        if (until == CW_NEVER && sim_group_is_over(&sim->group))
            return CANWIRE_SIM_AT_END;
        const bool there = frame <= sim_group_now(&sim->group); /* the buses have gone that far */
        status = run_step(sim, until, there ? frame : next_step(sim, until, awaits));
    }
    return status;
}

/* Returns false after noting that the traffic never ends. */
static bool ends(canwire_sim *sim)
{
    for (size_t i = 0; i < sim->count; i++) {
        cfg_unending found;
        if (!cfg_find_unending(sim->buses[i].config, &found))
            continue;
        (void)embed_fail(sim, CANWIRE_SIM_INVALID,
                         "%s:%d:%d: this never ends: give a time up to which to run",
                         found.file, found.place.line, found.place.column);
        return false;
    }
    return true;
}

int canwire_sim_offer(canwire_sim *sim, int node, const canwire_sim_frame *frame, int64_t at)
{
    int status = CANWIRE_SIM_OK;
    if (embed_tick_until(at) > sim->reached)
        status = canwire_sim_run(sim, at, NULL, CANWIRE_SIM_NO_NODE);
    if (status < 0)
        return status;
    if (canwire_sim_room(sim, node) == 0)
        return 0;
    status = canwire_sim_send(sim, node, frame, at);
    return status == CANWIRE_SIM_OK ? 1 : status;
}

/* Returns the time at which a wait is over. */
static int64_t end_of_wait(const canwire_sim *sim, int64_t until, int64_t span)
{
    const int64_t now = canwire_sim_now(sim);
    const int64_t end = span < CANWIRE_SIM_NEVER - now ? now + span : CANWIRE_SIM_NEVER;
    return end < until ? end : until;
}

int canwire_sim_wait(canwire_sim *sim, int node, int64_t until, int64_t span,
                      canwire_sim_waited *out)
{
    int status = canwire_sim_run(sim, end_of_wait(sim, until, span), NULL, node);
    if (status >= 0)
        status = canwire_sim_receive(sim, node, &out->frame);
    out->now = canwire_sim_now(sim);
    if (status == 0)
        out->next = canwire_sim_next(sim);
    return status;
}

int canwire_sim_run(canwire_sim *sim, int64_t until, const char *event, int frame_at)
{
    const uint64_t tick = until == CANWIRE_SIM_NEVER ? CW_NEVER : embed_tick_until(until);
    int status;
    if (sim->no_memory)
        return embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "out of memory");
    forget_told(sim);
    if ((tick == CW_NEVER && !ends(sim)) || (event && !run_await(sim, event)))
        return CANWIRE_SIM_INVALID;
    sim->happened = false;
    sim->frame_at = frame_at;
    if (event || frame_at != CANWIRE_SIM_NO_NODE)
        status = embed_run_watch(sim, tick, event || hears_more(sim, frame_at), frame_at);
    else if (tick == CW_NEVER)
        status = run_finish(sim);
    else
        status = tick >= sim->reached ? go_to(sim, tick) : outcome(sim, CANWIRE_SIM_AT_TIME);
    sim_go_in_steps(&sim->buses[0].run, false);
    if (event)
        await_nothing(sim);
    return status;
}
