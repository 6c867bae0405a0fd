/* SPDX-License-Identifier: MIT
 *
 * data_timing.c - the data phase of each node, by the configuration and by settings (D10).
 */
#include "bus/bus_private.h"

#include "mac/late.h"

#define MOST_BRP 65536u

/* Looks at the values of a data phase by themselves; its quantum is not one of them. */
bool cw_data_timing_valid(const cw_data_timing *d)
{
    if (d->data_brp == 0)
        return true;
    cw_bit_timing bit = d->bit;
    bit.quantum = 1;
    return cw_bit_timing_valid(&bit) && d->brp >= 1 && d->brp <= MOST_BRP &&
           d->data_brp <= MOST_BRP &&
           cw_late_valid(&d->tdc, cw_bit_timing_quanta(&d->bit) * d->data_brp);
}

bool cw_has_data_rate(const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++)
        if (c->nodes[i].timing.data.data_brp)
            return true;
    return false;
}

/* Returns the length of a bit by an exact clock. */
static cw_span bit_length(const cw_bit_timing *t)
{
    return t->quantum * cw_bit_timing_quanta(t);
}

cw_span cw_data_bit(const cw_bus_config *c, unsigned i, const cw_bit_timing *nominal)
{
    const cw_bit_timing data = cw_data_bit_timing(&c->nodes[i].timing.data, nominal);
    return bit_length(&data);
}

/* Returns the data timing that counts for the host: the next one, if it has been set and not taken
 * up yet. */
static const cw_data_timing *data_timing_now(const cw_bus *bus, unsigned i)
{
    const cw_timed_rates *r = &bus->timed.rates[i];
    return bus->timed.nodes[i].retimed ? &r->next : &r->given;
}

cw_bit_timing cw_new_data_bit(const cw_bus *bus, unsigned i, const cw_bit_timing *nominal,
                              const cw_data_timing *data)
{
    return cw_data_bit_timing(data ? data : data_timing_now(bus, i), nominal);
}

void cw_note_next_data(cw_bus *bus, unsigned i, const cw_data_timing *data)
{
    bus->timed.rates[i].next = data ? *data : *data_timing_now(bus, i);
}

cw_data_timing cw_data_timing_now(const cw_bus *bus, unsigned i)
{
    return bus->timed.rates ? *data_timing_now(bus, i) : (cw_data_timing){.data_brp = 0};
}

void cw_init_rates(cw_bus *bus, unsigned i, const cw_data_timing *data,
                   const cw_bit_timing *nominal)
{
    bus->timed.rates[i].nominal = *nominal;
    bus->timed.rates[i].fast = false;
    cw_timed_set_data(bus, i, data);
}

/* ---- Bits that all nodes have in common ------------------------------------------------------ */

/* Returns true when both divide a bit in the same way. */
static bool same_bit(const cw_bit_timing *a, const cw_bit_timing *b)
{
    return a->quantum == b->quantum && cw_bit_timing_quanta(a) == cw_bit_timing_quanta(b) &&
           cw_bit_timing_sample_at(a) == cw_bit_timing_sample_at(b) && a->sjw == b->sjw &&
           a->triple_sampling == b->triple_sampling;
}

/* Returns true when a transmitter without delays compares each bit before it ends. */
static bool compares_in_time(const cw_tdc *tdc, cw_span clock, cw_span bit)
{
    const uint64_t delay = tdc->mode == CW_TDC_MANUAL ? tdc->tdcv : 0;
    return tdc->mode == CW_TDC_OFF || (cw_span)(delay + tdc->tdco) <= bit / clock;
}

/* Returns true when all changes of the rate come at ticks, and no bit is longer than a nominal
 * one. */
static bool fits_ticks(cw_fast_bits *fast, const cw_bit_timing *nominal, const cw_bit_timing *data)
{
    const cw_span bit = bit_length(nominal), data_bit = bit_length(data);
    const cw_span to_sample = nominal->quantum * cw_bit_timing_sample_at(nominal);
    const cw_span data_to_sample = data->quantum * cw_bit_timing_sample_at(data);
    const cw_span earlier = to_sample - data_to_sample, shorter = bit - data_bit;
    *fast = (cw_fast_bits){.saved = (uint32_t)(shorter / CW_TICK),
                           .saved_by_brs = (uint32_t)((shorter - earlier) / CW_TICK)};
    return shorter % CW_TICK == 0 && earlier % CW_TICK == 0 && earlier >= 0 && shorter >= earlier;
}

bool cw_rates_agree(cw_bus *bus, const cw_bit_timing *nominal)
{
    cw_bit_timing first = {.quantum = 0};
    bool agree = true;
    for (unsigned i = 0; i < bus->node_count; i++) {
        if (!bus->nodes[i].mac.fd)
            continue;
        const cw_data_timing *data = data_timing_now(bus, i);
        const cw_bit_timing bit = cw_new_data_bit(bus, i, nominal, NULL);
        agree = agree && (first.quantum == 0 || same_bit(&first, &bit)) &&
                compares_in_time(&data->tdc, cw_data_clock(data, nominal), bit_length(&bit)) &&
                fits_ticks(&bus->timed.fast, nominal, &bit);
        first = bit;
    }
    return agree;
}
