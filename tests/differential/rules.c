/* SPDX-License-Identifier: MIT
 *
 * rules.c - random fault rules and settings: realistic ones, and absurd ones.
 */
#include "differential.h"

#include <string.h>

/* ---- Small things ---------------------------------------------------------------------------- */

uint64_t diff_random_nodes(diff_maker *m)
{
    uint64_t all = UINT64_MAX >> (CW_NODES_MAX - m->nodes);
    uint64_t one = UINT64_C(1) << diff_below(&m->random, m->nodes);
    if (diff_chance(&m->random, 600))
        return one;
    return (diff_draw(&m->random) & all) | one;
}

uint64_t diff_random_ticks(diff_maker *m, uint64_t bits_least, uint64_t bits_most)
{
    static const uint64_t ends_of_time[] = {CW_NEVER, CW_NEVER - 1, CW_NEVER / 2};
    uint64_t ticks = diff_magnitude(&m->random, bits_least, bits_most) * m->bit;
    if (diff_chance(&m->random, 5))
        return ends_of_time[diff_below(&m->random, 3)];
    return diff_chance(&m->random, 500) ? ticks : ticks + diff_below(&m->random, m->bit);
}

unsigned diff_random_modes(diff_maker *m)
{
    unsigned modes = 0;
    if (diff_chance(&m->random, 150))
        modes |= CW_MODE_ONE_SHOT;
    if (diff_chance(&m->random, 70))
        modes |= CW_MODE_LISTEN_ONLY;
    if (diff_chance(&m->random, 150))
        modes |= CW_MODE_LOOPBACK;
    if (diff_chance(&m->random, 100))
        modes |= CW_MODE_PRESUME_ACK;
    if (diff_chance(&m->random, 200))
        modes |= CW_MODE_BERR_REPORTING;
    if (diff_chance(&m->random, 120))
        modes |= CW_MODE_TIME_TRIGGERED;
    if (m->fd && diff_chance(&m->random, 70))
        modes |= CW_MODE_RESTRICTED;
    return modes;
}

/* Makes the clock of a bit timing too slow or too fast, by one part in so many at most. */
static void make_inexact(diff_random *r, cw_bit_timing *t, unsigned parts)
{
    const cw_span off = (cw_span)diff_magnitude(r, 1, (uint64_t)t->quantum / parts);
    t->quantum += diff_chance(r, 500) ? off : -off;
}

/* Draws a bit timing whose bits are nearly those of the bus. */
static cw_bit_timing random_bit_timing(diff_maker *m)
{
    diff_random *r = &m->random;
    cw_bit_timing t = {.prop_seg = (uint16_t)diff_between(r, 1, 8),
                       .phase_seg1 = (uint16_t)diff_between(r, 1, 8),
                       .phase_seg2 = (uint16_t)diff_between(r, 2, 8), .sjw = 1,
                       .triple_sampling = diff_chance(r, 100)};
    t.quantum = (cw_span)m->bit * CW_TICK / cw_bit_timing_quanta(&t);
    make_inexact(r, &t, 20);
    return t;
}

/* Returns the bit timing of all nodes, by a clock that can serve for two rates. */
static cw_bit_timing random_clock(diff_maker *m)
{
    cw_bit_timing t = m->common.bit;
    make_inexact(&m->random, &t, 200);
    return t;
}

/* Draws a bit timing by a clock that differs by 1000 ppm at most, and a short way. */
static void random_near_timing(diff_maker *m, cw_node_timing *timing)
{
    diff_random *r = &m->random;
    const uint64_t bit = m->bit * (uint64_t)CW_TICK;
    const unsigned quanta = (unsigned)diff_magnitude(r, 8, 200);
    const uint16_t behind = (uint16_t)diff_between(r, quanta / 8 + 1, quanta / 3);
    timing->bit = (cw_bit_timing){.prop_seg = (uint16_t)(quanta - 2u * behind - 1),
                                  .phase_seg1 = behind, .phase_seg2 = behind,
                                  .sjw = (uint16_t)(behind - diff_below(r, behind)),
                                  .triple_sampling = diff_chance(r, 50)};
    timing->bit.quantum = (cw_span)(bit / quanta);
    make_inexact(r, &timing->bit, 1000);
    if (diff_chance(r, 300))
        timing->place = (cw_span)diff_magnitude(r, 1, bit / 20);
    if (diff_chance(r, 50))
        timing->stub = (cw_span)diff_below(r, bit / 80);
    for (unsigned level = 0; level < 2 && diff_chance(r, 150); level++) {
        timing->tx_delay[level] = (cw_span)diff_below(r, bit / 80);
        timing->rx_delay[level] = (cw_span)diff_below(r, bit / 80);
    }
}

