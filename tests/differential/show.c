/* SPDX-License-Identifier: MIT
 *
 * show.c - events and scenarios as text: the latter as calls of the library, for a unit test.
 */
#include "differential.h"

#include <inttypes.h>
#include <string.h>

/* ---- Events ---------------------------------------------------------------------------------- */

static void write_frame_short(FILE *out, const cw_frame *f)
{
    fprintf(out, f->flags & CW_FRAME_EXTENDED ? " %08" PRIX32 "#" : " %03" PRIX32 "#", f->id);
    if (f->flags & CW_FRAME_REMOTE)
        fprintf(out, "R%u", f->dlc);
    for (unsigned i = 0; i < cw_frame_length(f); i++)
        fprintf(out, "%02X", f->data[i]);
}

static void write_error(FILE *out, const cw_event *e)
{
    const cw_place *p = &e->error.place;
    fprintf(out, " %s %s %s[%u]%s%s flag %s", e->error.role == CW_ROLE_TRANSMITTER ? "tx" : "rx",
            cw_error_type_name(e->error.type), cw_field_name(p->field), p->index,
            p->stuff ? " stuff" : "", p->extended ? " extended" : "", cw_flag_name(e->error.flag));
}

void diff_write_event(FILE *out, const cw_event *e)
{
    fprintf(out, "  tick %" PRIu64 " nodes %" PRIx64 " %s tec %u rec %u", e->tick, e->nodes,
            cw_event_name(e->kind), e->tec, e->rec);
    if (e->kind == CW_EVENT_FAULT)
        fprintf(out, " rule %u hit %" PRIu32, e->rule, e->hit);
    if (e->kind == CW_EVENT_ERROR || e->kind == CW_EVENT_TOLERATED)
        write_error(out, e);
    if (e->kind == CW_EVENT_STATE)
        fprintf(out, " %s to %s", cw_state_name(e->state_before), cw_state_name(e->state));
    if (e->kind == CW_EVENT_DROP)
        fprintf(out, " %s", cw_drop_name(e->why));
    if (e->kind == CW_EVENT_WAKE)
        fprintf(out, " %s", cw_wake_name(e->why));
    if (e->kind == CW_EVENT_ARBITRATION_LOST)
        fprintf(out, " bit %u", e->lost_bit);
    if (e->kind == CW_EVENT_DROP || e->kind == CW_EVENT_ARBITRATION_LOST ||
        e->kind == CW_EVENT_RX || e->kind == CW_EVENT_TX)
        write_frame_short(out, &e->frame);
    if (e->kind == CW_EVENT_RX || e->kind == CW_EVENT_TX)
        fprintf(out, " from %" PRIx64 " handed in %" PRIu64, e->from, e->handed_in);
    if (e->kind == CW_EVENT_ERROR)
        fprintf(out, " of %" PRIx32 " from %" PRIx64, e->can_id, e->from);
    if (e->kind == CW_EVENT_LINK)
        fputs(e->up ? " up" : " down", out);
    fputc('\n', out);
}

/* ---- Initialisers: what is zero is left out -------------------------------------------------- */

static void write_number(FILE *out, const char *name, uint64_t value)
{
    if (value == UINT64_MAX)
        fprintf(out, ".%s = UINT64_MAX, ", name);
    else if (value > UINT32_MAX)
        fprintf(out, ".%s = UINT64_C(%" PRIu64 "), ", name, value);
    else if (value)
        fprintf(out, ".%s = %" PRIu64 ", ", name, value);
}

static void write_mask(FILE *out, const char *name, uint64_t value)
{
    if (value)
        fprintf(out, ".%s = UINT64_C(0x%" PRIX64 "), ", name, value);
}

static void write_bytes(FILE *out, const char *name, const uint8_t *bytes, unsigned length)
{
    while (length > 0 && bytes[length - 1] == 0)
        length--;
    if (length == 0)
        return;
    fprintf(out, ".%s = {", name);
    for (unsigned i = 0; i < length; i++)
        fprintf(out, "%s0x%02X", i ? ", " : "", bytes[i]);
    fputs("}, ", out);
}

