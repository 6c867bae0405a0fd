/* SPDX-License-Identifier: MIT
 *
 * test_clocks.c - a bus whose nodes have clocks of their own, against the same nodes quantum by
 * quantum (quanta.h). Random clocks, bit timings, delays and frames must give the same events at
 * the same ticks. So must ringing, pulses, flipped bits and jitter, and delays and ringing that
 * change.
 */
#include "cases.h"
#include "mac/mac.h"
#include "made_levels.h"
#include "quanta.h"

#include <inttypes.h>
#include <limits.h>

#define SEEDS 100u
#define CHANGES 12u
#define FAULTY_SEEDS 60u /* more: the variable FAULTY_SEEDS */
#define MARKED_SEEDS 40u
#define BIT_TIMES 4000u
#define FRAMES 24u  /* of each node */
#define EVENTS 20000u
#define BIT_TICKS 160u

/* ---- Random buses ---------------------------------------------------------------------------- */

static uint64_t chance;

static uint64_t draw(void)
{
    chance += 0x9E3779B97F4A7C15u;
    uint64_t x = chance;
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

/* Returns a number from least to most. */
static int64_t between(int64_t least, int64_t most)
{
    return least + (int64_t)(draw() % (uint64_t)(most - least + 1));
}

static unsigned least_of(unsigned a, unsigned b)
{
    return a < b ? a : b;
}

typedef struct scenario {
    unsigned node_count;
    cw_node_config nodes[QUANTA_NODES_MAX];
    cw_frame frames[QUANTA_NODES_MAX][FRAMES];
    unsigned frame_count[QUANTA_NODES_MAX];
    uint64_t at_tick[QUANTA_NODES_MAX][FRAMES]; /* of which on a frame can be sent */
    bool counts; /* synchronisations: then no frame passes at once */
    uint64_t seed;
    unsigned rule_count;
    cw_rule rules[QUANTA_FAULTS];
    unsigned change_count;
    struct {
        uint64_t tick; /* between two bit times of the bus */
        unsigned node;
        cw_settings settings;
        bool taken; /* by the bus: it may refuse some */
    } changes[CHANGES];
} scenario;

static scenario now_tested;

/* Draws the segments of a bit, and a quantum with which a bit lasts about BIT_TICKS. */
static cw_bit_timing draw_timing(int64_t ppm)
{
    cw_bit_timing t = {.prop_seg = (uint16_t)between(1, 8), .phase_seg1 = (uint16_t)between(1, 8),
                       .phase_seg2 = (uint16_t)between(2, 8)};
    t.sjw = (uint16_t)between(1, least_of(4, least_of(t.phase_seg1, t.phase_seg2)));
    t.quantum = CW_TICK * BIT_TICKS / cw_bit_timing_quanta(&t);
    t.quantum += t.quantum / 1000000 * between(-ppm, ppm);
    return t;
}

static void draw_delays(cw_node_timing *t, cw_span most)
{
    for (unsigned level = 0; level < 2; level++) {
        t->tx_delay[level] = between(0, most / 4);
        t->rx_delay[level] = between(0, most / 4);
    }
    if (draw() % 2) {
        t->tx_delay[1] = t->tx_delay[0];
        t->rx_delay[1] = t->rx_delay[0];
    }
    t->place = between(0, most);
    t->stub = between(0, most / 8);
}

static cw_frame draw_frame(unsigned node)
{
    cw_frame f = {.id = (uint32_t)(draw() % CW_BASE_ID_MAX) << 3, .dlc = (uint8_t)between(0, 8)};
    if (draw() % 4 == 0)
        f.flags = CW_FRAME_EXTENDED;
    f.id = (f.id | node) & (f.flags ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX);
    for (unsigned i = 0; i < 8; i++)
        f.data[i] = (uint8_t)(draw() % 3 ? 0 : draw());
    return f;
}

/* Clocks are the same, near, or far from each other; so are delays. */
static void draw_scenario(uint64_t seed)
{
    static const int64_t clocks[] = {0, 100, 1000, 3000, 50000}; /* ppm */
    static const unsigned delays[] = {0, 5, 20, 300}; /* percent of a bit */
    chance = seed;
    scenario *s = &now_tested;
    *s = (scenario){.node_count = (unsigned)between(2, QUANTA_NODES_MAX), .counts = seed % 2,
                    .seed = seed};
    const int64_t ppm = clocks[draw() % 5];
    const cw_span most = CW_TICK * BIT_TICKS / 100 * delays[draw() % 4];
    const bool same = draw() % 3, gaps = draw() % 2, one = draw() % 2;
    const unsigned sender = (unsigned)between(0, s->node_count - 1);
    const cw_bit_timing common = draw_timing(0);
    for (unsigned i = 0; i < s->node_count; i++) {
        cw_node_config *n = &s->nodes[i];
        *n = (cw_node_config){.order = CW_ORDER_FIFO, .queue = FRAMES, .warning_limit = 96};
        n->timing.bit = same ? common : draw_timing(ppm);
        n->timing.bit.quantum += n->timing.bit.quantum / 1000000 * between(-ppm, ppm);
        n->timing.bit.triple_sampling = draw() % 8 == 0;
        draw_delays(&n->timing, most);
        s->frame_count[i] = draw() % 3 ? (unsigned)between(0, FRAMES) : 0;
        if (one)
            s->frame_count[i] = i == sender ? FRAMES : 0;
        for (unsigned k = 0; k < s->frame_count[i]; k++)
            s->frames[i][k] = draw_frame(i);
        for (unsigned k = 1; gaps && k < s->frame_count[i]; k++)
            s->at_tick[i][k] = s->at_tick[i][k - 1] + (uint64_t)between(0, 600 * BIT_TICKS);
    }
}

static cw_span draw_part_of_bit(unsigned permille)
{
    return between(1, CW_TICK * BIT_TICKS / 1000 * (cw_span)permille);
}

/* Draws where a pulse acts: on the wire, for all or for some, or on a line of a node. */
static void draw_place(cw_rule *r, unsigned node_count)
{
    r->line = (cw_line[]){CW_LINE_WIRE, CW_LINE_WIRE, CW_LINE_TX, CW_LINE_RX}[draw() % 4];
    r->node = (uint8_t)(draw() % node_count);
    if (r->line == CW_LINE_WIRE && draw() % 3 == 0)
        r->at = 1 + draw() % ((UINT64_C(1) << node_count) - 1);
}

/* Some bit of the frames of one node. */
static void draw_position(cw_rule *r, unsigned node_count)
{
    r->trigger = CW_TRIGGER_FRAME;
    r->from = UINT64_C(1) << draw() % node_count;
    r->field = CW_FIELD_BIT;
    r->index = (uint16_t)between(0, 70);
    r->skip = (uint32_t)between(0, 3);
    r->every = (uint32_t)between(1, 4);
}

static void draw_window(cw_rule *r)
{
    r->trigger = CW_TRIGGER_TIME;
    r->time_begin = (uint64_t)between(0, BIT_TIMES * BIT_TICKS);
    r->time_end = draw() % 2 ? CW_NEVER
                             : r->time_begin + (uint64_t)between(1, 1000 * BIT_TICKS);
}

/* Some pulses begin or end at a sample point of the first node, to which they do not come late. */
static void draw_quanta(cw_rule *r)
{
    const cw_bit_timing *t = &now_tested.nodes[0].timing.bit;
    const unsigned to_sample = cw_bit_timing_sample_at(t);
    const unsigned length = (unsigned)between(1, to_sample);
    if (draw() % 3)
        return;
    r->from = r->trigger == CW_TRIGGER_FRAME ? 1 : 0;
    r->pulse_permille = 0;
    r->pulse_offset = (to_sample - (draw() % 2 ? length : 0)) * t->quantum;
    r->pulse_length = length * t->quantum;
}

static cw_rule draw_rule(unsigned node_count)
{
    cw_rule r = {.time_end = CW_NEVER, .every = 1, .probability = UINT64_MAX};
    const unsigned kind = draw() % 8;
    if (kind == 0) {
        r.action = CW_ACTION_JITTER;
        r.jitter = draw_part_of_bit(draw() % 2 ? 50 : 400);
        r.nodes = 1 + draw() % ((UINT64_C(1) << node_count) - 1);
        draw_window(&r);
    } else if (kind == 1) {
        r.action = CW_ACTION_FLIP;
        r.bits = (uint16_t)between(1, 3);
        draw_position(&r, node_count);
        r.at = draw() % 2 ? 0 : 1 + draw() % ((UINT64_C(1) << node_count) - 1);
    } else {
        r.action = CW_ACTION_PULSE;
        r.level = draw() % 3 == 0;
        r.pulse_offset = draw() % 2 ? draw_part_of_bit(draw() % 4 ? 1000 : 15000) : 0;
        r.pulse_permille = (uint16_t)(draw() % 2 ? draw() % 1000 : 0);
        r.pulse_length = draw_part_of_bit(draw() % 4 ? 300 : 3000);
        draw_quanta(&r);
        if (kind == 2)
            draw_window(&r);
        else
            draw_position(&r, node_count);
        draw_place(&r, node_count);
    }
    return r;
}

static int by_tick(const void *a, const void *b)
{
    const uint64_t first = *(const uint64_t *)a, second = *(const uint64_t *)b;
    return (first > second) - (first < second);
}

/* Draws changes at some times; some of them come at one time, or in bits that follow. */
static void draw_changes(scenario *s, cw_span most)
{
    uint64_t ticks[CHANGES];
    const bool ringing = draw() % 2;
    s->change_count = (unsigned)between(0, CHANGES);
    for (unsigned i = 0; i < s->change_count; i++) {
        ticks[i] = (uint64_t)between(1, BIT_TIMES - 1) * BIT_TICKS;
        if (i > 0 && draw() % 2)
            ticks[i] = ticks[i - 1] + (draw() % 3) * BIT_TICKS;
    }
    qsort(ticks, s->change_count, sizeof ticks[0], by_tick);
    for (unsigned i = 0; i < s->change_count; i++) {
        cw_node_timing t = {.place = 0};
        draw_delays(&t, most);
        s->changes[i].tick = ticks[i];
        s->changes[i].node = (unsigned)(draw() % s->node_count);
        s->changes[i].settings = (cw_settings){
            .which = (uint16_t)((draw() % 16 * CW_SET_TX_DELAY) |
                                (ringing && draw() % 2 ? CW_SET_RINGING : 0)),
            .tx_delay = {t.tx_delay[0], t.tx_delay[1]},
            .rx_delay = {t.rx_delay[0], t.rx_delay[1]},
            .place = t.place, .stub = t.stub,
            .ringing = draw() % 3 ? draw_part_of_bit(draw() % 2 ? 400 : 1500) : 0};
    }
}

/* Few errors at first, so that pulses meet frames, too, that nothing else disturbs. */
static void draw_faults(uint64_t seed)
{
    static const char *const names[QUANTA_FAULTS] = {"a", "b", "c", "d", "e", "f", "g", "h"};
    scenario *s = &now_tested;
    draw_scenario(seed);
    s->rule_count = (unsigned)between(1, QUANTA_FAULTS);
    for (unsigned i = 0; i < s->rule_count; i++) {
        s->rules[i] = draw_rule(s->node_count);
        s->rules[i].name = names[i];
    }
    for (unsigned i = 0; seed % 4 == 0 && i < s->node_count; i++)
        s->nodes[i].timing.ringing = draw() % 2 ? draw_part_of_bit(draw() % 2 ? 100 : 900) : 0;
}

/* Draws a data phase with bits of 1/8 to 1/2 of the others. */
static cw_data_timing draw_data(const cw_bit_timing *nominal)
{
    const unsigned whole = cw_bit_timing_quanta(nominal);
    cw_data_timing d = {.brp = (uint32_t)between(1, 8)};
    d.data_brp = (uint32_t)between(1, (int64_t)d.brp);
    const unsigned most = whole * d.brp / d.data_brp / 2;
    d.bit = (cw_bit_timing){.prop_seg = (uint16_t)between(0, most / 3),
                            .phase_seg1 = (uint16_t)between(1, 1 + most / 4),
                            .phase_seg2 = (uint16_t)between(1, 1 + most / 4), .sjw = 1};
    const unsigned clocks = cw_bit_timing_quanta(&d.bit) * d.data_brp;
    d.tdc.mode = (cw_tdc_mode)between(CW_TDC_OFF, CW_TDC_MANUAL);
    d.tdc.tdco = (uint32_t)between(0, clocks);
    d.tdc.tdcv = d.tdc.mode == CW_TDC_MANUAL ? (uint32_t)between(0, clocks) : 0;
    return d;
}

static void make_fd(cw_frame *f)
{
    static const uint8_t flags[] = {0, CW_FRAME_FD, CW_FRAME_FD | CW_FRAME_BRS,
                                    CW_FRAME_FD | CW_FRAME_BRS};
    f->flags |= flags[draw() % 4];
    if (f->flags & CW_FRAME_FD)
        f->dlc = (uint8_t)between(0, 15);
    for (unsigned i = 8; i < CW_FRAME_DATA_MAX; i++)
        f->data[i] = (uint8_t)(draw() % 3 ? 0 : draw());
}

static bool is_possible(const scenario *s)
{
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = (uint8_t)s->node_count,
                                  .inbox = 1, .nodes = s->nodes};
    return cw_bus_size(&config) > 0;
}

