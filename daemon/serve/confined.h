/* SPDX-License-Identifier: MIT
 *
 * confined.h - what a bus asks for that the unit of the service keeps from it, without an error.
 */
#ifndef CANWIRE_SERVE_CONFINED_H
#define CANWIRE_SERVE_CONFINED_H

#include "config/config.h"

/* Warns of files and sockets that nobody else sees, and of other hosts that do not get through.
 * Does nothing outside of the service. */
void confined_warn(const cfg *config);

#endif
