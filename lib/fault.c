/* SPDX-License-Identifier: MIT
 *
 * fault.c - fault rules at work: which of them act on the bit in progress, and how.
 */
#include "fault.h"

#include "mac.h"

void cw_fault_init(cw_fault *f, const cw_rule *rule, uint64_t seed)
{
    *f = (cw_fault){.rule = *rule};
    f->rule.name = NULL; /* not ours to keep */
    if (f->rule.every == 0)
        f->rule.every = 1;
    cw_prng_init(&f->prng, seed, rule->name);
}

static bool filter_matches(const cw_filter *filter, uint32_t id)
{
    bool same = (id & filter->mask) == (filter->value & filter->mask);
    return same != filter->inverted;
}

static bool frame_matches(const cw_rule *rule, const cw_frame *frame)
{
    uint32_t id = frame->id;
    if (frame->flags & CW_FRAME_EXTENDED)
        id |= CW_FILTER_EXTENDED;
    if (frame->flags & CW_FRAME_REMOTE)
        id |= CW_FILTER_REMOTE;
    for (unsigned i = 0; i < rule->filter_count; i++)
        if (filter_matches(&rule->filters[i], id))
            return true;
    return rule->filter_count == 0;
}

static bool is_over(const cw_fault *f)
{
    return f->rule.count != 0 && f->hits >= f->rule.count;
}

void cw_fault_bind(cw_fault *f, unsigned node, const cw_frame *frame)
{
    uint64_t self = UINT64_C(1) << node;
    bool wanted = f->rule.from == 0 || (f->rule.from & self);
    f->bound &= ~self;
    if (wanted && !is_over(f) && frame_matches(&f->rule, frame))
        f->bound |= self;
}

/* The first bit of a delimiter is known by the wire: nobody sends a flag any more. */
static bool at_own_place(const cw_fault *f, const cw_mac *mac, bool wire)
{
    cw_place place = cw_mac_place(mac);
    bool delimiter = f->rule.field == CW_FIELD_ERROR_DELIMITER ||
                     f->rule.field == CW_FIELD_OVERLOAD_DELIMITER;
    if (delimiter && place.index == 0 && !wire)
        return false;
    return place.field == f->rule.field && place.index == f->rule.index;
}

/* Whether the bit in progress is the named one, seen from a transmitter the rule is bound to. */
static bool is_reached(const cw_fault *f, const cw_mac *mac, const cw_bit_context *context)
{
    unsigned n;
    switch (f->rule.field) {
    case CW_FIELD_ERROR_FLAG:
        return context->error_flag_bit == f->rule.index;
    case CW_FIELD_OVERLOAD_FLAG:
        return context->overload_flag_bit == f->rule.index;
    case CW_FIELD_INTERMISSION:
    case CW_FIELD_SUSPEND:
    case CW_FIELD_ERROR_DELIMITER:
    case CW_FIELD_OVERLOAD_DELIMITER:
        return at_own_place(f, mac, context->wire);
    case CW_FIELD_NONE:
    case CW_FIELD_SOF:
    case CW_FIELD_ID:
    case CW_FIELD_SRR:
    case CW_FIELD_IDE:
    case CW_FIELD_RTR:
    case CW_FIELD_R1:
    case CW_FIELD_R0:
    case CW_FIELD_DLC:
    case CW_FIELD_DATA:
    case CW_FIELD_CRC:
    case CW_FIELD_CRC_DELIMITER:
    case CW_FIELD_ACK_SLOT:
    case CW_FIELD_ACK_DELIMITER:
    case CW_FIELD_EOF:
    case CW_FIELD_STUFF:
    case CW_FIELD_BIT:
    case CW_FIELD_COUNT:
        break;
    }
    return cw_mac_own_bit(mac, &n) && cw_bits_is_at(&mac->tx, n, f->rule.field, f->rule.index);
}

/* A transmission is over for the rule when its node has become a receiver or is idle. */
static bool any_reached(cw_fault *f, const cw_bit_context *context)
{
    bool reached = false;
    for (unsigned node = 0; node < context->node_count; node++) {
        uint64_t self = UINT64_C(1) << node;
        const cw_mac *mac = context->macs[node];
        if (!(f->bound & self))
            continue;
        if (mac->role != CW_ROLE_TRANSMITTER)
            f->bound &= ~self;
        else if (is_reached(f, mac, context))
            reached = true;
    }
    return reached;
}

/* A match becomes a hit by time, skip, every, probability and count, in this order. */
static bool take_match(cw_fault *f, uint64_t start_tick)
{
    if (start_tick < f->rule.time_begin || start_tick >= f->rule.time_end || is_over(f))
        return false;
    if (f->matches++ < f->rule.skip)
        return false;
    if (f->passed++ % f->rule.every != 0)
        return false;
    if (f->rule.probability != UINT64_MAX && cw_prng_next(&f->prng) >= f->rule.probability)
        return false;
    f->hits++;
    return true;
}

void cw_fault_apply(cw_fault *f, cw_disturbance *out, const cw_bit_context *context)
{
    f->hit_now = f->bound != 0 && any_reached(f, context) && take_match(f, context->start_tick);
    if (f->hit_now && f->bits_left < f->rule.bits)
        f->bits_left = f->rule.bits;
    if (f->bits_left == 0)
        return;
    f->bits_left--;
    if (f->rule.at)
        out->nodes ^= f->rule.at;
    else
        out->wire = !out->wire;
}