static void shorten_ways(cw_node_timing *t)
{
    t->place /= 2;
    t->stub /= 2;
    for (unsigned level = 0; level < 2; level++) {
        t->tx_delay[level] /= 2;
        t->rx_delay[level] /= 2;
    }
}

/* Most nodes have the same data phase; some know no FD frames. Half of the buses have faults. */
static void draw_rates(uint64_t seed)
{
    (seed % 2 ? draw_scenario : draw_faults)(seed);
    scenario *s = &now_tested;
    const cw_data_timing common = draw_data(&s->nodes[0].timing.bit);
    const bool others = draw() % 3 == 0;
    for (unsigned i = 0; i < s->node_count; i++) {
        cw_node_config *n = &s->nodes[i];
        n->protocol = (uint8_t)(others && draw() % 3 == 0 ? draw() % 2 : CW_FD);
        if (n->protocol != CW_FD)
            continue;
        n->timing.data = draw() % 8 ? common : draw_data(&n->timing.bit);
        for (unsigned k = 0; k < FRAMES; k++)
            make_fd(&s->frames[i][k]);
    }
    while (!is_possible(s)) /* edges are under way for too many bits of the data phase */
        for (unsigned i = 0; i < s->node_count; i++)
            shorten_ways(&s->nodes[i].timing);
    if (s->rule_count) /* so that bit times of the bus do not follow the rates */
        s->nodes[0].timing.place++;
}

