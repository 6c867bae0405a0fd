/* SPDX-License-Identifier: MIT
 *
 * vcd.c - the bits of a bus as a Value Change Dump, for GTKWave, PulseView and sigrok.
 *
 * Levels, fields, faults and errors belong to a bit and change at its start; states and counters
 * change at its end. sigrok 0.5 skips texts as unknown words, word by word. So the identifier of a
 * text begins with a letter that begins no value (f, q, e, n), and no comments stand among the
 * values. sigrok fails at the first vector of more than one bit, but skips numbers of type real: so
 * the counters are real. Newer sigrok shows these as curves, and refuses files with variables of
 * type event.
 */
#include "record/vcd.h"

#include "base/divisor.h"
#include "base/text/chars.h"
#include "record/bit_moments.h"
#include "record/bitpart.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#define TICK_PS 12500u
#define LEAST_PS 100u /* the least unit, where nodes have clocks of their own; it divides a tick */
#define UNITS_PER_BIT_MIN 10u /* so that sigrok's decoder can place its sample points */
#define RULES_TEXT_MAX 256    /* bytes of the names of rules in one bit, with the final 0 */
#define NO_ERROR CW_ERROR_COUNT
#define NO_MARK UINT32_MAX
#define TEXT_BYTES 4096u    /* that are written at once */
#define LEVEL_MAX 5u   /* bytes of a level of one node: "1s63\n" */
#define PART_MAX 32u   /* bytes of a part that are copied at once: "soverload-delimiter" */
#define PART_ID_MAX 8u /* ... and of its end: " f63\n" */
#define CHANGE_MAX (CW_NODES_MAX * LEVEL_MAX + RULES_TEXT_MAX + 32u) /* of a time and values */

/* The inside of bits, as far as it has been written, where nodes have clocks of their own. */
typedef struct inside {
    bool levels_only; /* the bits of a bus with data rates, whose nodes may fall out of step */
    bit_clocks clocks;
    uint64_t wires;     /* of each node, the level of its wire */
    uint64_t quanta;    /* levels of NODE.tq */
    uint64_t sampling;  /* NODE.sample is 1 */
    uint64_t synced;    /* NODE.sync is not empty */
    bit_walk walk;
} inside;

/* The last written values of a node. */
typedef struct vcd_node {
    uint32_t mark; /* see mark_of(); NO_MARK: compute the part */
    bit_part part;
    cw_error_type error;
    cw_error_type error_now; /* of the bit in progress */
    cw_state state;
    uint16_t tec;
    uint16_t rec;
    char part_id[PART_ID_MAX]; /* the end of a line with its part */
    size_t part_id_length;
} vcd_node;

/* A level of each node, as last written. Often all change to the same one. */
typedef struct vcd_levels {
    char id;
    uint64_t now;  /* as in cw_bit_view */
    size_t length; /* of the lines with all nodes ... */
    char lines[2][CW_NODES_MAX * LEVEL_MAX]; /* ... dominant and recessive */
} vcd_levels;

struct vcd {
    FILE *out;
    const cfg *config;
    bool begun;    /* all variables have values */
    uint64_t time; /* tick last written; CW_NEVER: there is none, or it was inside a bit */
    uint64_t units; /* ... as written */
    inside *inside; /* NULL: all bits are common to all nodes */
    uint64_t end;  /* tick of the end of the last bit */
    uint64_t unit_ps;
    uint64_t all;     /* nodes */
    vcd_levels driven;
    vcd_levels sampled;
    vcd_levels stuff; /* 1: the node is in a stuff bit */
    uint64_t errors; /* nodes whose error must be written */
    uint64_t alike;  /* as in cw_bit_view */
    uint32_t alike_mark;
    uint32_t printed_mark; /* last printed part, which other nodes often share */
    bit_part printed_part;
    char printed[PART_MAX]; /* the begin of its lines */
    size_t printed_length;
    bool wire;
    bool fault;
    bool rule;                       /* `rule` is not empty */
    char rules_now[RULES_TEXT_MAX];  /* of the bit in progress */
    char rules_next[RULES_TEXT_MAX]; /* of the bit after it */
    size_t used; /* of text */
    char text[TEXT_BYTES];
    size_t node_count;
    vcd_node nodes[];
};

