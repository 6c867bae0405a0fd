/* SPDX-License-Identifier: MIT
 *
 * vcd.c - the bits of a bus as a Value Change Dump, for GTKWave, PulseView and sigrok.
 *
 * Levels, fields, faults and errors belong to a bit and change at its start; states and counters
 * change at its end. sigrok 0.5 takes texts for unknown words and passes over them, word by word:
 * so the identifier of a text begins with a letter that begins no value (f, q, e, n), and there are
 * no comments among the values. It gives up at the first vector of more than one bit, but passes
 * over numbers of type real: so the counters are real. Newer sigrok shows these as curves, and
 * refuses files with variables of type event.
 */
#include "vcd.h"

#include "bitpart.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define TICK_PS 12500u
#define UNITS_PER_BIT_MIN 10u /* so that sigrok's decoder can place its sample points */
#define RULES_TEXT_MAX 256    /* bytes of the names of rules in one bit, with the final 0 */
#define NO_ERROR CW_ERROR_COUNT

/* What was last written of a node. */
typedef struct vcd_node {
    bit_part part;
    cw_error_type error;
    cw_error_type error_now; /* of the bit in progress */
    cw_state state;
    uint16_t tec;
    uint16_t rec;
} vcd_node;

struct vcd {
    FILE *out;
    const cfg *config;
    bool begun;    /* all variables have values */
    uint64_t time; /* tick last written */
    uint64_t end;  /* tick of the end of the last bit */
    uint64_t units_per_bit;
    uint64_t driven; /* as in cw_bit_view */
    uint64_t sampled;
    uint64_t stuff;
    bool wire;
    bool fault;
    bool rule;                       /* `rule` is not empty */
    char rules_now[RULES_TEXT_MAX];  /* of the bit in progress */
    char rules_next[RULES_TEXT_MAX]; /* of the bit after it */
    size_t node_count;
    vcd_node nodes[];
};

/* ---- Header ---------------------------------------------------------------------------------- */

static void write_scale(vcd *self)
{
    static const struct {
        uint64_t ps;
        const char *name;
    } units[] = {{100000000, "100 us"}, {10000000, "10 us"}, {1000000, "1 us"}, {100000, "100 ns"},
                 {10000, "10 ns"},      {1000, "1 ns"},      {100, "100 ps"}};
    const uint64_t bit_ps = (uint64_t)self->config->bit_ticks * TICK_PS;
    size_t i = 0;
    while (bit_ps % units[i].ps != 0 || bit_ps / units[i].ps < UNITS_PER_BIT_MIN)
        i++; /* 100 ps divide a tick */
    self->units_per_bit = bit_ps / units[i].ps;
    fprintf(self->out, "$timescale %s $end\n", units[i].name);
}

static void write_header(vcd *self)
{
    FILE *out = self->out;
    fprintf(out, "$version canwire $end\n");
    write_scale(self);
    fprintf(out, "$scope module %s $end\n", self->config->bus_name);
    fprintf(out, "$var wire 1 w wire $end\n");
    for (size_t i = 0; i < self->node_count; i++) {
        const char *name = self->config->nodes[i].name;
        fprintf(out, "$var wire 1 d%zu %s.driven $end\n", i, name);
        fprintf(out, "$var wire 1 s%zu %s.sampled $end\n", i, name);
        fprintf(out, "$var wire 1 t%zu %s.stuff $end\n", i, name);
        fprintf(out, "$var string 1 f%zu %s.field $end\n", i, name);
        fprintf(out, "$var string 1 e%zu %s.error $end\n", i, name);
        fprintf(out, "$var string 1 q%zu %s.state $end\n", i, name);
        fprintf(out, "$var real 64 c%zu %s.tec $end\n", i, name);
        fprintf(out, "$var real 64 k%zu %s.rec $end\n", i, name);
    }
    fprintf(out, "$var wire 1 m fault $end\n");
    fprintf(out, "$var string 1 n rule $end\n");
    fprintf(out, "$upscope $end\n$enddefinitions $end\n");
}

vcd *vcd_open(FILE *out, const cfg *config, const cw_bus *bus)
{
    vcd *self = calloc(1, sizeof *self + config->node_count * sizeof self->nodes[0]);
    if (!self)
        return NULL;
    self->out = out;
    self->config = config;
    self->node_count = config->node_count;
    self->time = CW_NEVER;
    self->end = cw_bus_now(bus);
    for (unsigned i = 0; i < self->node_count; i++) {
        cw_node_stats stats;
        cw_status status = cw_node_get_stats(bus, i, &stats);
        assert(status == CW_OK);
        (void)status;
        self->nodes[i].state = stats.state;
        self->nodes[i].tec = stats.tec;
        self->nodes[i].rec = stats.rec;
        self->nodes[i].error_now = NO_ERROR;
    }
    write_header(self);
    return self;
}

/* ---- Values ---------------------------------------------------------------------------------- */

static void write_time(vcd *self, uint64_t tick)
{
    if (tick == self->time)
        return;
    const uint32_t bit_ticks = self->config->bit_ticks;
    assert(tick % bit_ticks == 0);
    fprintf(self->out, "#%" PRIu64 "\n", tick / bit_ticks * self->units_per_bit);
    self->time = tick;
}

static void write_number(vcd *self, uint64_t tick, char id, size_t node, unsigned value)
{
    write_time(self, tick);
    fprintf(self->out, "r%u %c%zu\n", value, id, node);
}

static void write_text(vcd *self, uint64_t tick, const char *text, char id, size_t node)
{
    write_time(self, tick);
    fprintf(self->out, "s%s %c%zu\n", text, id, node);
}