/* ---- Events ---------------------------------------------------------------------------------- */

typedef struct event {
    uint64_t tick;
    unsigned node;
    cw_event_kind kind;
    uint64_t details;
} event;

typedef struct events {
    unsigned count;
    event list[EVENTS];
} events;

static events of_quanta, of_bus;

static void add_event(events *all, uint64_t tick, unsigned node, cw_event_kind kind,
                      uint64_t details)
{
    assert_true(all->count < EVENTS);
    unsigned place = all->count++;
    for (; place > 0; place--) {
        const event *before = &all->list[place - 1];
        if (before->tick < tick || (before->tick == tick && before->node < node) ||
            (before->tick == tick && before->node == node && before->kind <= kind))
            break;
        all->list[place] = *before;
    }
    all->list[place] = (event){tick, node, kind, details};
}

static uint64_t details_of_error(const cw_error *e, bool fast, unsigned tec, unsigned rec)
{
    return (uint64_t)fast << 60 | (uint64_t)e->type << 56 | (uint64_t)e->role << 52 |
           (uint64_t)e->place.field << 40 | (uint64_t)e->place.index << 32 |
           (uint64_t)e->flag << 28 | (uint64_t)tec << 12 | rec;
}

static uint64_t details_of_frame(const cw_frame *f)
{
    uint64_t sum = f->id | (uint64_t)f->flags << 32 | (uint64_t)f->dlc << 40;
    for (unsigned i = 0; i < cw_frame_length(f); i++)
        sum = sum * 31 + f->data[i];
    return sum;
}