static void write_frame(FILE *out, const cw_frame *f)
{
    fprintf(out, ".id = 0x%" PRIX32 ", ", f->id);
    if (f->flags)
        fprintf(out, ".flags = 0x%X, ", f->flags);
    write_number(out, "dlc", f->dlc);
    write_bytes(out, "data", f->data, cw_frame_length(f));
}

/* The frames are the first ones of diff_filters. */
static void write_sleep(FILE *out, const cw_sleep_settings *s)
{
    fprintf(out, ".sleep = {%" PRIu64 ", %" PRIu64 ", %u}, ", s->filter_ticks, s->wake_ticks,
            s->frame_count);
}

static void write_settings(FILE *out, const cw_settings *s)
{
    fprintf(out, ".which = 0x%X, ", s->which);
    if (s->which & CW_SET_MODES)
        fprintf(out, ".modes_mask = 0x%X, .modes = 0x%X, ", s->modes_mask, s->modes);
    if (s->which & CW_SET_RESTART)
        write_number(out, "restart_ticks", s->restart_ticks);
    if (s->which & CW_SET_QUEUE)
        write_number(out, "queue", s->queue);
    if (s->which & CW_SET_ORDER)
        write_number(out, "order", s->order);
    if (s->which & CW_SET_WARNING)
        write_number(out, "warning_limit", s->warning_limit);
    if (s->which & CW_SET_SLEEP)
        write_number(out, "sleeps", s->sleeps);
    if (s->which & CW_SET_WAKE)
        write_sleep(out, &s->sleep);
}

static void write_change(FILE *out, const cw_change *c)
{
    write_number(out, "set_id", c->set_id);
    write_mask(out, "id", c->id);
    write_number(out, "id_flags", c->id_flags);
    write_number(out, "set_dlc", c->set_dlc);
    write_number(out, "dlc", c->dlc);
    write_bytes(out, "set_mask", c->set_mask, 8);
    write_bytes(out, "set", c->set, 8);
    write_bytes(out, "and_mask", c->and_mask, 8);
    write_bytes(out, "or_mask", c->or_mask, 8);
    write_bytes(out, "xor_mask", c->xor_mask, 8);
}

static void write_when(FILE *out, const cw_rule *r)
{
    static const char *const triggers[] = {"FRAME", "TIME", "ARMED", "ERROR"};
    fprintf(out, ".trigger = CW_TRIGGER_%s, ", triggers[r->trigger]);
    if (r->filter_count)
        fprintf(out, ".filter_count = %u, .filters = {", r->filter_count);
    for (unsigned i = 0; i < r->filter_count; i++)
        fprintf(out, "{0x%" PRIX32 ", 0x%" PRIX32 ", %s}, ", r->filters[i].value,
                r->filters[i].mask, r->filters[i].inverted ? "true" : "false");
    fputs(r->filter_count ? "}, " : "", out);
    write_mask(out, "error_mask", r->error_mask);
    write_number(out, "data_length", r->data_length);
    write_bytes(out, "data_mask", r->data_mask, 8);
    write_bytes(out, "data_value", r->data_value, 8);
    write_mask(out, "from", r->from);
    write_mask(out, "state_nodes", r->state_nodes);
    write_mask(out, "state_mask", r->state_mask);
    write_number(out, "time_begin", r->time_begin);
    write_number(out, "time_end", r->time_end);
    write_number(out, "again_ticks", r->again_ticks);
    write_number(out, "has_after", r->has_after);
    write_number(out, "manual", r->manual);
    write_number(out, "after", r->after);
    write_number(out, "after_delay", r->after_delay);
    write_number(out, "skip", r->skip);
    write_number(out, "every", r->every);
    write_number(out, "count", r->count);
    write_number(out, "probability", r->probability);
    write_number(out, "hold_off", r->hold_off);
}

