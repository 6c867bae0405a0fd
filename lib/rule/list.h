/* SPDX-License-Identifier: MIT
 *
 * list.h - sorted lists of rules, by their index.
 */
#ifndef CANWIRE_RULE_LIST_H
#define CANWIRE_RULE_LIST_H

#include <stdint.h>

/* Adds a rule. The list must have room for one more, and not have the rule. */
void cw_list_add(uint16_t *list, unsigned *count, unsigned rule);

/* Removes a rule. Does nothing when the list does not have it. */
void cw_list_remove(uint16_t *list, unsigned *count, unsigned rule);

#endif