/* ---- Header ---------------------------------------------------------------------------------- */

static uint64_t span_ps(cw_span span)
{
    return bit_moment_units(span, TICK_PS);
}

/* The time that divides all begins of bits, and the shortest bit. */
typedef struct grid {
    uint64_t ps;
    uint64_t shortest_ps;
} grid;

/* Adds the data phase of a node. BRS and the CRC delimiter are in part of either rate (D10). */
static void add_data_phase(grid *g, const cw_node_timing *t, cw_span bit)
{
    const cw_bit_timing *nominal = &t->bit, *data = &t->data.bit;
    if (t->data.data_brp == 0 || nominal->quantum == 0)
        return;
    const cw_span quantum = nominal->quantum / t->data.brp * t->data.data_brp;
    const cw_span data_bit = quantum * cw_bit_timing_quanta(data);
    const cw_span sample = nominal->quantum * cw_bit_timing_sample_at(nominal);
    const cw_span data_sample = quantum * cw_bit_timing_sample_at(data);
    const cw_span brs = sample + data_bit - data_sample;
    g->ps = common_divisor(g->ps, span_ps(data_bit));
    g->ps = common_divisor(g->ps, span_ps(brs < bit ? bit - brs : brs - bit));
    if (span_ps(data_bit) < g->shortest_ps)
        g->shortest_ps = span_ps(data_bit);
}

/* Finds the grid on which all bits begin, by the rates of all nodes. */
static grid grid_of(const vcd *self)
{
    const uint64_t ticks = cw_rate_ticks(self->config->rate, 1);
    grid g = {.ps = ticks * TICK_PS, .shortest_ps = ticks * TICK_PS};
    for (size_t i = 0; i < self->node_count; i++)
        add_data_phase(&g, &self->config->nodes[i].time.timing, (cw_span)ticks * CW_TICK);
    return g;
}

/* Takes the coarsest unit that divides all bits and is fine enough. Clocks of nodes, and bits that
 * begin at any tick, need the finest one. */
static void write_scale(vcd *self)
{
    static const struct {
        uint64_t ps;
        const char *name;
    } units[] = {{100000000, "100 us"}, {10000000, "10 us"}, {1000000, "1 us"}, {100000, "100 ns"},
                 {10000, "10 ns"},      {1000, "1 ns"},      {100, "100 ps"}};
    const size_t last = sizeof units / sizeof units[0] - 1;
    const grid g = grid_of(self);
    size_t i = 0;
    while (i < last && (g.ps % units[i].ps != 0 || g.shortest_ps / units[i].ps < UNITS_PER_BIT_MIN))
        i++;
    if ((self->inside && !self->inside->levels_only) || self->config->start == CFG_START_TICK)
        i = last;
    self->unit_ps = units[i].ps;
    fprintf(self->out, "$timescale %s $end\n", units[i].name);
}

/* Declares all variables. Their identifiers begin as the file's head explains. */
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
        if (!self->inside || self->inside->levels_only)
            continue;
        fprintf(out, "$var wire 1 u%zu %s.tq $end\n", i, name);
        fprintf(out, "$var wire 1 a%zu %s.sample $end\n", i, name);
        fprintf(out, "$var string 1 f%zuy %s.sync $end\n", i, name);
        fprintf(out, "$var real 64 p%zu %s.phase_error $end\n", i, name);
    }
    fprintf(out, "$var wire 1 m fault $end\n");
    fprintf(out, "$var string 1 n rule $end\n");
    fprintf(out, "$upscope $end\n$enddefinitions $end\n");
}

/* Makes room for the inside of bits, where there may be anything to see. Returns false without
 * memory. */
