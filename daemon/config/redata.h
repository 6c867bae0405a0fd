/* SPDX-License-Identifier: MIT
 *
 * redata.h - keys of a node's data phase that change while the node is in use (D10, D13).
 */
#ifndef CANWIRE_CONFIG_REDATA_H
#define CANWIRE_CONFIG_REDATA_H

#include "config/config.h"

/* Keys that are given, in the order of the documentation. */
#define CFG_DATA_BRP 0x01u
#define CFG_DATA_PROP_SEG 0x02u
#define CFG_DATA_PHASE_SEG1 0x04u
#define CFG_DATA_PHASE_SEG2 0x08u
#define CFG_DATA_SJW 0x10u
#define CFG_DATA_SAMPLE_POINT 0x20u
#define CFG_DATA_TDC_MODE 0x40u
#define CFG_DATA_TDCO 0x80u
#define CFG_DATA_TDCV 0x100u

/* Values of the keys. */
typedef struct cfg_redata {
    bit_timing bit;
    uint16_t sample_permille;
    cfg_tdc tdc;
    uint32_t tdco; /* clocks, as the next one */
    uint32_t tdcv;
} cfg_redata;

/* Returns the name of a mode of compensation; BY_RATE has none. */
const char *cfg_tdc_name(cfg_tdc tdc);

/* Returns false for a text that is no such name. */
bool cfg_parse_tdc(cfg_tdc *out, const char *text);

/* Returns the values that a node has at present. */
cfg_redata cfg_data_present(const cfg_node_time *time);

/* Changes a data phase. The node's clock and bit timing are changed already. found_anew: its
 * segments were found. Then those of the data phase are found, too, if no keys give them or the
 * clock is another one. *bit_changes becomes true when a common prescaler has changed both.
 * Otherwise it returns false with a message, and *time is undefined. */
bool cfg_change_data(cfg_node_time *time, char *problem, size_t size, bool *bit_changes,
                     const cfg *config, const cfg_redata *change, unsigned given, bool found_anew);

#endif