static cw_span begin_of_bit; /* that a controller of quanta begins now */

static void note_report(const quanta *q, unsigned i)
{
    const quanta_node *n = &q->nodes[i];
    const cw_mac_report *r = &n->report;
    begin_of_bit = n->now;
    const uint64_t tick = (uint64_t)((n->now + CW_TICK - 1) / CW_TICK);
    if (r->what & CW_REPORT_ARBITRATION_LOST)
        add_event(&of_quanta, tick, i, CW_EVENT_ARBITRATION_LOST, r->lost_bit);
    if (r->what & CW_REPORT_ERROR)
        add_event(&of_quanta, tick, i, CW_EVENT_ERROR,
                  details_of_error(&r->error, r->fast, cw_mac_tec(&n->mac),
                                   cw_mac_rec(&n->mac)));
    if (r->what & CW_REPORT_EXCEPTION)
        add_event(&of_quanta, tick, i, CW_EVENT_EXCEPTION, 0);
    if (r->what & CW_REPORT_OVERLOAD)
        add_event(&of_quanta, tick, i, CW_EVENT_OVERLOAD, 0);
    if (r->what & CW_REPORT_RX)
        add_event(&of_quanta, tick, i, CW_EVENT_RX, details_of_frame(cw_mac_received(&n->mac)));
    if (r->what & CW_REPORT_TX)
        add_event(&of_quanta, tick, i, CW_EVENT_TX, n->sent);
}

static uint64_t details_of(const cw_event *e, unsigned *sent)
{
    if (e->kind == CW_EVENT_ARBITRATION_LOST)
        return e->lost_bit;
    if (e->kind == CW_EVENT_ERROR)
        return details_of_error(&e->error, e->fast, e->tec, e->rec);
    if (e->kind == CW_EVENT_RX)
        return details_of_frame(&e->frame);
    return e->kind == CW_EVENT_TX ? ++*sent : 0;
}

static void note_event(const cw_event *e)
{
    static unsigned sent[QUANTA_NODES_MAX];
    if (of_bus.count == 0)
        for (unsigned i = 0; i < QUANTA_NODES_MAX; i++)
            sent[i] = 0;
    if (e->kind == CW_EVENT_STATE || e->kind == CW_EVENT_DROP ||
        e->kind == CW_EVENT_TOLERATED || e->kind == CW_EVENT_FAULT ||
        e->kind == CW_EVENT_IMPROPER)
        return;
    for (unsigned i = 0; i < QUANTA_NODES_MAX; i++)
        if (e->nodes >> i & 1u)
            add_event(&of_bus, e->tick, i, e->kind, details_of(e, &sent[i]));
}

/* ---- Faults, quantum by quantum -------------------------------------------------------------- */

#define BIT_SPAN (CW_TICK * (cw_span)BIT_TICKS)