static bool make_inside(vcd *self, const cw_bus *bus)
{
    cw_data_stats data;
    const bool on_grid = cw_bus_is_on_grid(bus);
    const bool rates = cw_node_get_data_stats(bus, 0, &data) == CW_OK;
    if (!cfg_has_clocks(self->config) || (on_grid && !rates))
        return true;
    self->inside = calloc(1, sizeof *self->inside);
    if (self->inside)
        self->inside->levels_only = on_grid;
    return self->inside != NULL;
}

/* Writes the identifier of a variable of a node, which has two digits at most. */
static char *put_id(char *at, char id, size_t node)
{
    *at++ = id;
    if (node >= 10)
        *at++ = (char)('0' + node / 10);
    *at++ = (char)('0' + node % 10);
    return at;
}

/* Makes the lines of all nodes for both levels, since often all change at once. */
static void begin_levels(vcd_levels *l, char id, size_t nodes)
{
    l->id = id;
    for (unsigned level = 0; level < 2; level++) {
        char *at = l->lines[level];
        for (size_t i = 0; i < nodes; i++) {
            *at++ = level ? '1' : '0';
            at = put_id(at, id, i);
            *at++ = '\n';
        }
        l->length = (size_t)(at - l->lines[level]);
    }
}

/* Begins a node with its state, which is written with the first bit. */
static void begin_node(vcd_node *n, const cw_bus *bus, unsigned i)
{
    cw_node_stats stats;
    cw_status status = cw_node_get_stats(bus, i, &stats);
    assert(status == CW_OK);
    (void)status;
    *n = (vcd_node){.mark = NO_MARK, .error_now = NO_ERROR, .state = stats.state,
                    .tec = stats.tec, .rec = stats.rec, .part_id = " "};
    char *end = put_id(n->part_id + 1, 'f', i);
    *end++ = '\n';
    n->part_id_length = (size_t)(end - n->part_id);
}

vcd *vcd_open(FILE *out, const cfg *config, const cw_bus *bus)
{
    vcd *self = calloc(1, sizeof *self + config->node_count * sizeof self->nodes[0]);
    if (!self)
        return NULL;
    self->out = out;
    self->config = config;
    self->node_count = config->node_count;
    self->time = self->units = CW_NEVER;
    if (!make_inside(self, bus)) {
        free(self);
        return NULL;
    }
    self->end = cw_bus_now(bus);
    self->all = UINT64_MAX >> (CW_NODES_MAX - self->node_count);
    begin_levels(&self->driven, 'd', self->node_count);
    begin_levels(&self->sampled, 's', self->node_count);
    begin_levels(&self->stuff, 't', self->node_count);
    for (unsigned i = 0; i < self->node_count; i++)
        begin_node(&self->nodes[i], bus, i);
    self->errors = UINT64_MAX; /* all are written once */
    self->alike_mark = self->printed_mark = NO_MARK;
    write_header(self);
    return self;
}

/* ---- Values ---------------------------------------------------------------------------------- */

/* Returns the lowest node of a set that is not empty. */
static unsigned lowest(uint64_t nodes)
{
    return (unsigned)__builtin_ctzll(nodes);
}

static void write_out(vcd *self)
{
    if (self->used > 0)
        (void)fwrite(self->text, 1, self->used, self->out);
    self->used = 0;
}

/* Writes a time, unless it is the last one. */
static char *put_time(vcd *self, char *at, uint64_t units)
{
    if (units == self->units)
        return at;
    self->units = units;
    *at++ = '#';
    at = chars_decimal(at, units);
    *at++ = '\n';
    return at;
}

/* Returns a moment, `at` after a tick, in units, rounded down. */
static uint64_t units_of(const vcd *self, uint64_t tick, cw_span at)
{
    const uint64_t per_tick = TICK_PS / LEAST_PS;
    const uint64_t behind = at ? bit_moment_units(at, (unsigned)per_tick) : 0;
    return (tick * per_tick + behind) / (self->unit_ps / LEAST_PS);
}

