/* SPDX-License-Identifier: MIT
 *
 * timed.c - one controller with its physical coding sublayer, quantum by quantum: the timed
 * test-bench interface.
 */
#include "mac/mac.h"
#include "time/pcs.h"

#include <string.h>

static void begin_bit(cw_timed_mac *c, unsigned passed)
{
    cw_pcs_begin_bit(&c->pcs, &c->timing);
    c->count = (uint16_t)passed;
    c->driven = cw_mac_drive(&c->mac);
}

cw_status cw_timed_mac_init(cw_timed_mac *c, const cw_bit_timing *timing, uint32_t brp,
                            unsigned modes, unsigned warning_limit)
{
    if (!cw_bit_timing_valid(timing) || brp == 0)
        return CW_INVALID;
    memset(c, 0, sizeof *c);
    c->timing = *timing;
    c->brp = brp;
    c->pcs.last_sample = CW_RECESSIVE;
    for (unsigned i = 0; i < 3; i++)
        c->seen[i] = CW_RECESSIVE;
    cw_mac_init(&c->mac, modes, warning_limit);
    begin_bit(c, 0);
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

/* Acts on an edge of the quantum that has just passed. Returns what happened. */
static unsigned watch_edge(cw_timed_mac *c)
{
    const bool edge = c->seen[1] == CW_RECESSIVE && c->seen[0] == CW_DOMINANT;
    const bool hard = cw_mac_synchronises_hard(&c->mac);
    if (!edge)
        return 0;
    switch (cw_pcs_take_edge(&c->pcs, &c->timing, c->count - 1u, c->driven, hard)) {
    case CW_EDGE_IGNORED:
        return 0;
    case CW_EDGE_RESYNCED:
        return CW_QUANTUM_RESYNC;
    case CW_EDGE_RESTARTS:
        c->count = 1;
        return CW_QUANTUM_HARD_SYNC;
    case CW_EDGE_ENDS_BIT:
        break;
    }
    begin_bit(c, 1); /* T12 */
    return CW_QUANTUM_BIT_ENDED | (hard ? CW_QUANTUM_HARD_SYNC : CW_QUANTUM_RESYNC);
}

/* Returns the level that the controller takes at the sample point (T7). */
static bool sampled_level(const cw_timed_mac *c)
{
    return c->timing.triple_sampling ? c->seen[0] + c->seen[1] + c->seen[2] >= 2 : c->seen[0];
}

/* The edge comes first, then the sample, then the next bit. */
unsigned cw_timed_mac_quantum(cw_timed_mac *c, bool level, cw_mac_report *report)
{
    c->clocks = 0;
    c->count++;
    c->seen[2] = c->seen[1];
    c->seen[1] = c->seen[0];
    c->seen[0] = level;
    unsigned what = watch_edge(c);
    if (!c->pcs.sampled && c->count == c->pcs.sample_at) {
        cw_mac_sample(&c->mac, sampled_level(c), report);
        cw_pcs_sampled(&c->pcs, sampled_level(c));
        what |= CW_QUANTUM_SAMPLED;
    }
    if (c->pcs.sampled && c->count >= c->pcs.end_at) {
        begin_bit(c, 0);
        what |= CW_QUANTUM_BIT_ENDED;
    }
    return what;
}

unsigned cw_timed_mac_clock(cw_timed_mac *c, bool level, cw_mac_report *report)
{
    return ++c->clocks == c->brp ? cw_timed_mac_quantum(c, level, report) : 0;
}
