/* SPDX-License-Identifier: MIT
 *
 * losses.c - what a run has lost: frames that were dropped or never sent, rules that never acted.
 */
#include "sim/losses.h"

#include "base/plain.h"
#include "config/doubts.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

#define RULES_TOLD 20u

void losses_forget(losses *all)
{
    all->count = 0;
    all->more = 0;
}

/* ---- Events ---------------------------------------------------------------------------------- */

static loss *find(losses *all, unsigned node, unsigned why)
{
    for (unsigned i = 0; i < all->count; i++)
        if (all->list[i].node == node && all->list[i].why == why)
            return &all->list[i];
    if (all->count == LOSSES_MAX)
        return NULL;
    all->list[all->count] = (loss){.node = (uint8_t)node, .why = (uint8_t)why};
    return &all->list[all->count++];
}

static void note_id(loss *l, const cw_frame *frame)
{
    const uint32_t id = frame->id | (frame->flags & CW_FRAME_EXTENDED ? CW_FILTER_EXTENDED : 0);
    bool known = l->id_count == LOSS_IDS;
    for (unsigned i = 0; i < l->id_count; i++)
        known = known || l->ids[i] == id;
    if (!known)
        l->ids[l->id_count++] = id;
}

void losses_event(losses *all, const cw_event *event)
{
    if (event->kind != CW_EVENT_DROP || event->why == CW_DROP_FAULT || event->nodes == 0)
        return;
    loss *l = find(all, (unsigned)__builtin_ctzll(event->nodes), event->why);
    if (!l) {
        all->more++;
        return;
    }
    l->count++;
    note_id(l, &event->frame);
}

/* ---- Telling --------------------------------------------------------------------------------- */

typedef struct teller {
    const losses *all;
    const cw_bus *bus;
    const char *before;
    losses_teller *tell;
    void *user;
} teller;

static void tell(const teller *t, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void tell(const teller *t, const char *format, ...)
{
    char line[LOSS_TEXT_MAX];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    t->tell(t->user, line);
}

static const char *plural(uint64_t count)
{
    return count == 1 ? "" : "s";
}

/* Prints the first identifiers: "111, 112, …". */
static void print_ids(char out[LOSS_TEXT_MAX], const loss *l)
{
    int length = 0;
    for (unsigned i = 0; i < l->id_count; i++)
        length += snprintf(out + length, (size_t)(LOSS_TEXT_MAX - length), "%s%0*" PRIX32,
                           i > 0 ? ", " : "", l->ids[i] & CW_FILTER_EXTENDED ? 8 : 3,
                           l->ids[i] & ~CW_FILTER_EXTENDED);
    if (l->count > l->id_count)
        (void)snprintf(out + length, (size_t)(LOSS_TEXT_MAX - length), ", …");
}

/* Prints what helps, after ": "; or nothing. */
static void print_remedy(char out[LOSS_TEXT_MAX], const cfg *config, const loss *l)
{
    static const char *const remedies[CW_DROP_COUNT] = {
        [CW_DROP_ONE_SHOT] = ": one-shot: off repeats them",
        [CW_DROP_BUS_OFF] = ": restart-ms: TIME brings the node back",
        [CW_DROP_LISTEN_ONLY] = ": listen-only: off lets it send",
        [CW_DROP_BAD_FRAME] = ": a node of another kind, or with other mailboxes, can send them",
        [CW_DROP_SLOT_MISSED] = ": a wider window takes them",
    };
    const cfg_node *node = &config->nodes[l->node];
    uint64_t tick;
    out[0] = '\0';
    if (l->why == CW_DROP_QUEUE_FULL) {
        const unsigned most = doubts_at_once(config, l->node, &tick);
        if (most > node->queue && most <= CW_QUEUE_MAX)
            (void)snprintf(out, LOSS_TEXT_MAX, ": queue: %u or offsets", most);
        else
            (void)snprintf(out, LOSS_TEXT_MAX, ": queue: more than %u, or less traffic",
                           node->queue);
    } else if (remedies[l->why] && !(l->why == CW_DROP_BUS_OFF && node->restart_ms > 0)) {
        (void)snprintf(out, LOSS_TEXT_MAX, "%s", remedies[l->why]);
    }
}

static void tell_dropped(const teller *t)
{
    for (unsigned i = 0; i < t->all->count; i++) {
        const loss *l = &t->all->list[i];
        char ids[LOSS_TEXT_MAX];
        char remedy[LOSS_TEXT_MAX];
        print_ids(ids, l);
        print_remedy(remedy, t->all->config, l);
        tell(t, "dropped: %s%s: %" PRIu64 " frame%s, %s (%s)%s", t->before,
             t->all->config->nodes[l->node].name, l->count, plural(l->count),
             cw_drop_name((cw_drop)l->why), ids, remedy);
    }
    if (t->all->more > 0)
        tell(t, "dropped: %" PRIu64 " more frame%s, of other nodes or for other reasons",
             t->all->more, plural(t->all->more));
}

/* ---- Frames that were never sent ------------------------------------------------------------- */

/* Returns why frames of a node still wait at the end of a run; NULL: they have just come, or will go
 * on. */
static const char *why_waiting(const cfg_node *node, const cw_node_stats *stats)
{
    if (stats->state == CW_STATE_BUS_OFF)
        return node->restart_ms ? NULL : "it is bus-off, and comes back with restart-ms: TIME";
    if (stats->state == CW_STATE_SLEEPING)
        return "it sleeps";
    if (stats->tx_frames == 0 && stats->errors[CW_ERROR_ACK] > 0)
        return "no other node acknowledges";
    return NULL;
}

static void tell_waiting(const teller *t)
{
    const cfg *config = t->all->config;
    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats stats;
        if (cw_node_get_stats(t->bus, i, &stats) != CW_OK || stats.queue == 0)
            continue;
        const char *why = why_waiting(&config->nodes[i], &stats);
        if (why)
            tell(t, "not sent: %s%s: %" PRIu32 " frame%s: %s", t->before, config->nodes[i].name,
                 stats.queue, plural(stats.queue), why);
    }
}

