/* SPDX-License-Identifier: MIT
 *
 * timed.c - one controller with its physical coding sublayer, quantum by quantum: the timed
 * test-bench interface.
 */
#include "mac/late.h"
#include "time/pcs.h"

#include <string.h>

/* ---- The two rates --------------------------------------------------------------------------- */

/* Returns the bit timing of the present rate (D10). */
static const cw_bit_timing *timing_of(const cw_timed_mac *c)
{
    return c->fast ? &c->data_timing : &c->timing;
}

/* Returns the prescaler of the present rate. */
static uint32_t brp_of(const cw_timed_mac *c)
{
    return c->fast ? c->data_brp : c->brp;
}

/* Goes on with the present bit at the other rate, at its sample point (D10). */
static void change_rate(cw_timed_mac *c)
{
    c->fast = cw_mac_is_fast(&c->mac);
    cw_pcs_change_rate(&c->pcs, timing_of(c));
    c->count = (uint16_t)cw_bit_timing_sample_at(timing_of(c));
}

bool cw_timed_mac_is_fast(const cw_timed_mac *c)
{
    return c->fast;
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

/* Begins a bit of which that many clocks have passed already, and drives its level. */
static void begin_bit(cw_timed_mac *c, unsigned passed)
{
    cw_pcs_begin_bit(&c->pcs, timing_of(c));
    c->count = (uint16_t)passed;
    c->driven = cw_mac_drive(&c->mac);
    cw_late_begin_bit(&c->late, &c->mac, c->driven, c->now);
}

cw_status cw_timed_mac_init(cw_timed_mac *c, const cw_bit_timing *timing, uint32_t brp,
                            unsigned modes, unsigned warning_limit)
{
    if (!cw_bit_timing_valid(timing) || brp == 0)
        return CW_INVALID;
    memset(c, 0, sizeof *c);
    c->timing = c->data_timing = *timing;
    c->brp = c->data_brp = brp;
    c->pcs.last_sample = CW_RECESSIVE;
    for (unsigned i = 0; i < 3; i++)
        c->seen[i] = CW_RECESSIVE;
    cw_mac_init(&c->mac, modes, warning_limit);
    begin_bit(c, 0);
    return CW_OK;
}

cw_status cw_timed_mac_set_data(cw_timed_mac *c, const cw_bit_timing *timing, uint32_t brp,
                                const cw_tdc *tdc)
{
    static const cw_tdc off = {.mode = CW_TDC_OFF};
    const cw_tdc *chosen = tdc ? tdc : &off;
    if (!cw_bit_timing_valid(timing) || brp == 0)
        return CW_INVALID;
    const uint32_t bit = cw_bit_timing_quanta(timing) * brp;
    if (!cw_late_valid(chosen, bit))
        return CW_INVALID;
    if (!c->mac.fd)
        return CW_REFUSED;
    c->data_timing = *timing;
    c->data_brp = brp;
    cw_late_init(&c->late, chosen, 1);
    c->mac.fd->compares_late = chosen->mode != CW_TDC_OFF;
    return CW_OK;
}

bool cw_timed_mac_level(const cw_timed_mac *c)
{
    return c->driven;
}

unsigned cw_timed_mac_quanta(const cw_timed_mac *c)
{
    return c->count;
}

/* ---- One quantum ----------------------------------------------------------------------------- */

/* Acts on an edge of the quantum that has just passed. Returns what happened. */
static unsigned watch_edge(cw_timed_mac *c)
{
    const bool edge = c->seen[1] == CW_RECESSIVE && c->seen[0] == CW_DOMINANT;
    const bool hard = cw_mac_synchronises_hard(&c->mac);
    if (!edge || !cw_mac_synchronises(&c->mac))
        return 0;
    const cw_edge_effect effect =
        cw_pcs_take_edge(&c->pcs, timing_of(c), c->count - 1u, c->driven, hard);
    if (effect == CW_EDGE_IGNORED)
        return 0;
    cw_mac_note_edge(&c->mac);
    if (effect == CW_EDGE_RESYNCED)
        return CW_QUANTUM_RESYNC;
    if (effect == CW_EDGE_RESTARTS) {
        c->count = 1;
        return CW_QUANTUM_HARD_SYNC;
    }
    begin_bit(c, 1); /* T12 */
    return CW_QUANTUM_BIT_ENDED | (hard ? CW_QUANTUM_HARD_SYNC : CW_QUANTUM_RESYNC);
}

/* Returns the level that the controller takes at the sample point (T7). */
static bool sampled_level(const cw_timed_mac *c)
{
    return timing_of(c)->triple_sampling ? c->seen[0] + c->seen[1] + c->seen[2] >= 2 : c->seen[0];
}

/* Samples the bit. The rate changes at this point where BRS or the CRC delimiter says so (D10). */
static void sample(cw_timed_mac *c, cw_mac_report *report)
{
    const bool level = sampled_level(c);
    cw_mac_sample(&c->mac, level, report);
    cw_pcs_sampled(&c->pcs, level);
    if (c->fast != cw_mac_is_fast(&c->mac))
        change_rate(c);
}

/* The edge comes first, then the sample, then the next bit. */
static unsigned end_quantum(cw_timed_mac *c, bool level, cw_mac_report *report)
{
    c->count++;
    c->seen[2] = c->seen[1];
    c->seen[1] = c->seen[0];
    c->seen[0] = level;
    unsigned what = watch_edge(c);
    if (!c->pcs.sampled && c->count == c->pcs.sample_at) {
        sample(c, report);
        what |= CW_QUANTUM_SAMPLED;
    }
    if (c->pcs.sampled && c->count >= c->pcs.end_at) {
        begin_bit(c, 0);
        what |= CW_QUANTUM_BIT_ENDED;
    }
    return what;
}

/* The level is seen at the end of the last of these clocks. */
static void pass(cw_timed_mac *c, uint32_t clocks, bool level)
{
    int64_t moment;
    cw_error_type error;
    c->now += clocks;
    while (cw_late_measures(&c->late, &c->mac, &moment) && moment <= c->now)
        cw_late_measure(&c->late, moment < c->now || level);
    while (cw_late_is_due(&c->late, &c->mac, &moment) && moment <= c->now)
        if (cw_late_compare_next(&c->late, level, &error))
            cw_mac_note_late_error(&c->mac, error);
}

unsigned cw_timed_mac_quantum(cw_timed_mac *c, bool level, cw_mac_report *report)
{
    pass(c, brp_of(c) - c->clocks, level);
    c->clocks = 0;
    return end_quantum(c, level, report);
}

unsigned cw_timed_mac_clock(cw_timed_mac *c, bool level, cw_mac_report *report)
{
    pass(c, 1, level);
    if (++c->clocks < brp_of(c))
        return 0;
    c->clocks = 0;
    return end_quantum(c, level, report);
}