void diff_random_timing(diff_maker *m, cw_node_timing *timing)
{
    diff_random *r = &m->random;
    if (m->near) {
        random_near_timing(m, timing);
        return;
    }
    if (diff_chance(r, 500))
        timing->bit = m->rates ? random_clock(m) : random_bit_timing(m);
    const uint64_t bit = m->bit * (uint64_t)CW_TICK;
    if (diff_chance(r, 300))
        timing->place = (cw_span)diff_below(r, bit / 3);
    for (unsigned level = 0; level < 2 && diff_chance(r, 300); level++)
        timing->tx_delay[level] = timing->rx_delay[level] = (cw_span)diff_below(r, bit / 8);
    if (diff_chance(r, 100))
        timing->ringing = (cw_span)diff_below(r, bit / 2);
}

/* Draws the place of the sample point of a bit of so many quanta. */
static cw_bit_timing random_segments(diff_random *r, unsigned quanta, unsigned most_behind)
{
    const unsigned behind = (unsigned)diff_between(r, 1, most_behind);
    const unsigned first = (unsigned)diff_between(r, 1, quanta - behind - 1);
    const unsigned less = behind < first ? behind : first;
    return (cw_bit_timing){.prop_seg = (uint16_t)(quanta - behind - first - 1),
                           .phase_seg1 = (uint16_t)first, .phase_seg2 = (uint16_t)behind,
                           .sjw = (uint16_t)diff_between(r, 1, less)};
}

/* The bit has 20 quanta at least, the one of the data phase at most half as many. */
void diff_random_rates(diff_maker *m, cw_node_timing *timing)
{
    diff_random *r = &m->random;
    cw_data_timing *data = &timing->data;
    do {
        data->brp = (uint32_t)diff_between(r, 1, m->bit / 20);
    } while (m->bit % data->brp || m->bit / data->brp > 400);
    const unsigned quanta = (unsigned)(m->bit / data->brp);
    const unsigned fast = (unsigned)diff_between(r, 8, quanta / 2);
    data->data_brp = data->brp;
    data->bit = random_segments(r, fast, fast / 2);
    timing->bit = random_segments(r, quanta, quanta / 2);
    while (timing->bit.phase_seg2 < data->bit.phase_seg2) /* each bit lasts as long as it should */
        timing->bit = random_segments(r, quanta, quanta / 2);
    timing->bit.quantum = (cw_span)data->brp * CW_TICK;
    data->tdc.mode = (cw_tdc_mode)diff_below(r, 3);
    data->tdc.tdco = (uint32_t)diff_between(r, 1, (uint64_t)fast * data->brp);
}

/* A filter is mostly of a few bits, so that frames wake the node. Half of the nodes that frames
 * wake are woken by each of a few. */
cw_sleep_settings diff_random_sleep(diff_maker *m)
{
    diff_random *r = &m->random;
    cw_sleep_settings s = {.filter_ticks = diff_random_ticks(m, 1, 6)};
    if (diff_chance(r, 300))
        s.filter_ticks = diff_random_ticks(m, 1, 20);
    if (diff_chance(r, 500))
        s.wake_ticks = diff_random_ticks(m, 1, 300);
    if (diff_chance(r, 400))
        s.frame_count = (uint8_t)diff_between(r, 1, DIFF_FILTERS);
    memcpy(s.frames, diff_filters, sizeof diff_filters);
    if (s.filter_ticks > CW_WAKE_TICKS_MAX || s.wake_ticks > CW_WAKE_TICKS_MAX)
        s.filter_ticks = s.wake_ticks = 0;
    return s;
}

static void random_sleep(diff_maker *m, cw_settings *s)
{
    diff_random *r = &m->random;
    s->which |= CW_SET_SLEEP;
    s->sleeps = diff_chance(r, 700);
    s->sleep = diff_random_sleep(m);
    if (diff_chance(r, 300))
        s->which |= (uint32_t)diff_between(r, 1, 7) * CW_SET_WAKE_FILTER;
}