/* ---- Rules that never acted ------------------------------------------------------------------ */

static cw_rule_stats stats_of(const teller *t, unsigned rule)
{
    cw_rule_stats stats = {.matches = 0};
    (void)cw_rule_get_stats(t->bus, rule, &stats);
    return stats;
}

/* Tells about a rule that had no match. One that waits for a hand waits for canwired. */
static void tell_rule(const teller *t, unsigned i)
{
    const cfg *config = t->all->config;
    const cw_rule *rule = &config->rules[i];
    const bool unarmed = rule->has_after && rule->after < config->rule_count &&
                         stats_of(t, rule->after).hits == 0;
    char begin[TIME_TEXT_MAX];
    if (unarmed) {
        tell(t, "rule %s%s: never matched: never armed, since rule %s has not acted", t->before,
             rule->name, config->rules[rule->after].name);
    } else if (doubts_no_frame(config, rule, t->all->fed)) {
        tell(t, "rule %s%s: never matched: no node sends such a frame", t->before, rule->name);
    } else if (rule->time_begin > cw_bus_now(t->bus)) {
        text_print_span(begin, rule->time_begin);
        tell(t, "rule %s%s: never matched: the run ended before %s", t->before, rule->name, begin);
    } else {
        tell(t, "rule %s%s: never matched", t->before, rule->name);
    }
}

static void tell_rules(const teller *t)
{
    const cfg *config = t->all->config;
    unsigned count = 0;
    for (unsigned i = 0; i < config->rule_count; i++) {
        if (stats_of(t, i).matches > 0 || doubts_by_hand(config, &config->rules[i]))
            continue;
        if (count++ < RULES_TOLD)
            tell_rule(t, i);
    }
    if (count > RULES_TOLD)
        tell(t, "%u more rules never matched", count - RULES_TOLD);
}

void losses_tell(const losses *all, const cw_bus *bus, const char *before, losses_teller *teller_fn,
                 void *user)
{
    const teller t = {
        .all = all, .bus = bus, .before = before, .tell = teller_fn, .user = user};
    tell_dropped(&t);
    tell_waiting(&t);
    tell_rules(&t);
}

static void print_line(void *user, const char *line)
{
    plain_print(user, "%s\n", line);
}

void losses_print(const losses *all, const cw_bus *bus, const char *before, FILE *out)
{
    losses_tell(all, bus, before, print_line, out);
}
