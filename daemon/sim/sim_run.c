/* SPDX-License-Identifier: MIT
 *
 * sim_run.c - a bus in virtual time: hands in releases, advances time, passes events and bits on.
 */
#include "sim/sim_run.h"

#include "base/least.h"
#include "base/text/plain.h"
#include "run/bus_make.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>

#define INBOX_FRAMES 1024
#define EVENT_RING 4096
#define SLICE_WORK 20000u /* of the bus between two looks at its events: some ms */
#define RELEASES_AHEAD 64u /* that the bus has before they are due; far less than its inbox holds */
#define CALM_BITS 3 /* shown after an event: its last effect is visible by then */
#define END_RECESSIVE_BITS 11 /* after the last frame */

/* ---- Set-up ---------------------------------------------------------------------------------- */

static void wipe(const sim_run *s)
{
    if (s->show.wipe)
        s->show.wipe(s->show.user);
}

/* Reports about replayed files. */
static void sim_run_report(void *user, bool failed, const char *text)
{
    sim_run *s = user;
    if (!s->messages)
        return;
    wipe(s);
    plain_print(s->messages, "%s%s\n", failed ? "" : SIM_NOTE, text);
}

/* Describes the bus for the library. A roomy one can take rules and longer queues later. */
static void sim_run_describe(cw_bus_config *out, cw_node_config nodes[CW_NODES_MAX],
                             const sim_run *s)
{
    cfg_bus_config(out, nodes, s->config);
    out->inbox = INBOX_FRAMES;
    out->events = EVENT_RING;
    out->keeps_setup = !s->roomy;
    if (!s->roomy)
        return;
    for (unsigned i = 0; i < out->node_count; i++)
        nodes[i].queue_room = CW_QUEUE_MAX; /* for settings; unused slots cost no memory */
    out->rule_room = (uint16_t)(CW_RULES_MAX - out->rule_count);
}

/* Ends what begins a bus that has its rules. */
static bool sim_run_complete(const sim_run *s)
{
    if (!s->bus)
        return false;
    release_add_replies(s->bus, s->config);
    bus_take_guests_off(s->bus, s->config);
    return true;
}

/* Makes the bus at time 0 in its memory, and its plan. */
static bool sim_run_make(sim_run *s, const cw_bus_config *bus_config)
{
    s->plan = release_plan_new(s->config, sim_run_report, s);
    s->bus = s->plan ? bus_init(s->memory, bus_config) : NULL;
    return sim_run_complete(s);
}

/* Takes memory for the bus, if what there is does not suffice. */
static bool reserve(sim_run *s, const cw_bus_config *bus_config)
{
    const size_t room = cw_bus_size(bus_config);
    if (s->memory && room <= s->room)
        return true;
    free(s->memory);
    s->memory = malloc(room ? room : 1);
    s->room = room;
    s->bus = NULL;
    return s->memory != NULL;
}

/* Makes the bus for the first time. False with errno. */
static bool open_run(sim_run *s)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    sim_run_describe(&bus_config, nodes, s);
    return reserve(s, &bus_config) && sim_run_make(s, &bus_config);
}

bool sim_open(sim_run *s, const cfg *config, FILE *messages)
{
    *s = (sim_run){
        .config = config, .until = CW_NEVER, .careful_from = CW_NEVER, .messages = messages};
    return open_run(s);
}

bool sim_open_roomy(sim_run *s, const cfg *config, FILE *messages)
{
    *s = (sim_run){.config = config,
                   .until = CW_NEVER,
                   .careful_from = CW_NEVER,
                   .messages = messages,
                   .roomy = true};
    return open_run(s);
}

/* Returns true when rules need no more room than any bus has: none makes a queue longer. */
static bool rules_need_no_room(const cfg *config)
{
    for (size_t i = 0; i < config->rule_count; i++) {
        const cw_rule *r = &config->rules[i];
        if (r->action == CW_ACTION_SET && (r->settings.which & CW_SET_QUEUE))
            return false;
    }
    return true;
}

