/* SPDX-License-Identifier: MIT
 *
 * losses.c - what a run has lost: frames that were dropped or never sent, rules that never acted.
 */
#include "sim/losses.h"

#include "base/text/chars.h"
#include "base/text/counted.h"
#include "base/text/plain.h"
#include "config/doubts.h"

#include <inttypes.h>
#include <stdio.h>

#define RULES_TOLD 20u /* in lines */

void losses_forget(losses *all)
{
    all->count = 0;
    all->more = 0;
}

/* ---- Events ---------------------------------------------------------------------------------- */

/* Finds or adds the losses of a node for a reason; NULL: there are too many, so it is only
 * counted. */
static lost_frames *losses_find(losses *all, unsigned node, unsigned why)
{
    for (unsigned i = 0; i < all->count; i++)
        if (all->list[i].node == node && all->list[i].why == why)
            return &all->list[i];
    if (all->count == LOSSES_MAX)
        return NULL;
    all->list[all->count] = (lost_frames){.node = (uint8_t)node, .why = (uint8_t)why};
    return &all->list[all->count++];
}

/* Keeps the first different identifiers, with a mark for extended ones. */
static void note_id(lost_frames *l, const cw_frame *frame)
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
    lost_frames *l = losses_find(all, (unsigned)__builtin_ctzll(event->nodes), event->why);
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

/* Tells a loss with the name of its bus before its own. */
static void sim_losses_tell(const teller *t, const char *name, loss_words words)
{
    char full[LOSS_TEXT_MAX];
    (void)snprintf(full, sizeof full, "%s%s", t->before, name);
    words.name = full;
    t->tell(t->user, &words);
}

/* ---- Frames that were dropped ---------------------------------------------------------------- */

/* Prints the first identifiers: "111, 112, …". */
static void print_ids(char out[LOSS_TEXT_MAX], const lost_frames *l)
{
    size_t used = 0;
    for (unsigned i = 0; i < l->id_count; i++)
        used = chars_print(out, LOSS_TEXT_MAX, used, "%s%0*" PRIX32, i > 0 ? ", " : "",
                           l->ids[i] & CW_FILTER_EXTENDED ? 8 : 3,
                           l->ids[i] & ~CW_FILTER_EXTENDED);
    if (l->count > l->id_count)
        (void)chars_print(out, LOSS_TEXT_MAX, used, ", …");
}

/* Prints the keys that help where a queue is too short. */
static void print_queue(char out[LOSS_TEXT_MAX], const losses *all, unsigned i)
{
    const cfg_node *node = &all->config->nodes[i];
    uint64_t tick;
    unsigned most = 0;
    if (!all->of_row && node->traffic_count > node->queue)
        most = doubts_at_once(all->config, i, &tick);
    if (most > node->queue && most <= CW_QUEUE_MAX)
        (void)snprintf(out, LOSS_TEXT_MAX, "queue: %u or offsets", most);
    else
        (void)snprintf(out, LOSS_TEXT_MAX, "queue: more than %u, offsets or less traffic",
                       node->queue);
}

/* Returns the key that avoids such losses, "" where it is not known or set already. */
static const char *help_with(const cfg_node *node, unsigned why)
{
    static const char *const help[CW_DROP_COUNT] = {
        [CW_DROP_ONE_SHOT] = "one-shot: off repeats them",
        [CW_DROP_BUS_OFF] = "restart-ms: TIME brings the node back",
        [CW_DROP_LISTEN_ONLY] = "listen-only: off lets it send",
        [CW_DROP_BAD_FRAME] = "a node of another kind, or with other mailboxes, can send them",
        [CW_DROP_SLOT_MISSED] = "a wider window takes them",
    };
    const bool restarts = why == CW_DROP_BUS_OFF && node->restart_ms > 0;
    const bool by_window = why == CW_DROP_ONE_SHOT && !(node->modes & CW_MODE_ONE_SHOT);
    return help[why] && !restarts && !by_window ? help[why] : "";
}

/* Tells nodes in the order of their first losses, then the number of others. */
static void tell_dropped(const teller *t)
{
    const losses *all = t->all;
    for (unsigned i = 0; i < all->count; i++) {
        const lost_frames *l = &all->list[i];
        const cfg_node *node = &all->config->nodes[l->node];
        char ids[LOSS_TEXT_MAX];
        char queue[LOSS_TEXT_MAX];
        loss_words words = {.why = cw_drop_name((cw_drop)l->why), .frames = l->count, .ids = ids};
        print_ids(ids, l);
        print_queue(queue, all, l->node);
        words.help = l->why == CW_DROP_QUEUE_FULL ? queue : help_with(node, l->why);
        sim_losses_tell(t, node->name, words);
    }
    if (all->more > 0)
        sim_losses_tell(t, "other nodes, or for other reasons",
                        (loss_words){.why = "dropped", .frames = all->more, .ids = "", .help = ""});
}

