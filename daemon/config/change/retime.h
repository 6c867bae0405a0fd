/* SPDX-License-Identifier: MIT
 *
 * retime.h - keys of a node's bit timing and of its place as texts. They change a node that is in
 * use.
 *
 * Files, fault rules and `canwire set` share these parsers and their limits.
 */
#ifndef CANWIRE_CONFIG_RETIME_H
#define CANWIRE_CONFIG_RETIME_H

#include "base/schema.h"
#include "config/config.h"
#include "config/change/reway.h"

#define RETIME_PROBLEM_MAX 240

/* The keys. Those of the phases of a bit come first; each has the same ones in the same order. */
typedef enum retime_key {
    RETIME_SAMPLE_POINT = 0,
    RETIME_BRP,
    RETIME_PROP_SEG,
    RETIME_PHASE_SEG1,
    RETIME_PHASE_SEG2,
    RETIME_SJW,
    RETIME_DSAMPLE_POINT,
    RETIME_DBRP,
    RETIME_DPROP_SEG,
    RETIME_DPHASE_SEG1,
    RETIME_DPHASE_SEG2,
    RETIME_DSJW,
    RETIME_TDC_MODE,
    RETIME_TDCO,
    RETIME_TDCV,
    RETIME_CLOCK,
    RETIME_PPM,
    RETIME_TRIPLE_SAMPLING,
    RETIME_TX_DELAY,
    RETIME_RX_DELAY,
    RETIME_POSITION,
    RETIME_STUB,
    RETIME_RINGING,
    RETIME_KEYS
} retime_key;

#define RETIME_BIT(key) (1u << (key))

/* The keys of the first phase; those of the phase behind it are as many bits further on. */
#define RETIME_PHASE_KEYS RETIME_DSAMPLE_POINT
#define RETIME_SEGMENTS                                                                            \
    (RETIME_BIT(RETIME_BRP) | RETIME_BIT(RETIME_PROP_SEG) | RETIME_BIT(RETIME_PHASE_SEG1) |        \
     RETIME_BIT(RETIME_PHASE_SEG2))

/* Values of some keys. */
typedef struct cfg_retime {
    uint32_t given; /* RETIME_BIT() */
    cfg_phase phase[CFG_PHASES];
    int32_t ppm;
    bool triple_sampling;
    cfg_tdc tdc;
    uint32_t tdco; /* clocks, as the next one */
    uint32_t tdcv;
    cfg_way way;
} cfg_retime;

/* Returns the row of a key in cfg_node_keys, with its name (node_keys.c). */
const schema_key *cfg_retime_row(retime_key key);

/* Adds the value of a key. A wrong one returns false; the message then has the key and what is
 * allowed, and *change stays as it is. */
bool cfg_retime_put(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                    const char *text);

/* Prints the value of a key in the form that cfg_retime_put() reads. */
void cfg_retime_print(char text[TIME_TEXT_MAX], const cfg_retime *values, const schema_key *key);

/* Writes a message. Returns false, for the caller to return. */
bool cfg_refuse(char problem[RETIME_PROBLEM_MAX], const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Returns the values of all keys that a node has at present. Those of its place that are 0 are left
 * out. */
cfg_retime cfg_retime_present(const cfg_node_time *time);

/* Changes a node. *out becomes what its keys then say; its time->timing.bit stays as it was. `set`
 * gets the parts of its bit timing and of its place that change. Keys that are not given stay as
 * the configuration has them at present. A sample point finds both phases anew. A change that the
 * node's controller or the bus does not allow returns false with a message; *out and *set are then
 * undefined. */
bool cfg_retime_node(cfg_node_time *out, cw_settings *set, char problem[RETIME_PROBLEM_MAX],
                     const cfg *config, unsigned node, const cfg_retime *change);

/* Takes the segments of a phase over that are given, in the bits of the first phase. */
void cfg_take_segments(bit_timing *bit, const bit_timing *change, unsigned given);

/* ---- For the reader of configurations -------------------------------------------------------- */

#define CFG_CLOCK_DEFAULT_HZ 80000000u
#define CFG_CLOCK_RANGE "100kHz to 1GHz"
#define CFG_PPM_RANGE "a whole number of millionths from -100000 to 100000"
#define CFG_BRP_MAX 1024u
#define CFG_SEGMENT_MAX 256u
#define CFG_SJW_MAX 128u
#define CFG_TDC_CLOCKS_MAX 65535u

bool cfg_clock_valid(uint64_t hz);

/* Returns false for a text that is not CFG_PPM_RANGE. */
bool cfg_parse_ppm(int32_t *ppm, const char *text);

/* Returns the bit timing that keys say. Without a clock the quantum is the nominal one with the
 * error. */
cw_bit_timing cfg_bit_timing(const cfg_node_time *time, cw_span nominal);

/* Returns the time quantum of a node whose clock is right. */
cw_span cfg_nominal_quantum(const cfg *config, unsigned node);

/* Returns a quantum whose clock has an error in millionths. */
cw_span cfg_drifted(cw_span quantum, cw_span ppm);

#endif