static uint64_t jitters_drawn[QUANTA_FAULTS];
static unsigned matches[QUANTA_FAULTS];
static unsigned bits_left[QUANTA_FAULTS];

/* Returns the begin of the first bit time of the bus at or after a tick. */
static cw_span bit_time_from(uint64_t tick)
{
    return tick == CW_NEVER ? INT64_MAX : (cw_span)((tick + BIT_TICKS - 1) / BIT_TICKS) * BIT_SPAN;
}

static int64_t jitter(const quanta *q, unsigned node)
{
    const int64_t now = q->nodes[node].now;
    int64_t late = 0;
    for (unsigned i = 0; i < now_tested.rule_count; i++) {
        const cw_rule *r = &now_tested.rules[i];
        if (r->action == CW_ACTION_JITTER && (r->nodes >> node & 1u) &&
            now >= bit_time_from(r->time_begin) && now < bit_time_from(r->time_end))
            late += (int64_t)(cw_random(now_tested.seed, r->name, jitters_drawn[i]++) %
                              ((uint64_t)r->jitter + 1));
    }
    return late;
}

/* Returns the length of a transmitter's bit by a clock that is exact (D10). */
static int64_t length_of_bit(const quanta_node *n, const cw_data_timing *data)
{
    const cw_place place = cw_mac_place(&n->mac);
    const bool switches = place.field == CW_FIELD_BRS && n->driven == CW_RECESSIVE;
    const bool after = n->fast ? place.field != CW_FIELD_CRC_DELIMITER : switches;
    const int64_t quantum = BIT_SPAN / quanta_bit(&n->nominal);
    if (!n->fast && !after)
        return BIT_SPAN;
    const int64_t fast = quantum / data->brp * data->data_brp;
    const quanta_timing *first = n->fast ? &n->data.timing : &n->nominal;
    const quanta_timing *then = after ? &n->data.timing : &n->nominal;
    return (1 + first->prop + first->seg1) * (n->fast ? fast : quantum) +
           then->seg2 * (after ? fast : quantum);
}

static void begin_pulse(const quanta *q, quanta_fault *f, const cw_rule *r, unsigned source,
                        int64_t begin, int64_t bit)
{
    const int64_t from = begin + r->pulse_offset + bit / 1000 * r->pulse_permille;
    (void)quanta_disturb(q, f, r->line == CW_LINE_TX ? r->node : source, from,
                         from + r->pulse_length);
}

/* Flipped bits are those of the transmitter, from their begin to their end. */
static void flip_bit(const quanta *q, quanta_fault *f, unsigned source, int64_t begin)
{
    (void)quanta_disturb(q, f, source, begin, INT64_MAX / 2);
}

static bool stands_at(const cw_mac *mac, const cw_rule *r)
{
    unsigned n;
    return cw_mac_role(mac) == CW_ROLE_TRANSMITTER && cw_mac_is_sending(mac) &&
           cw_mac_own_bit(mac, &n) && n == r->index;
}

static bool is_hit(const cw_rule *r, unsigned match)
{
    return match >= r->skip && (match - r->skip) % r->every == 0;
}

static void disturb(quanta *q, unsigned node)
{
    const quanta_node *n = &q->nodes[node];
    for (unsigned i = 0; i < now_tested.rule_count; i++) {
        const cw_rule *r = &now_tested.rules[i];
        quanta_fault *f = &q->faults[i];
        if (r->trigger != CW_TRIGGER_FRAME || !(r->from >> node & 1u))
            continue;
        if (r->action == CW_ACTION_FLIP && f->count > 0 &&
            f->spans[(f->count - 1) % QUANTA_SPANS].end == INT64_MAX / 2)
            f->spans[(f->count - 1) % QUANTA_SPANS].end = n->now;
        const bool hit = stands_at(&n->mac, r) && is_hit(r, matches[i]++);
        if (hit && r->action == CW_ACTION_PULSE)
            begin_pulse(q, f, r, node, n->now,
                        length_of_bit(n, &now_tested.nodes[node].timing.data));
        else if (hit)
            bits_left[i] = r->bits;
        if (bits_left[i] > 0) {
            bits_left[i]--;
            flip_bit(q, f, node, n->now);
        }
    }
}

static void set_faults(quanta *q, const scenario *s)
{
    q->fault_count = s->rule_count;
    for (unsigned i = 0; i < s->rule_count; i++) {
        const cw_rule *r = &s->rules[i];
        const unsigned self = 1u << r->node;
        const bool wire = r->line == CW_LINE_WIRE && r->at == 0;
        jitters_drawn[i] = matches[i] = bits_left[i] = 0;
        if (r->action == CW_ACTION_JITTER)
            continue;
        q->faults[i] = (quanta_fault){.inverts = r->action == CW_ACTION_FLIP, .level = r->level,
                                      .lines = r->line == CW_LINE_TX ? self : 0,
                                      .wires = wire ? UINT_MAX : 0,
                                      .samples = r->line == CW_LINE_RX ? self : (unsigned)r->at};
    }
}

