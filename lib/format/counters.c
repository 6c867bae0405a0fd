/* SPDX-License-Identifier: MIT
 *
 * counters.c - the tables of canwire_counters.h for those who go through them.
 */
#include "canwire.h"

#include <assert.h>
#include <string.h>

#define NODE_ROW(...) CW_STAT_ROW(cw_node_stats, __VA_ARGS__)
#define BUS_ROW(...) CW_STAT_ROW(cw_bus_stats, __VA_ARGS__)
#define HOST_ROW(...) CW_STAT_ROW(cw_host_stats, __VA_ARGS__)
#define SLEEP_ROW(...) CW_STAT_ROW(cw_sleep_stats, __VA_ARGS__)

const cw_stat cw_node_counters[] = {CW_NODE_COUNTERS(NODE_ROW){.name = NULL}};
const cw_stat cw_bus_counters[] = {CW_BUS_COUNTERS(BUS_ROW){.name = NULL}};
const cw_stat cw_host_counters[] = {CW_HOST_COUNTERS(HOST_ROW){.name = NULL}};
const cw_stat cw_sleep_counters[] = {CW_SLEEP_COUNTERS(SLEEP_ROW){.name = NULL}};

const char *cw_unit_name(cw_unit unit)
{
    static const char *const names[CW_UNIT_COUNT] = {
        [CW_UNIT_FRAMES] = "frames", [CW_UNIT_BYTES] = "bytes",       [CW_UNIT_BITS] = "bits",
        [CW_UNIT_ERRORS] = "errors", [CW_UNIT_TIMES] = "times",       [CW_UNIT_TICKS] = "ticks",
        [CW_UNIT_PPM] = "10^-6",     [CW_UNIT_PERMILLE] = "permille", [CW_UNIT_PPT] = "10^-12",
        [CW_UNIT_NS] = "ns",
    };
    assert(unit < CW_UNIT_COUNT);
    return names[unit];
}

const char *cw_stat_word(const cw_stat *counter, unsigned value)
{
    assert(value < counter->count);
    return counter->form == CW_STAT_DROPS ? cw_drop_name((cw_drop)value)
                                             : cw_error_type_name((cw_error_type)value);
}

uint64_t cw_stat_value(const cw_stat *counter, const void *stats, unsigned value)
{
    const size_t offset = counter->offset + value * counter->size;
    const unsigned char *at = (const unsigned char *)stats + offset;
    uint16_t narrow;
    uint32_t middle;
    uint64_t wide;
    assert(value < counter->count);
    if (counter->size == sizeof narrow)
        return memcpy(&narrow, at, sizeof narrow), narrow;
    if (counter->size == sizeof middle)
        return memcpy(&middle, at, sizeof middle), middle;
    assert(counter->size == sizeof wide);
    return memcpy(&wide, at, sizeof wide), wide;
}

uint64_t cw_stat_sum(const cw_stat *counter, const void *stats)
{
    uint64_t sum = 0;
    for (unsigned value = 0; value < counter->count; value++)
        sum += cw_stat_value(counter, stats, value);
    return sum;
}
