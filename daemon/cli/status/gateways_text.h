/* SPDX-License-Identifier: MIT
 *
 * gateways_text.h - prints the gateways of a rig.
 */
#ifndef CANWIRE_CLI_GATEWAYS_TEXT_H
#define CANWIRE_CLI_GATEWAYS_TEXT_H

#include <jansson.h>
#include <stdio.h>

/* Prints two lines for each gateway in the result of gateways_stats(). */
void gateways_print(FILE *out, const json_t *gateways);

#endif