/* Returns true when no rule needs what a bus that keeps its setup has no memory for. */
static bool rules_keep_setup(const cfg *config)
{
    bool keep = true;
    for (size_t i = 0; i < config->rule_count; i++)
        keep = keep && cw_rule_keeps_setup(&config->rules[i]);
    return keep;
}

/* Keeps the state of the bus, which has no rules yet. */
static void keep_start(sim_run *s)
{
    s->start = malloc(cw_bus_copy_size(s->bus));
    if (s->start)
        cw_bus_copy(s->bus, s->start);
}

/* Adds the rules of the configuration. False with EINVAL: the library refuses one. */
static bool add_rules(const sim_run *s)
{
    for (size_t i = 0; i < s->config->rule_count; i++) {
        unsigned index;
        if (cw_bus_add_rule(s->bus, &index, &s->config->rules[i]) == CW_OK)
            continue;
        errno = EINVAL;
        return false;
    }
    return true;
}

/* Makes the bus anew. Its state is kept before the rules come, if that is enough to begin again. */
static bool make_again(sim_run *s)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    sim_run_describe(&bus_config, nodes, s);
    if (!rules_need_no_room(s->config))
        return reserve(s, &bus_config) && sim_run_make(s, &bus_config);
    bus_config.rule_room = (uint16_t)(bus_config.rule_room + bus_config.rule_count);
    bus_config.rule_count = 0;
    bus_config.keeps_setup = bus_config.keeps_setup && rules_keep_setup(s->config);
    if (!reserve(s, &bus_config))
        return false;
    s->bus = bus_init(s->memory, &bus_config);
    if (s->bus)
        keep_start(s);
    s->plan = release_plan_new(s->config, sim_run_report, s);
    return s->bus && s->plan && add_rules(s) && sim_run_complete(s);
}

/* Begins again with the state that was kept. */
static bool begin_again(sim_run *s)
{
    cw_bus_begin_again(s->bus, s->start, s->config->seed);
    s->plan = release_plan_new(s->config, sim_run_report, s);
    return s->plan && add_rules(s) && sim_run_complete(s);
}

bool sim_restart(sim_run *s)
{
    release_plan_free(s->plan);
    s->last_activity = 0;
    s->last_rule = 0;
    s->stopped = false;
    s->watching = false;
    s->calm_bits = 0;
    s->plan = NULL;
    if (!(s->start ? begin_again(s) : make_again(s)))
        return false;
    if (s->syncs)
        cw_bus_set_sync_records(s->bus, s->syncs);
    return true;
}

bool sim_count_syncs(sim_run *s)
{
    s->syncs = malloc(s->config->node_count * sizeof *s->syncs);
    if (s->syncs)
        cw_bus_set_sync_records(s->bus, s->syncs);
    return s->syncs != NULL;
}

bool sim_open_bus(sim_run *s, const cfg *config, cw_bus *bus, FILE *messages)
{
    static const cfg no_traffic = {.node_count = 0};
    *s = (sim_run){.config = config,
                   .bus = bus,
                   .until = CW_NEVER,
                   .careful_from = CW_NEVER,
                   .messages = messages};
    s->plan = release_plan_new(&no_traffic, sim_run_report, s);
    return s->plan != NULL;
}

/* May be called for a run that could not be opened, and twice. */
void sim_close(sim_run *s)
{
    release_plan_free(s->plan);
    free(s->memory);
    free(s->start);
    free(s->syncs);
    s->plan = NULL;
    s->syncs = NULL;
    s->memory = NULL;
    s->start = NULL;
    s->bus = NULL;
}

void sim_add_sink(sim_run *s, const sim_sink *sink)
{
    assert(s->sink_count < SIM_SINKS_MAX);
    s->sinks[s->sink_count] = *sink;
    s->bit_sinks |= (uint32_t)(sink->bit != NULL) << s->sink_count;
    s->sinks[s->sink_count++].bits_from = cw_rate_bit_begin(s->config->rate, sink->bits_from);
}