cw_settings diff_random_settings(diff_maker *m)
{
    diff_random *r = &m->random;
    cw_settings s = {.which = (uint8_t)(1u << diff_below(r, 5))};
    if (diff_chance(r, 300))
        s.which = (uint8_t)diff_below(r, 32);
    s.modes_mask = (uint8_t)(diff_chance(r, 600) ? 0x1F : diff_below(r, 32));
    if (m->fd)
        s.modes_mask |= CW_MODE_RESTRICTED;
    s.modes = (uint8_t)(diff_chance(r, 500) ? 0 : diff_random_modes(m));
    s.order = diff_chance(r, 500) ? CW_ORDER_FIFO : CW_ORDER_PRIORITY;
    s.queue = (uint16_t)diff_between(r, 1, diff_chance(r, 100) ? 40 : 8);
    s.warning_limit = (uint16_t)diff_between(r, diff_chance(r, 50) ? 0 : 1, 255);
    s.restart_ticks = diff_chance(r, 300) ? 0 : diff_random_ticks(m, 1, 3000);
    if (m->clocks && m->bit <= DIFF_TIMED_BIT_MAX && diff_chance(r, 200)) {
        s.which |= CW_SET_TIMING;
        s.timing = m->rates ? random_clock(m) : random_bit_timing(m);
        if (diff_chance(r, 200)) {
            s.which |= CW_SET_UNIT;
            s.unit = CW_TICK * (cw_span)diff_magnitude(r, 1, 1000);
        }
    }
    if (m->rates && diff_chance(r, 50)) {
        s.which |= CW_SET_DATA;
        s.data = m->common.data;
        s.data.tdc.mode = (cw_tdc_mode)diff_below(r, 3);
    }
    if (m->sleeps && diff_chance(r, 600))
        random_sleep(m, &s);
    return s;
}

static void random_data(diff_random *r, uint8_t *data, unsigned length)
{
    static const uint8_t patterns[] = {0x00, 0xFF, 0x55, 0xF0, 0x1F, 0x83};
    unsigned kind = (unsigned)diff_below(r, 12);
    for (unsigned i = 0; i < length; i++)
        data[i] = kind < sizeof patterns ? patterns[kind] : (uint8_t)diff_draw(r);
}

/* Makes a frame an FD frame, or a classical one with the same identifier. */
void diff_change_format(diff_maker *m, cw_frame *frame)
{
    diff_random *r = &m->random;
    const unsigned extended = frame->flags & CW_FRAME_EXTENDED;
    unsigned flags = frame->flags & CW_FRAME_FD ? 0 : CW_FRAME_FD;
    if (flags && diff_chance(r, 500))
        flags |= CW_FRAME_BRS;
    if (flags && diff_chance(r, 100))
        flags |= CW_FRAME_ESI;
    frame->flags = (uint8_t)(extended | flags);
    if (flags && diff_chance(r, 300))
        frame->dlc = (uint8_t)diff_below(r, 16);
}

cw_frame diff_random_frame(diff_maker *m)
{
    diff_random *r = &m->random;
    cw_frame frame = m->frames[diff_below(r, m->frame_count)];
    if (diff_chance(r, 200))
        frame.dlc = (uint8_t)diff_below(r, diff_chance(r, 100) ? 16 : 9);
    if (m->fd && diff_chance(r, 400))
        diff_change_format(m, &frame);
    memset(frame.data, 0, sizeof frame.data);
    random_data(r, frame.data, cw_frame_length(&frame));
    return frame;
}

cw_frame diff_owned_frame(const diff_maker *m, const cw_frame *frame, unsigned node)
{
    cw_frame owned = *frame;
    if (m->owned)
        owned.id = (owned.id & ~(CW_NODES_MAX - 1u)) | (node % CW_NODES_MAX);
    return owned;
}

/* ---- When ------------------------------------------------------------------------------------ */

static cw_filter random_filter(diff_maker *m)
{
    diff_random *r = &m->random;
    const cw_frame *drawn = &m->frames[diff_below(r, m->frame_count)];
    const cw_frame frame = diff_owned_frame(m, drawn, (unsigned)diff_below(r, m->nodes));
    cw_filter f = {.value = cw_frame_can_id(&frame), .mask = CW_FILTER_EXTENDED_MASK};
    if (!(frame.flags & CW_FRAME_EXTENDED) && diff_chance(r, 700))
        f.mask = CW_FILTER_BASE_MASK;
    if (diff_chance(r, 300))
        f.mask |= CW_FILTER_REMOTE;
    if (diff_chance(r, 150))
        f.mask &= (uint32_t)diff_draw(r);
    f.inverted = diff_chance(r, 60);
    return f;
}