/* Makes room for a change, and writes the time of the first one at a tick. */
static void begin_tick(vcd *self, uint64_t tick)
{
    if (TEXT_BYTES - self->used < CHANGE_MAX)
        write_out(self);
    if (tick == self->time)
        return;
    self->time = tick;
    char *const at = self->text + self->used;
    self->used += (size_t)(put_time(self, at, units_of(self, tick, 0)) - at);
}

/* Returns the place for a change, behind its time. */
static inline char *begin_change(vcd *self, uint64_t tick)
{
    if (TEXT_BYTES - self->used < CHANGE_MAX || tick != self->time)
        begin_tick(self, tick);
    return self->text + self->used;
}

/* Writes a time inside a bit. The changes that follow have no tick. */
static void write_time_inside(vcd *self, uint64_t units)
{
    if (TEXT_BYTES - self->used < CHANGE_MAX)
        write_out(self);
    self->used = (size_t)(put_time(self, self->text + self->used, units) - self->text);
    self->time = CW_NEVER;
}

/* Ends one or several changes at `at`. */
static inline void end_changes(vcd *self, const char *at)
{
    self->used = (size_t)(at - self->text);
    assert(self->used <= TEXT_BYTES);
}

/* Ends a change at `at`, where its line is still open. */
static void end_change(vcd *self, char *at)
{
    *at++ = '\n';
    end_changes(self, at);
}

static void write_time(vcd *self, uint64_t tick)
{
    end_changes(self, begin_change(self, tick));
}

static void write_word(vcd *self, const char *word)
{
    end_change(self, chars_text(begin_change(self, self->time), word));
}

/* Writes a real number, which stands for an integer: see the file's head. */
static void write_number(vcd *self, uint64_t tick, char id, size_t node, unsigned value)
{
    char *at = begin_change(self, tick);
    *at++ = 'r';
    at = chars_decimal(at, value);
    *at++ = ' ';
    end_change(self, put_id(at, id, node));
}

/* Writes a text. Texts have no blanks. */
static void vcd_write_text(vcd *self, uint64_t tick, const char *text, char id, size_t node)
{
    char *at = begin_change(self, tick);
    *at++ = 's';
    at = chars_text(at, text);
    *at++ = ' ';
    end_change(self, put_id(at, id, node));
}

/* Writes a level of the whole bus. */
static inline void write_level(vcd *self, uint64_t tick, bool *before, bool level, char id)
{
    if (self->begun && *before == level)
        return;
    char *at = begin_change(self, tick);
    *at++ = level ? '1' : '0';
    *at++ = id;
    end_change(self, at);
    *before = level;
}

/* Writes a level of the nodes that have another one. */
static void write_changed(vcd *self, uint64_t tick, const vcd_levels *l, uint64_t changed)
{
    const uint64_t levels = l->now;
    const uint64_t high = levels & self->all;
    char *at = begin_change(self, tick); /* has room for all nodes */
    if (changed == self->all && (high == 0 || high == self->all)) {
        end_changes(self, chars_copy(at, l->lines[high != 0], l->length));
        return;
    }
    for (; changed; changed &= changed - 1) {
        unsigned i = lowest(changed);
        *at++ = levels >> i & 1u ? '1' : '0';
        at = put_id(at, l->id, i);
        *at++ = '\n';
    }
    end_changes(self, at);
}

/* Writes a level of each node. */
static inline void write_levels(vcd *self, uint64_t tick, vcd_levels *l, uint64_t levels)
{
    const uint64_t changed = (self->begun ? l->now ^ levels : UINT64_MAX) & self->all;
    l->now = levels;
    if (changed)
        write_changed(self, tick, l, changed);
}

/* Returns a mark; while it stays the same, so does the part. The part of some phases depends on a
 * level, too. */