/* Begins the pulses that wait for no frame. */
static void begin_pulses(quanta *q, const scenario *s)
{
    for (unsigned i = 0; i < s->rule_count; i++) {
        const cw_rule *r = &s->rules[i];
        const cw_span begin = bit_time_from(r->time_begin);
        if (r->action == CW_ACTION_PULSE && r->trigger == CW_TRIGGER_TIME &&
            q->faults[i].count == 0 && begin <= quanta_next(q) &&
            begin < bit_time_from(r->time_end))
            begin_pulse(q, &q->faults[i], r, QUANTA_NOBODY, begin, BIT_SPAN);
    }
}

/* ---- Both ------------------------------------------------------------------------------------ */

static bool next_frame(cw_frame *frame, unsigned node, unsigned number)
{
    const cw_span due = (cw_span)now_tested.at_tick[node][number % FRAMES] * CW_TICK;
    if (number >= now_tested.frame_count[node] || begin_of_bit < due)
        return false;
    *frame = now_tested.frames[node][number];
    return true;
}

static void set_delays(quanta *q, const cw_node_timing *nodes)
{
    for (unsigned a = 0; a < q->node_count; a++)
        for (unsigned b = 0; b < q->node_count; b++)
            for (unsigned level = 0; level < 2; level++) {
                const cw_node_timing *from = &nodes[a], *to = &nodes[b];
                const cw_span stubs = a == b ? 0 : from->stub + to->stub;
                const cw_span line = from->place - to->place;
                q->delay[a][b][level] = from->tx_delay[level] + to->rx_delay[level] + stubs +
                                        (line < 0 ? -line : line);
            }
}

static quanta_timing timing_of(const cw_bit_timing *t)
{
    return (quanta_timing){.quantum = t->quantum, .prop = t->prop_seg, .seg1 = t->phase_seg1,
                           .seg2 = t->phase_seg2, .sjw = t->sjw,
                           .triple = t->triple_sampling};
}

static void change_delay(cw_span delay[2], const cw_span to[2])
{
    delay[0] = to[0];
    delay[1] = to[1];
}

static void change(cw_node_timing *t, const cw_settings *s)
{
    if (s->which & CW_SET_TX_DELAY)
        change_delay(t->tx_delay, s->tx_delay);
    if (s->which & CW_SET_RX_DELAY)
        change_delay(t->rx_delay, s->rx_delay);
    if (s->which & CW_SET_PLACE)
        t->place = s->place;
    if (s->which & CW_SET_STUB)
        t->stub = s->stub;
}

/* Edges that are driven at the moment of a change are the first that have the new delays. */
static void change_delays(quanta *q, const scenario *s, cw_node_timing *nodes, unsigned *done)
{
    for (; *done < s->change_count; (*done)++) {
        if ((cw_span)s->changes[*done].tick * CW_TICK > quanta_next(q))
            return;
        if (s->changes[*done].taken)
            change(&nodes[s->changes[*done].node], &s->changes[*done].settings);
        set_delays(q, nodes);
    }
}

/* Looks after the moment of a change are the first that see another ringing. */
static void change_ringing(quanta *q, const scenario *s, unsigned *done)
{
    for (; *done < s->change_count; (*done)++) {
        const cw_span moment = (cw_span)s->changes[*done].tick * CW_TICK;
        const cw_settings *to = &s->changes[*done].settings;
        quanta_node *n = &q->nodes[s->changes[*done].node];
        if (moment >= quanta_next(q))
            return;
        if (!s->changes[*done].taken || !(to->which & CW_SET_RINGING))
            continue;
        n->ringing = to->ringing;
        n->ringing_since = moment;
    }
}

/* Quanta of both phases are whole clocks. */
static void add_data(quanta *all, const cw_node_config *node)
{
    const cw_data_timing *d = &node->timing.data;
    const cw_span quantum = node->timing.bit.quantum;
    quanta_timing timing = timing_of(d->data_brp ? &d->bit : &node->timing.bit);
    if (node->protocol != CW_FD) {
        (void)cw_mac_set_protocol(&all->nodes[all->node_count - 1].mac, node->protocol, NULL);
        return;
    }
    if (d->data_brp)
        timing.quantum = quantum * d->data_brp / d->brp;
    quanta_add_data(all, CW_FD, &timing, d->brp ? quantum / d->brp : quantum, &d->tdc);
}

static unsigned changes_taken;
static quanta q;
static cw_sync_record records[QUANTA_NODES_MAX];
static cw_sync_stats syncs_of_bus[QUANTA_NODES_MAX];

