/* SPDX-License-Identifier: MIT
 *
 * confinement.c - the error counters of a controller and its state (rules R1..R13).
 */
#include "mac/confinement.h"

#define REC_AFTER_PASSIVE 120u /* R8, ruling: one of the allowed 119..127 */

/* R9..R11, R13. Only a reset ends bus-off (R12). */
static void update_state(cw_confinement *c)
{
    unsigned worst = c->tec > c->rec ? c->tec : c->rec;
    if (c->state == CW_STATE_BUS_OFF || c->tec >= CW_BUS_OFF_LIMIT)
        c->state = CW_STATE_BUS_OFF;
    else if (worst >= CW_PASSIVE_LIMIT)
        c->state = CW_STATE_ERROR_PASSIVE;
    else if (worst >= c->warning_limit)
        c->state = CW_STATE_ERROR_WARNING;
    else
        c->state = CW_STATE_ERROR_ACTIVE;
}

/* Does that when a counter has fallen: from error active no state is better. */
static inline void improve_state(cw_confinement *c)
{
    if (c->state != CW_STATE_ERROR_ACTIVE)
        update_state(c);
}

void cw_confinement_set(cw_confinement *c, unsigned tec, unsigned rec)
{
    c->tec = (uint16_t)tec;
    c->rec = (uint16_t)rec;
    c->state = CW_STATE_ERROR_ACTIVE;
    update_state(c);
}

void cw_confinement_set_warning_limit(cw_confinement *c, unsigned limit)
{
    c->warning_limit = (uint16_t)limit;
    update_state(c);
}

void cw_confinement_reset(cw_confinement *c)
{
    cw_confinement_set(c, 0, 0);
}

void cw_confinement_tx_error(cw_confinement *c)
{
    if (c->frozen)
        return;
    c->tec = (uint16_t)(c->tec + 8);
    update_state(c);
}

void cw_confinement_rx_error(cw_confinement *c, unsigned increment)
{
    if (c->frozen || (c->holds_rec && c->rec >= CW_PASSIVE_LIMIT))
        return;
    unsigned rec = c->rec + increment;
    c->rec = (uint16_t)(rec < CW_REC_MAX ? rec : CW_REC_MAX);
    update_state(c);
}

void cw_confinement_tx_success(cw_confinement *c)
{
    if (c->frozen || c->tec == 0)
        return;
    c->tec--;
    improve_state(c);
}

void cw_confinement_rx_success(cw_confinement *c)
{
    if (c->frozen || c->rec == 0)
        return;
    c->rec = (uint16_t)(c->rec >= CW_PASSIVE_LIMIT ? REC_AFTER_PASSIVE : c->rec - 1u);
    improve_state(c);
}