void sim_be_careful(sim_run *s, uint64_t from)
{
    s->careful_from = from == CW_NEVER ? from : cw_rate_bit_begin(s->config->rate, from);
}

void sim_stop(sim_run *s, uint64_t tick)
{
    s->stopped = true;
    s->until = tick;
}

/* ---- The run --------------------------------------------------------------------------------- */

/* Events behind the end of the run are not shown: the bus may have gone further. */
static void sim_run_pass_on(sim_run *s, const cw_event *event)
{
    s->calm_bits = 0;
    if (event->tick > s->until)
        return;
    if (event->kind == CW_EVENT_TX)
        s->last_activity = event->tick;
    for (unsigned i = 0; i < s->sink_count; i++)
        if (s->sinks[i].event)
            s->sinks[i].event(s->sinks[i].user, event);
}

/* Takes all events that the bus has, in their order. */
static void pass_on_events(sim_run *s)
{
    cw_event_row events;
    while (events = cw_bus_peek(s->bus), events.count > 0) {
        for (unsigned i = 0; i < events.count; i++)
            sim_run_pass_on(s, cw_event_at(&events, i));
        cw_bus_take(s->bus, events.count);
    }
}

void sim_pass_on(sim_run *s, const cw_event *event)
{
    pass_on_events(s);
    if (event)
        sim_run_pass_on(s, event);
}

/* A run that is careful from a tick on is expected to end there. */
uint64_t sim_guess_end(const sim_run *s)
{
    const uint64_t now = cw_bus_now(s->bus);
    uint64_t known = s->careful_from > now ? least(s->until, s->careful_from) : s->until;
    return known != CW_NEVER ? known : release_guess_end(s->plan, now);
}

/* Advances in slices: events are passed on between them, and others can look. */
static void advance_bus(sim_run *s, uint64_t tick)
{
    cw_status status;
    do {
        status = cw_bus_advance_some(s->bus, tick, s->in_steps ? 1 : SLICE_WORK);
        pass_on_events(s);
        if (s->show.look)
            s->show.look(s->show.user, s);
    } while (status != CW_OK && !s->stopped && !s->paused);
}

/* Returns the start of the first bit from now on that a sink wants, or CW_NEVER. */
static uint64_t wanted_from(const sim_run *s, const sim_sink *sink)
{
    const uint64_t now = cw_bus_now(s->bus);
    uint64_t start = sink->bits_from > now ? sink->bits_from : now;
    bool over = sink->bits_to != 0 && start >= sink->bits_to;
    return over ? CW_NEVER : start;
}

/* Returns the same for all sinks. */
static uint64_t next_wanted(const sim_run *s)
{
    uint64_t start = CW_NEVER;
    for (uint32_t rest = s->bit_sinks; rest; rest &= rest - 1)
        start = least(start, wanted_from(s, &s->sinks[__builtin_ctz(rest)]));
    return start;
}

static void set_watching(sim_run *s, bool watching)
{
    if (watching != s->watching)
        cw_bus_set_watching(s->bus, watching);
    s->watching = watching;
}

/* Returns the tick up to which nothing visible changes, for sinks that want only changes. An event
 * is visible in its bit or in the next one, and no more in the one behind it. */
static uint64_t quiet_until(sim_run *s, uint64_t tick)
{
    const uint64_t now = cw_bus_now(s->bus);
    if (s->step || s->calm_bits < CALM_BITS)
        return now;
    for (uint32_t rest = s->bit_sinks; rest; rest &= rest - 1) {
        const sim_sink *sink = &s->sinks[__builtin_ctz(rest)];
        if (!sink->changes)
            return now;
        if (sink->bits_from > now)
            tick = least(tick, sink->bits_from);
        if (sink->bits_to > now) /* to the end of its last bit */
            tick = least(tick, sink->bits_to + cw_rate_ticks(s->config->rate, 1) - 1);
    }
    return cw_bus_quiet_until(s->bus, tick);
}

