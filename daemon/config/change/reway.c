/* SPDX-License-Identifier: MIT
 *
 * reway.c - keys of a node's delays, place and ringing as texts. They change a node in use.
 */
#include "config/change/reway.h"

#include "base/text/wide.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define DELAY_MAX_NS 10000000u
#define DELAY_MAX_BITS 1024u
#define DELAY_TEXT_MAX 24u
#define FS_PER_TICK 12500000u

cw_span cfg_span_of_way(uint64_t mm, uint64_t ps_per_m)
{
    uint64_t rest;
    const wide way = wide_product(mm * ps_per_m, CW_TICK); /* mm x ps/m = fs */
    const uint64_t whole = wide_divide(&rest, way, FS_PER_TICK).low;

    return (cw_span)(whole + (rest >= FS_PER_TICK / 2));
}

static bool is_delay(const cfg_time *time)
{
    return time->ns <= DELAY_MAX_NS && time->bits <= DELAY_MAX_BITS;
}

bool cfg_parse_delay(cfg_time *out, const char *text)
{
    cfg_time read = {0};
    if (text_parse_time(&read, text) || !is_delay(&read))
        return false;
    *out = read;
    return true;
}

bool cfg_parse_delays(cfg_time out[2], const char *text)
{
    char dominant[DELAY_TEXT_MAX];
    const char *slash = strchr(text, '/');
    if (!slash) {
        if (!cfg_parse_delay(&out[0], text))
            return false;
        out[1] = out[0];
        return true;
    }
    const size_t length = (size_t)(slash - text);
    if (length >= sizeof dominant)
        return false;
    memcpy(dominant, text, length);
    dominant[length] = '\0';
    return cfg_parse_delay(&out[CW_DOMINANT], dominant) &&
           cfg_parse_delay(&out[CW_RECESSIVE], slash + 1);
}

bool cfg_parse_way(uint64_t *mm, const char *text)
{
    uint64_t read = 0;
    if (text_parse_length(&read, text) || read > CFG_LENGTH_MAX_MM)
        return false;
    *mm = read;
    return true;
}

/* ---- Texts ----------------------------------------------------------------------------------- */

void cfg_print_delay(char text[TIME_TEXT_MAX], const cfg_time *time)
{
    if (time->bits)
        (void)snprintf(text, TIME_TEXT_MAX, "%" PRIu64 "bit", time->bits);
    else
        (void)snprintf(text, TIME_TEXT_MAX, "%" PRIu64 "ns", time->ns);
}

void cfg_print_delays(char text[TIME_TEXT_MAX], const cfg_time times[2])
{
    char recessive[TIME_TEXT_MAX];
    cfg_print_delay(text, &times[CW_DOMINANT]);
    cfg_print_delay(recessive, &times[CW_RECESSIVE]);
    if (strcmp(text, recessive) == 0)
        return;
    const size_t length = strlen(text);
    (void)snprintf(text + length, TIME_TEXT_MAX - length, "/%.15s", recessive);
}

cfg_time cfg_delay_of(cw_span span)
{
    return (cfg_time){.ns = (uint64_t)((span * 25 + CW_TICK) / (2 * CW_TICK))};
}

/* ---- A change -------------------------------------------------------------------------------- */

static void change_delays(cw_span set[2], cw_span now[2], const cfg_time to[2], cw_rate rate)
{
    for (unsigned level = 0; level < 2; level++)
        set[level] = now[level] = text_time_fine(to[level], rate);
}

unsigned cfg_change_way(cfg_node_time *time, cw_settings *set, const cfg *config,
                        const cfg_way *change, unsigned given)
{
    cw_node_timing *t = &time->timing;
    if (given & CW_SET_TX_DELAY)
        change_delays(set->tx_delay, t->tx_delay, change->tx_delay, config->rate);
    if (given & CW_SET_RX_DELAY)
        change_delays(set->rx_delay, t->rx_delay, change->rx_delay, config->rate);
    if (given & CW_SET_PLACE) {
        time->position_mm = change->position_mm;
        set->place = t->place = cfg_span_of_way(change->position_mm, config->line_ps_per_m);
    }
    if (given & CW_SET_STUB) {
        time->stub_mm = change->stub_mm;
        set->stub = t->stub = cfg_span_of_way(change->stub_mm, config->line_ps_per_m);
    }
    if (given & CW_SET_RINGING)
        set->ringing = t->ringing = text_time_fine(change->ringing, config->rate);
    return given;
}
