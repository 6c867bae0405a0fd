/* SPDX-License-Identifier: MIT
 *
 * failure.h - errors at random: how likely it is that a message comes too late.
 *
 * After Navet, Song and Simonot, "Worst-case deadline failure probability in real-time applications
 * distributed over CAN" (2000): errors come as a Poisson process. A message survives a number of
 * them in its period, whenever they come.
 */
#ifndef CANWIRE_CLI_ANALYSE_FAILURE_H
#define CANWIRE_CLI_ANALYSE_FAILURE_H

#include "cli/analyse/response.h"

#define FAILURE_ERRORS_MAX 64u

/* Finds the errors that each message survives in the worst case, up to FAILURE_ERRORS_MAX. So it
 * comes before its period ends. -1: it is late without any. */
void failure_find(const response_bus *bus, int *survived);

/* Returns the probability of more errors than that in a time in which `mean` of them are
 * expected. */
double failure_probability(int survived, double mean);

/* Returns the probability that a frame of that many bits is destroyed, with errors of single
 * bits. */
double failure_of_frame(unsigned bits, double per_bit);

#endif
