/* SPDX-License-Identifier: MIT
 *
 * rates.c - the two rates of a node, by the values that its host has given it.
 */
#include "state/state.h"

#include "mac/late.h"

cw_span cw_data_quantum(cw_span nominal, const cw_data_timing *data)
{
    return nominal / data->brp * data->data_brp + nominal % data->brp * data->data_brp / data->brp;
}

cw_bit_timing cw_data_bit_timing(const cw_data_timing *data, const cw_bit_timing *nominal)
{
    cw_bit_timing bit = data->data_brp ? data->bit : *nominal;
    if (data->data_brp)
        bit.quantum = cw_data_quantum(nominal->quantum, data);
    return bit;
}

cw_span cw_data_clock(const cw_data_timing *data, const cw_bit_timing *nominal)
{
    return data->data_brp ? nominal->quantum / data->brp : nominal->quantum;
}

void cw_timed_set_data(cw_bus *bus, unsigned i, const cw_data_timing *data)
{
    cw_timed_rates *r = &bus->timed.rates[i];
    cw_fd_part *fd = bus->nodes[i].mac.fd;
    r->given = *data;
    r->data = cw_data_bit_timing(data, &r->nominal);
    cw_late_change(&r->late, &data->tdc, cw_data_clock(data, &r->nominal));
    r->stats.tdcv = cw_late_delay(&r->late);
    if (fd)
        fd->compares_late = data->tdc.mode != CW_TDC_OFF;
}

void cw_timed_retime_rates(cw_bus *bus, unsigned i)
{
    cw_timed_rates *r = &bus->timed.rates[i];
    r->nominal = bus->timed.next_timings[i];
    cw_timed_set_data(bus, i, &r->next);
    cw_timed_set_timing(&bus->timed.nodes[i], cw_timing_at(r, r->fast));
}

uint64_t cw_fast_nodes(const cw_bus *bus)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; bus->timed.rates && bus->timed.active && i < bus->node_count; i++)
        nodes |= bus->timed.rates[i].fast && cw_mac_is_on_bus(&bus->nodes[i].mac) ? cw_node_bit(i)
                                                                                  : 0;
    return nodes;
}