static void random_filters(diff_maker *m, cw_rule *rule)
{
    rule->filter_count = diff_chance(&m->random, 800) ? 1 : 0;
    if (diff_chance(&m->random, 80))
        rule->filter_count = (uint8_t)diff_between(&m->random, 2, CW_RULE_FILTERS_MAX);
    for (unsigned i = 0; i < rule->filter_count; i++)
        rule->filters[i] = random_filter(m);
    if (!diff_chance(&m->random, 100))
        return;
    rule->data_length = (uint8_t)diff_between(&m->random, 1, 8);
    for (unsigned i = 0; i < rule->data_length; i++)
        rule->data_mask[i] =
            diff_chance(&m->random, 300) ? (uint8_t)diff_draw(&m->random) & 0x11 : 0;
    random_data(&m->random, rule->data_value, rule->data_length);
}

static void random_window(diff_maker *m, cw_rule *rule)
{
    rule->time_end = CW_NEVER;
    if (!diff_chance(&m->random, 250) && rule->trigger != CW_TRIGGER_TIME)
        return;
    rule->time_begin = diff_below(&m->random, m->bits * m->bit);
    if (diff_chance(&m->random, 300))
        rule->time_begin -= rule->time_begin % m->bit;
    if (diff_chance(&m->random, 600))
        rule->time_end = rule->time_begin + diff_magnitude(&m->random, 1, m->bits * m->bit);
    if (rule->trigger == CW_TRIGGER_TIME && diff_chance(&m->random, 300))
        rule->again_ticks = diff_magnitude(&m->random, 1, m->bits * m->bit);
}

static void random_choice(diff_maker *m, cw_rule *rule)
{
    diff_random *r = &m->random;
    rule->probability = UINT64_MAX;
    rule->every = 1;
    if (diff_chance(r, 200))
        rule->skip = (uint32_t)diff_below(r, 6);
    if (diff_chance(r, 300))
        rule->every = (uint32_t)diff_below(r, 8);
    if (diff_chance(r, 400))
        rule->count = (uint32_t)diff_between(r, 1, 10);
    if (diff_chance(r, 300))
        rule->probability = UINT64_MAX / diff_between(r, 1, 20);
    if (diff_chance(r, 200))
        rule->hold_off = diff_random_ticks(m, 1, 2000);
    if (m->rarity > 1 && diff_chance(r, 500))
        rule->every = (uint32_t)diff_between(r, 1, 2 * m->rarity);
    else if (m->rarity > 1)
        rule->probability = UINT64_MAX / m->rarity;
}

static void random_trigger(diff_maker *m, cw_rule *rule)
{
    static const cw_trigger often[] = {CW_TRIGGER_FRAME, CW_TRIGGER_FRAME, CW_TRIGGER_FRAME,
                                       CW_TRIGGER_TIME,  CW_TRIGGER_TIME,  CW_TRIGGER_ARMED,
                                       CW_TRIGGER_ARMED, CW_TRIGGER_ERROR};
    static const uint32_t classes[] = {0x002, 0x088, 0x020, 0x004, 0x040, 0x100, 0x1EE};
    diff_random *r = &m->random;
    rule->trigger = often[diff_below(r, 8)];
    if (cw_action_needs_frame(rule->action))
        rule->trigger = CW_TRIGGER_FRAME;
    if (rule->trigger == CW_TRIGGER_ERROR)
        rule->error_mask = classes[diff_below(r, 7)];
    if (rule->trigger == CW_TRIGGER_ARMED || diff_chance(r, 60)) {
        rule->has_after = m->rules > 0 && diff_chance(r, 600);
        rule->manual = !rule->has_after || diff_chance(r, 200);
        rule->after = (uint16_t)diff_below(r, m->rules);
        rule->after_delay = diff_chance(r, 300) ? 0 : diff_random_ticks(m, 1, 500);
    }
}

