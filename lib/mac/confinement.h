/* SPDX-License-Identifier: MIT
 *
 * confinement.h - the error counters of a controller and its state (rules R1..R13).
 *
 * The controller decides when a rule applies; these functions do what the rule does to the
 * counters.
 */
#ifndef CANWIRE_CONFINEMENT_H
#define CANWIRE_CONFINEMENT_H

#include "canwire.h"

#define CW_PASSIVE_LIMIT 128u /* R9 */
#define CW_BUS_OFF_LIMIT 256u /* R10 */

/* Sets TEC = REC = 0, error active; also after bus-off (R12). */
void cw_confinement_reset(cw_confinement *c);

/* Adds 8 to TEC (R3, R4, R6). */
void cw_confinement_tx_error(cw_confinement *c);

/* Adds 1 to REC by R1, or 8 by R2, R5 and R6; REC saturates. */
void cw_confinement_rx_error(cw_confinement *c, unsigned increment);

/* Lowers TEC after a successful transmission (R7). */
void cw_confinement_tx_success(cw_confinement *c);

/* Lowers REC after a successful reception (R8). */
void cw_confinement_rx_success(cw_confinement *c);

/* Presets both counters, within the limits above. */
void cw_confinement_set(cw_confinement *c, unsigned tec, unsigned rec);

/* Sets the warning limit (R13). */
void cw_confinement_set_warning_limit(cw_confinement *c, unsigned limit);

/* R9, R11: returns true when the node sends passive error flags. */
static inline bool cw_confinement_passive(const cw_confinement *c)
{
    return c->tec >= CW_PASSIVE_LIMIT || c->rec >= CW_PASSIVE_LIMIT;
}

#endif