/* Returns true when the run must end now, whatever is pending. */
static bool sim_run_is_over(const sim_run *s)
{
    return s->stopped || s->paused || release_failed(s->plan);
}

/* Returns the sinks that want the bit that begins at a tick, which is now. */
static uint32_t sinks_of_bit(const sim_run *s, uint64_t start)
{
    uint32_t wanted = 0;
    for (uint32_t rest = s->bit_sinks; rest; rest &= rest - 1) {
        const unsigned i = (unsigned)__builtin_ctz(rest);
        const sim_sink *sink = &s->sinks[i];
        const bool wants = start >= sink->bits_from && (!sink->bits_to || start < sink->bits_to);
        wanted |= (uint32_t)wants << i;
    }
    return wanted;
}

/* Advances to the end of the next bit, which these sinks want. */
static void advance_bit(sim_run *s, uint64_t end, uint32_t wanted)
{
    advance_bus(s, end);
    for (; wanted; wanted &= wanted - 1) {
        const sim_sink *sink = &s->sinks[__builtin_ctz(wanted)];
        sink->bit(sink->user, s->bus);
    }
    s->calm_bits++;
}

/* Leaves bits to the bus in which sinks see nothing new. */
static void skip_quiet(sim_run *s, uint64_t tick)
{
    const uint64_t quiet = quiet_until(s, tick);
    if (quiet < cw_bus_tick_after(s->bus, 1))
        return;
    set_watching(s, false);
    advance_bus(s, quiet);
    set_watching(s, true);
}

/* Shows bits up to a tick, at least one, as long as a sink wants the next one. */
static void show_bits(sim_run *s, uint64_t tick)
{
    uint32_t wanted = sinks_of_bit(s, cw_bus_now(s->bus));
    uint64_t end = cw_bus_tick_after(s->bus, 1);
    do {
        advance_bit(s, end, wanted);
        skip_quiet(s, tick);
        wanted = sinks_of_bit(s, cw_bus_now(s->bus));
        end = cw_bus_tick_after(s->bus, 1);
    } while (end <= tick && wanted && !sim_run_is_over(s));
}

/* Returns the limit of one step: a replay at full speed must be asked for its next frame there. */
static uint64_t next_look(const sim_run *s)
{
    if (!release_is_fast(s->plan))
        return CW_NEVER;
    if (s->config->rule_count > 0)
        return cw_bus_tick_after(s->bus, 1);
    return release_look_at(s->plan, s->bus);
}

/* Advances to a tick. Bits that no sink wants are left to the bus, which may skip them. The last
 * ones before a wanted time go singly: where bits have several lengths none need begin just then.
 * Ends early when a replay at full speed may send. */
static void sim_run_advance(sim_run *s, uint64_t tick)
{
    bool there = false;
    while (!sim_run_is_over(s) && cw_bus_tick_after(s->bus, 1) <= tick) {
        uint64_t wanted = next_wanted(s);
        uint64_t look = next_look(s);
        uint64_t end = least(tick, least(look, s->careful_from));
        bool now = wanted == cw_bus_now(s->bus);
        if (now)
            wanted = quiet_until(s, end);
        else
            s->calm_bits = 0; /* the first wanted bit must be shown */
        end = least(end, wanted);
        now = end < cw_bus_tick_after(s->bus, 1);
        set_watching(s, now);
        there = !now && cw_bus_now(s->bus) < s->careful_from && end == tick;
        if (now || cw_bus_now(s->bus) >= s->careful_from)
            show_bits(s, look == CW_NEVER ? least(tick, s->careful_from) : 0);
        else
            advance_bus(s, end);
        if (look == CW_NEVER)
            continue;
        release_look(s->plan, s->bus);
        if (release_next_tick(s->plan) <= cw_bus_tick_after(s->bus, 1))
            return;
    }
    if (!sim_run_is_over(s) && !there)
        advance_bus(s, tick);
}

