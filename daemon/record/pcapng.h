/* SPDX-License-Identifier: MIT
 *
 * pcapng.h - writes what happens on a bus as a capture, for Wireshark: pcapng, SocketCAN frames.
 *
 * One section with one interface a node, in the order of the configuration: if_name is the node's
 * port, else its name, if_description its name; times are nanoseconds. Packets are of
 * LINKTYPE_CAN_SOCKETCAN (227). A frame that the bus has carried is in it once, when it is over, as
 * outbound of the node that sent it; the error frames that a node's driver would give its users
 * (errframe.h), as inbound of that node, those of single bus errors in any case.
 *
 * The same input gives the same bytes on every machine. Nothing here fails by itself; the caller
 * looks at ferror(out). Each call writes whole blocks.
 */
#ifndef CANWIRE_RECORD_PCAPNG_H
#define CANWIRE_RECORD_PCAPNG_H

#include "canwire.h"
#include "config/config.h"

#include <stdio.h>

/* Begins a capture of the nodes of config. */
void pcapng_begin(FILE *out, const cfg *config);

/* Writes what there is to write of an event, which is now and then nothing. config has the nodes
 * that the capture began with; time_ns counts from 1970, or from the start of the bus. */
void pcapng_event(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns);

#endif