static void run_quanta(const scenario *s)
{
    memset(&q, 0, sizeof q);
    q.next_frame = next_frame;
    q.bit_ended = note_report;
    q.bit_begun = disturb;
    q.jitter = jitter;
    for (unsigned i = 0; i < s->node_count; i++) {
        const quanta_timing timing = timing_of(&s->nodes[i].timing.bit);
        quanta_add(&q, &timing, 0);
        add_data(&q, &s->nodes[i]);
        q.nodes[i].ringing = s->nodes[i].timing.ringing;
    }
    cw_node_timing nodes[QUANTA_NODES_MAX];
    unsigned delays_changed = 0, ringing_changed = 0;
    for (unsigned i = 0; i < s->node_count; i++)
        nodes[i] = s->nodes[i].timing;
    set_delays(&q, nodes);
    set_faults(&q, s);
    while (quanta_next(&q) <= (int64_t)BIT_TIMES * BIT_TICKS * CW_TICK) {
        change_delays(&q, s, nodes, &delays_changed);
        change_ringing(&q, s, &ringing_changed);
        begin_pulses(&q, s);
        if (made.wanted)
            check_made(&q, s->seed, quanta_next(&q) - 1);
        quanta_step(&q);
    }
}

static void advance(cw_bus *bus, uint64_t tick)
{
    cw_event e;
    while (made.wanted && cw_bus_tick_after(bus, 1) < tick) {
        assert_int_equal(cw_bus_advance(bus, cw_bus_tick_after(bus, 1)), CW_OK);
        note_bit(bus);
        while (cw_bus_poll(bus, &e))
            note_event(&e);
    }
    while (cw_bus_advance(bus, tick) != CW_OK)
        while (cw_bus_poll(bus, &e))
            note_event(&e);
    if (made.wanted)
        note_bit(bus);
}

static void run_bus(scenario *s)
{
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = (uint8_t)s->node_count,
                                  .inbox = QUANTA_NODES_MAX * FRAMES, .events = 8192,
                                  .nodes = s->nodes, .rules = s->rules, .seed = s->seed,
                                  .rule_count = (uint16_t)s->rule_count, .marks = made.wanted};
    FREED cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    cw_event e;
    assert_non_null(bus);
    cw_bus_set_own_clocks(bus, true);
    cw_bus_set_watching(bus, made.wanted);
    made.count = 0;
    cw_bus_set_sync_records(bus, s->counts ? records : NULL);
    for (unsigned i = 0; i < s->node_count; i++)
        for (unsigned k = 0; k < s->frame_count[i]; k++)
            assert_int_equal(cw_node_send(bus, i, &s->frames[i][k], s->at_tick[i][k]),
                             CW_OK);
    for (unsigned i = 0; i < s->change_count; i++) {
        advance(bus, s->changes[i].tick);
        s->changes[i].taken =
            cw_node_set(bus, s->changes[i].node, &s->changes[i].settings) == CW_OK;
        changes_taken += s->changes[i].taken;
    }
    advance(bus, (uint64_t)BIT_TIMES * BIT_TICKS);
    while (cw_bus_poll(bus, &e))
        note_event(&e);
    for (unsigned i = 0; s->counts && i < s->node_count; i++)
        assert_int_equal(cw_node_get_sync_stats(bus, i, &syncs_of_bus[i]), CW_OK);
}

static void write_event(const char *of, const event *e)
{
    print_error("%s: tick %" PRIu64 " node %u %s %" PRIx64 "\n", of, e->tick, e->node,
                cw_event_name(e->kind), e->details);
}

static void compare(uint64_t seed)
{
    for (unsigned i = 0; i < of_quanta.count && i < of_bus.count; i++) {
        const event *a = &of_quanta.list[i], *b = &of_bus.list[i];
        if (a->tick == b->tick && a->node == b->node && a->kind == b->kind &&
            a->details == b->details)
            continue;
        write_event("quanta", a);
        write_event("bus", b);
        fail_msg("seed %" PRIu64 ": event %u differs", seed, i);
    }
    if (of_quanta.count != of_bus.count)
        fail_msg("seed %" PRIu64 ": %u events by quanta, %u of the bus", seed, of_quanta.count,
                 of_bus.count);
}

/* The bus looks at edges when it samples: the last one may still be to come. Margins are those of
 * edges that do not overtake others. */
static unsigned compare_syncs(uint64_t seed, const scenario *s)
{
    unsigned resyncs = 0;
    for (unsigned i = 0; i < s->node_count; i++) {
        const cw_sync_stats *a = &q.nodes[i].sync, *b = &syncs_of_bus[i];
        const uint64_t by_quanta = a->hard_syncs + a->resyncs;
        const uint64_t of_it = b->hard_syncs + b->resyncs;
        if (of_it != by_quanta && of_it + 1 != by_quanta)
            fail_msg("seed %" PRIu64 " node %u: %" PRIu64 " synchronisations by quanta, %" PRIu64
                     " of the bus", seed, i, by_quanta, of_it);
        if (of_it == by_quanta && a->phase_error != b->phase_error)
            fail_msg("seed %" PRIu64 " node %u: phase error %d by quanta, %d of the bus", seed, i,
                     (int)a->phase_error_tq, (int)b->phase_error_tq);
        if (of_it == by_quanta && (a->margin ? a->margin : CW_NO_MARGIN) != b->margin)
            fail_msg("seed %" PRIu64 " node %u: margin %" PRId64 " by quanta, %" PRId64
                     " of the bus", seed, i, a->margin, b->margin);
        resyncs += (unsigned)b->resyncs;
    }
    return resyncs;
}