/* As long as one time is to come, later ones need not be known. */
uint64_t sim_last_activity(sim_run *s)
{
    const bool known = s->last_rule > cw_bus_now(s->bus);
    const uint64_t rules = known ? 0 : cw_bus_rules_until(s->bus);
    if (rules > s->last_rule)
        s->last_rule = rules;
    return s->last_rule > s->last_activity ? s->last_rule : s->last_activity;
}

/* Returns the end of the wait for activity in a run to the end of the traffic. */
static uint64_t quiet_end(sim_run *s)
{
    if (s->until != CW_NEVER)
        return CW_NEVER;
    return cw_after(sim_last_activity(s), (uint64_t)RELEASE_QUIET_S * CW_CLOCK_HZ);
}

/* Hands in all releases of one tick, which the bus has not reached yet, so that their events keep
 * their order within that tick. */
static void hand_in_due(sim_run *s, uint64_t tick)
{
    while (!sim_run_is_over(s) && release_next_tick(s->plan) == tick) {
        unsigned node;
        bool frame = release_first(s->plan, &node) != NULL;
        const cw_status status = release_hand_in(s->plan, s->bus);
        if (status == CW_FULL) /* to the end of the bit in which it leaves */
            sim_run_advance(s, cw_bus_inbox_first(s->bus) + cw_rate_ticks(s->config->rate, 1) - 1);
        else if (frame && status == CW_OK)
            s->last_activity = tick;
    }
}

/* Hands in releases up to a tick before they are due, and advances to the last of them. So the bus
 * goes over many frames at once. Whoever may end the run in between, or looks at its bits, has them
 * one by one. */
static void release_ahead(sim_run *s, uint64_t end)
{
    uint64_t last = 0;
    if (s->step || s->in_steps || s->bit_sinks || s->careful_from != CW_NEVER)
        return;
    for (unsigned i = 0; i < RELEASES_AHEAD && release_is_sure(s->plan); i++) {
        const uint64_t tick = release_next_tick(s->plan);
        if (tick > end || tick == CW_NEVER || release_hand_in(s->plan, s->bus) != CW_OK)
            break;
        last = s->last_activity = tick;
    }
    if (cw_bus_tick_after(s->bus, 1) < last)
        sim_run_advance(s, last - 1);
    s->last_activity = most(s->last_activity, last); /* frames may have been sent since */
}

/* Runs up to the last release; returns false when the run ends before. */
static bool run_releases(sim_run *s)
{
    release_look(s->plan, s->bus);
    while (release_ahead(s, least(s->until, quiet_end(s))), !sim_run_is_over(s)) {
        uint64_t tick = release_next_tick(s->plan);
        uint64_t bit_end = cw_bus_tick_after(s->bus, 1);
        bool fast = release_is_fast(s->plan);
        if (tick == CW_NEVER && !fast)
            return true;
        if ((fast ? least(tick, bit_end) : tick) > s->until)
            break;
        /* a tx on the way moves the end of the wait, which is computed again */
        uint64_t target = least(least(tick - 1, s->until), quiet_end(s));
        if (bit_end < tick && target < bit_end)
            return false;
        if (bit_end < tick)
            sim_run_advance(s, target);
        else if (tick > quiet_end(s))
            return false;
        else
            hand_in_due(s, tick);
    }
    return true;
}

/* Returns the frames that wait at nodes that sleep. */
static size_t pending_asleep(const sim_run *s)
{
    size_t count = 0;
    for (unsigned i = 0; i < s->config->node_count; i++) {
        cw_node_stats stats;
        if (cw_node_get_stats(s->bus, i, &stats) == CW_OK && stats.state == CW_STATE_SLEEPING)
            count += stats.queue;
    }
    return count;
}

/* Returns true when no frame will come. Frames of nodes that sleep wait until something wakes
 * them. */
static bool nothing_comes(const sim_run *s)
{
    const size_t pending = cw_bus_pending(s->bus);
    return pending == 0 || (cw_bus_next(s->bus) == CW_NEVER && pending == pending_asleep(s));
}

/* Returns the tick up to which the last rule that acts at its time shows what it does; 0: there is
 * none. */