/* Sets a condition of frames only. */
static void simple_when(diff_maker *m, cw_rule *rule)
{
    rule->filter_count = diff_chance(&m->random, 500);
    rule->filters[0] = random_filter(m);
    rule->time_end = CW_NEVER;
    rule->probability = UINT64_MAX;
    rule->every = (uint32_t)diff_between(&m->random, 1, 3 * m->rarity);
}

static bool is_about_making(const cw_rule *rule)
{
    return rule->action == CW_ACTION_COUNTER || rule->action == CW_ACTION_CHECKSUM;
}

static void random_when(diff_maker *m, cw_rule *rule)
{
    if (is_about_making(rule) && diff_chance(&m->random, 700)) {
        simple_when(m, rule);
        return;
    }
    if (diff_chance(&m->random, cw_action_kind_of(rule->action) == CW_KIND_POSITION ? 500 : 100)) {
        simple_when(m, rule);
        return;
    }
    random_trigger(m, rule);
    random_filters(m, rule);
    random_window(m, rule);
    random_choice(m, rule);
    if (diff_chance(&m->random, 300))
        rule->from = diff_random_nodes(m);
    if (diff_chance(&m->random, 80)) {
        rule->state_nodes = diff_random_nodes(m);
        rule->state_mask = (uint8_t)diff_between(&m->random, 1, m->sleeps ? 31 : 15);
    }
}

/* ---- Do -------------------------------------------------------------------------------------- */

/* Bits of a field; the last index may be beyond the frame at hand. */
static unsigned field_bits(cw_field field)
{
    switch (field) {
    case CW_FIELD_ID:
        return 29;
    case CW_FIELD_DLC:
        return 4;
    case CW_FIELD_DATA:
        return 64;
    case CW_FIELD_CRC:
        return 15;
    case CW_FIELD_STUFF_COUNT:
        return 4;
    case CW_FIELD_FIXED_STUFF:
        return 7;
    case CW_FIELD_ACK_SLOT:
        return 2;
    case CW_FIELD_EOF:
        return 7;
    case CW_FIELD_INTERMISSION:
        return 3;
    case CW_FIELD_SUSPEND:
    case CW_FIELD_ERROR_DELIMITER:
    case CW_FIELD_OVERLOAD_DELIMITER:
        return 8;
    case CW_FIELD_ERROR_FLAG:
    case CW_FIELD_OVERLOAD_FLAG:
        return 8;
    case CW_FIELD_STUFF:
        return 6;
    case CW_FIELD_BIT:
        return 140;
    case CW_FIELD_NONE:
    case CW_FIELD_SOF:
    case CW_FIELD_SRR:
    case CW_FIELD_IDE:
    case CW_FIELD_RTR:
    case CW_FIELD_R1:
    case CW_FIELD_R0:
    case CW_FIELD_FDF:
    case CW_FIELD_RES:
    case CW_FIELD_BRS:
    case CW_FIELD_ESI:
    case CW_FIELD_CRC_DELIMITER:
    case CW_FIELD_ACK_DELIMITER:
    case CW_FIELD_COUNT:
        break;
    }
    return 1;
}

static void random_position(diff_maker *m, cw_rule *rule)
{
    static const cw_field seldom[] = {
        CW_FIELD_SUSPEND, CW_FIELD_OVERLOAD_FLAG, CW_FIELD_OVERLOAD_DELIMITER, CW_FIELD_SRR,
        CW_FIELD_R1,      CW_FIELD_STUFF};
    static const cw_field of_fd[] = {CW_FIELD_FDF, CW_FIELD_RES, CW_FIELD_BRS, CW_FIELD_ESI,
                                     CW_FIELD_STUFF_COUNT, CW_FIELD_FIXED_STUFF,
                                     CW_FIELD_ACK_SLOT};
    diff_random *r = &m->random;
    rule->field = (cw_field)diff_between(r, CW_FIELD_SOF, CW_FIELD_COUNT - 1);
    if (diff_chance(r, 200))
        rule->field = seldom[diff_below(r, sizeof seldom / sizeof seldom[0])];
    if (m->fd && diff_chance(r, 600))
        rule->field = of_fd[diff_below(r, sizeof of_fd / sizeof of_fd[0])];
    rule->index = (uint16_t)diff_below(r, field_bits(rule->field));
    if (rule->field == CW_FIELD_BIT && diff_chance(r, 300))
        rule->index = 0; /* the SOF by its other name */
    rule->bits = (uint16_t)(diff_chance(r, 700) ? 1 : diff_magnitude(r, 1, 40));
    rule->level = diff_chance(r, 500);
    if (rule->action == CW_ACTION_FORCE && diff_chance(r, 200))
        rule->for_ticks = diff_random_ticks(m, 1, 30);
    if (rule->action == CW_ACTION_GLITCH) {
        rule->pattern_level = diff_draw(r);
        rule->pattern_mask = diff_chance(r, 500) ? UINT64_MAX : diff_draw(r);
        rule->bits = (uint16_t)diff_magnitude(r, 1, CW_PATTERN_MAX);
    }
}

