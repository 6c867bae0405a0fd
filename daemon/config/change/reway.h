/* SPDX-License-Identifier: MIT
 *
 * reway.h - keys of a node's delays, place and ringing as texts. They change a node in use.
 */
#ifndef CANWIRE_CONFIG_REWAY_H
#define CANWIRE_CONFIG_REWAY_H

#include "config/config.h"

#define CFG_LENGTH_MAX_MM 10000000u /* 10 km */
#define CFG_DELAY_RANGE "a time up to 10ms"
#define CFG_DELAYS_RANGE "a time up to 10ms, or two as in 120ns/180ns, to dominant and to recessive"
#define CFG_LENGTH_RANGE "a length of at most 10km"

/* Values of the keys. */
typedef struct cfg_way {
    cfg_time tx_delay[2]; /* to [CW_DOMINANT] and to [CW_RECESSIVE] */
    cfg_time rx_delay[2];
    uint64_t position_mm;
    uint64_t stub_mm;
    cfg_time ringing;
} cfg_way;

/* Read a time, one or two of them, and a length. Return false for any other text, and then change
 * nothing but delays. */
bool cfg_parse_delay(cfg_time *out, const char *text);
bool cfg_parse_delays(cfg_time out[2], const char *text);
bool cfg_parse_way(uint64_t *mm, const char *text);

/* Print what these read. */
void cfg_print_delay(char text[TIME_TEXT_MAX], const cfg_time *time);
void cfg_print_delays(char text[TIME_TEXT_MAX], const cfg_time times[2]);

/* Returns the time for a way, rounded to the nearest. */
cw_span cfg_span_of_way(uint64_t mm, uint64_t ps_per_m);

/* Returns a span in whole nanoseconds. */
cfg_time cfg_delay_of(cw_span span);

/* Changes a node, and puts what changes into settings. given: the keys, as CW_SET_*; returned. */
unsigned cfg_change_way(cfg_node_time *time, cw_settings *set, const cfg *config,
                        const cfg_way *change, unsigned given);

#endif