static uint64_t end_of_rules(const sim_run *s)
{
    const cw_rate rate = s->config->rate;
    return s->last_rule ? cw_rate_next_bit(rate, s->last_rule) +
                              cw_rate_ticks(rate, END_RECESSIVE_BITS)
                        : 0;
}

/* A rule whose time is to come is work as a release is. */
static bool traffic_is_over(const sim_run *s)
{
    return nothing_comes(s) && cw_bus_recessive_bits(s->bus) >= END_RECESSIVE_BITS &&
           cw_bus_now(s->bus) >= end_of_rules(s) && cw_bus_rules_until(s->bus) == 0;
}

/* Returns how far the bus may go, at most to tick, before it must be asked again whether the
 * traffic is over. That takes so many recessive bits in a row; behind them it stays as it is while
 * the bus rests. Bits of a data rate are shorter than others. */
static uint64_t sure_until(const sim_run *s, uint64_t tick)
{
    const uint64_t recessive = cw_bus_recessive_bits(s->bus);
    const uint64_t now = cw_bus_now(s->bus);
    /* a rule may arm others: look again when it has acted */
    const uint64_t rules = s->last_rule > now ? s->last_rule : end_of_rules(s);
    if (s->step)
        return now;
    if (rules > now)
        tick = least(tick, rules);
    if (recessive >= END_RECESSIVE_BITS)
        return cw_bus_rests_until(s->bus, tick);
    const uint64_t bits = s->config->dbitrate_bps > 0 ? 1 : END_RECESSIVE_BITS - recessive;
    return least(cw_bus_tick_after(s->bus, bits), tick);
}

/* Looks at each bit that may be the last one: the run ends in exactly the documented bit. */
static void run_out(sim_run *s)
{
    while (!sim_run_is_over(s) && !traffic_is_over(s) && cw_bus_now(s->bus) < quiet_end(s)) {
        const uint64_t bit = cw_bus_tick_after(s->bus, 1);
        const uint64_t sure = sure_until(s, quiet_end(s) - 1);
        sim_run_advance(s, sure > bit ? sure : bit);
    }
}

/* In a data phase the bus is off the grid while it is stepped. There nodes with equal clocks end
 * their bits with it. */
bool sim_has_own_bits(const sim_run *s)
{
    const bool clocks = s->began_off_grid || s->config->dbitrate_bps == 0;
    return clocks && !cw_bus_is_on_grid(s->bus);
}

/* Ends a bit that has begun when it may have events up to the end. Frames may come in, and nodes
 * may end their own bits before. */
static void run_until(sim_run *s)
{
    sim_run_advance(s, s->until);
    if (!sim_run_is_over(s) && (cw_bus_inbox_first(s->bus) <= s->until || sim_has_own_bits(s)))
        sim_run_advance(s, s->until + cw_rate_ticks(s->config->rate, 1));
}

/* Returns the events that sinks want. Lost arbitrations cost most with many nodes, and few sinks
 * want them. */
static uint32_t wanted_events(const sim_run *s)
{
    uint32_t kinds = 1u << CW_EVENT_TX;
    for (unsigned i = 0; i < s->sink_count; i++)
        if (s->sinks[i].event)
            kinds |= s->sinks[i].kinds ? s->sinks[i].kinds : CW_EVENTS_USUAL;
    return kinds;
}

void sim_begin(sim_run *s)
{
    s->began_off_grid = !cw_bus_is_on_grid(s->bus);
    cw_bus_set_stepping(s->bus, s->step);
    cw_bus_set_events(s->bus, wanted_events(s));
}

void sim_set_kinds(sim_run *s, unsigned sink, uint32_t kinds)
{
    assert(sink < s->sink_count);
    s->sinks[sink].kinds = kinds;
    cw_bus_set_events(s->bus, wanted_events(s));
}

void sim_end(sim_run *s)
{
    wipe(s);
}

bool sim_advance(sim_run *s, uint64_t tick)
{
    if (tick > s->until)
        run_until(s);
    else
        sim_run_advance(s, tick);
    return tick <= s->until && !sim_run_is_over(s);
}