static inline uint32_t mark_of(const cw_place *place, cw_mac_phase phase)
{
    uint32_t byte = place->field == CW_FIELD_DATA ? place->index / 8u : 0;
    return bit_part_waits(phase) ? NO_MARK
                                 : (uint32_t)phase << 16 | (uint32_t)place->field << 8 | byte;
}

/* Finds the text of a part. */
static void print_part(vcd *self, uint32_t mark, const cw_place *place, cw_mac_phase phase,
                       bool sampled)
{
    self->printed_mark = mark;
    self->printed_part = bit_part_at(place, phase, sampled);
    self->printed[0] = 's';
    bit_part_print(self->printed + 1, &self->printed_part);
    self->printed_length = strlen(self->printed);
}

/* Writes the part of a node if it has changed. Its text is often that of the node before. */
static inline void write_part(vcd *self, uint64_t tick, unsigned node, const cw_place *place,
                              cw_mac_phase phase, bool sampled)
{
    vcd_node *n = &self->nodes[node];
    if (n->mark == NO_MARK || n->mark != self->printed_mark)
        print_part(self, n->mark, place, phase, sampled);
    if (self->begun && bit_part_same(&n->part, &self->printed_part))
        return;
    n->part = self->printed_part;
    char *at = begin_change(self, tick);
    memcpy(at, self->printed, PART_MAX); /* whole pieces cost less than exact lengths */
    at += self->printed_length;
    memcpy(at, n->part_id, PART_ID_MAX);
    end_changes(self, at + n->part_id_length);
}

/* Writes an error in its bit, and the end of one in the bit behind it. */
static void write_error(vcd *self, uint64_t tick, size_t node)
{
    vcd_node *n = &self->nodes[node];
    if (!self->begun || n->error != n->error_now)
        vcd_write_text(self, tick, n->error_now == NO_ERROR ? "" : cw_error_type_name(n->error_now),
                       'e', node);
    n->error = n->error_now;
    n->error_now = NO_ERROR;
    if (n->error == NO_ERROR)
        self->errors &= ~(UINT64_C(1) << node);
}

/* Writes the part and the error of each node that may have changed. */
static void write_parts(vcd *self, const cw_bit_view *bit, uint64_t parts)
{
    for (uint64_t rest = (parts | self->errors) & self->all; rest; rest &= rest - 1) {
        unsigned i = lowest(rest);
        if (parts >> i & 1u)
            write_part(self, bit->start, i, &bit->nodes[i].place, bit->nodes[i].phase,
                       bit->sampled >> i & 1u);
        if (self->errors >> i & 1u)
            write_error(self, bit->start, i);
    }
}

/* Writes the rules. Consecutive bits of the same rules are written again, for a marker each. */
static void write_rules(vcd *self, uint64_t tick)
{
    bool now = self->rules_now[0] != '\0';
    if (!self->begun || now || self->rule) {
        char *at = begin_change(self, tick);
        *at++ = 's';
        at = chars_text(at, self->rules_now);
        end_change(self, chars_text(at, " n"));
    }
    self->rule = now;
    if (now || self->rules_next[0] != '\0')
        memcpy(self->rules_now, self->rules_next, sizeof self->rules_now);
    self->rules_next[0] = '\0';
}

/* Writes all states and counters, with which a dump begins. */
static void write_states(vcd *self, uint64_t tick)
{
    for (size_t i = 0; i < self->node_count; i++) {
        const vcd_node *n = &self->nodes[i];
        vcd_write_text(self, tick, cw_state_name(n->state), 'q', i);
        write_number(self, tick, 'c', i, n->tec);
        write_number(self, tick, 'k', i, n->rec);
    }
}