static void write_position(FILE *out, const cw_rule *r)
{
    static const char *const fields[CW_FIELD_COUNT] = {"NONE",
                                                       "SOF",
                                                       "ID",
                                                       "SRR",
                                                       "IDE",
                                                       "RTR",
                                                       "R1",
                                                       "R0",
                                                       "DLC",
                                                       "DATA",
                                                       "CRC",
                                                       "CRC_DELIMITER",
                                                       "ACK_SLOT",
                                                       "ACK_DELIMITER",
                                                       "EOF",
                                                       "INTERMISSION",
                                                       "SUSPEND",
                                                       "ERROR_FLAG",
                                                       "ERROR_DELIMITER",
                                                       "OVERLOAD_FLAG",
                                                       "OVERLOAD_DELIMITER",
                                                       "STUFF",
                                                       "BIT"};
    if (cw_action_kind_of(r->action) != CW_KIND_POSITION)
        return;
    fprintf(out, ".field = CW_FIELD_%s, ", fields[r->field]);
    write_number(out, "index", r->index);
    write_number(out, "bits", r->bits);
}

static void write_levels(FILE *out, const cw_rule *r)
{
    write_position(out, r);
    write_number(out, "level", r->level);
    if (r->action == CW_ACTION_STUCK) {
        write_number(out, "line", r->line);
        write_number(out, "dominant_timeout", r->dominant_timeout);
    }
    if (r->action == CW_ACTION_GLITCH) {
        write_mask(out, "pattern_level", r->pattern_level);
        write_mask(out, "pattern_mask", r->pattern_mask);
    }
    if (r->action == CW_ACTION_PULSE)
        write_number(out, "line", r->line);
    if (r->action == CW_ACTION_PULSE)
        write_number(out, "pulse_permille", r->pulse_permille);
    if (r->action == CW_ACTION_PULSE)
        write_number(out, "pulse_offset", (uint64_t)r->pulse_offset);
    if (r->action == CW_ACTION_PULSE)
        write_number(out, "pulse_length", (uint64_t)r->pulse_length);
    if (r->action == CW_ACTION_JITTER)
        write_number(out, "jitter", (uint64_t)r->jitter);
    if (r->action == CW_ACTION_RAMP)
        fprintf(out, ".quantum_from = %" PRId64 ", .quantum_to = %" PRId64 ", ", r->quantum_from,
                r->quantum_to);
    if (r->action == CW_ACTION_NOISE)
        write_number(out, "error_rate", r->error_rate);
    if (r->action == CW_ACTION_NOISE && r->burst_most) {
        write_number(out, "burst_least", r->burst_least);
        write_number(out, "burst_most", r->burst_most);
    }
    if (r->action == CW_ACTION_RAW)
        fprintf(out, ".raw_when_idle = %d, .raw = {%" PRIu64 "u, %" PRIu64 "u, %" PRIu64 "u}, ",
                r->raw_when_idle, r->raw[0], r->raw[1], r->raw[2]);
    if (r->action == CW_ACTION_PARTITION)
        write_bytes(out, "group", r->group, CW_NODES_MAX);
}

static void write_control(FILE *out, const cw_rule *r)
{
    if (r->action == CW_ACTION_COUNTERS)
        fprintf(out, ".tec = %u, .rec = %u, ", r->tec, r->rec);
    if (r->action != CW_ACTION_SET)
        return;
    fputs(".settings = {", out);
    write_settings(out, &r->settings);
    fputs("}, ", out);
}

static void write_frames(FILE *out, const cw_rule *r)
{
    if (r->action == CW_ACTION_CHANGE) {
        fputs(".change = {", out);
        write_change(out, &r->change);
        fputs("}, ", out);
    }
    if (cw_action_kind_of(r->action) == CW_KIND_TRAFFIC && r->action != CW_ACTION_LOAD) {
        fputs(".frame = {", out);
        write_frame(out, &r->frame);
        fputs("}, ", out);
    }
    write_number(out, "deviations", r->deviations);
    write_number(out, "period_ticks", r->period_ticks);
    write_number(out, "load_permille", r->load_permille);
}