void sim_change(sim_run *s, const cfg *config, cw_bus *bus)
{
    s->config = config;
    s->bus = bus;
    cw_bus_set_events(bus, wanted_events(s));
}

bool sim_finish(sim_run *s)
{
    const bool goes_on = run_releases(s);
    if (goes_on)
        run_out(s);
    return goes_on;
}

/* Tells why a run has ended before its traffic. */
static void tell_end(const sim_run *s, bool released)
{
    unsigned node;
    char tick[TIME_TEXT_MAX];
    if (released) {
        plain_print(s->messages,
                    "canwire sim: ended after %u s of bus time without a frame, while frames wait "
                    "(--until TIME waits longer)\n",
                    RELEASE_QUIET_S);
        return;
    }
    plain_print(s->messages,
                "canwire sim: ended before the last release, after %u s of bus time without a "
                "frame", RELEASE_QUIET_S);
    if (release_next_tick(s->plan) != CW_NEVER) {
        (void)release_first(s->plan, &node);
        text_print_span(tick, release_next_tick(s->plan));
        plain_print(s->messages, "; the next one, of %s, comes at %s",
                    s->config->nodes[node].name, tick);
    }
    plain_print(s->messages, " (--until TIME waits longer)\n");
}

bool sim_go(sim_run *s)
{
    sim_begin(s);
    const bool released = run_releases(s);
    if (s->until != CW_NEVER)
        run_until(s);
    else if (released)
        run_out(s);
    sim_end(s);
    if (s->messages && s->until == CW_NEVER && !sim_run_is_over(s) &&
        !(released && traffic_is_over(s)))
        tell_end(s, released);
    return !release_failed(s->plan);
}

/* ---- Runs of several buses ------------------------------------------------------------------- */

void sim_go_in_steps(sim_run *s, bool steps)
{
    s->in_steps = steps;
    s->paused = false;
}

void sim_pause(sim_run *s)
{
    s->paused = s->in_steps;
}

/* Advances to a tick with the releases before a limit: that tick, or the one behind it. */
static void release_before(sim_run *s, uint64_t limit, uint64_t end)
{
    s->paused = false;
    release_look(s->plan, s->bus);
    while (release_ahead(s, limit > 0 ? limit - 1 : 0), !sim_run_is_over(s)) {
        const uint64_t tick = release_next_tick(s->plan);
        const uint64_t bit_end = cw_bus_tick_after(s->bus, 1);
        if (tick < limit && tick <= bit_end)
            hand_in_due(s, tick);
        else if (bit_end <= end)
            sim_run_advance(s, tick < limit ? tick - 1 : end);
        else
            break;
    }
}

void sim_release_to(sim_run *s, uint64_t end)
{
    release_before(s, cw_after(end, 1), end);
}

void sim_release_before(sim_run *s, uint64_t end)
{
    release_before(s, end, end);
}

void sim_do_due(sim_run *s, uint64_t tick)
{
    if (!sim_run_is_over(s) && cw_bus_tick_after(s->bus, 1) > tick)
        advance_bus(s, tick);
}

bool sim_owes_events(const sim_run *s, uint64_t tick)
{
    return !sim_run_is_over(s) && cw_bus_now(s->bus) < tick &&
           (cw_bus_inbox_first(s->bus) <= tick || sim_has_own_bits(s));
}

static bool releases_are_over(const sim_run *s)
{
    return release_next_tick(s->plan) == CW_NEVER && !release_is_fast(s->plan);
}

bool sim_traffic_is_over(const sim_run *s)
{
    return releases_are_over(s) && traffic_is_over(s);
}

uint64_t sim_rests_until(const sim_run *s, uint64_t tick)
{
    const bool behind = cw_bus_recessive_bits(s->bus) >= END_RECESSIVE_BITS;
    return behind && releases_are_over(s) ? sure_until(s, tick) : cw_bus_now(s->bus);
}