/* Writes what has changed at the end of a bit, of a set of nodes. */
static void write_state_changes(vcd *self, const cw_bit_view *bit, uint64_t nodes)
{
    for (; nodes; nodes &= nodes - 1) {
        unsigned i = lowest(nodes);
        vcd_node *n = &self->nodes[i];
        const cw_bit_node *now = &bit->nodes[i];
        if (n->state != now->state)
            vcd_write_text(self, bit->end, cw_state_name(now->state), 'q', i);
        if (n->tec != now->tec)
            write_number(self, bit->end, 'c', i, now->tec);
        if (n->rec != now->rec)
            write_number(self, bit->end, 'k', i, now->rec);
        n->state = now->state;
        n->tec = now->tec;
        n->rec = now->rec;
    }
}

/* ---- Inside of bits -------------------------------------------------------------------------- */

/* Writes a level of a node at the time that was written last. */
static void write_bit(vcd *self, char id, unsigned node, bool level)
{
    char *at = begin_change(self, self->time);
    *at++ = level ? '1' : '0';
    end_change(self, put_id(at, id, node));
}

/* Writes the word of a synchronisation. Its identifier ends in y, as there is no other letter
 * left. */
static void write_sync(vcd *self, unsigned node, const char *text)
{
    char *at = begin_change(self, self->time);
    *at++ = 's';
    at = chars_text(at, text);
    *at++ = ' ';
    at = put_id(at, 'f', node);
    *at++ = 'y';
    end_change(self, at);
}

/* Writes the phase error of a synchronisation, in time quanta. */
static void write_phase_error(vcd *self, unsigned node, int error)
{
    char *at = begin_change(self, self->time);
    *at++ = 'r';
    if (error < 0)
        *at++ = '-';
    at = chars_decimal(at, (uint64_t)(error < 0 ? -error : error));
    *at++ = ' ';
    end_change(self, put_id(at, 'p', node));
}

/* Writes all values at the start of the dump. */
static void begin_inside(vcd *self, const cw_bit_view *bit)
{
    for (unsigned i = 0; i < bit->node_count && !self->inside->levels_only; i++) {
        write_bit(self, 'u', i, false);
        write_bit(self, 'a', i, false);
        write_sync(self, i, "");
        write_phase_error(self, i, 0);
    }
}

/* Returns true when a set has a node, and takes it out. */
static bool take_out(uint64_t *nodes, unsigned node)
{
    const uint64_t self = UINT64_C(1) << node;
    const bool in = *nodes & self;
    *nodes &= ~self;
    return in;
}

/* A sample point and a synchronisation are shown up to the next quantum. */
static void write_quantum(vcd *self, unsigned node)
{
    inside *in = self->inside;
    in->quanta ^= UINT64_C(1) << node;
    write_bit(self, 'u', node, in->quanta >> node & 1u);
    if (take_out(&in->sampling, node))
        write_bit(self, 'a', node, false);
    if (take_out(&in->synced, node))
        write_sync(self, node, "");
}

static void put_level(uint64_t *levels, unsigned node, bool level)
{
    const uint64_t self = UINT64_C(1) << node;
    *levels = level ? *levels | self : *levels & ~self;
}

static void write_drive(vcd *self, const cw_mark *m)
{
    uint64_t driven = self->driven.now;
    put_level(&driven, m->node, m->level);
    write_levels(self, self->time, &self->driven, driven);
}

/* All wires of a partitioned bus are shown as one. */
static void write_wire(vcd *self, const cw_bit_view *bit, const cw_mark *m)
{
    uint64_t *wires = &self->inside->wires;
    for (unsigned i = 0; i < bit->node_count; i++)
        if (bit->nodes[i].wire == bit->nodes[m->node].wire)
            put_level(wires, i, m->level);
    write_level(self, self->time, &self->wire, *wires == UINT64_MAX, 'w');
}

/* Writes the place of a node in its bit: known at its start, or else at its sample point. */
static void write_place(vcd *self, const cw_mark *m, bool sampled)
{
    uint64_t stuff = self->stuff.now;
    put_level(&stuff, m->node, m->place.stuff);
    write_levels(self, self->time, &self->stuff, stuff);
    self->nodes[m->node].mark = mark_of(&m->place, (cw_mac_phase)m->phase);
    write_part(self, self->time, m->node, &m->place, (cw_mac_phase)m->phase, sampled);
}