/* ---- Frames that were never sent ------------------------------------------------------------- */

/* Returns why frames of a node still wait at the end of a run; NULL: they have just come, or will
 * go on. */
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

/* Tells of frames that wait at the end for a reason which does not go away. */
static void tell_waiting(const teller *t)
{
    const cfg *config = t->all->config;
    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats stats;
        if (cw_node_get_stats(t->bus, i, &stats) != CW_OK || stats.queue == 0)
            continue;
        const char *why = why_waiting(&config->nodes[i], &stats);
        if (why)
            sim_losses_tell(
                t, config->nodes[i].name,
                (loss_words){.why = "not sent", .frames = stats.queue, .ids = "", .help = why});
    }
}

/* ---- Rules that never acted ------------------------------------------------------------------ */

/* Returns true when a rule is there and had no match. */
static bool is_idle(const teller *t, unsigned rule)
{
    cw_rule_stats stats;
    return cw_rule_get_stats(t->bus, rule, &stats) == CW_OK && stats.matches == 0;
}

static bool has_acted(const teller *t, unsigned rule)
{
    cw_rule_stats stats;
    return cw_rule_get_stats(t->bus, rule, &stats) == CW_OK && stats.hits > 0;
}

/* Returns true when a rule waits for programs at ports that are not there. */
static bool waits_for_program(const losses *all, const cw_rule *rule)
{
    return !all->programs && doubts_only_ports(all->config, rule, all->fed);
}

/* Says more about a rule that had no match. */
static void print_reason(char out[LOSS_TEXT_MAX], const teller *t, const cw_rule *rule)
{
    const cfg *config = t->all->config;
    char begin[TIME_TEXT_MAX];
    out[0] = '\0';
    if (rule->has_after && rule->after < config->rule_count && !has_acted(t, rule->after)) {
        (void)snprintf(out, LOSS_TEXT_MAX, "never armed, since rule %s has not acted",
                       config->rules[rule->after].name);
    } else if (!t->all->programs && doubts_no_frame(config, rule, t->all->fed)) {
        (void)snprintf(out, LOSS_TEXT_MAX, "no node sends such a frame");
    } else if (waits_for_program(t->all, rule)) {
        (void)snprintf(out, LOSS_TEXT_MAX, "programs at ports are not there");
    } else if (rule->time_begin > cw_bus_now(t->bus)) {
        text_print_span(begin, rule->time_begin);
        (void)snprintf(out, LOSS_TEXT_MAX, "the run ended before %s", begin);
    }
}

/* A rule that waits for a hand waits for canwired. */
static void tell_rules(const teller *t)
{
    const cfg *config = t->all->config;
    for (unsigned i = 0; i < config->rule_count; i++) {
        char reason[LOSS_TEXT_MAX];
        const cw_rule *rule = &config->rules[i];
        if (!is_idle(t, i) || doubts_by_hand(config, rule) ||
            (t->all->of_row && waits_for_program(t->all, rule)))
            continue;
        print_reason(reason, t, rule);
        sim_losses_tell(
            t, rule->name,
            (loss_words){.is_rule = true, .why = "never matched", .ids = "", .help = reason});
    }
}

void losses_tell(const losses *all, const cw_bus *bus, const char *before, losses_teller *taker,
                 void *user)
{
    const teller t = {.all = all, .bus = bus, .before = before, .tell = taker, .user = user};
    if (!all->config)
        return;
    tell_dropped(&t);
    tell_waiting(&t);
    tell_rules(&t);
}

/* ---- Lines ----------------------------------------------------------------------------------- */

typedef struct printer {
    FILE *out;
    unsigned rules;
} printer;

/* Prints a loss as a line. Of many rules only the first ones are printed. */
static void print_words(void *user, const loss_words *w)
{
    printer *p = user;
    const char *more = w->help[0] ? ": " : "";
    p->rules += w->is_rule;
    if (w->is_rule && p->rules <= RULES_TOLD)
        plain_print(p->out, "rule %s: %s%s%s\n", w->name, w->why, more, w->help);
    else if (!w->is_rule && w->ids[0])
        plain_print(p->out, "dropped: %s: %s, %s (%s)%s%s\n", w->name,
                    counted(w->frames, "frame").text, w->why, w->ids, more, w->help);
    else if (!w->is_rule)
        plain_print(p->out, "%s: %s: %s%s%s\n", w->why, w->name,
                    counted(w->frames, "frame").text, more, w->help);
}

void losses_print(const losses *all, const cw_bus *bus, const char *before, FILE *out)
{
    printer p = {.out = out};
    losses_tell(all, bus, before, print_words, &p);
    if (p.rules > RULES_TOLD)
        fprintf(out, "%u more rules never matched\n", p.rules - RULES_TOLD);
}