static void write_rule(FILE *out, const diff_rule *rule)
{
    const cw_rule *r = &rule->rule;
    fprintf(out, "{.name = \"%s\", ", diff_name(rule->name));
    write_when(out, r);
    fprintf(out, "\n   .action = CW_ACTION_%s, ", diff_action_name(r->action));
    if (cw_action_kind_of(r->action) <= CW_KIND_LEVEL)
        write_levels(out, r);
    else if (cw_action_kind_of(r->action) == CW_KIND_CONTROL)
        write_control(out, r);
    write_number(out, "for_ticks", r->for_ticks);
    write_mask(out, "at", r->at);
    write_mask(out, "nodes", r->nodes);
    write_number(out, "node", r->node);
    write_number(out, "side", r->side);
    write_number(out, "number", r->number);
    write_frames(out, r);
    fputs("}", out);
}

/* ---- Scenarios ------------------------------------------------------------------------------- */

static bool same_node(const cw_node_config *a, const cw_node_config *b)
{
    return a->modes == b->modes && a->order == b->order && a->queue == b->queue &&
           a->warning_limit == b->warning_limit && a->restart_ticks == b->restart_ticks &&
           a->protocol == b->protocol && a->variants == b->variants &&
           memcmp(&a->host, &b->host, sizeof a->host) == 0 &&
           memcmp(&a->local, &b->local, sizeof a->local) == 0 &&
           memcmp(&a->schedule, &b->schedule, sizeof a->schedule) == 0 &&
           memcmp(&a->timing, &b->timing, sizeof a->timing) == 0 && a->sleeps == b->sleeps &&
           memcmp(&a->sleep, &b->sleep, sizeof a->sleep) == 0;
}

static void write_bit_timing(FILE *out, const cw_bit_timing *t)
{
    fprintf(out, "{.quantum = %" PRId64 ", .prop_seg = %u, .phase_seg1 = %u, .phase_seg2 = %u, "
            ".sjw = %u, .triple_sampling = %d}, ", t->quantum, t->prop_seg, t->phase_seg1,
            t->phase_seg2, t->sjw, t->triple_sampling);
}

static void write_timing(FILE *out, const cw_node_timing *t)
{
    fputs(".timing = {", out);
    if (t->bit.quantum) {
        fputs(".bit = ", out);
        write_bit_timing(out, &t->bit);
    }
    if (t->data.data_brp) {
        fprintf(out, ".data = {.brp = %u, .data_brp = %u, .tdc = {%u, %u, %u}, .bit = ",
                t->data.brp, t->data.data_brp, (unsigned)t->data.tdc.mode, t->data.tdc.tdco,
                t->data.tdc.tdcv);
        write_bit_timing(out, &t->data.bit);
        fputs("}, ", out);
    }
    fprintf(out, ".tx_delay = {%" PRId64 ", %" PRId64 "}, .rx_delay = {%" PRId64 ", %" PRId64 "}, ",
            t->tx_delay[0], t->tx_delay[1], t->rx_delay[0], t->rx_delay[1]);
    fprintf(out, ".place = %" PRId64 ", .ringing = %" PRId64 "}, ", t->place, t->ringing);
}

static void write_host(FILE *out, const cw_host_config *h)
{
    if (h->filter_count || h->receive_buffers || h->mailbox_count)
        fprintf(out, ".host = {.filters = diff_filters, .filter_count = %u, .receive_buffers = %u, "
                ".service_ticks = %" PRIu64 ", .receive_bytes = %u, .overload_when_full = %d, ",
                h->filter_count, h->receive_buffers, h->service_ticks, h->receive_bytes,
                h->overload_when_full);
    if (h->mailbox_count)
        fprintf(out, ".mailboxes = diff_mailboxes + %td, .mailbox_count = %u, .receive_fifo = %d, "
                ".transmit = %d, ", h->mailboxes - diff_mailboxes, h->mailbox_count,
                h->receive_fifo, (int)h->transmit);
    if (h->filter_count || h->receive_buffers || h->mailbox_count)
        fputs("}, ", out);
}