static void write_mark(vcd *self, const cw_bit_view *bit, const cw_mark *m)
{
    inside *in = self->inside;
    uint64_t sampled = self->sampled.now;
    switch (m->kind) {
    case CW_MARK_BEGIN:
        if (!bit_part_waits((cw_mac_phase)m->phase))
            write_place(self, m, CW_RECESSIVE);
        break;
    case CW_MARK_DRIVE:
        write_drive(self, m);
        break;
    case CW_MARK_WIRE:
        write_wire(self, bit, m);
        break;
    case CW_MARK_LATE_SAMPLE:
        break;
    case CW_MARK_SAMPLE:
        put_level(&sampled, m->node, m->level);
        write_levels(self, self->time, &self->sampled, sampled);
        if (bit_part_waits((cw_mac_phase)m->phase))
            write_place(self, m, m->level);
        if (in->levels_only)
            break;
        write_bit(self, 'a', m->node, true);
        put_level(&in->sampling, m->node, true);
        break;
    case CW_MARK_HARD_SYNC:
    case CW_MARK_RESYNC:
        if (in->levels_only)
            break;
        write_sync(self, m->node, m->kind == CW_MARK_RESYNC ? "resync" : "hard");
        write_phase_error(self, m->node, m->phase_error);
        put_level(&in->synced, m->node, true);
        break;
    }
}

/* Writes what nodes do by their own clocks. All that changes at the start of the bit time has been
 * written. Bit times that may be left out write nothing, so that idle time costs nothing. */
static void write_inside(vcd *self, const cw_bit_view *bit)
{
    bit_walk *walk = &self->inside->walk;
    if (bit_rests(bit)) {
        memset(&self->inside->clocks, 0, sizeof self->inside->clocks);
        return;
    }
    bit_moment m;
    bit_walk_begin(walk, &self->inside->clocks, bit);
    while (bit_walk_next(walk, &m)) {
        if (self->inside->levels_only && !m.mark)
            continue;
        write_time_inside(self, units_of(self, bit->start, m.at));
        if (m.mark)
            write_mark(self, bit, m.mark);
        else
            write_quantum(self, m.node);
    }
}

/* Writes levels at the start of a bit time. Samples change inside it, but in bits that are
 * common to all nodes, which have no marks. */
static void write_levels_at_start(vcd *self, const cw_bit_view *bit)
{
    const bool marked = self->inside && self->begun && bit->mark_count > 0;
    if (self->inside)
        self->inside->wires = bit->wire;
    write_level(self, bit->start, &self->wire, bit->wire == UINT64_MAX, 'w');
    write_levels(self, bit->start, &self->driven, bit->driven);
    write_levels(self, bit->start, &self->sampled, marked ? self->sampled.now : bit->sampled);
}

/* ---- Bits and events ------------------------------------------------------------------------- */

/* Nodes that may have changes in a bit; each of these sets is computed for every bit. */
typedef struct changes {
    uint64_t stuff; /* they are in a stuff bit */
    uint64_t parts;
    uint64_t states;
} changes;

/* Finds the place of nodes that have the same one. Nothing is new when they were so before, too. */
static void find_alike(vcd *self, changes *found, const cw_bit_view *bit)
{
    const cw_bit_node *one = &bit->nodes[lowest(bit->alike)];
    const uint32_t mark = mark_of(&one->place, one->phase);
    const bool same = bit->alike == self->alike && mark == self->alike_mark && mark != NO_MARK;
    self->alike_mark = mark;
    found->stuff |= one->place.stuff ? bit->alike : 0;
    found->parts |= same ? 0 : bit->alike;
    for (uint64_t rest = same ? 0 : bit->alike; rest; rest &= rest - 1)
        self->nodes[lowest(rest)].mark = mark;
}