/* Bits of a frame, perhaps of one that deviates or is cut short, or any bits. */
static void random_raw(diff_maker *m, cw_rule *rule)
{
    diff_random *r = &m->random;
    const cw_frame frame = m->frames[diff_below(r, m->frame_count)];
    cw_bits bits;
    rule->raw_when_idle = diff_chance(r, 700);
    for (unsigned i = 0; i < CW_RAW_MAX / 64; i++)
        rule->raw[i] = diff_draw(r);
    rule->bits = (uint16_t)diff_magnitude(r, 1, CW_RAW_MAX);
    if (diff_chance(r, 300) ||
        cw_bits_encode_deviant(&bits, &frame, (unsigned)diff_below(r, 8)) != CW_OK)
        return;
    memcpy(rule->raw, bits.level, sizeof rule->raw);
    rule->bits = bits.length;
    if (diff_chance(r, 200))
        rule->bits = (uint16_t)diff_between(r, 1, bits.length);
}

static void random_levels(diff_maker *m, cw_rule *rule)
{
    diff_random *r = &m->random;
    bool destroys = rule->action == CW_ACTION_STUCK || rule->action == CW_ACTION_DISCONNECT;
    rule->line = (cw_line)diff_below(r, 3);
    rule->level = diff_chance(r, 500);
    rule->for_ticks = diff_chance(r, 100) ? 0 : diff_random_ticks(m, 1, destroys ? 400 : 2000);
    if (rule->action == CW_ACTION_STUCK && diff_chance(r, 970)) /* parts of bits leave the grid */
        rule->for_ticks = (rule->for_ticks + m->bit - 1) / m->bit * m->bit;
    if (diff_chance(r, 400))
        rule->dominant_timeout = diff_random_ticks(m, 1, 300);
    if (rule->action == CW_ACTION_RAW)
        random_raw(m, rule);
    rule->error_rate = UINT64_MAX / diff_magnitude(r, 8, 10000000);
    if (diff_chance(r, 400)) {
        rule->burst_least = (uint16_t)diff_between(r, 1, CW_BURST_MAX);
        rule->burst_most = (uint16_t)diff_between(r, rule->burst_least, CW_BURST_MAX);
    }
    for (unsigned i = 0; i < m->nodes; i++)
        rule->group[i] = (uint8_t)diff_below(r, diff_between(r, 1, 4));
}

/* Actions for parts of bits. */
static void random_spans(diff_maker *m, cw_rule *rule)
{
    diff_random *r = &m->random;
    const uint64_t bit = m->bit * (uint64_t)CW_TICK;
    const cw_bit_timing from = random_bit_timing(m);
    rule->line = (cw_line)diff_below(r, 3);
    rule->pulse_permille = (uint16_t)diff_below(r, 1000);
    rule->pulse_offset = diff_chance(r, 500) ? 0 : (cw_span)diff_below(r, 3 * bit);
    rule->pulse_length = (cw_span)diff_between(r, 1, diff_chance(r, 500) ? bit / 4 : 3 * bit);
    rule->jitter = (cw_span)diff_between(r, 1, bit / 8);
    rule->quantum_from = from.quantum;
    rule->quantum_to = from.quantum + from.quantum / 50;
}

static void random_counters(diff_maker *m, cw_rule *rule)
{
    diff_random *r = &m->random;
    rule->tec = (uint16_t)(diff_chance(r, 300) ? CW_KEEP : diff_below(r, 264));
    rule->rec = (uint16_t)(diff_chance(r, 300) ? CW_KEEP : diff_below(r, 256));
    rule->number = (uint32_t)diff_between(r, 1, 2);
    rule->settings = diff_random_settings(m);
}