/* Returns true when all bits are common to all nodes, so that none synchronises. */
static bool is_on_grid(const scenario *s)
{
    const cw_node_timing *first = &s->nodes[0].timing;
    bool same = first->bit.quantum * cw_bit_timing_quanta(&first->bit) == CW_TICK * BIT_TICKS;
    for (unsigned a = 0; a < s->node_count; a++) {
        const cw_bit_timing *b = &s->nodes[a].timing.bit;
        same = same && memcmp(&first->bit, b, sizeof *b) == 0;
        for (unsigned to = 0; to < s->node_count; to++)
            same = same && q.delay[a][to][0] == 0 && q.delay[a][to][1] == 0;
    }
    return same;
}

TEST(a_bus_does_what_its_nodes_do_quantum_by_quantum)
{
    unsigned kinds[CW_EVENT_COUNT] = {0}, resyncs = 0;
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        draw_scenario(seed);
        of_quanta.count = of_bus.count = 0;
        run_quanta(&now_tested);
        run_bus(&now_tested);
        compare(seed);
        if (now_tested.counts && !is_on_grid(&now_tested))
            resyncs += compare_syncs(seed, &now_tested);
        for (unsigned i = 0; i < of_bus.count; i++)
            kinds[of_bus.list[i].kind]++;
    }
    assert_true(kinds[CW_EVENT_RX] > 1000 && kinds[CW_EVENT_TX] > 1000);
    assert_true(kinds[CW_EVENT_ERROR] > 1000 && kinds[CW_EVENT_ARBITRATION_LOST] > 1000);
    assert_true(kinds[CW_EVENT_OVERLOAD] > 10);
    assert_true(resyncs > 1000);
}

static void compare_run(void (*draws)(uint64_t seed), uint64_t seed)
{
    draws(seed);
    of_quanta.count = of_bus.count = 0;
    run_bus(&now_tested);
    run_quanta(&now_tested);
    compare(seed);
}

/* Pulses and ringing make edges where synchronisations are counted by other rules than here. */
static void compare_runs(void (*draws)(uint64_t seed))
{
    unsigned kinds[CW_EVENT_COUNT] = {0};
    const char *most = getenv("FAULTY_SEEDS");
    for (uint64_t seed = 1; seed <= (most ? strtoul(most, NULL, 10) : FAULTY_SEEDS); seed++) {
        compare_run(draws, seed);
        for (unsigned i = 0; i < of_bus.count; i++)
            kinds[of_bus.list[i].kind]++;
    }
    assert_true(kinds[CW_EVENT_RX] > 500 && kinds[CW_EVENT_TX] > 200);
    assert_true(kinds[CW_EVENT_ERROR] > 500 && kinds[CW_EVENT_ARBITRATION_LOST] > 200);
}

TEST(faults_act_at_their_times_quantum_by_quantum)
{
    compare_runs(draw_faults);
}

/* Half of the buses have faults, too. */
static void draw_ways(uint64_t seed)
{
    static const unsigned delays[] = {5, 20, 100, 400}; /* percent of a bit */
    (seed / 2 % 2 ? draw_scenario : draw_faults)(seed); /* half of either counts */
    draw_changes(&now_tested, CW_TICK * BIT_TICKS / 100 * delays[draw() % 4]);
}

TEST(delays_and_ringing_change_for_edges_to_come)
{
    changes_taken = 0;
    compare_runs(draw_ways);
    compare_run(draw_ways, 2408); /* delays change twice while a pulse is under way, and no edge */
    assert_true(changes_taken > 2 * FAULTY_SEEDS);
}

TEST(nodes_have_two_rates_quantum_by_quantum)
{
    compare_runs(draw_rates);
}

/* Levels of lines and of the wire change just when nodes and faults change them. */
TEST(marks_show_each_level_when_it_is_made)
{
    unsigned by_rules = 0;
    made.wanted = true;
    for (uint64_t seed = 1; seed <= MARKED_SEEDS; seed++) {
        (seed % 2 ? draw_faults : draw_rates)(seed);
        of_quanta.count = of_bus.count = made.checked = 0;
        run_bus(&now_tested);
        run_quanta(&now_tested);
        compare(seed);
        assert_true(made.checked > BIT_TIMES / 2);
        by_rules += made.changed_by_rules;
    }
    made.wanted = false;
    assert_true(by_rules > 1000);
}