/* A level of the whole bus. */
static void write_level(vcd *self, uint64_t tick, bool *before, bool level, char id)
{
    if (self->begun && *before == level)
        return;
    write_time(self, tick);
    fprintf(self->out, "%c%c\n", level ? '1' : '0', id);
    *before = level;
}

/* A level of each node. */
static void write_levels(vcd *self, uint64_t tick, uint64_t *before, uint64_t levels, char id)
{
    for (size_t i = 0; i < self->node_count; i++) {
        if (self->begun && !((*before ^ levels) >> i & 1u))
            continue;
        write_time(self, tick);
        fprintf(self->out, "%c%c%zu\n", levels >> i & 1u ? '1' : '0', id, i);
    }
    *before = levels;
}

static void write_part(vcd *self, const cw_bit_view *bit, unsigned node)
{
    vcd_node *n = &self->nodes[node];
    bit_part part = bit_part_of(bit, node);
    char text[BIT_PART_TEXT_MAX];
    if (self->begun && bit_part_same(&n->part, &part))
        return;
    n->part = part;
    bit_part_print(text, &part);
    write_text(self, bit->start, text, 'f', node);
}

static void write_error(vcd *self, uint64_t tick, size_t node)
{
    vcd_node *n = &self->nodes[node];
    if (!self->begun || n->error != n->error_now)
        write_text(self, tick, n->error_now == NO_ERROR ? "" : cw_error_type_name(n->error_now),
                   'e', node);
    n->error = n->error_now;
    n->error_now = NO_ERROR;
}

/* One after the other may be of the same rules: then it is written again, for a marker each. */
static void write_rules(vcd *self, uint64_t tick)
{
    bool now = self->rules_now[0] != '\0';
    if (!self->begun || now || self->rule) {
        write_time(self, tick);
        fprintf(self->out, "s%s n\n", self->rules_now);
    }
    self->rule = now;
    memcpy(self->rules_now, self->rules_next, sizeof self->rules_now);
    self->rules_next[0] = '\0';
}

static void write_states(vcd *self, uint64_t tick)
{
    for (size_t i = 0; i < self->node_count; i++) {
        const vcd_node *n = &self->nodes[i];
        write_text(self, tick, cw_state_name(n->state), 'q', i);
        write_number(self, tick, 'c', i, n->tec);
        write_number(self, tick, 'k', i, n->rec);
    }
}

static void write_state_changes(vcd *self, const cw_bit_view *bit)
{
    for (size_t i = 0; i < self->node_count; i++) {
        vcd_node *n = &self->nodes[i];
        const cw_bit_node *now = &bit->nodes[i];
        if (n->state != now->state)
            write_text(self, bit->end, cw_state_name(now->state), 'q', i);
        if (n->tec != now->tec)
            write_number(self, bit->end, 'c', i, now->tec);
        if (n->rec != now->rec)
            write_number(self, bit->end, 'k', i, now->rec);
        n->state = now->state;
        n->tec = now->tec;
        n->rec = now->rec;
    }
}

/* ---- Bits and events ------------------------------------------------------------------------- */

static uint64_t stuff_bits(const cw_bit_view *bit)
{
    uint64_t stuff = 0;
    for (unsigned i = 0; i < bit->node_count; i++)
        if (bit->nodes[i].place.stuff)
            stuff |= UINT64_C(1) << i;
    return stuff;
}

void vcd_bit(vcd *self, const cw_bit_view *bit)
{
    uint64_t start = bit->start;
    bool fault = bit->tx_faults | bit->wire_faults | bit->rx_faults || self->rules_now[0] != '\0';
    assert(bit->node_count == self->node_count);
    if (!self->begun) {
        write_time(self, start);
        fprintf(self->out, "$dumpvars\n");
    }
    write_level(self, start, &self->wire, bit->wire == UINT64_MAX, 'w');
    write_levels(self, start, &self->driven, bit->driven, 'd');
    write_levels(self, start, &self->sampled, bit->sampled, 's');
    write_levels(self, start, &self->stuff, stuff_bits(bit), 't');
    for (unsigned i = 0; i < self->node_count; i++) {
        write_part(self, bit, i);
        write_error(self, start, i);
    }
    write_level(self, start, &self->fault, fault, 'm');
    write_rules(self, start);
    if (!self->begun) {
        write_states(self, start);
        fprintf(self->out, "$end\n");
        self->begun = true;
    }
    write_state_changes(self, bit);
    self->end = bit->end;
}

/* What does not fit is told by a +. */
static void add_rule(char text[RULES_TEXT_MAX], const char *name)
{
    size_t used = strlen(text);
    size_t length = strlen(name);
    if (used + 1 + length + 2 <= RULES_TEXT_MAX)
        snprintf(text + used, RULES_TEXT_MAX - used, "%s%s", used ? "+" : "", name);
    else if (text[used - 1] != '+')
        snprintf(text + used, RULES_TEXT_MAX - used, "+");
}

static void note_fault(vcd *self, const cw_event *event)
{
    const cw_rule *rule = &self->config->rules[event->rule];
    assert(event->rule < self->config->rule_count);
    bool in_bit = bit_has_hit(rule) || event->tick <= self->end;
    add_rule(in_bit ? self->rules_now : self->rules_next, rule->name);
}

void vcd_event(vcd *self, const cw_event *event)
{
    if (event->kind == CW_EVENT_FAULT)
        note_fault(self, event);
    if (event->kind != CW_EVENT_ERROR)
        return;
    for (size_t i = 0; i < self->node_count; i++)
        if (event->nodes >> i & 1u)
            self->nodes[i].error_now = event->error.type;
}

void vcd_close(vcd *self)
{
    if (!self)
        return;
    if (self->begun)
        write_time(self, self->end);
    free(self);
}
