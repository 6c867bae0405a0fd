/* SPDX-License-Identifier: MIT
 *
 * valid.c - whether a bus can be made by a configuration, and what is outside of its limits.
 */
#include "bus/bus_private.h"
#include "format/protect.h"

/* The frame of a mailbox must be one that it can send. */
static bool mailbox_valid(const cw_mailbox *box)
{
    const cw_filter *f = &box->filter;
    const bool one_id = !f->inverted && (f->mask == CW_FILTER_BASE_MASK ||
                                         f->mask == CW_FILTER_EXTENDED_MASK);
    const bool frame = !box->filled || (cw_frame_valid(&box->frame) &&
                                        !cw_frame_is_remote(&box->frame) &&
                                        cw_frame_matches(&box->frame, f, 1));
    return (unsigned)box->use < CW_MAILBOX_USES &&
           (box->use != CW_MAILBOX_REPLY || (one_id && frame));
}

/* All mailboxes must be valid, and so must the choice of the next one. */
static bool mailboxes_valid(const cw_host_config *h)
{
    if (h->mailbox_count > CW_MAILBOXES_MAX || (unsigned)h->transmit >= CW_TRANSMIT_COUNT)
        return false;
    for (unsigned i = 0; i < h->mailbox_count; i++)
        if (!mailbox_valid(&h->mailboxes[i]))
            return false;
    return true;
}

/* Local time has 16 to 32 bits, and a unit that the clock can count (L2). */
static bool local_time_valid(const cw_local_time *l)
{
    return l->bits == 0 ||
           (l->bits >= CW_LOCAL_BITS_MIN && l->bits <= CW_LOCAL_BITS_MAX &&
            l->unit >= CW_TICK / 2 && l->unit <= 2 * CW_LOCAL_UNIT_MAX && /* by an inexact clock */
            (uint64_t)l->start >> l->bits == 0);
}

/* Its numbers must fit into the local time of its node (L5). */
static bool trigger_valid(const cw_time_trigger *t, const cw_local_time *l)
{
    return t->slot >= 1 && ((uint64_t)t->at >> l->bits) == 0 &&
           ((uint64_t)t->slot >> l->bits) == 0 &&
           (t->repeat == 0 || t->cycle < t->repeat) && cw_frame_valid(&t->frame);
}

/* A schedule needs local time, and its triggers come in the order of cycle time. */
static bool schedule_valid(const cw_schedule *s, const cw_local_time *l)
{
    bool valid = s->cycles <= CW_CYCLES_MAX && s->trigger_count <= CW_TRIGGERS_MAX &&
                 (s->cycles == 0 || l->bits) && (s->cycles || s->trigger_count == 0);
    for (unsigned k = 0; valid && k < s->trigger_count; k++)
        valid = trigger_valid(&s->triggers[k], l) &&
                (k == 0 || s->triggers[k - 1].at <= s->triggers[k].at);
    return valid;
}

/* Looks at the values of a node by themselves; the timing is looked at elsewhere. */
static bool node_config_valid(const cw_node_config *c)
{
    return c->queue >= 1 && c->queue <= CW_QUEUE_MAX && c->queue_room <= CW_QUEUE_MAX &&
           c->warning_limit >= 1 && c->warning_limit <= 255 && cw_sleep_valid(&c->sleep) &&
           cw_protocol_valid(c->protocol) &&
           c->host.filter_count <= CW_NODE_FILTERS_MAX &&
           c->host.receive_buffers <= CW_RECEIVE_BUFFERS_MAX && mailboxes_valid(&c->host) &&
           local_time_valid(&c->local) && schedule_valid(&c->schedule, &c->local);
}

/* They are sorted by node and identifier, each one at most once. */
static bool protections_valid(const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->protection_count; i++) {
        const cw_protection *p = &c->protections[i];
        const cw_protection *before = i > 0 ? p - 1 : NULL;
        const bool sorted = !before || before->node < p->node ||
                            (before->node == p->node && before->id < p->id);
        if (!sorted || p->node >= c->node_count || !cw_protection_valid(p))
            return false;
    }
    return true;
}

static bool sizes_valid(const cw_bus_config *c)
{
    const bool none = c->bit_ticks == 0 || c->node_count == 0 || c->inbox == 0;
    return !none && c->node_count <= CW_NODES_MAX;
}

cw_bus_finding cw_bus_check(const cw_bus_config *c)
{
    cw_bus_finding found = {.limit = CW_LIMIT_BUS};
    if (!sizes_valid(c))
        return found;
    found = cw_check_timing(c);
    if (found.limit != CW_LIMIT_NONE)
        return found;
    if ((unsigned)c->rule_count + c->rule_room > CW_RULES_MAX)
        return (cw_bus_finding){.limit = CW_LIMIT_RULES};
    for (unsigned i = 0; i < c->node_count; i++)
        if (!node_config_valid(&c->nodes[i]))
            return (cw_bus_finding){.limit = CW_LIMIT_NODE, .node = (uint8_t)i};
    found.limit = protections_valid(c) ? CW_LIMIT_NONE : CW_LIMIT_PROTECTION;
    return found;
}

bool cw_bus_is_valid(const cw_bus_config *c)
{
    return cw_bus_check(c).limit == CW_LIMIT_NONE;
}
