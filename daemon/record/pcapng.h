/* SPDX-License-Identifier: MIT
 *
 * pcapng.h - writes the events of a bus as a capture for Wireshark: pcapng, SocketCAN frames.
 *
 * The capture has one section with one interface per node, in the order of the configuration.
 * if_name is the node's port, else its name, and if_description its name. Times are nanoseconds.
 * Packets are of LINKTYPE_CAN_SOCKETCAN (227). A frame of the bus is one packet at its end,
 * outbound of its sender. Error frames that a node's driver would give its users (errframe.h) are
 * inbound of that node. Those of single bus errors are always written.
 *
 * The same input gives the same bytes on every machine. No function reports failures; the caller
 * checks ferror(out). Each call writes whole blocks.
 */
#ifndef CANWIRE_RECORD_PCAPNG_H
#define CANWIRE_RECORD_PCAPNG_H

#include "canwire.h"
#include "config/config.h"

#include <stdio.h>

/* Begins a capture of the nodes of config. */
void pcapng_begin(FILE *out, const cfg *config);

/* Adds the interfaces of further nodes to a capture. Their number begins where the others end. */
void pcapng_add_interfaces(FILE *out, const cfg *config);

/* Begins a capture of the nodes of several buses, in their order. Interfaces are named as
 * BUS:NODE. */
void pcapng_begin_all(FILE *out, const cfg *const *buses, size_t count);

/* Returns whether an event makes packets. */
bool pcapng_takes(const cw_event *event);

/* Does the same as pcapng_event() for one of these buses. `first` is the number of nodes of those
 * before it. */
void pcapng_event_of_bus(FILE *out, const cfg *config, unsigned first, const cw_event *event,
                         uint64_t time_ns);

/* Writes the packets of an event, if it has any. config has the nodes that the capture began with;
 * time_ns counts from 1970, or from the start of the bus. */
void pcapng_event(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns);

#endif