/* Finds places that all nodes enter at the start of the bit. */
static void find_places(vcd *self, changes *found, const cw_bit_view *bit)
{
    if (bit->alike)
        find_alike(self, found, bit);
    self->alike = bit->alike; /* 0: when they are alike again, they may have changed */
    for (uint64_t rest = self->all & ~bit->alike; rest; rest &= rest - 1) {
        unsigned i = lowest(rest);
        const uint32_t mark = mark_of(&bit->nodes[i].place, bit->nodes[i].phase);
        bool same = mark == self->nodes[i].mark && mark != NO_MARK;
        self->nodes[i].mark = mark;
        found->stuff |= (uint64_t)bit->nodes[i].place.stuff << i;
        found->parts |= (uint64_t)!same << i;
    }
}

/* Returns true when all that marks say is written, and the start of the bit says nothing. */
static bool goes_by_marks(const vcd *self, const cw_bit_view *bit)
{
    return self->inside && self->begun && bit->mark_count > 0 && !bit_rests(bit);
}

/* Returns the nodes whose states or counters have changed. */
static uint64_t find_states(const vcd *self, const cw_bit_view *bit)
{
    uint64_t changed = 0;
    for (unsigned i = 0; i < bit->node_count; i++) {
        const vcd_node *n = &self->nodes[i];
        const cw_bit_node *now = &bit->nodes[i];
        const unsigned counters = (unsigned)(n->tec ^ now->tec) | (unsigned)(n->rec ^ now->rec);
        if (counters | ((unsigned)n->state ^ (unsigned)now->state))
            changed |= UINT64_C(1) << i;
    }
    return changed;
}

/* Finds what may have changed with the bit: few nodes in most bits, so that others cost nothing. */
static changes find_changes(vcd *self, const cw_bit_view *bit)
{
    changes found = {.stuff = self->stuff.now};
    if (goes_by_marks(self, bit)) {
        self->alike = 0;
    } else {
        found.stuff = 0;
        find_places(self, &found, bit);
    }
    if (!bit->steady)
        found.states = find_states(self, bit);
    return found;
}

void vcd_bit(vcd *self, const cw_bit_view *bit)
{
    uint64_t start = bit->start;
    bool fault = bit->tx_faults | bit->wire_faults | bit->rx_faults || self->rules_now[0] != '\0';
    assert(bit->node_count == self->node_count);
    const changes found = find_changes(self, bit);
    if (!self->begun) {
        write_time(self, start);
        write_word(self, "$dumpvars");
    }
    write_levels_at_start(self, bit);
    write_levels(self, start, &self->stuff, found.stuff);
    write_parts(self, bit, found.parts);
    write_level(self, start, &self->fault, fault, 'm');
    write_rules(self, start);
    if (!self->begun) {
        write_states(self, start);
        if (self->inside)
            begin_inside(self, bit);
        write_word(self, "$end");
        self->begun = true;
    }
    if (self->inside)
        write_inside(self, bit);
    write_state_changes(self, bit, found.states);
    self->end = bit->end;
}

/* Adds a rule; a + stands for rules that do not fit. */
static void add_rule(char text[RULES_TEXT_MAX], const char *name)
{
    size_t used = strlen(text);
    size_t length = strlen(name);
    if (used + 1 + length + 2 <= RULES_TEXT_MAX)
        snprintf(text + used, RULES_TEXT_MAX - used, "%s%s", used ? "+" : "", name);
    else if (text[used - 1] != '+')
        snprintf(text + used, RULES_TEXT_MAX - used, "+");
}

/* Notes a rule in its bit: one that acts behind the bit is shown in the next one. */
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
    self->errors |= event->nodes;
}

void vcd_flush(vcd *self)
{
    write_out(self);
}

void vcd_close(vcd *self)
{
    if (!self)
        return;
    if (self->begun)
        write_time(self, self->end);
    write_out(self);
    free(self->inside);
    free(self);
}