/* Sets one of eight bytes. */
static void set_one(diff_random *r, uint8_t *bytes)
{
    uint64_t place = diff_below(r, 8);
    bytes[place] = (uint8_t)diff_draw(r);
}

static void random_change(diff_maker *m, cw_change *c)
{
    diff_random *r = &m->random;
    const cw_frame *frame = &m->frames[diff_below(r, m->frame_count)];
    c->set_id = diff_chance(r, 300);
    c->set_dlc = diff_chance(r, 300);
    c->id = frame->id;
    c->id_flags = frame->flags & CW_FRAME_EXTENDED;
    c->dlc = (uint8_t)diff_below(r, diff_chance(r, 100) ? 18 : 9);
    memset(c->and_mask, 0xFF, sizeof c->and_mask);
    for (unsigned i = 0; i < 8; i++)
        if (diff_chance(r, 200))
            c->xor_mask[i] = (uint8_t)diff_draw(r);
    c->set_mask[diff_below(r, 8)] = 0xFF;
    set_one(r, c->set);
    set_one(r, c->or_mask);
    set_one(r, c->and_mask);
}

static void random_host(diff_maker *m, cw_rule *rule)
{
    rule->side = diff_chance(&m->random, 500) ? CW_SIDE_TX : CW_SIDE_RX;
    rule->for_ticks = diff_random_ticks(m, 1, 1000);
    rule->number = (uint32_t)diff_below(&m->random, 4);
    if (is_about_making(rule)) {
        rule->side = CW_SIDE_TX;
        rule->number = (uint32_t)diff_below(&m->random, CW_COUNTER_FAULTS);
    }
    random_change(m, &rule->change);
}

static void random_traffic(diff_maker *m, cw_rule *rule)
{
    diff_random *r = &m->random;
    cw_bits bits;
    rule->frame = diff_random_frame(m);
    rule->for_ticks = diff_random_ticks(m, 1, 3000);
    if (rule->action == CW_ACTION_REPLY)
        rule->for_ticks = diff_chance(r, 400) ? 0 : diff_random_ticks(m, 1, 300);
    rule->period_ticks = diff_chance(r, 300) ? 0 : diff_random_ticks(m, 20, 3000);
    rule->load_permille = (uint16_t)diff_below(r, 1001);
    if (rule->action != CW_ACTION_RAW_FRAME)
        return;
    rule->deviations = (uint8_t)diff_below(r, 8);
    rule->period_ticks = 0;
    if (cw_bits_encode_deviant(&bits, &rule->frame, rule->deviations) != CW_OK)
        rule->deviations &= CW_DEVIATES_R0;
}

static void random_do(diff_maker *m, cw_rule *rule)
{
    rule->node = (uint8_t)diff_below(&m->random, m->nodes);
    rule->nodes = diff_random_nodes(m);
    rule->bits = 1;
    static void (*const fill[])(diff_maker *, cw_rule *) = {
        [CW_KIND_POSITION] = random_position, [CW_KIND_LEVEL] = random_levels,
        [CW_KIND_CONTROL] = random_counters,  [CW_KIND_HOST] = random_host,
        [CW_KIND_TRAFFIC] = random_traffic};
    fill[cw_action_kind_of(rule->action)](m, rule);
    random_spans(m, rule);
    if (rule->action == CW_ACTION_RAMP && rule->for_ticks == 0)
        rule->for_ticks = m->bit;
    if (diff_chance(&m->random, 400))
        rule->at = diff_random_nodes(m);
}

static cw_action random_action(diff_maker *m)
{
    cw_action action;
    do
        action = (cw_action)diff_below(&m->random, CW_ACTION_COUNT);
    while (!(m->actions >> action & 1u));
    return action;
}

cw_rule diff_random_rule(diff_maker *m)
{
    cw_rule rule = {.action = random_action(m)};
    random_when(m, &rule);
    random_do(m, &rule);
    bool overload = rule.field == CW_FIELD_OVERLOAD_FLAG || /* rare, so each one has to do */
                    rule.field == CW_FIELD_OVERLOAD_DELIMITER;
    if ((rule.action == CW_ACTION_OVERLOAD && diff_chance(&m->random, 300)) || overload) {
        rule.filter_count = 0; /* after each frame */
        rule.data_length = 0;
        rule.from = 0;
    }
    return rule;
}