static void write_times(FILE *out, const cw_local_time *l, const cw_schedule *s)
{
    if (l->bits)
        fprintf(out, ".local = {%" PRId64 ", %u, %d, %" PRIu32 "}, ", l->unit, l->bits, l->at_eof,
                l->start);
    if (s->cycles)
        fprintf(out, ".schedule = {{0x%" PRIX32 ", 0x%" PRIX32 "}, %u, %u, %u, %s}, ",
                s->reference.value, s->reference.mask, s->cycles, s->cycle_byte, s->trigger_count,
                s->triggers == diff_master ? "diff_master" : "diff_slave");
}

static void write_nodes(FILE *out, const diff_plan *plan)
{
    for (unsigned i = 0, next; i < plan->config.node_count; i = next) {
        const cw_node_config *n = &plan->nodes[i];
        next = i + 1;
        while (next < plan->config.node_count && same_node(n, &plan->nodes[next]))
            next++;
        fprintf(out, next > i + 1 ? "  [%u ... %u] = {" : "  [%u] = {", i, next - 1);
        write_mask(out, "modes", n->modes);
        write_number(out, "order", n->order);
        write_number(out, "queue", n->queue);
        write_number(out, "warning_limit", n->warning_limit);
        write_number(out, "protocol", n->protocol);
        write_number(out, "variants", n->variants);
        write_number(out, "restart_ticks", n->restart_ticks);
        write_timing(out, &n->timing);
        write_host(out, &n->host);
        write_number(out, "sleeps", n->sleeps);
        if (n->sleep.filter_ticks || n->sleep.wake_ticks || n->sleep.frame_count)
            write_sleep(out, &n->sleep);
        write_times(out, &n->local, &n->schedule);
        fputs("},\n", out);
    }
}

static void write_protection(FILE *out, const cw_protection *p)
{
    const cw_counter *n = &p->counter;
    const cw_checksum *c = &p->checksum;
    fprintf(out, "  {.node = %u, .id = 0x%" PRIX32 ", .counter = {%u, %u, %" PRIu32 ", %" PRIu32
            "}, .checksum = {.kind = %d, .at = %u, .polynomial = 0x%X, .start = 0x%X, "
            ".inverted = 0x%X, .id_first = %d, .id_by_counter = %d, .id_length = %u, ", p->node,
            p->id, n->bit, n->bits, n->max, n->start, (int)c->kind, c->at, c->polynomial, c->start,
            c->inverted, c->id_first, c->id_by_counter, c->id_length);
    write_bytes(out, "id", c->id, c->id_length);
    fputs("}},\n", out);
}

static void write_plan(FILE *out, const diff_plan *plan, unsigned number)
{
    const cw_bus_config *c = &plan->config;
    fprintf(out, "cw_node_config nodes_%u[] = {\n", number);
    write_nodes(out, plan);
    fprintf(out, "};\n");
    if (c->rule_count)
        fprintf(out, "cw_rule rules_%u[] = {\n", number);
    for (unsigned i = 0; i < c->rule_count; i++) {
        fputs("  ", out);
        write_rule(out, &plan->rules[i]);
        fprintf(out, ", /* %u */\n", i);
    }
    fputs(c->rule_count ? "};\n" : "", out);
    if (c->protection_count)
        fprintf(out, "cw_protection protections_%u[] = {\n", number);
    for (unsigned i = 0; i < c->protection_count; i++)
        write_protection(out, &plan->protections[i]);
    fprintf(out, "%scw_bus_config config_%u = {", c->protection_count ? "};\n" : "", number);
    fprintf(out, ".bit_ticks = %" PRIu32 ", .node_count = %u, .inbox = %u, ", c->bit_ticks,
            c->node_count, c->inbox);
    write_number(out, "events", c->events);
    write_number(out, "seed", c->seed);
    write_number(out, "rule_count", c->rule_count);
    write_number(out, "rule_room", c->rule_room);
    write_number(out, "start_at_tick", c->start_at_tick);
    fprintf(out, "\n  .nodes = nodes_%u", number);
    if (c->rule_count)
        fprintf(out, ", .rules = rules_%u", number);
    if (c->protection_count)
        fprintf(out, ", .protection_count = %" PRIu32 ", .protections = protections_%u",
                c->protection_count, number);
    fputs("};\n", out);
}

static void write_call(FILE *out, const diff_scenario *s, const diff_op *op)
{
    switch (op->kind) {
    case DIFF_SEND:
        fprintf(out, "cw_node_send(bus, %u, &(cw_frame){", op->target);
        write_frame(out, &op->send.frame);
        fprintf(out, "}, %" PRIu64 ");\n", op->send.at_tick);
        break;
    case DIFF_RESTART:
        fprintf(out, "cw_node_restart(bus, %u);\n", op->target);
        break;
    case DIFF_ADD_RULE:
        fputs("cw_bus_add_rule(bus, &index, &(cw_rule)", out);
        write_rule(out, &s->added[op->target]);
        fputs(");\n", out);
        break;
    case DIFF_CLEAR_RULE:
        fprintf(out, "cw_bus_clear_rule(bus, %u);\n", op->target);
        break;
    case DIFF_STOP_RULE:
        fprintf(out, "cw_bus_stop_rule(bus, %u);\n", op->target);
        break;
    case DIFF_FIRE_RULE:
        fprintf(out, "cw_bus_fire_rule(bus, %u);\n", op->target);
        break;
    case DIFF_SET:
        fprintf(out, "cw_node_set(bus, %u, &(cw_settings){", op->target);
        write_settings(out, &op->settings);
        fputs("});\n", out);
        break;
    case DIFF_FLUSH:
        fprintf(out, "cw_node_flush(bus, %u);\n", op->target);
        break;
    case DIFF_ATTACH:
        fprintf(out, "cw_node_attach(bus, %u, %s);\n", op->target, op->on ? "true" : "false");
        break;
    case DIFF_SET_EVENTS:
        fprintf(out, "cw_bus_set_events(bus, 0x%" PRIX32 ");\n", op->kinds);
        break;
    case DIFF_TAKE_OVER:
        fprintf(out, "/* to config_%u: */ cw_bus_take_over(next, bus, (uint8_t[]){", op->target);
        for (unsigned i = 0; i < s->plans[op->target].config.node_count; i++)
            fprintf(out, "%s%u", i ? ", " : "", op->from[i]);
        fputs("});\n", out);
        break;
    case DIFF_BRING_FORWARD:
        fprintf(out, "cw_bus_bring_forward(bus, %" PRIu64 ");\n", op->ticks);
        break;
    case DIFF_STEPPING:
        fprintf(out, "cw_bus_set_stepping(fast, %s);\n", op->on ? "true" : "false");
        break;
    case DIFF_WATCHING:
        fprintf(out, "cw_bus_set_watching(fast, %s);\n", op->on ? "true" : "false");
        break;
    case DIFF_CHECK:
    case DIFF_OP_COUNT:
        fputs("compare(fast, reference);\n", out);
        break;
    }
}

static bool plan_used(const diff_scenario *s, unsigned plan)
{
    bool used = plan == 0;
    for (unsigned i = 0; i < s->op_count; i++)
        used = used || (s->ops[i].kind == DIFF_TAKE_OVER && s->ops[i].target == plan);
    return used;
}

void diff_write_scenario(FILE *out, const diff_scenario *s)
{
    static const char *const slicings[] = {"in one go", "bit by bit", "in short slices",
                                           "in slices of all lengths", "to cw_bus_next()",
                                           "as far as a little work goes"};
    fprintf(out, "/* seed %" PRIu64 ", style \"%s\"; fast %s%s, reference %s%s */\n", s->seed,
            diff_style_name(s->style), slicings[s->fast], s->peeks ? ", read after each slice" : "",
            slicings[s->reference], s->repeats ? ", to where the fast one stops" : "");
    for (unsigned i = 0; i < s->plan_count; i++)
        if (plan_used(s, i))
            write_plan(out, &s->plans[i], i);
    for (unsigned i = 0; i < s->op_count; i++) {
        if (!s->ops[i].at_once)
            fprintf(out, "cw_bus_advance(bus, %" PRIu64 ");\n", s->ops[i].tick);
        write_call(out, s, &s->ops[i]);
    }
    fprintf(out, "cw_bus_advance(bus, %" PRIu64 ");\n", s->end);
}
